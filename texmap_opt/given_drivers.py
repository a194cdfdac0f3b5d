"""Drivers of the warp that the case gives: painted regions and results of another program."""

import json
from dataclasses import dataclass

from texmap_opt.case import DesignCase
from texmap_opt.case_sections import STRESS_DRIVERS, ImportedSection
from texmap_opt.errors import CaseError
from texmap_opt.warp.background import Background
from texmap_opt.warp.grid import Grid
from texmap_opt.warping_function.imported import ImportedField, read_imported
from texmap_opt.warping_function.painted import PaintedRegion, painted


@dataclass(frozen=True, eq=False)
class GivenDrivers:
    """What drives the warp beside the part's own stress.

    Attributes:
        paint: painted regions.
        imported: a result of another program; None: there is none.
    """

    paint: tuple[PaintedRegion, ...]
    imported: ImportedField | None


def given_drivers(case: DesignCase, grid: Grid) -> GivenDrivers:
    """Reads them, and refuses what cannot be used before anything is analysed.

    Args:
        case: the validated input.
        grid: the uniform grid.

    Raises:
        CaseError: a painted region outside the box of the grid, a file or field that is not there, or
            cells that are to be turned although no driver knows a stress tensor.
    """
    if case.paint:
        background = Background.of(case.warp, grid)
        painted(case.paint, background.grid, smoothing_mm=background.smoothing_mm)
    section = case.imported
    given = GivenDrivers(case.paint, None if section is None else _imported(section, case))
    _require_tensor(case, given)
    return given


def _require_tensor(case: DesignCase, given: GivenDrivers) -> None:
    warp = case.warp
    imported = given.imported is not None and given.imported.is_stress
    if warp.alignment == 0 or imported or set(warp.driver) & set(STRESS_DRIVERS):
        return
    of_scalar = "" if given.imported is None else f", {given.imported.name} being a scalar"
    raise CaseError(
        f"{case.path.name}: [warp] alignment = {warp.alignment:g}: anisotropy without a tensor: driver = "
        f"{json.dumps(warp.driver)} gives sizes only{of_scalar}; import a stress tensor, add a driver "
        f'such as "{STRESS_DRIVERS[0]}", or give alignment = 0.'
    )


def _imported(section: ImportedSection, case: DesignCase) -> ImportedField:
    values = None if section.values is None else case.directory / section.values
    return read_imported(
        case.directory / section.file,
        field=section.field,
        values=values,
        unit=section.unit,
        order=section.order,
        where=f"{case.path.name}: [imported]",
    )
