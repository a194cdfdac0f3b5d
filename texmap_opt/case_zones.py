"""Zones of a case file: where the lattice has another unit cell."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from texmap_opt.case_table import Kind, key, number, table, text
from texmap_opt.errors import CaseError
from texmap_opt.region import AbstractRegion
from texmap_opt.region_table import region_from_table


def index_range() -> Kind:
    """Two corners of a block of grid cells, such as [[0, 0, 0], [3, 3, 1]]."""

    def read(value: Any) -> tuple[tuple[int, ...], tuple[int, ...]]:
        pair = value if isinstance(value, list) and len(value) == 2 else [value, None]
        low, high = (tuple(index) if isinstance(index, list) else () for index in pair)
        whole = all(type(number) is int for number in (*low, *high))
        if len(low) not in (2, 3) or len(low) != len(high) or not whole:
            raise ValueError(
                "must be the indices of two cells, such as [[0, 0, 0], [3, 3, 1]]; two for each in 2.5-D."
            )
        if any(first > last for first, last in zip(low, high, strict=True)):
            raise ValueError("must have the lowest index along each axis first; swap them.")
        return low, high

    return Kind("two of: whole numbers", read)


@dataclass(frozen=True)
class ZoneSection:
    """`[[zone]]`: cells of the grid that get another unit cell than `[lattice] cell`; later ones win."""

    cell: str = key(text(), "a name of `texmap cells`, or a path to a unit-cell XML")
    region: dict | None = key(
        table(),
        "cells of the warped grid whose centre is in it: see Regions; in space, so not `normal`",
        default=None,
    )
    f_least: float | None = key(
        number(above=0.0),
        "instead of a region: cells at whose centre f is at least this; f is 1 half way between its "
        "limits",
        default=None,
    )
    f_most: float | None = key(
        number(above=0.0), "with f_least or alone: at most this", default=None
    )
    grid_cells: tuple[tuple[int, ...], tuple[int, ...]] | None = key(
        index_range(),
        "instead of a region: the first and the last cell of a block by their indices, which count from "
        "0 at the lower corner of the part's box, are negative in the margin below it, and stand in the "
        "order of [lattice] cells",
        default=None,
    )


@dataclass(frozen=True, eq=False)
class Zone:
    """Cells of the grid that get another unit cell; one of region, f and grid_cells says which.

    Attributes:
        where: file and section for messages, such as "case.toml: [[zone]] 1".
        cell: name or path of the unit cell.
        region: where the centre of a cell of the warped grid lies; None: not by region.
        f: least and largest f at its centre; None: not by f.
        grid_cells: indices of the first and the last cell of a block; None: not by index.
    """

    where: str
    cell: str
    region: AbstractRegion | None
    f: tuple[float, float] | None
    grid_cells: Int[np.ndarray, "2 d"] | None


def zones(sections: list[ZoneSection], file: str, base: Path) -> tuple[Zone, ...]:
    """The zones of a case.

    Args:
        sections: the tables `[[zone]]`.
        file: name of the case file, for messages.
        base: folder that relative paths start at.

    Raises:
        CaseError: for an impossible region or range, or not exactly one choice of cells.
    """
    return tuple(
        _zone(section, f"{file}: [[zone]] {i}", base) for i, section in enumerate(sections, start=1)
    )


def _zone(section: ZoneSection, where: str, base: Path) -> Zone:
    least, most = section.f_least, section.f_most
    by_f = least is not None or most is not None
    given = [section.region is not None, by_f, section.grid_cells is not None]
    if sum(given) != 1:
        raise CaseError(
            f"{where}: has {'several choices' if sum(given) else 'no choice'} of cells; give one of "
            "region, f_least and f_most, or grid_cells."
        )
    low, high = (0.0 if least is None else least), (math.inf if most is None else most)
    if low > high:
        raise CaseError(f"{where} f_least = {low:g}: is above f_most = {high:g}; swap them.")
    region = None
    if section.region is not None:
        if "normal" in section.region:
            raise CaseError(
                f"{where} region normal: tells parts of a surface, but a zone fills space; give a box, "
                "sphere, cylinder, plane or stl."
            )
        region = region_from_table(section.region, f"{where} region", base)
    block = section.grid_cells
    return Zone(
        where=where,
        cell=section.cell,
        region=region,
        f=(low, high) if by_f else None,
        grid_cells=None if block is None else np.array(block),
    )
