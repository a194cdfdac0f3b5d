"""The library in the order of a property, so that a designer can choose by requirement."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from texmap_opt.cache import StageCache
from texmap_opt.cells.at_density import all_homogenised_at
from texmap_opt.cells.listing import LISTED_DENSITY, table_text
from texmap_opt.cells.properties import direction_of, property_named
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.errors import CellError, InputError

DEFAULT_DIRECTION = "1,0,0"

# For cells whose property is not found along a direction, and why.
OBLIQUE = (
    "a 2.5-D cell has it in its plane (third component 0), E and nu also along its axis (0,0,1)"
)
NO_ZENER = "its stiffness is not cubic, or square in the plane"


@dataclass(frozen=True)
class Wish:
    """What cells are ordered by.

    Attributes:
        name: of the property, of `texmap_opt.cells.properties.PROPERTIES`.
        direction: along which.
        density: relative.
        ascending: the least first.
    """

    name: str
    direction: tuple[float, float, float]
    density: float
    ascending: bool = False


@dataclass(frozen=True)
class Ranked:
    """A cell that has the property.

    Attributes:
        cell: the unit cell.
        radius: at the density, in cell edges.
        value: of the property, moduli over that of the solid.
        jointed: whether joints were stiffened as fitted to solids.
    """

    cell: UnitCell
    radius: float
    value: float
    jointed: bool


@dataclass(frozen=True)
class Ranking:
    """Cells in the order of a property.

    Attributes:
        wish: what they are ordered by.
        rows: first the best.
        left_out: why other cells are not among them, by name.
    """

    wish: Wish
    rows: tuple[Ranked, ...]
    left_out: dict[str, str]

    def text(self) -> str:
        """A heading, a table, and what was left out."""
        wish, measure = self.wish, property_named(self.wish.name)
        along = f" along ({', '.join(f'{c:g}' for c in wish.direction)})"
        heading = (
            f"{wish.name}: {measure.meaning}{along if measure.directional else ''}, "
            f"relative density {wish.density:g}, moduli over that of the solid"
        )
        rows = [
            [
                str(place),
                row.cell.name,
                _dimensions(row.cell),
                f"{row.value:.4g}",
                row.cell.classification,
                f"{row.radius:.4f}",
                "fitted" if row.jointed else "beams",
            ]
            for place, row in enumerate(self.rows, 1)
        ]
        head = ["", "cell", "", wish.name, "class", "radius", "joints"]
        lines = [heading, table_text(head, rows, right={0, 3, 5})]
        for why in dict.fromkeys(self.left_out.values()):
            names = [name for name, reason in self.left_out.items() if reason == why]
            lines.append(f"left out: {', '.join(names)}: {why}")
        return "\n".join(lines)

    def as_dict(self) -> dict:
        """For JSON."""
        measure = property_named(self.wish.name)
        return {
            "property": self.wish.name,
            "direction": list(self.wish.direction) if measure.directional else None,
            "relative_density": self.wish.density,
            "cells": [
                {
                    "name": row.cell.name,
                    "dimensions": row.cell.dimensions,
                    "value": row.value,
                    "class": row.cell.classification,
                    "radius": row.radius,
                    "joint_model": row.jointed,
                }
                for row in self.rows
            ],
            "left_out": self.left_out,
        }


def wish_of(
    name: str, direction: str | None, density: float | None, *, ascending: bool = False
) -> Wish:
    """What was typed, checked.

    Args:
        name: of a property.
        direction: three numbers with commas between; None: along x.
        density: relative; None: that of the listing.
        ascending: the least first.

    Raises:
        InputError: for an unknown property, a direction or density that is none, or a direction that the
            property does not depend on.
    """
    measure = property_named(name)
    if direction is not None and not measure.directional:
        raise InputError(f'property "{name}" has no direction; leave --direction out.')
    density = LISTED_DENSITY if density is None else density
    if not 0 < density < 1:
        raise InputError(
            f"density {density:g}: the relative density must be above 0 and below 1, such as 0.15."
        )
    x, y, z = direction_of(direction or DEFAULT_DIRECTION).tolist()
    return Wish(name, (x, y, z), density, ascending)


def ranking(
    cells: list[UnitCell], wish: Wish, *, cache: StageCache, computing: Callable[[int], None]
) -> Ranking:
    """Order cells by a property at a density.

    Args:
        cells: the unit cells.
        wish: what they are ordered by.
        cache: where stiffness is kept.
        computing: told of how many cells it is not there yet.
    """
    measure = property_named(wish.name)
    direction = np.array(wish.direction)
    homogenised = all_homogenised_at(cells, wish.density, cache=cache, computing=computing)
    rows, left_out = [], {}
    for cell in cells:
        result = homogenised[cell.name]
        if isinstance(result, CellError):
            left_out[cell.name] = str(result)
            continue
        value = measure.of(result, direction)
        if value is None:
            left_out[cell.name] = OBLIQUE if measure.directional else NO_ZENER
            continue
        rows.append(Ranked(cell, result.radius, value, result.joint_model is not None))
    # Cells that are one lattice differ by rounding: they keep the order of their names.
    rows.sort(key=lambda row: float(f"{row.value:.9e}"), reverse=not wish.ascending)
    return Ranking(wish, tuple(rows), left_out)


def _dimensions(cell: UnitCell) -> str:
    return "3-D" if cell.dimensions == 3 else "2.5-D"
