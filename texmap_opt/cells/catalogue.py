"""The library of unit cells: the only code that knows where its files are."""

from pathlib import Path

from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.cells.unit_cell_xml import read_aliases, read_unit_cell
from texmap_opt.errors import CellError, nearest_name

_PACKAGE = Path(__file__).resolve().parents[1]
# The wheel carries the library inside the package; in a checkout it lies beside the package.
_PLACES = (_PACKAGE / "_library", _PACKAGE.parent / "library")


def cell_names() -> list[str]:
    """Names of the cells in the library, in alphabetical order."""
    return sorted(path.stem for path in _library().glob("*.xml"))


def alias_names() -> dict[str, str]:
    """Other names of cells in the library, and the name of the cell that each stands for."""
    return {
        alias: path.stem
        for path in sorted(_library().glob("*.xml"))
        for alias in read_aliases(path)
    }


def unit_cell(name_or_path: str | Path, *, base: Path | None = None) -> UnitCell:
    """A cell of the library by its name or alias, or one read from a file.

    Args:
        name_or_path: "octet", "kelvin", or the path of a unit-cell XML file.
        base: folder that a relative path refers to; None: the working directory.

    Raises:
        CellError: for an unknown name, or a file that is missing or wrong.
    """
    if isinstance(name_or_path, str) and name_or_path in cell_names():
        return read_unit_cell(_library() / f"{name_or_path}.xml")
    path = Path(name_or_path)
    if path.suffix.lower() == ".xml" or len(path.parts) > 1:
        return read_unit_cell(path if base is None else base / path)
    aliases = alias_names()
    if str(name_or_path) in aliases:
        return read_unit_cell(_library() / f"{aliases[str(name_or_path)]}.xml")
    known = nearest_name(str(name_or_path), [*cell_names(), *aliases])
    raise CellError(
        f'unit cell "{name_or_path}" is not in the library; {known} A file of your own is given by '
        "its path, ending in .xml."
    )


def _library() -> Path:
    for place in _PLACES:
        if place.is_dir():
            return place
    raise CellError(
        f"the library of unit cells is missing ({_PLACES[0]}); reinstall texmap-opt, or give the "
        "path of a unit-cell XML file."
    )
