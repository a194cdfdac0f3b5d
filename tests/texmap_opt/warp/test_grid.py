"""The grid around a part, of hexahedra or, for cells that are extruded, of quadrilaterals."""

import numpy as np
import pytest

from texmap_opt.box import Box
from texmap_opt.errors import WarpError
from texmap_opt.warp.grid import Grid

BOUNDS = np.array([[1.0, 2.0, 3.0], [11.0, 6.0, 9.0]])
PART = Box.aligned(BOUNDS)
FLAT = Box.aligned(BOUNDS, extrusion="z")
UNIT = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])


def test_a_margin_adds_cells_of_the_same_size():
    grid = Grid.around(PART, (5, 2, 3), margin_cells=1, radius_mm=0.5)
    assert grid.cells == (7, 4, 5)
    np.testing.assert_allclose(grid.uniform_edge, 2)
    np.testing.assert_allclose(grid.box.bounds, BOUNDS + np.array([[-2], [2]]))


def test_a_margin_around_a_cross_section_leaves_the_extrusion():
    grid = Grid.around(FLAT, (5, 2), margin_cells=2, radius_mm=0.5)
    assert grid.cells == (9, 6) and grid.dimensions == 2
    np.testing.assert_allclose(grid.box.bounds, BOUNDS + np.outer([-1, 1], [4, 4, 0]))


def test_without_margin_struts_on_faces_stay_whole():
    """Design section 2.1: the box is shrunk by the strut radius."""
    grid = Grid.around(PART, (5, 2, 3), margin_cells=0, radius_mm=0.5)
    assert grid.cells == (5, 2, 3)
    np.testing.assert_allclose(grid.box.bounds, BOUNDS + np.array([[0.5], [-0.5]]))


def test_corners_of_hexahedra_are_in_the_order_of_vtk():
    """VTK_HEXAHEDRON: bottom face counter-clockwise from above, then the top face."""
    grid = Grid.uniform(Box.aligned(UNIT), (1, 1, 1))
    bottom = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    np.testing.assert_array_equal(
        grid.nodes.reshape(-1, 3)[grid.corners[0]], bottom + [[x, y, 1] for x, y, _ in bottom]
    )


def test_corners_of_quadrilaterals_are_in_the_order_of_vtk():
    """VTK_QUAD: counter-clockwise."""
    grid = Grid.uniform(Box.aligned(UNIT, extrusion="z"), (2, 1))
    first, second = grid.nodes.reshape(-1, 2)[grid.corners]
    np.testing.assert_array_equal(first, [[0, 0], [0.5, 0], [0.5, 1], [0, 1]])
    np.testing.assert_array_equal(second, first + np.array([0.5, 0]))


@pytest.mark.parametrize(("box", "cells"), [(PART, (2, 3, 4)), (FLAT, (2, 3))])
def test_nodes_and_centres_of_the_uniform_grid(box, cells):
    grid = Grid.uniform(box, cells)
    assert grid.nodes.shape == (*(n + 1 for n in cells), box.dimensions)
    assert grid.cell_count == np.prod(cells) == len(grid.corners)
    index = np.stack(np.indices(cells), axis=-1).reshape(-1, box.dimensions)
    np.testing.assert_allclose(grid.centres, box.low + (index + 0.5) * grid.uniform_edge)


def test_nodes_of_a_turned_box_lie_on_its_edges_in_space():
    """Axes y, z, x: the grid's first axis runs along y."""
    box = Box.around(BOUNDS, np.eye(3)[[1, 2, 0]])
    grid = Grid.uniform(box, (2, 3, 5))
    np.testing.assert_allclose(grid.positions[0, 0, 0], [1, 2, 3])
    np.testing.assert_allclose(grid.positions[1, 0, 0], [1, 4, 3])
    np.testing.assert_allclose(grid.positions[0, 1, 0], [1, 2, 5])
    np.testing.assert_allclose(grid.positions[0, 0, 1], [3, 2, 3])


def test_nodes_of_a_cross_section_lie_half_way_along_the_extrusion():
    positions = Grid.uniform(FLAT, (2, 2)).positions
    assert positions.shape == (3, 3, 3)
    np.testing.assert_array_equal(positions[..., 2], 6)


@pytest.mark.parametrize(("box", "cells"), [(PART, (2, 3, 4)), (FLAT, (3, 2))])
def test_nodes_slide_in_the_faces_of_the_box(box, cells):
    """Counted: what moves along an axis is all but the two layers of nodes at its ends."""
    free = Grid.uniform(box, cells).free
    for axis, n in enumerate(cells):
        along = np.moveaxis(free[axis], axis, 0)
        assert not along[0].any() and not along[n].any() and along[1:n].all()


def test_nothing_moves_on_a_fixed_face():
    fixed = np.zeros((2, 3), dtype=bool)
    fixed[1, 0] = True
    sliding, grid = Grid.uniform(PART, (3, 3, 3)), Grid.uniform(PART, (3, 3, 3), fixed=fixed)
    assert not grid.free[:, -1].any()
    np.testing.assert_array_equal(grid.free[:, :-1], sliding.free[:, :-1])
    assert sliding.free[:, -1].any()


def test_the_grid_at_rest_has_the_same_box_cells_and_fixed_faces():
    fixed = np.ones((2, 2), dtype=bool)
    grid = Grid.uniform(FLAT, (3, 4), fixed=fixed)
    moved = grid.with_nodes(grid.nodes + 0.1)
    np.testing.assert_array_equal(moved.at_rest.nodes, grid.nodes)
    np.testing.assert_array_equal(moved.at_rest.free, grid.free)
    assert not np.array_equal(moved.free, Grid.uniform(FLAT, (3, 4)).free)


def test_a_radius_that_leaves_nothing_is_refused():
    with pytest.raises(WarpError, match="thinner struts"):
        Grid.around(PART, (5, 2, 3), margin_cells=0, radius_mm=2.0)


@pytest.mark.parametrize(("box", "cells"), [(PART, (3, 0, 2)), (PART, (3, 2)), (FLAT, (3, 2, 2))])
def test_impossible_counts_are_refused(box, cells):
    with pytest.raises(WarpError, match="impossible"):
        Grid.uniform(box, cells)
