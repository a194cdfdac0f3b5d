"""From a coarse grid to a finer one over the same box."""

from itertools import product

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from texmap_opt.warp.certificate import grid_coefficients
from texmap_opt.warp.grid import Grid

# A grid of fewer cells than this is solved in less time than a coarser one takes to compile.
WORTH_COARSENING = 6000

# Cells along an axis below which halving them leaves too little to follow f.
LEAST_CELLS = 4

# Halvings of a prolonged displacement; the first always suffices where counts are even.
HALVINGS = 10


def coarser(grid: Grid) -> list[Grid]:
    """Grids over the same box with about half the cells along each axis, coarsest first.

    The last one is the uniform grid of `grid` itself.
    """
    levels = [grid.at_rest]
    while levels[0].cell_count > WORTH_COARSENING and min(levels[0].cells) >= 2 * LEAST_CELLS:
        cells = tuple((n + 1) // 2 for n in levels[0].cells)
        levels.insert(0, Grid.uniform(grid.box, cells, fixed=grid.fixed))
    return levels


def prolonged(nodes: Float[Array, " d *nodes"], grid: Grid) -> Float[Array, " d *_"]:
    """Nodes of `grid` where the map of a coarser grid without folds takes them.

    Where a number of cells has doubled, cells divide cells: the map is the same, and the coefficients
    of the parts are convex combinations of those of the whole (de Casteljau), so nothing folds.
    Where it was odd a cell may straddle two, which proves nothing; then the displacement is halved
    until the grid is certified.

    Args:
        nodes: of the coarser grid, component first [mm].
        grid: uniform.
    """
    start = np.moveaxis(grid.nodes, -1, 0)
    displacement = _multilinear(np.asarray(nodes), grid.cells) - start
    for _ in range(HALVINGS):
        moved = start + displacement
        if grid_coefficients(grid.with_nodes(np.moveaxis(moved, 0, -1))).min() > 0:
            return jnp.asarray(moved)
        displacement = displacement / 2
    return jnp.asarray(start)


def _multilinear(
    nodes: Float[np.ndarray, " d *nodes"], cells: tuple[int, ...]
) -> Float[np.ndarray, " d *_"]:
    """Values at evenly divided coordinates of the grid."""
    first, part = [], []
    for n, coarse in zip(cells, nodes.shape[1:], strict=True):
        at = np.arange(n + 1) * (coarse - 1) / n
        lower = np.minimum(at.astype(int), coarse - 2)
        first.append(lower)
        part.append(at - lower)
    total = np.zeros((len(nodes), *(n + 1 for n in cells)))
    for corner in product((0, 1), repeat=len(cells)):
        index = np.ix_(*[lower + side for lower, side in zip(first, corner, strict=True)])
        weights = [p if side else 1 - p for p, side in zip(part, corner, strict=True)]
        weight = np.prod(np.stack(np.meshgrid(*weights, indexing="ij")), axis=0)
        total += weight * nodes[(slice(None), *index)]
    return total
