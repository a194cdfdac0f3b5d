"""Refinement until the estimated error is small: it ends, keeps to its limits, and is honest."""

import numpy as np
import pytest

import fea
from fea import FeaError, Material, SolidProblem, Support, TetMesh, solid
from fea.adaptive import refine
from fea.error_estimate import ErrorEstimate
from fea.ftetwild import tetrahedralise
from fea.sizing_field import nodal_edges

STEEL = Material(E=210e3, nu=0.3, density=7.85e-9, name="steel")


def pulled(mesh: TetMesh) -> fea.SolidSolution:
    """Clamped at x = 0, pulled at the other end."""
    far = mesh.nodes[:, 0].max()
    forces = fea.force_on_facets(
        mesh, mesh.facets_where(lambda x: x[:, 0] > far - 1e-6), np.array([1.0, 0.0, 0.0])
    )
    clamp = Support.clamp(mesh.nodes_where(lambda x: x[:, 0] < 1e-6))
    return fea.solve_solid(SolidProblem.from_supports(mesh, STEEL, [clamp], forces))


class Blocks:
    """A mesher of equal cells, as fine as the finest edge wanted; remembers what it was asked."""

    def __init__(self, first: int = 2, finest: int = 14):
        self.first, self.finest, self.asked = first, finest, []

    def __call__(self, sizing):
        self.asked.append(sizing)
        cells = self.first
        if sizing is not None:
            # Kuhn's tets of a unit cube of n³ cells have edges of 1.2/n in the mean.
            cells = int(np.clip(round(1.2 / np.quantile(sizing.edge, 0.1)), 1, self.finest))
        return TetMesh.box((1.0, 1.0, 1.0), (cells,) * 3)


def error_like(power: float, scale: float):
    """A stand-in for the estimate: all cells err alike, in all by scale * edge ** power."""

    def estimate(mesh, C, at_quadrature, recovered, *, modulus=None) -> ErrorEstimate:
        error = scale * nodal_edges(mesh).mean() ** power
        share = error / np.sqrt(1 - error**2)
        cells = np.sqrt(mesh.volumes / mesh.volume)[None] * share
        return ErrorEstimate(mesh, cells, np.ones(1))

    return estimate


def test_it_ends_when_the_share_is_reached(monkeypatch):
    monkeypatch.setattr(solid, "estimate_error", error_like(1.0, 0.3))
    mesher = Blocks()
    adapted = refine(mesher, pulled, share=0.08, max_nodes=20_000)
    assert adapted.converged and adapted.message == ""
    assert adapted.history[-1].relative <= 0.08 < adapted.history[-2].relative
    assert mesher.asked[0] is None
    assert len(adapted.mesh.nodes) == adapted.history[-1].nodes
    assert adapted.solution.problem.mesh is adapted.mesh is adapted.estimate.mesh
    assert all(step.seconds > 0 for step in adapted.history)


def test_a_first_mesh_that_is_good_enough_is_the_only_one(monkeypatch):
    monkeypatch.setattr(solid, "estimate_error", error_like(1.0, 0.01))
    mesher = Blocks()
    adapted = refine(mesher, pulled, share=0.08, max_nodes=20_000)
    assert len(adapted.history) == len(mesher.asked) == 1


def test_an_error_that_does_not_fall_is_told_with_both_remedies(monkeypatch):
    """Negative control: an estimate that no mesh improves."""
    monkeypatch.setattr(solid, "estimate_error", error_like(0.0, 0.3))
    adapted = refine(Blocks(finest=5), pulled, share=0.05, rounds=3, max_nodes=10**6, throw=False)
    assert not adapted.converged
    assert len(adapted.history) == 3
    assert "The estimated error is 30 % with" in adapted.message
    assert "after 3 of 3 rounds, wanted 5 %; allow more than 3 rounds." in adapted.message
    with pytest.raises(FeaError, match="wanted 5 %"):
        refine(Blocks(finest=5), pulled, share=0.05, rounds=3, max_nodes=10**6)


def test_no_mesh_has_more_nodes_than_allowed(monkeypatch):
    monkeypatch.setattr(solid, "estimate_error", error_like(1.0, 0.3))
    adapted = refine(Blocks(), pulled, share=0.03, rounds=8, max_nodes=600, throw=False)
    assert max(step.nodes for step in adapted.history) <= 600
    # It uses what it may, and then stops before its rounds are spent.
    assert adapted.history[-1].nodes > 300
    assert len(adapted.history) < 8
    assert "allow more than 600 nodes (about" in adapted.message
    # The best mesh is kept.
    assert len(adapted.mesh.nodes) == min(adapted.history, key=lambda s: s.relative).nodes


def test_a_mesher_that_ignores_what_is_wanted_is_given_up(monkeypatch):
    monkeypatch.setattr(solid, "estimate_error", error_like(1.0, 0.3))
    meshes = iter([2, 9, 9, 9, 9])
    adapted = refine(
        lambda sizing: TetMesh.box((1.0, 1.0, 1.0), (next(meshes),) * 3),
        pulled,
        share=0.03,
        max_nodes=200,
        throw=False,
    )
    assert len(adapted.history) == 1
    assert "allow more than 200 nodes" in adapted.message


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"share": 0.0}, "share = 0: must be above 0 and below 1"),
        ({"share": 1.0}, "share = 1: must be"),
        ({"share": float("nan")}, "share = nan: must be"),
        ({"share": 0.1, "rounds": 0}, "rounds = 0: must be at least 1"),
        ({"share": 0.1, "max_nodes": 10}, "first mesh has 27 nodes, more than the 10 allowed"),
    ],
)
def test_impossible_wishes_are_refused(options, words):
    with pytest.raises(FeaError, match=words):
        refine(Blocks(), pulled, **{"max_nodes": 1000, **options})


def test_the_nodes_go_to_a_re_entrant_corner():
    """An L-bracket of 30 mm, held at the top and pulled at its toe; fTetWild and the estimate."""
    block = TetMesh.box((30.0, 10.0, 30.0), (3, 1, 3))
    centre = block.nodes[block.tets].mean(axis=1)
    inside = ~((centre[:, 0] > 10) & (centre[:, 2] > 10))
    used, tets = np.unique(block.tets[inside], return_inverse=True)
    bracket = TetMesh(block.nodes[used], tets.reshape(-1, 4))

    def solve(mesh: TetMesh) -> fea.SolidSolution:
        clamp = Support.clamp(np.unique(mesh.facets_where(lambda x: x[:, 2] > 29.95)))
        toe = mesh.facets_where(lambda x: x[:, 0] > 29.95)
        forces = fea.force_on_facets(mesh, toe, np.array([0.0, 0.0, -1.0]))
        return fea.solve_solid(SolidProblem.from_supports(mesh, STEEL, [clamp], forces))

    adapted = refine(
        lambda sizing: tetrahedralise(
            bracket.nodes, bracket.boundary_facets, edge=6.0, sizing=sizing
        ).to_tet10(),
        solve,
        share=0.09,
        rounds=5,
        max_nodes=10_000,
    )
    assert adapted.history[0].relative > 0.09 >= adapted.history[-1].relative
    corners = TetMesh(adapted.mesh.nodes, adapted.mesh.tets[:, :4])
    used = np.unique(corners.tets)
    tet4 = TetMesh(corners.nodes[used], np.searchsorted(used, corners.tets))
    away = np.hypot(tet4.nodes[:, 0] - 10, tet4.nodes[:, 2] - 10)
    edge = nodal_edges(tet4)
    assert edge[away < 1].mean() < 0.5 * edge[away > 10].mean()
