"""Results on meshes of any cells: how much space each cell and node stands for."""

import numpy as np
import pytest

from fea import FeaError, TetMesh
from fea.result_mesh import ResultMesh

CUBE = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
    dtype=float,
)
# A shear and a stretch of volume 6.
SHEARED = CUBE @ np.array([[1.0, 0, 0], [0.4, 2, 0], [-0.3, 0.7, 3]])


def mesh_of(kind, nodes, points=SHEARED):
    return ResultMesh(points, ((kind, np.array(nodes)),), {}, {})


@pytest.mark.parametrize(
    ("kind", "nodes", "share"),
    [
        ("hexahedron", range(8), 1),
        ("hexahedron", [4, 5, 6, 7, 0, 1, 2, 3], 1),  # numbered from the other side
        ("wedge", [0, 1, 2, 4, 5, 6], 1 / 2),
        ("pyramid", [0, 1, 2, 3, 4], 1 / 3),
        ("tetra", [0, 1, 3, 4], 1 / 6),
    ],
)
def test_solid_cells_have_their_share_of_a_parallelepiped(kind, nodes, share):
    mesh = mesh_of(kind, [list(nodes)])
    np.testing.assert_allclose(mesh.cell_volumes, 6 * share, rtol=1e-12)
    np.testing.assert_allclose(mesh.node_volumes.sum(), 6 * share, rtol=1e-12)


def test_sheets_count_by_area_and_bars_by_length():
    np.testing.assert_allclose(mesh_of("quad", [[0, 1, 2, 3]], CUBE * 3).cell_volumes, 9)
    np.testing.assert_allclose(mesh_of("triangle", [[0, 1, 2]], CUBE * 3).cell_volumes, 4.5)
    np.testing.assert_allclose(mesh_of("line", [[0, 6]], CUBE).cell_volumes, 3**0.5)


def test_nodes_on_edges_share_but_do_not_bend_the_cell():
    box = TetMesh.box((3.0, 2.0, 1.0), (2, 2, 1)).to_tet10()
    mesh = mesh_of("tetra10", box.tets, box.nodes)
    np.testing.assert_allclose(mesh.cell_volumes.sum(), 6, rtol=1e-12)
    np.testing.assert_allclose(mesh.node_volumes.sum(), 6, rtol=1e-12)
    assert mesh.node_volumes.min() > 0


def test_triangles_around_a_solid_count_nothing():
    blocks = (("tetra", np.array([[0, 1, 3, 4]])), ("triangle", np.array([[0, 1, 3], [1, 2, 3]])))
    mesh = ResultMesh(CUBE, blocks, {}, {})
    np.testing.assert_allclose(mesh.cell_volumes, [1 / 6, 0, 0], rtol=1e-12)
    assert mesh.node_volumes[2] == 0
    np.testing.assert_allclose(mesh.cell_centres[1], [1 / 3, 1 / 3, 0])


def test_the_longest_cell_is_measured_across_its_corners():
    np.testing.assert_allclose(mesh_of("hexahedron", [range(8)], CUBE).longest_cell, 3**0.5)
    assert ResultMesh(CUBE, (), {}, {}).longest_cell == 0


def test_cells_of_unknown_kind_are_refused():
    with pytest.raises(FeaError, match="kind polyhedron8 are not understood, only vertex, line"):
        mesh_of("polyhedron8", [range(8)])
