"""The box that is warped, wherever it lies and however it is turned."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from texmap_opt.box import Box, principal_axes
from texmap_opt.errors import WarpError

BOUNDS = np.array([[1.0, 2.0, 3.0], [11.0, 6.0, 9.0]])

turns = st.builds(lambda v: Rotation.from_rotvec(v).as_matrix(), st.tuples(*[st.floats(-3, 3)] * 3))


def test_an_aligned_box_has_positions_for_coordinates():
    box = Box.aligned(BOUNDS)
    points = np.random.default_rng(0).uniform(-5, 20, (20, 3))
    np.testing.assert_array_equal(box.coordinates(points), points)
    np.testing.assert_array_equal(box.positions(points), points)
    np.testing.assert_array_equal(box.extent, [10, 4, 6])


@settings(max_examples=30, derandomize=True, deadline=None)
@given(turns)
def test_positions_undo_coordinates_and_lengths_stay(R):
    box = Box.around(BOUNDS, R)
    points = np.random.default_rng(0).uniform(-5, 20, (20, 3))
    coordinates = box.coordinates(points)
    np.testing.assert_allclose(box.positions(coordinates), points, atol=1e-12 * 20)
    np.testing.assert_allclose(
        np.linalg.norm(coordinates[1:] - coordinates[:-1], axis=1),
        np.linalg.norm(points[1:] - points[:-1], axis=1),
        rtol=1e-12,
    )


@settings(max_examples=30, derandomize=True, deadline=None)
@given(turns)
def test_the_smallest_box_around_points_touches_them_on_every_side(R):
    points = np.random.default_rng(1).normal(size=(50, 3))
    box = Box.around(points, R)
    coordinates = box.coordinates(points)
    np.testing.assert_allclose(coordinates.min(axis=0), box.low, atol=1e-12)
    np.testing.assert_allclose(coordinates.max(axis=0), box.high, atol=1e-12)


@pytest.mark.parametrize(("extrusion", "order"), [("x", "yzx"), ("y", "zxy"), ("z", "xyz")])
def test_the_cross_section_is_normal_to_the_extrusion(extrusion, order):
    """Third axis the extrusion's, the others in the cyclic order that keeps it right-handed."""
    box = Box.aligned(BOUNDS, extrusion=extrusion)
    columns = ["xyz".index(letter) for letter in order]
    assert box.dimensions == 2
    np.testing.assert_array_equal(box.axes, np.eye(3)[columns])
    np.testing.assert_array_equal(box.bounds, BOUNDS[:, columns])
    np.testing.assert_array_equal(box.extent, (BOUNDS[1] - BOUNDS[0])[columns[:2]])


@pytest.mark.parametrize("extrusion", ["x", "y", "z"])
def test_a_point_of_the_cross_section_lies_half_way_along_the_extrusion(extrusion):
    box = Box.aligned(BOUNDS, extrusion=extrusion)
    point = np.array([[4.0, 3.0, 5.0]])
    k = "xyz".index(extrusion)
    expected = point.copy()
    expected[0, k] = BOUNDS[:, k].mean()
    np.testing.assert_allclose(box.positions(box.coordinates(point)), expected, rtol=1e-15)


def test_growing_moves_both_sides_of_each_axis_but_not_the_extrusion():
    np.testing.assert_array_equal(
        Box.aligned(BOUNDS).grown(np.array([1.0, 2.0, -0.5])).bounds,
        [[0, 0, 3.5], [12, 8, 8.5]],
    )
    flat = Box.aligned(BOUNDS, extrusion="z").grown(np.array([1.0, 2.0]))
    np.testing.assert_array_equal(flat.bounds, [[0, 0, 3], [12, 8, 9]])
    assert flat.dimensions == 2


@pytest.mark.parametrize(
    ("axes", "dimensions", "message"),
    [
        (np.diag([1.0, 1.0, -1.0]), 3, "left-handed"),
        (np.diag([1.0, 2.0, 0.5]), 3, "unit vectors at right angles"),
        (np.array([[1.0, 0, 0], [0.1, 1, 0], [0, 0, 1]]), 3, "unit vectors at right angles"),
        (np.eye(3), 1, "2 or 3 dimensions"),
    ],
)
def test_axes_that_are_no_system_are_refused(axes, dimensions, message):
    with pytest.raises(WarpError, match=message):
        Box(axes, BOUNDS, dimensions)


@settings(max_examples=30, derandomize=True, deadline=None)
@given(turns)
def test_principal_axes_of_a_turned_cuboid_are_its_edges_longest_first(R):
    """Edges 6, 3, 1; the sign of an axis is that of its largest component."""
    corners = np.array(list(np.ndindex(2, 2, 2))) * [3.0, 1.0, 6.0] @ R.T
    axes = principal_axes(corners, np.ones(8))
    edges = R.T[[2, 0, 1]]
    np.testing.assert_allclose(np.abs(np.sum(axes * edges, axis=1)), 1, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(axes), 1, atol=1e-12)
    for axis in axes[:2]:
        assert axis[np.argmax(np.abs(axis))] > 0
    np.testing.assert_allclose(np.sort(Box.around(corners, axes).extent), [1, 3, 6], atol=1e-12)


def test_heavy_points_turn_the_principal_axes():
    """Two crossing bars of equal points: the heavier one is the first axis."""
    x, y = np.zeros((5, 3)), np.zeros((5, 3))
    x[:, 0] = y[:, 1] = np.linspace(-1, 1, 5)
    weights = np.repeat([1.0, 3.0], 5)
    np.testing.assert_allclose(
        principal_axes(np.concatenate([x, y]), weights)[0], [0, 1, 0], atol=1e-12
    )


def test_principal_axes_do_not_depend_on_where_the_points_are():
    points = np.random.default_rng(3).normal(size=(30, 3)) * [3, 2, 1]
    weights = np.random.default_rng(4).uniform(0.5, 1, 30)
    np.testing.assert_allclose(
        principal_axes(points + np.array([100.0, -50.0, 20.0]), weights),
        principal_axes(points, weights),
        atol=1e-10,
    )


def test_points_without_weight_have_no_principal_axes():
    with pytest.raises(WarpError, match="without weight"):
        principal_axes(BOUNDS, np.zeros(2))
