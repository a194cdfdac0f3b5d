"""A finished solid, and the files it can be written to."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from texmap_opt.errors import InputError
from texmap_opt.export.stl import write_stl
from texmap_opt.export.three_mf import write_three_mf
from texmap_opt.solid.tri_mesh import TriMesh

WRITERS: dict[str, Callable[[Path, TriMesh], None]] = {
    ".stl": write_stl,
    ".3mf": write_three_mf,
}


def check_ending(path: Path) -> None:
    """Refuse a file whose ending names no format that a solid can be written in.

    Raises:
        InputError: with the endings that can.
    """
    if path.suffix.lower() not in WRITERS:
        known = " or ".join(WRITERS)
        raise InputError(f'{path}: the ending "{path.suffix}" is not {known}; choose one of them.')


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed surface that keeps its shape in float32, as files hold it.

    Attributes:
        surface: its triangles [mm].
    """

    surface: TriMesh

    def save(self, path: str | Path) -> None:
        """Write it; the format follows from the ending, .stl or .3mf.

        Raises:
            InputError: for another ending.
            OutputError: when the file cannot be written.
        """
        path = Path(path)
        check_ending(path)
        WRITERS[path.suffix.lower()](path, self.surface)
