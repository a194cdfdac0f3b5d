"""Which unit cell is in which cell of a grid."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int

from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.errors import CellError
from texmap_opt.structure.structure import TRANSITION


@dataclass(frozen=True, eq=False)
class Layout:
    """Which unit cell is in which cell of a grid.

    Attributes:
        cells: the unit cells, all of one number of dimensions and one section.
        kinds: index into `cells` of each cell of the grid.
    """

    cells: tuple[UnitCell, ...]
    kinds: Int[np.ndarray, "*shape"]

    def __post_init__(self) -> None:
        first, *others = self.cells
        for other in others:
            require_alike(first, other)
        names = [cell.name for cell in self.cells]
        for name in names:
            if names.count(name) > 1 or name == TRANSITION:
                raise CellError(
                    f'several kinds of cells in one part are named "{name}" ("{TRANSITION}" being that '
                    "of struts between kinds); give each unit cell a name of its own."
                )
        if self.kinds.ndim != first.dimensions:
            raise CellError(
                f'unit cell "{first.name}" has {first.dimensions} dimensions, but the grid has '
                f"{self.kinds.ndim}; take a cell or a grid of the other number."
            )

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of cells along each axis."""
        return self.kinds.shape

    @property
    def index(self) -> Int[np.ndarray, "cells d"]:
        """Index along each axis of each cell, in C order."""
        return np.stack(np.unravel_index(np.arange(self.kinds.size), self.shape), axis=1)

    @property
    def reflected(self) -> Bool[np.ndarray, "cells d"]:
        """Whether each cell, in C order, is reflected along each axis, by its own tiling rule."""
        mirrored = np.array([cell.mirrored for cell in self.cells])
        return (self.index % 2 == 1) & mirrored[self.kinds.ravel()]


def require_alike(one: UnitCell, other: UnitCell) -> None:
    """Two cells can be in one part.

    Raises:
        CellError: they differ in the number of dimensions or in the section of their struts.
    """
    if one.dimensions != other.dimensions:
        raise CellError(
            f'unit cell "{other.name}" has {other.dimensions} dimensions and "{one.name}" has '
            f"{one.dimensions}; all cells of a part must have as many: choose another."
        )
    if one.section != other.section:
        raise CellError(
            f'unit cell "{other.name}" has {other.section} struts and "{one.name}" {one.section} ones; '
            "all cells of a part must have the same section: give [lattice] section."
        )
