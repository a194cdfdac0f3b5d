"""Binary STL: 84 bytes of header and count, then 50 bytes a triangle, in float32."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from texmap_opt.errors import OutputError
from texmap_opt.export.metadata import Metadata
from texmap_opt.export.whole_file import whole_file
from texmap_opt.solid.tri_mesh import TriMesh

# Must not begin with "solid", by which readers tell text files.
HEADER = "binary STL, unit millimetre, written by {Application}: {Title}"
HEADER_BYTES = 80
# The count of triangles has four bytes.
MAX_TRIANGLES = (1 << 32) - 1
# Some ten megabytes at a time.
TRIANGLES_PER_CHUNK = 200_000
TRIANGLE = np.dtype(
    [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")], align=False
)


def write_stl(path: Path, surface: TriMesh, metadata: Metadata) -> None:
    """Writes a surface; the header says what fits.

    Vertices are rounded to float32: pass what `float32_solid.printable_mesh` returns, for which
    that changes nothing.

    Raises:
        OutputError: for more triangles than the format can count, or when the file cannot be written.
    """
    count = len(surface.faces)
    if count > MAX_TRIANGLES:
        raise OutputError(
            f"{path}: {count:,} triangles; STL holds at most {MAX_TRIANGLES:,}: write .ply instead."
        )
    header = HEADER.format(**metadata.entries()).encode("ascii", "replace")[:HEADER_BYTES]
    with whole_file(path) as file:
        file.write(header.ljust(HEADER_BYTES, b" "))
        file.write(np.array(count, dtype="<u4").tobytes())
        for start in range(0, count, TRIANGLES_PER_CHUNK):
            faces = surface.faces[start : start + TRIANGLES_PER_CHUNK]
            records = np.zeros(len(faces), dtype=TRIANGLE)
            corners = surface.vertices[faces]
            records["normal"] = _normals(corners)
            records["corners"] = corners
            file.write(records.data)


def _normals(corners: Float[np.ndarray, "faces 3 3"]) -> Float[np.ndarray, "faces 3"]:
    """Unit normals, zero where a triangle has no area; of some triangles, never of all at once."""
    a, b, c = np.moveaxis(corners, 1, 0)
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    return np.divide(cross, length, out=np.zeros_like(cross), where=length > 0)
