"""A proof that a hexahedron does not fold: the Bezier coefficients of its Jacobian determinant."""

from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from texmap_opt.warp.hex_grid import HexGrid

# How often an undecided cell is halved along each axis. The gap between the coefficients and the
# determinant falls by 4 per halving: three decide every cell whose smallest determinant is above
# about 1/64 of its variation.
SUBDIVISIONS = 3

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
    nodes: Float[Array, " 3 *nodes"], uniform_edge: Float[Array, " 3"]
) -> tuple[
    Float[Array, "3 1 3 3 *cells"], Float[Array, "3 3 1 3 *cells"], Float[Array, "3 3 3 1 *cells"]
]:
    """Columns of the Jacobian of every cell at the 27 points with coordinates in {0, 1/2, 1}.

    The map of a cell is trilinear, so the derivative along an axis depends on the other two only;
    the axis of length 1 broadcasts. J = I on the uniform grid.

    Args:
        nodes: positions, component first [mm].
        uniform_edge: edges of a uniform cell [mm]; each column is divided by its own.
    """
    columns = []
    for axis in range(3):
        edges = jnp.diff(nodes, axis=1 + axis) / uniform_edge[axis]
        for other in (d for d in (2, 1, 0) if d != axis):
            edges = _at_three(edges, other)
        columns.append(jnp.expand_dims(edges, 1 + axis))
    return columns[0], columns[1], columns[2]


def determinants(
    columns: tuple[
        Float[Array, "3 1 3 3 *cells"],
        Float[Array, "3 3 1 3 *cells"],
        Float[Array, "3 3 3 1 *cells"],
    ],
) -> Float[Array, "3 3 3 *cells"]:
    """Values of det J of every cell at the 27 points: first column . (second x third)."""
    return jnp.sum(columns[0] * cross(columns[1], columns[2]), axis=0)


def bezier_coefficients(det: Float[Array, "3 3 3 *cells"]) -> Float[Array, "3 3 3 *cells"]:
    """The 27 Bezier coefficients of det J from its values at the 27 points.

    det J is a polynomial of degree two in each coordinate of the cell, so this is exact. It is a
    convex combination of the coefficients everywhere in the cell: where all are positive, so is it.
    The eight outer ones are det J at the corners.

    Source: Johnen, Weill, Remacle, "Robust and efficient validation of the linear hexahedral
    element", Procedia Engineering 203 (2017).
    """
    M = jnp.asarray(_TO_BEZIER)
    for _ in range(3):
        # Transforms the first axis and puts it third: three turns do all and restore the order.
        det = jnp.moveaxis(jnp.tensordot(M, det, axes=1), 0, 2)
    return det


@jax.jit
def cell_coefficients(
    nodes: Float[Array, " 3 *nodes"], uniform_edge: Float[Array, " 3"]
) -> Float[Array, "3 3 3 *cells"]:
    """Bezier coefficients of det J of all cells; all 1 on the uniform grid."""
    return bezier_coefficients(determinants(edge_matrices(nodes, uniform_edge)))


def grid_coefficients(grid: HexGrid) -> Float[np.ndarray, "cells 27"]:
    """Bezier coefficients of det J of each cell, relative to the volume of a uniform cell."""
    nodes = jnp.moveaxis(jnp.asarray(grid.nodes), -1, 0)
    coefficients = cell_coefficients(nodes, jnp.asarray(grid.uniform_edge))
    return np.asarray(coefficients).reshape(27, -1).T


def folded(coefficients: Float[np.ndarray, "cells 27"]) -> Bool[np.ndarray, " cells"]:
    """Which cells fold, or cannot be shown not to.

    Not folded: all coefficients positive, on the cell or on each of its parts after at most
    `SUBDIVISIONS` halvings. A coefficient at a corner is a value of det J, so one that is not
    positive decides. A cell that stays undecided counts as folded.
    """
    bad = np.zeros(len(coefficients), dtype=bool)
    parts, owner = coefficients.reshape(-1, 3, 3, 3), np.arange(len(coefficients))
    for _ in range(SUBDIVISIONS + 1):
        corner_bad = ~np.all(parts[:, ::2, ::2, ::2] > 0, axis=(1, 2, 3))
        bad[owner[corner_bad]] = True
        unsure = ~np.all(parts > 0, axis=(1, 2, 3)) & ~bad[owner]
        parts, owner = parts[unsure], owner[unsure]
        if not len(owner):
            return bad
        halves = [_part(parts, octant) for octant in product((0, 1), repeat=3)]
        parts, owner = np.concatenate(halves), np.tile(owner, 8)
    bad[owner[~np.all(parts > 0, axis=(1, 2, 3))]] = True
    return bad


def cross(a: Float[Array, " 3 *_"], b: Float[Array, " 3 *_"]) -> Float[Array, " 3 *_"]:
    """Cross product along the first axis; the others broadcast."""
    return jnp.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _at_three(values: Float[Array, " 3 *_"], axis: int) -> Float[Array, " 3 3 *_"]:
    """Values at the lower end, the middle and the upper end of every cell along a grid axis."""
    # The grid axes are always the last three, however many point axes are already in front.
    along = values.ndim - 3 + axis
    low = jax.lax.slice_in_dim(values, 0, -1, axis=along)
    high = jax.lax.slice_in_dim(values, 1, None, axis=along)
    return jnp.stack([low, (low + high) / 2, high], axis=1)


def _part(
    coefficients: Float[np.ndarray, "cells 3 3 3"], octant: tuple[int, ...]
) -> Float[np.ndarray, "cells 3 3 3"]:
    """Bezier coefficients on one eighth of each cell."""
    X, Y, Z = (_HALVES[half] for half in octant)
    return np.einsum("ai,bj,ck,nijk->nabc", X, Y, Z, coefficients, optimize=True)
