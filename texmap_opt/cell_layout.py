"""The unit cells of a case, and which of them is in which cell of its grid."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from texmap_opt.case import DesignCase
from texmap_opt.case_zones import Zone
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.errors import CaseError, CellError
from texmap_opt.grid_plan import grid_axes
from texmap_opt.structure.layout import Layout
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.warped_grid import WarpedGrid

# Centres on the limit of a region belong to it: rounding, far below any cell [mm].
REGION_SLACK_MM = 1e-9


@dataclass(frozen=True, eq=False)
class CaseCells:
    """The unit cells of a case, each once, with the section asked for.

    Attributes:
        cells: that of `[lattice]`, then those of the zones.
        of_zone: which of them each zone has.
    """

    cells: tuple[UnitCell, ...]
    of_zone: tuple[int, ...]


def case_cells(case: DesignCase) -> CaseCells:
    """Read the unit cells of a case.

    Raises:
        CellError: a cell is unknown or malformed.
        CaseError: a zone's cell does not go with that of `[lattice]`.
    """
    cells, of_zone = [_read(case, case.lattice.cell)], []
    for zone in case.zones:
        try:
            # Layout knows which cells go together.
            other = _read(case, zone.cell)
            same = [k for k, cell in enumerate(cells) if _same(cell, other)]
            if not same:
                Layout((*cells, other), np.zeros((1,) * cells[0].dimensions, np.int64))
                same = [len(cells)]
                cells.append(other)
            of_zone += same
        except CellError as failure:
            raise CaseError(f'{zone.where} cell = "{zone.cell}": {failure}') from failure
    return CaseCells(tuple(cells), tuple(of_zone))


def cell_layout(case: DesignCase, cells: CaseCells, warp: WarpedGrid) -> Layout:
    """Which cell of a case is in which cell of its warped grid; where zones overlap the later one.

    A region is met in space: by the centre of the warped cell, in 2.5-D half way along the extrusion.

    Args:
        case: its zones.
        cells: see `case_cells`.
        warp: the warped grid and the warping function on it.

    Raises:
        CaseError: a zone that selects no cell with material in it.
    """
    kinds = np.zeros(warp.grid.cells, np.int64)
    for zone, kind in zip(case.zones, cells.of_zone, strict=True):
        chosen = _chosen(case, zone, warp.grid, warp.f)
        if not (chosen & (warp.occupied_mm3 > 0)).any():
            raise CaseError(f"{zone.where} {_missed(case, zone, warp)}")
        kinds.reshape(-1)[chosen] = kind
    return Layout(cells.cells, kinds)


def planned_layout(case: DesignCase, cells: CaseCells, grid: Grid) -> Layout:
    """The same before the warp, in its uniform grid; zones by f are not known yet and left out.

    Args:
        case: its zones.
        cells: see `case_cells`.
        grid: the uniform grid, margin included.
    """
    kinds = np.zeros(grid.cells, np.int64)
    for zone, kind in zip(case.zones, cells.of_zone, strict=True):
        if zone.f is None:
            kinds.reshape(-1)[_chosen(case, zone, grid, None)] = kind
    return Layout(cells.cells, kinds)


def require_zones_in_grid(case: DesignCase, grid: Grid) -> None:
    """Every block of grid cells that a zone names is there.

    Args:
        case: its zones.
        grid: the uniform grid, margin included.

    Raises:
        CaseError: a zone names cells that the grid does not have.
    """
    margin = case.warp.margin_cells
    for zone in case.zones:
        if zone.grid_cells is None:
            continue
        given = f"{zone.where} grid_cells = {zone.grid_cells.tolist()}"
        if zone.grid_cells.shape[1] != grid.dimensions:
            raise CaseError(f"{given}: needs {grid.dimensions} indices for each cell of this grid.")
        first, last = _block(case, zone.grid_cells, grid)
        if (first < 0).any() or (last >= np.array(grid.cells)).any():
            order = np.argsort(list(grid_axes(case, grid.box)))
            high = np.array(grid.cells)[order] - margin - 1
            raise CaseError(
                f"{given}: goes beyond the grid, whose cells are {[-margin] * len(high)} to "
                f"{high.tolist()} with margin_cells = {margin}; stay within."
            )


def _read(case: DesignCase, name: str) -> UnitCell:
    cell = unit_cell(name, base=case.directory)
    section = case.lattice.section
    return cell if section is None else replace(cell, section=section)


def _same(one: UnitCell, other: UnitCell) -> bool:
    """The same cell, by whatever name it was asked for."""
    return (
        (one.name, one.mirrored, one.proportions) == (other.name, other.mirrored, other.proportions)
        and np.array_equal(one.joints, other.joints)
        and np.array_equal(one.struts, other.struts)
        and np.array_equal(one.relative_radius, other.relative_radius)
    )


def _chosen(
    case: DesignCase, zone: Zone, grid: Grid, f: Float[np.ndarray, " cells"] | None
) -> Bool[np.ndarray, " cells"]:
    """Cells of a zone; f is needed by those that are chosen by it."""
    if zone.region is not None:
        centres = grid.box.positions(grid.centres)
        return zone.region.contains(centres, None, slack=REGION_SLACK_MM)
    if zone.f is not None and f is not None:
        return (f >= zone.f[0]) & (f <= zone.f[1])
    chosen = np.zeros(grid.cells, bool)
    if zone.grid_cells is not None:
        first, last = _block(case, zone.grid_cells, grid)
        chosen[tuple(slice(a, b + 1) for a, b in zip(first, last, strict=True))] = True
    return chosen.reshape(-1)


def _block(case: DesignCase, indices: Int[np.ndarray, "2 d"], grid: Grid) -> Int[np.ndarray, "2 d"]:
    """Indices of a zone, in the order of the grid's axes, margin counted."""
    names = grid_axes(case, grid.box)
    order = [sorted(names).index(name) for name in names]
    return indices[:, order] + case.warp.margin_cells


def _missed(case: DesignCase, zone: Zone, warp: WarpedGrid) -> str:
    """Why a zone selects nothing, and what to do."""
    inside = warp.occupied_mm3 > 0
    if zone.f is not None:
        f, (least, most) = warp.f[inside], zone.f
        limits = [f"f_least = {least:g}"] * (least > 0) + [f"f_most = {most:g}"] * (most < np.inf)
        return (
            f"{', '.join(limits)}: no cell in the part has such an f, which "
            f"runs from {f.min():.4g} to {f.max():.4g} there; choose limits in this range."
        )
    if zone.region is not None:
        return (
            f"region: the centre of no cell in the part lies in {zone.region.describe()}; enlarge or "
            "move it, or use smaller cells."
        )
    return (
        "grid_cells: none of these cells has part in it; count from 0 at the lower corner of the part's "
        "box."
    )
