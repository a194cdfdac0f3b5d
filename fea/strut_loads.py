"""Loads along struts: force per length [N/mm] in global axes, quadratic from joint to joint.

A load is given at the first joint, the middle and the second joint of each strut. On the elastic
part it becomes the work-equivalent forces at its ends, minus the fixed-end forces, which the
flexibility method gives exactly for tapered Timoshenko beams (Przemieniecki, Theory of Matrix
Structural Analysis (1968), chapter 7): with m_0, n_0 the section forces of the simply supported
beam, the moments at the clamped ends are those that undo its end rotations. Then displacements of
joints are exact. On the rigid ends it goes to the joint, with its lever. Resultant and moment are
those of the load by equilibrium, whatever the integration.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from fea.abstract_section import AbstractSection
from fea.beam import ElasticPart, Strut, StrutMaterial, bending, elastic_part

ArrayLike = Array | np.ndarray

# Monomials 1, z, z² of z = x/span, of the parabolas through the three given values.
QUADRATIC = np.array([[1.0, -3.0, 2.0], [0.0, 4.0, -4.0], [0.0, -1.0, 2.0]])

# Points of the integrals of m_0/I, whose closed form is singular without taper. Error of the joint
# forces against 200 points, relative to the largest, by ratio of the end radii: 2e-15 at 3, 1e-13 at
# 5, 2e-9 at 10, 5e-6 at 40. A prismatic strut needs three.
TAPER_POINTS = 20


class LoadShares(eqx.Module):
    """What the joints of one strut get of a load of 1 N/mm at first end, middle, second end.

    Attributes:
        along: force along the strut, of a load along it [mm].
        across: force across the strut, of a load across it [mm].
        turn: moment t x load, of a load across the strut with unit axis t [mm²].
    """

    along: Float[Array, "2 3"]
    across: Float[Array, "2 3"]
    turn: Float[Array, "2 3"]


def load_shares(part: ElasticPart, material: StrutMaterial) -> LoadShares:
    """Work-equivalent joint forces of the three loads that span all quadratic ones.

    Args:
        part: where the strut deforms.
        material: of the struts.
    """
    rigid = _rigid_end_shares(part)
    elastic = _elastic_shares(part, material)
    # Forces at the ends of the elastic part act on the joints with its arms.
    lever = (part.arms * jnp.array([1.0, -1.0]))[:, None]
    return LoadShares(
        along=rigid.along + elastic.along,
        across=rigid.across + elastic.across,
        turn=rigid.turn + elastic.turn + lever * elastic.across,
    )


def _rigid_end_shares(part: ElasticPart) -> LoadShares:
    """Resultant, and moment about the joint, of the loads on the two rigid ends."""
    z = part.arms / part.span
    power = jnp.stack([z, z**2 / 2, z**3 / 3, z**4 / 4], axis=1)  # integrals of z^k from a joint
    # Seen from the second joint the loads come in reverse order.
    basis = jnp.stack([jnp.asarray(QUADRATIC), jnp.asarray(QUADRATIC[::-1])])  # end, load, monomial
    force = part.span * jnp.einsum("elk,ek->el", basis, power[:, :3])
    moment = part.span**2 * jnp.einsum("elk,ek->el", basis, power[:, 1:])
    return LoadShares(along=force, across=force, turn=moment * jnp.array([[1.0], [-1.0]]))


def _elastic_shares(part: ElasticPart, material: StrutMaterial) -> LoadShares:
    """Work-equivalent forces and moments at the ends of the elastic part."""
    section, L = material.section, part.length
    mean = section.mean(part.radii)
    b = bending(part, mean, material)
    c = _local_monomials(part).T  # power of xi, load
    points, w = np.polynomial.legendre.leggauss(TAPER_POINTS)
    xi, w = (points + 1) / 2, w[:, None] / 2
    x = jnp.asarray(xi)
    radius = part.radii[0] * (1 - x) + part.radii[1] * x
    # Flexibility in extension and shear, and in bending, over that of the mean section.
    soft = mean.area / section.area(radius)
    bent = mean.second_moment / section.second_moment(radius)

    # Simply supported under q = xi^k: m'' = q, m = 0 at both ends, moment m L², shear force -m' L.
    power = np.arange(3)
    m = (xi[:, None] ** (power + 2) - xi[:, None]) / ((power + 1) * (power + 2))
    dm = ((power + 2) * xi[:, None] ** (power + 1) - 1) / ((power + 1) * (power + 2))
    sheared = b.shear * (soft @ jnp.asarray(w * dm))
    # End rotations under the load in units of L³/EI, and the moments (sagging positive) that undo
    # them.
    va = bent @ jnp.asarray(w * (1 - xi[:, None]) * m) - sheared
    vb = bent @ jnp.asarray(w * xi[:, None] * m) + sheared
    ma = (-b.near[0] * va + b.far * vb) @ c * L**2
    mb = (b.far * va - b.near[1] * vb) @ c * L**2

    total = jnp.asarray(1 / (power + 1)) @ c * L
    second = jnp.asarray(1 / (power + 2)) @ c * L  # simple support at the second end
    shift = (ma - mb) / L
    # Clamped in extension: the axial force N_a - n of n = xi^(k+1)/(k+1) stretches nothing.
    n = soft @ jnp.asarray(w * xi[:, None] ** (power + 1) / (power + 1))
    Na = n @ c * L  # the integral of `soft` is one
    return LoadShares(
        along=jnp.stack([Na, total - Na]),
        across=jnp.stack([total - second + shift, second - shift]),
        turn=jnp.stack([ma, -mb]),
    )


def _local_monomials(part: ElasticPart) -> Float[Array, "3 3"]:
    """The three loads as polynomials of xi, 0 to 1 along the elastic part: load, power of xi."""
    start, scale = part.arms[0] / part.span, part.length / part.span
    # (start + scale xi)^k by powers of xi.
    one, zero = jnp.ones_like(start), jnp.zeros_like(start)
    powers = jnp.stack(
        [
            jnp.stack([one, zero, zero]),
            jnp.stack([start, scale, zero]),
            jnp.stack([start**2, 2 * start * scale, scale**2]),
        ]
    )
    return jnp.asarray(QUADRATIC) @ powers


def joint_loads(
    strut: Strut, material: StrutMaterial, load: Float[Array, "3 3"]
) -> Float[Array, "12"]:
    """Work-equivalent forces [N] and moments [N mm] of one strut's load on its two joints.

    Args:
        strut: a single strut.
        material: of the struts.
        load: force per length at first end, middle, second end [N/mm].
    """
    part = elastic_part(strut)
    shares, t = load_shares(part, material), part.axis
    size = load @ t
    across = load - size[:, None] * t[None]
    force = (shares.along @ size)[:, None] * t[None] + shares.across @ across
    moment = jnp.cross(t[None], shares.turn @ across)
    return jnp.concatenate([force, moment], axis=1).reshape(12)


@eqx.filter_jit
def strut_joint_loads(
    struts: Strut, material: StrutMaterial, strut_loads: Float[ArrayLike, "cases struts 3 3"]
) -> Float[Array, "cases struts 12"]:
    """`joint_loads` of every strut and case."""
    one_case = jax.vmap(lambda strut, load: joint_loads(strut, material, load))
    return jax.vmap(lambda loads: one_case(struts, loads))(jnp.asarray(strut_loads))


@eqx.filter_jit
def strut_load_forces(
    struts: Strut,
    material: StrutMaterial,
    connectivity: Int[ArrayLike, "struts 2"],
    joints: int,
    strut_loads: Float[ArrayLike, "cases struts 3 3"],
) -> Float[Array, "cases joints 6"]:
    """Work-equivalent forces [N] and moments [N mm] of all strut loads on the joints.

    Args:
        struts: all struts.
        material: of the struts.
        connectivity: joints of each strut.
        joints: number of joints.
        strut_loads: force per length at first end, middle, second end [N/mm].
    """
    forces = strut_joint_loads(struts, material, strut_loads)
    ends = forces.reshape(*forces.shape[:2], 2, 6)
    nothing = jnp.zeros((len(ends), joints, 6))
    return nothing.at[:, jnp.asarray(connectivity)].add(ends)


@eqx.filter_jit
def strut_weight(
    struts: Strut,
    section: AbstractSection,
    density: float | Float[ArrayLike, ""],
    acceleration: Float[ArrayLike, "cases 3"],
) -> Float[Array, "cases struts 3 3"]:
    """Weight per length of struts [N/mm], exact: the area of a linear taper is quadratic.

    Args:
        struts: all struts.
        section: their shape.
        density: [tonne/mm³].
        acceleration: of each case [mm/s²], such as (0, 0, -9810).
    """
    ends = struts.radii
    radii = jnp.stack([ends[:, 0], (ends[:, 0] + ends[:, 1]) / 2, ends[:, 1]], axis=1)
    mass = jnp.asarray(density * section.area(radii))
    return mass[None, :, :, None] * jnp.asarray(acceleration)[:, None, None, :]
