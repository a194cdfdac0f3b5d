"""One unit cell as a structure, to be drawn."""

import numpy as np

from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.structure import Structure

# Thick enough to see how struts meet, thin enough to see through the cell.
RADIUS_SHARE = 0.04


def drawn_cell(
    cell: UnitCell, *, repeat: int = 1, edge_mm: float = 10.0, radius_mm: float | None = None
) -> Structure:
    """A cube of `repeat` cells along each axis, its lowest corner at the origin.

    Args:
        cell: the unit cell.
        repeat: cells along each axis.
        edge_mm: edge of one cell [mm].
        radius_mm: strut radius [mm]; None: 4 % of the edge.
    """
    ticks = np.arange(repeat + 1) * edge_mm
    nodes = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1)
    return map_structure(cell, nodes, RADIUS_SHARE * edge_mm if radius_mm is None else radius_mm)
