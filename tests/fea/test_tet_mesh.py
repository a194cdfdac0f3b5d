import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fea import FeaError, TetMesh
from fea.elements import TETRAHEDRON_EDGES
from fea.isoparametric import facet_points
from fea.quadrature import TRIANGLE_4
from fea.tet_mesh import RIGHTED


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
    wrong = mesh.tets.copy()
    wrong[7, 2] = 36
    with pytest.raises(FeaError, match=r"refer to nodes 0 to 36, .* cell 7, with node 36"):
        TetMesh(mesh.nodes, wrong)
    with pytest.raises(FeaError, match="no tetrahedra"):
        TetMesh(mesh.nodes, mesh.tets[:0])
    with pytest.raises(FeaError, match="float32, single precision"):
        TetMesh(mesh.nodes.astype(np.float32), mesh.tets)


# Curved cells -------------------------------------------------------------------------------


def curved_box():
    """A quadratic map of a straight mesh, which quadratic cells follow exactly."""
    mesh = box("tet10")
    x, y, z = (mesh.nodes - [1.0, 2.0, 3.0]).T
    return mesh.with_nodes(np.stack([x + 0.1 * y * z, y + 0.1 * x**2, z + 0.2 * x * y], axis=1))


def test_volume_of_curved_cells_is_exact():
    """Each cell against 5³ Gauss points collapsed onto it (Duffy), exact for the cubic det J.

    The degree-2 rule that stiffness uses is off by 6e-6 on single cells.
    """
    mesh = curved_box()
    t, w = np.polynomial.legendre.leggauss(5)
    t, w = (t + 1) / 2, w / 2
    r, s, u = (a.ravel() for a in np.meshgrid(t, t, t, indexing="ij"))
    weight = (w[:, None, None] * w[None, :, None] * w[None, None, :]).ravel()
    points = np.stack([r, (1 - r) * s, (1 - r) * (1 - s) * u], axis=1)
    J = np.einsum("cnx,qnr->cqxr", mesh.nodes[mesh.tets], mesh.element_type.gradient(points))
    exact = np.linalg.det(J) @ (weight * (1 - r) ** 2 * (1 - s))
    np.testing.assert_allclose(mesh.volumes, exact, rtol=1e-13)
    assert mesh.curved.all()
    stiffness_rule = mesh.jacobians @ mesh.element_type.quadrature.weights
    assert np.abs(stiffness_rule / exact - 1).max() > 1e-6
    # The divergence theorem: on quadratic facets x.n has degree 4, which their rule integrates.
    x, n = facet_points(mesh.nodes[mesh.boundary_facets], TRIANGLE_4)
    np.testing.assert_allclose((x * n).sum() / 3, mesh.volume, rtol=1e-13)
    mesh.check()


def test_straight_cells_are_seen_to_be_straight_wherever_they_are():
    mesh = box("tet10")
    R = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    turned = mesh.with_nodes(1e3 * mesh.nodes @ R.T + 1e4)
    assert not mesh.curved.any()
    assert not turned.curved.any()
    bent = mesh.nodes.copy()
    bent[mesh.tets[3, 4]] += 1e-9
    assert mesh.with_nodes(bent).curved[3]
    assert not box().curved.any()


# Faces --------------------------------------------------------------------------------------


def slow_faces(mesh):
    """Cells of each face, by a dictionary of corner sets."""
    owners = {}
    for cell, tet in enumerate(mesh.tets):
        for skipped in range(4):
            face = frozenset(int(n) for n in np.delete(tet[:4], skipped))
            owners.setdefault(face, []).append(cell)
    return owners


@settings(max_examples=20, derandomize=True, deadline=None)
@given(cells=st.sets(st.integers(0, 71), min_size=1))
def test_facets_and_neighbours_are_those_of_a_dictionary_of_faces(cells):
    whole = box("tet10")
    mesh = TetMesh(whole.nodes, whole.tets[sorted(cells)])
    owners = slow_faces(mesh)
    outer = {face for face, cells in owners.items() if len(cells) == 1}
    assert {frozenset(map(int, row[:3])) for row in mesh.boundary_facets} == outer
    assert len(mesh.boundary_facets) == len(outer)
    pairs = sorted(sorted(cells) for cells in owners.values() if len(cells) == 2)
    assert sorted(sorted(map(int, pair)) for pair in mesh.face_neighbours) == pairs


def test_node_numbers_too_large_for_one_key_give_the_same_faces():
    """Three node numbers beyond 2^21 do not fit in 63 bits: two keys are sorted instead."""
    mesh = box()
    shift = 2**21
    far = TetMesh(np.concatenate([np.zeros((shift, 3)), mesh.nodes]), mesh.tets + shift)
    np.testing.assert_array_equal(far.boundary_facets, mesh.boundary_facets + shift)
    np.testing.assert_array_equal(
        np.unique(np.sort(far.face_neighbours, axis=1), axis=0),
        np.unique(np.sort(mesh.face_neighbours, axis=1), axis=0),
    )


def test_moved_nodes_keep_the_numbering():
    mesh = box("tet10")
    facets = mesh.boundary_facets
    moved = mesh.with_nodes(2 * mesh.nodes)
    assert moved.boundary_facets is facets
    np.testing.assert_allclose(moved.volume, 8 * mesh.volume)
    np.testing.assert_allclose(moved.facet_areas, 4 * mesh.facet_areas)
    with pytest.raises(FeaError, match="Moved nodes have shape"):
        mesh.with_nodes(mesh.nodes[:-1])


# Regions ------------------------------------------------------------------------------------


@pytest.mark.parametrize("element", ["tet4", "tet10"])
def test_regions_are_chosen_by_position(element):
    mesh = box(element)
    top = mesh.facets_where(lambda x: x[:, 2] > 4 - 1e-9)
    np.testing.assert_allclose(mesh.facet_integrals(top)[0].sum(), 6.0)
    assert (mesh.nodes[top][..., 2] == 4).all()
    nodes = mesh.nodes_where(lambda x: x[:, 2] > 4 - 1e-9)
    np.testing.assert_array_equal(nodes, np.unique(top))


def test_regions_that_choose_nothing_or_make_no_sense_are_refused():
    mesh = box()
    with pytest.raises(FeaError, match=r"none of the 36 nodes; .* \(1, 2, 3\) to \(4, 4, 4\)"):
        mesh.nodes_where(lambda x: x[:, 0] > 5)
    with pytest.raises(FeaError, match="none of the 64 boundary facets"):
        mesh.facets_where(lambda x: x[:, 0] > 5)
    with pytest.raises(FeaError, match="one truth value"):
        mesh.nodes_where(lambda x: x > 1)
    with pytest.raises(FeaError, match="one truth value"):
        mesh.nodes_where(lambda x: x[:, 0])


# Checking -----------------------------------------------------------------------------------


@pytest.mark.parametrize("element", ["tet4", "tet10"])
def test_sound_meshes_pass_at_any_size_and_place(element):
    mesh = box(element)
    for scale, shift in [(1.0, 0.0), (1e-6, 0.0), (1e6, 0.0), (1.0, 1e5)]:
        mesh.with_nodes(scale * mesh.nodes + shift).check()


@pytest.mark.parametrize("element", ["tet4", "tet10"])
def test_inverted_and_flat_cells_are_named_with_place_and_remedy(element):
    mesh = box(element)
    order = RIGHTED[mesh.tets.shape[1]]
    wrong = mesh.tets.copy()
    wrong[[5, 9]] = wrong[[5, 9]][:, order]
    centre = mesh.nodes[mesh.tets[5, :4]].mean(axis=0)
    with pytest.raises(FeaError) as failure:
        TetMesh(mesh.nodes, wrong).check()
    message = str(failure.value)
    assert message.startswith("2 of 72 tetrahedra are flat or inverted: the first, cell 5 ")
    assert f"({centre[0]:.6g}, {centre[1]:.6g}, {centre[2]:.6g}) mm" in message
    assert "volume -0.0833 mm³" in message
    assert "these cells" in message
    # The remedy rights every cell of a mesh that is inside out.
    inside_out = TetMesh(mesh.nodes, mesh.tets[:, order])
    with pytest.raises(FeaError, match=r"72 of 72 .* reorder the nodes of every cell as"):
        inside_out.check()
    TetMesh(mesh.nodes, inside_out.tets[:, order]).check()
    flat = mesh.nodes.copy()
    flat[:, 2] = 0
    with pytest.raises(FeaError, match=r"72 of 72 .* volume 0 mm³; remesh"):
        mesh.with_nodes(flat).check()
    # Rounding gives a flat cell any sign.
    R = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    with pytest.raises(FeaError, match="72 of 72"):
        mesh.with_nodes(flat @ R.T).check()


def test_a_cell_that_folds_at_a_corner_only_is_refused():
    """A mid-edge node past the quarter point: det J changes sign at the corner alone.

    Along an edge with its middle at s the map is 2 s (1 - xi) xi.. ; its slope at the corner is
    4 s - 1, in units of the edge, negative for s < 1/4 (Zienkiewicz and Taylor, quarter points).
    """
    one = TetMesh(np.concatenate([np.zeros((1, 3)), np.eye(3)]), np.arange(4)[None]).to_tet10()
    for share, sound in [(0.26, True), (0.24, False)]:
        nodes = one.nodes.copy()
        nodes[one.tets[0, 4]] = [share, 0, 0]
        bent = one.with_nodes(nodes)
        assert (bent.jacobians > 0).all()
        if sound:
            bent.check()
            continue
        with pytest.raises(FeaError, match=r"curved edges and folds over at \(0, 0, 0\) mm"):
            bent.check()


def test_nodes_that_are_not_numbers_or_not_used_are_named():
    mesh = box()
    broken = mesh.nodes.copy()
    broken[[4, 8], 1] = np.nan, np.inf
    with pytest.raises(FeaError, match=r"2 of 36 nodes .* node 4, is at \(1, nan, 3.5\)"):
        mesh.with_nodes(broken).check()
    loose = TetMesh(np.concatenate([mesh.nodes, np.ones((2, 3))]), mesh.tets)
    with pytest.raises(FeaError, match=r"2 mesh nodes belong to no tetrahedron: .* node 36"):
        loose.check()


def test_cells_listed_twice_are_refused():
    mesh = box()
    twice = TetMesh(mesh.nodes, np.concatenate([mesh.tets, mesh.tets[6:7]]))
    with pytest.raises(FeaError, match=r"Cells .*6.* all share one face, at .*: cells overlap"):
        twice.check()


# Mid-edge nodes -----------------------------------------------------------------------------


def torn(mesh, *, nodes=None):
    """The same cells with mid-edge nodes of their own on the right of x = 2; corners are shared."""
    right = mesh.nodes[mesh.tets[:, :4]].mean(axis=1)[:, 0] > 2
    on_plane = np.flatnonzero(mesh.nodes[:, 0] == 2)
    shared = np.setdiff1d(on_plane, mesh.tets[:, :4]) if nodes is None else nodes
    number = np.arange(len(mesh.nodes))
    number[shared] = len(mesh.nodes) + np.arange(len(shared))
    tets = mesh.tets.copy()
    tets[right] = number[tets[right]]
    return TetMesh(np.concatenate([mesh.nodes, mesh.nodes[shared]]), tets), right, shared


def test_cells_that_share_corners_but_not_the_node_between_are_refused():
    whole = box("tet10")
    mesh, right, shared = torn(whole)
    assert len(shared) == 16  # Euler: 2 x 2 squares with a diagonal each have 16 edges
    with pytest.raises(FeaError, match=r"16 edges have more than one mid-edge node"):
        mesh.check()
    # A single edge is found, and named.
    node = shared[5]
    mesh, right, _ = torn(whole, nodes=np.array([node]))
    with pytest.raises(FeaError) as failure:
        mesh.check()
    message = str(failure.value)
    cells, edges = np.nonzero(whole.tets[:, 4:] == node)
    a, b = np.sort(whole.tets[cells[0], TETRAHEDRON_EDGES[edges[0]]])
    x, y, z = (whole.nodes[a] + whole.nodes[b]) / 2
    assert message.startswith("1 edges have more than one")
    assert f"between nodes {a} and {b} at ({x:.6g}, {y:.6g}, {z:.6g}) mm" in message
    found = re.search(r"has node (\d+) in cell (\d+) and node (\d+) in cell (\d+); merge", message)
    one, in_one, two, in_two = (int(word) for word in found.groups())
    assert {one, two} == {node, len(whole.nodes)}
    assert one in mesh.tets[in_one, 4:] and two in mesh.tets[in_two, 4:]
    assert right[in_one] != right[in_two]
    # The remedy.
    tets = np.where(mesh.tets == two, one, mesh.tets) if two > one else mesh.tets
    tets = np.where(mesh.tets == one, two, mesh.tets) if two < one else tets
    TetMesh(whole.nodes, tets).check()


def test_cells_in_the_node_order_of_gmsh_are_refused():
    whole = box("tet10")
    gmsh = TetMesh(whole.nodes, whole.tets[:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]])
    with pytest.raises(FeaError) as failure:
        gmsh.check()
    message = str(failure.value)
    assert "mid-edge nodes lie on more than one edge" in message
    found = re.search(
        r"node (\d+) at .* between nodes (\d+) and (\d+) in cell (\d+) and between nodes "
        r"(\d+) and (\d+) in cell (\d+); list",
        message,
    )
    node, a, b, one, c, d, two = (int(word) for word in found.groups())
    assert {a, b} != {c, d}
    for cell, ends in ((one, {a, b}), (two, {c, d})):
        edge = list(gmsh.tets[cell, 4:]).index(node)
        assert set(gmsh.tets[cell, TETRAHEDRON_EDGES[edge]]) == ends
    TetMesh(whole.nodes, gmsh.tets[:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]]).check()


def test_a_corner_on_a_neighbours_edge_is_refused():
    """Two small cells against the edge of a large one: a hanging node."""
    nodes = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2], [1, 0, 0], [0, -2, 0]])
    large = TetMesh(nodes[:4], np.array([[0, 1, 2, 3]])).to_tet10()
    small = TetMesh(nodes[[0, 4, 3, 5]], np.array([[0, 1, 2, 3]])).to_tet10()
    both = np.concatenate([large.nodes, small.nodes])
    tets = np.concatenate([large.tets, small.tets + len(large.nodes)])
    TetMesh(both, tets).check()  # apart
    corner, middle = tets[1, 1], tets[0, 4]
    np.testing.assert_array_equal(both[corner], both[middle])
    hanging = TetMesh(both, np.where(tets == corner, middle, tets))
    message = rf"1 nodes are corners .* node {middle} at \(1, 0, 0\) mm, is a corner of cell 1 and"
    with pytest.raises(FeaError, match=message + r" between nodes 0 and 1 in cell 0"):
        hanging.check()


@settings(max_examples=15, derandomize=True, deadline=None)
@given(cells=st.sets(st.integers(0, 71), min_size=1), seed=st.integers(0, 99))
def test_mid_edge_nodes_of_any_cells_in_any_numbering_are_sound(cells, seed):
    whole = box("tet10")
    used, tets = np.unique(whole.tets[sorted(cells)], return_inverse=True)
    turn = np.random.default_rng(seed).permutation(len(used))
    nodes = np.zeros((len(used), 3))
    nodes[turn] = whole.nodes[used]
    TetMesh(nodes, turn[tets.reshape(-1, 10)]).check()
