"""What a run leaves: every value that travelled between the stages."""

from dataclasses import dataclass

from texmap_opt.case import DesignCase
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.combine.part_with_lattice import Result as CombinedResult
from texmap_opt.export.solid_file import Solid
from texmap_opt.filling import Filling
from texmap_opt.part import Part
from texmap_opt.solid.printability import Printability
from texmap_opt.solid.validity import ValidityReport
from texmap_opt.stress_field import StressField
from texmap_opt.structure.interface import Interface
from texmap_opt.structure.layout import Layout
from texmap_opt.structure.trim import Trimmed
from texmap_opt.unreached import Unreached
from texmap_opt.warp.warped_grid import WarpedGrid


@dataclass(frozen=True, eq=False)
class Run:
    """Every value that travelled between the stages, and the report.

    Attributes:
        case: what was asked.
        part: the surface that was filled.
        stress: analysis of the solid part.
        warp: the warped grid.
        cell: the unit cell of `[lattice]`.
        layout: which unit cell is in which cell of the grid.
        interfaces: how unit cells of different kinds were joined.
        trimmed: the lattice in the part before sizing.
        unreached: what of the part it does not reach.
        filling: the sized structure and the lattice solid.
        combined: part and lattice joined.
        solid: the result as it is printed; `solid.save("part.stl")` writes it.
        validity: what was checked on it.
        printability: what was measured on it.
        report: the numbers of report.json.
    """

    case: DesignCase
    part: Part
    stress: StressField
    warp: WarpedGrid
    cell: UnitCell
    layout: Layout
    interfaces: tuple[Interface, ...]
    trimmed: Trimmed
    unreached: Unreached
    filling: Filling
    combined: CombinedResult
    solid: Solid
    validity: ValidityReport
    printability: Printability | None
    report: dict
