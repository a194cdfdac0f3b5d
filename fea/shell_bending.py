"""Bending of a thin triangular plate: the discrete Kirchhoff triangle (DKT), by its slope field.

Nine dofs: deflection w along the normal and its slope, the vector g, at each corner. The normal turns
with the rotation vector theta of the corner, so that g = n x theta.

J.-L. Batoz, K.-J. Bathe, L.-W. Ho, "A study of three-node triangular plate bending elements", Int. J.
Numer. Meth. Eng. 15 (1980) 1771-1812. The slope is quadratic in the triangle; at the middle of an edge,
across it, it is the mean of the corners', along it that of the cubic through the corners' deflections
and slopes. With the edge vector e from corner i to j both are one equation without angles: the middle's
slope exceeds the mean of the corners' by e c,

    c = [3 (w_j - w_i) - 3/2 e.(g_i + g_j)] / 2 |e|².

Between the edges DKT does not define the deflection itself; where it is needed, for the mass, it is the
cubic of Bazeley, Cheung, Irons and Zienkiewicz (1965), which has the same edges and contains all
quadratics.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.shell_plane import NEXT, OPPOSITE, PlaneTriangle, dyad

# Area coordinates of the corners.
AT_CORNERS = np.eye(3)


def slopes(plane: PlaneTriangle) -> Float[Array, "6 2 3 3"]:
    """The slope field: at the corners, and in excess of linear at mid-edges; by corner and w, gx, gy.

    The field is sum_i lambda_i slopes[i] + sum_e 4 lambda_i lambda_j slopes[3 + e], edge e from i to j.
    """
    e = plane.edges
    corner = np.zeros((3, 2, 3, 3))
    corner[np.arange(3), 0, np.arange(3), 1] = 1
    corner[np.arange(3), 1, np.arange(3), 2] = 1
    ends = AT_CORNERS[NEXT] - AT_CORNERS, AT_CORNERS[NEXT] + AT_CORNERS
    by_w = 1.5 * ends[0][:, :, None]
    by_g = -0.75 * ends[1][:, :, None] * e[:, None, :]
    c = jnp.concatenate([by_w, by_g], axis=-1) / (e**2).sum(axis=1)[:, None, None]
    return jnp.concatenate([corner, jnp.einsum("ex,eid->exid", e, c)])


def corner_curvatures(plane: PlaneTriangle) -> Float[Array, "3 3 3 3"]:
    """Curvature -sym grad g [xx, yy, 2xy] at each corner, by corner and w, gx, gy; linear between.

    The strain at height z above the middle surface is z times the curvature.
    """
    g = slopes(plane)
    grad = plane.gradients
    x, y = jnp.broadcast_to(jnp.eye(2)[:, None], (2, 3, 2))
    unit = jnp.stack([dyad(x, grad), dyad(y, grad)])  # axis of the slope, corner, component
    linear = jnp.einsum("nxid,xns->sid", g[:3], unit)
    # At its first corner edge e bends as the gradient of its second, and the reverse.
    first = 4 * jnp.einsum("exid,xes->esid", g[3:], unit[:, NEXT])
    second = 4 * jnp.einsum("exid,xes->esid", g[3:], unit)
    return -(linear[None] + first + second[OPPOSITE])


def deflection(plane: PlaneTriangle) -> Float[Array, "9 3 3"]:
    """The deflection's factors of the nine `deflection_shapes`, by corner and w, gx, gy.

    Along edge e from i to j, the shapes take what the slopes at both ends have in excess of the chord's.
    """
    e = plane.edges
    chord = np.broadcast_to((AT_CORNERS[NEXT] - AT_CORNERS)[:, :, None], (3, 3, 1))
    no_slope = np.zeros((3, 3, 2))
    corner = np.concatenate([AT_CORNERS[:, :, None], no_slope], axis=-1)
    first, second = (
        jnp.concatenate([-chord, own[:, :, None] * e[:, None, :]], axis=-1)
        for own in (AT_CORNERS, AT_CORNERS[NEXT])
    )
    return jnp.concatenate([corner, first, -second])


def deflection_shapes(area: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 9"]:
    """The functions whose factors `deflection` gives, at area coordinates."""
    i, j, k = area, area[:, NEXT], area[:, OPPOSITE]
    return np.concatenate([area, i * j * (i + k / 2), i * j * (j + k / 2)], axis=1)


def slope_shapes(area: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 6"]:
    """The functions whose factors `slopes` gives, at area coordinates."""
    return np.concatenate([area, 4 * area * area[:, NEXT]], axis=1)
