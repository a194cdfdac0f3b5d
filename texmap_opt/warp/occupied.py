"""How much of the part is in each cell of a grid."""

import numpy as np
from jaxtyping import Float

from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.warp.cell_volumes import cell_volumes
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.part_distance import PartDistance


def occupied_volume(grid: Grid, surface: TriMesh) -> Float[np.ndarray, " cells"]:
    """Volume of the part in each cell [mm³], from one distance a cell; 0 in cells inside out.

    As if the part were bounded in the cell by a plane along its faces: a share 1/2 - d / h of it is
    inside, d the signed distance of the centre and h the edge of the cube of the cell's volume,
    between none and all. In two dimensions cells reach through the box, d is the distance to the
    part's outline, and h the edge of the square.

    Args:
        grid: hexahedra.
        surface: of the part, closed [mm].
    """
    volume = np.maximum(cell_volumes(grid.nodes).reshape(-1), 0)
    size = volume ** (1 / grid.dimensions)
    if grid.dimensions == 2:
        volume = volume * np.ptp(grid.box.bounds[:, 2])
    distance = PartDistance(surface, grid.box)(grid.centres)
    share = 0.5 - np.divide(distance, size, out=np.zeros_like(size), where=size > 0)
    return volume * np.clip(share, 0.0, 1.0)
