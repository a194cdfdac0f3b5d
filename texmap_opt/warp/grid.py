"""The grid that is warped: hexahedra, or quadrilaterals for cells that are extruded."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from texmap_opt.box import Box
from texmap_opt.errors import WarpError


@dataclass(frozen=True, eq=False)
class Grid:
    """A block of cells; each becomes one unit cell of the lattice.

    Attributes:
        nodes: coordinates along the axes of the box [mm], `d` of them; node (i, j, k) is the i-th
            along the first axis, j-th along the second, k-th along the third if there is one.
        box: the block; outer nodes stay on its faces.
        fixed: lower and upper face along each axis whose nodes do not move at all; those of the
            others slide in their face. None: all slide.
    """

    nodes: Float[np.ndarray, "*nodes d"]
    box: Box
    fixed: Bool[np.ndarray, "2 d"] | None = None

    @classmethod
    def uniform(
        cls, box: Box, cells: tuple[int, ...], *, fixed: Bool[np.ndarray, "2 d"] | None = None
    ) -> "Grid":
        """The box divided evenly.

        Args:
            box: the block.
            cells: number of cells along each axis.
            fixed: see the attribute.

        Raises:
            WarpError: if an edge of the box or a number of cells is not positive.
        """
        if len(cells) != box.dimensions or min(cells) < 1 or not np.all(box.extent > 0):
            raise WarpError(
                f"A grid of {' x '.join(map(str, cells))} cells over "
                f"{' x '.join(f'{length:g}' for length in box.extent)} mm is impossible: each count "
                "must be at least 1 and each edge positive; use thinner struts or other counts."
            )
        axes = [
            np.linspace(low, high, n + 1)
            for low, high, n in zip(box.low, box.high, cells, strict=True)
        ]
        return cls(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1), box, fixed)

    @classmethod
    def around(
        cls,
        part: Box,
        cells: tuple[int, ...],
        *,
        margin_cells: int,
        radius_mm: float,
        fixed: Bool[np.ndarray, "2 d"] | None = None,
    ) -> "Grid":
        """The uniform grid for a part: `cells` over the box of the part, and a margin around it.

        Cells at a fixed face cannot turn, so a margin gives the part's own cells their freedom.
        Without one the box is shrunk by the strut radius: struts on its faces stay whole.

        Args:
            part: the smallest box around the part.
            cells: number of cells over it along each axis.
            margin_cells: number of cells added on each side.
            radius_mm: largest strut radius [mm]; used without margin.
            fixed: see the attribute.

        Raises:
            WarpError: if nothing is left of the box.
        """
        if margin_cells == 0:
            return cls.uniform(part.grown(np.full(part.dimensions, -radius_mm)), cells, fixed=fixed)
        margin = margin_cells * part.extent / np.array(cells)
        more = tuple(n + 2 * margin_cells for n in cells)
        return cls.uniform(part.grown(margin), more, fixed=fixed)

    def with_nodes(self, nodes: Float[np.ndarray, "*nodes d"]) -> "Grid":
        """The same block with its nodes elsewhere [mm]."""
        return replace(self, nodes=nodes)

    @property
    def at_rest(self) -> "Grid":
        """The uniform grid with as many cells over the same box."""
        return Grid.uniform(self.box, self.cells, fixed=self.fixed)

    @cached_property
    def free(self) -> Bool[np.ndarray, " d *nodes"]:
        """Where a node may move, component first: not off a face of the box, not on a fixed one."""
        free = np.ones((self.dimensions, *self.nodes.shape[:-1]), dtype=bool)
        for axis in range(self.dimensions):
            for side, end in enumerate((0, -1)):
                on_face = (*[slice(None)] * axis, end)
                free[(axis, *on_face)] = False
                if self.fixed is not None and self.fixed[side, axis]:
                    free[(slice(None), *on_face)] = False
        return free

    @property
    def dimensions(self) -> int:
        """3, or 2 for cells that are extruded."""
        return self.box.dimensions

    @property
    def positions(self) -> Float[np.ndarray, "*nodes 3"]:
        """Nodes in space [mm]."""
        return self.box.positions(self.nodes)

    @property
    def cells(self) -> tuple[int, ...]:
        """Number of cells along each axis."""
        return tuple(n - 1 for n in self.nodes.shape[:-1])

    @property
    def cell_count(self) -> int:
        """Number of cells."""
        return math.prod(self.cells)

    @property
    def uniform_edge(self) -> Float[np.ndarray, " d"]:
        """Edges of a cell of the uniform grid [mm]."""
        return self.box.extent / np.array(self.cells)

    @cached_property
    def corners(self) -> Int[np.ndarray, "cells corners"]:
        """Flat node numbers of each cell in VTK's order of the corners of a hexahedron or quad."""
        number = np.arange(self.nodes[..., 0].size).reshape(self.nodes.shape[:-1])
        lower, upper = slice(None, -1), slice(1, None)
        around = [(lower, lower), (upper, lower), (upper, upper), (lower, upper)]
        layers = [()] if self.dimensions == 2 else [(lower,), (upper,)]
        return np.stack([number[xy + z].ravel() for z in layers for xy in around], axis=1)

    @cached_property
    def centres(self) -> Float[np.ndarray, "cells d"]:
        """Mean of the corners of each cell, coordinates [mm]."""
        return self.nodes.reshape(-1, self.dimensions)[self.corners].mean(axis=1)
