"""Geometric stiffness and mass of the flat triangular shell, for buckling and vibration."""

import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import block_diag
from jaxtyping import Array, Float

from fea.beam import BLOCK
from fea.shell import Triangle, bending_dofs, membrane_dofs
from fea.shell_bending import deflection, deflection_shapes, slope_shapes, slopes
from fea.shell_membrane import mean_strain
from fea.shell_plane import PlaneTriangle, Scalar, plane_stress_root

# Gauss points a direction: exact to degree 7, where products of cubics need 6 (and 1 for the collapse).
GAUSS_POINTS = 4


def _mean_products(
    shapes: Float[np.ndarray, "points shapes"],
) -> Float[np.ndarray, "shapes shapes"]:
    return shapes.T @ (_WEIGHTS[:, None] * shapes)


def _collapsed_rule() -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, " points"]]:
    """Area coordinates and weights, which sum to 1: a Gauss rule of the square with one side collapsed."""
    x, weight = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    s, t = (axis.ravel() for axis in np.meshgrid((1 + x) / 2, (1 + x) / 2, indexing="ij"))
    area = np.stack([1 - s, s * (1 - t), s * t], axis=1)
    return area, np.outer(weight, weight).ravel() / 2 * s


_AREA, _WEIGHTS = _collapsed_rule()
# Means over the triangle of products of two shapes.
LINEAR = _mean_products(_AREA)
QUADRATIC = _mean_products(slope_shapes(_AREA))
CUBIC = _mean_products(deflection_shapes(_AREA))


def shell_geometric_stiffness(
    triangle: Triangle, E: Scalar, nu: Scalar, u: Float[Array, "18"]
) -> Float[Array, "18 18"]:
    """Change of the stiffness of one triangle by its membrane forces [N/mm, N, N mm]; linear in u.

    The work of the membrane forces N on the second-order strains (Green's): their mean over the triangle,
    times N: the integral of N_xy g_x g_y with the slope g of `fea.shell_bending` across the plane, and of
    N_xy v_k,x v_k,y with linear displacements v in the plane. Tension stiffens; buckling is where
    K + factor K_G is singular. What the bending moments contribute is left out, as usual for thin plates.

    Args:
        triangle: one.
        E: Young's modulus [MPa].
        nu: Poisson's ratio.
        u: displacements and rotations of its nodes under the reference load.
    """
    plane = PlaneTriangle.of(triangle.corners)
    strain = jnp.einsum("sid,id->s", membrane_dofs(mean_strain(plane), plane), u.reshape(3, BLOCK))
    root = plane_stress_root(nu)
    N = E * triangle.thickness * (root.T @ root) @ strain
    N = jnp.stack([jnp.stack([N[0], N[2]]), jnp.stack([N[2], N[1]])])
    slope = bending_dofs(slopes(plane), plane)
    across = jnp.einsum("pxid,xy,pq,qyje->idje", slope, N, QUADRATIC, slope)
    g = plane.gradients
    t = plane.axes[:2]
    within = jnp.einsum("ix,xy,jy,kd,ke->idje", g, N, g, t, t)
    moves = ((0, 0), (0, BLOCK - 3), (0, 0), (0, BLOCK - 3))
    whole = plane.area * (across + jnp.pad(within, moves))
    return whole.reshape(3 * BLOCK, 3 * BLOCK)


def shell_mass(triangle: Triangle, density: Scalar) -> Float[Array, "18 18"]:
    """Consistent mass of one triangle [tonne, tonne mm, tonne mm²]; positive definite.

    Displacements are linear in the plane and the cubic of `fea.shell_bending` across it; the section's
    rotary inertia density h³/12 turns with the slope. Rotation about the normal has the same inertia, of
    which the mechanics of a thin shell knows nothing: without it the matrix would be singular, and it
    changes frequencies in the plane by the order of (h/wavelength)² only, which plane stress neglects too.

    Args:
        triangle: one.
        density: [tonne/mm³].
    """
    plane = PlaneTriangle.of(triangle.corners)
    h = triangle.thickness
    rotary = h**2 / 12
    t = plane.axes
    linear = block_diag(t[:2].T @ t[:2], rotary * jnp.outer(t[2], t[2]))
    w = bending_dofs(deflection(plane), plane)
    slope = bending_dofs(slopes(plane), plane)
    M = (
        jnp.einsum("ij,de->idje", LINEAR, linear)
        + jnp.einsum("pid,pq,qje->idje", w, CUBIC, w)
        + rotary * jnp.einsum("pxid,pq,qxje->idje", slope, QUADRATIC, slope)
    )
    return (density * h * plane.area * M).reshape(3 * BLOCK, 3 * BLOCK)
