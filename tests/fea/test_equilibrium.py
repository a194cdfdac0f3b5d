"""Derivatives of solved problems: Taylor remainders of second order, and how they are computed."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fea import (
    FeaError,
    FrameProblem,
    Material,
    Sequence,
    SolidProblem,
    Support,
    TetMesh,
    compliance_gradient,
    displacement,
    solve_frame,
    solve_solid,
)
from fea.boundary_conditions import pressure_forces, traction_forces
from fea.objectives import compliance, mean_displacement, p_norm, stress_p_norm
from fea.sections import Round

NAMES = ("nodes", "modulus", "forces", "value")


def solid(element="tet10", *, prescribed=False, varying=True) -> SolidProblem:
    """A small block, jittered, clamped at one end, two load cases, modulus at quadrature points."""
    rng = np.random.default_rng(5)
    mesh = TetMesh.box((3.0, 2.0, 1.0), (3, 2, 1))
    mesh = TetMesh(mesh.nodes + rng.uniform(-0.05, 0.05, mesh.nodes.shape), mesh.tets)
    mesh = mesh if element == "tet4" else mesh.to_tet10()
    clamp = Support.clamp(np.flatnonzero(mesh.nodes[:, 0] < 0.1))
    forces = rng.normal(size=(2, *mesh.nodes.shape))
    samples = len(mesh.element_type.quadrature.weights) if varying else 1
    modulus = rng.uniform(0.5, 2.0, (len(mesh.tets), samples))
    problem = SolidProblem.from_supports(
        mesh, Material(100.0, 0.3, 0.0), [clamp], forces, modulus=modulus
    )
    if prescribed:
        value = np.where(problem.fixed, rng.normal(size=mesh.nodes.shape) * 0.05, 0.0)
        problem = replace(problem, value=value)
    return problem


def start(problem, names=NAMES):
    known = {**problem.parameters, "forces": problem.forces, "value": problem.value}
    return {name: jnp.asarray(known[name]) for name in names}


def end_facets(mesh):
    return mesh.boundary_facets[mesh.facet_centroids[:, 0] > 2.8]


def by_compliance(problem, values):
    u = displacement(problem, **values)
    forces = values.get("forces", jnp.asarray(problem.forces))
    return jnp.asarray([1.0, 2.0]) @ compliance(u, forces)


def by_end_displacement(problem, values):
    u = displacement(problem, **values)
    mean = mean_displacement(problem.mesh, end_facets(problem.mesh), u, nodes=values.get("nodes"))
    return mean[0, 2] - 0.5 * mean[1, 0]


def by_stress(problem, values):
    u = displacement(problem, **values)
    given = {name: values[name] for name in ("nodes", "modulus") if name in values}
    return stress_p_norm(problem, u, **given).sum()


def remainder_orders(function, values, name, *, seed=0, steps=(4e-3, 2e-3, 1e-3)):
    """Observed orders of |g(h) - g(0) - h g'| as h halves, along a random direction."""
    at = values[name]
    direction = jnp.asarray(np.random.default_rng(seed).normal(size=at.shape))
    direction *= 0.3 * max(float(jnp.abs(at).max()), 0.1) / float(jnp.abs(direction).max())
    slope = float(jnp.vdot(jax.grad(function)(values)[name], direction))

    def value(h):
        return float(function({**values, name: at + h * direction}))

    rest = [abs(value(h) - value(0.0) - h * slope) for h in steps]
    if max(rest) < 1e-11 * abs(value(0.0)):
        return np.array([2.0])  # the function is linear along this direction
    return np.log2(np.array(rest[:-1]) / np.array(rest[1:]))


@pytest.mark.parametrize("objective", [by_compliance, by_end_displacement, by_stress])
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("element", ["tet4", "tet10"])
def test_gradient_of_a_solid_has_a_second_order_taylor_remainder(objective, name, element):
    problem = solid(element, prescribed=name == "value")
    orders = remainder_orders(lambda v: objective(problem, v), start(problem), name)
    np.testing.assert_allclose(orders, 2, atol=0.1)


def test_a_wrong_gradient_fails_the_taylor_test():
    """Negative control: the dependence of the stress itself on the modulus left out."""
    problem = solid()

    def wrong(values):
        u = displacement(problem, **values)
        frozen = jax.lax.stop_gradient(values["modulus"])
        live = stress_p_norm(problem, u, modulus=values["modulus"]).sum()
        dead = stress_p_norm(problem, u, modulus=frozen).sum()
        return dead + jax.lax.stop_gradient(live - dead)  # the one's value, the other's slope

    orders = remainder_orders(wrong, start(problem, ("modulus",)), "modulus")
    assert orders[-1] < 1.5


def test_modulus_of_a_cell_is_the_sum_over_its_quadrature_points():
    fine, coarse = solid(), solid(varying=False)
    fine = replace(fine, modulus=np.repeat(coarse.modulus, fine.modulus.shape[1], axis=1))
    a = compliance_gradient(solve_solid(fine))["modulus"].sum(axis=1)
    b = compliance_gradient(solve_solid(coarse))["modulus"][:, 0]
    np.testing.assert_allclose(a, b, rtol=1e-9)


def test_loads_that_follow_the_nodes_are_differentiated_too():
    """A pressure on a moving face: through the forces and through the stiffness."""
    problem = solid("tet10")
    facets = end_facets(problem.mesh)

    def value(values):
        forces = pressure_forces(problem.mesh, facets, 3.0, nodes=values["nodes"])[None]
        u = displacement(
            replace(problem, forces=np.zeros((1, *problem.mesh.nodes.shape))),
            nodes=values["nodes"],
            forces=forces,
        )
        return compliance(u, forces).sum()

    orders = remainder_orders(value, start(problem, ("nodes",)), "nodes")
    np.testing.assert_allclose(orders, 2, atol=0.1)


def test_compliance_needs_no_further_solve(monkeypatch):
    """The adjoint of a multiple of the forces is that multiple of the displacement."""
    problem = solid()
    solution = solve_solid(problem)

    def refuse(*args, **kwargs):
        raise AssertionError("solved again")

    monkeypatch.setattr(type(solution.system.factor), "solve", refuse)
    gradient = compliance_gradient(solution, np.array([1.0, 2.0]))
    assert set(gradient) == set(NAMES)
    with pytest.raises(AssertionError, match="solved again"):
        solution.adjoint(np.ones_like(problem.forces))


def test_the_adjoint_gradient_and_jax_agree():
    problem = solid()
    w = np.array([1.0, 2.0])
    adjoint = compliance_gradient(solve_solid(problem), w)
    by_jax = jax.grad(lambda v: by_compliance(problem, v))(start(problem))
    for name in NAMES:
        scale = np.abs(adjoint[name]).max() + 1e-30
        np.testing.assert_allclose(by_jax[name], adjoint[name], atol=1e-9 * scale, err_msg=name)


def test_compliance_with_moving_supports_has_the_right_gradient():
    problem = solid(prescribed=True)
    for name in NAMES:
        orders = remainder_orders(lambda v: by_compliance(problem, v), start(problem), name)
        np.testing.assert_allclose(orders, 2, atol=0.1, err_msg=name)


def frame() -> FrameProblem:
    rng = np.random.default_rng(1)
    joints = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0], [3, 3, 10], [8, 8, 9]])
    struts = np.array([[0, 3], [1, 3], [2, 3], [3, 4], [1, 4], [2, 4]])
    fixed = np.zeros((5, 6), bool)
    fixed[:3] = True
    forces = np.where(fixed, 0.0, rng.normal(size=(2, 5, 6)))
    radii = rng.uniform(0.4, 0.8, (6, 2))
    return FrameProblem(joints, struts, radii, 70e3, 0.3, Round(), fixed, np.zeros((5, 6)), forces)


@pytest.mark.parametrize("name", ["joints", "radii", "forces", "value"])
def test_the_same_interface_serves_frames(name):
    problem = frame()

    def tip(values):
        u = displacement(problem, **values)
        return 1e3 * (u[0, 4, 2] + u[1, 3, 0] ** 2 + u[0, 3, 4])

    values = {name: start(problem, (name,))[name]}
    orders = remainder_orders(tip, values, name, steps=(2e-2, 1e-2, 5e-3))
    np.testing.assert_allclose(orders, 2, atol=0.15)


def test_a_factor_is_taken_over_and_then_spent():
    problem = solid()
    first = solve_solid(problem)
    stiffer = replace(problem, modulus=1.5 * problem.modulus)
    second = solve_solid(stiffer, previous=first)
    np.testing.assert_allclose(1.5 * second.displacement, first.displacement, rtol=1e-8, atol=1e-9)
    with pytest.raises(FeaError, match="cannot be used again"):
        first.adjoint(np.ones_like(problem.forces))


def test_another_structure_is_no_previous_one():
    problem = solid()
    other = replace(problem, fixed=~problem.fixed)
    with pytest.raises(FeaError, match="other supports"):
        solve_solid(other, previous=solve_solid(problem))


def test_jit_is_refused_with_the_remedy():
    problem = solid()
    with pytest.raises(FeaError, match="outside"):
        jax.jit(lambda f: displacement(problem, forces=f).sum())(jnp.asarray(problem.forces))


def test_unknown_parameters_and_wrong_shapes_are_refused():
    problem = solid()
    with pytest.raises(FeaError, match='"radius" is no parameter'):
        displacement(problem, radius=jnp.ones(3))
    with pytest.raises(FeaError, match="shape"):
        displacement(problem, forces=jnp.ones((1, 2, 3)))


def test_p_norm_lies_between_mean_and_maximum_and_is_smooth_at_zero():
    values, weights = jnp.asarray([0.0, 1.0, 3.0]), jnp.asarray([1.0, 1.0, 2.0])
    norms = [float(p_norm(values, weights, p=p)) for p in (1.0, 4.0, 16.0, 64.0)]
    np.testing.assert_allclose(norms[0], 7 / 4)
    assert norms == sorted(norms)
    assert 2.9 < norms[-1] < 3.0
    # 1e200 to the 8th overflows unless it is scaled.
    np.testing.assert_allclose(
        p_norm(1e200 * values, weights, p=8.0), 1e200 * p_norm(values, weights, p=8.0)
    )
    gradient = jax.grad(lambda v: p_norm(v, weights, p=8.0))(jnp.zeros(3))
    assert np.isfinite(gradient).all()
    assert np.isnan(p_norm(values.at[1].set(jnp.nan), weights, p=8.0))


@pytest.mark.parametrize("solver", ["superlu", "amg", "jax-cg"])
def test_a_sequence_of_gradients_takes_the_factor_along(solver):
    """Steps of an optimiser: each as good as one that starts afresh."""
    problem, steps = frame(), Sequence()

    def value(radii, sequence):
        u = displacement(problem, solver=solver, sequence=sequence, radii=radii)
        return u[0, 4, 2] ** 2 + u[1, 3, 0]

    for factor in (1.0, 1.1, 0.9):
        radii = jnp.asarray(factor * problem.radii)
        along = jax.grad(value)(radii, steps)
        alone = jax.grad(value)(radii, Sequence())
        np.testing.assert_allclose(along, alone, rtol=1e-6, atol=1e-6 * np.abs(alone).max())
    assert steps.last is not None
    np.testing.assert_array_equal(steps.last.problem.parameters["radii"], radii)


def test_a_failed_step_is_no_start_for_the_next():
    problem, steps = frame(), Sequence()
    displacement(problem, sequence=steps)
    with pytest.raises(FeaError):
        displacement(problem, sequence=steps, radii=jnp.zeros_like(problem.radii))
    assert steps.last is None
    np.testing.assert_allclose(
        displacement(problem, sequence=steps), solve_frame(problem).displacement, rtol=1e-12
    )


def test_another_solver_than_that_of_the_previous_solution_is_refused():
    problem = frame()
    with pytest.raises(FeaError, match='by "superlu", not by "amg"'):
        solve_frame(problem, previous=solve_frame(problem, solver="superlu"), solver="amg")


def test_rows_of_a_jacobian_are_refused_with_the_remedy():
    problem = frame()
    with pytest.raises(FeaError, match=r"jax\.grad"):
        jax.jacrev(lambda r: displacement(problem, radii=r)[0, 3])(jnp.asarray(problem.radii))


def test_single_precision_is_refused_wherever_it_enters():
    problem = frame()
    for name in ("joints", "radii", "forces", "value"):
        single = {name: np.asarray(getattr(problem, name), np.float32)}
        with pytest.raises(FeaError, match=f'"{name}" are float32'):
            solve_frame(replace(problem, **single))


def test_mean_displacement_is_the_work_of_a_unit_force():
    problem = solid()
    facets = end_facets(problem.mesh)
    u = solve_solid(problem).displacement
    area = problem.mesh.facet_integrals(facets)[0].sum()
    load = traction_forces(problem.mesh, facets, np.array([0.0, 0.0, 1.0 / area]))
    mean = mean_displacement(problem.mesh, facets, u)
    np.testing.assert_allclose(mean[:, 2], np.einsum("cni,ni->c", u, load), rtol=1e-12)
