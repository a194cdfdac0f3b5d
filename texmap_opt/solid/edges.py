"""How the triangles of a surface are joined: edges, fans around vertices, shells."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from texmap_opt.solid.tri_mesh import TriMesh


@dataclass(frozen=True, eq=False)
class Edges:
    """The directed edges of a surface; edge 3 f + k runs from corner k of face f to the next one.

    Attributes:
        surface: any triangles, closed or not.
    """

    surface: TriMesh

    @cached_property
    def ends(self) -> Int[np.ndarray, "edges 2"]:
        """First and last vertex of each directed edge."""
        faces = self.surface.faces
        return np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)

    @cached_property
    def opposite(self) -> Int[np.ndarray, " edges"]:
        """The one edge that runs the other way; -1 where there is none or more than one."""
        starts, forward, backward = self._counts
        first = starts[(forward == 1) & (backward == 1)]
        one, other = self._order[first], self._order[first + 1]
        opposite = np.full(len(self.ends), -1)
        opposite[one], opposite[other] = other, one
        return opposite

    @cached_property
    def open(self) -> Bool[np.ndarray, " edges"]:
        """Whether nothing runs against an edge: a hole, or a neighbour turned inside out."""
        _, forward, backward = self._counts
        lonely = self._of_edges((forward == 0) | (backward == 0))
        # An edge from a vertex to itself is its own reverse.
        return lonely & (self.ends[:, 0] != self.ends[:, 1])

    @cached_property
    def crowded(self) -> Bool[np.ndarray, " edges"]:
        """Whether an edge, or its reverse, occurs more than once."""
        _, forward, backward = self._counts
        return self._of_edges((forward > 1) | (backward > 1))

    @cached_property
    def fan_of_corner(self) -> Int[np.ndarray, " corners"]:
        """Number of the fan of triangles each corner 3 f + k belongs to, over all vertices."""
        edges = np.flatnonzero(self.opposite >= 0)
        against = self.opposite[edges]
        # Both ends are shared: corner k of the edge is the corner after the opposite edge's start.
        return _groups(edges, _next(against), len(self.ends))

    @cached_property
    def shell_of_face(self) -> Int[np.ndarray, " faces"]:
        """Number of the edge-connected shell each face belongs to."""
        edges = np.flatnonzero(self.opposite >= 0)
        return _groups(edges // 3, self.opposite[edges] // 3, len(self.surface.faces))

    @cached_property
    def shell_volumes(self) -> Float[np.ndarray, " shells"]:
        """Signed volume of each shell [mm³]; meaningful where it is closed."""
        corners = self.surface.vertices[self.surface.faces]
        # Relative to the middle of the part: less cancellation far from the origin.
        corners = corners - corners.mean(axis=(0, 1))
        share = np.linalg.det(corners) / 6
        return np.bincount(self.shell_of_face, weights=share)

    @cached_property
    def _keys(self) -> Int[np.ndarray, " edges"]:
        """A number for the two ends of each edge, whichever way it runs."""
        return self.ends.min(axis=1) * len(self.surface.vertices) + self.ends.max(axis=1)

    @cached_property
    def _order(self) -> Int[np.ndarray, " edges"]:
        """The edges so that those between the same two vertices follow each other."""
        return np.argsort(self._keys, kind="stable")

    @cached_property
    def _counts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Per pair of vertices: where it starts in the order, edges from the lower, and back."""
        sorted_keys = self._keys[self._order]
        starts = np.flatnonzero(np.diff(sorted_keys, prepend=-1))
        if not len(starts):
            return starts, starts, starts
        rises = (self.ends[:, 0] <= self.ends[:, 1])[self._order]
        forward = np.add.reduceat(rises.astype(np.int64), starts)
        return starts, forward, np.diff(starts, append=len(rises)) - forward

    def _of_edges(self, of_pairs: Bool[np.ndarray, " pairs"]) -> Bool[np.ndarray, " edges"]:
        starts = self._counts[0]
        of_edges = np.zeros(len(self._order), dtype=bool)
        of_edges[self._order] = np.repeat(of_pairs, np.diff(starts, append=len(self._order)))
        return of_edges


def _next(edges: np.ndarray) -> np.ndarray:
    return edges - edges % 3 + (edges + 1) % 3


def _groups(first: np.ndarray, second: np.ndarray, count: int) -> np.ndarray:
    links = coo_array((np.ones(len(first), dtype=np.int8), (first, second)), shape=(count, count))
    return connected_components(links, directed=False)[1].astype(np.int64)
