"""3MF core files: a triangle mesh in millimetres."""

from collections.abc import Iterator
from pathlib import Path

from texmap_opt.export.three_mf_package import (
    model_text,
    triangles_text,
    vertices_text,
    write_package,
)
from texmap_opt.solid.tri_mesh import TriMesh


def write_three_mf(path: Path, surface: TriMesh) -> None:
    """Writes a surface as one object of a 3MF package.

    Raises:
        OutputError: when the file cannot be written.
    """
    write_package(path, model_text(_mesh(surface), name="part"))


def _mesh(surface: TriMesh) -> Iterator[str]:
    yield from vertices_text(surface.vertices)
    yield from triangles_text(surface.faces)
