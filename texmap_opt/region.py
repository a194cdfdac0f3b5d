"""Regions of a part: where it is held, where it is loaded, where its cells are painted."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from texmap_opt.errors import CaseError
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh

# [mm]; what a machinist calls the same plane, far below any tet edge.
PLANE_TOLERANCE = 1e-3
# [degrees]; a flat face's facets agree to rounding, a fillet turns this much within a facet or two.
NORMAL_ANGLE = 15.0

# One row a point.
Points = Float[np.ndarray, "n 3"]
Chosen = Bool[np.ndarray, " n"]
Distances = Float[np.ndarray, " n"]


class AbstractRegion(ABC):
    """A set of points in space, or of a surface, told by position and outward normal."""

    @abstractmethod
    def contains(self, points: Points, normals: Points | None, *, slack: float) -> Chosen:
        """Whether each point belongs to the region.

        Args:
            points: positions [mm].
            normals: unit outward normals of the surface there; only `Normal` asks for them.
            slack: how far outside a geometric limit still counts [mm].
        """

    @abstractmethod
    def distance(self, points: Points) -> Distances:
        """Distance of each point to the region's boundary [mm], negative inside.

        Exact but for an `Intersection`. It changes by no more than the way between two points.

        Raises:
            CaseError: the region is one of a surface only, which has no inside.
        """

    @abstractmethod
    def describe(self) -> str:
        """The region in words, for messages."""


@dataclass(frozen=True, eq=False)
class Box(AbstractRegion):
    """Between two opposite corners, edges along the axes.

    Attributes:
        low: lowest corner [mm].
        high: highest corner [mm].
    """

    low: Float[np.ndarray, " 3"]
    high: Float[np.ndarray, " 3"]

    def contains(self, points: Points, normals: Points | None, *, slack: float) -> Chosen:
        """See `AbstractRegion.contains`."""
        inside = (points >= self.low - slack) & (points <= self.high + slack)
        return np.all(inside, axis=1)

    def distance(self, points: Points) -> Distances:
        """See `AbstractRegion.distance`."""
        beyond = np.maximum(self.low - points, points - self.high)
        outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
        return outside + np.minimum(beyond.max(axis=1), 0)

    def describe(self) -> str:
        """See `AbstractRegion.describe`."""
        return f"the box from {_shown(self.low)} to {_shown(self.high)} mm"


@dataclass(frozen=True, eq=False)
class Sphere(AbstractRegion):
    """A ball.

    Attributes:
        center: its centre [mm].
        radius: its radius [mm].
    """

    center: Float[np.ndarray, " 3"]
    radius: float

    def contains(self, points: Points, normals: Points | None, *, slack: float) -> Chosen:
        """See `AbstractRegion.contains`."""
        return np.linalg.norm(points - self.center, axis=1) <= self.radius + slack

    def distance(self, points: Points) -> Distances:
        """See `AbstractRegion.distance`."""
        return np.linalg.norm(points - self.center, axis=1) - self.radius

    def describe(self) -> str:
        """See `AbstractRegion.describe`."""
        return f"the sphere of radius {self.radius:g} mm about {_shown(self.center)} mm"


@dataclass(frozen=True, eq=False)
class Cylinder(AbstractRegion):
    """A solid cylinder with flat ends.

    Attributes:
        start: centre of one end [mm].
        end: centre of the other end [mm].
        radius: its radius [mm].
    """

    start: Float[np.ndarray, " 3"]
    end: Float[np.ndarray, " 3"]
    radius: float

    def contains(self, points: Points, normals: Points | None, *, slack: float) -> Chosen:
        """See `AbstractRegion.contains`."""
        along, across, length = self._along_and_across(points)
        return (along >= -slack) & (along <= length + slack) & (across <= self.radius + slack)

    def distance(self, points: Points) -> Distances:
        """See `AbstractRegion.distance`."""
        along, across, length = self._along_and_across(points)
        # A rectangle in the half plane through the axis and the point.
        beyond = np.stack([np.maximum(-along, along - length), across - self.radius], axis=1)
        outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
        return outside + np.minimum(beyond.max(axis=1), 0)

    def _along_and_across(self, points: Points) -> tuple[Distances, Distances, float]:
        """How far along the axis from the start, and how far off it; the length [mm]."""
        axis = self.end - self.start
        length = float(np.linalg.norm(axis))
        axis = axis / length
        along = (points - self.start) @ axis
        across = np.linalg.norm(points - self.start - along[:, None] * axis, axis=1)
        return along, across, length

    def describe(self) -> str:
        """See `AbstractRegion.describe`."""
        ends = f"from {_shown(self.start)} to {_shown(self.end)} mm"
        return f"the cylinder of radius {self.radius:g} mm {ends}"


@dataclass(frozen=True, eq=False)
class Plane(AbstractRegion):
    """Points near a plane, on either side of it.

    Attributes:
        point: a point of the plane [mm].
        normal: its unit normal.
        tolerance: largest distance from it [mm].
    """

    point: Float[np.ndarray, " 3"]
    normal: Float[np.ndarray, " 3"]
    tolerance: float = PLANE_TOLERANCE

    def contains(self, points: Points, normals: Points | None, *, slack: float) -> Chosen:
        """See `AbstractRegion.contains`."""
        return np.abs((points - self.point) @ self.normal) <= self.tolerance + slack

    def distance(self, points: Points) -> Distances:
        """See `AbstractRegion.distance`: of the layer, as thick as twice the tolerance."""
        return np.abs((points - self.point) @ self.normal) - self.tolerance

    def describe(self) -> str:
        """See `AbstractRegion.describe`."""
        near = f"within {self.tolerance:g} mm of the plane through {_shown(self.point)} mm"
        return f"{near} with normal {_shown(self.normal)}"


@dataclass(frozen=True, eq=False)
class Normal(AbstractRegion):
    """Where the surface faces a direction.

    Attributes:
        direction: unit vector.
        angle_deg: largest angle between it and the outward normal [degrees].
    """

    direction: Float[np.ndarray, " 3"]
    angle_deg: float = NORMAL_ANGLE

    def contains(self, points: Points, normals: Points | None, *, slack: float) -> Chosen:
        """See `AbstractRegion.contains`; slack, a length, does not widen the angle.

        Raises:
            ValueError: without normals.
        """
        if normals is None:
            raise ValueError("a region by normal needs the normals of the points")
        # By the half chord: the arc cosine of the dot product loses half the digits near zero.
        half_chord = np.linalg.norm(normals - self.direction, axis=1) / 2
        angle = 2 * np.arcsin(np.minimum(half_chord, 1))
        # Rounding only: a facet exactly at the limit belongs to the region.
        return angle <= math.radians(self.angle_deg) + 1e-12

    def distance(self, points: Points) -> Distances:
        """Refused; see `AbstractRegion.distance`."""
        raise CaseError(
            f"{self.describe()} is no region of space, since it has no inside; give a box, sphere, "
            "cylinder, plane or STL."
        )

    def describe(self) -> str:
        """See `AbstractRegion.describe`."""
        return f"the surface facing {_shown(self.direction)} to within {self.angle_deg:g} degrees"


@dataclass(frozen=True, eq=False)
class Stl(AbstractRegion):
    """Inside a closed surface.

    Attributes:
        surface: the surface [mm].
        name: of the file, for messages.
    """

    surface: TriMesh
    name: str

    def contains(self, points: Points, normals: Points | None, *, slack: float) -> Chosen:
        """See `AbstractRegion.contains`."""
        return self.distance(points) <= slack

    def distance(self, points: Points) -> Distances:
        """See `AbstractRegion.distance`."""
        distance, _, _ = SignedDistance(self.surface)(points)
        return distance

    def describe(self) -> str:
        """See `AbstractRegion.describe`."""
        low, high = self.surface.bounds
        return f"the inside of {self.name}, which spans {_shown(low)} to {_shown(high)} mm,"


@dataclass(frozen=True, eq=False)
class Intersection(AbstractRegion):
    """Points that belong to all of several regions.

    Attributes:
        regions: two or more.
    """

    regions: tuple[AbstractRegion, ...]

    def contains(self, points: Points, normals: Points | None, *, slack: float) -> Chosen:
        """See `AbstractRegion.contains`."""
        inside = [region.contains(points, normals, slack=slack) for region in self.regions]
        return np.logical_and.reduce(inside)

    def distance(self, points: Points) -> Distances:
        """See `AbstractRegion.distance`; the largest of those to the regions.

        Inside that is exact. Outside it is a lower bound, too small where the nearest point lies
        on an edge of the intersection.
        """
        return np.max([region.distance(points) for region in self.regions], axis=0)

    def describe(self) -> str:
        """See `AbstractRegion.describe`."""
        return " and ".join(region.describe() for region in self.regions)


def _shown(vector: np.ndarray) -> str:
    return "[" + ", ".join(f"{x:.6g}" for x in vector) + "]"
