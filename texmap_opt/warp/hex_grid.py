"""The grid of hexahedra that is warped."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.errors import WarpError


@dataclass(frozen=True, eq=False)
class HexGrid:
    """A block of hexahedral cells; each becomes one unit cell of the lattice.

    Attributes:
        nodes: positions [mm]; node (i, j, k) is the i-th along x, j-th along y, k-th along z.
        box: lowest and highest corner of the block [mm]; the outer nodes stay on its faces.
    """

    nodes: Float[np.ndarray, "*nodes 3"]
    box: Float[np.ndarray, "2 3"]

    @classmethod
    def uniform(cls, box: Float[np.ndarray, "2 3"], cells: tuple[int, int, int]) -> "HexGrid":
        """The block divided evenly.

        Raises:
            WarpError: if an edge of the box or a number of cells is not positive.
        """
        extent = box[1] - box[0]
        if min(cells) < 1 or not np.all(extent > 0):
            raise WarpError(
                f"A grid of {cells[0]} x {cells[1]} x {cells[2]} cells over "
                f"{extent[0]:g} x {extent[1]:g} x {extent[2]:g} mm is impossible: each count must "
                "be at least 1 and each edge positive; use thinner struts or other counts."
            )
        axes = [np.linspace(box[0, d], box[1, d], cells[d] + 1) for d in range(3)]
        return cls(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1), box)

    @classmethod
    def around(
        cls,
        bounds: Float[np.ndarray, "2 3"],
        cells: tuple[int, int, int],
        *,
        margin_cells: int,
        radius_mm: float,
    ) -> "HexGrid":
        """The uniform grid for a part: `cells` over its bounding box, and a margin around it.

        Cells at a fixed face cannot turn, so a margin gives the part's own cells their freedom.
        Without one the box is shrunk by the strut radius: struts on its faces stay whole.

        Args:
            bounds: lowest and highest corner of the part [mm].
            cells: number of cells over the bounding box along x, y, z.
            margin_cells: number of cells added on each side.
            radius_mm: largest strut radius [mm]; used without margin.

        Raises:
            WarpError: if nothing is left of the box.
        """
        if margin_cells == 0:
            return cls.uniform(bounds + radius_mm * np.array([[1.0], [-1.0]]), cells)
        margin = margin_cells * (bounds[1] - bounds[0]) / np.array(cells)
        x, y, z = (n + 2 * margin_cells for n in cells)
        return cls.uniform(np.stack([bounds[0] - margin, bounds[1] + margin]), (x, y, z))

    def with_nodes(self, nodes: Float[np.ndarray, "*nodes 3"]) -> "HexGrid":
        """The same block with its nodes elsewhere [mm]."""
        return replace(self, nodes=nodes)

    @property
    def cells(self) -> tuple[int, int, int]:
        """Number of cells along x, y, z."""
        x, y, z = self.nodes.shape[:3]
        return x - 1, y - 1, z - 1

    @property
    def cell_count(self) -> int:
        """Number of cells."""
        return int(np.prod(self.cells))

    @property
    def uniform_edge(self) -> Float[np.ndarray, " 3"]:
        """Edges of a cell of the uniform grid [mm]."""
        return (self.box[1] - self.box[0]) / np.array(self.cells)

    @cached_property
    def hexes(self) -> Int[np.ndarray, "cells 8"]:
        """Flat node numbers of each cell in VTK's order of corners."""
        number = np.arange(self.nodes[..., 0].size).reshape(self.nodes.shape[:3])
        lower, upper = slice(None, -1), slice(1, None)
        bottom = [(lower, lower), (upper, lower), (upper, upper), (lower, upper)]
        corners = [number[x, y, z].ravel() for z in (lower, upper) for x, y in bottom]
        return np.stack(corners, axis=1)

    @cached_property
    def centres(self) -> Float[np.ndarray, "cells 3"]:
        """Mean of the eight corners of each cell [mm]."""
        return self.nodes.reshape(-1, 3)[self.hexes].mean(axis=1)
