"""Surfaces and tet meshes survive their files; other files are refused in one sentence."""

import struct

import numpy as np
import pytest

from fea import FeaError, TetMesh
from fea.ftetwild import enclosed_volume
from fea.mesh_files import read_surface, read_tets, write_tets

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
