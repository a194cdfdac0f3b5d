"""The stage between warp and sizing: the unit cell mapped into the warped grid, trimmed to the part."""

import numpy as np
from jaxtyping import Bool, Float

from texmap_opt.case import DesignCase
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.part import Part
from texmap_opt.region_reach import RegionReach
from texmap_opt.stress_field import StressField
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.trim import Trimmed, trim
from texmap_opt.warp.grid import Grid


def trimmed_lattice(
    case: DesignCase,
    part: Part,
    stress: StressField,
    cell: UnitCell,
    grid: Grid,
    *,
    radius_mm: float,
) -> Trimmed:
    """Fill a warped grid with a unit cell and keep what lies in the part.

    Args:
        case: skin, radius mode, section; regions that hold loose ends where there is no skin.
        part: what is filled.
        stress: analysis of the solid part; its mesh tells what regions select.
        cell: the unit cell.
        grid: the warped grid.
        radius_mm: strut radius before sizing.

    Raises:
        LatticeError: nothing is left, or it falls into pieces.
    """
    lattice = case.lattice
    net = map_structure(
        cell, grid.positions, radius_mm, radius_mode=lattice.radius_mode, section=lattice.section
    )
    thickest = float(net.radii.max())
    regions = [action.region for action in (*case.supports, *case.loads) if action.region]

    def in_region(points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        reach = RegionReach.of(points, part, case, stress, thickest)
        return np.any([reach.meets(region) for region in regions], axis=0)

    skin = lattice.skin_mm
    # Under a skin, supports and loads act on it alone.
    return trim(net, part, skin_mm=skin, in_region=None if skin > 0 else in_region)
