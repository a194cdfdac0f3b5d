"""Binary STL: 84 bytes of header and count, then 50 bytes a triangle, in float32."""

from pathlib import Path

import numpy as np

from texmap_opt.export.whole_file import whole_file
from texmap_opt.solid.tri_mesh import TriMesh

# Must not begin with "solid", by which readers tell text files.
HEADER = b"binary STL, unit millimetre, written by texmap"
TRIANGLES_PER_CHUNK = 200_000
TRIANGLE = np.dtype(
    [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")], align=False
)


def write_stl(path: Path, surface: TriMesh) -> None:
    """Writes a surface.

    Vertices are rounded to float32: pass what `float32_solid.printable_mesh` returns, for which
    that changes nothing.

    Raises:
        OutputError: when the file cannot be written.
    """
    with whole_file(path) as file:
        file.write(HEADER.ljust(80, b" "))
        file.write(np.array(len(surface.faces), dtype="<u4").tobytes())
        for start in range(0, len(surface.faces), TRIANGLES_PER_CHUNK):
            chunk = slice(start, start + TRIANGLES_PER_CHUNK)
            records = np.zeros(len(surface.faces[chunk]), dtype=TRIANGLE)
            records["normal"] = surface.face_normals[chunk]
            records["corners"] = surface.vertices[surface.faces[chunk]]
            file.write(records.tobytes())
