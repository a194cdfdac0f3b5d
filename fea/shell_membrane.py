"""Membrane strains of a triangle with drilling rotations: Felippa's optimal element (OPT).

Nine dofs: u, v and the drilling rotation theta (a true rotation about the normal) at each corner.

C. A. Felippa, "A study of optimal membrane triangles with drilling freedoms", Comput. Methods Appl.
Mech. Eng. 192 (2003) 2125-2168, with the free parameters that make rectangles of two triangles exact in
bending in their plane, at any aspect ratio. The stiffness is the sum of two parts:

* basic: constant strain, lumped from displacements of the edges that are Hermite cubics in the corner
  rotations, scaled by alpha. It alone decides the patch test.
* higher order: strains that are linear in the triangle, have no mean, and depend on the corner
  rotations relative to the mean rotation of the triangle.

Felippa writes natural strains (along the three edges) and turns them to plane axes (equation 12). The
strain tensor with natural strains eps_i along edges i of length l_i is -sum_i l_i² eps_i sym(g_i g_jᵀ),
where g are the gradients of the area coordinates at the ends of edge i, so that the lengths cancel.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.shell_plane import NEXT, OPPOSITE, PlaneTriangle, Scalar, dyad, quarter_turn

# Felippa (2003), equation 42: alpha_b.
EDGE_ROTATION = 3 / 2
# The same: beta_0 = max((1 - 4 nu²)/2, 0.01); the floor keeps the rank for nu near 1/2.
LEAST_HIGHER_ORDER = 0.01
# Felippa (2003), equation 32: the factor 3/4 of beta_0 in the higher order stiffness, times the 3 by
# which his sum over mid-sides exceeds the integral.
HIGHER_ORDER_SCALE = 9 / 4

# Felippa (2003), equation 29 with beta_1..9 = 1, 2, 1, 0, 1, -1, -1, -1, -2: 3 l² eps/2A along
# each edge (second index) at each corner (first) by each relative rotation (third).
NATURAL = np.array(
    [
        [[1, 2, 1], [0, 1, -1], [-1, -1, -2]],
        [[-2, -1, -1], [1, 1, 2], [-1, 0, 1]],
        [[1, -1, 0], [-1, -2, -1], [2, 1, 1]],
    ],
    dtype=float,
)


def mean_strain(plane: PlaneTriangle) -> Float[Array, "3 3 3"]:
    """Strain [xx, yy, xy] of the basic stiffness by corner and by u, v, theta.

    Felippa (2003), equation 22: this is Lᵀ/(A h).
    """
    g = plane.gradients
    x, y = jnp.broadcast_to(jnp.eye(2)[:, None], (2, 3, 2))
    lean = quarter_turn(plane.edges)
    lean = dyad(lean, lean)
    # Edge i leaves corner i, edge OPPOSITE[i] arrives there.
    drill = EDGE_ROTATION / 12 / plane.area * (lean[OPPOSITE] - lean)
    return jnp.stack([dyad(x, g), dyad(y, g), drill], axis=-1).transpose(1, 0, 2)


def relative_rotation(plane: PlaneTriangle) -> Float[Array, "3 3 3"]:
    """Corner rotations less the mean rotation of the triangle, by corner and by u, v, theta.

    Felippa (2003), equation 16.
    """
    g = plane.gradients
    mean = jnp.stack([-g[:, 1] / 2, g[:, 0] / 2, jnp.zeros(3)], axis=-1)
    own = np.zeros((3, 3, 3))
    own[np.arange(3), np.arange(3), 2] = 1
    return jnp.asarray(own) - mean[None]


def linear_strain(plane: PlaneTriangle) -> Float[Array, "3 3 3 3"]:
    """Strain of the higher order stiffness at each corner, unscaled, by corner and by u, v, theta.

    The second index is the component; the mean over the corners is zero.
    """
    ends = dyad(plane.gradients, plane.gradients[NEXT])
    by_rotation = -2 / 3 * plane.area * jnp.einsum("aej,es->asj", NATURAL, ends)
    return jnp.einsum("asj,jid->asid", by_rotation, relative_rotation(plane))


def higher_order_share(nu: Scalar) -> Scalar:
    """Factor of the energy of `linear_strain`."""
    return HIGHER_ORDER_SCALE * jnp.maximum((1 - 4 * nu**2) / 2, LEAST_HIGHER_ORDER)
