"""From points in space to coordinates in a warped grid, and back."""

from dataclasses import dataclass
from enum import IntEnum
from itertools import product

import numpy as np
from jaxtyping import Bool, Float, Int

from texmap_opt.errors import WarpError
from texmap_opt.warp.cell_tree import CellTree
from texmap_opt.warp.certificate import cofactors
from texmap_opt.warp.grid import Grid

# A point that a cell's map misses by no more than this share of the largest coordinate is in the
# cell: rounding of the coordinates themselves and of the few sums of the map.
ROUNDING = 32 * np.finfo(np.float64).eps

# Local coordinates this near to 0 or 1 are on the face: above rounding, below the promised 1e-10.
ON_FACE = 1e-11

# Newton's method squares its error, so the step after one this small changes nothing.
LAST_STEP = 1e-9

# On random grids at the verge of folding 98 of 100 cells take at most six. One that takes many is
# divided instead.
NEWTON_STEPS = 12

# A root is sought this far beyond a cell, in cells: a step may overshoot and come back.
OVERSHOOT = 1.0

# How often a cell in which Newton's method lost its way is halved: it then starts within 2^-12 of
# the root.
SUBDIVISIONS = 12

# Parts of cells a point may lie in, at most, while they are halved: in one that has collapsed all
# parts are at the same place.
MAX_PARTS = 512

# Points searched for at once: about 3 kB each, so that all of them together need not fit in memory.
CHUNK = 32_768


class PointStatus(IntEnum):
    """Whether a point has coordinates in a grid.

    FOUND: it has. OUTSIDE: it lies outside the box. FAILED: it lies where the grid is folded, in a
    cell turned inside out or collapsed.
    """

    FOUND = 0
    OUTSIDE = 1
    FAILED = 2


@dataclass(frozen=True, eq=False)
class GridCoordinates:
    """Where points lie in a grid.

    Attributes:
        xi: along each axis of the grid, from 0 to the number of cells, whole numbers on the faces
            between cells; NaN for points not found.
        status: of each point, values of `PointStatus`.
    """

    xi: Float[np.ndarray, "points d"]
    status: Int[np.ndarray, " points"]

    @property
    def found(self) -> Bool[np.ndarray, " points"]:
        """Which points have coordinates."""
        return self.status == PointStatus.FOUND

    @property
    def cell(self) -> Int[np.ndarray, "points d"]:
        """Indices of each found point's cell, the lowest of those that share it; -1 for others."""
        lowest = np.maximum(np.ceil(np.where(np.isnan(self.xi), 0.0, self.xi)) - 1, 0)
        return np.where(self.found[:, None], lowest, -1).astype(np.int64)


@dataclass(frozen=True, eq=False)
class _CellMaps:
    """The multilinear maps of cells, from local coordinates in [0, 1] to coordinates [mm].

    Attributes:
        origin: lowest corner of each cell [mm].
        terms: coefficients of the monomials in each cell; index 1 along an axis for those with the
            local coordinate of that axis as a factor. Without the constant, which is the origin:
            what is left is as small as the cell, and so is its rounding.
    """

    origin: Float[np.ndarray, "cells d"]
    terms: Float[np.ndarray, "cells *_ d"]

    @classmethod
    def of(cls, grid: Grid) -> "_CellMaps":
        d = grid.dimensions
        ends = (slice(None, -1), slice(1, None))
        corners = np.stack(
            [
                grid.nodes[tuple(ends[side] for side in corner)].reshape(-1, d)
                for corner in product((0, 1), repeat=d)
            ],
            axis=1,
        )
        origin = corners[:, 0]
        terms = (corners - origin[:, None]).reshape(-1, *[2] * d, d)
        for axis in range(1, d + 1):
            low, high = np.take(terms, 0, axis=axis), np.take(terms, 1, axis=axis)
            terms = np.stack([low, high - low], axis=axis)
        return cls(origin, terms)

    def gathered(self, cell: Int[np.ndarray, " parts"]) -> Float[np.ndarray, "*_ d parts"]:
        """Terms of the given cells, last axis first to be fast to compute with."""
        return np.ascontiguousarray(np.moveaxis(self.terms[cell], 0, -1))


@dataclass(frozen=True, eq=False)
class _Parts:
    """Parts of cells in which points may lie.

    Attributes:
        point: number of the point.
        cell: flat number of the cell.
        low: lowest local coordinates of the part, component first.
        size: edge of all parts in local coordinates, a power of 1/2.
    """

    point: Int[np.ndarray, " parts"]
    cell: Int[np.ndarray, " parts"]
    low: Float[np.ndarray, "d parts"]
    size: float

    def __getitem__(self, which: Bool[np.ndarray, " parts"]) -> "_Parts":
        return _Parts(self.point[which], self.cell[which], self.low[:, which], self.size)

    def halved(self) -> "_Parts":
        """The 2^d halves of each along all axes."""
        half = self.size / 2
        octants = half * np.array(list(product((0, 1), repeat=len(self.low))), dtype=float)
        low = (self.low[:, None] + octants.T[:, :, None]).reshape(len(self.low), -1)
        count = len(octants)
        return _Parts(np.tile(self.point, count), np.tile(self.cell, count), low, half)


def positions_at(grid: Grid, xi: Float[np.ndarray, "points d"]) -> Float[np.ndarray, "points 3"]:
    """Points in space [mm] of grid coordinates; in two dimensions half way along the extrusion.

    Raises:
        WarpError: if coordinates are not from 0 to the number of cells.
    """
    count = np.array(grid.cells)
    out = ~np.all((xi >= 0) & (xi <= count), axis=1)
    if out.any():
        raise WarpError(
            f"{int(out.sum())} of {len(xi)} grid coordinates, such as {xi[out][0].tolist()}, are not "
            f"in the grid of {' x '.join(map(str, grid.cells))} cells: give each from 0 to the "
            "number of cells along its axis."
        )
    cell = np.minimum(xi.astype(np.int64), count - 1)
    flat = np.asarray(np.ravel_multi_index(tuple(cell.T), grid.cells))
    maps = _CellMaps.of(grid)
    offset, _ = _multilinear(maps.gathered(flat), (xi - cell).T)
    return grid.box.positions(maps.origin[flat] + offset.T)


def grid_coordinates(grid: Grid, points: Float[np.ndarray, "points 3"]) -> GridCoordinates:
    """Solves the map of the grid for points in space [mm]; exact to 1e-10 of a cell.

    A cell lies in the box around its corners, and a part of it in the one around the part's. So a
    hierarchy of such boxes gives every cell that a point may lie in; Newton's method from the
    middle solves for the local coordinates; and where it finds no root in any of the cells, they
    are halved along each axis, and it starts again from the middle of the parts that may hold the
    point. What is left is the rounding of the points over the thickness of the cell.

    In a grid without folds (`certificate.folded`) this finds every point of the box. In a folded
    one it reports most of the points that lie in several cells, not all.

    Args:
        grid: the grid.
        points: in space; in two dimensions only their place in the cross-section matters.

    Raises:
        WarpError: if a point is not finite.
    """
    if not np.all(np.isfinite(points)):
        bad = int(np.sum(~np.all(np.isfinite(points), axis=1)))
        raise WarpError(
            f"{bad} of {len(points)} points have coordinates that are not finite numbers: leave "
            "them out."
        )
    box = grid.box
    place = box.coordinates(points)
    slack = ROUNDING * float(np.abs(box.bounds).max())
    inside = np.all((place >= box.low - slack) & (place <= box.high + slack), axis=1)
    xi = np.full(place.shape, np.nan)
    status = np.full(len(points), int(PointStatus.OUTSIDE))
    maps, tree = _CellMaps.of(grid), CellTree(grid)
    numbers = np.flatnonzero(inside)
    for first in range(0, len(numbers), CHUNK):
        chunk = numbers[first : first + CHUNK]
        at = np.clip(place[chunk], box.low, box.high)
        cell, local = _located(maps, tree, at, slack)
        index = np.stack(np.unravel_index(np.maximum(cell, 0), grid.cells), axis=1)
        xi[chunk] = np.where((cell >= 0)[:, None], index + local, np.nan)
        status[chunk] = np.where(cell >= 0, int(PointStatus.FOUND), int(PointStatus.FAILED))
    return GridCoordinates(xi, status)


def _located(
    maps: _CellMaps, tree: CellTree, place: Float[np.ndarray, "points d"], slack: float
) -> tuple[Int[np.ndarray, " points"], Float[np.ndarray, "points d"]]:
    """Cell of each point, -1 where there is none or a folded one, and local coordinates in it."""
    count, d = place.shape
    cell, local = np.full(count, -1), np.zeros((count, d))
    folded = np.zeros(count, dtype=bool)
    point, candidate = tree.candidates(place, slack)
    parts = _Parts(point, candidate, np.zeros((d, len(point))), 1.0)
    for _ in range(SUBDIVISIONS + 1):
        terms = maps.gathered(parts.cell)
        target = (place[parts.point] - maps.origin[parts.cell]).T
        xi, det, hit = _newton(terms, target, parts.low + parts.size / 2, slack)
        folded[parts.point[hit & (det <= 0)]] = True
        # Which of several cells that share a point is kept makes no difference to its coordinates.
        cell[parts.point[hit]] = parts.cell[hit]
        local[parts.point[hit]] = xi[:, hit].T
        parts = parts[cell[parts.point] < 0]
        if not len(parts.point):
            break
        parts = _that_may_hold(maps, parts.halved(), place, slack)
    return np.where(folded, -1, cell), local


def _that_may_hold(
    maps: _CellMaps, parts: _Parts, place: Float[np.ndarray, "points d"], slack: float
) -> _Parts:
    """The parts whose box holds their point, unless a point is in too many."""
    terms = maps.gathered(parts.cell)
    target = (place[parts.point] - maps.origin[parts.cell]).T
    low, high = np.full(target.shape, np.inf), np.full(target.shape, -np.inf)
    for corner in product((0.0, parts.size), repeat=len(target)):
        at, _ = _multilinear(terms, parts.low + np.array(corner)[:, None])
        low, high = np.minimum(low, at), np.maximum(high, at)
    parts = parts[np.all((low - slack <= target) & (target <= high + slack), axis=0)]
    return parts[np.bincount(parts.point, minlength=1)[parts.point] <= MAX_PARTS]


def _newton(
    terms: Float[np.ndarray, "*_ d parts"],
    target: Float[np.ndarray, "d parts"],
    start: Float[np.ndarray, "d parts"],
    slack: float,
) -> tuple[Float[np.ndarray, "d parts"], Float[np.ndarray, " parts"], Bool[np.ndarray, " parts"]]:
    """Local coordinates where each map takes its target, det J there, and whether in the cell.

    Args:
        terms: see `_CellMaps`.
        target: relative to the lowest corner [mm].
        start: local coordinates to start from.
        slack: by how much the map may miss its target [mm].
    """
    xi = start.copy()
    running = np.arange(xi.shape[1])
    T, x, y = terms, start, target
    for _ in range(NEWTON_STEPS):
        value, J = _multilinear(T, x)
        step, _ = _solved(J, y - value)
        x = x + step
        xi[:, running] = x
        # A step from where det J = 0 is not finite, and fails the first comparison.
        near = np.all(np.abs(x - 0.5) <= 0.5 + OVERSHOOT, axis=0)
        going = near & np.any(np.abs(step) > LAST_STEP, axis=0)
        if not going.any():
            break
        running, T, x, y = running[going], T[..., going], x[:, going], y[:, going]
    xi = np.clip(xi, 0.0, 1.0)
    value, J = _multilinear(terms, xi)
    _, det = _solved(J, value)
    hit = np.all(np.abs(value - target) <= slack, axis=0)
    face = np.rint(xi)
    return np.where(np.abs(xi - face) < ON_FACE, face, xi), det, hit


def _multilinear(
    terms: Float[np.ndarray, "*_ d parts"], xi: Float[np.ndarray, "d parts"]
) -> tuple[Float[np.ndarray, "d parts"], Float[np.ndarray, "d d parts"]]:
    """Values of multilinear maps, and their derivatives: column, component, part."""
    d = len(xi)
    value, columns = terms, [terms] * d
    # One axis after the other: the first axis left is the one that goes.
    for axis in range(d):
        value = value[0] + xi[axis] * value[1]
        columns = [c[1] if k == axis else c[0] + xi[axis] * c[1] for k, c in enumerate(columns)]
    return value, np.stack(columns)


def _solved(
    J: Float[np.ndarray, "d d parts"], right: Float[np.ndarray, "d parts"]
) -> tuple[Float[np.ndarray, "d parts"], Float[np.ndarray, " parts"]]:
    """J^-1 times a vector by cofactors, and det J; not finite where that is zero."""
    normals = np.stack(cofactors(tuple(J)))
    det = np.sum(J[0] * normals[0], axis=0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.sum(normals * right, axis=1) / det, det
