"""Unit cells as structures without a part: to be drawn, and measured."""

import numpy as np

from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.net import Net
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.tile import tile

# Thick enough to see how struts meet, thin enough to see through the cell.
RADIUS_SHARE = 0.04


def drawn_cell(
    cell: UnitCell, *, repeat: int = 1, edge_mm: float = 10.0, radius_mm: float | None = None
) -> Structure:
    """A block of `repeat` cells along each axis, its lowest corner at the origin.

    Cells of a cross-section are extruded by one edge.

    Args:
        cell: the unit cell, drawn in its undistorted proportions.
        repeat: cells along each axis.
        edge_mm: edge of one cell along its first axis [mm].
        radius_mm: strut radius [mm]; None: 4 % of the edge.
    """
    radius = RADIUS_SHARE * edge_mm if radius_mm is None else radius_mm
    return drawn_net(cell, tile(cell, (repeat,) * cell.dimensions), radius, edge_mm=edge_mm)


def drawn_net(cell: UnitCell, net: Net, radius_mm: float, *, edge_mm: float = 1.0) -> Structure:
    """A net of a cell in its undistorted proportions; extruded by one edge if it is a cross-section.

    Args:
        cell: the unit cell.
        net: copies of it.
        radius_mm: strut radius [mm].
        edge_mm: edge of one cell along its first axis [mm].
    """
    edges = edge_mm * np.array(cell.proportions)
    ticks = [np.arange(n + 1) * edge for n, edge in zip(net.shape, edges, strict=True)]
    nodes = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1)
    if cell.dimensions == 3:
        return map_structure(net, nodes, radius_mm)
    # The plane of the joints lies half way up the walls.
    nodes = np.concatenate([nodes, np.full((*nodes.shape[:-1], 1), edge_mm / 2)], axis=-1)
    flat = map_structure(net, nodes, radius_mm)
    return flat.extruded(np.array([0.0, 0.0, 1.0]), np.array([0.0, edge_mm]))
