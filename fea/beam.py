"""The straight 3-D Timoshenko beam with linear taper and rigid ends, in global axes.

Sections bend equally in all directions, so the stiffness depends on the unit axis t only, through
the projectors t tᵀ (along the strut) and 1 - t tᵀ (across it) and the cross product [t]x. There is
no second axis to choose, hence no special case for vertical members and no branch. Each joint has
six degrees of freedom: displacement, then rotation.

The flexibility method makes the element exact for linear taper (Przemieniecki, Theory of Matrix
Structural Analysis (1968), chapter 7): section forces follow from equilibrium, end deformations from
them, by the integrals of `fea.taper`. Nothing is singular where both ends are alike, and there the
element is that of Przemieniecki's equation 5.116.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from fea.abstract_section import AbstractSection, MeanSection

ArrayLike = Array | np.ndarray

# Degrees of freedom of a joint, of a node of a skin, and of all that is coupled to them: three
# displacements, three rotations.
BLOCK = 6


class Strut(eqx.Module):
    """One strut, or with a leading axis all struts of a frame.

    Attributes:
        ends: positions of its two joints [mm].
        radii: section radius at both joints [mm], linear between.
        rigid_ends: length at each end that does not deform [mm]: the zone of the joint.
        modulus: its E (and G) over that of the material.
    """

    ends: Float[Array, "*struts 2 3"]
    radii: Float[Array, "*struts 2"]
    rigid_ends: Float[Array, "*struts 2"]
    modulus: Float[Array, "*struts"]


class StrutMaterial(eqx.Module):
    """What all struts of a frame have in common.

    Attributes:
        E: Young's modulus [MPa].
        nu: Poisson's ratio.
        section: shape of the sections.
    """

    E: float
    nu: float
    section: AbstractSection

    @property
    def G(self) -> float:
        """Shear modulus [MPa]."""
        return self.E / (2 * (1 + self.nu))


class ElasticPart(eqx.Module):
    """The part of a strut that deforms, between its rigid ends.

    Attributes:
        axis: unit vector from the first joint to the second.
        span: distance of the joints [mm].
        arms: from each joint to the elastic part along the strut [mm].
        length: of the elastic part [mm].
        radii: at its two ends [mm].
    """

    axis: Float[Array, "3"]
    span: Float[Array, ""]
    arms: Float[Array, "2"]
    length: Float[Array, ""]
    radii: Float[Array, "2"]


def elastic_part(strut: Strut) -> ElasticPart:
    """Where one strut deforms; the rigid ends share the taper of the strut."""
    axis = strut.ends[1] - strut.ends[0]
    span = jnp.sqrt(axis @ axis)
    slope = (strut.radii[1] - strut.radii[0]) / span
    return ElasticPart(
        axis=axis / span,
        span=span,
        arms=strut.rigid_ends,
        length=span - strut.rigid_ends[0] - strut.rigid_ends[1],
        radii=strut.radii + slope * strut.rigid_ends * jnp.array([1.0, -1.0]),
    )


class EndStiffness(eqx.Module):
    """Stiffness of a beam with two ends in its own axes.

    Attributes:
        extension: axial force over extension [N/mm].
        torsion: torque over twist [N mm].
        sway: transverse force over relative transverse displacement [N/mm].
        shear: transverse force at the first end by a unit rotation of each end [N].
        near: moment at each end by its own unit rotation [N mm].
        far: moment at an end by a unit rotation of the other [N mm].
    """

    extension: Float[Array, ""]
    torsion: Float[Array, ""]
    sway: Float[Array, ""]
    shear: Float[Array, "2"]
    near: Float[Array, "2"]
    far: Float[Array, ""]


class Bending(eqx.Module):
    """How the elastic part bends, without dimension: rotations of its ends in units of length/EI.

    EI is that of the mean section, and the flexibility [[turn_a + shear, shear - cross], [shear - cross,
    turn_b + shear]].

    Attributes:
        turn: rotation of each end by its own moment, 1/3 for prismatic struts.
        cross: less that by the moment at the other end, 1/6 for prismatic struts.
        shear: flexibility in shear over that in bending, EI/(kappa GA length²).
        determinant: of the flexibility, 1/12 for slender prismatic struts.
    """

    turn: Float[Array, "2"]
    cross: Float[Array, ""]
    shear: Float[Array, ""]
    determinant: Float[Array, ""]

    @property
    def near(self) -> Float[Array, "2"]:
        """Moment at each end by its own unit rotation."""
        return (self.turn[::-1] + self.shear) / self.determinant

    @property
    def far(self) -> Float[Array, ""]:
        """Moment at an end by a unit rotation of the other."""
        return (self.cross - self.shear) / self.determinant

    @property
    def together(self) -> Float[Array, "2"]:
        """Moment at each end by a unit rotation of both: shear drops out."""
        return (self.turn[::-1] + self.cross) / self.determinant


def bending(part: ElasticPart, mean: MeanSection, material: StrutMaterial) -> Bending:
    """How the elastic part bends.

    Args:
        part: where the strut deforms.
        mean: its mean section.
        material: of the struts.
    """
    f = mean.flexibility
    # E/(kappa G); 1/kappa first, so that kappa may be infinite.
    softness = 1 / material.section.kappa(material.nu) * material.E / material.G
    eta = softness * mean.second_moment / (mean.area * part.length**2)
    return Bending(f.turn, f.cross, eta, f.determinant + eta * f.whole)


def elastic_stiffness(
    part: ElasticPart, modulus: Float[Array, ""], material: StrutMaterial
) -> EndStiffness:
    """Stiffness of the elastic part with respect to its own ends.

    Args:
        part: where the strut deforms.
        modulus: relative modulus.
        material: of the struts.
    """
    mean, L = material.section.mean(part.radii), part.length
    b = bending(part, mean, material)
    EI = material.E * modulus * mean.second_moment
    return EndStiffness(
        extension=material.E * modulus * mean.area / L,
        torsion=material.G * modulus * mean.torsion_constant / L,
        sway=EI / L**3 * jnp.sum(b.together),
        shear=EI / L**2 * b.together,
        near=EI / L * b.near,
        far=EI / L * b.far,
    )


def joint_stiffness(
    part: ElasticPart, modulus: Float[Array, ""], material: StrutMaterial
) -> EndStiffness:
    """Stiffness of a strut with respect to its joints.

    The ends of the elastic part move with the joints, u_end = u_joint + θ x arm. All terms that the
    arms add are positive, so none cancels.

    Args:
        part: where the strut deforms.
        modulus: relative modulus.
        material: of the struts.
    """
    k, d = elastic_stiffness(part, modulus, material), part.arms
    return EndStiffness(
        extension=k.extension,
        torsion=k.torsion,
        sway=k.sway,
        shear=k.shear + d * k.sway,
        near=k.near + 2 * d * k.shear + d**2 * k.sway,
        far=k.far + d[0] * k.shear[1] + d[1] * k.shear[0] + d[0] * d[1] * k.sway,
    )


def cross_matrix(t: Float[Array, "*many 3"]) -> Float[Array, "*many 3 3"]:
    """The matrices [t]x with [t]x v = t x v."""
    x, y, z = t[..., 0], t[..., 1], t[..., 2]
    zero = jnp.zeros_like(x)
    rows = [(zero, -z, y), (z, zero, -x), (-y, x, zero)]
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)


class _Blocks(NamedTuple):
    """What the stiffness of a strut with joints a, b is made of, 3 x 3 each.

    Attributes:
        U: force at a by a displacement of a.
        Wa, Wb: force at a by a rotation of a, of b; antisymmetric.
        Na, Nb: moment at a, b by its own rotation.
        F: moment at a by a rotation of b.
    """

    U: Float[Array, "3 3"]
    Wa: Float[Array, "3 3"]
    Wb: Float[Array, "3 3"]
    Na: Float[Array, "3 3"]
    Nb: Float[Array, "3 3"]
    F: Float[Array, "3 3"]


def _blocks(strut: Strut, material: StrutMaterial) -> _Blocks:
    part = elastic_part(strut)
    k = joint_stiffness(part, strut.modulus, material)
    along = jnp.outer(part.axis, part.axis)
    across = jnp.eye(3) - along
    cross = cross_matrix(part.axis)
    return _Blocks(
        U=k.extension * along + k.sway * across,
        Wa=-k.shear[0] * cross,
        Wb=-k.shear[1] * cross,
        Na=k.torsion * along + k.near[0] * across,
        Nb=k.torsion * along + k.near[1] * across,
        F=-k.torsion * along + k.far * across,
    )


def beam_stiffness(strut: Strut, material: StrutMaterial) -> Float[Array, "12 12"]:
    """Stiffness of one strut in global axes, with respect to its joints [N/mm, N, N mm].

    Args:
        strut: a single strut, without leading axis.
        material: of the struts.

    Returns:
        Rows and columns: displacement and rotation of the first joint, then of the second.
    """
    U, Wa, Wb, Na, Nb, F = _blocks(strut, material)
    return jnp.block(
        [
            [U, Wa, -U, Wb],
            [Wa.T, Na, -Wa.T, F],
            [-U, -Wa, U, -Wb],
            [Wb.T, F, -Wb.T, Nb],
        ]
    )


@eqx.filter_jit
def beam_stiffnesses(struts: Strut, material: StrutMaterial) -> Float[Array, "struts 12 12"]:
    """`beam_stiffness` of every strut."""
    return jax.vmap(lambda strut: beam_stiffness(strut, material))(struts)


# Not equinox's jit: its result comes in a tuple, for which XLA makes a copy of all blocks.
@partial(jax.jit, static_argnames="material")
def beam_pairs(struts: Strut, material: StrutMaterial) -> Float[Array, "struts 3 6 6"]:
    """Blocks (a, a), (b, b), (a, b) of the stiffness of every strut with joints a, b.

    The order is that of `fea.assembly.node_pairs(2)`; the block (b, a) is the transpose of (a, b).
    """

    def pairs(strut: Strut) -> Float[Array, "3 6 6"]:
        U, Wa, Wb, Na, Nb, F = _blocks(strut, material)
        # Waᵀ = -Wa; as transposes they would be kept in memory for all struts.
        own_a, own_b = jnp.block([[U, Wa], [-Wa, Na]]), jnp.block([[U, -Wb], [Wb, Nb]])
        return jnp.stack([own_a, own_b, jnp.block([[-U, Wb], [Wa, F]])])

    return jax.vmap(pairs)(struts)


def strut_displacements(
    displacement: Float[ArrayLike, "cases joints 6"], struts: Int[ArrayLike, "struts 2"]
) -> Float[Array, "cases struts 12"]:
    """The twelve displacements of each strut's joints, in the order of its stiffness."""
    return jnp.asarray(displacement)[:, struts].reshape(len(displacement), len(struts), 12)


def beam_forces(strut: Strut, material: StrutMaterial, u: Float[Array, "12"]) -> Float[Array, "12"]:
    """K u of one strut without forming K.

    Args:
        strut: a single strut.
        material: of the struts.
        u: displacements and rotations of its joints.

    Returns:
        Forces [N] and moments [N mm] that the joints exert on the strut, global axes.
    """
    part = elastic_part(strut)
    k, t = joint_stiffness(part, strut.modulus, material), part.axis
    ua, ra, ub, rb = u.reshape(4, 3)

    def split(v: Float[Array, "3"]) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        along = (t @ v) * t
        return along, v - along

    (stretch, sway), (twist, _) = split(ua - ub), split(ra - rb)
    across_a, across_b = split(ra)[1], split(rb)[1]
    turned = k.shear[0] * ra + k.shear[1] * rb
    force = k.extension * stretch + k.sway * sway - jnp.cross(t, turned)
    lever = jnp.cross(t, sway)
    ma = k.torsion * twist + k.shear[0] * lever + k.near[0] * across_a + k.far * across_b
    mb = -k.torsion * twist + k.shear[1] * lever + k.far * across_a + k.near[1] * across_b
    return jnp.concatenate([force, ma, -force, mb])


@eqx.filter_jit
def beam_end_forces(
    struts: Strut, material: StrutMaterial, u: Float[Array, "cases struts 12"]
) -> Float[Array, "cases struts 12"]:
    """`beam_forces` of every strut under the displacements of its joints."""
    one_case = jax.vmap(lambda strut, u: beam_forces(strut, material, u))
    return jax.vmap(lambda u: one_case(struts, u))(u)
