"""The stage between warp and sizing: unit cells mapped into the warped grid, trimmed to the part."""

import numpy as np
from jaxtyping import Bool, Float

from texmap_opt.case import DesignCase
from texmap_opt.part import Part
from texmap_opt.region_reach import RegionReach
from texmap_opt.stress_field import StressField
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.net import Net
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.trim import Trimmed, trim
from texmap_opt.warp.grid import Grid

# Walls reach this far beyond the part on both sides, over its extent along the extrusion: no face of
# theirs then lies in one of the part's.
OVERHANG = 0.01


def trimmed_lattice(
    case: DesignCase,
    part: Part,
    stress: StressField,
    net: Net,
    grid: Grid,
    *,
    radius_mm: float,
) -> Trimmed:
    """Fill a warped grid with unit cells and keep what lies in the part.

    Args:
        case: skin, radius mode, section; regions that hold loose ends where there is no skin.
        part: what is filled.
        stress: analysis of the solid part; its mesh tells what regions select.
        net: of unit cells, one in each cell of the grid.
        grid: the warped grid.
        radius_mm: strut radius before sizing.

    Raises:
        LatticeError: nothing is left, or it falls into pieces.
    """
    lattice = case.lattice
    uncut = uncut_lattice(case, net, grid, radius_mm=radius_mm)
    thickest = float(uncut.radii.max())
    regions = [action.region for action in (*case.supports, *case.loads) if action.region]

    def in_region(points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        reach = RegionReach.of(points, part, case, stress, thickest, walls=uncut.extrusion)
        return np.any([reach.meets(region) for region in regions], axis=0)

    skin = lattice.skin_mm
    # Under a skin, supports and loads act on it alone.
    return trim(
        uncut,
        part,
        skin_mm=skin,
        in_region=None if skin > 0 else in_region,
        sliver_mm=lattice.sliver_share * float(grid.uniform_edge.mean()),
    )


def uncut_lattice(case: DesignCase, net: Net, grid: Grid, *, radius_mm: float) -> Structure:
    """A grid filled with unit cells, its margin as well; in two dimensions the walls of the box.

    Args:
        case: radius mode, section.
        net: of unit cells, one in each cell of the grid.
        grid: the grid, warped or not.
        radius_mm: strut radius before sizing.
    """
    lattice = case.lattice
    structure = map_structure(
        net,
        grid.positions,
        radius_mm,
        radius_mode=lattice.radius_mode,
        section=lattice.section,
    )
    if grid.dimensions == 3:
        return structure
    low, high = grid.box.bounds[:, 2]
    beyond = OVERHANG * (high - low)
    return structure.extruded(grid.box.axes[2], np.array([low - beyond, high + beyond]))
