"""Forces, moments and stress in flat triangular shells, at the middle of each triangle.

Tensors are in global axes, 6-vectors in the Voigt order of `fea`, so that they do not depend on how a
triangle's nodes are numbered; turning its normal over swaps bottom and top and the sign of moments.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.beam import BLOCK
from fea.shell import Triangle, bending_dofs, membrane_dofs
from fea.shell_bending import corner_curvatures
from fea.shell_membrane import mean_strain
from fea.shell_plane import PlaneTriangle, Scalar, plane_stress_root
from fea.skin import Skin
from fea.voigt import vector, von_mises

ArrayLike = Array | np.ndarray


class ShellStress(eqx.Module):
    """What a shell carries at the middle of a triangle, or of all triangles in all load cases.

    Both the membrane strain and the curvature vary in a triangle; these are their means. At a clamped
    edge or under a point force the bending stress at the corners is larger, by an amount that vanishes
    with the size of triangles.

    Attributes:
        membrane_forces: stress integrated over the thickness [N/mm].
        bending_moments: stress times height, integrated [N mm/mm]; positive with tension at the top, the
            side of the normal.
        stress: at the bottom, in the middle, at the top [MPa].
    """

    membrane_forces: Float[Array, "*shape 6"]
    bending_moments: Float[Array, "*shape 6"]
    stress: Float[Array, "*shape 3 6"]

    @property
    def von_mises(self) -> Float[Array, "*shape 3"]:
        """Equivalent stress at the bottom, in the middle and at the top [MPa]."""
        return von_mises(self.stress)


@jax.jit
def shell_stress(
    triangles: Triangle, E: Scalar, nu: Scalar, u: Float[Array, "*cases faces 18"]
) -> ShellStress:
    """Membrane forces, bending moments and stress of every triangle.

    Args:
        triangles: all of them.
        E: Young's modulus [MPa].
        nu: Poisson's ratio.
        u: displacements and rotations of their nodes, node after node.
    """
    root = plane_stress_root(nu)
    elasticity = E * root.T @ root

    def carried(triangle: Triangle, u: Float[Array, "18"]) -> ShellStress:
        plane = PlaneTriangle.of(triangle.corners)
        h = triangle.thickness
        strain = membrane_dofs(mean_strain(plane), plane)
        curvature = bending_dofs(corner_curvatures(plane).mean(axis=0), plane)
        strain, curvature = jnp.einsum(
            "ksid,id->ks", jnp.stack([strain, curvature]), u.reshape(3, BLOCK)
        )
        middle, bending = (_global(elasticity @ e, plane) for e in (strain, h / 2 * curvature))
        stress = jnp.stack([middle - bending, middle, middle + bending])
        return ShellStress(h * middle, h**2 / 6 * bending, stress)

    by_face = jax.vmap(carried)
    for _ in range(u.ndim - 2):
        by_face = jax.vmap(by_face, in_axes=(None, 0))
    return by_face(triangles, u)


def skin_stress(
    skin: Skin,
    points: Float[ArrayLike, "joints 3"],
    displacement: Float[ArrayLike, "*cases joints 6"],
    *,
    thickness: Float[ArrayLike, " faces"] | None = None,
) -> ShellStress:
    """Forces, moments and stress in a skin; JAX sees how they follow from all arrays.

    Args:
        skin: its triangles, material and thickness.
        points: positions of the joints [mm].
        displacement: of the joints, in each load case [mm, rad].
        thickness: to use instead of the skin's own [mm].
    """
    triangles = skin.triangle_values(points, thickness)
    u = jnp.asarray(displacement)[..., skin.triangles, :]
    return shell_stress(triangles, skin.E, skin.nu, u.reshape(*u.shape[:-2], 3 * BLOCK))


def _global(stress: Float[Array, "3"], plane: PlaneTriangle) -> Float[Array, "6"]:
    """A plane tensor [xx, yy, xy] as 6-vector in global axes."""
    t = plane.axes[:2]
    return vector(t.T @ jnp.stack([stress[jnp.array([0, 2])], stress[jnp.array([2, 1])]]) @ t)
