"""What of a case drives the warp: painted regions and imported results understood, limits checked."""

import json
from pathlib import Path

from texmap_opt.case_sections import STRESS_DRIVERS, ImportedSection, PaintSection, WarpSection
from texmap_opt.errors import CaseError, nearest_name
from texmap_opt.region_table import region_from_table
from texmap_opt.warping_function.painted import PaintedRegion


def painted_regions(
    sections: list[PaintSection], file: str, base: Path
) -> tuple[PaintedRegion, ...]:
    """The painted regions of a case.

    Args:
        sections: the tables `[[paint]]`.
        file: name of the case file, for messages.
        base: folder that relative paths start at.

    Raises:
        CaseError: for an impossible region.
    """
    painted = []
    for i, section in enumerate(sections, start=1):
        where = f"{file}: [[paint]] {i}"
        if "normal" in section.region:
            raise CaseError(
                f"{where} region normal: tells parts of a surface, but paint fills space; give a box, "
                "sphere, cylinder, plane or stl."
            )
        region = region_from_table(section.region, f"{where} region", base)
        painted.append(PaintedRegion(region, section.value, section.falloff_mm, where))
    return tuple(painted)


def check_warp(
    warp: WarpSection,
    file: str,
    *,
    load_cases: tuple[str, ...],
    paint: tuple[PaintedRegion, ...],
    imported: ImportedSection | None,
) -> None:
    """Limits of the warp that involve more than one key.

    Args:
        warp: the section.
        file: name of the case file, for messages.
        load_cases: names of the load cases there are.
        paint: the painted regions.
        imported: the result of another program, if there is one.

    Raises:
        CaseError: for keys that contradict each other.
    """
    for driver, table, given in (
        ("paint", "[[paint]]", bool(paint)),
        ("file", "[imported]", imported is not None),
    ):
        if driver in warp.driver and not given:
            raise CaseError(
                f'{file}: [warp] driver = {_shown(warp.driver)}: "{driver}" needs a table {table}; add '
                f'one, or remove "{driver}".'
            )
        if given and driver not in warp.driver:
            raise CaseError(
                f"{file}: {table}: drives nothing, because [warp] driver = {_shown(warp.driver)} has no "
                f'"{driver}"; add it there, or remove the table.'
            )
    _check_weights(warp, file, load_cases)


def _check_weights(warp: WarpSection, file: str, load_cases: tuple[str, ...]) -> None:
    weights = warp.driver_weights
    if weights is not None and len(weights) != len(warp.driver):
        raise CaseError(
            f"{file}: [warp] driver_weights = {_shown(weights)}: are {len(weights)} for "
            f"{len(warp.driver)} drivers {_shown(warp.driver)}; give one for each."
        )
    factors = warp.case_weights
    if factors is None:
        return
    given = ", ".join(f"{name} = {factor:g}" for name, factor in factors.items())
    where = f"{file}: [warp] case_weights = {{ {given} }}"
    for name in factors:
        if name not in load_cases:
            raise CaseError(
                f"{file}: [warp] case_weights {name}: there is no such load case; "
                f"{nearest_name(name, load_cases)}"
            )
    if not any(factors.get(name, 1.0) for name in load_cases):
        raise CaseError(
            f"{where}: every load case has the weight 0, so nothing drives the warp; give one of them "
            "a positive weight."
        )
    if not set(warp.driver) & set(STRESS_DRIVERS):
        raise CaseError(
            f"{where}: weigh the part's own stress, which driver = {_shown(warp.driver)} does not read; "
            f'add a driver such as "{STRESS_DRIVERS[0]}", or remove them.'
        )


def _shown(values: tuple[str, ...] | tuple[float, ...]) -> str:
    """A list as the case file writes it."""
    return json.dumps(list(values))
