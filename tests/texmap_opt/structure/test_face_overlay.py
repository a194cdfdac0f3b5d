"""Two faces on each other: what coincides, crosses, touches, and what is tied."""

from dataclasses import replace

import numpy as np

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.unit_cell import TICKS, UnitCell
from texmap_opt.structure.face_overlay import FaceOverlay, face_overlay

STILL = ((False,) * 3, (False,) * 3)


def prism(name: str, places: list[tuple[float, float]], lines: list[tuple[int, int]]) -> UnitCell:
    """A cell with the same pattern in both faces across z, joined by struts along z."""
    n = len(places)
    flat = np.array(places, float)
    joints = np.concatenate([np.insert(flat, 2, z, axis=1) for z in (0.0, 1.0)])
    struts = [(k, k + n) for k in range(n)]
    struts += [(a + z, b + z) for z in (0, n) for a, b in lines]
    return replace(
        unit_cell("cube"),
        name=name,
        joint_names=tuple(map(str, range(2 * n))),
        joints=joints,
        struts=np.array(struts),
        relative_radius=np.ones(len(struts)),
    )


def laid(lower: UnitCell, upper: UnitCell) -> FaceOverlay:
    return face_overlay((lower, upper), STILL, 2)


def segments(overlay: FaceOverlay, pairs: np.ndarray) -> set[frozenset[tuple[float, ...]]]:
    places = np.round(overlay.points / TICKS, 6)
    return {frozenset(map(tuple, places[pair].tolist())) for pair in pairs}


def test_a_joint_on_a_strut_of_the_other_cell_splits_it():
    lower = prism("bar", [(0, 0.5), (1, 0.5)], [(0, 1)])
    upper = prism("post", [(0.25, 0.5), (0.75, 0.5)], [])
    overlay = laid(lower, upper)
    assert segments(overlay, overlay.pieces) == {
        frozenset([(0.0, 0.5), (0.25, 0.5)]),
        frozenset([(0.25, 0.5), (0.75, 0.5)]),
        frozenset([(0.75, 0.5), (1.0, 0.5)]),
    }
    assert overlay.split.all()
    assert not len(overlay.transitions)


def test_struts_that_overlap_on_a_line_are_cut_at_each_others_ends():
    lower = prism("left", [(0, 0.5), (0.6, 0.5)], [(0, 1)])
    upper = prism("right", [(0.4, 0.5), (1, 0.5)], [(0, 1)])
    overlay = laid(lower, upper)
    middle = frozenset([(0.4, 0.5), (0.6, 0.5)])
    both = [segments(overlay, overlay.pieces[overlay.piece_side == side]) for side in (0, 1)]
    assert both[0] & both[1] == {middle}
    assert len(both[0] | both[1]) == 3


def test_three_struts_through_one_place_share_one_joint():
    """Directions with irrational slopes, whose crossings differ in rounding."""
    angle = 2 * np.pi * np.arange(6) / 6 + 0.3
    spokes = [(0.5 + 0.4 * np.cos(a), 0.5 + 0.4 * np.sin(a)) for a in angle]
    lower = prism("two", [spokes[k] for k in (0, 3, 1, 4)], [(0, 1)])
    upper = prism("three", [spokes[k] for k in (1, 4, 2, 5)], [(0, 1), (2, 3)])
    overlay = laid(lower, upper)
    crossings = overlay.points[~overlay.of_kind.any(axis=1)] / TICKS
    np.testing.assert_allclose(crossings, [[0.5, 0.5]], atol=1e-8)


def test_a_joint_behind_struts_is_tied_to_what_it_sees():
    """The centre sees neither corner past the square around it, so it is tied to the square."""
    ring = [(0.3, 0.3), (0.7, 0.3), (0.7, 0.7), (0.3, 0.7)]
    lower = prism("ring", [*ring, (0.5, 0.5)], [(0, 1), (1, 2), (2, 3), (3, 0)])
    upper = prism("posts", [(0, 0), (1, 0), (1, 1), (0, 1)], [])
    overlay = laid(lower, upper)
    assert overlay.joined().all()
    tied = segments(overlay, overlay.transitions)
    assert frozenset([(0.0, 0.0), (0.3, 0.3)]) in tied
    assert frozenset([(0.5, 0.5), (0.3, 0.3)]) in tied
    assert not any({(0.5, 0.5), corner} <= ends for ends in tied for corner in [(0.0, 0.0)])


def test_of_two_ties_that_cross_the_shorter_stays():
    """The joint whose nearest is behind the shorter tie takes the nearest that it then sees."""
    far, near, right, top = (0.0, 0.05), (0.5, 0.0), (1.0, 0.05), (0.6, 0.95)
    overlay = laid(prism("pair", [far, near], []), prism("other", [right, top], []))
    assert segments(overlay, overlay.transitions) == {
        frozenset(tie) for tie in [(near, right), (near, top), (far, top)]
    }


def test_a_tie_is_as_thick_as_the_thinner_of_what_it_joins():
    lower = prism("thin", [(0.5, 0.5)], [])
    thin = replace(lower, relative_radius=np.array([0.5]))
    thick = prism("thick", [(0, 0), (1, 1)], [])
    overlay = laid(thin, replace(thick, relative_radius=np.array([1.5, 2.0])))
    np.testing.assert_array_equal(overlay.transition_radius, [0.5, 0.5])


def test_kinds_of_the_plane_meet_on_a_line():
    """In two dimensions a face is an edge: what lies between two joints is tied along it."""
    still = ((False,) * 2, (False,) * 2)
    overlay = face_overlay((unit_cell("octagon"), unit_cell("square")), still, 0)
    assert overlay.points.shape[1] == 1
    assert overlay.joined().all()
