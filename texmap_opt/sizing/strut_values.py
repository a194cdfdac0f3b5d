"""Values of grid cells at the middle of struts."""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import map_coordinates

from texmap_opt.structure.structure import Origin, Structure
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.inverse_map import grid_coordinates


def strut_values(
    structure: Structure, origin: Origin, grid: Grid, values: Float[np.ndarray, " cells"]
) -> Float[np.ndarray, " struts"]:
    """Values of cells, linear between their middles in the grid's own coordinates, at struts' middles.

    A strut in a face between two cells gets the mean of both, one in an edge that of four, so that
    symmetric grids give symmetric values. Beyond the middles of the outermost cells they stay as there.
    A middle that rounding puts outside the grid takes the value of the strut's cell.

    Args:
        structure: joints and struts.
        origin: of its struts, cells of the grid.
        grid: the grid.
        values: of its cells, in C order.
    """
    middle = structure.joints[structure.struts].mean(axis=1)
    place = grid_coordinates(grid, middle)
    result = values[origin.cell]
    index = place.xi[place.found].T - 0.5
    cells = values.reshape(grid.cells)
    result[place.found] = map_coordinates(cells, index, order=1, mode="nearest")
    return result
