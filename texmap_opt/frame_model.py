"""The lattice as a frame: the part's supports and loads carried over to the joints.

The rules are those of docs/decisions/0002-supports-and-loads-on-frames.md. The frame has no skin.
"""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.spatial import KDTree

import fea
from fea import FeaError, Material
from fea.boundary_conditions import prescribed_dofs
from fea.frame import FrameProblem, free_frame_motion
from fea.sections import section
from texmap_opt.case import DesignCase, Load
from texmap_opt.errors import LatticeError
from texmap_opt.part import Part
from texmap_opt.region_reach import RegionReach
from texmap_opt.stress_field import MM_PER_M, StressField
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.volume import LatticeVolume, centre_line_volume


@dataclass(frozen=True, eq=False)
class FrameModel:
    """A structure under a part's supports and loads, for any radii.

    Attributes:
        structure: joints and struts, with the radii before sizing.
        material: of the struts.
        case_names: load cases, in the order of the first axis of the arrays.
        fixed: prescribed displacements and rotations of the joints.
        value: their values [mm, rad].
        surface_forces: forces [N] and moments [N mm] of the loads on the surface.
        acceleration: gravity of each case [mm/s²].
        weight_factor: true volume of the struts over the sum of their own volumes, so that joints
            are not weighed once for each strut.
    """

    structure: Structure
    material: Material
    case_names: tuple[str, ...]
    fixed: Bool[np.ndarray, "joints 6"]
    value: Float[np.ndarray, "joints 6"]
    surface_forces: Float[np.ndarray, "cases joints 6"]
    acceleration: Float[np.ndarray, "cases 3"]
    weight_factor: float

    def with_structure(self, structure: Structure) -> "FrameModel":
        """The same model for a structure that differs in its radii only."""
        return replace(self, structure=structure, weight_factor=_true_share(structure))

    def forces(
        self, radii: Float[Array | np.ndarray, "struts 2"]
    ) -> Float[Array, "cases joints 6"]:
        """All forces [N] and moments [N mm] on the joints; JAX differentiates in the radii.

        A strut's weight goes to its joints so that its resultant and moment stay.
        """
        mass = joint_masses(self.structure, radii, self.material.density * self.weight_factor)
        weight = self.acceleration[:, None, :] * mass[None, :, None]
        return jnp.asarray(self.surface_forces).at[..., :3].add(weight)

    def problem(self, radii: Float[np.ndarray, "struts 2"] | None = None) -> FrameProblem:
        """The frame with the given radii [mm], or its own."""
        radii = self.structure.radii if radii is None else radii
        return FrameProblem(
            joints=self.structure.joints,
            struts=self.structure.struts,
            radii=radii,
            E=self.material.E,
            nu=self.material.nu,
            section=section(self.structure.section),
            fixed=self.fixed,
            value=self.value,
            forces=np.asarray(self.forces(radii)),
        )


def frame_model(
    structure: Structure, part: Part, case: DesignCase, stress: StressField
) -> FrameModel:
    """Carry a case's supports and loads over to the joints of a structure.

    Args:
        structure: the trimmed lattice.
        part: what it fills.
        case: supports, loads, material, skin thickness, tolerance.
        stress: analysis of the solid part, whose nodal forces are carried over.

    Raises:
        LatticeError: a region that no strut reaches, supports that contradict each other or leave
            a motion of the lattice, or a case whose loads act on held joints only.
    """
    thickest = float(structure.radii.max())
    reach = RegionReach.of(structure.joints, part, case, stress, thickest)
    fixed, value = _supports(reach, case)
    names = case.load_cases
    forces = np.zeros((len(names), len(structure.joints), 6))
    acceleration = np.zeros((len(names), 3))
    for load, nodal in zip(case.loads, stress.load_forces, strict=True):
        k = names.index(load.case)
        if load.gravity_m_s2 is not None:
            g = MM_PER_M * np.array(load.gravity_m_s2)
            acceleration[k] += g
            nodal = nodal - fea.gravity_forces(stress.mesh, case.material.density, g)
        if load.region is not None:
            forces[k] += _joint_forces(reach, load, nodal, lever=float(structure.radii.mean()))
    model = FrameModel(
        structure=structure,
        material=case.material,
        case_names=names,
        fixed=fixed,
        value=value,
        surface_forces=forces,
        acceleration=acceleration,
        weight_factor=_true_share(structure),
    )
    _check_can_be_solved(model, case.path.name)
    return model


def _true_share(structure: Structure) -> float:
    """Overlap-corrected volume over the sum of the struts' own volumes."""
    measure = LatticeVolume.of(structure)
    radii = measure.as_round(structure.radii)
    apart = float(centre_line_volume(structure.joints, structure.struts, radii))
    return float(measure(structure.joints, structure.radii)) / apart


def carried_forces(
    joints: Float[np.ndarray, "reached 3"],
    points: Float[np.ndarray, "nodes 3"],
    forces: Float[np.ndarray, "nodes 3"],
    *,
    lever: float,
) -> Float[np.ndarray, "reached 6"]:
    """Forces [N] and moments [N mm] on joints, equivalent to forces at points of a surface.

    Each force goes to its nearest joint. The smallest additional forces (least squares) then make
    the moment about any point that of the surface forces. Where the joints offer no lever arm, as
    on one line, moments on the joints do the rest.

    Args:
        joints: the joints that the region reaches [mm].
        points: where the forces act [mm].
        forces: [N].
        lever: joints closer than this (root mean square) to an axis turn nothing about it [mm].
    """
    carried = np.zeros((len(joints), 6))
    nearest = KDTree(joints).query(points)[1]
    np.add.at(carried[:, :3], nearest, forces)
    # The resultant is right by now; the forces w x arm that add a moment J w have none.
    centre = joints.mean(axis=0)
    arm = joints - centre
    wanted = np.cross(points - centre, forces).sum(axis=0)
    missing = wanted - np.cross(arm, carried[:, :3]).sum(axis=0)
    J = np.eye(3) * np.sum(arm**2) - arm.T @ arm
    inertia, axes = np.linalg.eigh(J)
    turns = inertia > lever**2 * len(joints)
    w = axes[:, turns] @ ((axes[:, turns].T @ missing) / inertia[turns])
    carried[:, :3] += np.cross(w, arm)
    missing = wanted - np.cross(arm, carried[:, :3]).sum(axis=0)
    carried[:, 3:] += missing / len(joints)
    return carried


def joint_masses(
    structure: Structure, radii: Float[Array | np.ndarray, "struts 2"], density: float
) -> Float[Array, " joints"]:
    """Mass of the struts shared between their joints [tonne], centres of gravity kept.

    The joint at the end a of a linearly tapered strut gets the integral of density A (1 - x/L).

    Args:
        structure: joints and struts.
        radii: radius, or half the side, at both ends [mm].
        density: [tonne/mm³].
    """
    a, b = jnp.asarray(radii).T
    shape = section(structure.section)
    per_square = float(shape.area(np.ones(1))[0])
    scale = density * per_square * jnp.asarray(structure.lengths())
    shares = jnp.stack([a**2 / 4 + a * b / 6 + b**2 / 12, a**2 / 12 + a * b / 6 + b**2 / 4], axis=1)
    masses = jnp.zeros(len(structure.joints))
    return masses.at[jnp.asarray(structure.struts)].add(scale[:, None] * shares)


def _supports(
    reach: RegionReach, case: DesignCase
) -> tuple[Bool[np.ndarray, "joints 6"], Float[np.ndarray, "joints 6"]]:
    """Held degrees of freedom and their values; held in all three directions means clamped."""
    supports = [
        fea.Support(
            reach.reached(support.where, support.region),
            np.array([axis in support.fix for axis in "xyz"]),
            np.array(support.value_mm or (0.0, 0.0, 0.0), float),
        )
        for support in case.supports
    ]
    try:
        held, moved = prescribed_dofs(supports, len(reach.joints))
    except FeaError as failure:
        raise LatticeError(
            f"{case.path.name}: [[support]]: on the lattice's joints, {failure} Use smaller cells."
        ) from failure
    clamped = np.repeat(held.all(axis=1, keepdims=True), 3, axis=1)
    return np.hstack([held, clamped]), np.hstack([moved, np.zeros_like(moved)])


def _joint_forces(
    reach: RegionReach, load: Load, nodal: Float[np.ndarray, "nodes 3"], *, lever: float
) -> Float[np.ndarray, "joints 6"]:
    """Forces and moments on all joints of one load's surface forces."""
    region = load.region
    if region is None:
        raise ValueError("a load without a region has no surface forces")
    reached = reach.reached(load.where, region)
    loaded = np.flatnonzero(nodal.any(axis=1))
    forces = np.zeros((len(reach.joints), 6))
    points = reach.stress.mesh.nodes[loaded]
    forces[reached] = carried_forces(reach.joints[reached], points, nodal[loaded], lever=lever)
    return forces


def _check_can_be_solved(model: FrameModel, file: str) -> None:
    problem = model.problem()
    motion = free_frame_motion(problem)
    if motion:
        raise LatticeError(
            f"{file}: [[support]]: the lattice is not held: it {motion}; widen the supports' "
            "regions, add directions to `fix`, or use smaller cells."
        )
    if (problem.value[problem.fixed] != 0).any():
        return
    for name, force in zip(model.case_names, problem.forces, strict=True):
        if not force[~problem.fixed].any():
            raise LatticeError(
                f'{file}: [[load]] case = "{name}": reaches only joints that are held, so the '
                "lattice carries nothing; use smaller cells, or move load and support apart."
            )
