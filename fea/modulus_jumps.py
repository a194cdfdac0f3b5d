"""A mesh torn where the modulus jumps, so that either side has nodes, and stress there, of its own.

At such a face the traction on it and the strain along it are continuous; the other components of
stress and of strain are not.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fea.elements import FACES_OF_TETRAHEDRON, TETRAHEDRA, barycentric
from fea.errors import FeaError
from fea.isoparametric import facet_points
from fea.quadrature import Quadrature
from fea.tet_mesh import TetMesh

# Moduli on the two sides of a face are samples of one smooth field where the larger is at most this
# times the smaller. Measured in `TornMesh`.
SMOOTH_RATIO = 1.5

# Corners of the reference triangle: there to evaluate at, not to integrate with.
CORNERS = Quadrature(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), np.ones(3), 0)


@dataclass(frozen=True, eq=False)
class InnerFaces:
    """Faces between two cells.

    Attributes:
        mesh: the mesh.
        cells: on either side.
        corners: nodes of the face, as numbered in the cell of either side and in the same order:
            three corners, or three corners and three mid-edge nodes.
        modulus: relative modulus of either side in the middle of the face.
    """

    mesh: TetMesh
    cells: Int[np.ndarray, "faces 2"]
    corners: Int[np.ndarray, "faces 2 corners"]
    modulus: Float[np.ndarray, "faces 2"]

    @classmethod
    def of(cls, mesh: TetMesh, modulus: Float[np.ndarray, "cells samples"]) -> "InnerFaces":
        """All inner faces of a mesh."""
        order, same = mesh.faces
        (first,) = np.nonzero(same)
        cells, face = np.divmod(np.stack([order[first], order[first + 1]], axis=1), 4)
        corners = FACES_OF_TETRAHEDRON[face, : 3 if mesh.element == "tet4" else 6]
        nodes = mesh.tets[cells[:, :, None], corners]
        # The second side's nodes in the order of the first side's.
        rank = np.argsort(np.argsort(nodes[:, 0], axis=1), axis=1)
        there = np.take_along_axis(np.argsort(nodes[:, 1], axis=1), rank, axis=1)
        corners[:, 1] = np.take_along_axis(corners[:, 1], there, axis=1)
        if modulus.shape[1] == 1:
            return cls(mesh, cells, corners, modulus[cells, 0])
        # Linear in the logarithm, which stays positive however steep the field is.
        points = TETRAHEDRA[mesh.tets.shape[1]].quadrature.points
        at_corners = np.log(modulus) @ np.linalg.inv(barycentric(points)).T
        middle = np.take_along_axis(at_corners[cells], corners[:, :, :3], axis=2).mean(axis=2)
        return cls(mesh, cells, corners, np.exp(middle))

    def where(self, some: Bool[np.ndarray, " faces"]) -> "InnerFaces":
        """Some of these faces."""
        return InnerFaces(self.mesh, self.cells[some], self.corners[some], self.modulus[some])

    @cached_property
    def nodes(self) -> Int[np.ndarray, "faces corners"]:
        """Nodes of each face."""
        return self.mesh.tets[self.cells[:, :1], self.corners[:, 0]]

    @cached_property
    def normals(self) -> Float[np.ndarray, "faces corners 3"]:
        """Unit normals at the three corners, out of the first cell."""
        _, normal = facet_points(self.mesh.nodes[self.nodes], CORNERS)
        return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


@dataclass(frozen=True, eq=False)
class TornMesh:
    """A mesh, and the same cells sharing nodes only where no jump lies between them.

    Two cells share a node when one is reached from the other through faces at that node across
    which the modulus does not jump. Where every face is a jump, every cell has nodes of its own.

    What counts as a jump was measured by the index of `fea.error_estimate` (estimated over true
    error, the best is 1) for bars of tet4 and tet10 with one modulus a cell, at two mesh sizes:

    ===============================  ===========  ===========  ===========
    largest ratio that is smooth     any          1.5          1.1
    ===============================  ===========  ===========  ===========
    smooth field                     0.8 to 1.2   0.8 to 1.2   0.8 to 1.2
    each cell at random, 0.5 to 2    0.9 to 2.4   0.8 to 1.7   0.8 to 1.5
    two layers, 1 and 0.1            1.1 to 7.6   0.7 to 1.0   0.7 to 1.0
    bar in a void of 1e-6            2.4 to 6.5   0.6 to 0.8   0.6 to 0.8
    each cell at random, 1e-3 to 1   2.4 to 6.4   0.5 to 1.6   0.5 to 1.7
    ===============================  ===========  ===========  ===========

    The true error is that against tet10 on the mesh of four times as many cells along each edge, itself
    not exact at the singular edges of voids and random moduli: there the index is too large, most of
    all on the finer mesh.

    Smaller ratios tear graded fields, to the harm of the stress at their nodes: 1.4 to 2.1 times as
    far from that of a fine mesh with 1.1, where no neighbours differ by more than 1.2. What meets with
    less than 1.5 is smoothed: name the sides by `groups` where that matters.

    Attributes:
        whole: the mesh.
        pieces: the same cells in the same order; the mesh itself where nothing jumps.
        node: for each node of the pieces, that of the whole mesh which it stands for.
        jumps: faces across which the modulus jumps; None where nothing does.
    """

    whole: TetMesh
    pieces: TetMesh
    node: Int[np.ndarray, " vertices"]
    jumps: InnerFaces | None

    @classmethod
    def between(
        cls,
        mesh: TetMesh,
        modulus: Float[np.ndarray, "cells samples"],
        *,
        groups: Int[np.ndarray, " cells"] | None = None,
    ) -> "TornMesh":
        """Tear a mesh where the modulus jumps, and between groups of cells.

        Args:
            mesh: the mesh.
            modulus: relative modulus, one a cell or one at each quadrature point. Jumps lie between
                cells; what the modulus does within a cell is taken as smooth.
            groups: a number for each cell, such as that of its part or material.

        Raises:
            FeaError: when moduli are no positive numbers.
        """
        if not ((modulus > 0) & np.isfinite(modulus)).all():
            raise FeaError("Relative moduli must be positive numbers, where stress is recovered.")
        untorn = cls(mesh, mesh, np.arange(len(mesh.nodes)), None)
        if modulus.max() <= SMOOTH_RATIO * modulus.min() and groups is None:
            return untorn
        faces = InnerFaces.of(mesh, modulus)
        jump = faces.modulus.max(axis=1) > SMOOTH_RATIO * faces.modulus.min(axis=1)
        if groups is not None:
            jump |= groups[faces.cells[:, 0]] != groups[faces.cells[:, 1]]
        if not jump.any():
            return untorn
        jumps = faces.where(jump)
        return cls(mesh, *_torn(mesh, jumps, faces.where(~jump)), jumps)


def _torn(
    mesh: TetMesh, jumps: InnerFaces, smooth: InnerFaces
) -> tuple[TetMesh, Int[np.ndarray, " vertices"]]:
    """The mesh with nodes shared through smooth faces only, and which node each stands for."""
    # Only the nodes of jumps can come apart: slots are their places in the cells.
    slot = np.zeros(len(mesh.nodes), dtype=bool)
    slot[jumps.nodes] = True
    slot = slot[mesh.tets]
    number = np.cumsum(slot.ravel()) - 1
    place = smooth.cells[:, :, None] * mesh.tets.shape[1] + smooth.corners
    a, b = place.transpose(1, 0, 2)[:, slot.ravel()[place[:, 0]]]
    shared = (np.ones(len(a), dtype=bool), (number[a], number[b]))
    graph = coo_array(shared, shape=(int(slot.sum()),) * 2)
    key = mesh.tets.astype(np.int64)
    key[slot] = len(mesh.nodes) + connected_components(graph, directed=False)[1]
    _, first, tets = np.unique(key, return_index=True, return_inverse=True)
    node = mesh.tets.ravel()[first]
    return TetMesh(mesh.nodes[node], tets.reshape(mesh.tets.shape)), node
