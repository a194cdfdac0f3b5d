"""The grid around a part."""

import numpy as np
import pytest

from texmap_opt.errors import WarpError
from texmap_opt.warp.hex_grid import HexGrid

BOUNDS = np.array([[1.0, 2.0, 3.0], [11.0, 6.0, 9.0]])


def test_a_margin_adds_cells_of_the_same_size():
    grid = HexGrid.around(BOUNDS, (5, 2, 3), margin_cells=1, radius_mm=0.5)
    assert grid.cells == (7, 4, 5)
    np.testing.assert_allclose(grid.uniform_edge, 2)
    np.testing.assert_allclose(grid.box, BOUNDS + np.array([[-2], [2]]))


def test_without_margin_struts_on_faces_stay_whole():
    """Design section 2.1: the box is shrunk by the strut radius."""
    grid = HexGrid.around(BOUNDS, (5, 2, 3), margin_cells=0, radius_mm=0.5)
    assert grid.cells == (5, 2, 3)
    np.testing.assert_allclose(grid.box, BOUNDS + np.array([[0.5], [-0.5]]))


def test_hexes_are_in_the_order_of_vtk():
    """VTK_HEXAHEDRON: bottom face counter-clockwise from above, then the top face."""
    grid = HexGrid.uniform(np.array([[0.0, 0, 0], [1, 1, 1]]), (1, 1, 1))
    corners = grid.nodes.reshape(-1, 3)[grid.hexes[0]]
    bottom = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    np.testing.assert_array_equal(corners, bottom + [[x, y, 1] for x, y, _ in bottom])


def test_a_radius_that_leaves_nothing_is_refused():
    with pytest.raises(WarpError, match="thinner struts"):
        HexGrid.around(BOUNDS, (5, 2, 3), margin_cells=0, radius_mm=2.0)
