"""Which joints of a lattice without a skin meet a region of the part's surface.

The rule is that of docs/decisions/0002-supports-and-loads-on-frames.md.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from texmap_opt.case import DesignCase
from texmap_opt.errors import LatticeError
from texmap_opt.part import Part
from texmap_opt.region import AbstractRegion, Box, Cylinder, Sphere, Stl
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.stress_field import StressField, region_slack, selected_facets, selected_nodes

# Regions that have an inside: a joint there is reached however far it is from the surface.
VOLUMES = (Box, Sphere, Cylinder, Stl)


@dataclass(frozen=True, eq=False)
class RegionReach:
    """Joints, and what is needed to tell which of them meet a region.

    Attributes:
        joints: positions [mm].
        closest: nearest point of the part's surface [mm].
        normal: the surface's normal there.
        distance: to it [mm].
        stress: analysis of the solid part; its mesh tells what a region selects.
        reach: largest distance at which a joint meets a region [mm].
    """

    joints: Float[np.ndarray, "joints 3"]
    closest: Float[np.ndarray, "joints 3"]
    normal: Float[np.ndarray, "joints 3"]
    distance: Float[np.ndarray, " joints"]
    stress: StressField
    reach: float

    @classmethod
    def of(
        cls,
        joints: Float[np.ndarray, "joints 3"],
        part: Part,
        case: DesignCase,
        stress: StressField,
        thickest: float,
    ) -> "RegionReach":
        """Prepare the joints of a lattice whose thickest strut has the radius `thickest` [mm]."""
        closest, distance, face = part.closest(joints)
        return cls(
            joints,
            closest,
            part.surface.face_normals[face],
            np.abs(distance),
            stress,
            thickest + case.output.tolerance_mm,
        )

    def meets(self, region: AbstractRegion) -> Bool[np.ndarray, " joints"]:
        """Whether each joint meets a region of the surface."""
        slack = region_slack(self.stress.mesh.nodes)
        near = region.contains(self.closest, self.normal, slack=slack)
        near &= self.distance <= self.reach
        near |= self._to_facets(region) <= self.reach
        if isinstance(region, VOLUMES):
            near |= region.contains(self.joints, None, slack=slack)
        return near

    def reached(self, where: str, region: AbstractRegion) -> Int[np.ndarray, " reached"]:
        """Joints that meet a region of the surface.

        Raises:
            LatticeError: when there is none; `where` names the key in the message.
        """
        near = self.meets(region)
        if not near.any():
            raise LatticeError(
                f"{where} region: no strut reaches {region.describe()} to within "
                f"{self.reach:.3g} mm; use smaller cells or a larger region."
            )
        return np.flatnonzero(near)

    def _to_facets(self, region: AbstractRegion) -> Float[np.ndarray, " joints"]:
        """Distance of each joint to the facets of the analysis that belong to the region [mm].

        At an edge of the part the nearest surface may be the neighbouring face, hence this.
        """
        mesh = self.stress.mesh
        corners = mesh.boundary_facets[:, :3]
        chosen = np.asarray(np.isin(corners, selected_nodes(mesh, region)).all(axis=1))
        chosen[selected_facets(mesh, region)] = True
        if not chosen.any():
            return np.full(len(self.joints), np.inf)
        return SignedDistance(TriMesh(mesh.nodes, corners[chosen])).unsigned(self.joints)[0]
