"""The targets can be missed: wrong physics, geometry or numbering is noticed."""

from dataclasses import replace

import numpy as np
import pytest
from solid_cases import exact_fields, lame_and_kirsch, published, scikit_fem
from solid_cases.exact_fields import PATCH_MATERIAL, linear_field, macneal_harder_cube
from solid_cases.mapped_mesh import field_support
from targets import BENCHMARKS

from fea import FeaError, SolidProblem, TetMesh, body_forces, quadrature_stress, solve_solid


def target(benchmark, quantity):
    (found,) = [
        target
        for one in BENCHMARKS
        if one.name == benchmark
        for target in one.targets
        if target.quantity == quantity
    ]
    return found


CYLINDER, HOOP = "Lamé's cylinder", "hoop stress at a, nu = 0.3"
MISSED = {
    "Poisson's ratio 0.35 for 0.3": (
        (CYLINDER, "u(a), nu = 0.3"),
        lambda: lame_and_kirsch.cylinder(0.35)["u"],
    ),
    "suction for pressure": (
        (CYLINDER, HOOP),
        lambda: lame_and_kirsch.cylinder(0.3, pressure=-1.0)["hoop"],
    ),
    "straight edges on the bore": (
        (CYLINDER, HOOP),
        lambda: lame_and_kirsch.cylinder(0.3, curved=False)["hoop"],
    ),
    "linear tetrahedra near incompressibility": (
        (CYLINDER, "u(a), nu = 0.4999"),
        lambda: lame_and_kirsch.cylinder(0.4999, element="tet4")["u"],
    ),
    "straight edges on the hole": (
        ("Kirsch's hole", "stress concentration"),
        lambda: lame_and_kirsch.kirsch(curved=False)["concentration"],
    ),
    "pressure for tension on the membrane": (
        ("NAFEMS LE1, elliptic membrane", "sigma_yy at (2, 0)"),
        lambda: published.le1("tet10", "fine", pressure=10.0),
    ),
    "the mean for a graded modulus": (
        ("Graded modulus", "displacement, difference"),
        lambda: exact_fields.graded_modulus(uniform=True)["u"],
    ),
    "Poisson's ratio off by 1e-10 in the stiffness": (
        ("Same mesh in scikit-fem", "stiffness, difference, P2"),
        lambda: scikit_fem.same_mesh("P2", 0.3 + 1e-10)["K"],
    ),
}


@pytest.mark.parametrize("fault", MISSED)
def test_a_fault_misses_its_target(fault):
    which, measure = MISSED[fault]
    assert not target(*which).met_by(measure().value)


def test_a_number_that_is_none_meets_no_target():
    assert not target(CYLINDER, HOOP).met_by(float("nan"))


def test_exchanged_mid_edge_nodes_fail_the_patch_test():
    """Edges 12 and 03 of every cell named the wrong way round: neighbours disagree on them."""
    mesh = macneal_harder_cube("tet10")
    wrong = mesh.tets.copy()
    wrong[:, [5, 7]] = wrong[:, [7, 5]]
    boundary = np.unique(mesh.boundary_facets)
    support = field_support(boundary, linear_field(mesh.nodes[boundary]))
    problem = SolidProblem.from_supports(
        TetMesh(mesh.nodes, wrong), PATCH_MATERIAL, [support], np.zeros_like(mesh.nodes)
    )
    with pytest.raises(FeaError, match="mid-edge nodes lie on more than one edge"):
        solve_solid(problem)
    # Stress of the exact displacement, in cells whose mid-edge nodes are not where they should be.
    u = linear_field(mesh.nodes)
    swapped = u.copy()
    edge = mesh.tets[0]
    swapped[edge[[5, 7]]] = u[edge[[7, 5]]]
    stress = quadrature_stress(replace(problem, mesh=mesh), swapped[None])
    assert np.ptp(np.asarray(stress)[0, 0, :, 0]) > 1.0


def test_a_wrong_body_force_loses_the_order_of_convergence():
    """Half the body force of the manufactured solution: errors no longer fall with the mesh."""
    errors = []
    for cells in (3, 6):
        mesh = TetMesh.box((1.0, 1.0, 1.0), (cells, cells, cells)).to_tet10()
        boundary = np.unique(mesh.boundary_facets)
        exact = exact_fields.manufactured(mesh.nodes)
        forces = body_forces(mesh, lambda p: exact_fields.manufactured_force(p) / 2)
        support = field_support(boundary, exact[boundary])
        problem = SolidProblem.from_supports(mesh, exact_fields.UNIT_MATERIAL, [support], forces)
        errors.append(np.abs(solve_solid(problem).displacement[0] - exact).max())
    assert errors[1] > errors[0] / 2
