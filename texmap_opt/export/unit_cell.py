"""A structure that is one cell of a lattice, as a unit-cell file (schema: library/unit_cell.xsd)."""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from texmap_opt.cells.unit_cell_xml import read_unit_cell
from texmap_opt.errors import CellError, OutputError
from texmap_opt.export.whole_file import whole_file
from texmap_opt.structure.structure import WALL, Structure


def write_unit_cell(
    path: Path, structure: Structure, *, name: str, source: str, tiling: str = "translate"
) -> None:
    """Write the cell that fills the bounding box of some struts' axes.

    Radii become relative to their median. The file is read back before it gets its name, so that it is
    a cell that tiles.

    Args:
        path: the file.
        structure: the struts of one cell; its size does not matter.
        name: of the cell.
        source: where it is from.
        tiling: "translate" or "mirror", one word for all axes or one for each.

    Raises:
        OutputError: for walls, struts in one plane, or when the file cannot be written.
        CellError: when no lattice comes of it, naming the line of the file that would be written.
    """
    low, high = structure.joints.min(axis=0), structure.joints.max(axis=0)
    if structure.section == WALL or not (high > low).all():
        raise OutputError(
            f"{path}: a unit cell is made of bars that fill a box, these lie in a plane or are walls; "
            "write the cell by hand (library/README.md)."
        )
    text = "".join(_text(structure, name=name, source=source, tiling=tiling)).encode()
    with tempfile.TemporaryDirectory() as folder:
        trial = Path(folder) / path.name
        trial.write_bytes(text)
        try:
            read_unit_cell(trial)
        except CellError as failure:
            raise CellError(
                f"these struts make no unit cell, and nothing was written; what would be {failure}"
            ) from failure
    with whole_file(path) as file:
        file.write(text)


def _text(structure: Structure, *, name: str, source: str, tiling: str) -> Iterator[str]:
    low = structure.joints.min(axis=0)
    edges = np.ptp(structure.joints, axis=0)
    shares, mean = (structure.joints - low) / edges, structure.radii.mean(axis=1)
    relative = mean / np.median(mean)
    yield '<?xml version="1.0" encoding="UTF-8"?>\n'
    yield f'<unit_cell name={quoteattr(name)} dimensions="3" unit="cell"'
    yield f' section="{structure.section}" tiling={quoteattr(tiling)}'
    if np.ptp(edges) > 0:
        yield f' proportions="{" ".join(_decimal(edge) for edge in edges / edges[0])}"'
    yield ">\n  <description>A cell from another program.</description>\n"
    yield f"  <source>{escape(source)}</source>\n  <joints>\n"
    for number, place in enumerate(shares):
        yield f'    <joint id="{number}">{" ".join(_decimal(x) for x in place)}</joint>\n'
    yield "  </joints>\n  <struts>\n"
    for (a, b), radius in zip(structure.struts.tolist(), relative.tolist(), strict=True):
        thickness = "" if radius == 1 else f' radius="{radius!r}"'
        yield f'    <strut from="{a}" to="{b}"{thickness}/>\n'
    yield "  </struts>\n</unit_cell>\n"


def _decimal(value: float) -> str:
    """A number without an exponent."""
    return np.format_float_positional(value, trim="-")
