"""Is it a solid: every defect is built here, and must be repaired with a report or refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt.builtin_part import builtin_part
from texmap_opt.edge_pairs import EdgePairs, consistently_oriented, with_single_fans
from texmap_opt.errors import PartError
from texmap_opt.repair import repaired
from texmap_opt.self_intersection import crossing_faces, self_overlap
from texmap_opt.solid.tri_mesh import TriMesh


def box(low=(0.0, 0.0, 0.0), high=(1.0, 1.0, 1.0)):
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    size = dict(zip(("length_mm", "width_mm", "height_mm"), (high - low).tolist(), strict=True))
    surface = builtin_part("cantilever", size)
    return TriMesh(surface.vertices + low, surface.faces)


def inverted(surface):
    return TriMesh(surface.vertices, surface.faces[:, ::-1])


def together(*surfaces):
    starts = np.cumsum([0] + [len(s.vertices) for s in surfaces[:-1]])
    return TriMesh(
        np.concatenate([s.vertices for s in surfaces]),
        np.concatenate([s.faces + at for s, at in zip(surfaces, starts, strict=True)]),
    )


def is_solid(surface):
    edges = EdgePairs(surface.faces)
    return edges.open.size == 0 and edges.crowded == 0 and bool(edges.agree.all())


def test_a_good_solid_leaves_as_it_came():
    result = repaired(box(), "box")
    assert result.notes == () and result.surface.volume == pytest.approx(1)


def test_an_inside_out_solid_is_turned_and_reported():
    result = repaired(inverted(box()), "box")
    assert result.surface.volume == pytest.approx(1) and "inside out" in result.notes[0]


def test_single_turned_triangles_are_turned_back_and_counted():
    faces = box().faces.copy()
    faces[4] = faces[4, ::-1]
    result = repaired(TriMesh(box().vertices, faces), "box")
    assert result.notes == ("turned 1 of 12 triangles to agree with their neighbours",)
    assert result.surface.volume == pytest.approx(1)


def test_an_open_box_is_refused_with_its_count():
    surface = box()
    with pytest.raises(PartError, match=r"open: 4 edges .* 1 holes of up to 4 edges.*Repair it"):
        repaired(TriMesh(surface.vertices, surface.faces[2:]), "box")


def test_a_small_hole_is_closed_and_reported():
    bar = builtin_part("torsion-bar", {})
    # One facet of 284, 1 % of the area.
    result = repaired(TriMesh(bar.vertices, bar.faces[:-1]), "bar")
    assert "closed 1 holes (largest 3 edges)" in result.notes[0]
    assert result.surface.volume == pytest.approx(bar.volume) and is_solid(result.surface)


def test_a_missing_piece_of_more_than_the_limit_is_not_made_up():
    bar = builtin_part("torsion-bar", {"length_mm": 2.0})
    with pytest.raises(PartError, match=r"holes of up to 72 edges.* 2 % of the surface"):
        repaired(TriMesh(bar.vertices, bar.faces[70:]), "bar")


def test_degenerate_and_duplicate_triangles_are_dropped_and_counted():
    surface = box()
    extra = np.array([[0, 0, 1], surface.faces[3]])
    result = repaired(TriMesh(surface.vertices, np.concatenate([surface.faces, extra])), "box")
    assert len(result.surface.faces) == 12
    assert result.notes == (
        "dropped 1 degenerate triangles (a corner twice)",
        "dropped 1 duplicate triangles",
    )


def test_a_wall_in_the_middle_that_faces_both_ways_cancels():
    """Two boxes glued face to face share a doubled wall that bounds nothing."""
    left = box()
    mirrored = TriMesh(left.vertices * [-1, 1, 1], left.faces[:, ::-1])
    both = together(left, mirrored)
    positions, index = np.unique(both.vertices + 0.0, axis=0, return_inverse=True)
    result = repaired(TriMesh(positions, index.reshape(-1)[both.faces]), "boxes")
    assert result.notes == ("dropped 4 duplicate triangles",)
    assert result.surface.volume == pytest.approx(2) and is_solid(result.surface)


def test_zero_volume_shells_are_dropped_and_reported():
    flap = TriMesh(
        np.array([[5.0, 0, 0], [6.0, 0, 0], [5.0, 1, 0]]), np.array([[0, 1, 2], [2, 1, 0]])
    )
    # Four triangles of a tetrahedron pressed flat.
    flat = TriMesh(
        np.array([[5.0, 5, 0], [6.0, 5, 0], [5.0, 6, 0], [5.3, 5.3, 0]]),
        np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]),
    )
    result = repaired(together(box(), flap, flat), "box")
    assert len(result.surface.faces) == 12
    assert "dropped 1 zero-volume shell (2 triangles)" in result.notes
    assert "dropped 1 zero-volume shell (4 triangles)" in result.notes


def test_nothing_but_flat_shells_is_refused():
    flap = TriMesh(
        np.array([[0.0, 0, 0], [1.0, 0, 0], [0.0, 1, 0]]), np.array([[0, 1, 2], [2, 1, 0]])
    )
    with pytest.raises(PartError, match="enclose no volume"):
        repaired(flap, "flap")


def test_an_open_scrap_is_dropped_but_an_open_sheet_is_not():
    scrap = TriMesh(np.array([[5.0, 0, 0], [5.01, 0, 0], [5.0, 0.01, 0]]), np.array([[0, 1, 2]]))
    result = repaired(together(box(), scrap), "box")
    assert "dropped 1 open scraps (1 triangles" in result.notes[0]
    sheet = TriMesh(10 * scrap.vertices, scrap.faces)
    with pytest.raises(PartError, match="open: 3 edges"):
        repaired(together(box(), TriMesh(10 * sheet.vertices, sheet.faces)), "box")


def test_several_solids_are_counted_and_one_can_be_chosen():
    both = together(box(), box(low=(3.0, 0.0, 0.0), high=(5.0, 2.0, 2.0)))
    with pytest.raises(PartError, match=r"holds 2 solids \(volumes 8, 1 mm³\).*solid = 1"):
        repaired(both, "boxes")
    assert repaired(both, "boxes", solid=1).surface.volume == pytest.approx(8)
    chosen = repaired(both, "boxes", solid=2)
    assert chosen.surface.volume == pytest.approx(1)
    assert chosen.notes == ("took solid 2 of 2 (volumes 8, 1 mm³)",)
    with pytest.raises(PartError, match=r"solid = 3: it holds 2"):
        repaired(both, "boxes", solid=3)


def test_a_void_belongs_to_its_solid():
    hollow = together(box(high=(3.0, 3.0, 3.0)), inverted(box((1.0, 1.0, 1.0), (2.0, 2.0, 2.0))))
    result = repaired(hollow, "hollow")
    assert result.notes == () and result.surface.volume == pytest.approx(26)
    turned = repaired(inverted(hollow), "hollow")
    assert turned.surface.volume == pytest.approx(26) and "2 shells" in turned.notes[0]


def test_a_solid_in_a_solid_is_two():
    nested = together(box(high=(3.0, 3.0, 3.0)), box((1.0, 1.0, 1.0), (2.0, 2.0, 2.0)))
    with pytest.raises(PartError, match="holds 2 solids"):
        repaired(nested, "nested")


def test_a_void_in_a_void_is_refused():
    nested = together(
        box(high=(5.0, 5.0, 5.0)),
        inverted(box((1.0, 1.0, 1.0), (4.0, 4.0, 4.0))),
        inverted(box((2.0, 2.0, 2.0), (3.0, 3.0, 3.0))),
    )
    with pytest.raises(PartError, match="contradict"):
        repaired(nested, "nested")


def test_solids_that_overlap_little_are_united_and_reported():
    both = together(box(), box(low=(0.98, 0.1, 0.1), high=(2.0, 0.9, 0.9)))
    result = repaired(both, "boxes")
    assert "united 2 solids" in result.notes[0]
    assert result.surface.volume == pytest.approx(1 + 1.0 * 0.64) and is_solid(result.surface)


def test_solids_that_overlap_much_are_refused():
    both = together(box(), box(low=(0.5, 0.1, 0.1), high=(2.0, 0.9, 0.9)))
    with pytest.raises(PartError, match=r"cross each other, which have .* % of their volume"):
        repaired(both, "boxes")


def crossed_bars():
    """One shell that passes through itself: a box whose one end is folded back through it."""
    bar = builtin_part("l-bracket", {"fillet_mm": 1.0})
    vertices = bar.vertices.copy()
    # The end of the upright leg is pulled down through the other leg.
    vertices[np.isclose(vertices[:, 2], 80.0), 2] = -40.0
    return TriMesh(vertices, bar.faces)


def test_a_shell_that_passes_through_itself_is_refused_with_counts():
    with pytest.raises(PartError, match=r"intersects itself: \d+ of \d+ triangles .* mm deep"):
        repaired(crossed_bars(), "bars")


def test_edges_with_more_than_two_triangles_are_counted():
    a, b = box(), box(low=(1.0, 1.0, 0.0), high=(2.0, 2.0, 1.0))
    both = together(a, b)
    positions, index = np.unique(both.vertices, axis=0, return_inverse=True)
    with pytest.raises(PartError, match="1 edges have more than two triangles"):
        repaired(TriMesh(positions, index.reshape(-1)[both.faces]), "boxes")


def test_a_one_sided_surface_is_refused():
    n = 12
    angle = 2 * np.pi * np.arange(n) / n
    middle = np.stack([3 * np.cos(angle), 3 * np.sin(angle), 0 * angle], axis=1)
    half = np.stack(
        [np.cos(angle / 2) * np.cos(angle), np.cos(angle / 2) * np.sin(angle), np.sin(angle / 2)],
        axis=1,
    )
    vertices = np.concatenate([middle + half, middle - half])
    faces = []
    for i in range(n):
        j, twist = (i + 1) % n, (i + 1) // n
        a, b, c, d = i, i + n, j + n * (1 - twist), j + n * twist
        faces += [[a, b, c], [a, c, d]]
    with pytest.raises(PartError, match="one-sided"):
        repaired(TriMesh(vertices, np.array(faces)), "strip")


def test_fans_that_meet_in_one_vertex_are_taken_apart():
    a, b = box(), box(low=(1.0, 1.0, 1.0), high=(2.0, 2.0, 2.0))
    both = together(a, b)
    positions, index = np.unique(both.vertices, axis=0, return_inverse=True)
    joined = TriMesh(positions, index.reshape(-1)[both.faces])
    assert len(joined.vertices) == 15
    apart, added = with_single_fans(joined)
    assert added == 1 and len(apart.vertices) == 16
    np.testing.assert_array_equal(apart.vertices[apart.faces], joined.vertices[joined.faces])


def test_crossings_are_exactly_those_of_two_boxes():
    apart = together(box(), box(low=(1.5, 0.0, 0.0), high=(2.0, 1.0, 1.0)))
    touching = together(box(), box(low=(1.0, 0.2, 0.2), high=(2.0, 0.7, 0.7)))
    through = together(box(), box(low=(0.5, 0.2, 0.2), high=(2.0, 0.7, 0.7)))
    assert len(crossing_faces(apart)) == 0 and len(crossing_faces(touching)) == 0
    pairs = crossing_faces(through)
    # Two triangles of the wall x = 1, crossed by the eight of the small box's sides.
    assert len(pairs) >= 8 and (pairs[:, 0] < 12).all() and (pairs[:, 1] >= 12).all()


@settings(derandomize=True, max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_crossings_agree_with_brute_force(seed):
    """Triangles in general position against dense sampling of the signed volumes of all pairs."""
    random = np.random.default_rng(seed)
    corners = random.uniform(0, 1, (30, 1, 3)) + random.uniform(-0.3, 0.3, (30, 3, 3))
    surface = TriMesh(corners.reshape(-1, 3), np.arange(90).reshape(30, 3))
    expected = {
        (i, j)
        for i in range(30)
        for j in range(i + 1, 30)
        if pierces(corners[i], corners[j]) or pierces(corners[j], corners[i])
    }
    assert {(int(i), int(j)) for i, j in crossing_faces(surface)} == expected


def pierces(a, b):
    """Whether an edge of triangle a meets triangle b (Möller and Trumbore 1997)."""
    for k in range(3):
        start, along = a[k], a[(k + 1) % 3] - a[k]
        matrix = np.stack([-along, b[1] - b[0], b[2] - b[0]], axis=1)
        t, u, v = np.linalg.solve(matrix, start - b[0])
        if 0 < t < 1 and u > 0 and v > 0 and u + v < 1:
            return True
    return False


@pytest.mark.parametrize("overlap", [0.01, 0.2])
def test_depth_of_an_overlap_is_its_thickness(overlap):
    """Two boxes as one surface, sharing a slab of known thickness."""
    both = together(box(), box(low=(1 - overlap, 0.2, 0.2), high=(2.0, 0.7, 0.7)))
    # Rays from the slab's long faces run along it, up to its width of 0.5.
    assert self_overlap(both).depth >= overlap * 0.999
    assert self_overlap(both).depth <= 0.5 + 1e-9


@settings(derandomize=True, max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_orientation_is_restored_whatever_triangles_are_turned(seed):
    bar = builtin_part("l-bracket", {})
    turn = np.random.default_rng(seed).random(len(bar.faces)) < 0.5
    faces = np.where(turn[:, None], bar.faces[:, ::-1], bar.faces)
    oriented = consistently_oriented(faces)
    assert oriented is not None and oriented[1] == min(turn.sum(), (~turn).sum())
    assert abs(TriMesh(bar.vertices, oriented[0]).volume) == pytest.approx(bar.volume)
