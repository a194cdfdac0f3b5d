"""VTK XML files for ParaView: stress on tets, the warped grid, the sized struts, surfaces.

Written directly (arrays in base64 with a 64-bit length before each), so that no graphics library
is loaded: `struts.vtp` and the others also come out where VTK cannot start.
"""

import base64
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO
from xml.sax.saxutils import quoteattr

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.export.metadata import Metadata
from texmap_opt.export.whole_file import whole_file
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.structure import Structure

# Cell types of the VTK file format.
VTK_TETRA, VTK_HEXAHEDRON, VTK_QUADRATIC_TETRA = 10, 12, 24
# Ours is xx, yy, zz, yz, xz, xy; VTK's symmetric tensor xx, yy, zz, xy, yz, xz.
VOIGT_TO_VTK = [0, 1, 2, 5, 3, 4]
# Arrays of struts.
RADIUS, MEAN_RADIUS, DEPTH = "radius_mm", "mean_radius_mm", "depth_mm"
_TYPES = {"f": "Float64", "i": "Int64", "u": "UInt8"}
# Numbers encoded at a time: some ten megabytes.
_CHUNK = 1 << 20

# A range stands for an array of whole numbers that is never in memory as a whole.
Data = Mapping[str, np.ndarray | range]


def write_stress(
    path: Path,
    *,
    mesh: tuple[Float[np.ndarray, "nodes 3"], Int[np.ndarray, "cells corners"]],
    case_names: Sequence[str],
    displacement: Float[np.ndarray, "cases nodes 3"],
    stress: Float[np.ndarray, "cases nodes 6"],
    von_mises: Float[np.ndarray, "cases nodes"],
) -> None:
    """Writes `stress.vtu`: the tets with displacement, stress and von Mises stress of each case.

    Args:
        path: the file.
        mesh: nodes [mm] and 4 or 10 nodes of each tet, in VTK's order.
        case_names: of the load cases; appended to the arrays' names where there are several.
        displacement: of the nodes [mm].
        stress: nodal stress [MPa], Voigt order xx, yy, zz, yz, xz, xy.
        von_mises: nodal von Mises stress [MPa].

    Raises:
        OutputError: when the file cannot be written.
    """
    nodes, tets = mesh
    data: dict[str, np.ndarray] = {}
    for k, case in enumerate(case_names):
        ending = f" {case}" if len(case_names) > 1 else ""
        data[f"displacement_mm{ending}"] = displacement[k]
        data[f"von_mises_MPa{ending}"] = von_mises[k]
        data[f"stress_MPa{ending}"] = stress[k][:, VOIGT_TO_VTK]
    kind = VTK_TETRA if tets.shape[1] == 4 else VTK_QUADRATIC_TETRA
    _write_unstructured(path, nodes, (tets, kind), point_data=data, cell_data={})


def write_grid(
    path: Path,
    *,
    nodes: Float[np.ndarray, "nx ny nz 3"],
    cell_data: Mapping[str, Float[np.ndarray, "cx cy cz"]],
) -> None:
    """Writes `grid.vtu`: the cells of a warped grid as hexahedra.

    Args:
        path: the file.
        nodes: grid nodes [mm].
        cell_data: a number for every cell, such as `size`, `wanted_size`, `jacobian`.

    Raises:
        OutputError: when the file cannot be written.
    """
    number = np.arange(nodes[..., 0].size).reshape(nodes.shape[:3])
    low, high = slice(None, -1), slice(1, None)
    # VTK goes around the bottom, then around the top.
    around = [(low, low), (high, low), (high, high), (low, high)]
    hexahedra = np.stack([number[x, y, z] for z in (low, high) for x, y in around], axis=-1)
    _write_unstructured(
        path,
        nodes.reshape(-1, 3),
        (hexahedra.reshape(-1, 8), VTK_HEXAHEDRON),
        point_data={},
        cell_data={name: values.reshape(-1) for name, values in cell_data.items()},
    )


def write_struts(
    path: Path, structure: Structure, *, strut_data: Mapping[str, Float[np.ndarray, " struts"]]
) -> None:
    """Writes `struts.vtp`: one line a strut, with its radius, and other numbers per strut.

    Joints are repeated for every strut, so that `radius_mm` can differ at the ends that meet in one
    joint. Struts from a grid have the number of their `cell` and of their `kind`, walls `depth_mm`.

    Args:
        path: the file.
        structure: joints and struts [mm].
        strut_data: a number for every strut, such as `utilisation`.

    Raises:
        OutputError: when the file cannot be written.
    """
    count = len(structure.struts)
    ends = structure.joints[structure.struts].reshape(-1, 3)
    cells: dict[str, np.ndarray] = {MEAN_RADIUS: structure.radii.mean(axis=1), **strut_data}
    if structure.origin is not None:
        cells |= {"cell": structure.origin.cell, "kind": structure.origin.kind}
    if structure.extrusion is not None:
        cells[DEPTH] = structure.extrusion.depth
    with whole_file(path) as file:
        _open(file, "PolyData")
        _text(file, f'<Piece NumberOfPoints="{2 * count}" NumberOfLines="{count}">\n')
        _group(file, "Points", {"points": ends})
        connectivity = np.arange(2 * count)
        _group(file, "Lines", {"connectivity": connectivity, "offsets": connectivity[1::2] + 1})
        _group(file, "PointData", {RADIUS: structure.radii.reshape(-1)})
        _group(file, "CellData", cells)
        _text(file, "</Piece>\n</PolyData>\n</VTKFile>\n")


def write_surface(path: Path, surface: TriMesh, metadata: Metadata) -> None:
    """Writes the triangles of a surface, in float64; field data say the unit and the metadata.

    Args:
        path: the file.
        surface: its triangles [mm].
        metadata: title and origin.

    Raises:
        OutputError: when the file cannot be written.
    """
    count = len(surface.faces)
    with whole_file(path) as file:
        _open(file, "PolyData")
        _text(file, "<FieldData>\n")
        for name, text in {"Unit": "millimetre", **metadata.entries()}.items():
            # A string is the codes of its bytes, and a zero.
            codes = " ".join(str(code) for code in (*text.encode(), 0))
            _text(
                file,
                f'<DataArray type="String" Name="{name}" NumberOfTuples="1" format="ascii">{codes}'
                "</DataArray>\n",
            )
        _text(file, "</FieldData>\n")
        _text(file, f'<Piece NumberOfPoints="{len(surface.vertices)}" NumberOfPolys="{count}">\n')
        _group(file, "Points", {"points": surface.vertices})
        offsets = range(3, 3 * count + 1, 3)
        _group(file, "Polys", {"connectivity": surface.faces.reshape(-1), "offsets": offsets})
        _text(file, "</Piece>\n</PolyData>\n</VTKFile>\n")


def _write_unstructured(
    path: Path,
    points: np.ndarray,
    cells: tuple[np.ndarray, int],
    *,
    point_data: Data,
    cell_data: Data,
) -> None:
    corners, kind = cells
    count, width = corners.shape
    with whole_file(path) as file:
        _open(file, "UnstructuredGrid")
        _text(file, f'<Piece NumberOfPoints="{len(points)}" NumberOfCells="{count}">\n')
        _group(file, "Points", {"points": points})
        topology = {
            "connectivity": corners.reshape(-1),
            "offsets": width * np.arange(1, count + 1),
            "types": np.full(count, kind, dtype=np.uint8),
        }
        _group(file, "Cells", topology)
        _group(file, "PointData", point_data)
        _group(file, "CellData", cell_data)
        _text(file, "</Piece>\n</UnstructuredGrid>\n</VTKFile>\n")


def _open(file: BinaryIO, kind: str) -> None:
    order = "LittleEndian" if sys.byteorder == "little" else "BigEndian"
    _text(
        file,
        f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="1.0" byte_order="{order}" '
        f'header_type="UInt64">\n<{kind}>\n',
    )


def _group(file: BinaryIO, name: str, arrays: Data) -> None:
    _text(file, f"<{name}>\n")
    for label, array in arrays.items():
        kind, width = "Int64", ""
        if not isinstance(array, range):
            kind = _TYPES[array.dtype.kind]
            width = f' NumberOfComponents="{array.shape[1]}"' if array.ndim == 2 else ""
        _text(file, f'<DataArray type="{kind}" Name={quoteattr(label)}{width} format="binary">')
        kept = b""
        for piece in _payload(array, np.dtype(kind.lower())):
            # Three bytes are four letters; what is over waits for the next piece.
            whole = (len(kept) + len(piece)) // 3 * 3 - len(kept)
            file.write(base64.b64encode(kept + piece[:whole]))
            kept = piece[whole:]
        file.write(base64.b64encode(kept))
        _text(file, "</DataArray>\n")
    _text(file, f"</{name}>\n")


def _payload(array: np.ndarray | range, dtype: np.dtype) -> Iterator[bytes]:
    """The number of bytes that follow, and these."""
    numbers = array if isinstance(array, range) else array.reshape(-1)
    yield np.array(len(numbers) * dtype.itemsize, dtype=np.uint64).tobytes()
    for start in range(0, len(numbers), _CHUNK):
        some = numbers[start : start + _CHUNK]
        if isinstance(some, range):
            some = np.arange(some.start, some.stop, some.step)
        yield some.astype(dtype).tobytes()


def _text(file: BinaryIO, text: str) -> None:
    file.write(text.encode())
