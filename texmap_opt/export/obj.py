"""OBJ (Wavefront): vertices and triangles as text."""

from pathlib import Path

from texmap_opt.export.metadata import Metadata
from texmap_opt.export.rows_text import rows_text
from texmap_opt.export.whole_file import whole_file
from texmap_opt.solid.tri_mesh import TriMesh

# Triangles renumbered at a time: some ten megabytes.
TRIANGLES_PER_CHUNK = 500_000


def write_obj(path: Path, surface: TriMesh, metadata: Metadata) -> None:
    """Writes a surface; comments say the unit and the metadata.

    Coordinates have nine digits, which hold any float32 exactly; vertices are numbered from 1.

    Raises:
        OutputError: when the file cannot be written.
    """
    with whole_file(path) as file:
        file.write(b"# Unit: millimetre\n")
        for name, text in metadata.entries().items():
            file.write(f"# {name}: {text}\n".encode())
        for lines in rows_text("v %.9g %.9g %.9g\n", surface.vertices):
            file.write(lines.encode())
        for start in range(0, len(surface.faces), TRIANGLES_PER_CHUNK):
            faces = surface.faces[start : start + TRIANGLES_PER_CHUNK] + 1
            for lines in rows_text("f %d %d %d\n", faces):
                file.write(lines.encode())
