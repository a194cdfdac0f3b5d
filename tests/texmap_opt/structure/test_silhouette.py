"""A part seen along an axis: the outline of its shadow, and how deep it is at each place."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from texmap_opt.builtin_part import builtin_part
from texmap_opt.combine.boolean import difference, prism, shadow, union
from texmap_opt.part import Part
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.chords import chords
from texmap_opt.structure.plane_axes import plane_axes
from texmap_opt.structure.silhouette import silhouette, thickness_inside, wall_depths
from texmap_opt.structure.structure import Structure

Z = np.array([0.0, 0.0, 1.0])


def block(low, high) -> TriMesh:
    size = dict(zip(("length_mm", "width_mm", "height_mm"), np.subtract(high, low), strict=True))
    part = builtin_part("cantilever", {name: float(length) for name, length in size.items()})
    return TriMesh(part.vertices + np.array(low, float), part.faces)


def turned(surface: TriMesh, rotation: Rotation) -> TriMesh:
    return TriMesh(rotation.apply(surface.vertices), surface.faces)


def area(outline) -> float:
    """Shoelace formula, holes negative."""
    total = 0.0
    for polygon in outline:
        (x, y), (u, v) = polygon.T, np.roll(polygon, -1, axis=0).T
        total += float(np.sum(x * v - y * u)) / 2
    return total


def convex(seed: int) -> tuple[TriMesh, np.ndarray]:
    """A random convex polyhedron, and the planes n.x + d <= 0 that it is the intersection of."""
    points = np.random.default_rng(seed).normal(size=(24, 3)) * [3.0, 2.0, 1.0]
    hull = ConvexHull(points)
    a, b, c = np.moveaxis(points[hull.simplices], 1, 0)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
    return TriMesh(points, faces.astype(np.int64)), hull.equations


def walls(ends, radius: float = 0.1) -> Structure:
    joints = np.array(ends, float).reshape(-1, 3)
    count = len(joints) // 2
    struts = np.arange(2 * count).reshape(-1, 2)
    bars = Structure(
        joints,
        struts,
        np.full((count, 2), radius),
        np.zeros(2 * count, bool),
        np.ones(count),
    )
    return bars.extruded(Z, np.array([-100.0, 100.0]))


def depths(ends, surface: TriMesh) -> np.ndarray:
    structure = walls(ends)
    assert structure.extrusion is not None
    return wall_depths(structure, structure.extrusion, Part(surface, "part"))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_the_shadow_of_a_turned_box_has_the_area_of_its_projected_faces(seed: int):
    """The sum of |n . axis| A over the three kinds of faces; a convex body covers its shadow twice."""
    size = np.array([3.0, 2.0, 1.0])
    rotation = Rotation.random(random_state=seed)
    outline = shadow(turned(block([0, 0, 0], size), rotation), np.eye(3), tolerance=1e-9)
    faces = size.prod() / size
    expected = np.abs(rotation.as_matrix()[2]) @ faces
    # Outlines lie on a grid of 1e-8 mm.
    assert area(outline) == pytest.approx(expected, abs=1e-6)


def test_a_hole_along_the_axis_is_one_of_the_shadow_and_a_blind_one_is_not():
    plate = difference(block([0, 0, 0], [10, 10, 2]), block([2, 2, -1], [4, 4, 3]))
    plate = difference(plate, block([6, 6, 1], [8, 8, 3]))
    outline = shadow(plate, np.eye(3), tolerance=1e-9)
    assert len(outline) == 2
    assert area(outline) == pytest.approx(96.0)
    # Seen from the side there is none.
    assert len(shadow(plate, plane_axes(np.array([1.0, 0, 0])), tolerance=1e-9)) == 1


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_a_prism_over_a_shadow_stands_upright_on_it_along_any_axis(seed: int):
    surface = convex(seed)[0]
    axis = Rotation.random(random_state=seed).apply(Z)
    outline = shadow(surface, plane_axes(axis), tolerance=1e-9)
    upright = prism(outline, plane_axes(axis), np.array([-2.0, 5.0]))
    assert upright.volume == pytest.approx(7 * area(outline), rel=1e-9)
    height = upright.vertices @ axis
    assert np.isclose(height, -2).sum() == np.isclose(height, 5).sum() == len(height) / 2


def test_the_silhouette_is_as_far_off_as_the_outline_and_has_its_ends_out_of_reach():
    part = Part(silhouette(block([0, 0, 0], [10, 4, 0.1]), Z), "prism")
    distance = part.signed_distance(np.array([[5.0, 2.0, 0.05], [1.0, 2.0, 0.0], [12.0, 2.0, 0.1]]))
    np.testing.assert_allclose(distance[0], [-2, -1, 2], atol=1e-7)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_chords_of_a_convex_solid_are_those_between_its_planes(seed: int):
    """A line is inside from the last plane that it enters through to the first that it leaves by."""
    surface, planes = convex(seed)
    rng = np.random.default_rng(seed)
    axis = Rotation.random(random_state=seed).apply(Z)
    points = rng.uniform(-3, 3, (200, 3))
    rate = planes[:, :3] @ axis
    at = -(points @ planes[:, :3].T + planes[:, 3]) / rate
    leave = np.where(rate > 0, at, np.inf).min(axis=1)
    enter = np.where(rate < 0, at, -np.inf).max(axis=1)
    found = chords(surface, points, axis)
    np.testing.assert_allclose(found, np.maximum(leave - enter, 0), atol=1e-9)


def test_chords_across_a_round_bar_are_those_of_a_circle():
    """2 sqrt(R² - y²); a chord of the facets is up to 0.01 mm inside, at 53 degrees 1.7 times that."""
    bar = builtin_part("torsion-bar", {"diameter_mm": 20.0, "length_mm": 50.0})
    y = np.array([0.0, 3.0, 6.0, 8.0])
    points = np.stack([np.full(4, 20.0), y, np.zeros(4)], axis=1)
    np.testing.assert_allclose(chords(bar, points, Z), 2 * np.sqrt(100 - y**2), atol=0.04)


def test_lines_through_edges_and_corners_of_facets_count_once():
    """The diagonals of a box's faces, where symmetric lattices have their joints."""
    points = np.array([[1.0, 1.0, 0.0], [2.0, 2.0, 9.0], [0.5, 3.5, -4.0], [1.0, 3.0, 0.0]])
    np.testing.assert_allclose(chords(block([0, 0, 0], [4, 4, 3]), points, Z), 3, rtol=1e-12)


def test_pieces_above_each_other_add_up():
    """A fork: two plates of 1 and 2 mm, joined at one end."""
    fork = union(
        [block([0, 0, 0], [10, 4, 1]), block([0, 0, 3], [10, 4, 5]), block([0, 0, 0], [2, 4, 5])]
    )
    found = chords(fork, np.array([[5.1, 2.3, 0.0], [1.1, 2.3, 0.0], [11.0, 2.3, 0.0]]), Z)
    np.testing.assert_allclose(found, [3, 5, 0], atol=1e-9)


def test_an_open_surface_has_no_chords_where_it_is_open():
    """Negative control: such a line is told apart from one outside."""
    box = block([0, 0, 0], [4, 4, 3])
    lid = np.isclose(box.face_normals[:, 2], 1)
    lidless = TriMesh(box.vertices, box.faces[~lid])
    found = chords(lidless, np.array([[1.2, 2.1, 0.0], [9.0, 2.1, 0.0]]), Z)
    assert np.isnan(found[0])
    assert found[1] == 0


def test_the_depth_of_a_wall_is_the_mean_over_its_length():
    """Over a ramp from 2 to 6 mm: 4 mm; Gauss points are exact for it."""
    ramp = block([0, 0, 0], [10, 4, 2])
    top = np.isclose(ramp.vertices[:, 2], 2)
    ramp.vertices[top, 2] += 0.4 * ramp.vertices[top, 0]
    found = depths([[[0, 1.3, 0], [10, 1.3, 0]], [[0, 1.3, 0], [5, 2.3, 0]]], ramp)
    np.testing.assert_allclose(found, [4, 3], rtol=1e-3)


def test_a_wall_in_a_side_of_the_part_is_half_inside():
    part = block([0, 0, 0], [10, 4, 3])
    found = depths(
        [[[0, 0, 0], [10, 0, 0]], [[0, 2, 0], [10, 2, 0]], [[10, 0, 0], [10, 4, 0]]], part
    )
    np.testing.assert_allclose(found, [1.5, 3.0, 1.5], rtol=1e-12)


def test_a_wall_in_a_step_has_the_mean_depth_of_its_two_sides():
    stairs = union([block([0, 0, 0], [10, 2, 4]), block([0, 1, 0], [10, 4, 2])])
    found = depths([[[1, 2, 0], [9, 2, 0]]], stairs)
    np.testing.assert_allclose(found, 3, rtol=1e-12)


def test_of_a_wall_in_a_side_half_the_thickness_is_inside_and_of_one_in_a_step_all():
    """Half its length in a side and half within: three quarters; a wall given as whole stays so."""
    stairs = union([block([0, 0, 0], [10, 2, 4]), block([0, 1, 0], [5, 4, 2])])
    structure = walls([[[1, 0, 0], [9, 0, 0]], [[1, 2, 0], [4, 2, 0]], [[0, 2, 0], [10, 2, 0]]])
    part, whole = Part(stairs, "part"), structure.extrusion
    assert whole is not None
    inside = replace(whole, depth=wall_depths(structure, whole, part))
    np.testing.assert_allclose(inside.depth, [2, 3, 2.5], rtol=1e-12)
    share = thickness_inside(structure, inside, part)
    np.testing.assert_allclose(share, [1 / 2, 1, 3 / 4], rtol=1e-12)
    np.testing.assert_array_equal(thickness_inside(structure, whole, part), 1)
    off = walls([[[1, 9, 0], [9, 9, 0]]])
    assert off.extrusion is not None
    np.testing.assert_array_equal(thickness_inside(off, off.extrusion, part), 1)
