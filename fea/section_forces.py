"""Forces, moments and deflection along the struts of a frame.

Section forces follow from what the first joint exerts on the strut and from the loads up to the
section, by equilibrium alone; deflections from them by integration along the strut.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from fea.batches import batches
from fea.beam import Strut, StrutMaterial, beam_forces, elastic_part, strut_displacements
from fea.errors import FeaError
from fea.frame import FrameSolution
from fea.strut_loads import QUADRATIC, TAPER_POINTS, joint_loads

# Sections looked at along a strut, ends included. The largest moment of a uniform load is met within
# (1/20)² of q L²/2: 1 % of the moment of a simply supported strut.
POINTS = 11

# Struts handled at once, so that intermediate values stay small.
AT_ONCE = 65_536


class SectionForces(eqx.Module):
    """What the part of a strut beyond a section exerts on the part before it, global axes.

    With leading axes for cases and struts where there are several.

    Attributes:
        radius: of the section [mm].
        axial: force along the strut, tension positive [N].
        shear: force across the strut [N].
        torque: moment about the strut [N mm].
        moment: bending moment [N mm]; the strut's rotation grows along it by moment/(E I).
    """

    radius: Float[Array, "*struts points"]
    axial: Float[Array, "*struts points"]
    shear: Float[Array, "*struts points 3"]
    torque: Float[Array, "*struts points"]
    moment: Float[Array, "*struts points 3"]


def section_forces(
    strut: Strut,
    material: StrutMaterial,
    u: Float[Array, "12"],
    load: Float[Array, "3 3"] | None,
    xi: Float[Array, " points"],
) -> SectionForces:
    """Section forces of one strut.

    Args:
        strut: a single strut.
        material: of the struts.
        u: displacements and rotations of its joints.
        load: force per length at first joint, middle, second joint [N/mm]; None: none.
        xi: sections, 0 to 1 along the elastic part.
    """
    part = elastic_part(strut)
    t, x = part.axis, part.arms[0] + part.length * xi
    end = beam_forces(strut, material, u)
    if load is not None:
        end = end - joint_loads(strut, material, load)
    # On the part before the section: force, and moment about the section.
    force = jnp.broadcast_to(end[None, :3], (len(xi), 3))
    moment = end[None, 3:6] - x[:, None] * jnp.cross(t, end[:3])[None]
    if load is not None:
        z = x / part.span
        basis = jnp.asarray(QUADRATIC)
        once = jnp.stack([z, z**2 / 2, z**3 / 3], axis=1) @ basis.T
        twice = jnp.stack([z**2 / 2, z**3 / 6, z**4 / 12], axis=1) @ basis.T
        force = force + part.span * once @ load
        moment = moment - part.span**2 * jnp.cross(t[None], twice @ load)
    axial, torque = -force @ t, -moment @ t
    return SectionForces(
        radius=part.radii[0] * (1 - xi) + part.radii[1] * xi,
        axial=axial,
        shear=-force - axial[:, None] * t[None],
        torque=torque,
        moment=-moment - torque[:, None] * t[None],
    )


def deflection(
    strut: Strut,
    material: StrutMaterial,
    u: Float[Array, "12"],
    load: Float[Array, "3 3"] | None,
    xi: Float[Array, " points"],
) -> Float[Array, "points 3"]:
    """Displacement of the axis of one strut [mm], global axes; arguments as `section_forces`.

    From the first end on u' = θ x t + V/(kappa G A) + t N/(E A) and θ' = M/(E I) are integrated; at
    the second end this closes to the accuracy of `TAPER_POINTS`.
    """
    section, part = material.section, elastic_part(strut)
    t, L = part.axis, part.length
    points, w = np.polynomial.legendre.leggauss(TAPER_POINTS)
    start = u[:3] + part.arms[0] * jnp.cross(u[3:6], t)
    slope = jnp.cross(u[3:6], t)
    softness = 1 / section.kappa(material.nu) / (material.G * strut.modulus)

    def at(end: Float[Array, ""]) -> Float[Array, "3"]:
        x = end * jnp.asarray((points + 1) / 2)
        forces = section_forces(strut, material, u, load, x)
        E = material.E * strut.modulus
        area, inertia = section.area(forces.radius), section.second_moment(forces.radius)
        turned = (L * (end - x) / (E * inertia))[:, None] * jnp.cross(forces.moment, t[None])
        sheared = (softness / area)[:, None] * forces.shear
        stretched = (forces.axial / (E * area))[:, None] * t[None]
        weight = end * L * jnp.asarray(w / 2)
        return start + end * L * slope + weight @ (turned + sheared + stretched)

    return jax.vmap(at)(xi)


@eqx.filter_jit
def at_sections(
    values: Callable,
    struts: Strut,
    material: StrutMaterial,
    u: Float[Array, "cases struts 12"],
    loads: Float[Array, "cases struts 3 3"] | None,
    xi: Float[Array, " points"],
) -> Any:
    """`section_forces` or `deflection` of every strut and case.

    What does not depend on the case, such as the radius, is repeated for each.
    """

    def one(strut, u, load):
        return values(strut, material, u, load, xi)

    return jax.vmap(jax.vmap(one), in_axes=(None, 0, 0))(struts, u, loads)


@dataclass(frozen=True, eq=False)
class MemberForces:
    """What the part of each strut beyond a section exerts on the part before it, global axes.

    Sections are evenly spaced on the elastic part, its ends included.

    Attributes:
        position: of the sections, from the first joint of the strut [mm].
        radius: there [mm].
        axial: force along the strut, tension positive [N].
        shear: force across the strut [N].
        torque: moment about the strut's axis, first joint to second [N mm].
        moment: bending moment [N mm].
    """

    position: Float[np.ndarray, "struts points"]
    radius: Float[np.ndarray, "struts points"]
    axial: Float[np.ndarray, "cases struts points"]
    shear: Float[np.ndarray, "cases struts points 3"]
    torque: Float[np.ndarray, "cases struts points"]
    moment: Float[np.ndarray, "cases struts points 3"]


def member_forces(
    solution: FrameSolution, *, points: int = POINTS, struts: Int[np.ndarray, " some"] | None = None
) -> MemberForces:
    """Section forces along struts, loads between the joints included.

    Args:
        solution: the solved frame.
        points: sections of each strut.
        struts: which; None: all.

    Raises:
        FeaError: for fewer than two points, and struts that the frame does not have.
    """
    xi = _sections(points)
    chosen = _chosen(solution, struts)
    cases, count = len(solution.displacement), len(chosen)
    rigid = solution.problem.rigid_ends
    ends = solution.problem.joints[solution.problem.struts[chosen]]
    span = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    arms = np.zeros((count, 2)) if rigid is None else rigid[chosen]
    result = MemberForces(
        position=arms[:, :1] + (span - arms.sum(axis=1))[:, None] * xi,
        radius=np.zeros((count, points)),
        axial=np.zeros((cases, count, points)),
        shear=np.zeros((cases, count, points, 3)),
        torque=np.zeros((cases, count, points)),
        moment=np.zeros((cases, count, points, 3)),
    )
    for run, some in batches(count, AT_ONCE):
        forces = at_sections(section_forces, *_of(solution, chosen[some]), jnp.asarray(xi))
        kept = run.stop - run.start
        result.radius[run] = forces.radius[0, :kept]
        for name in ("axial", "shear", "torque", "moment"):
            getattr(result, name)[:, run] = getattr(forces, name)[:, :kept]
    return result


def strut_deflection(
    solution: FrameSolution, *, points: int = POINTS, struts: Int[np.ndarray, " some"] | None = None
) -> Float[np.ndarray, "cases some points 3"]:
    """Displacement of the axis of struts [mm] at the sections of `member_forces`; same arguments.

    Raises:
        FeaError: for fewer than two points, and struts that the frame does not have.
    """
    xi = _sections(points)
    chosen = _chosen(solution, struts)
    result = np.zeros((len(solution.displacement), len(chosen), points, 3))
    for run, some in batches(len(chosen), AT_ONCE):
        values = at_sections(deflection, *_of(solution, chosen[some]), jnp.asarray(xi))
        result[:, run] = values[:, : run.stop - run.start]
    return result


def _of(solution: FrameSolution, some: Int[np.ndarray, " some"]):
    """Struts, material, displacements and loads of some struts."""
    frame = solution.problem
    loads = frame.strut_loads
    return (
        jax.tree.map(lambda leaf: leaf[some], frame.strut_values()),
        frame.strut_material,
        strut_displacements(solution.displacement, frame.struts[some]),
        None if loads is None else jnp.asarray(loads[:, some]),
    )


def _sections(points: int) -> Float[np.ndarray, " points"]:
    if points < 2:
        raise FeaError(f"points = {points}: give at least 2, the ends of the strut.")
    return np.linspace(0, 1, points)


def _chosen(
    solution: FrameSolution, struts: Int[np.ndarray, " some"] | None
) -> Int[np.ndarray, " some"]:
    count = len(solution.problem.struts)
    if struts is None:
        return np.arange(count)
    if struts.size and not 0 <= struts.min() <= struts.max() < count:
        raise FeaError(
            f"Struts {struts.min()} to {struts.max()} are asked for, but the frame has struts 0 to "
            f"{count - 1}."
        )
    return struts
