"""The flat triangular shell: three nodes with six dofs, membrane with drilling rotation and thin plate.

Membrane: `fea.shell_membrane`; bending: `fea.shell_bending`. In the flat element they do not interact;
curved surfaces couple them at the nodes, where neighbours meet at an angle. Rotations about the normal
have stiffness of their own, so that a flat skin is not singular.

The stiffness is Fᵀ F with F the weighted strains: symmetric, without negative eigenvalues, and of rank
12, whatever the triangle.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.assembly import node_pairs
from fea.beam import BLOCK
from fea.shell_bending import corner_curvatures
from fea.shell_membrane import higher_order_share, linear_strain, mean_strain
from fea.shell_plane import SLOPE_SHARE, SLOPES, PlaneTriangle, Scalar, plane_stress_root

# Nodes whose blocks the stiffness of a triangle hands over.
PAIRS = node_pairs(3)

# Weighted strains: three components of mean membrane strain, of two slopes of it, and of bending alike.
ROWS = 18

# Triangles whose stiffness is computed at a time, so that their strains stay in the cache.
BATCH = 1024


class Triangle(eqx.Module):
    """One flat triangle, or with a leading axis all of them.

    Attributes:
        corners: positions of its nodes [mm].
        thickness: [mm].
    """

    corners: Float[Array, "*faces 3 3"]
    thickness: Float[Array, "*faces"]


def membrane_dofs(
    rows: Float[Array, "*rows 3 3"], plane: PlaneTriangle
) -> Float[Array, "*rows 3 6"]:
    """Rows over u, v and the drilling rotation of each node, as rows over its six global dofs."""
    t = plane.axes
    return jnp.concatenate([rows[..., :2] @ t[:2], rows[..., 2:] @ t[2:]], axis=-1)


def bending_dofs(
    rows: Float[Array, "*rows 3 3"], plane: PlaneTriangle
) -> Float[Array, "*rows 3 6"]:
    """Rows over the deflection and the slope of each node, as rows over its six global dofs."""
    t = plane.axes
    slope = jnp.stack([-t[1], t[0]])  # g = n x theta
    return jnp.concatenate([rows[..., :1] @ t[2:], rows[..., 1:] @ slope], axis=-1)


def weighted_strains(triangle: Triangle, E: Scalar, nu: Scalar) -> Float[Array, "18 3 6"]:
    """F with Fᵀ F the stiffness of one triangle, by its nodes and their dofs in global axes.

    Half of |F u|² is the energy, and v' K u = (F v).(F u).
    """
    plane = PlaneTriangle.of(triangle.corners)
    h = triangle.thickness
    root = plane_stress_root(nu)
    linear = jnp.einsum("ka,asid->ksid", SLOPES, linear_strain(plane))
    curvature = corner_curvatures(plane)
    varying = jnp.einsum("ka,asid->ksid", SLOPES, curvature)
    membrane = jnp.concatenate(
        [mean_strain(plane)[None], jnp.sqrt(higher_order_share(nu) * SLOPE_SHARE) * linear]
    )
    bending = jnp.concatenate([curvature.mean(axis=0)[None], jnp.sqrt(SLOPE_SHARE) * varying])
    rows = jnp.concatenate(
        [membrane_dofs(membrane, plane), h / jnp.sqrt(12.0) * bending_dofs(bending, plane)]
    )
    return jnp.sqrt(E * h * plane.area) * jnp.einsum("rs,ksid->krid", root, rows).reshape(
        ROWS, 3, BLOCK
    )


def shell_stiffness(triangle: Triangle, E: Scalar, nu: Scalar) -> Float[Array, "18 18"]:
    """Stiffness of one triangle in global axes [N/mm, N, N mm].

    Args:
        triangle: one.
        E: Young's modulus [MPa].
        nu: Poisson's ratio.

    Returns:
        Rows and columns: displacement and rotation of the first node, then the second, the third.
    """
    F = weighted_strains(triangle, E, nu).reshape(ROWS, 3 * BLOCK)
    return F.T @ F


@jax.jit
def shell_pairs(triangles: Triangle, E: Scalar, nu: Scalar) -> Float[Array, "faces 6 6 6"]:
    """Stiffness of every triangle as blocks of its `fea.assembly.node_pairs`."""

    def blocks(triangle: Triangle) -> Float[Array, "6 6 6"]:
        F = weighted_strains(triangle, E, nu)
        return jnp.einsum("rpd,rpe->pde", F[:, PAIRS[0]], F[:, PAIRS[1]])

    faces = len(triangles.thickness)
    batch = min(BATCH, faces)
    # The last batch is filled up from the front, so that one piece of code serves all.
    order = np.arange(faces + -faces % batch) % faces
    batches = jax.tree.map(lambda x: x[order].reshape(-1, batch, *x.shape[1:]), triangles)
    return jax.lax.map(jax.vmap(blocks), batches).reshape(-1, 6, BLOCK, BLOCK)[:faces]
