import numpy as np
import pytest

from fea import FeaError, TetMesh


def box(element="tet4"):
    mesh = TetMesh.box((3.0, 2.0, 1.0), (3, 2, 2), origin=(1.0, 2.0, 3.0))
    return mesh if element == "tet4" else mesh.to_tet10()


@pytest.mark.parametrize("element", ["tet4", "tet10"])
def test_box_fills_its_volume_with_positive_cells(element):
    mesh = box(element)
    assert mesh.element == element
    assert len(mesh.tets) == 6 * 12
    np.testing.assert_allclose(mesh.volumes, 1 / 12, rtol=1e-12)
    np.testing.assert_allclose(mesh.volume, 6.0, rtol=1e-12)


@pytest.mark.parametrize("element", ["tet4", "tet10"])
def test_boundary_facets_face_outwards_and_close_the_surface(element):
    mesh = box(element)
    centre = np.array([2.5, 3.0, 3.5])
    outward = np.einsum("fx,fx->f", mesh.facet_normals, mesh.facet_centroids - centre)
    assert (outward > 0).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.facet_normals, axis=1), 1, rtol=1e-14)
    np.testing.assert_allclose(mesh.facet_areas.sum(), 2 * (6 + 3 + 2), rtol=1e-12)
    np.testing.assert_allclose(mesh.facet_areas @ mesh.facet_normals, 0, atol=1e-12)
    # The divergence theorem ties the surface to the volume.
    flux = np.einsum("f,fx,fx->", mesh.facet_areas, mesh.facet_normals, mesh.facet_centroids)
    np.testing.assert_allclose(flux / 3, 6.0, rtol=1e-12)


def test_quadratic_mesh_shares_mid_edge_nodes():
    """Euler: edges of the mesh, each counted once, are the nodes added."""
    mesh = box()
    corners = mesh.tets[:, [0, 0, 0, 1, 1, 2, 1, 2, 3, 2, 3, 3]].reshape(-1, 2, 6)
    edges = np.unique(np.sort(corners.transpose(0, 2, 1).reshape(-1, 2), axis=1), axis=0)
    quadratic = mesh.to_tet10()
    assert len(quadratic.nodes) == len(mesh.nodes) + len(edges)
    assert quadratic.to_tet10() is quadratic


def test_facets_of_a_quadratic_mesh_carry_their_mid_edge_nodes():
    mesh = box("tet10")
    x = mesh.nodes[mesh.boundary_facets]
    middle = (x[:, [0, 1, 2]] + x[:, [1, 2, 0]]) / 2
    np.testing.assert_allclose(x[:, 3:], middle, atol=1e-14)


def test_malformed_meshes_are_refused():
    mesh = box()
    with pytest.raises(FeaError, match="5 nodes"):
        TetMesh(mesh.nodes, np.zeros((2, 5), dtype=int))
    with pytest.raises(FeaError, match="refer to nodes"):
        TetMesh(mesh.nodes[:-1], mesh.tets)
    with pytest.raises(FeaError, match="no tetrahedra"):
        TetMesh(mesh.nodes, mesh.tets[:0])
