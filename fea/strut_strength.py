"""Stress in the struts of a frame against yield, and their compression against Euler's load.

Functions of a `FrameProblem` and a displacement are JAX's, made for `fea.displacement`: what it was
given by name must be given to them too. Functions of a `FrameSolution` are for reports. Aggregate
with `fea.p_norm`.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.abstract_section import AbstractSection
from fea.beam import Strut, StrutMaterial, strut_displacements
from fea.columns import columns
from fea.errors import FeaError
from fea.frame import FrameProblem, FrameSolution
from fea.section_forces import (
    AT_ONCE,
    POINTS,
    SectionForces,
    at_sections,
    section_forces,
)

ArrayLike = Array | np.ndarray


def section_stress(
    forces: SectionForces, section: AbstractSection
) -> Float[Array, "*struts points"]:
    """Largest von Mises stress in each section [MPa].

    Elementary beam theory: sigma = |N|/A + |M|/W and tau = |T|/W_t at the outermost fibre,
    sigma = |N|/A and tau = |T|/W_t + V/A_v at the neutral axis (peak of the transverse shear), von
    Mises sqrt(sigma² + 3 tau²), the larger of the two. A square's corner and the middle of its side
    are taken as one point, which is safe. Notches at joints are not resolved.

    Where a force vanishes its derivative is taken as zero: no NaN.

    Args:
        forces: in the sections.
        section: their shape.
    """
    r = forces.radius
    axial = jnp.abs(forces.axial) / section.area(r)
    torsion = jnp.abs(forces.torque) / section.torsion_modulus(r)
    bent = axial + _length(forces.moment) / section.bending_modulus(r)
    shear = torsion + _length(forces.shear) / section.shear_modulus_area(r)
    fibre = _length(jnp.stack([bent, math.sqrt(3) * torsion], axis=-1))
    neutral = _length(jnp.stack([axial, math.sqrt(3) * shear], axis=-1))
    return jnp.maximum(fibre, neutral)


def _length(v: Float[Array, "*struts components"]) -> Float[Array, "*struts"]:
    """Euclidean norm, with derivative zero at zero."""
    square = jnp.sum(v * v, axis=-1)
    zero = square == 0
    return jnp.where(zero, 0.0, jnp.sqrt(jnp.where(zero, 1.0, square)))


def strut_stress(
    frame: FrameProblem,
    displacement: Float[ArrayLike, "cases joints 6"],
    *,
    points: int = POINTS,
    **parameters: ArrayLike,
) -> Float[Array, "cases struts points"]:
    """`section_stress` at evenly spaced sections of the elastic part of each strut [MPa].

    Args:
        frame: gives what the parameters leave out.
        displacement: of the joints [mm, rad].
        points: sections of a strut, its ends included.
        **parameters: `joints`, `radii` and others of `FrameProblem.parameters`.
    """
    struts, u, loads = _struts(frame, displacement, parameters)
    return _stresses(struts, frame.strut_material, u, loads, jnp.linspace(0, 1, points))


@eqx.filter_jit
def _stresses(
    struts: Strut,
    material: StrutMaterial,
    u: Float[Array, "cases struts 12"],
    loads: Float[Array, "cases struts 3 3"] | None,
    xi: Float[Array, " points"],
) -> Float[Array, "cases struts points"]:
    def one(strut, u, load):
        return section_stress(section_forces(strut, material, u, load, xi), material.section)

    def of_cases(values):
        return jax.vmap(one, in_axes=(None, 0, 0))(*values)

    by_strut = (struts, jnp.moveaxis(u, 1, 0), None if loads is None else jnp.moveaxis(loads, 1, 0))
    if u.shape[1] <= AT_ONCE:
        stress = jax.vmap(of_cases)(by_strut)
    else:
        # The gradient computes a batch again rather than keep what all struts need on the way.
        stress = jax.lax.map(jax.checkpoint(of_cases), by_strut, batch_size=AT_ONCE)
    return jnp.moveaxis(stress, 0, 1)


def strut_utilisation(
    frame: FrameProblem,
    displacement: Float[ArrayLike, "cases joints 6"],
    *,
    yield_stress: float,
    **parameters: ArrayLike,
) -> Float[Array, "cases struts"]:
    """Largest stress along each strut over yield.

    The largest of several sections has a kink where another takes over; `strut_stress` with
    `fea.p_norm` over sections and struts has none.

    Args:
        frame: gives what the parameters leave out.
        displacement: of the joints [mm, rad].
        yield_stress: [MPa].
        **parameters: `joints`, `radii` and others of `FrameProblem.parameters`.

    Raises:
        FeaError: when the yield stress is not positive.
    """
    _check_yield(yield_stress)
    stress = strut_stress(frame, displacement, points=POINTS, **parameters)
    return stress.max(axis=-1) / yield_stress


def euler_utilisation(
    frame: FrameProblem,
    displacement: Float[ArrayLike, "cases joints 6"],
    *,
    length_factor: float = 1.0,
    **parameters: ArrayLike,
) -> Float[Array, "cases struts"]:
    """Largest compressive force along each strut over `euler_load`, zero in tension.

    Args:
        frame: gives what the parameters leave out.
        displacement: of the joints [mm, rad].
        length_factor: effective over true length.
        **parameters: `joints`, `radii` and others of `FrameProblem.parameters`.

    Raises:
        FeaError: when the length factor is not positive.
    """
    # Without loads between the joints the axial force is the same everywhere.
    struts, u, loads = _struts(frame, displacement, parameters)
    sections = np.zeros(1) if loads is None else np.linspace(0, 1, POINTS)
    forces = at_sections(
        section_forces, struts, frame.strut_material, u, loads, jnp.asarray(sections)
    )
    compression = jnp.maximum(-forces.axial, 0.0).max(axis=-1)
    return compression / _euler_load(struts, frame, length_factor)[None]


def euler_load(frame: FrameProblem, *, length_factor: float = 1.0) -> Float[np.ndarray, " struts"]:
    """Compressive force under which each strut buckles [N]: π² E I/(K L)² of its column.

    A column is one strut, or several in a row that nothing holds sideways between (`fea.columns`): L is
    the length of all, and E I the least of them, which is exact for equal ones and safe for others.

    I = (∫ dξ/√I)⁻², the section's `moment_of_column`; for all sections but walls that is sqrt(I_a I_b),
    I_a, I_b at the two joints. For them and a linear taper it is exact whenever the ends do not
    move sideways: with x measured from the apex of the taper, I = I_1 x⁴ turns E I v'' + P v =
    C + D x into the equation of the prismatic column for g = v/x in y = 1/x (v'' = y³ g'', and v, v'
    vanish where g, g' do), with the same end conditions, so K of the prismatic column holds (the
    substitution is that of Timoshenko, Gere, Theory of Elastic Stability, 2nd ed., chapter 2, for
    I ~ x⁴). Where the ends sway it is not. Of walls, in their plane, it is within 1 % on the safe side
    as long as neither end is more than twice as thick as the other. Rigid ends are left out, which is
    safe; so is the shear of stocky struts, which is not: it lowers the load to P/(1 + P/(kappa G A)).

    Args:
        frame: the struts.
        length_factor: K, effective over true length: 1 hinged, 0.5 clamped.

    Raises:
        FeaError: when the length factor is not positive.
    """
    return np.asarray(_euler_load(frame.strut_values(), frame, length_factor))


def _euler_load(
    struts: Strut, frame: FrameProblem, length_factor: float
) -> Float[Array, " struts"]:
    if not length_factor > 0:
        raise FeaError(
            f"length_factor = {length_factor:g}: must be positive, such as 1 for hinged ends and 0.5 "
            "for clamped ones."
        )
    axis = struts.ends[:, 1] - struts.ends[:, 0]
    stiffness = frame.E * struts.modulus * frame.section.moment_of_column(*struts.radii.T)
    column = columns(frame)
    length = jax.ops.segment_sum(jnp.sqrt((axis**2).sum(-1)), column, len(column))
    least = jax.ops.segment_min(stiffness, column, len(column))
    return math.pi**2 * least[column] / (length_factor * length[column]) ** 2


def end_stress(solution: FrameSolution) -> Float[np.ndarray, "cases struts 2"]:
    """Largest von Mises stress at both ends of the elastic part of each strut [MPa]."""
    return np.asarray(strut_stress(solution.problem, solution.displacement, points=2))


def utilisation(solution: FrameSolution, yield_stress: float) -> Float[np.ndarray, " struts"]:
    """Largest von Mises stress of each strut along it and over load cases, over yield.

    Raises:
        FeaError: when the yield stress is not positive.
    """
    _check_yield(yield_stress)
    return np.asarray(strut_stress(solution.problem, solution.displacement)).max(axis=(0, 2)) / (
        yield_stress
    )


def buckling_utilisation(
    solution: FrameSolution, *, length_factor: float = 1.0
) -> Float[np.ndarray, " struts"]:
    """Largest `euler_utilisation` of each strut over load cases.

    Raises:
        FeaError: when the length factor is not positive.
    """
    return np.asarray(
        euler_utilisation(solution.problem, solution.displacement, length_factor=length_factor)
    ).max(axis=0)


def _check_yield(yield_stress: float) -> None:
    if not yield_stress > 0:
        raise FeaError(f"yield_stress = {yield_stress:g} MPa: must be positive.")


def _struts(
    frame: FrameProblem,
    displacement: Float[ArrayLike, "cases joints 6"],
    parameters: dict[str, ArrayLike],
) -> tuple[Strut, Float[Array, "cases struts 12"], Float[Array, "cases struts 3 3"] | None]:
    """Struts, the displacements of their joints, and their loads."""
    loads = parameters.get("strut_loads", frame.strut_loads)
    return (
        frame.strut_values(**parameters),
        strut_displacements(displacement, frame.struts),
        None if loads is None else jnp.asarray(loads),
    )
