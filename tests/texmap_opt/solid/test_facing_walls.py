"""Thickness and gaps against solids whose walls are known, and what must not count as either."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt.combine.boolean import difference, union
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid import facing_walls as module
from texmap_opt.solid.facing_walls import FacingWalls, facing_walls
from texmap_opt.solid.tri_mesh import TriMesh


def surface(mesh: trimesh.Trimesh) -> TriMesh:
    return TriMesh(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64))


def box(*edges: float, at=(0, 0, 0)) -> TriMesh:
    return surface(trimesh.creation.box(edges).apply_translation(at))


def hull(*points) -> TriMesh:
    return surface(trimesh.convex.convex_hull(np.array(points, dtype=float)))


def rod(start, end, radius: float, sections: int = 24) -> TriMesh:
    """A cylinder whose sides, not corners, are `radius` from its axis."""
    corner = radius / np.cos(np.pi / sections)
    return surface(trimesh.creation.cylinder(corner, segment=[start, end], sections=sections))


def walls(mesh: TriMesh) -> FacingWalls:
    return facing_walls(SignedDistance(mesh), "solid")


def gaps(mesh: TriMesh) -> FacingWalls:
    return facing_walls(SignedDistance(mesh), "air")


PLATE = box(20, 20, 4)


def test_a_plate_is_as_thick_as_it_is_and_has_no_gaps():
    """Chords between its narrow sides are longer, and no ball between them would be empty."""
    found = walls(box(10, 20, 3))
    np.testing.assert_allclose(
        [found.smallest_mm, found.percentile_5_mm, found.median_mm], 3, rtol=1e-6
    )
    assert found.smallest_at_mm is not None
    assert abs(found.smallest_at_mm[2]) < 1e-6
    np.testing.assert_allclose(walls(box(10, 10, 9)).median_mm, 9, rtol=1e-6)
    assert gaps(box(10, 20, 3)).smallest_mm is None


@pytest.mark.parametrize("width", [0.05, 0.7, 3.0])
def test_a_slot_in_a_plate_is_a_gap_of_its_width_and_its_corners_are_none(width):
    found = gaps(difference(PLATE, box(width, 10, 10)))
    np.testing.assert_allclose(found.smallest_mm, width, rtol=1e-5)


@pytest.mark.parametrize("sections", [8, 9, 11, 12, 24])
def test_the_thinnest_strut_of_a_cube_frame_is_found_with_its_diameter(sections):
    """Eleven struts of diameter 1 and one of 0.6: within 2.5 % for every number of sides."""
    corners = 8.0 * np.array(list(np.ndindex(2, 2, 2)))
    pairs = [
        (a, b)
        for a in corners
        for b in corners
        if np.isclose(np.linalg.norm(a - b), 8) and a.sum() < b.sum()
    ]
    radii = [0.3] + [0.5] * (len(pairs) - 1)
    struts = [rod(a, b, r, sections) for (a, b), r in zip(pairs, radii, strict=True)]
    balls = [
        surface(trimesh.creation.icosphere(2, 0.7).apply_translation(corner)) for corner in corners
    ]
    found = walls(union([*struts, *balls]))
    np.testing.assert_allclose(found.smallest_mm, 0.6, rtol=0.025)
    np.testing.assert_allclose(found.median_mm, 1.0, rtol=0.05)
    a, b = pairs[0]
    place = np.array(found.smallest_at_mm)
    along = (place - a) @ (b - a) / 64
    assert 0 < along < 1
    assert np.linalg.norm(place - a - along * (b - a)) < 0.3


def test_a_pin_of_a_ten_millionth_of_the_area_is_found():
    """Points spread over the area alone miss it: the pin has 0.006 of 60,000 mm²."""
    pinned = union([box(100, 100, 100), rod([10, 10, 49], [10, 10, 50.2], 0.005, 12)])
    np.testing.assert_allclose(walls(pinned).smallest_mm, 0.01, rtol=0.02)


@pytest.mark.parametrize("moves", [module.MOVES, 0])
def test_few_samples_on_a_strut_are_enough(moves, monkeypatch):
    """Four points on an octagon: chords beside the axis are moved to it; unmoved they hold no ball."""
    monkeypatch.setattr(module, "AREA_SAMPLES", 2)
    monkeypatch.setattr(module, "MOVES", moves)
    smallest = walls(rod([0, 0, 0], [0, 0, 50], 1.0, 8)).smallest_mm
    if moves:
        np.testing.assert_allclose(smallest, 2.0, rtol=1e-3)
    else:
        assert smallest is None


def test_balls_of_a_hollow_sphere_are_its_wall_outside_and_its_void_inside():
    """Facets of 3 degrees lie within 0.1 % of the spheres; balls are empty to 2 %."""
    outer, inner = (trimesh.creation.icosphere(4, radius) for radius in (5.0, 4.0))
    inner.invert()
    shell = surface(trimesh.util.concatenate([outer, inner]))
    np.testing.assert_allclose(walls(shell).smallest_mm, 1.0, rtol=0.01)
    np.testing.assert_allclose(gaps(shell).smallest_mm, 8.0, rtol=0.03)


def test_the_gap_between_rods_that_pass_each_other_is_found_between_the_samples():
    """Axes at right angles, 2.3 apart, radius 1: 0.3, a facet's chord at most 0.9 % of 2 more."""
    pair = [rod([-5, 0, 0], [5, 0, 0], 1.0), rod([0, -5, 2.3], [0, 5, 2.3], 1.0)]
    found = gaps(union(pair))
    assert found.smallest_mm is not None
    assert 0.27 < found.smallest_mm < 0.32


def bevelled(angle_deg: float) -> TriMesh:
    """A plate 4 thick that ends in a knife edge."""
    tip = 10 + 4 / np.tan(np.radians(angle_deg))
    section = [(0, 0), (tip, 0), (10, 4), (0, 4)]
    return hull(*[(x, y, z) for y in (0, 15) for x, z in section])


@pytest.mark.parametrize("angle", [10.0, 20.0, 28.0, 40.0, 90.0])
def test_a_knife_edge_is_no_thin_wall_and_a_sharp_groove_is_no_gap(angle):
    """Between walls that meet balls shrink to nothing; a knife of 10 degrees still has its plate."""
    smallest = walls(bevelled(angle)).smallest_mm
    np.testing.assert_allclose(smallest, 4.0, rtol=0.02)
    half = 3 * np.tan(np.radians(angle / 2))
    tool = hull(*[(x, y, z) for y in (-11, 11) for x, z in ((0, -1), (-half, 2), (half, 2))])
    assert gaps(difference(PLATE, tool)).smallest_mm is None


def test_without_looking_where_walls_meet_the_knife_edge_would_count(monkeypatch):
    """Negative control of the one above."""
    monkeypatch.setattr(module, "MEETING_REACH", 0.0)
    smallest = walls(bevelled(20.0)).smallest_mm
    assert smallest is not None
    assert smallest < 0.5


def test_a_pyramid_has_no_walls_that_face_each_other():
    assert walls(hull([0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1])).smallest_mm is None


@settings(max_examples=8, derandomize=True, deadline=None)
@given(
    st.floats(0.01, 100.0),
    st.tuples(*[st.floats(-1, 1)] * 3),
    st.tuples(*[st.floats(-50, 50)] * 3),
)
def test_distances_turn_move_and_scale_with_the_solid(scale, turn, shift):
    matrix = trimesh.transformations.euler_matrix(*turn)[:3, :3]
    slotted = difference(PLATE, box(0.7, 10, 10))
    mesh = TriMesh(scale * (slotted.vertices @ matrix.T + np.array(shift)), slotted.faces)
    np.testing.assert_allclose(gaps(mesh).smallest_mm, 0.7 * scale, rtol=1e-4)
    np.testing.assert_allclose(walls(mesh).smallest_mm, 4.0 * scale, rtol=1e-4)
