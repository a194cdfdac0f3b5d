"""The lattice as a frame, with its skin where it has one, under the part's supports and loads.

The rules are those of docs/decisions/0002-supports-and-loads-on-frames.md, and for walls of
docs/decisions/0011-mechanics-of-extruded-lattices.md.
"""

from dataclasses import dataclass, field, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

import fea
from fea import FeaError, Material
from fea.boundary_conditions import prescribed_dofs
from fea.frame import FrameProblem
from fea.frame_checks import free_frame_motion
from fea.sections import section
from texmap_opt.bearers import AbstractBearer, bearer_of
from texmap_opt.case import DesignCase
from texmap_opt.errors import CaseError, LatticeError
from texmap_opt.joint_zones import JointZones
from texmap_opt.part import Part
from texmap_opt.plane_loads import REMEDY, out_of_plane_load
from texmap_opt.plane_supports import FrameSupports, plane_supports
from texmap_opt.skinned_frame import ABSENT, FrameSkin
from texmap_opt.stress_field import MM_PER_M, StressField
from texmap_opt.structure.silhouette import thickness_inside
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.volume import LatticeVolume


@dataclass(frozen=True, eq=False)
class FrameModel:
    """A structure under a part's supports and loads, for any radii.

    Attributes:
        structure: joints and struts, with the radii before sizing.
        material: of the struts.
        case_names: load cases, in the order of the first axis of the arrays.
        fixed: prescribed displacements and rotations of the joints.
        value: their values [mm, rad].
        surface_forces: forces [N] and moments [N mm] of the loads on the surface, and the weight of
            the skin.
        acceleration: gravity of each case [mm/s²].
        weight_factor: true volume of the struts over the sum of their own volumes, so that joints
            are not weighed once for each strut.
        skin: shells whose vertices are joints after those of the structure; None: there is none.
        zones: what the joints add to the struts; None: beams from joint to joint.
        inside: share of each wall's thickness that is in the part; None: all, as of bars.
        axes: unit vectors along which the frame's coordinates, and the components of all arrays here,
            are taken, as rows: x, y, z, but for walls whose axis of extrusion is none of them.
    """

    structure: Structure
    material: Material
    case_names: tuple[str, ...]
    fixed: Bool[np.ndarray, "joints 6"]
    value: Float[np.ndarray, "joints 6"]
    surface_forces: Float[np.ndarray, "cases joints 6"]
    acceleration: Float[np.ndarray, "cases 3"]
    weight_factor: float
    skin: FrameSkin | None = None
    zones: JointZones | None = None
    inside: Float[np.ndarray, " struts"] | None = None
    axes: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))

    @property
    def joints(self) -> Float[np.ndarray, "joints 3"]:
        """Positions of the structure's joints, then of the skin's vertices, along the axes [mm]."""
        joints = self.structure.joints
        if self.skin is not None:
            joints = np.concatenate([joints, self.skin.mesh.surface.vertices])
        return joints @ self.axes.T

    def with_structure(self, structure: Structure) -> "FrameModel":
        """The same model for a structure that differs in its radii only."""
        return replace(self, structure=structure, weight_factor=_true_share(structure))

    def parameters(self, radii: Float[Array | np.ndarray, "struts 2"]) -> dict[str, Array]:
        """All that the frame takes from the radii, by the names of `FrameProblem`, in JAX.

        A strut's weight goes to its joints so that its resultant and moment stay.

        Args:
            radii: at both ends of each strut [mm].
        """
        radii = jnp.asarray(radii)
        density = self.material.density * self.weight_factor
        factor = self.section_shares(radii) * self.section_depths
        mass = joint_masses(self.structure, radii, density, factor)
        weight = self.acceleration[:, None, :] * mass[None, :, None]
        lattice = len(self.structure.joints)
        values = {
            "radii": radii,
            "forces": jnp.asarray(self.surface_forces).at[:, :lattice, :3].add(weight),
        }
        rigid_ends, modulus = jnp.zeros(radii.shape), factor
        if self.skin is not None:
            rigid_ends += self.skin.rigid_ends
        if self.zones is not None:
            rigid_ends += self.zones.rigid_ends(radii)
            modulus *= self.zones.modulus(radii)
        if self.skin is not None or self.zones is not None:
            values["rigid_ends"] = rigid_ends
        if "rigid_ends" in values or self.structure.extrusion is not None:
            values["modulus"] = modulus
        return values

    @property
    def section_depths(self) -> Float[np.ndarray, " struts"]:
        """Depth of each wall between the plates of its skin [mm]; 1 for bars.

        The section that the frame knows is 1 mm deep. With a skin it is the depth where the wall is in
        the part: what of its thickness is not there, the rim takes from it (`FrameSkin.shares`).
        """
        walls = self.structure.extrusion
        if walls is None:
            return np.ones(len(self.structure.struts))
        if self.skin is None or self.skin.plates is None:
            return walls.depth
        depth = walls.depth / self.shares_inside
        return np.maximum(depth - self.skin.plates, ABSENT * depth)

    @property
    def shares_inside(self) -> Float[np.ndarray, " struts"]:
        """Share of each strut's thickness that is in the part."""
        return np.ones(len(self.structure.struts)) if self.inside is None else self.inside

    def section_shares(
        self, radii: Float[Array | np.ndarray, "struts 2"]
    ) -> Float[Array, " struts"]:
        """Share of each strut's section that the skin does not hold already."""
        if self.skin is None:
            return jnp.ones(len(self.structure.struts))
        return self.skin.shares(radii)

    def problem(self, radii: Float[np.ndarray, "struts 2"] | None = None) -> FrameProblem:
        """The frame with the given radii [mm], or its own."""
        values = self.parameters(self.structure.radii if radii is None else radii)
        return FrameProblem(
            joints=self.joints,
            struts=self.structure.struts,
            E=self.material.E,
            nu=self.material.nu,
            section=section(self.structure.section),
            fixed=self.fixed,
            value=self.value,
            skin=None if self.skin is None else self.skin.shell,
            couplings=() if self.skin is None else (self.skin.tie,),
            **{name: np.asarray(value) for name, value in values.items()},
        )


def frame_model(
    structure: Structure, part: Part, case: DesignCase, stress: StressField
) -> FrameModel:
    """Carry a case's supports and loads over to the skin of a structure, or to its joints.

    Args:
        structure: the trimmed lattice.
        part: what it fills.
        case: supports, loads, material, skin thickness, tolerance.
        stress: analysis of the solid part, whose nodal forces are carried over.

    Raises:
        LatticeError: a region that no strut or no vertex of the skin reaches, a strut end that
            misses the skin, supports that contradict each other or leave a motion of the lattice, or
            a case whose loads act on held joints only.
        CaseError: loads out of the plane of walls.
    """
    walls = structure.extrusion
    fault = None if walls is None else out_of_plane_load(case, stress, walls)
    if fault is not None:
        raise CaseError(f"{fault}; {REMEDY}")
    bearer = bearer_of(structure, part, case, stress)
    axes, fixed, value = _supports(bearer, case, structure)
    names = case.load_cases
    forces = np.zeros((len(names), bearer.joints, 6))
    acceleration = np.zeros((len(names), 3))
    for load, nodal in zip(case.loads, stress.load_forces, strict=True):
        k = names.index(load.case)
        if load.gravity_m_s2 is not None:
            g = MM_PER_M * np.array(load.gravity_m_s2)
            nodal = nodal - fea.gravity_forces(stress.mesh, case.material.density, g)
            if walls is not None:
                g = g - g @ walls.axis * walls.axis
            acceleration[k] += g
            forces[k] += bearer.own_weight(case.material.density, g)
        if load.region is not None:
            forces[k] += bearer.carried(load, nodal)
    model = FrameModel(
        structure=structure,
        material=case.material,
        case_names=names,
        fixed=fixed,
        value=value,
        surface_forces=np.concatenate(
            [forces[..., :3] @ axes.T, forces[..., 3:] @ axes.T], axis=-1
        ),
        acceleration=acceleration @ axes.T,
        weight_factor=_true_share(structure),
        skin=bearer.skin,
        zones=JointZones.of(structure, case, bearer.skin),
        inside=None if walls is None else thickness_inside(structure, walls, part),
        axes=axes,
    )
    _check_can_be_solved(model, case.path.name)
    return model


def _true_share(structure: Structure) -> float:
    """Overlap-corrected volume over the sum of the struts' own volumes."""
    measure = LatticeVolume.of(structure)
    apart = float(measure.strut_volumes(structure.joints, structure.radii).sum())
    return float(measure(structure.joints, structure.radii)) / apart


def joint_masses(
    structure: Structure,
    radii: Float[Array | np.ndarray, "struts 2"],
    density: float,
    share: Float[Array | np.ndarray, " struts"] | float = 1.0,
) -> Float[Array, " joints"]:
    """Mass of the struts shared between their joints [tonne], centres of gravity kept.

    The joint at the end a of a linearly tapered strut gets the integral of density A (1 - x/L).

    Args:
        structure: joints and struts.
        radii: radius, or half the side or thickness, at both ends [mm].
        density: [tonne/mm³].
        share: of each strut's section that counts; of walls their depth [mm].
    """
    a, b = jnp.asarray(radii).T
    unit_area = float(section(structure.section).area(np.ones(1))[0])
    scale = share * density * unit_area * jnp.asarray(structure.lengths())
    if structure.extrusion is None:
        first, second = a**2 / 4 + a * b / 6 + b**2 / 12, a**2 / 12 + a * b / 6 + b**2 / 4
    else:
        first, second = a / 3 + b / 6, a / 6 + b / 3
    shares = jnp.stack([first, second], axis=1)
    masses = jnp.zeros(len(structure.joints))
    return masses.at[jnp.asarray(structure.struts)].add(scale[:, None] * shares)


def _supports(bearer: AbstractBearer, case: DesignCase, structure: Structure) -> FrameSupports:
    """Axes of the frame, held degrees of freedom and their values; fully held means clamped."""
    supports = [
        fea.Support(
            bearer.held(support.where, support.region),
            np.array([axis in support.fix for axis in "xyz"]),
            np.array(support.value_mm or (0.0, 0.0, 0.0), float),
        )
        for support in case.supports
    ]
    try:
        held, moved = prescribed_dofs(supports, bearer.joints)
    except FeaError as failure:
        raise LatticeError(
            f"{case.path.name}: [[support]]: on the lattice's joints, {failure} Use smaller cells."
        ) from failure
    walls = structure.extrusion
    if walls is not None:
        return plane_supports(structure, walls.axis, bearer.skin, held, moved, case)
    clamped = np.repeat(held.all(axis=1, keepdims=True), 3, axis=1)
    moved = np.hstack([moved, np.zeros_like(moved)])
    return FrameSupports(np.eye(3), np.hstack([held, clamped]), moved)


def _check_can_be_solved(model: FrameModel, file: str) -> None:
    problem = model.problem()
    motion = free_frame_motion(problem.joints, problem.fixed, problem.links)
    if motion:
        raise LatticeError(
            f"{file}: [[support]]: the lattice is not held: it {motion}{_in_axes(model.axes)}; widen the "
            "supports' regions, add directions to `fix`, or use smaller cells."
        )
    if (problem.value[problem.fixed] != 0).any():
        return
    for name, force in zip(model.case_names, problem.forces, strict=True):
        if not force[~problem.fixed].any():
            raise LatticeError(
                f'{file}: [[load]] case = "{name}": reaches only joints that are held, so the '
                "lattice carries nothing; use smaller cells, or move load and support apart."
            )


def _in_axes(axes: Float[np.ndarray, "3 3"]) -> str:
    """Says which axes x, y, z are, in a message about a frame that is turned."""
    if np.array_equal(axes, np.eye(3)):
        return ""
    x, y, z = ("[" + ", ".join(f"{c:.3g}" for c in axis) + "]" for axis in axes)
    return f" (with x, y, z along {x}, {y}, {z})"
