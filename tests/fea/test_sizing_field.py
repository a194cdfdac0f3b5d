"""Wanted edges: graded, carried on beyond the solid, counted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fea import FeaError, TetMesh
from fea.elements import TETRAHEDRON_EDGES
from fea.sizing_field import GROWTH, Sizing, graded, nodal_edges, tets_wanted

MESH = TetMesh.box((4.0, 3.0, 2.0), (4, 3, 2))


def value_at(sizing: Sizing, point) -> float | None:
    """Interpolated wanted edge as the mesher takes it: from the tet that holds the point."""
    a, *others = np.moveaxis(sizing.nodes[sizing.tets], 1, 0)
    frames = np.stack([other - a for other in others], axis=-1)
    weights = np.linalg.solve(frames, (np.asarray(point) - a)[..., None])[..., 0]
    weights = np.concatenate([1 - weights.sum(axis=1, keepdims=True), weights], axis=1)
    inside = np.flatnonzero((weights > -1e-9).all(axis=1))
    if len(inside) == 0:
        return None
    return float(weights[inside[0]] @ sizing.edge[sizing.tets[inside[0]]])


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(0.05, 5.0), min_size=60, max_size=60), st.floats(0.1, 1.0))
def test_graded_edges_are_the_largest_that_grow_no_faster(wanted, growth):
    """Below the wish, within the slope along every edge of the mesh, and tight at every node."""
    edge = np.array(wanted)
    sizes = graded(MESH, edge, growth=growth)
    assert (sizes <= edge + 1e-12).all()
    ends = MESH.tets[:, TETRAHEDRON_EDGES].reshape(-1, 2)
    i, j = np.unique(np.sort(ends, axis=1), axis=0).T
    step = growth * np.linalg.norm(MESH.nodes[i] - MESH.nodes[j], axis=1)
    assert (np.abs(sizes[i] - sizes[j]) <= step + 1e-12).all()
    bound = edge.copy()
    np.minimum.at(bound, i, sizes[j] + step)
    np.minimum.at(bound, j, sizes[i] + step)
    np.testing.assert_allclose(sizes, bound, rtol=1e-12)


def test_the_background_holds_points_beyond_the_surface_with_the_edge_of_the_nearest_node():
    edge = 0.2 + 0.1 * MESH.nodes[:, 0]
    sizing = Sizing.around(MESH, edge)
    for point in ([0.5, 1.5, 1.0], [3.5, 0.2, 0.4]):
        assert value_at(sizing, point) == pytest.approx(0.2 + 0.1 * point[0])
    # A surface node of the next mesh may lie outside this one by an envelope.
    for point in ([4.01, 1.5, 1.0], [2.0, 3.02, 2.02], [4.02, 3.02, 2.02], [-0.01, -0.01, -0.01]):
        near = 0.2 + 0.1 * np.clip(point[0], 0, 4)
        assert near * 0.9 < value_at(sizing, point) < near + GROWTH * 0.2
    # Negative control: the mesh alone does not hold them.
    bare = Sizing(MESH.nodes, MESH.tets, edge)
    assert value_at(bare, [4.01, 1.5, 1.0]) is None


def test_a_notch_is_covered_and_the_tets_are_not_flat():
    centre = MESH.nodes[MESH.tets].mean(axis=1)
    notched = MESH.tets[~((centre[:, 0] > 2) & (centre[:, 2] > 1))]
    used, tets = np.unique(notched, return_inverse=True)
    mesh = TetMesh(MESH.nodes[used], tets.reshape(-1, 4))
    sizing = Sizing.around(mesh, np.full(len(mesh.nodes), 0.5))
    assert value_at(sizing, [2.01, 1.5, 1.01]) == pytest.approx(0.5, abs=0.3)
    a, b, c, d = np.moveaxis(sizing.nodes[sizing.tets], 1, 0)
    volume = np.abs(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)) / 6
    assert (volume > 0).all()
    box = np.prod(np.ptp(sizing.nodes, axis=0))
    assert volume.sum() == pytest.approx(box)


def test_edges_at_nodes_are_those_that_meet_there():
    mesh = TetMesh(
        np.array([[0.0, 0, 0], [3.0, 0, 0], [0, 4.0, 0], [0, 0, 12.0]]), np.array([[0, 1, 2, 3]])
    )
    far = np.sqrt([9 + 16, 9 + 144, 16 + 144])
    expected = [(3 + 4 + 12) / 3, (3 + far[0] + far[1]) / 3]
    np.testing.assert_allclose(nodal_edges(mesh)[:2], expected)


def test_half_the_edge_wants_eight_times_the_tets():
    edge = np.full(len(MESH.nodes), 0.8)
    assert tets_wanted(MESH, edge) == pytest.approx(24 / 0.8**3)
    assert tets_wanted(MESH, edge / 2) == pytest.approx(8 * tets_wanted(MESH, edge))


def test_a_scaled_field_wants_every_edge_longer():
    sizing = Sizing.around(MESH, np.full(len(MESH.nodes), 0.5))
    np.testing.assert_allclose(sizing.scaled(1.5).edge, 1.5 * sizing.edge)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_edges_that_are_no_lengths_are_refused(bad):
    edge = np.ones(len(MESH.nodes))
    edge[3] = bad
    with pytest.raises(FeaError, match="lengths above 0"):
        Sizing(MESH.nodes, MESH.tets, edge)


def test_edges_for_other_nodes_are_refused():
    with pytest.raises(FeaError, match="at 3 nodes, but the background mesh has 60"):
        Sizing(MESH.nodes, MESH.tets, np.ones(3))
