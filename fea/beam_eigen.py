"""Geometric stiffness and mass of a strut: what buckling and vibration need beside its stiffness.

As the stiffness, both are written without a local frame. With t the unit axis and S θ = θ x t the
slope that a rotation gives the axis, the motion across is described by the four vectors
(P d_a, S θ_a, P d_b, S θ_b), P = 1 - t tᵀ, and all directions across are alike: one symmetric
4 x 4 matrix of numbers serves them all. Along the strut, and about it, there are two numbers each.

Shape functions are the cubics that solve the prismatic Timoshenko beam without load between its
ends (Friedman, Kosmatka, Computers & Structures 47 (1993) 473-481; Hermite's for phi = 0), with phi
of the geometric mean radius where the strut is tapered, and linear along and about the axis. Rigid
ends move as rigid bodies and carry force and mass as the rest does. An element bends, but does not
shear, with the axial force and the inertia between its ends: errors fall with the fourth power of
its length, in stocky beams with the second.

The geometric stiffness is that of the axial force N alone, N/2 times the integral of the squared
slope of the axis (Engesser's column: P_cr = P_E/(1 + P_E/(kappa G A))), N being constant along the
strut: loads between the joints enter by their mean. Moments and torques are left out on purpose. A
section that bends equally in all directions does not buckle sideways when it is bent: the critical
moment holds the factor 1/sqrt(1 - I_z/I_y) of the deflection before buckling (Trahair,
Flexural-Torsional Buckling of Structures, 1993), which a linear analysis misses. A torque buckles a
hinged bar at 2 π E I/L (Greenhill, 1883), a shear strain of 2 π (1 + nu) r/L. And the Wagner term
N I_p/A of twisting matters where N reaches G A.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.beam import (
    ElasticPart,
    Strut,
    StrutMaterial,
    cross_matrix,
    elastic_part,
    elastic_stiffness,
)

# Gauss points between the ends of each part of a strut: exact for the inertia of a round taper,
# r⁴ times the square of a quadratic, and for its mass, r² times the square of a cubic.
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(5)
POINTS, WEIGHTS = (1 + _POINTS) / 2, _WEIGHTS / 2


class StrutForm(NamedTuple):
    """A symmetric form in the motions of a strut's two ends that knows no direction across it.

    Attributes:
        across: in deflection and slope at the first end, then at the second.
        along: in displacement along the axis at both ends.
        about: in rotation about the axis at both ends.
    """

    across: Float[Array, "4 4"]
    along: Float[Array, "2 2"]
    about: Float[Array, "2 2"]


class _Motions(NamedTuple):
    """Motions of a strut's ends: what a `StrutForm` multiplies."""

    across: Float[Array, "4 3"]
    along: Float[Array, "2"]
    about: Float[Array, "2"]


def beam_geometric_stiffness(
    strut: Strut, material: StrutMaterial, u: Float[Array, "12"]
) -> Float[Array, "12 12"]:
    """Second-order stiffness of one strut under the axial force of its displacements, global axes.

    Args:
        strut: one strut.
        material: its material and section.
        u: displacement [mm] and rotation [rad] of its joints; the result is linear in it.
    """
    return _whole(_blocks(strut, geometric_form(strut, material, u)))


def beam_mass(strut: Strut, material: StrutMaterial, density: float) -> Float[Array, "12 12"]:
    """Consistent mass of one strut with its rotary inertia, joint to joint, in global axes.

    Args:
        strut: one strut.
        material: section, and the Poisson's ratio that shear deformation depends on.
        density: [tonne/mm³].
    """
    return _whole(_blocks(strut, mass_form(strut, material, density)))


@eqx.filter_jit
def geometric_pairs(
    struts: Strut, material: StrutMaterial, u: Float[Array, "struts 12"]
) -> Float[Array, "struts 3 6 6"]:
    """Geometric stiffness of every strut as `fea.assembly.node_pairs(2)`."""
    return jax.vmap(lambda strut, u: _blocks(strut, geometric_form(strut, material, u)))(struts, u)


@eqx.filter_jit
def mass_pairs(
    struts: Strut, material: StrutMaterial, density: float
) -> Float[Array, "struts 3 6 6"]:
    """Mass of every strut as `fea.assembly.node_pairs(2)`."""
    return jax.vmap(lambda strut: _blocks(strut, mass_form(strut, material, density)))(struts)


def geometric_work(
    strut: Strut, material: StrutMaterial, u: Float[Array, "12"], x: Float[Array, "12"]
) -> Float[Array, ""]:
    """Quadratic form x' Kg(u) x of one strut [N mm], without the matrix."""
    return _product(_motions(strut, x), geometric_form(strut, material, u))


def inertia_work(
    strut: Strut, material: StrutMaterial, density: float, x: Float[Array, "12"]
) -> Float[Array, ""]:
    """Quadratic form x' M x of one strut [tonne mm²], without the matrix."""
    return _product(_motions(strut, x), mass_form(strut, material, density))


def axial_force(strut: Strut, material: StrutMaterial, u: Float[Array, "12"]) -> Float[Array, ""]:
    """Mean axial force of one strut [N], tension positive."""
    part = elastic_part(strut)
    stiffness = elastic_stiffness(part, strut.modulus, material).extension
    return stiffness * (part.axis @ (u[6:9] - u[:3]))


def geometric_form(strut: Strut, material: StrutMaterial, u: Float[Array, "12"]) -> StrutForm:
    """The geometric stiffness of one strut without its directions."""
    part = elastic_part(strut)
    a, b = part.arms
    L, phi = part.length, _shear_flexibility(part, material)
    # N over twice the integral of the squared slope; for phi = 0 Przemieniecki, Theory of Matrix
    # Structural Analysis (1968), chapter 15.
    scale = 1 / (1 + phi) ** 2
    g = (6 / 5 + 2 * phi + phi**2) / L
    h = jnp.asarray(1 / 10)
    near, far = L * (2 / 15 + phi / 6 + phi**2 / 12), -L * (1 / 30 + phi / 6 + phi**2 / 12)
    flexible = jnp.stack(
        [
            jnp.stack([g, h, -g, h]),
            jnp.stack([h, near, -h, far]),
            jnp.stack([-g, -h, g, -h]),
            jnp.stack([h, far, -h, near]),
        ]
    )
    to_ends = _rigid_arms(part)
    rigid = jnp.zeros((4, 4)).at[1, 1].set(a).at[3, 3].set(b)
    across = axial_force(strut, material, u) * (scale * to_ends.T @ flexible @ to_ends + rigid)
    return StrutForm(across, jnp.zeros((2, 2)), jnp.zeros((2, 2)))


def mass_form(strut: Strut, material: StrutMaterial, density: float) -> StrutForm:
    """The mass of one strut without its directions."""
    part = elastic_part(strut)
    place = _places(strut, part, _shear_flexibility(part, material))
    section = material.section
    # Mass [tonne] and rotary inertia [tonne mm²] that each point stands for.
    m = density * place.length * section.area(place.radius)
    J = density * place.length * section.second_moment(place.radius)
    line = place.along.T @ (m[:, None] * place.along)
    # The polar moment of a section that bends equally in all directions is twice the other.
    turn = place.along.T @ (2 * J[:, None] * place.along)
    across = place.deflection.T @ (m[:, None] * place.deflection)
    return StrutForm(across + place.slope.T @ (J[:, None] * place.slope), line, turn)


class _Places(NamedTuple):
    """Quadrature points of a strut, rigid ends first and last.

    Attributes:
        length: that each stands for [mm].
        radius: of the section [mm].
        deflection: by the deflections and slopes at both joints.
        slope: of the section, likewise.
        along: share of the motions at both joints along and about the axis.
    """

    length: Float[Array, " samples"]
    radius: Float[Array, " samples"]
    deflection: Float[Array, "samples 4"]
    slope: Float[Array, "samples 4"]
    along: Float[Array, "samples 2"]


def _places(strut: Strut, part: ElasticPart, phi: Float[Array, ""]) -> _Places:
    a, b = part.arms
    L = part.length
    xi = jnp.asarray(POINTS)
    one, zero = jnp.ones_like(xi), jnp.zeros_like(xi)
    to_ends = _rigid_arms(part)
    # From the first joint; the last part counts from the second, so that its arm is negative.
    x = jnp.concatenate([a * xi, a + L * xi, part.span - b * xi])
    deflection = jnp.concatenate(
        [
            jnp.stack([one, a * xi, zero, zero], axis=1),
            _deflection(xi, L, phi) @ to_ends,
            jnp.stack([zero, zero, one, -b * xi], axis=1),
        ]
    )
    slope = jnp.concatenate(
        [
            jnp.stack([zero, one, zero, zero], axis=1),
            _section_slope(xi, L, phi) @ to_ends,
            jnp.stack([zero, zero, zero, one], axis=1),
        ]
    )
    along = jnp.concatenate(
        [
            jnp.stack([one, zero], axis=1),
            jnp.stack([1 - xi, xi], axis=1),
            jnp.stack([zero, one], axis=1),
        ]
    )
    length = jnp.concatenate([each * jnp.asarray(WEIGHTS) for each in (a, L, b)])
    first, second = strut.radii
    return _Places(length, first + (second - first) * x / part.span, deflection, slope, along)


def _deflection(
    xi: Float[Array, " samples"], L: Float[Array, ""], phi: Float[Array, ""]
) -> Float[Array, "samples 4"]:
    """Deflection of the axis by deflections and slopes at the ends (Friedman, Kosmatka)."""
    shapes = [
        2 * xi**3 - 3 * xi**2 - phi * xi + 1 + phi,
        L * (xi**3 - (2 + phi / 2) * xi**2 + (1 + phi / 2) * xi),
        -(2 * xi**3 - 3 * xi**2 - phi * xi),
        L * (xi**3 - (1 - phi / 2) * xi**2 - phi / 2 * xi),
    ]
    return jnp.stack(shapes, axis=1) / (1 + phi)


def _section_slope(
    xi: Float[Array, " samples"], L: Float[Array, ""], phi: Float[Array, ""]
) -> Float[Array, "samples 4"]:
    """Slope of the section's normal by the same."""
    bent = 6 / L * (xi**2 - xi)
    shapes = [
        bent,
        3 * xi**2 - (4 + phi) * xi + 1 + phi,
        -bent,
        3 * xi**2 - (2 - phi) * xi,
    ]
    return jnp.stack(shapes, axis=1) / (1 + phi)


def _rigid_arms(part: ElasticPart) -> Float[Array, "4 4"]:
    """Deflection and slope at the ends of the elastic part by those at the joints."""
    a, b = part.arms
    return jnp.eye(4).at[0, 1].set(a).at[2, 3].set(-b)


def _shear_flexibility(part: ElasticPart, material: StrutMaterial) -> Float[Array, ""]:
    """Shear over bending, phi = 12 EI/(kappa G A L²), of the geometric mean of the end radii."""
    section, radius = material.section, jnp.sqrt(part.radii[0] * part.radii[1])
    ratio = section.second_moment(radius) / (section.area(radius) * part.length**2)
    # 1/kappa first, so that kappa may be infinite.
    softness = 1 / section.kappa(material.nu) * 12 * material.E / material.G
    return jnp.asarray(softness * ratio)


def _motions(strut: Strut, x: Float[Array, "12"]) -> _Motions:
    t = elastic_part(strut).axis
    d, theta = x.reshape(2, 2, 3)[:, 0], x.reshape(2, 2, 3)[:, 1]
    across = d - jnp.outer(d @ t, t)
    slope = jnp.cross(theta, t[None])
    return _Motions(jnp.stack([across, slope], axis=1).reshape(4, 3), d @ t, theta @ t)


def _product(motions: _Motions, form: StrutForm) -> Float[Array, ""]:
    return (
        jnp.sum(motions.across * (form.across @ motions.across))
        + motions.along @ form.along @ motions.along
        + motions.about @ form.about @ motions.about
    )


def _blocks(strut: Strut, form: StrutForm) -> Float[Array, "3 6 6"]:
    """The form in global axes: blocks of the first end, the second, and between them."""
    t = elastic_part(strut).axis
    along = jnp.outer(t, t)
    across = jnp.eye(3) - along
    S = -cross_matrix(t)  # S' S = 1 - t t'

    def block(a: int, b: int) -> Float[Array, "6 6"]:
        C = form.across[2 * a : 2 * a + 2, 2 * b : 2 * b + 2]
        return jnp.block(
            [
                [C[0, 0] * across + form.along[a, b] * along, C[0, 1] * S],
                [C[1, 0] * S.T, C[1, 1] * across + form.about[a, b] * along],
            ]
        )

    return jnp.stack([block(0, 0), block(1, 1), block(0, 1)])


def _whole(blocks: Float[Array, "3 6 6"]) -> Float[Array, "12 12"]:
    first, second, between = blocks
    return jnp.block([[first, between], [between.T, second]])
