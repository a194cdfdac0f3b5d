"""Volumes of the cells of a grid.

NumPy or JAX arrays in, the same kind out; JAX differentiates them in the nodes.
"""

import numpy as np
from jaxtyping import Float

from texmap_opt.warp.cell_corners import Kind, corners


def cell_volumes(nodes: Float[Kind, "*nodes d"]) -> Float[Kind, "*cells"]:
    """Volume of each cell [mm³], or its area in two dimensions [mm²]; negative when inside out.

    Exact for the multilinear map: faces are bilinear, so neighbours fill the box without gaps.

    Source: Grandy, "Efficient computation of volume of hexahedral cells", Lawrence Livermore
    National Laboratory, UCRL-ID-128886 (1997): twelve times the volume is the sum of three
    determinants, each of one diagonal of the cell and of diagonals of its faces.

    Args:
        nodes: of the grid [mm]; two grid directions or three.
    """
    d = nodes.shape[-1]
    corner = corners(nodes, d)
    if d == 2:
        a, b = corner[1, 1] - corner[0, 0], corner[0, 1] - corner[1, 0]
        return (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]) / 2
    # Across the cell's faces and its body, from the names of the axes they run along.
    x, y, z = (corner[s] - corner[0, 0, 0] for s in ((1, 1, 0), (1, 0, 1), (0, 1, 1)))
    u, v, w = (corner[1, 1, 1] - corner[s] for s in ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    return (_triple(u + z, v, x) + _triple(z, v + y, w) + _triple(u, y, w + x)) / 12


def equivalent_edges(nodes: Float[np.ndarray, "*nodes d"]) -> Float[np.ndarray, "*cells"]:
    """Edge of the cube, or square, with each cell's volume [mm]; NaN where it is inside out."""
    volume = cell_volumes(nodes)
    return np.where(volume > 0, np.abs(volume), np.nan) ** (1 / nodes.shape[-1])


def _triple(a: Float[Kind, "*cells 3"], b: Float[Kind, "*cells 3"], c: Float[Kind, "*cells 3"]):
    """The determinant of three vectors."""
    xp = a.__array_namespace__()
    return (a * xp.cross(b, c)).sum(axis=-1)
