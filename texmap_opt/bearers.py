"""What supports hold and loads act on: the joints of a bare lattice, or the vertices of its skin.

The rules are those of docs/decisions/0002-supports-and-loads-on-frames.md, and for walls of
docs/decisions/0011-mechanics-of-extruded-lattices.md.
"""

import abc
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from fea.skin_loads import skin_gravity_forces
from texmap_opt.case import DesignCase, Load
from texmap_opt.errors import LatticeError
from texmap_opt.part import Part
from texmap_opt.region import AbstractRegion
from texmap_opt.region_reach import RegionReach
from texmap_opt.skin_mesh import SkinMesh
from texmap_opt.skinned_frame import FrameSkin, forces_on_skin, frame_skin
from texmap_opt.stress_field import StressField, selected_nodes
from texmap_opt.structure.structure import Structure
from texmap_opt.wall_skin import wall_skin

# Vertices of a sheet closer than this share of its triangles' edge, root mean square, to their centre
# offer no lever arm to a moment.
LEVER_SHARE = 0.1

Forces = Float[np.ndarray, "joints 6"]


class AbstractBearer(abc.ABC):
    """The joints of a frame that stand for the part's surface.

    Attributes:
        skin: shells among the joints; None where there are none.
    """

    skin: FrameSkin | None

    @property
    @abc.abstractmethod
    def joints(self) -> int:
        """How many joints the frame has."""

    @abc.abstractmethod
    def held(self, where: str, region: AbstractRegion) -> Int[np.ndarray, " reached"]:
        """Joints that a support holds.

        Args:
            where: names the support in messages.
            region: of the part's surface.

        Raises:
            LatticeError: when there is none.
        """

    @abc.abstractmethod
    def carried(self, load: Load, nodal: Float[np.ndarray, "nodes 3"]) -> Forces:
        """Forces [N] and moments [N mm] on the joints, of the force and moment of a load.

        Args:
            load: its region.
            nodal: its forces on the nodes of the solid [N].

        Raises:
            LatticeError: when it reaches no joint.
        """

    @abc.abstractmethod
    def own_weight(self, density: float, g: Float[np.ndarray, " 3"]) -> Forces:
        """Weight [N] of what is not struts.

        Args:
            density: [tonne/mm³].
            g: acceleration [mm/s²].
        """


@dataclass(frozen=True, eq=False)
class StrutJoints(AbstractBearer):
    """Joints of struts that a region of the surface reaches.

    Attributes:
        structure: the lattice.
        reach: which joints that are.
        skin: none.
    """

    structure: Structure
    reach: RegionReach
    skin: None = None

    @property
    def joints(self) -> int:
        """See `AbstractBearer`."""
        return len(self.structure.joints)

    def held(self, where: str, region: AbstractRegion) -> Int[np.ndarray, " reached"]:
        """See `AbstractBearer`."""
        return self.reach.reached(where, region)

    def carried(self, load: Load, nodal: Float[np.ndarray, "nodes 3"]) -> Forces:
        """See `AbstractBearer`."""
        forces = np.zeros((self.joints, 6))
        if load.region is None:
            return forces
        reached = self.reach.reached(load.where, load.region)
        lever = float(self.structure.radii.mean())
        forces[reached] = _carried_to(self.reach, reached, nodal, lever=lever)
        return forces

    def own_weight(self, density: float, g: Float[np.ndarray, " 3"]) -> Forces:
        """Nothing."""
        return np.zeros((self.joints, 6))


@dataclass(frozen=True, eq=False)
class SkinVertices(AbstractBearer):
    """Vertices of the skin: corners of the solid's tets, so that regions choose the same.

    Attributes:
        lattice: joints of the struts, which come first.
        skin: the shells.
        mesh: the surface they are.
        stress: analysis of the solid part; its mesh tells what a region selects.
    """

    lattice: int
    skin: FrameSkin
    mesh: SkinMesh
    stress: StressField

    @property
    def joints(self) -> int:
        """See `AbstractBearer`."""
        return self.lattice + len(self.mesh.nodes)

    def held(self, where: str, region: AbstractRegion) -> Int[np.ndarray, " reached"]:
        """See `AbstractBearer`."""
        chosen = selected_nodes(self.stress.mesh, region)
        found = np.flatnonzero(np.isin(self.mesh.nodes, chosen))
        if len(found) == 0:
            raise LatticeError(
                f"{where} region: no corner of the skin's triangles lies in {region.describe()}; use a "
                "smaller [analysis] edge_mm or a larger region."
            )
        return self.lattice + found

    def carried(self, load: Load, nodal: Float[np.ndarray, "nodes 3"]) -> Forces:
        """See `AbstractBearer`."""
        forces = np.zeros((self.joints, 6))
        forces[self.lattice :] = forces_on_skin(self.stress.mesh, self.mesh, nodal)
        return forces

    def own_weight(self, density: float, g: Float[np.ndarray, " 3"]) -> Forces:
        """That of the skin."""
        return _weight_of(self.skin, self.lattice, density, g)


@dataclass(frozen=True, eq=False)
class SheetVertices(AbstractBearer):
    """Vertices of the sheet that plates and rim of an extruded lattice are.

    Attributes:
        lattice: joints of the walls, which come first.
        skin: the sheet.
        reach: which of its vertices a region reaches.
        edge: of its triangles [mm].
    """

    lattice: int
    skin: FrameSkin
    reach: RegionReach
    edge: float

    @property
    def joints(self) -> int:
        """See `AbstractBearer`."""
        return self.lattice + len(self.skin.mesh.surface.vertices)

    def held(self, where: str, region: AbstractRegion) -> Int[np.ndarray, " reached"]:
        """See `AbstractBearer`."""
        return self.lattice + self._reached(where, region)

    def carried(self, load: Load, nodal: Float[np.ndarray, "nodes 3"]) -> Forces:
        """See `AbstractBearer`."""
        forces = np.zeros((self.joints, 6))
        if load.region is None:
            return forces
        reached = self._reached(load.where, load.region)
        lever = LEVER_SHARE * self.edge
        forces[self.lattice + reached] = _carried_to(self.reach, reached, nodal, lever=lever)
        return forces

    def own_weight(self, density: float, g: Float[np.ndarray, " 3"]) -> Forces:
        """That of plates and rim."""
        return _weight_of(self.skin, self.lattice, density, g)

    def _reached(self, where: str, region: AbstractRegion) -> Int[np.ndarray, " reached"]:
        near = self.reach.meets(region)
        if not near.any():
            raise LatticeError(
                f"{where} region: no corner of the skin's triangles, which are {self.edge:.3g} mm long, "
                f"lies in {region.describe()} seen along the axis of extrusion; use smaller cells or a "
                "larger region."
            )
        return np.flatnonzero(near)


def _weight_of(skin: FrameSkin, lattice: int, density: float, g: np.ndarray) -> Forces:
    """Weight of a skin, whose vertices come after the joints of the lattice [N]."""
    points = np.concatenate([np.zeros((lattice, 3)), skin.mesh.surface.vertices])
    return np.asarray(skin_gravity_forces(skin.shell, points, density, g))


def bearer_of(
    structure: Structure, part: Part, case: DesignCase, stress: StressField
) -> AbstractBearer:
    """The skin of a lattice where the case asks for one, or else its joints.

    Raises:
        LatticeError: a strut end that misses the skin, or a skin that holds no strut.
    """
    walls, skin_mm = structure.extrusion, case.lattice.skin_mm
    if skin_mm > 0 and walls is not None:
        skin, sheet = wall_skin(structure, walls, part, case)
        vertices = sheet.surface.vertices
        # Vertices on the outline are in the middle of nothing: half a skin off still counts.
        reach = RegionReach.of(vertices, part, case, stress, skin_mm / 2, walls=walls)
        return SheetVertices(len(structure.joints), skin, reach, sheet.edge)
    if skin_mm > 0:
        skin, mesh = frame_skin(structure, part, case, stress.mesh)
        return SkinVertices(len(structure.joints), skin, mesh, stress)
    thickest = float(structure.radii.max())
    reach = RegionReach.of(structure.joints, part, case, stress, thickest, walls=walls)
    return StrutJoints(structure, reach)


def _carried_to(
    reach: RegionReach,
    reached: Int[np.ndarray, " reached"],
    nodal: Float[np.ndarray, "nodes 3"],
    *,
    lever: float,
) -> Float[np.ndarray, "reached 6"]:
    """`carried_forces` of the forces on the solid's nodes [N], of walls what is in their plane."""
    loaded = np.flatnonzero(nodal.any(axis=1))
    points, applied = reach.stress.mesh.nodes[loaded], nodal[loaded]
    if reach.walls is not None:
        # Along the axis of extrusion a wall is rigid: forces act where they are seen along it.
        axis, middle = reach.walls.axis, (reach.walls.low + reach.walls.high) / 2
        points = points - (points @ axis - middle)[:, None] * axis
        applied = applied - (applied @ axis)[:, None] * axis
    return carried_forces(reach.joints[reached], points, applied, lever=lever)


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
