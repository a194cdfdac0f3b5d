"""Which cells of a grid points may lie in: boxes around cells, and around blocks of them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.warp.grid import Grid


@dataclass(frozen=True, eq=False)
class _Level:
    """Boxes around blocks of cells, and how the next finer level divides them.

    Attributes:
        shape: number of blocks along each axis.
        low: lowest coordinates of each block [mm].
        high: highest.
        axis: along which the next coarser level joins two blocks into one; -1 for the coarsest.
    """

    shape: tuple[int, ...]
    low: Float[np.ndarray, "blocks d"]
    high: Float[np.ndarray, "blocks d"]
    axis: int


class CellTree:
    """A hierarchy of boxes, made of the grid's own order: two neighbouring blocks make the next.

    However unequal or sheared the cells are, neighbours in the grid are neighbours in space, so the
    boxes stay about as small as the cells in them allow.
    """

    def __init__(self, grid: Grid) -> None:
        corners = grid.nodes.reshape(-1, grid.dimensions)[grid.corners]
        shape, low, high = grid.cells, corners.min(axis=1), corners.max(axis=1)
        self._levels: list[_Level] = []
        while max(shape) > 1:
            axis = int(np.argmax(shape))
            self._levels.append(_Level(shape, low, high, axis))
            pairs = np.arange(0, shape[axis], 2)
            low = np.minimum.reduceat(low.reshape(*shape, -1), pairs, axis=axis)
            high = np.maximum.reduceat(high.reshape(*shape, -1), pairs, axis=axis)
            shape = low.shape[:-1]
            low, high = low.reshape(-1, grid.dimensions), high.reshape(-1, grid.dimensions)
        self._levels.append(_Level(shape, low, high, -1))

    def candidates(
        self, place: Float[np.ndarray, "points d"], slack: float
    ) -> tuple[Int[np.ndarray, " pairs"], Int[np.ndarray, " pairs"]]:
        """Pairs of a point and a cell whose box holds it.

        Args:
            place: coordinates of the points [mm].
            slack: by how much a point may lie outside a box [mm].

        Returns:
            numbers of points, and flat numbers of cells.
        """
        root = self._levels[-1]
        near = np.all((root.low - slack <= place) & (place <= root.high + slack), axis=1)
        point = np.flatnonzero(near)
        block = np.zeros(len(point), dtype=np.int64)
        for coarse, fine in zip(self._levels[:0:-1], self._levels[-2::-1], strict=True):
            index = list(np.unravel_index(block, coarse.shape))
            index[fine.axis] = 2 * index[fine.axis]
            first = np.ravel_multi_index(index, fine.shape)
            index[fine.axis] = index[fine.axis] + 1
            there = index[fine.axis] < fine.shape[fine.axis]
            second = np.ravel_multi_index([i[there] for i in index], fine.shape)
            point, block = np.concatenate([point, point[there]]), np.concatenate([first, second])
            at = place[point]
            holds = np.all(
                (fine.low[block] - slack <= at) & (at <= fine.high[block] + slack), axis=1
            )
            point, block = point[holds], block[holds]
        return point, block
