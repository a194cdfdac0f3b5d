"""Solids as problems: what K is, what becomes of a rigid motion, and what is refused."""

import copy
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fea import (
    FeaError,
    Material,
    SolidProblem,
    Support,
    TetMesh,
    quadrature_stress,
    solve_solid,
)
from fea.materials import Orthotropic
from fea.system import Assembled

STEEL = Material(E=210e3, nu=0.3, density=7.85e-9)
WOOD = Orthotropic(
    E=(11e3, 0.9e3, 0.6e3), nu=(0.4, 0.4, 0.35), G=(0.05e3, 0.7e3, 0.75e3), density=0.5e-9
)


def block(element="tet10", *, curved=False, material=STEEL) -> SolidProblem:
    rng = np.random.default_rng(2)
    mesh = TetMesh.box((3.0, 2.0, 1.0), (3, 2, 1))
    mesh = TetMesh(mesh.nodes + rng.uniform(-0.05, 0.05, mesh.nodes.shape), mesh.tets)
    mesh = mesh if element == "tet4" else mesh.to_tet10()
    if curved:
        mesh = mesh.with_nodes(mesh.nodes + 0.02 * np.sin(7 * mesh.nodes[:, ::-1]))
    clamp = Support.clamp(np.flatnonzero(mesh.nodes[:, 0] < 0.1))
    return SolidProblem.from_supports(mesh, material, [clamp], rng.normal(size=mesh.nodes.shape))


def forged(problem, **fields):
    """A problem as it comes without the runtime checks of shapes that these tests switch on."""
    other = copy.copy(problem)
    for name, value in fields.items():
        object.__setattr__(other, name, value)
    return other


def rigid(nodes, shift, turn):
    return np.array(shift) + np.cross(np.array(turn), nodes)


@settings(max_examples=5, derandomize=True, deadline=None)
@given(st.tuples(*[st.floats(-1, 1)] * 3), st.tuples(*[st.floats(-1, 1)] * 3))
@pytest.mark.parametrize("element", ["tet4", "tet10"])
def test_a_rigid_motion_costs_no_force_and_gives_no_stress(element, shift, turn):
    problem = block(element, curved=element == "tet10", material=WOOD)
    u = rigid(problem.mesh.nodes, shift, turn)
    K = Assembled.of(problem).stiffness(problem)[0]
    # Some 1e4 N/mm times 1 mm before it cancels.
    np.testing.assert_allclose(K @ u.ravel(), 0, atol=1e-9 * abs(K).max())
    np.testing.assert_allclose(quadrature_stress(problem, u[None]), 0, atol=1e-9 * 11e3)


@pytest.mark.parametrize("material", [STEEL, WOOD])
@pytest.mark.parametrize("element", ["tet4", "tet10"])
def test_the_operator_without_a_matrix_multiplies_as_the_matrix_does(element, material):
    problem = block(element, curved=element == "tet10", material=material)
    rng = np.random.default_rng(0)
    cells, quad = len(problem.mesh.tets), len(problem.mesh.element_type.quadrature.weights)
    problem = replace(problem, modulus=rng.uniform(0.5, 2.0, (cells, quad)))
    K, _ = Assembled.of(problem).stiffness(problem)
    x = rng.normal(size=(K.shape[0], 2))
    free = problem.operator(np.zeros_like(problem.fixed))
    np.testing.assert_allclose(free @ x, K @ x, atol=1e-11 * abs(K).max())
    dense = K.toarray()
    own = [dense[3 * n : 3 * n + 3, 3 * n : 3 * n + 3] for n in range(10)]
    np.testing.assert_allclose(free.diagonal[:10], own, atol=1e-11 * abs(K).max())


@pytest.mark.parametrize("element", ["tet4", "tet10"])
def test_twice_the_modulus_is_half_the_displacement_and_the_same_stress(element):
    problem = block(element)
    stiff = replace(problem, modulus=2 * problem.modulus)
    one, two = solve_solid(problem), solve_solid(stiff)
    np.testing.assert_allclose(2 * two.displacement, one.displacement, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(two.stress, one.stress, atol=1e-8 * np.abs(one.stress).max())


def test_solving_without_a_matrix_gives_the_same():
    problem = block()
    one, two = solve_solid(problem), solve_solid(problem, solver="jax-cg")
    scale = np.abs(one.displacement).max()
    np.testing.assert_allclose(two.displacement, one.displacement, atol=1e-8 * scale)
    np.testing.assert_allclose(two.reaction, one.reaction, atol=1e-7)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"modulus": lambda p: 0 * p.modulus}, "relative modulus of cell 0 is 0"),
        ({"modulus": lambda p: p.modulus.astype(np.float32)}, "single precision"),
        ({"forces": lambda p: np.full_like(p.forces, np.nan)}, "not a number"),
        ({"forces": lambda p: p.forces * p.fixed}, "acts only where the structure is held"),
        ({"fixed": lambda p: np.zeros_like(p.fixed)}, "add a support"),
        ({"mesh": lambda p: TetMesh(0 * p.mesh.nodes, p.mesh.tets)}, "flat or inverted"),
        ({"modulus": lambda p: p.modulus[1:]}, "Relative moduli have shape"),
        ({"modulus": lambda p: np.repeat(p.modulus, 3, axis=1)}, "one a cell, or"),
        ({"forces": lambda p: p.forces[:, 1:]}, "Forces have shape"),
        ({"value": lambda p: p.value[1:]}, '"value" has shape'),
        ({"value": lambda p: np.where(p.fixed, np.nan, 0.0)}, "not a number"),
    ],
)
def test_impossible_solids_are_refused_by_name(change, message):
    problem = block()
    wrong = {name: make(problem) for name, make in change.items()}
    with pytest.raises(FeaError, match=message):
        solve_solid(forged(problem, **wrong))


def test_single_precision_jax_is_refused():
    problem = block("tet4")
    with jax.enable_x64(False), pytest.raises(FeaError, match="jax_enable_x64"):
        solve_solid(problem)


def test_a_hinge_is_named_with_its_axis():
    """Two blocks that share an edge only: the second turns about it."""
    one = TetMesh.box((1.0, 1.0, 1.0), (1, 1, 1))
    two = TetMesh.box((1.0, 1.0, 1.0), (1, 1, 1), origin=(1.0, 0.0, 1.0))
    nodes = np.concatenate([one.nodes, two.nodes])
    _, first, number = np.unique(nodes, axis=0, return_index=True, return_inverse=True)
    tets = number.ravel()[np.concatenate([one.tets, two.tets + len(one.nodes)])]
    mesh = TetMesh(nodes[first], tets)
    clamp = Support.clamp(np.flatnonzero(mesh.nodes[:, 0] == 0))
    forces = np.zeros_like(mesh.nodes)
    forces[-1, 2] = 1.0
    problem = SolidProblem.from_supports(mesh, STEEL, [clamp], forces)
    with pytest.raises(FeaError, match=r"turn about an axis along y"):
        solve_solid(problem)


def test_whole_numbers_and_jax_arrays_are_as_good_as_floats():
    problem = block()
    forces = np.zeros(problem.forces.shape, int)
    forces[0, -1, 2] = 3
    wanted = solve_solid(replace(problem, forces=forces.astype(float))).displacement
    for same in (forces, jnp.asarray(forces, float)):
        found = solve_solid(forged(problem, forces=same)).displacement
        np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("solver", ["auto", "amg", "jax-cg"])
def test_a_solid_that_is_prescribed_everywhere_has_just_that_displacement(solver):
    problem = block("tet4")
    value = np.random.default_rng(1).normal(size=problem.value.shape)
    whole = replace(problem, fixed=np.ones_like(problem.fixed), value=value)
    np.testing.assert_array_equal(solve_solid(whole, solver=solver).displacement[0], value)


def test_stress_of_another_mesh_is_refused():
    """JAX by itself would take the last node for every number that is too large."""
    problem, other = block("tet10"), block("tet4")
    u = solve_solid(other).displacement
    with pytest.raises(FeaError, match='"displacement" has shape'):
        quadrature_stress(problem, u)
    with pytest.raises(FeaError, match='"modulus" has shape'):
        quadrature_stress(other, u, modulus=other.modulus[1:])
