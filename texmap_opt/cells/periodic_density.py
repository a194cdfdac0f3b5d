"""Relative density of an endless lattice, with what its struts share at joints counted once."""

import numpy as np
from jaxtyping import Bool, Float, Int

from texmap_opt.cells.drawn_cell import drawn_net
from texmap_opt.cells.unit_cell import TICKS, UnitCell
from texmap_opt.structure.tile import tile
from texmap_opt.structure.volume import SUBDIVISIONS, LatticeVolume


def periodic_density(cell: UnitCell, radius: float, *, subdivisions: int = SUBDIVISIONS) -> float:
    """Overlap-corrected volume of one cell inside the lattice, over that of the undistorted cell.

    Args:
        cell: the unit cell.
        radius: of struts of relative radius 1, in edges of the cell along its first axis.
        subdivisions: of the quadrature; see `texmap_opt.structure.volume`.
    """
    # What lies around the inner cells (an even number where they are mirrored) is as in the endless
    # lattice; of joints and half struts on their faces, those on the lower ones count.
    inner = np.array(cell.period)
    net = tile(cell, tuple(int(n) for n in inner + 3))
    block = drawn_net(cell, net, radius)
    first, last = (_inside(net.joints, inner)[net.struts[:, end]] for end in (0, 1))
    block, kept = block.select(first | last), (first | last)
    inside = np.zeros(len(block.joints), bool)
    inside[block.struts[:, 0]] = first[kept]
    inside[block.struts[:, 1]] = last[kept]
    measure = LatticeVolume.of(block, subdivisions=subdivisions, seen=inside)
    share = inside[block.struts].mean(axis=1)
    whole = float(np.prod(inner * np.array(cell.proportions)))
    return measure.host_volume(block.joints, block.radii, share=share) / whole


def _inside(
    joints: Float[np.ndarray, "joints d"], inner: Int[np.ndarray, " d"]
) -> Bool[np.ndarray, " joints"]:
    """Joints of the inner cells, which begin after the first; without those on upper faces."""
    # Half a tick: positions are compared as exactly as joints are welded.
    low = 1 - 0.5 / TICKS
    return np.asarray(((joints >= low) & (joints < low + inner)).all(axis=1))
