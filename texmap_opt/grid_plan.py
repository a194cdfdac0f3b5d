"""How many cells a case asks for, and the uniform grid they start from."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from texmap_opt.box import Box
from texmap_opt.case import DesignCase
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.errors import CaseError
from texmap_opt.structure.map import map_structure
from texmap_opt.warp.grid import Grid

# A grid above this many cells holds more struts than the program has been tried with.
MOST_CELLS = 200_000
# Struts thinner than this are below the spot of a laser and the nozzle of an extruder [mm].
LEAST_PRINTABLE_RADIUS_MM = 0.05
# A radius above this share of the cell's shortest edge leaves no opening in any cell of the library.
FILLED_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class GridPlan:
    """What the lattice starts from.

    Attributes:
        grid: the uniform grid.
        radius_mm: strut radius before sizing: the case's, or that of its relative density when
            overlaps at joints are left out of account.
    """

    grid: Grid
    radius_mm: float


def plan_grid(case: DesignCase, box: Box, cell: UnitCell) -> GridPlan:
    """The uniform grid of a case around a part.

    Args:
        case: gives `cells` or `cell_mm`, the margin and the radius.
        box: the smallest around the part, along the axes of the case.
        cell: the unit cell; its strut length turns a density into a radius.

    Raises:
        CaseError: cells larger than the part, too many cells, or a radius that fills the cells or
            is too thin to print.
    """
    file, lattice = case.path.name, case.lattice
    extent = box.extent
    cells = _cells(case, extent)
    shortest = float((extent / np.array(cells)).min())
    radius = lattice.radius_mm
    if radius is not None:
        _check_radius(f"{file}: [lattice] radius_mm = {radius:g}", radius, shortest)
    else:
        density = lattice.relative_density or 0.0
        radius = math.sqrt(density / (math.pi * _length_density(cell, extent / np.array(cells))))
        where = f"{file}: [lattice] relative_density = {density:g}"
        _check_radius(where, radius, shortest, density=density)
    for name in ("min_radius_mm", "max_radius_mm"):
        bound = getattr(case.sizing, name)
        if bound is not None:
            _check_radius(f"{file}: [sizing] {name} = {bound:g}", bound, shortest)
    if case.warp.margin_cells == 0 and 2 * radius >= extent.min():
        raise CaseError(
            f"{file}: [lattice] radius_mm = {radius:g}: the part is only {extent.min():.3g} mm thick; "
            "give a smaller radius."
        )
    grid = Grid.around(
        box,
        cells,
        margin_cells=case.warp.margin_cells,
        radius_mm=radius,
        fixed=_fixed(case.warp.fixed_faces),
    )
    return GridPlan(grid, radius)


def _cells(case: DesignCase, extent: Float[np.ndarray, " 3"]) -> tuple[int, int, int]:
    """Number of cells over the part along each axis of its box."""
    file, lattice, margin = case.path.name, case.lattice, case.warp.margin_cells
    if lattice.cells is not None:
        cells = lattice.cells
    else:
        edge = lattice.cell_mm or math.inf
        if edge > extent.min():
            raise CaseError(
                f"{file}: [lattice] cell_mm = {edge:g}: is larger than the part, which spans "
                f"{extent[0]:.4g} x {extent[1]:.4g} x {extent[2]:.4g} mm; give at most "
                f"{extent.min() / 2:.3g}, or check [part] unit."
            )
        x, y, z = (max(1, round(float(length) / edge)) for length in extent)
        cells = (x, y, z)
    shown = f"{cells[0]} x {cells[1]} x {cells[2]} cells"
    count = math.prod(n + 2 * margin for n in cells)
    if count > MOST_CELLS:
        raise CaseError(
            f"{file}: [lattice]: {shown} are {count:,} with their margin; at most {MOST_CELLS:,} are "
            "possible: use larger cells, or check [part] unit."
        )
    if case.warp.method != "uniform" and min(cells) + 2 * margin < 2:
        raise CaseError(
            f'{file}: [warp] method = "{case.warp.method}": has nothing to move along '
            f"{'xyz'[cells.index(min(cells))]}, where {shown} have one only; give [lattice] cells at "
            'least 2, [warp] margin_cells = 1, or the method "uniform".'
        )
    return cells


def _length_density(cell: UnitCell, edges: Float[np.ndarray, " 3"]) -> float:
    """Strut length per volume of an endless uniform lattice [1/mm²]: a block's growth by one cell."""
    lengths = []
    for n in (1, 2, 3):
        block = Grid.uniform(Box.aligned(np.stack([np.zeros(3), n * edges])), (n, n, n))
        lengths.append(float(map_structure(cell, block.positions, 1.0).lengths().sum()))
    # n cells an axis hold a n³ + b n² + c n: inside, on faces, on edges; the third difference is 6 a.
    inside = (lengths[2] - 3 * lengths[1] + 3 * lengths[0]) / 6
    return inside / float(np.prod(edges))


def _check_radius(where: str, radius: float, shortest: float, *, density: float = 0.0) -> None:
    """Refuse a radius that no printer makes or that leaves no opening.

    Args:
        where: file, key and value for messages.
        radius: [mm].
        shortest: shortest edge of a cell [mm].
        density: the value of the key, where that is a density and not the radius itself.
    """
    least, most = LEAST_PRINTABLE_RADIUS_MM, FILLED_SHARE * shortest
    means = f" means a radius of {radius:.3g} mm, which" if density else ""
    # A density goes with the square of the radius.
    low, high = (f"{density * (r / radius) ** 2 if density else r:.2g}" for r in (least, most))
    if radius < least:
        raise CaseError(
            f"{where}:{means} does not print: struts need a radius of {least:g} mm; give at least "
            f"{low}, or use larger cells."
        )
    if radius >= most:
        raise CaseError(
            f"{where}:{means} fills the cells, whose shortest edge is {shortest:.4g} mm; give less "
            f"than {high}, or use larger cells."
        )


def _fixed(faces: tuple[str, ...]) -> Bool[np.ndarray, "2 3"]:
    """Lower and upper face along each axis: whether its nodes stay."""
    return np.array([[sign + axis in faces for axis in "xyz"] for sign in "-+"])
