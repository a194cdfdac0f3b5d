"""A finished solid, and the files it can be written to."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from texmap_opt.errors import InputError
from texmap_opt.export.metadata import Metadata
from texmap_opt.export.obj import write_obj
from texmap_opt.export.ply import write_ply
from texmap_opt.export.stl import write_stl
from texmap_opt.export.three_mf import write_three_mf
from texmap_opt.export.vtk import write_surface
from texmap_opt.solid.tri_mesh import TriMesh

WRITERS: dict[str, Callable[[Path, TriMesh, Metadata], None]] = {
    ".stl": write_stl,
    ".3mf": write_three_mf,
    ".obj": write_obj,
    ".ply": write_ply,
    ".vtp": write_surface,
}


def check_ending(path: Path) -> None:
    """Refuse a file whose ending names no format that a solid can be written in.

    Raises:
        InputError: with the endings that can.
    """
    if path.suffix.lower() not in WRITERS:
        raise InputError(
            f'{path}: the ending "{path.suffix}" is not one of {", ".join(WRITERS)}; choose one of them.'
        )


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed surface that keeps its shape in float32, as files hold it.

    Attributes:
        surface: its triangles [mm].
    """

    surface: TriMesh

    def save(self, path: str | Path, metadata: Metadata | None = None) -> None:
        """Write it; the format follows from the ending, .stl, .3mf, .obj, .ply or .vtp.

        All hold the vertices bit for bit, STL, 3MF, OBJ and PLY as float32, VTP as float64.

        Args:
            path: the file.
            metadata: title and origin; None: the file's name is the title.

        Raises:
            InputError: for another ending.
            OutputError: when the file cannot be written.
        """
        path = Path(path)
        check_ending(path)
        about = metadata or Metadata(title=path.stem)
        WRITERS[path.suffix.lower()](path, self.surface, about)
