"""The straight 3-D Timoshenko beam: 12 x 12 stiffness in global axes, without a local frame.

Sections bend equally in all directions, so the stiffness depends on the unit axis t only, through
the projectors t tᵀ (along the strut) and 1 - t tᵀ (across it) and the cross product [t]x. There is
no second axis to choose, hence no special case for vertical members and no branch. Each end has
six degrees of freedom: displacement, then rotation. In the textbook's local axes this is
Przemieniecki, Theory of Matrix Structural Analysis (1968), equation 5.116.

A tapered strut is taken as prismatic with the geometric mean of its end radii. For a linear taper
of area proportional to r² that is exact in extension: the integral of dx/(E A) is
L/(E sqrt(A_a A_b)). In bending and torsion it is too stiff by (s + 1/s + 1)/3 with s the ratio of
the end radii: 2.3 % at s = 1.3, 17 % at s = 2.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from fea.sections import AbstractSection

ArrayLike = Array | np.ndarray


def effective_radius(radii: Float[ArrayLike, "struts 2"]) -> Float[Array, " struts"]:
    """Radius of the prismatic strut that stands for a tapered one [mm]: the geometric mean."""
    return jnp.sqrt(radii[:, 0] * radii[:, 1])


def cross_matrix(t: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """The matrix [t]x with [t]x v = t x v."""
    zero = jnp.zeros_like(t[0])
    return jnp.stack(
        [
            jnp.stack([zero, -t[2], t[1]]),
            jnp.stack([t[2], zero, -t[0]]),
            jnp.stack([-t[1], t[0], zero]),
        ]
    )


def beam_stiffness(
    ends: Float[Array, "2 3"],
    radius: Float[Array, ""],
    E: float,
    nu: float,
    section: AbstractSection,
) -> Float[Array, "12 12"]:
    """Stiffness of one strut in global axes [N/mm, N, N mm].

    Args:
        ends: positions of its two ends [mm].
        radius: radius of the prismatic strut [mm].
        E: Young's modulus [MPa].
        nu: Poisson's ratio.
        section: shape of the section.

    Returns:
        Rows and columns: displacement and rotation of the first end, then of the second.
    """
    axis = ends[1] - ends[0]
    L = jnp.sqrt(axis @ axis)
    t = axis / L
    G = E / (2 * (1 + nu))
    A, I = section.area(radius), section.second_moment(radius)
    # Shear flexibility over bending flexibility; 1/kappa first, so that kappa may be infinite.
    phi = 1 / section.kappa(nu) * 12 * E * I / (G * A * L**2)
    bend = E * I / ((1 + phi) * L)
    along = jnp.outer(t, t)
    across = jnp.eye(3) - along
    torsion = G * section.torsion_constant(radius) / L * along

    U = E * A / L * along + 12 * bend / L**2 * across
    # Force at the first end by a unit rotation of either end.
    W = -6 * bend / L * cross_matrix(t)
    near = torsion + (4 + phi) * bend * across
    far = -torsion + (2 - phi) * bend * across
    return jnp.block(
        [
            [U, W, -U, W],
            [W.T, near, -W.T, far],
            [-U, -W, U, -W],
            [W.T, far, -W.T, near],
        ]
    )


@eqx.filter_jit
def beam_stiffnesses(
    joints: Float[ArrayLike, "joints 3"],
    struts: Int[ArrayLike, "struts 2"],
    radii: Float[ArrayLike, "struts 2"],
    E: float,
    nu: float,
    section: AbstractSection,
) -> Float[Array, "struts 12 12"]:
    """Stiffness of every strut of a frame, tapered struts by `effective_radius`."""
    return jax.vmap(lambda ends, radius: beam_stiffness(ends, radius, E, nu, section))(
        jnp.asarray(joints)[struts], effective_radius(radii)
    )


def strut_displacements(
    displacement: Float[ArrayLike, "cases joints 6"], struts: Int[ArrayLike, "struts 2"]
) -> Float[Array, "cases struts 12"]:
    """The twelve displacements of each strut's ends, in the order of its stiffness."""
    return jnp.asarray(displacement)[:, struts].reshape(len(displacement), len(struts), 12)


@eqx.filter_jit
def beam_end_forces(
    stiffness: Float[Array, "struts 12 12"],
    displacement: Float[ArrayLike, "cases joints 6"],
    struts: Int[ArrayLike, "struts 2"],
) -> Float[Array, "cases struts 12"]:
    """Forces [N] and moments [N mm] that the joints exert on each strut's ends, global axes."""
    u = strut_displacements(displacement, struts)
    return jnp.einsum("sij,csj->csi", stiffness, u)  # strut, dof, case


@eqx.filter_jit
def bilinear_gradient(
    joints: Float[ArrayLike, "joints 3"],
    radii: Float[ArrayLike, "struts 2"],
    struts: Int[ArrayLike, "struts 2"],
    fields: tuple[Float[ArrayLike, "cases joints 6"], Float[ArrayLike, "cases joints 6"]],
    material: tuple[float, float, AbstractSection],
) -> tuple[Float[Array, "joints 3"], Float[Array, "struts 2"]]:
    """Gradient of sum_c v_c' K u_c with respect to joints and radii, u and v held.

    Args:
        joints: positions [mm].
        radii: radius at both ends [mm].
        struts: joints of each strut.
        fields: v and u.
        material: E [MPa], nu, section.
    """
    v, u = (strut_displacements(field, struts) for field in fields)

    def value(joints: Float[Array, "joints 3"], radii: Float[Array, "struts 2"]):
        K = beam_stiffnesses(joints, struts, radii, *material)
        return jnp.einsum("csi,sij,csj->", v, K, u)  # case, strut, dof

    return jax.grad(value, argnums=(0, 1))(jnp.asarray(joints), jnp.asarray(radii))
