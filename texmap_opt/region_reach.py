"""Which joints of a lattice without a skin meet a region of the part's surface.

The rules are those of docs/decisions/0002-supports-and-loads-on-frames.md, and for walls of
docs/decisions/0011-mechanics-of-extruded-lattices.md.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from texmap_opt.case import DesignCase
from texmap_opt.errors import LatticeError
from texmap_opt.part import Part
from texmap_opt.region import AbstractRegion, Box, Cylinder, Sphere, Stl
from texmap_opt.shadow_distance import near_shadow
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.stress_field import StressField, region_slack, selected_facets, selected_nodes
from texmap_opt.structure.plane_axes import plane_axes
from texmap_opt.structure.structure import Extrusion

# Regions that have an inside: a joint there is reached however far it is from the surface.
VOLUMES = (Box, Sphere, Cylinder, Stl)

# Places over the depth of the walls at which it is asked whether they meet a region, ends included.
# They find what is no facet's: regions smaller than one, and joints inside a region. Facets are met
# exactly, however small.
LEVELS = 17


@dataclass(frozen=True, eq=False)
class RegionReach:
    """Joints, and what is needed to tell which of them meet a region.

    The joint of walls is a line along the axis of extrusion, and meets what any of its points meets.

    Attributes:
        joints: positions [mm].
        places: of each joint that are looked at, one place after the other [mm].
        closest: nearest point of the part's surface to each place [mm].
        normal: the surface's normal there.
        distance: to it [mm].
        stress: analysis of the solid part; its mesh tells what a region selects.
        reach: largest distance at which a joint meets a region [mm].
        walls: axis and heights of the extrusion; None: struts are bars.
    """

    joints: Float[np.ndarray, "joints 3"]
    places: Float[np.ndarray, "samples 3"]
    closest: Float[np.ndarray, "samples 3"]
    normal: Float[np.ndarray, "samples 3"]
    distance: Float[np.ndarray, " samples"]
    stress: StressField
    reach: float
    walls: Extrusion | None

    @classmethod
    def of(
        cls,
        joints: Float[np.ndarray, "joints 3"],
        part: Part,
        case: DesignCase,
        stress: StressField,
        thickest: float,
        *,
        walls: Extrusion | None = None,
    ) -> "RegionReach":
        """Prepare the joints of a lattice.

        Args:
            joints: positions [mm].
            part: what the lattice fills.
            case: gives the tolerance.
            stress: analysis of the solid part.
            thickest: radius of the thickest strut, or half the thickness of the thickest wall [mm].
            walls: axis and heights of the extrusion; None: struts are bars.
        """
        places = joints
        if walls is not None:
            levels = np.linspace(walls.low, walls.high, LEVELS)
            rise = levels[:, None] - joints @ walls.axis
            places = (joints + rise[..., None] * walls.axis).reshape(-1, 3)
        closest, distance, face = part.closest(places)
        return cls(
            joints,
            places,
            closest,
            part.surface.face_normals[face],
            np.abs(distance),
            stress,
            thickest + case.output.tolerance_mm,
            walls,
        )

    def meets(self, region: AbstractRegion) -> Bool[np.ndarray, " joints"]:
        """Whether each joint meets a region of the surface."""
        slack = region_slack(self.stress.mesh.nodes)
        near = region.contains(self.closest, self.normal, slack=slack)
        near &= self.distance <= self.reach
        if isinstance(region, VOLUMES):
            near |= region.contains(self.places, None, slack=slack)
        return near.reshape(-1, len(self.joints)).any(axis=0) | self._meets_facets(region)

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

    def _meets_facets(self, region: AbstractRegion) -> Bool[np.ndarray, " joints"]:
        """Whether each joint is near the facets of the analysis that belong to the region.

        At an edge of the part the nearest surface may be the neighbouring face, hence this.
        """
        mesh = self.stress.mesh
        corners = mesh.boundary_facets[:, :3]
        chosen = np.asarray(np.isin(corners, selected_nodes(mesh, region)).all(axis=1))
        chosen[selected_facets(mesh, region)] = True
        if not chosen.any():
            return np.zeros(len(self.joints), bool)
        if self.walls is not None:
            plane = plane_axes(self.walls.axis)[:2]
            shadows = (mesh.nodes @ plane.T)[corners[chosen]]
            return near_shadow(self.joints @ plane.T, shadows, self.reach)
        facets = SignedDistance(TriMesh(mesh.nodes, corners[chosen]))
        return np.asarray(facets.unsigned(self.joints)[0] <= self.reach)
