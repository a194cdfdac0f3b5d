"""An independent program finds the same displacements, forces and stresses."""

import calculix
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from solid_cases.mapped_mesh import ON, eye_bar

from fea import (
    Material,
    SolidProblem,
    Support,
    force_on_facets,
    gravity_forces,
    pressure_forces,
    solve_solid,
)
from fea.elements import TRIANGLES
from fea.isoparametric import facet_points
from fea.materials import Orthotropic
from fea.quadrature import TRIANGLE_2

pytestmark = pytest.mark.skipif(
    not calculix.installed(), reason="CalculiX (ccx, Debian package calculix-ccx) is not installed"
)

ELEMENTS = ["tet4", "tet10"]
MATERIAL = Material(E=210e3, nu=0.3, density=7.85e-9)
G, PRESSURE = 9810.0, 30.0

# CalculiX prints seven digits.
SAME = {"displacement": 2e-6, "force": 2e-6, "stress": 2e-6}
# Where the two integrate loads by different rules: CalculiX takes three points a facet and four a
# cell, which are too few for curved ones. 1e-3 of the displacement and 1e-2 of the stress are asked
# for; these are what docs/verification.md says, and the weight stays below them by far.
OTHER_RULES = {"displacement": 6e-4, "force": 4e-3, "stress": 4e-3}


def clamped(mesh, forces):
    clamp = Support.clamp(mesh.nodes_where(lambda x: x[:, 0] < ON))
    return SolidProblem.from_supports(mesh, MATERIAL, [clamp], forces)


def end_of(mesh):
    return mesh.facets_where(lambda x: x[:, 0] > 60 - ON)


def bore_of(mesh):
    """Facets of the hole of radius 5 about (20, 10): their centroids lie within its radius."""
    return mesh.facets_where(
        lambda x: (np.hypot(x[:, 0] - 20, x[:, 1] - 10) < 5 + ON) & (np.abs(x[:, 2] - 5) < 5 - ON)
    )


def three_point_pressure(mesh, facets):
    """Nodal forces of the pressure by the rule of three points, exact on straight facets only."""
    _, normal = facet_points(mesh.nodes[facets], TRIANGLE_2)
    shape = TRIANGLES[facets.shape[1]].shape(TRIANGLE_2.points)
    forces = np.zeros_like(mesh.nodes)
    np.add.at(forces, facets, -PRESSURE * np.einsum("fqx,qn->fnx", normal, shape))
    return forces


def assert_agree(solution, theirs, tolerance):
    """Compare fields, each relative to its largest value."""
    ours = {
        "displacement": solution.displacement[0],
        "force": solution.reaction[0] + solution.problem.forces[0],
        "stress": solution.quadrature_stress[0],
    }
    for name, field in ours.items():
        atol = tolerance[name] * np.abs(field).max()
        np.testing.assert_allclose(field, getattr(theirs, name), rtol=0, atol=atol, err_msg=name)


@pytest.mark.parametrize("element", ELEMENTS)
def test_the_same_nodal_forces_give_the_same_to_all_printed_digits(element, tmp_path):
    """A bar with an eye, edges on its circle (tet10), bent, under pressure in the eye and weight."""
    mesh = eye_bar(element)
    forces = force_on_facets(mesh, end_of(mesh), np.array([400.0, -300.0, 200.0]))
    forces += pressure_forces(mesh, bore_of(mesh), PRESSURE)
    forces += gravity_forces(mesh, MATERIAL.density, np.array([0.0, 0.0, -1e3 * G]))
    problem = clamped(mesh, forces)
    material, loads = calculix.isotropic(MATERIAL), calculix.nodal_forces(forces)
    theirs = calculix.run(tmp_path, problem, material=material, loads=loads)
    assert_agree(solve_solid(problem), theirs, SAME)


@pytest.mark.parametrize(
    ("element", "ours", "tolerance"),
    [
        ("tet4", pressure_forces, SAME),
        ("tet10", pressure_forces, OTHER_RULES),
        ("tet10", three_point_pressure, SAME),
    ],
    ids=["tet4", "tet10", "tet10 with its rule"],
)
def test_pressure_that_calculix_integrates_itself(element, ours, tolerance, tmp_path):
    mesh = eye_bar(element)
    bore = bore_of(mesh)
    forces = ours(mesh, bore, PRESSURE) if ours is pressure_forces else ours(mesh, bore)
    problem = clamped(mesh, forces)
    theirs = calculix.run(
        tmp_path,
        problem,
        material=calculix.isotropic(MATERIAL),
        loads=calculix.pressure(mesh, bore, PRESSURE),
    )
    assert_agree(solve_solid(problem), theirs, tolerance)


@pytest.mark.parametrize(("element", "tolerance"), [("tet4", SAME), ("tet10", OTHER_RULES)])
def test_weight_that_calculix_integrates_itself(element, tolerance, tmp_path):
    mesh = eye_bar(element)
    problem = clamped(mesh, gravity_forces(mesh, MATERIAL.density, np.array([0.0, 0.0, -G])))
    theirs = calculix.run(
        tmp_path, problem, material=calculix.isotropic(MATERIAL), loads=calculix.gravity(G)
    )
    assert_agree(solve_solid(problem), theirs, tolerance)


@pytest.mark.parametrize("element", ELEMENTS)
def test_an_orthotropic_bar_with_turned_axes_and_a_moved_end(element, tmp_path):
    """Nine constants of a carbon-fibre ply, no two alike, axes in no plane of the bar."""
    ply = Orthotropic(
        E=(140e3, 10e3, 9e3),
        nu=(0.45, 0.3, 0.25),
        G=(3.2e3, 4.5e3, 5e3),
        density=0.0,
        axes=Rotation.from_euler("zyx", [30, 20, 50], degrees=True).as_matrix(),
    )
    mesh = eye_bar(element)
    moved = Support(
        np.unique(end_of(mesh)), np.array([True, False, True]), np.array([0.1, 0.0, -0.2])
    )
    forces = force_on_facets(mesh, bore_of(mesh), np.array([0.0, 500.0, 0.0]))
    clamp = Support.clamp(mesh.nodes_where(lambda x: x[:, 0] < ON))
    problem = SolidProblem.from_supports(mesh, ply, [clamp, moved], forces)
    theirs = calculix.run(
        tmp_path,
        problem,
        material=calculix.orthotropic(ply),
        loads=calculix.nodal_forces(forces),
    )
    assert_agree(solve_solid(problem), theirs, SAME)


def test_the_comparison_notices_a_wrong_poissons_ratio(tmp_path):
    """Negative control."""
    mesh = eye_bar("tet10")
    forces = force_on_facets(mesh, end_of(mesh), np.array([400.0, -300.0, 200.0]))
    problem = clamped(mesh, forces)
    wrong = Material(MATERIAL.E, 0.32, MATERIAL.density)
    theirs = calculix.run(
        tmp_path,
        problem,
        material=calculix.isotropic(wrong),
        loads=calculix.nodal_forces(forces),
    )
    with pytest.raises(AssertionError):
        assert_agree(solve_solid(problem), theirs, OTHER_RULES)
