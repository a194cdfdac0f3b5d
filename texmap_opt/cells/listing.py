"""The library as a table: what each cell is, and how stiff at one density."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from texmap_opt.cache import StageCache
from texmap_opt.cells.at_density import all_homogenised_at
from texmap_opt.cells.face_patterns import face_patterns_text
from texmap_opt.cells.properties import PROPERTIES
from texmap_opt.cells.rigidity import maxwell_number, mechanisms
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.errors import CellError

# Relative density, and direction in the cell, of the stiffness that is listed.
LISTED_DENSITY = 0.1
LISTED_DIRECTION = np.array([1.0, 0.0, 0.0])

HEAD = ["cell", "", "joints", "struts", "class", "Maxwell", "E/Es", "symmetry", "description"]
RIGHT = {2, 3, 5, 6}


@dataclass(frozen=True)
class ListedCell:
    """A row of the table.

    Attributes:
        cell: the unit cell.
        modulus: Young's modulus along x over that of the solid, at a relative density of 0.1; None where
            the cell has none.
    """

    cell: UnitCell
    modulus: float | None

    def as_dict(self) -> dict:
        """For JSON."""
        cell = self.cell
        return {
            "name": cell.name,
            "aliases": list(cell.aliases),
            "dimensions": cell.dimensions,
            "joints": len(cell.joints),
            "struts": len(cell.struts),
            "class": cell.classification,
            "maxwell_number": maxwell_number(cell),
            "relative_modulus": self.modulus,
            "symmetry": cell.symmetry,
            "tiling": cell.tiling,
            "section": cell.section,
            "joint_model": cell.joint_model is not None,
            "description": cell.description,
            "source": cell.source,
        }


def listing(
    cells: Sequence[UnitCell], *, cache: StageCache, computing: Callable[[int], None]
) -> list[ListedCell]:
    """Rows of the table, cells of three dimensions first.

    Args:
        cells: the unit cells.
        cache: where stiffness is kept.
        computing: told of how many cells it is not there yet.
    """
    homogenised = all_homogenised_at(cells, LISTED_DENSITY, cache=cache, computing=computing)
    rows = []
    for cell in sorted(cells, key=lambda cell: (-cell.dimensions, cell.name)):
        result = homogenised[cell.name]
        failed = isinstance(result, CellError)
        rows.append(
            ListedCell(cell, None if failed else PROPERTIES["E"].of(result, LISTED_DIRECTION))
        )
    return rows


def listing_text(rows: Sequence[ListedCell], width: int) -> str:
    """The table, with a line on what its columns mean.

    Args:
        rows: of `listing`.
        width: of the terminal, to which descriptions are cut.
    """
    cells = [
        [
            row.cell.name,
            "3-D" if row.cell.dimensions == 3 else "2.5-D",
            str(len(row.cell.joints)),
            str(len(row.cell.struts)),
            row.cell.classification,
            str(maxwell_number(row.cell)),
            "-" if row.modulus is None else f"{row.modulus:.2e}",
            row.cell.symmetry,
            _first_sentence(row.cell.description),
        ]
        for row in rows
    ]
    lines = [_cut(line, width) for line in table_text(HEAD, cells, right=RIGHT).splitlines()]
    note = (
        f"E/Es: Young's modulus along x over the solid's, relative density {LISTED_DENSITY:g}. "
        "`texmap cells --rank E --direction 1,0,0 --density 0.15` orders by it; docs/cells.md has more."
    )
    return "\n".join([*lines, "", note])


def cell_text(cell: UnitCell, library: Iterable[UnitCell]) -> str:
    """A cell in lines: what it is, how rigid with pin joints, how tiled, its faces, whose it is.

    Args:
        cell: the unit cell.
        library: cells with which its faces are compared.
    """
    found = mechanisms(cell)
    known_as = f" (also called {', '.join(cell.aliases)})" if cell.aliases else ""
    proportions = " x ".join(f"{edge:.4g}" for edge in cell.proportions)
    shape = "3-D" if cell.dimensions == 3 else "2.5-D, extruded"
    lines = [
        f"{cell.name}{known_as}: {cell.description}",
        f"  {shape}; {len(cell.joints)} joints, {len(cell.struts)} struts ({cell.section}); edges "
        f"{proportions}; {cell.symmetry}",
        f"  {cell.classification}-dominated; Maxwell number {maxwell_number(cell)}; pin-jointed lattice: "
        f"mechanisms {found.mechanisms} ({found.strain_producing} of them strains), states of "
        f"self-stress {found.self_stresses}",
        f"  tiled by {cell.tiling}; source: {cell.source}",
        *(f"  {line}" for line in face_patterns_text(cell, library).splitlines()),
    ]
    return "\n".join(lines)


def table_text(head: list[str], rows: list[list[str]], *, right: set[int]) -> str:
    """Columns as wide as their widest entry.

    Args:
        head: names of the columns.
        rows: entries.
        right: columns that are aligned on the right.
    """
    widths = [max(len(row[k]) for row in [head, *rows]) for k in range(len(head))]
    lines = [
        "  ".join(
            entry.rjust(width) if k in right else entry.ljust(width)
            for k, (entry, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in [head, *rows]
    ]
    return "\n".join(lines)


def _first_sentence(text: str) -> str:
    return text.split(". ")[0].rstrip(".")


def _cut(line: str, width: int) -> str:
    return line if len(line) <= width else f"{line[: width - 1].rstrip()}…"
