"""Binary PLY, little-endian: float32 vertices and the vertex numbers of each triangle."""

from pathlib import Path

import numpy as np

from texmap_opt.errors import OutputError
from texmap_opt.export.metadata import Metadata
from texmap_opt.export.whole_file import whole_file
from texmap_opt.solid.tri_mesh import TriMesh

# Some ten megabytes at a time.
ROWS_PER_CHUNK = 500_000
TRIANGLE = np.dtype([("count", "u1"), ("corners", "<i4", 3)], align=False)
# Numbers of vertices have four bytes and a sign.
MAX_VERTICES = 1 << 31


def write_ply(path: Path, surface: TriMesh, metadata: Metadata) -> None:
    """Writes a surface; comments say the unit and the metadata.

    Vertices are rounded to float32: pass what `float32_solid.printable_mesh` returns, for which
    that changes nothing.

    Raises:
        OutputError: for more vertices than the format can number, or when the file cannot be written.
    """
    vertices, faces = surface.vertices, surface.faces
    if len(vertices) > MAX_VERTICES:
        raise OutputError(
            f"{path}: {len(vertices):,} vertices; PLY numbers at most {MAX_VERTICES:,}: write .stl "
            "instead."
        )
    said = "".join(f"comment {name}: {text}\n" for name, text in metadata.entries().items())
    head = (
        f"ply\nformat binary_little_endian 1.0\ncomment Unit: millimetre\n{said}"
        f"element vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    with whole_file(path) as file:
        file.write(head.encode("ascii", "replace"))
        for start in range(0, len(vertices), ROWS_PER_CHUNK):
            file.write(vertices[start : start + ROWS_PER_CHUNK].astype("<f4").data)
        for start in range(0, len(faces), ROWS_PER_CHUNK):
            some = faces[start : start + ROWS_PER_CHUNK]
            records = np.full(len(some), np.array((3, 0), TRIANGLE))
            records["corners"] = some
            file.write(records.data)
