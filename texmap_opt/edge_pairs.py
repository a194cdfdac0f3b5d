"""How triangles meet along edges: which are open, which join two, which join more."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from texmap_opt.solid.tri_mesh import TriMesh


@dataclass(frozen=True, eq=False)
class EdgePairs:
    """The half-edges of a list of triangles, grouped by the edge they run along.

    Half-edge 3 f + k runs from corner k of face f to the next corner.

    Attributes:
        faces: vertex indices of each triangle; a triangle's three are different.
    """

    faces: Int[np.ndarray, "faces 3"]

    @cached_property
    def half_edges(self) -> Int[np.ndarray, "edges 2"]:
        """First and last vertex of each half-edge."""
        return self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)

    @cached_property
    def joined(self) -> Int[np.ndarray, "edges 2"]:
        """The two half-edges of each edge that exactly two triangles share."""
        starts = self._starts[self._counts == 2]
        return np.stack([self._order[starts], self._order[starts + 1]], axis=1)

    @cached_property
    def agree(self) -> Bool[np.ndarray, " edges"]:
        """For each of `joined`: whether the two triangles have one orientation."""
        first = self.half_edges[self.joined[:, 0], 0]
        return first != self.half_edges[self.joined[:, 1], 0]

    @cached_property
    def open(self) -> Int[np.ndarray, " edges"]:
        """Half-edges along which a triangle has no neighbour."""
        return self._order[self._starts[self._counts == 1]]

    @cached_property
    def crowded(self) -> int:
        """Number of edges that more than two triangles share."""
        return int((self._counts > 2).sum())

    @cached_property
    def shells(self) -> Int[np.ndarray, " faces"]:
        """Number of the shell each face belongs to: faces joined across edges, however many."""
        chain = np.flatnonzero(np.repeat(self._counts, self._counts) > 1)
        # Consecutive half-edges of one edge's group are linked.
        linked = chain[:-1][np.diff(self._group[chain]) == 0] if chain.size else chain
        a, b = self._order[linked] // 3, self._order[linked + 1] // 3
        return _components(len(self.faces), a, b)

    @cached_property
    def _keys(self) -> Int[np.ndarray, " edges"]:
        ends = np.sort(self.half_edges, axis=1)
        return ends[:, 0] * (int(self.faces.max(initial=0)) + 1) + ends[:, 1]

    @cached_property
    def _order(self) -> Int[np.ndarray, " edges"]:
        return np.argsort(self._keys, kind="stable")

    @cached_property
    def _starts(self) -> Int[np.ndarray, " edges"]:
        return np.unique(self._keys[self._order], return_index=True)[1]

    @cached_property
    def _counts(self) -> Int[np.ndarray, " edges"]:
        return np.diff(np.append(self._starts, len(self._order)))

    @cached_property
    def _group(self) -> Int[np.ndarray, " edges"]:
        return np.repeat(np.arange(len(self._starts)), self._counts)


def consistently_oriented(
    faces: Int[np.ndarray, "faces 3"],
) -> tuple[Int[np.ndarray, "faces 3"], int] | None:
    """Faces turned so that neighbours agree, and how many had to be turned.

    In each shell the larger half keeps its orientation. None for a one-sided surface (a Möbius
    strip), which has no consistent orientation.
    """
    edges = EdgePairs(faces)
    n = len(faces)
    a, b = edges.joined.T // 3
    # Two copies of each face, as it is and turned; a link joins copies that agree.
    differ = np.where(edges.agree, 0, n)
    label = _components(2 * n, np.r_[a, a + n], np.r_[b + differ, b + n - differ])
    as_is, turned = label[:n], label[n:]
    if (as_is == turned).any():
        return None
    # The two components of a shell are each other's mirror; take the one with more faces as is.
    count = np.bincount(as_is, minlength=int(label.max()) + 1)
    mirror = np.zeros(len(count), dtype=np.int64)
    mirror[as_is], mirror[turned] = turned, as_is
    # On a tie the component that was numbered first wins, in both of its faces' views.
    component = np.arange(len(count))
    kept = (count > count[mirror]) | ((count == count[mirror]) & (component < mirror))
    turn = ~kept[as_is]
    return np.where(turn[:, None], faces[:, ::-1], faces), int(turn.sum())


def with_single_fans(surface: TriMesh) -> tuple[TriMesh, int]:
    """The surface with vertices doubled where several fans of triangles meet in one point.

    Returns:
        The surface (same positions, same triangles) and the number of vertices added.
    """
    edges = EdgePairs(surface.faces)
    h, g = edges.joined.T
    # Half-edge h starts at corner h of its face and ends at the next; its partner the other way
    # round when the orientations agree.
    h_end, g_end = h - h % 3 + (h + 1) % 3, g - g % 3 + (g + 1) % 3
    first, last = np.where(edges.agree, g_end, g), np.where(edges.agree, g, g_end)
    fan = _components(surface.faces.size, np.r_[h, h_end], np.r_[first, last])
    source = np.zeros(int(fan.max(initial=-1)) + 1, dtype=np.int64)
    source[fan] = surface.faces.reshape(-1)
    added = len(source) - len(np.unique(surface.faces))
    return TriMesh(surface.vertices[source], fan.reshape(-1, 3)), int(added)


def _components(
    n: int, a: Int[np.ndarray, " edges"], b: Int[np.ndarray, " edges"]
) -> Int[np.ndarray, " n"]:
    links = coo_array((np.ones(len(a), dtype=bool), (a, b)), shape=(n, n))
    return connected_components(links, directed=False)[1].astype(np.int64)
