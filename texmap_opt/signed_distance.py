"""Distance to a closed surface and the side a point lies on; the only user of libigl.

The distance is exact (nearest point by an axis-aligned bounding-box tree). The side is the
generalised winding number of Jacobson, Kavan and Sorkine-Hornung (2013), evaluated by the fast
hierarchy of Barill, Dickson, Schmidt, Levin and Jacobson (2018): unlike the normal of the nearest
triangle it does not fail next to sharp edges, slivers and small gaps.
"""

from dataclasses import dataclass
from functools import cached_property

import igl
import numpy as np
from jaxtyping import Bool, Float, Int

from texmap_opt.solid.tri_mesh import TriMesh

# Points a query handles at once: about 40 MB of temporary arrays, with no measurable overhead.
POINTS_PER_CHUNK = 500_000
# The fast winding number is wrong by up to 0.005 (measured on a sphere of 5,120 triangles); within
# ten times that of the threshold the exact sum decides.
DOUBTFUL_WINDING = 0.05
# Cells along the longest side of the points' box, for the curve that puts them in order.
_CURVE_CELLS = 1023
# Steps that put two zeros between the ten bits of a number.
_SPREAD_BITS = ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249))


@dataclass(frozen=True, eq=False)
class SignedDistance:
    """Queries against one surface, whose search trees are built once, at the first query.

    Attributes:
        surface: a closed surface, counter-clockwise seen from outside [mm].
    """

    surface: TriMesh

    def __call__(
        self, points: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Distance [mm], negative inside; the nearest face; the nearest point on it [mm]."""
        distance, face, closest = self.unsigned(points)
        return np.where(self.contains(points), -distance, distance), face, closest

    def unsigned(
        self, points: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Distance without sign [mm], nearest face, nearest point; an open surface will do."""
        order = _along_a_curve(points)
        distance, face = np.zeros(len(points)), np.zeros(len(points), dtype=np.int64)
        closest = np.zeros((len(points), 3))
        start = 0
        for chunk in _chunks(points[order]):
            squared, nearest, place = self._tree.squared_distance(
                self._vertices, self._faces, chunk
            )
            chosen = order[start : start + len(chunk)]
            distance[chosen], face[chosen] = np.sqrt(squared), nearest
            closest[chosen] = np.reshape(place, (-1, 3))
            start += len(chunk)
        return distance, face, closest

    def winding_number(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """How often the surface encloses each point: 0 outside, 1 inside; error below 0.005."""
        return np.concatenate([self._hierarchy.winding_number(chunk) for chunk in _chunks(points)])

    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Whether each point lies inside; on the surface itself either answer."""
        winding = self.winding_number(points)
        doubtful = np.flatnonzero(np.abs(winding - 0.5) < DOUBTFUL_WINDING)
        if doubtful.size:
            query = np.ascontiguousarray(points[doubtful], dtype=np.float64)
            winding[doubtful] = igl.winding_number(self._vertices, self._faces, query)
        return winding > 0.5

    def first_hit(
        self,
        origins: Float[np.ndarray, "n 3"],
        directions: Float[np.ndarray, "n 3"],
        *,
        within: float = np.inf,
    ) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """Path along each ray to the first face it meets, and that face.

        Args:
            origins: starts of the rays [mm].
            directions: any length; the path is in units of it.
            within: longest path that is followed: in a fine lattice six times faster than inf.

        Returns:
            path (inf where the ray meets nothing) and face (-1 there).
        """
        paths, faces = [], []
        for start, along in zip(_chunks(origins), _chunks(directions), strict=True):
            face, path, _ = self._tree.intersect_ray_first(
                self._vertices, self._faces, start, along, within
            )
            missed = np.less(face, 0) | ~np.isfinite(path)
            paths.append(np.where(missed, np.inf, path))
            faces.append(np.where(missed, -1, face))
        return np.concatenate(paths), np.concatenate(faces).astype(np.int64)

    @cached_property
    def _vertices(self) -> np.ndarray:
        return np.ascontiguousarray(self.surface.vertices, dtype=np.float64)

    @cached_property
    def _faces(self) -> np.ndarray:
        return np.ascontiguousarray(self.surface.faces, dtype=np.int64)

    @cached_property
    def _tree(self) -> igl.AABB:
        tree = igl.AABB()
        tree.init(self._vertices, self._faces)
        return tree

    @cached_property
    def _hierarchy(self) -> igl.FastWindingNumberBVH:
        hierarchy = igl.FastWindingNumberBVH()
        hierarchy.init(self._vertices, self._faces)
        return hierarchy


def signed_distance(
    surface: TriMesh, points: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Distance to a closed surface, as `SignedDistance(surface)(points)`.

    Args:
        surface: closed, counter-clockwise seen from outside [mm].
        points: where the distance is wanted [mm].

    Returns:
        distance [mm] (negative inside), nearest face, nearest point [mm].
    """
    return SignedDistance(surface)(points)


def winding_number(surface: TriMesh, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """How often the surface encloses each point: 0 outside, 1 inside; error below 0.005."""
    return SignedDistance(surface).winding_number(points)


def _along_a_curve(points: np.ndarray) -> np.ndarray:
    """Order of points along Morton's curve: neighbours meet the same branches of a tree.

    Twice as fast as at random, on 400,000 points and 5,026 triangles.
    """
    low = points.min(axis=0, initial=np.inf)
    extent = float((points.max(axis=0, initial=-np.inf) - low).max(initial=0.0))
    if not 0 < extent < np.inf:
        return np.arange(len(points))
    key = np.zeros(len(points), dtype=np.int64)
    for axis in range(3):
        spread = ((points[:, axis] - low[axis]) * (_CURVE_CELLS / extent)).astype(np.int64)
        for shift, mask in _SPREAD_BITS:
            spread = (spread | (spread << shift)) & mask
        key |= spread << axis
    return np.argsort(key)


def _chunks(points: np.ndarray) -> list[np.ndarray]:
    """Contiguous float64 pieces (one empty piece for no points, so that shapes stay right)."""
    starts = range(0, max(len(points), 1), POINTS_PER_CHUNK)
    return [
        np.ascontiguousarray(points[start : start + POINTS_PER_CHUNK], dtype=np.float64)
        for start in starts
    ]
