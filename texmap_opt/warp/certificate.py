"""A proof that a cell does not fold: the Bezier coefficients of its Jacobian determinant.

The functions of nodes work on arrays of NumPy and of JAX alike. A certificate takes the former:
compiling would take longer than all of its arithmetic on 262,144 cells.
"""

from itertools import product

import numpy as np
from jaxtyping import Array, Bool, Float

from texmap_opt.warp.grid import Grid

# How often an undecided cell is halved along each axis. The gap between the coefficients and the
# determinant falls by 4 per halving: three decide every cell whose smallest determinant is above
# about 1/64 of its variation.
SUBDIVISIONS = 3

# Cells per block: what a block needs of memory stays in the processor's cache.
BLOCK_CELLS = 4096

Numbers = Array | np.ndarray

# From values at 0, 1/2, 1 to Bezier coefficients of a parabola: its middle one is
# 2 p(1/2) - (p(0) + p(1)) / 2.
_TO_BEZIER = np.array([[1.0, 0.0, 0.0], [-0.5, 2.0, -0.5], [0.0, 0.0, 1.0]])

# de Casteljau's algorithm at 1/2: Bezier coefficients on the lower and on the upper half.
_HALVES = np.array(
    [
        [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.25, 0.5, 0.25]],
        [[0.25, 0.5, 0.25], [0.0, 0.5, 0.5], [0.0, 0.0, 1.0]],
    ]
)


def edge_matrices(
    nodes: Float[Numbers, " d *nodes"], uniform_edge: Float[Numbers, " d"]
) -> tuple[Float[Numbers, "..."], ...]:
    """Columns of the Jacobian of every cell at the points with coordinates in {0, 1/2, 1}.

    The map of a cell is linear along each axis, so the derivative along an axis depends on the
    others only: one array per column, of shape component, 3 along every axis of the cell but 1
    along the column's own (it broadcasts), cells. J = I on the uniform grid.

    Args:
        nodes: coordinates, component first [mm].
        uniform_edge: edges of a uniform cell [mm]; each column is divided by its own.
    """
    xp, d = nodes.__array_namespace__(), nodes.shape[0]
    columns = []
    for axis in range(d):
        edges = xp.diff(nodes, axis=1 + axis) / uniform_edge[axis]
        for other in (k for k in reversed(range(d)) if k != axis):
            edges = _at_three(edges, d, other)
        columns.append(xp.expand_dims(edges, 1 + axis))
    return tuple(columns)


def determinants(columns: tuple[Float[Numbers, "..."], ...]) -> Float[Numbers, "..."]:
    """Values of det J of every cell at the 3^d points, 3 along each axis first."""
    product = columns[0] * normal(columns[1:])
    return product.__array_namespace__().sum(product, axis=0)


def normal(columns: tuple[Float[Numbers, "..."], ...]) -> Float[Numbers, "..."]:
    """The vector whose product with another column is their determinant: all but one are given.

    In three dimensions the cross product of two columns, in two a quarter turn of one; components
    along the first axis, the others broadcast.
    """
    xp = columns[0].__array_namespace__()
    if len(columns) == 1:
        return xp.stack([columns[0][1], -columns[0][0]])
    a, b = columns
    return xp.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def cofactors(columns: tuple[Float[Numbers, "..."], ...]) -> tuple[Float[Numbers, "..."], ...]:
    """Columns of the matrix of cofactors, that is det J times J^-T."""
    if len(columns) == 2:
        return normal(columns[1:]), -normal(columns[:1])
    return tuple(normal((columns[(k + 1) % 3], columns[(k + 2) % 3])) for k in range(3))


def bezier_coefficients(det: Float[Numbers, "..."], dimensions: int) -> Float[Numbers, "..."]:
    """The 3^d Bezier coefficients of det J from its values at the 3^d points.

    det J is a polynomial of degree two in each coordinate of the cell, so this is exact. It is a
    convex combination of the coefficients everywhere in the cell: where all are positive, so is it.
    The 2^d outer ones are det J at the corners.

    Source: Johnen, Weill, Remacle, "Robust and efficient validation of the linear hexahedral
    element", Procedia Engineering 203 (2017).
    """
    xp = det.__array_namespace__()
    for axis in range(dimensions):
        low, middle, high = (_between(det, axis, k, k + 1) for k in range(3))
        inner = 2.0 * middle - (low + high) / 2.0
        det = xp.concat([low, inner, high], axis=axis)
    return det


def grid_coefficients(grid: Grid) -> Float[np.ndarray, "cells _"]:
    """Bezier coefficients of det J of each cell, relative to the volume of a uniform cell."""
    d = grid.dimensions
    nodes = np.ascontiguousarray(np.moveaxis(grid.nodes, -1, 0))
    coefficients = np.zeros((*[3] * d, *grid.cells))
    layers = max(1, BLOCK_CELLS * grid.cells[0] // grid.cell_count)
    for first in range(0, grid.cells[0], layers):
        columns = edge_matrices(nodes[:, first : first + layers + 1], grid.uniform_edge)
        block = (*[slice(None)] * d, slice(first, first + layers))
        coefficients[block] = bezier_coefficients(determinants(columns), d)
    return coefficients.reshape(3**d, -1).T


def folded(coefficients: Float[np.ndarray, "cells _"]) -> Bool[np.ndarray, " cells"]:
    """Which cells fold, or cannot be shown not to.

    Not folded: all coefficients positive, on the cell or on each of its parts after at most
    `SUBDIVISIONS` halvings. A coefficient at a corner is a value of det J, so one that is not
    positive decides. A cell that stays undecided counts as folded.
    """
    d = {9: 2, 27: 3}[coefficients.shape[1]]
    bad = np.zeros(len(coefficients), dtype=bool)
    undecided = np.flatnonzero(~np.all(coefficients > 0, axis=1))
    parts, owner = coefficients[undecided].reshape(-1, *[3] * d), undecided
    points = tuple(range(1, d + 1))
    for _ in range(SUBDIVISIONS):
        corners = parts[(slice(None), *[slice(None, None, 2)] * d)]
        bad[owner[~np.all(corners > 0, axis=points)]] = True
        unsure = ~np.all(parts > 0, axis=points) & ~bad[owner]
        parts, owner = parts[unsure], owner[unsure]
        if not len(owner):
            return bad
        halves = [_part(parts, octant) for octant in product((0, 1), repeat=d)]
        parts, owner = np.concatenate(halves), np.tile(owner, 2**d)
    bad[owner[~np.all(parts > 0, axis=points)]] = True
    return bad


def _at_three(values: Float[Numbers, "..."], dimensions: int, axis: int) -> Float[Numbers, "..."]:
    """Values at the lower end, the middle and the upper end of every cell along a grid axis."""
    # The grid axes are always the last ones, however many point axes are already in front.
    along = values.ndim - dimensions + axis
    low, high = _between(values, along, 0, -1), _between(values, along, 1, None)
    return values.__array_namespace__().stack([low, (low + high) / 2, high], axis=1)


def _between(values: Numbers, axis: int, start: int, stop: int | None) -> Numbers:
    """A slice along one axis."""
    return values[(*[slice(None)] * axis, slice(start, stop))]


def _part(
    coefficients: Float[np.ndarray, "cells ..."], octant: tuple[int, ...]
) -> Float[np.ndarray, "cells ..."]:
    """Bezier coefficients on the half (per axis) of each cell that `octant` names."""
    for axis, half in enumerate(octant):
        turned = np.tensordot(_HALVES[half], coefficients, axes=(1, 1 + axis))
        coefficients = np.moveaxis(turned, 0, 1 + axis)
    return coefficients
