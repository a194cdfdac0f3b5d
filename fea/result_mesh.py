"""Results of an analysis as a file holds them: a mesh of any cells, and named values on it."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from fea.errors import FeaError

# Dimension and number of corners of each kind of cell, by meshio's name without the count of nodes;
# corners come first in all of them, nodes on edges and faces after them.
CORNERS = {
    "vertex": (0, 1),
    "line": (1, 2),
    "triangle": (2, 3),
    "quad": (2, 4),
    "tetra": (3, 4),
    "pyramid": (3, 5),
    "wedge": (3, 6),
    "hexahedron": (3, 8),
}

# Triangles and quadrilaterals around each kind of solid cell (VTK file formats, figure 2).
FACES = {
    "tetra": ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)),
    "pyramid": ((0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    "wedge": ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "hexahedron": (
        (0, 1, 2, 3),
        (4, 5, 6, 7),
        (0, 1, 5, 4),
        (1, 2, 6, 5),
        (2, 3, 7, 6),
        (3, 0, 4, 7),
    ),
}


@dataclass(frozen=True, eq=False)
class ResultMesh:
    """Points, cells of any kinds, and values at both.

    Attributes:
        points: as in the file, in its unit.
        cells: kind, in meshio's names, and points of each cell, one block a kind.
        point_data: named values at the points.
        cell_data: named values of the cells, block after block.
    """

    points: Float[np.ndarray, "nodes 3"]
    cells: tuple[tuple[str, Int[np.ndarray, "_ _"]], ...]
    point_data: dict[str, Float[np.ndarray, "nodes _"]]
    cell_data: dict[str, Float[np.ndarray, "cells _"]]

    def __post_init__(self) -> None:
        require_known(kind for kind, _ in self.cells)

    @property
    def dimension(self) -> int:
        """The largest of the cells: 3 for solids, 2 for sheets, 1 for bars, 0 for mere points."""
        return max((CORNERS[_base(kind)][0] for kind, _ in self.cells), default=0)

    @cached_property
    def cell_volumes(self) -> Float[np.ndarray, " cells"]:
        """Volume of each cell; area or length where there is nothing of a higher dimension.

        Cells of a lower dimension than the others, such as the triangles around a solid, count 0.
        Exact for cells with straight edges and flat faces.
        """
        volumes = [
            _measure(_base(kind), self._corners(kind, nodes))
            if CORNERS[_base(kind)][0] == self.dimension
            else np.zeros(len(nodes))
            for kind, nodes in self.cells
        ]
        return np.concatenate([np.zeros(0), *volumes])

    @cached_property
    def cell_centres(self) -> Float[np.ndarray, "cells 3"]:
        """Mean of the corners of each cell."""
        centres = [self._corners(kind, nodes).mean(axis=1) for kind, nodes in self.cells]
        return np.concatenate([np.zeros((0, 3)), *centres])

    @cached_property
    def node_volumes(self) -> Float[np.ndarray, " nodes"]:
        """The volumes of the cells, each shared evenly by its nodes; 0 where no cell is."""
        volumes, start = np.zeros(len(self.points)), 0
        for _, nodes in self.cells:
            share = self.cell_volumes[start : start + len(nodes)] / nodes.shape[1]
            np.add.at(volumes, nodes, share[:, None])
            start += len(nodes)
        return volumes

    @property
    def longest_cell(self) -> float:
        """Largest distance of two corners of a cell; 0 without cells."""
        longest = 0.0
        for kind, nodes in self.cells:
            corners = self._corners(kind, nodes)
            for k in range(1, corners.shape[1]):
                away = np.linalg.norm(corners[:, k:] - corners[:, :-k], axis=-1)
                longest = max(longest, float(away.max(initial=0.0)))
        return longest

    def _corners(
        self, kind: str, nodes: Int[np.ndarray, "cells _"]
    ) -> Float[np.ndarray, "cells corners 3"]:
        return self.points[nodes[:, : CORNERS[_base(kind)][1]]]


def require_known(kinds: Iterable[str]) -> None:
    """Let only kinds of cells pass whose corners are known.

    Raises:
        FeaError: naming the others.
    """
    unknown = sorted({kind for kind in kinds if _base(kind) not in CORNERS})
    if unknown:
        raise FeaError(
            f"Cells of kind {', '.join(unknown)} are not understood, only {', '.join(CORNERS)}, also "
            "with nodes on their edges and faces; divide them into tetrahedra."
        )


def _base(kind: str) -> str:
    """The kind without its number of nodes, such as "tetra" of "tetra10"."""
    return kind.rstrip("0123456789")


def _measure(
    base: str, corners: Float[np.ndarray, "cells corners 3"]
) -> Float[np.ndarray, " cells"]:
    """Volume, area or length; of a vertex 1."""
    if base == "vertex":
        return np.ones(len(corners))
    if base == "line":
        return np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
    if base in ("triangle", "quad"):
        # Half the cross product of the diagonals; a triangle's second one is an edge.
        first, last = corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1]
        return np.linalg.norm(np.cross(first, last), axis=1) / 2
    # Tetrahedra from the centre to the triangles of a fan about each face's centre: an element may
    # be numbered from either side, so each counts by its size.
    centre, volume = corners.mean(axis=1), np.zeros(len(corners))
    for face in FACES[base]:
        around = corners[:, list(face)]
        middle = around.mean(axis=1) - centre
        for a, b in zip(range(len(face)), np.roll(range(len(face)), -1), strict=True):
            normal = np.cross(around[:, a] - centre, around[:, b] - centre)
            volume += np.abs(np.einsum("cd,cd->c", middle, normal)) / 6
    return volume
