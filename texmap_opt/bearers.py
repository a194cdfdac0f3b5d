"""What supports hold and loads act on: the joints of a bare lattice, or the vertices of its skin.

The rules are those of docs/decisions/0002-supports-and-loads-on-frames.md.
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
from texmap_opt.skinned_frame import FrameSkin, forces_on_skin, frame_skin
from texmap_opt.stress_field import StressField, selected_nodes
from texmap_opt.structure.structure import Structure

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
        loaded = np.flatnonzero(nodal.any(axis=1))
        forces[reached] = carried_forces(
            self.structure.joints[reached],
            self.reach.stress.mesh.nodes[loaded],
            nodal[loaded],
            lever=float(self.structure.radii.mean()),
        )
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
        stress: analysis of the solid part; its mesh tells what a region selects.
    """

    lattice: int
    skin: FrameSkin
    stress: StressField

    @property
    def joints(self) -> int:
        """See `AbstractBearer`."""
        return self.lattice + len(self.skin.mesh.nodes)

    def held(self, where: str, region: AbstractRegion) -> Int[np.ndarray, " reached"]:
        """See `AbstractBearer`."""
        chosen = selected_nodes(self.stress.mesh, region)
        found = np.flatnonzero(np.isin(self.skin.mesh.nodes, chosen))
        if len(found) == 0:
            raise LatticeError(
                f"{where} region: no corner of the skin's triangles lies in {region.describe()}; use a "
                "smaller [analysis] edge_mm or a larger region."
            )
        return self.lattice + found

    def carried(self, load: Load, nodal: Float[np.ndarray, "nodes 3"]) -> Forces:
        """See `AbstractBearer`."""
        forces = np.zeros((self.joints, 6))
        forces[self.lattice :] = forces_on_skin(self.stress.mesh, self.skin.mesh, nodal)
        return forces

    def own_weight(self, density: float, g: Float[np.ndarray, " 3"]) -> Forces:
        """That of the skin."""
        points = np.zeros((self.joints, 3))
        points[self.lattice :] = self.skin.mesh.surface.vertices
        return np.asarray(skin_gravity_forces(self.skin.shell, points, density, g))


def bearer_of(
    structure: Structure, part: Part, case: DesignCase, stress: StressField
) -> AbstractBearer:
    """The skin of a lattice where the case asks for one, or else its joints.

    Raises:
        LatticeError: a strut end that misses the skin, or a skin that holds no strut.
    """
    if case.lattice.skin_mm > 0:
        skin = frame_skin(structure, part, case, stress.mesh)
        return SkinVertices(len(structure.joints), skin, stress)
    thickest = float(structure.radii.max())
    return StrutJoints(structure, RegionReach.of(structure.joints, part, case, stress, thickest))


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
