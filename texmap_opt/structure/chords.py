"""How long lines along one axis are inside a solid.

Seen along the axis lines are points and facets are triangles in a plane. Facets are sorted into square
bins, so that a point is compared with those in its bin alone.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.plane_axes import plane_axes

# Entries that the bins may have together: a facet has one for every bin that its bounding box meets.
MOST_ENTRIES = 4_000_000
# Points times facets compared at once: some 30 MB an array.
AT_ONCE = 1_000_000


def chords(
    surface: TriMesh, points: Float[np.ndarray, "samples 3"], axis: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " samples"]:
    """Length inside a solid of the line through each point along a unit vector [mm].

    Which side of an edge a point is on is computed once for the facets on both its sides, alike to
    the last bit, so that a line through an edge meets one of them. NaN where a line leaves the
    solid more or less often than it enters it, as through a hole of the surface.

    Args:
        surface: closed, outward oriented [mm].
        points: one on each line [mm].
        axis: direction of all lines.
    """
    bins = _Bins.of(surface, plane_axes(axis))
    flat = points @ bins.axes[:2].T
    count = bins.candidates(flat)
    inside, balance = np.zeros(len(points)), np.zeros(len(points))
    for some in _chunks(count):
        here = flat[some]
        place = np.repeat(np.arange(len(here)), count[some])
        sense, height = bins.meetings(here[place], bins.faces_at(here))
        inside[some] = np.bincount(place, weights=sense * height, minlength=len(here))
        balance[some] = np.bincount(place, weights=sense, minlength=len(here))
    return np.where(balance == 0, inside, np.nan)


@dataclass(frozen=True, eq=False)
class _Bins:
    """Facets in square bins of a plane.

    Attributes:
        surface: whose facets.
        axes: of the plane, as rows, and of the lines.
        corners: of the surface, in the plane [mm].
        heights: of the surface's vertices along the lines [mm].
        low: corner of the first bin [mm].
        edge: of the bins [mm].
        shape: number of bins along each axis.
        first: where the facets of each bin begin in `face`, and where the last end.
        face: the facets, bin by bin.
    """

    surface: TriMesh
    axes: Float[np.ndarray, "3 3"]
    corners: Float[np.ndarray, "vertices 2"]
    heights: Float[np.ndarray, " vertices"]
    low: Float[np.ndarray, " 2"]
    edge: float
    shape: tuple[int, int]
    first: Int[np.ndarray, " bins"]
    face: Int[np.ndarray, " n"]

    @classmethod
    def of(cls, surface: TriMesh, axes: Float[np.ndarray, "3 3"]) -> "_Bins":
        corners = surface.vertices @ axes[:2].T
        of_face = corners[surface.faces]
        low, high = of_face.min(axis=1), of_face.max(axis=1)
        origin, extent = low.min(axis=0), float((high.max(axis=0) - low.min(axis=0)).max())
        across = math.ceil(math.sqrt(len(surface.faces)))
        while True:
            edge = extent / across
            begin, end = (((at - origin) / edge).astype(int) for at in (low, high))
            spans = end - begin + 1
            count = spans.prod(axis=1)
            if count.sum() <= MOST_ENTRIES or across == 1:
                break
            across = across // 2
        face = np.repeat(np.arange(len(count)), count)
        rank = np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count)
        i, j = begin[face].T + np.stack(np.divmod(rank, spans[face, 1]))
        shape = (int(end[:, 0].max()) + 1, int(end[:, 1].max()) + 1)
        number = i * shape[1] + j
        order = np.argsort(number, kind="stable")
        first = np.searchsorted(number[order], np.arange(shape[0] * shape[1] + 1))
        return cls(
            surface,
            axes,
            corners,
            surface.vertices @ axes[2],
            origin,
            edge,
            shape,
            first,
            face[order],
        )

    def candidates(self, flat: Float[np.ndarray, "samples 2"]) -> Int[np.ndarray, " samples"]:
        """How many facets are in the bin of each point."""
        number, inside = self._bin(flat)
        return np.where(inside, self.first[number + 1] - self.first[number], 0)

    def faces_at(self, flat: Float[np.ndarray, "samples 2"]) -> Int[np.ndarray, " pairs"]:
        """The facets in the bins of the points, point by point."""
        count = self.candidates(flat)
        start = np.repeat(self.first[self._bin(flat)[0]], count)
        return self.face[start + np.arange(len(start)) - np.repeat(np.cumsum(count) - count, count)]

    def meetings(
        self, flat: Float[np.ndarray, "pairs 2"], face: Int[np.ndarray, " pairs"]
    ) -> tuple[Float[np.ndarray, " pairs"], Float[np.ndarray, " pairs"]]:
        """1 where the line leaves through a facet, -1 where it enters, 0 where it misses; the height.

        A point is in a triangle when it is on the left of all three edges, or on the right of all.
        """
        corner = self.surface.faces[face]
        area = np.zeros((len(face), 3))
        left = np.zeros((len(face), 3), bool)
        for k in range(3):
            # The edge opposite to corner k, from its vertex of lower number.
            a, b = corner[:, (k + 1) % 3], corner[:, (k + 2) % 3]
            start, end = self.corners[np.minimum(a, b)], self.corners[np.maximum(a, b)]
            along, off = end - start, flat - start
            side = along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0]
            turned = a > b
            area[:, k] = np.where(turned, -side, side)
            left[:, k] = (side >= 0) ^ turned
        sense = np.where(left.all(axis=1), 1.0, np.where(left.any(axis=1), 0.0, -1.0))
        total = area.sum(axis=1)
        corner_height = self.heights[corner]
        # A facet seen edge-on has no area: any height on it will do.
        flat_on = (sense != 0) & (total != 0)
        height = corner_height.mean(axis=1)
        share = area[flat_on] / total[flat_on, None]
        height[flat_on] = np.einsum("pk,pk->p", share, corner_height[flat_on])
        low, high = corner_height.min(axis=1), corner_height.max(axis=1)
        return sense, np.minimum(np.maximum(height, low), high)

    def _bin(
        self, flat: Float[np.ndarray, "samples 2"]
    ) -> tuple[Int[np.ndarray, " samples"], Bool[np.ndarray, " samples"]]:
        """Number of the bin of each point, and whether there is one."""
        index = np.floor((flat - self.low) / self.edge)
        inside = np.ones(len(flat), bool)
        for k, count in enumerate(self.shape):
            inside &= (index[:, k] >= 0) & (index[:, k] < count)
        index = np.where(inside[:, None], index, 0).astype(int)
        return index[:, 0] * self.shape[1] + index[:, 1], inside


def _chunks(count: Int[np.ndarray, " samples"]) -> list[slice]:
    """Runs of points with about `AT_ONCE` candidates together, one point at least."""
    total = np.cumsum(count)
    most = int(total[-1]) if len(total) else 0
    limits = np.arange(AT_ONCE, most + AT_ONCE, AT_ONCE)
    ends = np.unique(np.append(np.searchsorted(total, limits, side="right"), len(count)))
    begins = np.concatenate([[0], ends[:-1]])
    return [slice(int(a), int(b)) for a, b in zip(begins, ends, strict=True) if b > a]
