"""Wanted edge lengths over a solid: what an error estimate asks of the mesher."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import Delaunay, KDTree

from fea.elements import TETRAHEDRON_EDGES
from fea.errors import FeaError
from fea.tet_mesh import TetMesh, tet_volumes

# Largest growth of the wanted edge over a distance, as its share: the next tet is 0.4 times larger.
# With 0.3 to 0.5 an L-bracket reaches 5 % with equally many nodes; steeper, and edges near the smallest
# come out longer than wanted; flatter, and most nodes serve the transition.
GROWTH = 0.4
# The background reaches this share of the bounding box's diagonal beyond it on every side.
MARGIN = 0.1
# Tets of a background flatter than this share of their longest edge cubed have no use: they hold
# no point, and interpolation over them is unstable.
FLAT_VOLUME = 1e-9


@dataclass(frozen=True, eq=False)
class Sizing:
    """Wanted edge lengths at the nodes of a background mesh, linear between them.

    Attributes:
        nodes: positions [mm].
        tets: tet4 between them, in any order of corners.
        edge: wanted edge at each node [mm].

    Raises:
        FeaError: when shapes differ, or an edge is not a length above 0.
    """

    nodes: Float[np.ndarray, "nodes 3"]
    tets: Int[np.ndarray, "cells 4"]
    edge: Float[np.ndarray, " samples"]

    def __post_init__(self):
        if len(self.edge) != len(self.nodes):
            raise FeaError(
                f"Edges are wanted at {len(self.edge)} nodes, but the background mesh has "
                f"{len(self.nodes)}."
            )
        if not (np.isfinite(self.edge).all() and (self.edge > 0).all()):
            raise FeaError(
                f"Wanted edges go from {self.edge.min():g} to {self.edge.max():g}; all must be "
                "lengths above 0."
            )

    @classmethod
    def around(
        cls, mesh: TetMesh, edge: Float[np.ndarray, " nodes"], *, margin: float = MARGIN
    ) -> "Sizing":
        """Edges given at the nodes of a mesh, carried on beyond its surface.

        A new mesh of the same solid has its surface elsewhere: within the mesher's envelope, and off
        the old chords where the solid is curved. So the background is the Delaunay tetrahedra of the
        mesh's nodes and of a grid on a larger box, whose points continue the nearest node's edge with
        `GROWTH`.

        Args:
            mesh: tet4 of the solid.
            edge: wanted edge at each node of the mesh [mm].
            margin: how far the box reaches beyond the mesh, as a share of its diagonal.
        """
        nodes = mesh.nodes
        low, high = nodes.min(axis=0), nodes.max(axis=0)
        reach = margin * float(np.linalg.norm(high - low))
        shell = _box_points(low - reach, high + reach, margin=reach)
        distance, nearest = KDTree(nodes).query(shell)
        points = np.concatenate([nodes, shell])
        values = np.concatenate([edge, edge[nearest] + GROWTH * distance])
        tets = Delaunay(points).simplices.astype(np.int64)
        volume = np.abs(tet_volumes(points, tets))
        longest = np.linalg.norm(points[tets] - np.roll(points[tets], 1, axis=1), axis=-1).max(
            axis=1
        )
        return cls(points, tets[volume > FLAT_VOLUME * longest**3], values)

    @property
    def tets_wanted(self) -> float:
        """Integral of 1/edge³ over the background: proportional to the tets it asks for, and more."""
        volumes = np.abs(tet_volumes(self.nodes, self.tets))
        return float((volumes * (1 / self.edge[self.tets] ** 3).mean(axis=1)).sum())

    def scaled(self, factor: float) -> "Sizing":
        """The same field with every edge multiplied."""
        return Sizing(self.nodes, self.tets, self.edge * factor)


def graded(
    mesh: TetMesh, edge: Float[np.ndarray, " nodes"], *, growth: float = GROWTH
) -> Float[np.ndarray, " nodes"]:
    """The largest edges below the given ones that grow no faster than `growth` times the distance.

    Distances run along the mesh's edges, so that the two walls of a slit do not see each other:
    h(x) = min over y of edge(y) + growth * |x - y|, as in Persson, Engineering with Computers 22
    (2006) 95-109.

    Args:
        mesh: tet4.
        edge: wanted edge at each node [mm].
        growth: largest slope.
    """
    ends = mesh.tets[:, TETRAHEDRON_EDGES].reshape(-1, 2)
    ends = np.unique(np.sort(ends, axis=1), axis=0)
    length = np.linalg.norm(mesh.nodes[ends[:, 0]] - mesh.nodes[ends[:, 1]], axis=1)
    # A source joined to every node by a way as long as the node's wanted edge: distances from it
    # are the graded edges.
    source, count = len(mesh.nodes), len(mesh.nodes)
    rows = np.concatenate([ends[:, 0], ends[:, 1], np.full(count, source)])
    columns = np.concatenate([ends[:, 1], ends[:, 0], np.arange(count)])
    ways = csr_array(
        (np.concatenate([growth * length, growth * length, edge]), (rows, columns)),
        shape=(count + 1, count + 1),
    )
    return np.asarray(dijkstra(ways, indices=source))[:count]


def nodal_edges(mesh: TetMesh) -> Float[np.ndarray, " nodes"]:
    """Mean length of the tet edges that meet at each node of a tet4 mesh [mm]."""
    ends = mesh.tets[:, TETRAHEDRON_EDGES].reshape(-1, 2)
    length = np.linalg.norm(mesh.nodes[ends[:, 0]] - mesh.nodes[ends[:, 1]], axis=1)
    total, count = np.zeros(len(mesh.nodes)), np.zeros(len(mesh.nodes))
    np.add.at(total, ends, length[:, None])
    np.add.at(count, ends, 1)
    return total / count


def tets_wanted(mesh: TetMesh, edge: Float[np.ndarray, " nodes"]) -> float:
    """Integral of 1/edge³ over a tet4 mesh: proportional to the tets that the field asks for."""
    return float((mesh.volumes * (1 / edge[mesh.tets] ** 3).mean(axis=1)).sum())


def _box_points(
    low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"], *, margin: float
) -> Float[np.ndarray, "points 3"]:
    """A grid on the faces of a box, as fine as the margin, so that no tet leans far into the solid."""
    counts = np.maximum(1, np.ceil((high - low) / (2 * margin)).astype(int))
    axes = [np.linspace(a, b, n + 1) for a, b, n in zip(low, high, counts, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    index = np.stack(np.meshgrid(*[np.arange(n + 1) for n in counts], indexing="ij"), axis=-1)
    return grid[((index == 0) | (index == counts)).any(axis=-1)]
