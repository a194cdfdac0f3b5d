"""Tet meshes of parts: all of the part, positive, on its surface; and how failure looks."""

from pathlib import Path

import numpy as np
import pytest

from fea import TetMesh, ftetwild
from fea.sizing_field import Sizing, graded, nodal_edges
from texmap_opt import tetrahedralise as module
from texmap_opt.builtin_part import builtin_part
from texmap_opt.errors import TetrahedralisationError
from texmap_opt.part import Part
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.tet_surface import fitted_to_surface
from texmap_opt.tetrahedralise import default_edge_mm, estimated_counts, tetrahedralise


@pytest.fixture(scope="module")
def bar():
    return Part(builtin_part("cantilever", {"length_mm": 40.0}), "bar")


@pytest.fixture(scope="module")
def mesh(bar):
    return tetrahedralise(bar, edge_mm=8.0, element="tet4")


def test_the_mesh_is_all_of_the_part(bar, mesh):
    assert (mesh.volumes > 0).all()
    # The box's corners and edges are found; a node that a thin tet holds back may miss by little.
    assert mesh.volume == pytest.approx(bar.volume, rel=1e-5)


def test_boundary_nodes_lie_on_the_surface(bar, mesh):
    boundary = np.unique(mesh.boundary_facets)
    distance, _, _ = bar.signed_distance.unsigned(mesh.nodes[boundary])
    assert np.quantile(distance, 0.95) < 1e-9 and distance.max() < 1e-3 * bar.diagonal
    # So the clamped end is the whole face, but for a facet that may cut its rim by the envelope.
    end = np.isclose(mesh.facet_centroids[:, 0], 0, atol=1e-3)
    assert mesh.facet_areas[end].sum() == pytest.approx(400, rel=5e-3)


def test_tet10_has_the_same_volume_and_middle_nodes(bar):
    quadratic = tetrahedralise(bar, edge_mm=10.0, element="tet10")
    assert quadratic.element == "tet10"
    assert quadratic.volume == pytest.approx(bar.volume, rel=1e-5)


def test_a_curved_part_keeps_its_volume_within_the_envelope():
    part = Part(builtin_part("torsion-bar", {"length_mm": 30.0}), "torsion-bar")
    meshed = tetrahedralise(part, edge_mm=6.0, element="tet4")
    assert meshed.volume == pytest.approx(part.volume, rel=0.02)
    boundary = np.unique(meshed.boundary_facets)
    distance, _, _ = part.signed_distance.unsigned(meshed.nodes[boundary])
    # Some nodes may be held back where a tet would go flat: by the envelope at most.
    assert distance.max() <= 1e-3 * part.diagonal
    assert np.quantile(distance, 0.95) < 1e-9


def test_a_mesher_that_fails_names_the_part_and_its_edge(bar, monkeypatch):
    monkeypatch.setattr(ftetwild.sys, "executable", "/bin/false")
    with pytest.raises(
        TetrahedralisationError, match=r"bar: meshing at edge_mm = 10 failed: The tet"
    ):
        tetrahedralise(bar, edge_mm=10.0, element="tet4")


def test_wanted_edges_reach_the_mesher_and_the_mesh_stays_on_the_surface(bar, mesh):
    """Finer at the clamped end only; fTetWild's own first mesh has 3.5 mm here."""
    edge = np.where(mesh.nodes[:, 0] < 10, 2.0, 8.0)
    sizing = Sizing.around(mesh, graded(mesh, edge))
    finer = tetrahedralise(bar, edge_mm=8.0, element="tet4", sizing=sizing)
    achieved = nodal_edges(finer)
    assert np.median(achieved[finer.nodes[:, 0] < 8]) == pytest.approx(2.0, rel=0.2)
    assert np.median(achieved[finer.nodes[:, 0] > 25]) > 3
    assert finer.volume == pytest.approx(bar.volume, rel=1e-5)


@pytest.mark.parametrize(
    ("edge", "element", "words"),
    [
        (0.0, "tet4", "above 0"),
        (float("nan"), "tet4", "above 0"),
        (5.0, "tet8", 'must be "tet4" or "tet10"'),
        (0.1, "tet4", "larger edge"),
    ],
)
def test_impossible_wishes_are_refused_before_meshing(bar, edge, element, words):
    with pytest.raises(TetrahedralisationError, match=words):
        tetrahedralise(bar, edge_mm=edge, element=element)


def test_a_mesh_of_another_volume_is_refused(bar, mesh, monkeypatch):
    """Negative control: half the tets are lost on the way."""
    half = TetMesh(mesh.nodes, mesh.tets[mesh.nodes[mesh.tets].mean(axis=1)[:, 0] < 20])
    monkeypatch.setattr(module, "mesh_of_surface", lambda *_, **__: half)
    with pytest.raises(TetrahedralisationError, match="from the part's volume by -"):
        tetrahedralise(bar, edge_mm=8.0, element="tet4")


def stubbed(monkeypatch, *meshes):
    """The mesher replaced by one that returns these in turn; what it was asked, call by call."""
    asked, left = [], iter(meshes)
    monkeypatch.setattr(
        module, "mesh_of_surface", lambda *_, **wishes: asked.append(wishes) or next(left)
    )
    return asked


def strayed(mesh):
    """One node of a face 0.3 mm off it, beyond the envelope of 0.06 mm, and no tet inverted."""
    nodes = mesh.nodes.copy()
    boundary = np.unique(mesh.boundary_facets)
    inside_face = boundary[np.all(np.abs(nodes[boundary, :2] - [20, 0]) < [15, 8], axis=1)]
    top = inside_face[np.isclose(nodes[inside_face, 2], nodes[:, 2].max())]
    nodes[top[0], 2] += 0.3
    return TetMesh(nodes, mesh.tets)


def runaway(mesh):
    """Each tet cut into 8^3 of its shape."""
    for _ in range(3):
        a, b, c, d, ab, bc, ca, ad, bd, cd = mesh.to_tet10().tets.T
        tets = [(a, ab, ca, ad), (ab, b, bc, bd), (ca, bc, c, cd), (ad, bd, cd, d), (ab, bc, ca, bd), (ab, ca, ad, bd), (ca, ad, bd, cd), (ca, bc, cd, bd)]  # fmt: skip # noqa: E501
        mesh = TetMesh(mesh.to_tet10().nodes, np.concatenate([np.stack(t, axis=1) for t in tets]))
    return mesh


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (
            strayed,
            "bar, meshed 2 times: 1 of .* boundary are off the part's surface by up to 0.3 mm",
        ),
        (runaway, "bar, meshed 2 times: the mesh has .* tets where at most .* make sense"),
    ],
)
def test_a_mesh_that_ran_away_or_strayed_is_made_again_and_refused_the_second_time(
    bar, mesh, monkeypatch, bad, words
):
    """The mesher's threads race, so equal input may give a good mesh the next time."""
    broken = bad(mesh)
    assert (broken.volumes > 0).all() and broken.volume == pytest.approx(mesh.volume, rel=0.01)
    asked = stubbed(monkeypatch, broken, mesh)
    again = tetrahedralise(bar, edge_mm=8.0, element="tet4")
    np.testing.assert_allclose(again.nodes, mesh.nodes, atol=1e-3)
    assert len(asked) == 2 and asked[0] == asked[1]
    stubbed(monkeypatch, broken, broken)
    with pytest.raises(TetrahedralisationError, match=words):
        tetrahedralise(bar, edge_mm=8.0, element="tet4")


def test_fine_detail_and_wanted_edges_do_not_count_as_running_away(bar, mesh, monkeypatch):
    """512 times as many tets are what edges of an eighth make; and triangles want tets of their own."""
    finer = runaway(mesh)
    stubbed(monkeypatch, finer)
    sizing = Sizing.around(mesh, np.full(len(mesh.nodes), 1.0))
    made = tetrahedralise(bar, edge_mm=8.0, element="tet4", sizing=sizing)
    assert len(made.tets) == len(finer.tets)


def test_a_rough_boundary_becomes_flat_and_sharp_and_no_tet_inverts():
    smooth = TetMesh.box((4.0, 3.0, 2.0), (8, 6, 4))
    surface = builtin_part("cantilever", {"length_mm": 4.0, "width_mm": 3.0, "height_mm": 2.0})
    noise = np.random.default_rng(0).uniform(-0.02, 0.02, smooth.nodes.shape)
    nodes = fitted_to_surface(
        smooth.nodes + noise, smooth.tets, surface, query=SignedDistance(surface), reach=0.05
    )
    fitted = TetMesh(nodes, smooth.tets)
    assert (fitted.volumes > 0).all()
    assert fitted.volume == pytest.approx(24, rel=1e-9)


def test_a_way_that_would_flatten_a_tet_is_cut_short():
    """One tet whose apex is close to where its base must go."""
    surface = builtin_part("cantilever", {"length_mm": 9.0, "width_mm": 9.0, "height_mm": 9.0})
    nodes = np.array([[3.0, 3, -0.5], [5.0, 3, -0.5], [3.0, 5, -0.5], [3.5, 3.5, -0.05]])
    tets = np.array([[0, 1, 2, 3]])
    moved = fitted_to_surface(nodes, tets, surface, query=SignedDistance(surface), reach=1.0)
    assert TetMesh(moved, tets).volumes[0] > 0
    assert (moved[:3, 2] > -0.5).any()


@pytest.mark.parametrize(
    ("name", "edge", "tets"),
    [
        ("cantilever", 5.0, 2508),
        ("bracket", 4.0, 17385),
        ("torsion-bar", 5.0, 5868),
        ("l-bracket", 4.0, 10751),
    ],
)
def test_counts_are_foreseen_within_a_factor_of_two(name, edge, tets):
    """Against meshes of fTetWild made once."""
    part = Part(builtin_part(name, {}), name)
    estimate = estimated_counts(part, edge_mm=edge, element="tet4")
    assert tets / 2 < estimate.tets < tets * 2
    assert estimated_counts(part, edge_mm=edge, element="tet10").nodes > 4 * estimate.nodes


def test_the_default_edge_is_a_share_of_the_diagonal(bar):
    assert default_edge_mm(bar) == pytest.approx(bar.diagonal / 25)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "unit", "solid"),
    [
        ("72214.stl", "mm", None),
        ("beethoven.ply", "cm", None),
        ("fandisk.obj", "cm", None),
        ("spot.obj", "m", None),
        ("112932.stl", "mm", 1),
        ("112932.stl", "mm", 2),
    ],
)
def test_real_parts_are_meshed(name, unit, solid):
    from texmap_opt.part import read_surface

    folder = Path(__file__).parents[2] / "../shared/parts"
    if not folder.is_dir():
        pytest.skip("the shared test parts are not here")
    part = read_surface(folder / name, unit=unit, solid=solid)
    edge = float(np.ptp(part.bounds, axis=0).max()) / 20
    meshed = tetrahedralise(part, edge_mm=edge, element="tet4")
    assert (meshed.volumes > 0).all()
    # A coarse tet mesh cuts curved walls short; flat ones not at all.
    assert meshed.volume == pytest.approx(part.volume, rel=5e-3)
    boundary = np.unique(meshed.boundary_facets)
    distance, _, _ = part.signed_distance.unsigned(meshed.nodes[boundary])
    assert np.quantile(distance, 0.99) < 1e-9 * part.diagonal
    assert isinstance(part.surface, TriMesh)
