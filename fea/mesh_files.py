"""Surfaces, tet meshes and results from files and to them; the only user of meshio."""

import contextlib
import io
import math
import re
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from fea.errors import FeaError
from fea.result_mesh import ResultMesh, require_known
from fea.tet_mesh import TetMesh

# What meshio calls the cells that `TetMesh` holds.
MESHIO_TETS = {4: "tetra", 10: "tetra10"}

# Names of numbers in legacy VTK files, C++'s and VTK's. Writers mix them; meshio knows only C++'s up to
# version 4.2, only VTK's in 5.1 (and there takes "int" for eight bytes). "long" has eight bytes
# everywhere but on Windows.
VTK_TYPES = {
    b"char": b"vtktypeint8",
    b"unsigned_char": b"vtktypeuint8",
    b"short": b"vtktypeint16",
    b"unsigned_short": b"vtktypeuint16",
    b"int": b"vtktypeint32",
    b"unsigned_int": b"vtktypeuint32",
    b"long": b"vtktypeint64",
    b"unsigned_long": b"vtktypeuint64",
}
C_TYPES = {theirs: name for name, theirs in VTK_TYPES.items()}
# In a legacy VTK file the heads of an array of scalars, and of one array in a field.
VTK_SCALARS = re.compile(
    rb"^SCALARS (\S+) (\S+)(?: (\d+))? *\r?\nLOOKUP_TABLE default *\r?\n", re.MULTILINE
)
VTK_ARRAY = re.compile(rb"^(\S+ \d+ \d+) (\w+)(?=\s*$)", re.MULTILINE)

RESULT_SUFFIXES = (".vtu", ".vtk", ".msh", ".xdmf", ".xmf")


def read_surface(
    path: Path | str,
) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "faces 3"]]:
    """Vertices and triangles of an STL, OBJ or PLY file.

    Vertices at equal coordinates become one, since STL repeats every vertex in each of its triangles;
    polygons are cut into fans; triangles that lose a corner by this are dropped.

    Args:
        path: the file; its suffix tells the format. Coordinates are taken as they are [mm].

    Raises:
        FeaError: the file cannot be read, or holds no triangles.
    """
    path = Path(path)
    mesh = _read(path, (".stl", ".obj", ".ply"), "a surface")
    polygons = [
        np.asarray(block.data, np.int64)
        for block in mesh.cells
        if block.type in ("triangle", "quad", "polygon") and len(block.data)
    ]
    if not polygons:
        raise FeaError(f"{path.name} holds no triangles; give the closed surface of a solid.")
    triangles = np.concatenate(
        [
            np.stack([polygon[:, [0, i, i + 1]] for i in range(1, polygon.shape[1] - 1)], axis=1)
            .reshape(-1, 3)
            for polygon in polygons
        ]
    )  # fmt: skip
    points = _points(mesh, path)
    _check_node_numbers(triangles, len(points), path)
    vertices, number = np.unique(points, axis=0, return_inverse=True)
    triangles = number.reshape(-1)[triangles]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    if len(triangles) == 0:
        raise FeaError(f"{path.name}: all its triangles are flat; give the surface of a solid.")
    used, triangles = np.unique(triangles, return_inverse=True)
    return vertices[used], triangles.reshape(-1, 3).astype(np.int64)


def read_tets(path: Path | str) -> TetMesh:
    """The tetrahedra of a VTU, VTK or Gmsh (MSH) file, with the nodes that they use.

    Other cells, such as the triangles of a boundary, are left out.

    Args:
        path: the file; its suffix tells the format.

    Raises:
        FeaError: the file cannot be read, holds no tetrahedra, or holds tet4 beside tet10.
    """
    path = Path(path)
    mesh = _read(path, (".vtu", ".msh", ".vtk"), "a tet mesh")
    found = [kind for kind in MESHIO_TETS.values() if len(mesh.cells_dict.get(kind, ()))]
    if not found:
        raise FeaError(f"{path.name} holds no tetrahedra; give a mesh of tet4 or of tet10.")
    if len(found) > 1:
        raise FeaError(f"{path.name} holds tet4 and tet10; give a mesh of one kind.")
    tets = np.asarray(mesh.cells_dict[found[0]], np.int64)
    points = _points(mesh, path)
    _check_node_numbers(tets, len(points), path)
    used, number = np.unique(tets, return_inverse=True)
    return TetMesh(points[used], number.reshape(tets.shape).astype(np.int64))


def read_results(path: Path | str) -> ResultMesh:
    """The mesh and all named values of a VTU, VTK, Gmsh (MSH) or XDMF file.

    Values that are no numbers are left out; tensors become rows of their components.

    Args:
        path: the file; its suffix tells the format.

    Raises:
        FeaError: the file cannot be read, or holds cells that are not understood.
    """
    path = Path(path)
    said = io.StringIO()
    # meshio leaves out cells that it does not know and says so on the terminal only.
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        mesh = _read(path, RESULT_SUFFIXES, "a result")
    warning = " ".join(said.getvalue().split())
    if "cannot handle" in warning:
        raise FeaError(
            f"{path.name} cannot be read as a result ({warning[:120]}); divide its cells into "
            "tetrahedra and save it anew as VTU."
        )
    points = _points(mesh, path)
    try:
        require_known(block.type for block in mesh.cells)
    except FeaError as failure:
        raise FeaError(f"{path.name}: {failure}") from failure
    filled = [(k, block) for k, block in enumerate(mesh.cells) if len(block.data)]
    cells = tuple((block.type, np.asarray(block.data, np.int64)) for _, block in filled)
    for _, nodes in cells:
        _check_node_numbers(nodes, len(points), path)
    point_data = {
        name: _rows(values) for name, values in mesh.point_data.items() if _numeric(values)
    }
    cell_data = {
        name: np.concatenate([_rows(blocks[k]) for k, _ in filled])
        for name, blocks in mesh.cell_data.items()
        if filled and all(_numeric(blocks[k]) for k, _ in filled)
    }
    return ResultMesh(points, cells, point_data, cell_data)


def write_tets(
    path: Path | str, mesh: TetMesh, *, node_values: Mapping[str, np.ndarray] | None = None
) -> None:
    """Write a tet mesh, and values at its nodes, as VTU (ParaView) or MSH (Gmsh 4.1).

    Args:
        path: the file; its suffix, .vtu or .msh, tells the format.
        mesh: what to write.
        node_values: named arrays whose first axis is the nodes, such as displacement or stress.

    Raises:
        FeaError: unknown suffix, values for other than the nodes, or a file that cannot be written.
    """
    import meshio

    path = Path(path)
    writers = {".vtu": "vtu", ".msh": "gmsh"}
    if path.suffix.lower() not in writers:
        raise FeaError(f'{path.name}: the suffix must be .vtu or .msh, not "{path.suffix}".')
    for name, values in (node_values or {}).items():
        if len(values) != len(mesh.nodes):
            raise FeaError(
                f'{path.name}: "{name}" has {len(values)} values, but the mesh has '
                f"{len(mesh.nodes)} nodes."
            )
    written = meshio.Mesh(
        mesh.nodes,
        [(MESHIO_TETS[mesh.tets.shape[1]], mesh.tets)],
        point_data=dict(node_values or {}),
    )
    try:
        meshio.write(path, written, file_format=writers[path.suffix.lower()])
    except OSError as failure:
        raise FeaError(f"{path} cannot be written: {failure.strerror or failure}.") from failure


def _read(path: Path, suffixes: tuple[str, ...], what: str):
    """What meshio makes of a file, by its format's own reader: `meshio.read` prints and exits."""
    suffix = path.suffix.lower()
    if suffix not in suffixes:
        raise FeaError(
            f"{path.name}: {what} is read from {', '.join(suffixes)}, not from "
            f'"{path.suffix}"; convert it.'
        )
    if not path.is_file():
        raise FeaError(f"{path} is not a file; check the path.")
    try:
        # The STL reader takes an ASCII file's words for a count of triangles, which overflows.
        with np.errstate(over="ignore"):
            return _readers()[suffix](str(path))
    except ModuleNotFoundError as failure:
        raise FeaError(
            f"{path.name} keeps its values in an HDF5 file, which takes the package {failure.name} to "
            "read: install it, or save the results as VTU."
        ) from failure
    # Readers meet broken bytes with whatever they happen to raise, even with SystemExit.
    except (Exception, SystemExit) as failure:
        reason = " ".join(str(failure).split())[:120]
        raise FeaError(
            f"{path.name} cannot be read as {what}{f' ({reason})' if reason else ''}; write it anew."
        ) from failure


def _readers() -> dict[str, Callable]:
    import meshio  # Takes a tenth of a second; programs that read no file do without.

    return {
        ".stl": meshio.stl.read,
        ".obj": meshio.obj.read,
        ".ply": meshio.ply.read,
        ".vtu": meshio.vtu.read,
        ".vtk": _read_vtk,
        ".msh": meshio.gmsh.read,
        ".xdmf": meshio.xdmf.read,
        ".xmf": meshio.xdmf.read,
    }


def _read_vtk(name: str):
    """A legacy VTK file, also as VTK itself writes it.

    It writes the array that is active as SCALARS, of any number of components, while meshio keeps to
    the letter of the format; as a FIELD the same bytes are lawful. (VTK's own reader is no remedy: it
    takes a file that breaks off for a whole one.)
    """
    import meshio

    content = Path(name).read_bytes()
    dataset = re.search(rb"^DATASET (\w+)", content, re.MULTILINE)
    if dataset and dataset[1] != b"UNSTRUCTURED_GRID":
        raise ValueError(f"its DATASET is a {dataset[1].decode()}, not an UNSTRUCTURED_GRID")
    lawful = VTK_SCALARS.sub(lambda found: _as_field(content, found), content)
    types = VTK_TYPES if content.startswith(b"# vtk DataFile Version 5") else C_TYPES
    lawful = VTK_ARRAY.sub(
        lambda found: b"%b %b" % (found[1], types.get(found[2].lower(), found[2])), lawful
    )
    with tempfile.TemporaryDirectory() as folder:
        rewritten = Path(folder) / "lawful.vtk"
        rewritten.write_bytes(lawful)
        return meshio.vtk.read(rewritten)


def _as_field(content: bytes, found: re.Match[bytes]) -> bytes:
    """The head of a FIELD of one array, for that of SCALARS."""
    name, kind, components = found.groups(default=b"1")
    *_, count = re.findall(rb"^(?:POINT|CELL)_DATA (\d+)", content[: found.start()], re.MULTILINE)
    return b"FIELD FieldData 1\n%b %b %b %b\n" % (name, components, count, kind)


def _numeric(values: np.ndarray) -> bool:
    return np.issubdtype(np.asarray(values).dtype, np.number)


def _rows(values: np.ndarray) -> Float[np.ndarray, "_ _"]:
    """Values as floating-point rows, one a point or cell."""
    values = np.asarray(values, np.float64)
    return values.reshape(len(values), math.prod(values.shape[1:]))


def _points(mesh, path: Path) -> Float[np.ndarray, "nodes 3"]:
    points = np.asarray(mesh.points, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise FeaError(f"{path.name}: its points are not in space; give three coordinates.")
    if not np.isfinite(points).all():
        raise FeaError(f"{path.name}: some coordinates are not numbers; write it anew.")
    return points


def _check_node_numbers(cells: Int[np.ndarray, "cells corners"], points: int, path: Path) -> None:
    if cells.min() < 0 or cells.max() >= points:
        raise FeaError(
            f"{path.name}: cells refer to points {cells.min()} to {cells.max()}, but the file has "
            f"points 0 to {points - 1}; write it anew, without relative indices."
        )
