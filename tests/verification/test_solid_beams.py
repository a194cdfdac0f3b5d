"""A solid cantilever against beam theory; the straight beam is among the targets."""

import numpy as np
import pytest

from fea import (
    Material,
    SolidProblem,
    Support,
    TetMesh,
    force_on_facets,
    solve_solid,
)

L, H, E, P = 100.0, 20.0, 70e3, 500.0


@pytest.fixture(scope="module")
def cantilever():
    """100 x 20 x 20 mm, refined towards the clamp, where Poisson's effect is singular."""
    mesh = TetMesh.box((L, H, H), (20, 4, 4))
    nodes = mesh.nodes.copy()
    # Grading with exponent 1.3 halves the first layer; lengths still sum to L.
    nodes[:, 0] = L * (nodes[:, 0] / L) ** 1.3
    return TetMesh(nodes, mesh.tets).to_tet10()


def end_of(mesh, x):
    return mesh.boundary_facets[np.abs(mesh.facet_centroids[:, 0] - x) < 1e-9]


def mean_over(mesh, facets, field):
    """Area mean of a nodal field: its work with the forces of a unit traction."""
    weight = force_on_facets(mesh, facets, np.array([1.0, 0.0, 0.0]))[:, 0]
    return weight @ field


def tip_deflection(mesh, nu):
    clamp = Support.clamp(np.flatnonzero(mesh.nodes[:, 0] < 1e-9))
    end = end_of(mesh, L)
    forces = force_on_facets(mesh, end, np.array([0.0, 0.0, -P]))
    solution = solve_solid(SolidProblem.from_supports(mesh, Material(E, nu, 0.0), [clamp], forces))
    return -mean_over(mesh, end, solution.displacement[0, :, 2]), solution, forces


def timoshenko(nu):
    """P L³/3EI + P L/kappa G A, kappa = 5/6 (Timoshenko and Goodier, Theory of Elasticity)."""
    inertia, G = H**4 / 12, E / (2 * (1 + nu))
    return P * L**3 / (3 * E * inertia) + P * L / (5 / 6 * G * H**2)


def test_cantilever_without_lateral_contraction_is_timoshenkos(cantilever):
    """With nu = 0 the clamp disturbs the beam solution by its warping only: 0.2 %."""
    deflection, _, _ = tip_deflection(cantilever, 0.0)
    np.testing.assert_allclose(deflection, timoshenko(0.0), rtol=2e-3)


def test_cantilever_with_nu_030_is_09865_of_timoshenko(cantilever):
    """A full clamp forbids lateral contraction and stiffens: 0.9865, converged (within 0.3 %)."""
    deflection, _, _ = tip_deflection(cantilever, 0.3)
    np.testing.assert_allclose(deflection / timoshenko(0.3), 0.9865, rtol=3e-3)


def test_reactions_balance_loads(cantilever):
    _, solution, forces = tip_deflection(cantilever, 0.3)
    # 1e-8 of the load: a hundred times the residual that the solver promises.
    reaction = solution.reaction[0]
    np.testing.assert_allclose(reaction.sum(axis=0), -forces.sum(axis=0), atol=1e-8 * P)
    moment = np.cross(cantilever.nodes, reaction + forces).sum(axis=0)
    np.testing.assert_allclose(moment, 0, atol=1e-8 * P * L)


def test_compliance_is_load_times_deflection(cantilever):
    """A uniform traction works on the mean deflection: u.f = P delta."""
    deflection, solution, _ = tip_deflection(cantilever, 0.3)
    np.testing.assert_allclose(solution.compliance[0], P * deflection, rtol=1e-12)
