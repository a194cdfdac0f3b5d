"""How much of the part is in each cell of a grid."""

import itertools

import numpy as np
from jaxtyping import Float

from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.chords import chords
from texmap_opt.structure.map import multilinear
from texmap_opt.warp.cell_volumes import cell_volumes
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.part_distance import PartDistance

# Lines along the extrusion through each cell, along each of its two directions. An even number: none
# is in the middle, where symmetric grids meet the edges of the part's facets.
LINES = 4


def occupied_volume(grid: Grid, surface: TriMesh) -> Float[np.ndarray, " cells"]:
    """Volume of the part in each cell [mm³]; 0 in cells inside out.

    From one distance a cell, as if the part were bounded in the cell by a plane along its faces: a
    share 1/2 - d / h of it is inside, d the signed distance of the centre and h the edge of the cube
    of the cell's volume, between none and all. In two dimensions cells reach through the part, which
    is as deep as on the mean of some lines along the extrusion, evenly spread.

    Args:
        grid: hexahedra, or quadrilaterals.
        surface: of the part, closed [mm].
    """
    volume = np.maximum(cell_volumes(grid.nodes).reshape(-1), 0)
    if grid.dimensions == 2:
        return volume * _mean_depth(grid, surface)
    size = np.cbrt(volume)
    distance = PartDistance(surface, grid.box)(grid.centres)
    share = 0.5 - np.divide(distance, size, out=np.zeros_like(size), where=size > 0)
    return volume * np.clip(share, 0.0, 1.0)


def _mean_depth(grid: Grid, surface: TriMesh) -> Float[np.ndarray, " cells"]:
    """Length of lines through each cell that is in the part, on the mean [mm]."""
    along = (np.arange(LINES) + 0.5) / LINES
    local = np.array(list(itertools.product(along, repeat=2)))
    cells = np.stack(np.unravel_index(np.arange(grid.cell_count), grid.cells), axis=1)
    points = multilinear(
        grid.nodes, np.repeat(cells, len(local), axis=0), np.tile(local, (len(cells), 1))
    )
    length = chords(surface, grid.box.positions(points), grid.box.axes[2])
    length = length.reshape(-1, len(local))
    known = np.isfinite(length)
    return np.where(known, length, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
