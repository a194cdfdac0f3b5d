"""Trimming a lattice to a part: cut at the surface, nothing loose, one piece."""

import numpy as np
import pytest

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.errors import LatticeError
from texmap_opt.part import Part
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.strut_pieces import strut_pieces
from texmap_opt.structure.tile import tile
from texmap_opt.structure.trim import trim

SKIN = 0.2


def bar(length: float, width: float, height: float) -> Part:
    """A box with its lowest corner at the origin."""
    axes = ([0.0, length], [0.0, width], [0.0, height])
    vertices = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    quads = np.array(
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    )
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return Part(TriMesh(vertices, faces), "bar")


def beside(*parts: Part) -> Part:
    """Several solids as one part."""
    count = np.cumsum([0] + [len(p.surface.vertices) for p in parts])
    return Part(
        TriMesh(
            np.concatenate([p.surface.vertices for p in parts]),
            np.concatenate([p.surface.faces + n for p, n in zip(parts, count, strict=False)]),
        ),
        "parts",
    )


def moved(part: Part, shift) -> Part:
    return Part(
        TriMesh(part.surface.vertices + np.array(shift, float), part.surface.faces), "moved"
    )


def lattice(cell: str, low, edge: float, cells, radius: float = 0.5) -> Structure:
    axes = [a + edge * np.arange(n + 1) for a, n in zip(low, cells, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).astype(float)
    return map_structure(tile(unit_cell(cell), tuple(n - 1 for n in grid.shape[:3])), grid, radius)


def single_struts(*ends) -> Structure:
    joints = np.array(ends, float).reshape(-1, 3)
    n = len(joints) // 2
    return Structure(
        joints,
        np.arange(2 * n).reshape(-1, 2),
        np.tile([[0.1, 0.3]], (n, 1)),
        np.zeros(2 * n, bool),
        np.ones(n),
    )


def everywhere(points: np.ndarray) -> np.ndarray:
    return np.ones(len(points), bool)


def test_a_grid_with_a_margin_is_trimmed_to_the_cells_within():
    """Lattice planes coincide with the part's faces: what lies in a face is inside, whole."""
    whole = lattice("octet", (-5, -5, -5), 5.0, (22, 6, 6))
    trimmed = trim(whole, bar(100, 20, 20), skin_mm=0.0)
    inner = lattice("octet", (0, 0, 0), 5.0, (20, 4, 4))
    assert len(trimmed.structure.joints) == len(inner.joints)
    assert len(trimmed.structure.struts) == len(inner.struts)
    np.testing.assert_allclose(trimmed.structure.lengths().sum(), inner.lengths().sum())
    assert trimmed.counts.struts_cut == trimmed.counts.loose_struts == 0
    assert trimmed.counts.components == 1
    on_face = (np.abs(trimmed.structure.joints - [0, 0, 0]) < 1e-9).any(axis=1)
    assert trimmed.structure.cut[on_face].all()
    trimmed.structure.validate()


@pytest.mark.parametrize("shift", [1e-7, -1e-7])
def test_rounding_does_not_decide_what_lies_in_a_face(shift: float):
    whole = lattice("octet", (-5 + shift, -5 - shift, -5 + shift), 5.0, (22, 6, 6))
    trimmed = trim(whole, bar(100, 20, 20), skin_mm=0.0)
    inner = lattice("octet", (0, 0, 0), 5.0, (20, 4, 4))
    assert len(trimmed.structure.struts) == len(inner.struts)


def test_struts_are_cut_where_they_cross():
    part = bar(10, 10, 10)
    pieces = strut_pieces(single_struts([-1, 5, 5], [11, 5, 5], [5, 5, 2], [5, 5, 20]), part)
    first, second = pieces.structure.joints[pieces.structure.struts]
    np.testing.assert_allclose(first, [[0, 5, 5], [10, 5, 5]], atol=1e-12)
    np.testing.assert_allclose(second, [[5, 5, 2], [5, 5, 10]], atol=1e-12)
    # The taper goes on: radius is linear along the strut.
    np.testing.assert_allclose(
        pieces.structure.radii,
        [[0.1 + 0.2 / 12, 0.1 + 0.2 * 11 / 12], [0.1, 0.1 + 0.2 * 8 / 18]],
    )
    np.testing.assert_array_equal(pieces.structure.cut[pieces.structure.struts], [[1, 1], [0, 1]])
    assert (pieces.outside, pieces.cut) == (0, 2)


def test_a_strut_that_leaves_and_comes_back_is_cut_into_its_inside_pieces():
    part = beside(
        bar(10, 10, 10), moved(bar(10, 10, 10), (15, 0, 0)), moved(bar(1, 10, 10), (30, 0, 0))
    )
    pieces = strut_pieces(single_struts([5, 5, 5], [40, 5, 5]), part)
    x = np.sort(pieces.structure.joints[pieces.structure.struts][:, :, 0], axis=1)
    np.testing.assert_allclose(x[np.argsort(x[:, 0])], [[5, 10], [15, 25], [30, 31]], atol=1e-9)


def test_touching_an_edge_does_not_cut_a_strut():
    """One diagonal from edge to edge, one along a face from edge to edge."""
    part = bar(10, 10, 10)
    pieces = strut_pieces(single_struts([0, 0, 5], [10, 10, 5], [0, 5, 0], [0, 5, 10]), part)
    assert pieces.cut == 0
    assert len(pieces.structure.struts) == 2


def test_a_strut_outside_that_touches_a_corner_is_dropped():
    pieces = strut_pieces(single_struts([-1, 1, 5], [1, -1, 5]), bar(10, 10, 10))
    assert len(pieces.structure.struts) == 0
    assert pieces.outside == 1


def test_dangling_ends_go_unless_a_skin_or_a_region_holds_them():
    whole = lattice("bcc", (-2.5, -2.5, -2.5), 5.0, (9, 5, 5))
    part = bar(40, 20, 20)
    bare = trim(whole, part, skin_mm=0.0)
    skin = trim(whole, part, skin_mm=SKIN)
    held = trim(whole, part, skin_mm=0.0, in_region=lambda p: p[:, 0] < 0.1)
    assert bare.counts.struts < held.counts.struts < skin.counts.struts
    assert bare.structure.degrees().min() == 2
    assert skin.counts.loose_struts == 0
    assert skin.structure.cut[skin.structure.degrees() == 1].all()
    loose = held.structure.joints[held.structure.degrees() == 1]
    assert len(loose)
    assert (loose[:, 0] < 0.1).all()


def test_loose_ends_unravel_until_nothing_is_loose():
    """A chain of three struts hanging from a triangle goes, strut by strut."""
    joints = [[1, 1, 1], [3, 1, 1], [1, 3, 1], [4, 4, 1], [6, 6, 1], [8, 8, 1]]
    struts = [[0, 1], [1, 2], [2, 0], [2, 3], [3, 4], [4, 5]]
    s = Structure(
        np.array(joints, float),
        np.array(struts),
        np.full((6, 2), 0.1),
        np.zeros(6, bool),
        np.ones(6),
    )
    trimmed = trim(s, bar(10, 10, 10), skin_mm=SKIN)
    assert trimmed.counts.loose_struts == 3
    assert len(trimmed.structure.struts) == 3


def test_a_stub_within_the_joints_own_sphere_is_left_out():
    """Joint 0.3 mm below the face, radius 0.5: it reaches the skin without the stub."""
    part = bar(10, 10, 9.7)
    s = lattice("cube", (0, 0, -0.6), 5.0, (2, 2, 3))
    trimmed = trim(s, part, skin_mm=SKIN)
    top = trimmed.structure.joints[:, 2].max()
    assert top == pytest.approx(9.4)
    assert trimmed.counts.slivers == 9
    assert trimmed.in_skin[trimmed.structure.joints[:, 2] > 9].all()
    assert len(trimmed.in_skin) == len(trimmed.structure.joints)


def test_slivers_are_pieces_shorter_than_a_share_of_their_cell():
    """Nine stubs of 0.4 mm in cells of 5 mm: eight stand on joints in the part's sides.

    The joint of the ninth lies deeper than its radius and would not reach the surface without it.
    """
    s = lattice("cube", (0, 0, -0.4), 5.0, (2, 2, 3), radius=0.2)
    assert trim(s, bar(10, 10, 10), skin_mm=SKIN).counts.slivers == 0
    assert trim(s, bar(10, 10, 10), skin_mm=SKIN, sliver_mm=0.07 * 5.0).counts.slivers == 0
    assert trim(s, bar(10, 10, 10), skin_mm=SKIN, sliver_mm=0.09 * 5.0).counts.slivers == 8


def test_the_largest_piece_stays_and_the_rest_is_counted():
    """Blocks of 8 x 2 x 2 and 1 x 2 x 2 octet cells: 4 x 132 + 12 x 32 = 912 struts, and 128."""
    part = beside(bar(40, 10, 10), moved(bar(5, 10, 10), (60, 0, 0)))
    s = lattice("octet", (0, 0, 0), 5.0, (13, 2, 2))
    with pytest.raises(LatticeError, match=r"falls into 2 pieces that hold 87\.7%, 12\.3% of"):
        trim(s, part, skin_mm=SKIN)
    trimmed = trim(s, part, skin_mm=SKIN, least_share=0.8)
    assert trimmed.counts.components == 2
    assert trimmed.counts.dropped_share == pytest.approx(128 / 1040)
    np.testing.assert_array_equal(trimmed.structure.components(), 0)
    assert trimmed.structure.joints[:, 0].max() == pytest.approx(40)


def test_pieces_that_only_the_skin_connects_stay_with_it():
    """Two blocks of octet in one bar: apart without a skin, one piece under it."""
    whole = lattice("octet", (0, 0, 0), 5.0, (13, 2, 2))
    x = whole.joints[whole.struts][..., 0]
    apart = whole.select(~((x > 41) & (x < 59)).any(axis=1))
    part = bar(65, 10, 10)
    with pytest.raises(LatticeError, match="falls into 2 pieces"):
        trim(apart, part, skin_mm=0.0)
    trimmed = trim(apart, part, skin_mm=SKIN)
    assert trimmed.counts.components == 1
    assert trimmed.counts.dropped_share == 0
    assert trimmed.structure.components().max() == 1
    small = trimmed.structure.joints[:, 0] > 50
    assert small.any()
    assert 0 < trimmed.counts.skin_only_share < 0.2


def test_a_piece_that_floats_inside_the_skin_is_dropped():
    ring = [[5, 5, 5], [6, 5, 5], [5, 6, 5]]
    cross = [[0, 5, 2], [10, 5, 2]]
    s = Structure(
        np.array(ring + cross, float),
        np.array([[0, 1], [1, 2], [2, 0], [3, 4]]),
        np.full((4, 2), 0.1),
        np.zeros(5, bool),
        np.ones(4),
    )
    trimmed = trim(s, bar(10, 10, 10), skin_mm=SKIN, least_share=0.5)
    assert len(trimmed.structure.struts) == 1
    assert trimmed.in_skin.all()
    with pytest.raises(LatticeError, match="falls into 2 pieces"):
        trim(s, bar(10, 10, 10), skin_mm=SKIN)


def test_joints_grown_together_with_the_skin_are_held():
    """Half a strut's section in common at skin + r/sqrt(2) below the surface; one deeper is loose."""
    r = 0.5
    for deeper, struts in ((-1e-6, 1), (1e-6, 0)):
        z = SKIN + r / np.sqrt(2) + deeper
        s = Structure(
            np.array([[2, 5, 5], [8, 5, z], [2, 5, 10], [2, 5, 0]], float),
            np.array([[0, 1], [0, 2], [0, 3]]),
            np.full((3, 2), r),
            np.zeros(4, bool),
            np.ones(3),
        )
        trimmed = trim(s, bar(10, 10, 10), skin_mm=SKIN)
        assert trimmed.counts.loose_struts == 1 - struts
        assert len(trimmed.structure.struts) == 2 + struts


def test_a_lattice_beside_the_part_is_refused():
    s = lattice("octet", (100, 0, 0), 5.0, (2, 2, 2))
    with pytest.raises(LatticeError, match=r"No strut .* inside the part \(10 x 10 x 10 mm\)"):
        trim(s, bar(10, 10, 10), skin_mm=SKIN)


def test_cells_too_large_for_the_part_are_refused_with_the_remedy():
    s = lattice("octet", (-7, -7, -7), 20.0, (2, 2, 2))
    with pytest.raises(LatticeError, match=r"loose ends: .* smaller cells .*skin_mm"):
        trim(s, bar(10, 10, 10), skin_mm=0.0)
    with pytest.raises(
        LatticeError, match=r"falls into 3 pieces that hold 33\.3%, 33\.3%, 33\.3% of"
    ):
        trim(s, bar(10, 10, 10), skin_mm=0.0, in_region=everywhere)
