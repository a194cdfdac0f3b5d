"""Loads keep their resultants, solutions turn with the axes, and supports are honoured."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fea import (
    FeaError,
    Material,
    SolidModel,
    Support,
    TetMesh,
    force_on_facets,
    gravity_forces,
    moment_on_facets,
    pressure_forces,
    solve_solid,
    traction_forces,
    von_mises,
)

MATERIAL = Material(E=70e3, nu=0.33, density=2.67e-9)
ELEMENTS = ["tet4", "tet10"]


def block(element, *, turn=None):
    mesh = TetMesh.box((30.0, 20.0, 10.0), (3, 2, 2), origin=(5.0, -3.0, 2.0))
    if turn is not None:
        mesh = TetMesh(mesh.nodes @ turn.T, mesh.tets)
    return mesh if element == "tet4" else mesh.to_tet10()


def top(mesh):
    return mesh.boundary_facets[mesh.facet_centroids[:, 2] > 12 - 1e-9]


def resultants(mesh, forces):
    return forces.sum(axis=0), np.cross(mesh.nodes, forces).sum(axis=0)


@pytest.mark.parametrize("element", ELEMENTS)
def test_pressure_on_the_top_pushes_down_with_area_times_pressure(element):
    mesh = block(element)
    force, moment = resultants(mesh, pressure_forces(mesh, top(mesh), 2.5))
    expected = np.array([0.0, 0.0, -2.5 * 600.0])
    np.testing.assert_allclose(force, expected, atol=1e-9)
    np.testing.assert_allclose(moment, np.cross([20.0, 7.0, 12.0], expected), atol=1e-8)


@pytest.mark.parametrize("element", ELEMENTS)
def test_pressure_on_a_closed_surface_has_no_resultant(element):
    mesh = block(element)
    force, moment = resultants(mesh, pressure_forces(mesh, mesh.boundary_facets, 1.0))
    np.testing.assert_allclose(np.concatenate([force, moment / 30]), 0, atol=1e-10)


@pytest.mark.parametrize("element", ELEMENTS)
def test_gravity_weighs_density_times_volume_at_the_centroid(element):
    mesh = block(element)
    g = np.array([0.0, 0.0, -9810.0])
    force, moment = resultants(mesh, gravity_forces(mesh, MATERIAL.density, g))
    weight = MATERIAL.density * 6000.0 * g
    np.testing.assert_allclose(force, weight, rtol=1e-12)
    np.testing.assert_allclose(moment, np.cross([20.0, 7.0, 7.0], weight), atol=1e-10)


vectors = st.tuples(*[st.floats(-1e3, 1e3, allow_nan=False)] * 3).map(np.array)


@settings(max_examples=15, derandomize=True, deadline=None)
@given(wanted=vectors)
@pytest.mark.parametrize("element", ELEMENTS)
def test_force_and_moment_resultants_are_exact(element, wanted):
    mesh = block(element)
    facets = top(mesh)
    force, _ = resultants(mesh, force_on_facets(mesh, facets, wanted))
    np.testing.assert_allclose(force, wanted, atol=1e-9)
    force, moment = resultants(mesh, moment_on_facets(mesh, facets, wanted))
    np.testing.assert_allclose(force, 0, atol=1e-9)
    np.testing.assert_allclose(moment, wanted, atol=1e-8)


def test_a_load_on_no_facets_is_refused():
    mesh = block("tet4")
    with pytest.raises(FeaError, match="without area"):
        force_on_facets(mesh, mesh.boundary_facets[:0], np.ones(3))


@settings(max_examples=3, derandomize=True, deadline=None)
@given(angles=vectors)
def test_turning_the_axes_turns_the_solution(angles):
    R = Rotation.from_rotvec(angles).as_matrix()
    straight, turned = block("tet10"), block("tet10", turn=R)
    clamp = Support.clamp(np.flatnonzero(straight.nodes[:, 0] < 5 + 1e-9))
    load = np.array([3.0, -20.0, 100.0])
    facets = top(straight)
    a = solve_solid(straight, MATERIAL, [clamp], traction_forces(straight, facets, load)[None])
    b = solve_solid(turned, MATERIAL, [clamp], traction_forces(turned, facets, R @ load)[None])
    scale = np.abs(a.displacement).max()
    np.testing.assert_allclose(b.displacement, a.displacement @ R.T, atol=1e-9 * scale)
    peak = von_mises(a.stress).max()
    np.testing.assert_allclose(von_mises(b.stress), von_mises(a.stress), atol=1e-8 * peak)
    np.testing.assert_allclose(b.compliance, a.compliance, rtol=1e-9)


def test_several_cases_share_one_factor_and_superpose():
    mesh = block("tet10")
    clamp = Support.clamp(np.flatnonzero(mesh.nodes[:, 0] < 5 + 1e-9))
    model = SolidModel.from_supports(mesh, MATERIAL, [clamp])
    one = pressure_forces(mesh, top(mesh), 1.0)
    two = gravity_forces(mesh, 1e-6, np.array([9810.0, 0.0, 0.0]))
    both = model.solve(np.stack([one, two, one + two]))
    u, stress = both.displacement, both.stress
    np.testing.assert_allclose(u[0] + u[1], u[2], atol=1e-12 * np.abs(u).max())
    np.testing.assert_allclose(stress[0] + stress[1], stress[2], atol=1e-9 * np.abs(stress).max())
    np.testing.assert_allclose(both.reaction[0], [0, 0, 600.0], atol=1e-6)


@pytest.mark.parametrize("element", ELEMENTS)
def test_prescribed_displacement_stretches_a_bar_by_E(element):
    """A bar free to contract, its ends drawn apart by 0.3 of 30 mm: sigma_xx = E/100."""
    mesh = block(element)
    x, y, z = (mesh.nodes - mesh.nodes.min(axis=0)).T
    only = np.eye(3, dtype=bool)
    supports = [
        Support(np.flatnonzero(x < 1e-9), only[0], np.zeros(3)),
        Support(np.flatnonzero(x > 30 - 1e-9), only[0], np.array([0.3, np.nan, np.nan])),
        Support(np.flatnonzero(y < 1e-9), only[1], np.zeros(3)),
        Support(np.flatnonzero(z < 1e-9), only[2], np.zeros(3)),
    ]
    solution = solve_solid(mesh, MATERIAL, supports, np.zeros((1, *mesh.nodes.shape)))
    expected = np.array([700.0, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(
        solution.stress[0], np.broadcast_to(expected, (len(x), 6)), atol=1e-8
    )
    np.testing.assert_allclose(solution.displacement[0, :, 1], -0.33 * 0.01 * y, atol=1e-12)
    np.testing.assert_allclose(solution.reaction[0], 0, atol=1e-6)


def test_free_motion_is_named():
    mesh = block("tet4")
    floor = Support(
        np.flatnonzero(mesh.nodes[:, 2] < 2 + 1e-9), np.array([False, False, True]), np.zeros(3)
    )
    with pytest.raises(FeaError, match="slides along x and y and turns about an axis along z"):
        SolidModel.from_supports(mesh, MATERIAL, [floor])
    with pytest.raises(FeaError, match="add a support"):
        SolidModel.from_supports(mesh, MATERIAL, [])


def test_each_of_two_separate_pieces_must_be_held():
    one = TetMesh.box((1.0, 1.0, 1.0), (1, 1, 1))
    mesh = TetMesh(
        np.concatenate([one.nodes, one.nodes + 5]), np.concatenate([one.tets, one.tets + 8])
    )
    clamp = Support.clamp(np.arange(4))
    with pytest.raises(FeaError, match=r"piece 2 of 2 .* slides and turns in every direction"):
        SolidModel.from_supports(mesh, MATERIAL, [clamp])


def test_contradicting_supports_are_refused():
    mesh = block("tet4")
    nodes = np.arange(4)
    pull = Support(nodes[2:], np.array([True, False, False]), np.array([0.1, 0.0, 0.0]))
    with pytest.raises(FeaError, match="another support prescribes 0 mm"):
        SolidModel.from_supports(mesh, MATERIAL, [Support.clamp(nodes), pull])


def test_inverted_cells_and_loose_nodes_are_refused():
    mesh = block("tet4")
    clamp = Support.clamp(np.arange(12))
    inverted = mesh.tets.copy()
    inverted[3] = inverted[3][[1, 0, 2, 3]]
    with pytest.raises(FeaError, match="1 of 72 tetrahedra are flat or inverted"):
        SolidModel.from_supports(TetMesh(mesh.nodes, inverted), MATERIAL, [clamp])
    loose = TetMesh(np.concatenate([mesh.nodes, np.zeros((2, 3))]), mesh.tets)
    with pytest.raises(FeaError, match="2 mesh nodes belong to no tetrahedron"):
        SolidModel.from_supports(loose, MATERIAL, [clamp])


def test_forces_that_are_not_numbers_are_refused():
    mesh = block("tet4")
    model = SolidModel.from_supports(mesh, MATERIAL, [Support.clamp(np.arange(12))])
    with pytest.raises(FeaError, match="NaN"):
        model.solve(np.full((1, *mesh.nodes.shape), np.nan))
