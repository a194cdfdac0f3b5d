"""Surfaces and tet meshes survive their files; other files are refused in one sentence."""

import struct
import sys

import numpy as np
import pytest
import pyvista
from vtkmodules.vtkIOLegacy import vtkUnstructuredGridWriter

from fea import FeaError, TetMesh
from fea.ftetwild import enclosed_volume
from fea.mesh_files import read_results, read_surface, read_tets, write_tets

BOX = TetMesh.box((3.0, 2.0, 1.0), (2, 2, 1))

TETRAHEDRON_OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def ascii_stl(corners) -> str:
    facets = [
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in triangle)
        + "endloop\nendfacet\n"
        for triangle in corners
    ]
    return "solid box\n" + "".join(facets) + "endsolid box\n"


def binary_stl(corners) -> bytes:
    facets = [
        struct.pack("<12fH", 0, 0, 0, *np.asarray(triangle, "<f4").ravel(), 0)
        for triangle in corners
    ]
    return b"\0" * 80 + struct.pack("<I", len(facets)) + b"".join(facets)


@pytest.mark.parametrize("binary", [False, True], ids=["ascii", "binary"])
def test_an_stl_becomes_a_closed_surface_of_shared_vertices(tmp_path, binary):
    """STL repeats each vertex in every triangle; merged, V - E + F = 2 with E = 3F/2."""
    corners = BOX.nodes[BOX.boundary_facets]
    path = tmp_path / "box.STL"
    path.write_bytes(binary_stl(corners) if binary else ascii_stl(corners).encode())
    vertices, triangles = read_surface(path)
    assert len(vertices) - len(triangles) // 2 == 2
    assert enclosed_volume(vertices, triangles) == pytest.approx(6)


def test_an_obj_of_quads_is_cut_into_triangles(tmp_path):
    path = tmp_path / "cube.obj"
    corners = [
        (0, 0, 0),
        (1, 0, 0),
        (1, 1, 0),
        (0, 1, 0),
        (0, 0, 1),
        (1, 0, 1),
        (1, 1, 1),
        (0, 1, 1),
    ]
    quads = ["4 3 2 1", "5 6 7 8", "1 2 6 5", "2 3 7 6", "3 4 8 7", "4 1 5 8"]
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
    path.write_text(text + "".join(f"f {quad}\n" for quad in quads))
    vertices, triangles = read_surface(path)
    assert triangles.shape == (12, 3)
    assert enclosed_volume(vertices, triangles) == pytest.approx(1)


def test_a_ply_is_read(tmp_path):
    path = tmp_path / "tetrahedron.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\n"
        "property double z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
        "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"
    )
    vertices, triangles = read_surface(path)
    assert enclosed_volume(vertices, triangles) == pytest.approx(1 / 6)


def test_triangles_that_lose_a_corner_and_vertices_that_nothing_uses_go(tmp_path):
    path = tmp_path / "tetrahedron.obj"
    path.write_text("v 9 9 9\nv 0 0 0\n" + TETRAHEDRON_OBJ.replace("f ", "f ") + "f 2 2 4\n")
    # The first lines moved the numbers on by two: only their shape matters here.
    vertices, triangles = read_surface(path)
    assert (np.sort(np.unique(triangles)) == np.arange(len(vertices))).all()
    assert all(len(set(triangle)) == 3 for triangle in triangles.tolist())


@pytest.mark.parametrize("suffix", [".vtu", ".msh"])
@pytest.mark.parametrize("element", ["tet4", "tet10"])
def test_tets_come_back_as_they_were_written(tmp_path, suffix, element):
    mesh = BOX if element == "tet4" else BOX.to_tet10()
    path = tmp_path / f"box{suffix}"
    write_tets(path, mesh, node_values={"displacement": mesh.nodes})
    again = read_tets(path)
    assert again.element == element
    # Mid-edge nodes in the same order: the volumes of curved cells depend on it.
    np.testing.assert_array_equal(again.nodes[again.tets], mesh.nodes[mesh.tets])


def test_gmsh_files_hold_boundary_cells_too_and_their_own_order_of_mid_edge_nodes(tmp_path):
    """Gmsh 2.2 ASCII, type 11: nodes 9 and 10 are the edges 32 and 31 (Gmsh manual, section 9.3.2)."""
    x = BOX.to_tet10()
    corners = x.nodes[x.tets[0]][[0, 1, 2, 3, 4, 5, 6, 7, 9, 8]]
    nodes = "".join(f"{i + 2} {a} {b} {c}\n" for i, (a, b, c) in enumerate(corners))
    path = tmp_path / "one.msh"
    path.write_text(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n11\n1 9 9 9\n"
        + nodes
        + "$EndNodes\n$Elements\n2\n1 15 2 1 1 1\n2 11 2 1 1 2 3 4 5 6 7 8 9 10 11\n$EndElements\n"
    )
    mesh = read_tets(path)
    assert len(mesh.nodes) == 10
    assert mesh.volume == pytest.approx(x.volumes[0])
    np.testing.assert_allclose(mesh.nodes[mesh.tets[0]], x.nodes[x.tets[0]])


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("part.step", "ISO-10303-21;", r"a surface is read from \.stl, \.obj, \.ply"),
        ("part.stl", "this is not a mesh", "cannot be read as a surface|holds no triangles"),
        ("part.stl", "", "cannot be read as a surface|holds no triangles"),
        ("part.obj", "v 0 0 0\nv 1 0 0\n", "holds no triangles"),
        ("part.obj", "v 0 0 0\nv 1 0 0\nf 1 2 9\n", "refer to points 0 to 8, but the file has"),
        ("part.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n", "without relative indices"),
        ("part.obj", "v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n", "not numbers"),
        ("part.obj", "v 0 0 0\nv 1 0 0\nv 0 0 0\nf 1 2 3\n", "triangles are flat"),
        ("part.ply", "ply\nformat", "cannot be read as a surface"),
    ],
)
def test_files_that_are_no_surface_are_refused(tmp_path, capfd, name, content, words):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(FeaError, match=words):
        read_surface(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("tets.inp", "*HEADING", r"a tet mesh is read from \.vtu, \.msh, \.vtk"),
        ("tets.vtu", "not XML", "cannot be read as a tet mesh"),
        ("tets.msh", "$MeshFormat\n", "cannot be read as a tet mesh"),
        ("tets.vtk", "", "cannot be read as a tet mesh"),
    ],
)
def test_files_that_are_no_tet_mesh_are_refused(tmp_path, capfd, name, content, words):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(FeaError, match=words):
        read_tets(path)
    assert capfd.readouterr() == ("", "")


def test_a_mesh_without_tets_or_of_two_kinds_is_refused(tmp_path):
    """Gmsh 2.2 ASCII; type 2 is a triangle, 4 a tet4, 11 a tet10."""
    mesh = BOX.to_tet10()
    head = f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{len(mesh.nodes)}\n"
    nodes = "".join(f"{i + 1} {a} {b} {c}\n" for i, (a, b, c) in enumerate(mesh.nodes))
    path = tmp_path / "mesh.msh"

    def elements(*lines: str) -> None:
        body = "".join(f"{i + 1} {line}\n" for i, line in enumerate(lines))
        path.write_text(f"{head}{nodes}$EndNodes\n$Elements\n{len(lines)}\n{body}$EndElements\n")

    elements("2 2 1 1 1 2 3")
    with pytest.raises(FeaError, match="holds no tetrahedra"):
        read_tets(path)
    ten = " ".join(str(n + 1) for n in mesh.tets[0])
    elements("4 2 1 1 1 2 3 4", f"11 2 1 1 {ten}")
    with pytest.raises(FeaError, match="holds tet4 and tet10"):
        read_tets(path)


def test_a_file_that_is_not_there_is_one_sentence(tmp_path):
    with pytest.raises(FeaError, match="is not a file; check the path"):
        read_tets(tmp_path / "none.vtu")


def test_impossible_writing_is_refused(tmp_path):
    with pytest.raises(FeaError, match=r"must be \.vtu or \.msh"):
        write_tets(tmp_path / "box.stl", BOX)
    with pytest.raises(FeaError, match='"u" has 1 values, but the mesh has'):
        write_tets(tmp_path / "box.vtu", BOX, node_values={"u": np.zeros((1, 3))})
    with pytest.raises(FeaError, match="cannot be written"):
        write_tets(tmp_path / "none" / "box.vtu", BOX)


def results(kind):
    """A box of hexahedra or tetrahedra with all kinds of values, as PyVista holds it."""
    x, y, z = np.meshgrid(*(np.arange(n) for n in (4.0, 3.0, 2.0)), indexing="ij")
    mesh = pyvista.StructuredGrid(x, y, z).cast_to_unstructured_grid()
    mesh = mesh if kind == "hexahedron" else mesh.triangulate()
    random = np.random.default_rng(0)
    mesh.point_data["S_Mises"] = random.random(mesh.n_points)
    mesh.point_data["S"] = random.random((mesh.n_points, 6))
    mesh.cell_data["T"] = random.random((mesh.n_cells, 9))
    mesh.cell_data["region"] = np.arange(mesh.n_cells)
    mesh.cell_data["small"] = np.arange(mesh.n_cells, dtype=np.int32)
    return mesh


@pytest.mark.parametrize("kind", ["hexahedron", "tetra"])
@pytest.mark.parametrize("binary", [True, False], ids=["binary", "ascii"])
@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
def test_results_that_pyvista_writes_are_read(tmp_path, kind, binary, suffix):
    mesh, path = results(kind), tmp_path / f"results{suffix}"
    mesh.save(path, binary=binary)
    found = read_results(path)
    assert [(name, len(cells)) for name, cells in found.cells] == [(kind, mesh.n_cells)]
    np.testing.assert_allclose(found.points, mesh.points)
    # ASCII files round to what a reader needs for single precision, about 1e-6.
    for name, values in mesh.point_data.items():
        np.testing.assert_allclose(found.point_data[name].squeeze(), values, rtol=1e-5)
    for name, values in mesh.cell_data.items():
        np.testing.assert_allclose(found.cell_data[name].squeeze(), values, rtol=1e-5)
    np.testing.assert_allclose(found.cell_volumes.sum(), 6)


@pytest.mark.parametrize("binary", [True, False], ids=["binary", "ascii"])
def test_legacy_results_of_the_older_version_are_read(tmp_path, binary):
    mesh, path = results("tetra"), tmp_path / "results.vtk"
    writer = vtkUnstructuredGridWriter()
    writer.SetFileVersion(writer.VTK_LEGACY_READER_VERSION_4_2)
    writer.SetFileType(2 if binary else 1)
    writer.SetFileName(str(path))
    writer.SetInputData(mesh)
    writer.Write()
    found = read_results(path)
    assert path.read_bytes().startswith(b"# vtk DataFile Version 4.2")
    for name, values in {**mesh.point_data, **mesh.cell_data}.items():
        read = {**found.point_data, **found.cell_data}[name]
        np.testing.assert_allclose(read.squeeze(), values, rtol=1e-5)


def test_legacy_grids_without_cells_of_their_own_are_refused(tmp_path):
    pyvista.ImageData(dimensions=(4, 3, 2)).save(tmp_path / "grid.vtk")
    with pytest.raises(FeaError, match="is a STRUCTURED_POINTS, not an UNSTRUCTURED_GRID"):
        read_results(tmp_path / "grid.vtk")


@pytest.mark.parametrize("compression", ["zlib", "lzma", None])
def test_compressed_results_are_read(tmp_path, compression):
    mesh, path = results("tetra"), tmp_path / "results.vtu"
    mesh.save(path, compression=compression)
    np.testing.assert_array_equal(read_results(path).point_data["S"], mesh.point_data["S"])


def test_results_of_gmsh_are_read(tmp_path):
    """Gmsh 2.2 ASCII: a view at the nodes; the triangle of the boundary counts nothing."""
    path = tmp_path / "one.msh"
    path.write_text(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n"
        "$EndNodes\n$Elements\n2\n1 2 2 1 1 1 2 3\n2 4 2 1 1 1 2 3 4\n$EndElements\n$NodeData\n1\n"
        '"S_Mises"\n1\n0.0\n3\n0\n1\n4\n1 1.5\n2 2.5\n3 3.5\n4 4.5\n$EndNodeData\n'
    )
    found = read_results(path)
    np.testing.assert_allclose(found.point_data["S_Mises"].squeeze(), [1.5, 2.5, 3.5, 4.5])
    np.testing.assert_allclose(found.cell_volumes, [0, 1 / 6])


XDMF = """<?xml version="1.0"?><Xdmf Version="3.0"><Domain><Grid Name="Grid">
<Geometry GeometryType="XYZ"><DataItem DataType="Float" Dimensions="4 3" Format="XML" Precision="8">
0 0 0 1 0 0 0 1 0 0 0 1</DataItem></Geometry>
<Topology TopologyType="Tetrahedron" NumberOfElements="1">
<DataItem DataType="Int" Dimensions="1 4" Format="XML" Precision="8">0 1 2 3</DataItem></Topology>
<Attribute Name="S_Mises" AttributeType="Scalar" Center="Node">
<DataItem DataType="Float" Dimensions="4" Format="XML" Precision="8">1 2 3 4</DataItem></Attribute>
<Attribute Name="S" AttributeType="Tensor6" Center="Cell">
<DataItem DataType="Float" Dimensions="1 6" Format="XML" Precision="8">1 2 3 4 5 6</DataItem>
</Attribute></Grid></Domain></Xdmf>"""


def test_results_of_xdmf_are_read(tmp_path):
    path = tmp_path / "results.xdmf"
    path.write_text(XDMF)
    found = read_results(path)
    np.testing.assert_array_equal(found.point_data["S_Mises"].squeeze(), [1, 2, 3, 4])
    np.testing.assert_array_equal(found.cell_data["S"], [[1, 2, 3, 4, 5, 6]])


def test_xdmf_with_hdf5_asks_for_the_package_where_it_is_missing(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)  # an import of it then fails
    path = tmp_path / "results.xdmf"
    heavy = XDMF.replace('Format="XML" Precision="8">1 2 3 4<', 'Format="HDF">r.h5:/s<')
    path.write_text(heavy)
    with pytest.raises(FeaError, match="HDF5 file, which takes the package h5py"):
        read_results(path)


def test_cells_that_would_be_lost_are_refused(tmp_path, capfd):
    """Voxels, VTK's type 11: meshio leaves them out with a warning on the terminal."""
    mesh = pyvista.ImageData(dimensions=(3, 3, 3)).cast_to_unstructured_grid()
    path = tmp_path / "voxels.vtu"
    mesh.save(path)
    with pytest.raises(FeaError, match=r"cannot handle \(type 11\).*divide its cells"):
        read_results(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
def test_results_that_break_off_are_refused(tmp_path, suffix):
    path = tmp_path / f"results{suffix}"
    results("tetra").save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FeaError, match="cannot be read as a result"):
        read_results(path)


def test_results_in_formats_of_other_programs_are_refused(tmp_path):
    with pytest.raises(FeaError, match=r"a result is read from .vtu, .vtk, .msh, .xdmf"):
        read_results(tmp_path / "results.odb")
