"""Relative density of an endless lattice, with what its struts share at joints counted once."""

import numpy as np
from jaxtyping import Bool, Float

from texmap_opt.cells.unit_cell import TICKS, UnitCell
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.volume import SUBDIVISIONS, LatticeVolume


def periodic_density(cell: UnitCell, radius: float, *, subdivisions: int = SUBDIVISIONS) -> float:
    """Overlap-corrected volume of one cell inside the lattice, over that of its cube.

    Args:
        cell: the unit cell.
        radius: of struts of relative radius 1, in cell edges.
        subdivisions: of the quadrature; see `texmap_opt.structure.volume`.
    """
    # What lies around the inner cells (an even number where they are mirrored) is as in the endless
    # lattice; of joints and half struts on their faces, those on the lower ones count.
    inner = 2 if cell.tiling == "mirror" else 1
    ticks = np.arange(inner + 3.0)
    block = map_structure(
        cell, np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1), radius
    )
    touching = _inside(block.joints, inner)[block.struts].any(axis=1)
    block = block.select(np.asarray(touching))
    inside = _inside(block.joints, inner)
    measure = LatticeVolume.of(block, subdivisions=subdivisions, seen=inside)
    area = np.pi * measure.as_round(block.radii)[:, 0] ** 2
    own = float(np.sum(area * block.lengths() * inside[block.struts].mean(axis=1)))
    return (own - float(measure.overlap(block.joints, block.radii))) / inner**3


def _inside(joints: Float[np.ndarray, "joints 3"], inner: int) -> Bool[np.ndarray, " joints"]:
    """Joints of the inner cells, which begin after the first; without those on upper faces."""
    # Half a tick: positions are compared as exactly as joints are welded.
    low = 1 - 0.5 / TICKS
    return np.asarray(((joints >= low) & (joints < low + inner)).all(axis=1))
