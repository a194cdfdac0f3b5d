"""Loads keep their resultants, solutions turn with the axes, cases superpose, supports are honoured."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from solid_cases.mapped_mesh import ON, eye_bar

from fea import (
    FeaError,
    Material,
    SolidProblem,
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
    return mesh.facets_where(lambda x: x[:, 2] > 12 - ON)


def foot(mesh):
    return Support.clamp(mesh.nodes_where(lambda x: x[:, 0] < 5 + ON))


def half_bore(mesh):
    """The right half of the hole of radius 5 through (20, 10) of the bar with an eye."""
    return mesh.facets_where(
        lambda x: (
            (np.hypot(x[:, 0] - 20, x[:, 1] - 10) < 5 + ON)
            & (x[:, 0] > 20)
            & (np.abs(x[:, 2] - 5) < 5 - ON)
        )
    )


# Flat facets, straight-sided and curved cells round a hole.
REGIONS = {
    "tet4": lambda: (block("tet4"), top),
    "tet10": lambda: (block("tet10"), top),
    "chords": lambda: (eye_bar("tet4"), half_bore),
    "circle": lambda: (eye_bar("tet10"), half_bore),
}


def region(name):
    mesh, chosen = REGIONS[name]()
    return mesh, chosen(mesh)


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
def test_pressure_in_half_a_bore_pushes_with_its_projected_area(element):
    """The normal integrates to the plane between the ends of a curve, however it bulges."""
    mesh = eye_bar(element)
    force, moment = resultants(mesh, pressure_forces(mesh, half_bore(mesh), 2.5))
    # The wall lies on the right, so that the pressure pushes to the right: diameter 10, height 10.
    expected = np.array([2.5 * 100.0, 0.0, 0.0])
    np.testing.assert_allclose(force, expected, atol=1e-9)
    np.testing.assert_allclose(moment, np.cross([20.0, 10.0, 5.0], expected), atol=1e-8)


@pytest.mark.parametrize(("element", "share"), [("tet4", 2e-2), ("tet10", 1e-4)])
def test_traction_on_half_a_bore_carries_its_area(element, share):
    """The area is pi r h: chords fall 0.7 % short, parabolas 0.003 %."""
    mesh = eye_bar(element)
    force = traction_forces(mesh, half_bore(mesh), np.array([0.0, 0.0, 3.0])).sum(axis=0)
    np.testing.assert_allclose(force, [0, 0, 3 * np.pi * 50], rtol=share, atol=1e-9)
    if element == "tet4":
        assert abs(force[2] - 3 * np.pi * 50) > 1e-3 * force[2]


@pytest.mark.parametrize("mesh", [block("tet4"), block("tet10"), eye_bar("tet10")])
def test_pressure_on_a_closed_surface_has_no_resultant(mesh):
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
@pytest.mark.parametrize("name", REGIONS)
def test_force_and_moment_resultants_are_exact_on_flat_and_curved_facets(name, wanted):
    mesh, facets = region(name)
    force, _ = resultants(mesh, force_on_facets(mesh, facets, wanted))
    np.testing.assert_allclose(force, wanted, atol=1e-9)
    force, moment = resultants(mesh, moment_on_facets(mesh, facets, wanted))
    np.testing.assert_allclose(force, 0, atol=1e-9)
    np.testing.assert_allclose(moment, wanted, atol=1e-8)


@settings(max_examples=3, derandomize=True, deadline=None)
@given(angles=vectors)
def test_turning_the_axes_turns_the_solution(angles):
    R = Rotation.from_rotvec(angles).as_matrix()
    straight, turned = block("tet10"), block("tet10", turn=R)
    load = np.array([3.0, -20.0, 100.0])
    clamp, facets = foot(straight), top(straight)
    a, b = (
        solve_solid(
            SolidProblem.from_supports(mesh, MATERIAL, [clamp], traction_forces(mesh, facets, t))
        )
        for mesh, t in ((straight, load), (turned, R @ load))
    )
    scale = np.abs(a.displacement).max()
    np.testing.assert_allclose(b.displacement, a.displacement @ R.T, atol=1e-9 * scale)
    peak = von_mises(a.stress).max()
    np.testing.assert_allclose(von_mises(b.stress), von_mises(a.stress), atol=1e-8 * peak)
    np.testing.assert_allclose(b.compliance, a.compliance, rtol=1e-9)


def load_cases(mesh):
    return np.stack(
        [
            pressure_forces(mesh, top(mesh), 1.0),
            gravity_forces(mesh, 1e-6, np.array([9810.0, 0.0, 0.0])),
            moment_on_facets(mesh, top(mesh), np.array([1e4, -2e4, 5e3])),
        ]
    )


@pytest.mark.parametrize("element", ELEMENTS)
def test_several_cases_on_one_factor_equal_separate_solves(element):
    """A case does not know of its neighbours, also where supports move."""
    mesh = block(element)
    lifted = Support(
        mesh.nodes_where(lambda x: x[:, 0] > 35 - ON),
        np.array([False, False, True]),
        np.array([0.0, 0.0, 0.02]),
    )
    problem = SolidProblem.from_supports(mesh, MATERIAL, [foot(mesh), lifted], load_cases(mesh))
    together = solve_solid(problem)
    for case, forces in enumerate(problem.forces):
        alone = solve_solid(replace(problem, forces=forces[None]))
        for name in ("displacement", "reaction", "stress"):
            one, many = getattr(alone, name)[0], getattr(together, name)[case]
            np.testing.assert_allclose(many, one, atol=1e-9 * np.abs(one).max(), err_msg=name)


def test_load_cases_superpose():
    mesh = block("tet10")
    cases = load_cases(mesh)
    forces = np.concatenate([cases, cases.sum(axis=0, keepdims=True)])
    both = solve_solid(SolidProblem.from_supports(mesh, MATERIAL, [foot(mesh)], forces))
    for field in (both.displacement, both.stress):
        whole = field[-1]
        np.testing.assert_allclose(field[:-1].sum(axis=0), whole, atol=1e-9 * np.abs(whole).max())
    np.testing.assert_allclose(both.reaction[0].sum(axis=0), [0, 0, 600.0], atol=1e-6)


@pytest.mark.parametrize("element", ELEMENTS)
def test_prescribed_displacement_stretches_a_bar_by_E(element):
    """A bar free to contract, its ends drawn apart by 0.3 of 30 mm: sigma_xx = E/100."""
    mesh = block(element)
    x, y, z = (mesh.nodes - mesh.nodes.min(axis=0)).T
    only = np.eye(3, dtype=bool)
    supports = [
        Support(np.flatnonzero(x < ON), only[0], np.zeros(3)),
        Support(np.flatnonzero(x > 30 - ON), only[0], np.array([0.3, np.nan, np.nan])),
        Support(np.flatnonzero(y < ON), only[1], np.zeros(3)),
        Support(np.flatnonzero(z < ON), only[2], np.zeros(3)),
    ]
    problem = SolidProblem.from_supports(mesh, MATERIAL, supports, np.zeros_like(mesh.nodes))
    solution = solve_solid(problem)
    expected = np.array([700.0, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(
        solution.stress[0], np.broadcast_to(expected, (len(x), 6)), atol=1e-8
    )
    np.testing.assert_allclose(solution.displacement[0, :, 1], -0.33 * 0.01 * y, atol=1e-12)
    np.testing.assert_allclose(solution.reaction[0].sum(axis=0), 0, atol=1e-6)
    # The ends are drawn by stress times area.
    np.testing.assert_allclose(solution.reaction[0][x > 30 - ON, 0].sum(), 700.0 * 200, rtol=1e-9)


@pytest.mark.parametrize("element", ELEMENTS)
def test_a_column_under_its_weight_shortens_by_half_its_stress_over_E(element):
    """Where nu = 0, sigma_zz = -rho g (h - z) and the top sinks by rho g h²/2E."""
    mesh = block(element)
    g, h, material = 9.81e6, 10.0, Material(70e3, 0.0, 2.67e-9)
    floor = Support.clamp(mesh.nodes_where(lambda x: x[:, 2] < 2 + ON))
    forces = gravity_forces(mesh, material.density, np.array([0.0, 0.0, -g]))
    solution = solve_solid(SolidProblem.from_supports(mesh, material, [floor], forces))
    stress = material.density * g
    weight = force_on_facets(mesh, top(mesh), np.array([0.0, 0.0, 1.0]))
    down = np.einsum("nx,nx->", weight, solution.displacement[0])
    np.testing.assert_allclose(down, -stress * h**2 / 2 / material.E, rtol=1e-9)
    if element == "tet10":
        z = mesh.nodes[:, 2] - 2
        np.testing.assert_allclose(solution.stress[0, :, 2], -stress * (h - z), atol=1e-9)


def test_a_moment_bends_as_a_couple_of_forces_does():
    """St Venant's principle: away from the end only the resultant counts."""
    mesh = eye_bar("tet10")
    clamp = Support.clamp(mesh.nodes_where(lambda x: x[:, 0] < ON))
    end = mesh.facets_where(lambda x: x[:, 0] > 60 - ON)
    upper = mesh.facets_where(lambda x: (x[:, 0] > 60 - ON) & (x[:, 1] > 10))
    lower = mesh.facets_where(lambda x: (x[:, 0] > 60 - ON) & (x[:, 1] < 10))
    # Halves of the end, 20 mm high, have their centroids 10 mm apart.
    couple = force_on_facets(mesh, upper, np.array([100.0, 0, 0]))
    couple -= force_on_facets(mesh, lower, np.array([100.0, 0, 0]))
    moment = moment_on_facets(mesh, end, np.array([0.0, 0.0, -1000.0]))
    forces = np.stack([couple, moment])
    solution = solve_solid(SolidProblem.from_supports(mesh, MATERIAL, [clamp], forces))
    # 35 mm from the end, nearly twice the height.
    far = mesh.nodes[:, 0] < 25
    a, b = solution.stress[:, far, 0]
    np.testing.assert_allclose(a, b, atol=2e-3 * np.abs(b).max())


# What `fea` refuses -------------------------------------------------------------------------


def test_free_motion_is_named():
    mesh = block("tet4")
    floor = Support(
        np.flatnonzero(mesh.nodes[:, 2] < 2 + ON), np.array([False, False, True]), np.zeros(3)
    )
    forces = pressure_forces(mesh, top(mesh), 1.0)
    problem = SolidProblem.from_supports(mesh, MATERIAL, [floor], forces)
    with pytest.raises(FeaError, match="slide along x and y and turn about an axis along z"):
        solve_solid(problem)
    with pytest.raises(FeaError, match="add a support"):
        solve_solid(SolidProblem.from_supports(mesh, MATERIAL, [], forces))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda p: replace(p, mesh=TetMesh(p.mesh.nodes, p.mesh.tets[:, [1, 0, 2, 3]])),
            "inverted",
        ),
        (lambda p: replace(p, forces=np.full_like(p.forces, np.nan)), "not a number"),
        (lambda p: replace(p, modulus=np.zeros_like(p.modulus)), "modulus"),
        (
            lambda p: replace(p, forces=np.where(p.fixed, 1.0, 0.0)[None]),
            "is held, so nothing is loaded",
        ),
    ],
)
def test_solving_looks_at_mesh_forces_and_modulus(change, message):
    """What each check says in full is tested beside it, in tests/fea."""
    mesh = block("tet4")
    forces = pressure_forces(mesh, top(mesh), 1.0)
    problem = SolidProblem.from_supports(mesh, MATERIAL, [foot(mesh)], forces)
    with pytest.raises(FeaError, match=message):
        solve_solid(change(problem))
