"""How many cells a case asks for, and the uniform grid they start from."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from texmap_opt.box import Box
from texmap_opt.case import DesignCase
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.errors import CaseError
from texmap_opt.part_box import USUAL_EXTRUSION
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.tile import tile
from texmap_opt.warp.grid import Grid

# A grid above this many cells holds more struts than the program has been tried with.
MOST_CELLS = 200_000
# Struts thinner than this are below the spot of a laser and the nozzle of an extruder [mm].
LEAST_PRINTABLE_RADIUS_MM = 0.05
# A radius above this share of the cell's shortest edge leaves no opening in any cell of the library.
FILLED_SHARE = 0.5
# Area of a strut's section is the radius to this power, times this: a circle; in two dimensions the
# thickness of a wall.
SECTION_AREA = {2: (1, 2.0), 3: (2, math.pi)}


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
        box: the smallest around the part, along the axes of the case, of the cell's dimensions.
        cell: the unit cell; its strut length turns a density into a radius.

    Raises:
        CaseError: cells larger than the part, too many or too few of them, a radius that fills the
            cells or is too thin to print, or keys that do not fit the cell's dimensions.
    """
    file, lattice = case.path.name, case.lattice
    if cell.dimensions == 2 and lattice.section is not None:
        raise CaseError(
            f'{file}: [lattice] section = "{lattice.section}": the struts of the 2.5-D cell '
            f'"{cell.name}" become walls; remove the key.'
        )
    extent = box.extent
    cells = _cells(case, box, cell)
    edges = extent / np.array(cells)
    shortest = float(edges.min())
    radius = lattice.radius_mm
    if radius is not None:
        _check_radius(f"{file}: [lattice] radius_mm = {radius:g}", radius, shortest)
    else:
        density = lattice.relative_density or 0.0
        power, area = SECTION_AREA[cell.dimensions]
        radius = (density / (area * _length_density(cell, edges))) ** (1 / power)
        where = f"{file}: [lattice] relative_density = {density:g}"
        _check_radius(where, radius, shortest, density=density, power=power)
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
        fixed=_fixed(case, box),
    )
    return GridPlan(grid, radius)


def grid_axes(case: DesignCase, box: Box) -> str:
    """Names of the axes along which a grid has cells, in the order of the grid."""
    if box.dimensions == 3:
        return "xyz"
    # As `Box.around` turns them.
    after = "xyz".index(case.lattice.extrusion or USUAL_EXTRUSION) + 1
    return ("xyz" * 2)[after : after + 2]


def _cells(case: DesignCase, box: Box, cell: UnitCell) -> tuple[int, ...]:
    """Number of cells over the part along each axis of its box."""
    file, lattice, margin = case.path.name, case.lattice, case.warp.margin_cells
    names, extent = grid_axes(case, box), box.extent
    if lattice.cells is not None:
        cells = _in_grid_order(case, lattice.cells, names, cell)
    else:
        edge = lattice.cell_mm or math.inf
        edges = edge * np.array(cell.proportions) / cell.proportions[0]
        if (edges > extent).any():
            spans = " x ".join(f"{length:.4g}" for length in extent)
            raise CaseError(
                f"{file}: [lattice] cell_mm = {edge:g}: is larger than the part, which spans "
                f"{spans} mm along {', '.join(names)}; give at most "
                f"{(extent / edges).min() * edge / 2:.3g}, or check [part] unit."
            )
        cells = tuple(max(1, round(float(n))) for n in extent / edges)
    shown = f"{' x '.join(map(str, cells))} cells"
    count = math.prod(n + 2 * margin for n in cells)
    if count > MOST_CELLS:
        raise CaseError(
            f"{file}: [lattice]: {shown} are {count:,} with their margin; at most {MOST_CELLS:,} are "
            "possible: use larger cells, or check [part] unit."
        )
    if case.warp.method != "uniform" and min(cells) + 2 * margin < 2:
        raise CaseError(
            f'{file}: [warp] method = "{case.warp.method}": has nothing to move along '
            f"{names[cells.index(min(cells))]}, where {shown} have one only; give [lattice] cells at "
            'least 2, [warp] margin_cells = 1, or the method "uniform".'
        )
    return cells


def _in_grid_order(
    case: DesignCase, cells: tuple[int, ...], names: str, cell: UnitCell
) -> tuple[int, ...]:
    """`[lattice] cells`, which are in alphabetical order of the axes, in that of the grid."""
    if len(cells) != len(names):
        along = " and ".join(sorted(names))
        raise CaseError(
            f'{case.path.name}: [lattice] cells = {list(cells)}: the unit cell "{cell.name}" has '
            f"{cell.dimensions} dimensions; give {len(names)} numbers, along {along}."
        )
    return tuple(cells[sorted(names).index(name)] for name in names)


def _length_density(cell: UnitCell, edges: Float[np.ndarray, " d"]) -> float:
    """Strut length per volume, or wall length per area, of an endless uniform lattice [mm^(1 - d)].

    It is a block's growth by one cell.
    """
    d = cell.dimensions
    lengths = []
    for n in range(1, d + 1):
        bounds = np.zeros((2, 3))
        bounds[1, :d] = n * edges
        shape = (n,) * d
        block = Grid.uniform(Box(np.eye(3), bounds, d), shape)
        net = map_structure(tile(cell, shape), block.positions, 1.0)
        lengths.append(float(net.lengths().sum()))
    # n cells an axis hold a n³ + b n² + c n: inside, on faces, on edges; the third difference is 6 a.
    # In two dimensions they hold a n² + b n, and the second difference is 2 a.
    if d == 3:
        inside = (lengths[2] - 3 * lengths[1] + 3 * lengths[0]) / 6
    else:
        inside = (lengths[1] - 2 * lengths[0]) / 2
    return inside / float(np.prod(edges))


def _check_radius(
    where: str, radius: float, shortest: float, *, density: float = 0.0, power: int = 2
) -> None:
    """Refuse a radius that no printer makes or that leaves no opening.

    Args:
        where: file, key and value for messages.
        radius: [mm].
        shortest: shortest edge of a cell [mm].
        density: the value of the key, where that is a density and not the radius itself.
        power: of the radius that it goes with.
    """
    least, most = LEAST_PRINTABLE_RADIUS_MM, FILLED_SHARE * shortest
    means = f" means a radius of {radius:.3g} mm, which" if density else ""
    low, high = (f"{density * (r / radius) ** power if density else r:.2g}" for r in (least, most))
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


def _fixed(case: DesignCase, box: Box) -> Bool[np.ndarray, "2 d"]:
    """Lower and upper face along each axis of the grid: whether its nodes stay."""
    faces, names = case.warp.fixed_faces, grid_axes(case, box)
    for face in faces:
        if face[1] not in names:
            raise CaseError(
                f'{case.path.name}: [warp] fixed_faces: "{face}" is an end of the extrusion, along '
                "which nothing moves anyway; remove it."
            )
    return np.array([[sign + axis in faces for axis in names] for sign in "-+"])
