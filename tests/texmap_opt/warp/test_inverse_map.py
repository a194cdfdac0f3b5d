"""From points to coordinates in a warped grid, and back."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from texmap_opt.box import Box
from texmap_opt.errors import WarpError
from texmap_opt.warp.certificate import folded, grid_coefficients
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.inverse_map import PointStatus, grid_coordinates, positions_at

BOUNDS = np.array([[-3.0, 5.0, 1.0], [7.0, 9.0, 4.0]])
BOXES = {
    2: Box(Rotation.from_rotvec([0.3, 2.0, -1.0]).as_matrix(), BOUNDS, 2),
    3: Box(Rotation.from_rotvec([-1.3, 0.2, 0.4]).as_matrix(), BOUNDS),
}
DIMENSIONS = pytest.mark.parametrize("d", [2, 3])


def wavy(d, cells, amplitude):
    """A smooth warp that shears and squeezes; amplitude relative to the box."""
    grid = Grid.uniform(BOXES[d], cells)
    u = (grid.nodes - grid.box.low) / grid.box.extent
    wave = np.sin(np.pi * u)
    moves = wave * np.cos(2 * np.pi * np.roll(u, 1, axis=-1))
    return grid.with_nodes(grid.nodes + amplitude * moves * grid.box.extent)


def rough(d, cells, seed, share):
    """Random moves of all free nodes, by `share` of the largest that leave the grid certified."""
    grid = Grid.uniform(BOXES[d], cells)
    moves = np.random.default_rng(seed).normal(size=grid.nodes.shape) * grid.uniform_edge
    moves = moves * np.moveaxis(grid.free, 0, -1)
    low, high = 0.0, 4.0
    for _ in range(30):
        middle = (low + high) / 2
        sound = grid_coefficients(grid.with_nodes(grid.nodes + middle * moves)).min() > 0
        low, high = (middle, high) if sound else (low, middle)
    return grid.with_nodes(grid.nodes + share * low * moves)


def graded(d):
    """Edges from 1 to 1/2000 along the first axis, and sheared by several of them."""
    grid = Grid.uniform(BOXES[d], (12,) + (4,) * (d - 1))
    u = (grid.nodes - grid.box.low) / grid.box.extent
    x = np.expm1(8 * u[..., 0]) / np.expm1(8)
    u[..., 0] = x + 0.8 * x * (1 - x) * np.sin(3 * np.pi * u[..., 1])
    return grid.with_nodes(grid.box.low + u * grid.box.extent)


def random_xi(grid, count, seed=0):
    return np.random.default_rng(seed).random((count, grid.dimensions)) * np.array(grid.cells)


def assert_round_trip(grid, xi):
    """Found, at the coordinates it came from to 1e-10 of a cell, and in the lowest cell."""
    assert not folded(grid_coefficients(grid)).any()
    back = grid_coordinates(grid, positions_at(grid, xi))
    np.testing.assert_array_equal(back.status, PointStatus.FOUND)
    np.testing.assert_allclose(back.xi, xi, rtol=0, atol=1e-10)
    np.testing.assert_array_equal(back.cell, np.maximum(np.ceil(xi) - 1, 0))


@DIMENSIONS
def test_in_the_uniform_grid_coordinates_are_lengths_over_edges(d):
    grid = Grid.uniform(BOXES[d], (4, 5, 3)[:d])
    xi = random_xi(grid, 50)
    points = grid.box.positions(grid.box.low + xi * grid.uniform_edge)
    np.testing.assert_allclose(positions_at(grid, xi), points, atol=1e-12)
    np.testing.assert_allclose(grid_coordinates(grid, points).xi, xi, atol=1e-11)


@DIMENSIONS
def test_nodes_have_whole_coordinates(d):
    grid = wavy(d, (6, 5, 4)[:d], 0.1)
    xi = np.stack(np.indices(grid.nodes.shape[:-1]), axis=-1).reshape(-1, d).astype(float)
    np.testing.assert_allclose(positions_at(grid, xi), grid.positions.reshape(-1, 3), atol=1e-12)
    back = grid_coordinates(grid, grid.positions.reshape(-1, 3))
    np.testing.assert_array_equal(back.xi, xi)


@settings(max_examples=15, derandomize=True, deadline=None)
@given(st.sampled_from([2, 3]), st.integers(0, 10_000), st.floats(0.3, 0.97))
def test_points_of_rough_grids_are_found_to_1e_10_of_a_cell(d, seed, share):
    grid = rough(d, (4, 5, 3)[:d], seed, share)
    xi = random_xi(grid, 300, seed)
    # Rounding over the thickness of a cell is all that may be left: not cells without any.
    assume(grid_coefficients(grid).min() > 1e-4)
    assert_round_trip(grid, xi)


@settings(max_examples=15, derandomize=True, deadline=None)
@given(st.sampled_from([2, 3]), st.integers(0, 10_000))
def test_points_on_faces_edges_and_corners_are_found_in_the_lowest_cell(d, seed):
    grid = rough(d, (4, 5, 3)[:d], seed, 0.7)
    xi = random_xi(grid, 300, seed)
    whole = np.random.default_rng(seed).random(xi.shape) < 0.6
    assert_round_trip(grid, np.where(whole, np.rint(xi), xi))


@DIMENSIONS
def test_points_of_small_strongly_sheared_cells_are_found(d):
    grid = graded(d)
    assert grid_coefficients(grid).min() < 1e-2
    assert_round_trip(grid, random_xi(grid, 2000))


@DIMENSIONS
def test_the_first_method_failing_on_some_cells_does_not_lose_a_point(d):
    """On the verge of folding Newton's method from the middle of the cell fails for a few points.

    Those are found by halving their cells. Rounding of the points over the thickness of the cell
    then leaves more than 1e-10: the point of the coordinates is tested instead.
    """
    for seed in range(3):
        grid = rough(d, (2,) * d, seed, 1.0)
        points = positions_at(grid, random_xi(grid, 3000, seed))
        back = grid_coordinates(grid, points)
        assert back.found.all()
        np.testing.assert_allclose(positions_at(grid, back.xi), points, rtol=0, atol=1e-9)


@DIMENSIONS
def test_points_outside_the_box_are_told_from_those_on_its_faces(d):
    grid = wavy(d, (5,) * d, 0.1)
    place = np.tile((grid.box.low + grid.box.high) / 2, (2 * d, 1))
    for axis in range(d):
        place[2 * axis, axis], place[2 * axis + 1, axis] = grid.box.bounds[:, axis]
    on = grid_coordinates(grid, grid.box.positions(place))
    assert on.found.all()
    for axis in range(d):
        np.testing.assert_array_equal(on.xi[2 * axis : 2 * axis + 2, axis], [0, 5])
    centre = (grid.box.low + grid.box.high) / 2
    beyond = grid_coordinates(grid, grid.box.positions(place + 1e-9 * (place - centre)))
    np.testing.assert_array_equal(beyond.status, PointStatus.OUTSIDE)
    assert np.isnan(beyond.xi).all() and (beyond.cell == -1).all()


def test_in_two_dimensions_the_place_along_the_extrusion_does_not_matter():
    grid = wavy(2, (4, 4), 0.1)
    xi = random_xi(grid, 20)
    points = positions_at(grid, xi)
    along = np.outer(np.linspace(-10, 10, 20), grid.box.axes[2])
    np.testing.assert_allclose(grid_coordinates(grid, points + along).xi, xi, atol=1e-11)
    mean = points @ grid.box.axes[2]
    np.testing.assert_allclose(mean, grid.box.bounds[:, 2].mean(), atol=1e-12)


@DIMENSIONS
def test_points_where_a_grid_is_folded_fail(d):
    """Negative control: inner nodes in reverse order along the first axis, so most cells overlap.

    Everything is covered by cells turned inside out but for the outermost layers.
    """
    grid = Grid.uniform(BOXES[d], (6,) * d)
    nodes = grid.nodes.copy()
    inner = (slice(2, -2),) * d
    nodes[inner] = nodes[inner][::-1]
    bad = grid.with_nodes(nodes)
    assert folded(grid_coefficients(bad)).any()
    back = grid_coordinates(bad, grid.box.positions(grid.centres))
    middle = np.all(
        np.abs(grid.centres - (grid.box.low + grid.box.high) / 2) < grid.uniform_edge, axis=1
    )
    assert middle.sum() == 2**d
    assert (back.status[middle] == PointStatus.FAILED).all()
    assert np.isnan(back.xi[middle]).all()
    assert (back.status != PointStatus.OUTSIDE).all()


def test_more_points_than_are_searched_at_once_are_found():
    grid = wavy(3, (30, 25, 20), 0.1)
    assert_round_trip(grid, random_xi(grid, 40_000))


def test_no_points_have_no_coordinates():
    back = grid_coordinates(wavy(2, (3, 3), 0.1), np.zeros((0, 3)))
    assert back.xi.shape == (0, 2) and back.status.shape == (0,)


def test_points_that_are_not_finite_are_refused():
    points = np.zeros((3, 3))
    points[1, 2] = np.nan
    with pytest.raises(WarpError, match="1 of 3 points"):
        grid_coordinates(wavy(3, (3, 3, 3), 0.1), points)


@pytest.mark.parametrize("xi", [[-0.1, 1.0], [1.0, 3.1], [np.nan, 1.0]])
def test_coordinates_outside_the_grid_are_refused(xi):
    with pytest.raises(WarpError, match="from 0 to the number of cells"):
        positions_at(wavy(2, (3, 3), 0.1), np.array([xi]))
