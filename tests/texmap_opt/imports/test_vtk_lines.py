"""Lines of VTK files in every way that VTK writes them, and what breaks."""

import base64
import zlib
from pathlib import Path

import numpy as np
import pytest
import pyvista
from hypothesis import given, settings
from hypothesis import strategies as st
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkFloatArray, vtkLookupTable
from vtkmodules.vtkIOLegacy import vtkPolyDataWriter, vtkUnstructuredGridWriter
from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter, vtkXMLUnstructuredGridWriter

from texmap_opt.errors import StructureError
from texmap_opt.export.vtk import write_struts
from texmap_opt.imports.imported import Imported
from texmap_opt.imports.vtk_lines import read_vtk_lines
from texmap_opt.structure.structure import Extrusion, Origin, Structure

POINTS = np.array([[0.1, 0, 0], [1, 0, 1 / 3], [2, 0, 0], [2, 3, 0], [9, 9, 9], [0, 1, 0]])
RADII = np.array([0.1, 0.2, 1 / 3, 0.4, 9, 0.6])
STRUTS = [[0, 1], [1, 2], [2, 3], [3, 0]]


def lines() -> pyvista.PolyData:
    """A line through three points, two of two, a vertex and a triangle; radii at points and lines."""
    mesh = pyvista.PolyData()
    mesh.points = POINTS
    mesh.verts = [1, 4]
    mesh.lines = [3, 0, 1, 2, 2, 2, 3, 2, 3, 0]
    mesh.faces = [3, 3, 4, 5]
    mesh.cell_data["mean_radius_mm"] = np.array([7.0, 0.5, 0.25, 0.125, 7])
    mesh.cell_data["kind"] = np.arange(5, dtype=np.int8)
    mesh.point_data["Radius"] = RADII
    mesh.point_data["normals"] = POINTS.astype(np.float32)
    return mesh


def grid() -> pyvista.UnstructuredGrid:
    """The same lines beside a triangle; the one between 2 and 3 bent through point 5."""
    cells = [3, 0, 1, 2, 3, 2, 3, 5, 3, 3, 4, 5, 2, 3, 0]
    types = [pyvista.CellType.POLY_LINE, pyvista.CellType.QUADRATIC_EDGE]
    types += [pyvista.CellType.TRIANGLE, pyvista.CellType.LINE]
    mesh = pyvista.UnstructuredGrid(cells, types, POINTS)
    mesh.point_data["Radius"] = RADII
    mesh.cell_data["mean_radius_mm"] = np.array([0.5, 0.25, 7.0, 0.125])
    return mesh


def read(path: Path, *, radius: float | None = None, mm_per_unit: float = 1.0) -> Imported:
    return read_vtk_lines(path, radius=radius, section="round", mm_per_unit=mm_per_unit)


def assert_read(path: Path, left_out: int) -> None:
    found = read(path)
    s = found.structure
    np.testing.assert_array_equal(s.joints, POINTS[:4])
    np.testing.assert_array_equal(s.struts, STRUTS)
    np.testing.assert_array_equal(s.radii, RADII[np.array(STRUTS)])
    assert found.notes == (f"{left_out} cells that are no lines were left out",)


MODES = {
    "ASCII": lambda w: w.SetDataModeToAscii(),
    "base64": lambda w: w.SetDataModeToBinary(),
    "base64, not compressed": lambda w: (w.SetDataModeToBinary(), w.SetCompressorTypeToNone()),
    "appended bytes": lambda w: (w.SetDataModeToAppended(), w.EncodeAppendedDataOff()),
    "appended base64": lambda w: (w.SetDataModeToAppended(), w.EncodeAppendedDataOn()),
    "appended, not compressed": lambda w: (
        w.SetDataModeToAppended(),
        w.SetCompressorTypeToNone(),
        w.EncodeAppendedDataOff(),
    ),
    "LZMA": lambda w: w.SetCompressorTypeToLZMA(),
    "64-bit header": lambda w: w.SetHeaderTypeToUInt64(),
    "big-endian": lambda w: w.SetByteOrderToBigEndian(),
    "small blocks": lambda w: w.SetBlockSize(48),
}


@pytest.mark.parametrize("mode", sorted(MODES))
@pytest.mark.parametrize("of", [lines, grid])
def test_what_vtk_writes_as_xml_is_read(mode: str, of, tmp_path: Path):
    mesh = of()
    flat = isinstance(mesh, pyvista.PolyData)
    writer = vtkXMLPolyDataWriter() if flat else vtkXMLUnstructuredGridWriter()
    path = tmp_path / ("s.vtp" if flat else "s.vtu")
    writer.SetFileName(str(path))
    MODES[mode](writer)
    writer.SetInputData(mesh)
    assert writer.Write() == 1
    assert_read(path, left_out=2 if flat else 1)


@pytest.mark.parametrize("version", [42, 51])
@pytest.mark.parametrize("binary", [True, False], ids=["binary", "ASCII"])
@pytest.mark.parametrize("of", [lines, grid])
def test_what_vtk_writes_as_legacy_files_is_read(version: int, *, binary: bool, of, tmp_path: Path):
    mesh = of()
    flat = isinstance(mesh, pyvista.PolyData)
    writer = vtkPolyDataWriter() if flat else vtkUnstructuredGridWriter()
    writer.SetFileName(str(tmp_path / "s.vtk"))
    writer.SetFileVersion(version)
    if binary:
        writer.SetFileTypeToBinary()
    writer.SetInputData(mesh)
    assert writer.Write() == 1
    if binary:
        assert_read(tmp_path / "s.vtk", left_out=2 if flat else 1)
    else:
        # VTK writes ASCII in eleven digits, or fewer.
        s = read(tmp_path / "s.vtk").structure
        np.testing.assert_allclose(s.joints, POINTS[:4], rtol=1e-5)
        np.testing.assert_array_equal(s.struts, STRUTS)
        np.testing.assert_allclose(s.radii, RADII[np.array(STRUTS)], rtol=1e-5)


@pytest.mark.parametrize("binary", [True, False], ids=["binary", "ASCII"])
def test_textures_and_tables_of_colour_are_passed_over(*, binary: bool, tmp_path: Path):
    """Radii are read after a table; the coordinates of a texture stand before fields."""
    mesh = lines()
    del mesh.point_data["Radius"], mesh.cell_data["mean_radius_mm"], mesh.cell_data["kind"]
    texture = vtkFloatArray()
    texture.SetName("texture")
    texture.SetNumberOfComponents(2)
    texture.SetNumberOfTuples(len(POINTS))
    texture.Fill(0.5)
    mesh.GetPointData().SetTCoords(texture)
    radii = numpy_to_vtk(RADII, deep=True)
    radii.SetName("radius")
    table = vtkLookupTable()
    table.SetNumberOfTableValues(5)
    table.Build()
    radii.SetLookupTable(table)
    mesh.GetPointData().SetScalars(radii)
    writer = vtkPolyDataWriter()
    writer.SetFileName(str(tmp_path / "s.vtk"))
    if binary:
        writer.SetFileTypeToBinary()
    writer.SetInputData(mesh)
    assert writer.Write() == 1
    content = (tmp_path / "s.vtk").read_bytes()
    assert b"TEXTURE_COORDINATES" in content
    assert content.count(b"LOOKUP_TABLE") == 2
    s = read(tmp_path / "s.vtk").structure
    np.testing.assert_allclose(s.radii, RADII[np.array(STRUTS)], rtol=1e-5)


def test_two_pieces_are_one_structure(tmp_path: Path):
    lines().save(tmp_path / "one.vtp", binary=False)
    text = (tmp_path / "one.vtp").read_text()
    start, end = text.index("<Piece"), text.index("</Piece>") + len("</Piece>")
    piece = text[start:end]
    other = piece.replace("0.1 0 0 ", "0.1 5 5 ")
    assert other != piece
    (tmp_path / "two.vtp").write_text(text[:end] + other + text[end:])
    assert len(read(tmp_path / "one.vtp").structure.struts) == 4
    with pytest.raises(StructureError, match="repeats an earlier strut"):
        read(tmp_path / "two.vtp")
    other = other.replace("2 0 0 2 3 0", "2 0 7 2 3 7")
    (tmp_path / "two.vtp").write_text(text[:end] + other + text[end:])
    s = read(tmp_path / "two.vtp").structure
    # They share the point (1, 0, 1/3).
    assert (len(s.struts), len(s.joints)) == (8, 7)


def star(section: str = "round") -> Structure:
    rng = np.random.default_rng(6)
    joints = np.concatenate([np.zeros((1, 3)), rng.normal(size=(5, 3))])
    struts = np.stack([np.zeros(5, np.int64), np.arange(1, 6)], axis=1)
    radii = rng.uniform(0.1, 0.2, (5, 2))
    return Structure(joints, struts, radii, np.zeros(6, bool), np.ones(5), section)


def test_our_own_struts_come_back_bit_for_bit(tmp_path: Path):
    """Every strut has its own two points in the file; equal places are one joint again."""
    write_struts(tmp_path / "s.vtp", star(), strut_data={"utilisation": np.zeros(5)})
    again = read(tmp_path / "s.vtp").structure
    np.testing.assert_array_equal(again.joints, star().joints)
    np.testing.assert_array_equal(again.struts, star().struts)
    np.testing.assert_array_equal(again.radii, star().radii)


def test_origin_and_depth_are_written_and_walls_are_refused(tmp_path: Path):
    s = star("wall")
    extrusion = Extrusion(np.array([0.0, 0, 1]), -1.0, 1.0, np.full(5, 2.0))
    origin = Origin(np.arange(5), np.zeros(5, np.int64), ("a",))
    s = Structure(
        s.joints * [1, 1, 0], s.struts, s.radii, s.cut, s.cell_size, "wall", origin, extrusion
    )
    write_struts(tmp_path / "w.vtp", s, strut_data={})
    mesh = pyvista.read(tmp_path / "w.vtp")
    np.testing.assert_array_equal(mesh["depth_mm"], extrusion.depth)
    np.testing.assert_array_equal(mesh["cell"], origin.cell)
    np.testing.assert_array_equal(mesh["kind"], origin.kind)
    with pytest.raises(StructureError, match=r"w\.vtp: its struts are walls"):
        read(tmp_path / "w.vtp")


def test_radii_come_from_points_then_lines_then_the_option(tmp_path: Path):
    mesh = lines()
    mesh.point_data.remove("Radius")
    mesh.save(tmp_path / "s.vtp")
    s = read(tmp_path / "s.vtp", mm_per_unit=10.0).structure
    np.testing.assert_array_equal(s.joints, 10 * POINTS[:4])
    np.testing.assert_array_equal(s.radii[:, 0], [5, 5, 2.5, 1.25])
    mesh.cell_data.remove("mean_radius_mm")
    mesh.save(tmp_path / "s.vtp")
    s = read(tmp_path / "s.vtp", radius=2.0, mm_per_unit=10.0).structure
    np.testing.assert_allclose(s.radii, 2)
    with pytest.raises(StructureError, match=r"s\.vtp: has no array of radii"):
        read(tmp_path / "s.vtp")


def test_files_without_lines_are_refused(tmp_path: Path):
    pyvista.Sphere().save(tmp_path / "ball.vtp")
    pyvista.Sphere().save(tmp_path / "ball.vtk")
    pyvista.ImageData(dimensions=(2, 2, 2)).save(tmp_path / "image.vtk")
    for name, words in {
        "ball.vtp": "it has no lines",
        "ball.vtk": "it has no lines",
        "image.vtk": "DATASET is a STRUCTURED_POINTS",
        "no.vtp": "cannot be read",
    }.items():
        with pytest.raises(StructureError, match=rf"{name}: .*{words}"):
            read(tmp_path / name)


def test_a_compression_that_is_not_known_is_named(tmp_path: Path):
    writer = vtkXMLPolyDataWriter()
    writer.SetFileName(str(tmp_path / "s.vtp"))
    writer.SetCompressorTypeToLZ4()
    writer.SetInputData(lines())
    assert writer.Write() == 1
    with pytest.raises(
        StructureError, match=r"s\.vtp, line 2: vtkLZ4DataCompressor is not underst"
    ):
        read(tmp_path / "s.vtp")


def with_points(tmp_path: Path, array: str) -> Path:
    """A compressed file of lines whose positions are what is given, in base64."""
    lines().save(tmp_path / "s.vtp", binary=False)
    text = (tmp_path / "s.vtp").read_text()
    assert 'header_type="UInt32"' in text
    assert 'compressor="vtkZLibDataCompressor"' in text
    head, _, tail = text.partition('type="Float64" Name="Points"')
    array = f'type="Float64" Name="Points" NumberOfComponents="3" format="binary">{array}'
    path = tmp_path / "b.vtp"
    path.write_text(head + array + "</DataArray>" + tail.partition("</DataArray>")[2])
    return path


@pytest.mark.parametrize(
    "sizes",
    # 2^30 blocks, two gigabytes each of two, and nothing at all: to zlib a limit of 0 bytes is none.
    [(1 << 30, 8, 8), (2, 1 << 31, 1 << 31), (1, 0, 0)],
)
def test_blocks_that_would_unpack_to_more_than_they_say_do_not(sizes, tmp_path: Path):
    packed = zlib.compress(bytes(8 * 3 * 1000))
    packed += bytes(-len(packed) % 4)
    header = np.array([*sizes, *[len(packed)] * min(sizes[0], 2)], "<u4").tobytes()
    array = (base64.b64encode(header) + base64.b64encode(packed)).decode()
    with pytest.raises(StructureError, match="sizes of its compressed blocks do not fit"):
        read(with_points(tmp_path, array))


@pytest.fixture(scope="module", params=["vtp", "ascii.vtp", "vtu", "vtk", "ascii.vtk"])
def whole(request, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes]:
    path = tmp_path_factory.mktemp("vtk") / f"s.{request.param}"
    mesh = grid() if path.suffix == ".vtu" else lines()
    mesh.save(path, binary="ascii" not in path.name)
    return path.with_stem("broken"), path.read_bytes()


@settings(max_examples=80)
@given(place=st.integers(0, 10**6), byte=st.integers(0, 255), end=st.sampled_from([0, 10**6]))
def test_broken_bytes_are_read_or_refused_and_never_a_crash(
    whole: tuple[Path, bytes], place: int, byte: int, end: int
):
    path, content = whole
    place %= len(content)
    # The rest of the file, or nothing.
    path.write_bytes(content[:place] + bytes([byte]) + content[place + 1 : end])
    found = outcome(path)
    if isinstance(found, StructureError):
        assert "broken.v" in str(found)
    else:
        found.structure.validate()


def outcome(path: Path) -> Imported | StructureError:
    try:
        return read(path)
    except StructureError as failure:
        return failure
