import numpy as np
import pytest
from scipy.sparse import csr_array

from fea import FeaError, SolveResult, Support, TetMesh, factorise, material, rigid_body_modes
from fea.assembly import Pattern, Reduced
from fea.boundary_conditions import prescribed_dofs
from fea.linear_solve import choice
from fea.linear_solve.direct_pardiso import is_installed
from fea.solid import element_stiffness

SOLVERS = [
    pytest.param(
        "pardiso", marks=pytest.mark.skipif(not is_installed(), reason="pypardiso not installed")
    ),
    "superlu",
    "amg",
]


def solid(supports):
    """A small tet10 cantilever: reduced stiffness and rigid-body modes."""
    mesh = TetMesh.box((40.0, 10.0, 10.0), (8, 2, 2)).to_tet10()
    pattern = Pattern.from_nodes(mesh.tets, len(mesh.nodes), block=3)
    K = pattern.assemble(element_stiffness(mesh, material("steel").stiffness))
    fixed, _ = prescribed_dofs(supports(mesh), len(mesh.nodes))
    reduced = Reduced.from_matrix(K, fixed.ravel(), block=3)
    return reduced.matrix(K), reduced.restrict(rigid_body_modes(mesh.nodes))


def clamped(mesh):
    return [Support.clamp(np.flatnonzero(mesh.nodes[:, 0] < 1e-9))]


def rollers(mesh):
    """Held along x only: five rigid motions are free, nodes are partly fixed."""
    return [
        Support(
            np.flatnonzero(mesh.nodes[:, 0] < 1e-9), np.array([True, False, False]), np.zeros(3)
        )
    ]


@pytest.fixture(scope="module")
def system():
    return solid(clamped)


@pytest.fixture(scope="module")
def free_system():
    return solid(rollers)


@pytest.mark.parametrize("solver", SOLVERS)
def test_every_solver_finds_the_solution(system, solver):
    K, modes = system
    expected = np.random.default_rng(0).normal(size=(K.shape[0], 3))
    factor = factorise(K, near_null=modes, block=3, solver=solver)
    solution = factor.solve(K @ expected)
    assert factor.name == solver
    assert solution.result is SolveResult.CONVERGED
    assert solution.residual <= 1.1e-10
    # Condition number 1e5 times the residual.
    np.testing.assert_allclose(solution.x, expected, atol=1e-5)
    one = factor.solve(K @ expected[:, 0])
    np.testing.assert_allclose(one.x, solution.x[:, 0], atol=1e-9)
    factor.free()


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_factor_follows_new_values_on_its_pattern(system, solver):
    """Stiffness doubled, then made very uneven: kept or rebuilt, the answer is right."""
    K, modes = system
    rng = np.random.default_rng(1)
    b = rng.normal(size=K.shape[0])
    factor = factorise(K, near_null=modes, block=3, solver=solver)
    first = factor.solve(b)
    factor = factor.update(csr_array((2 * K.data, K.indices, K.indptr), K.shape))
    np.testing.assert_allclose(2 * factor.solve(b).x, first.x, atol=1e-6 * abs(first.x).max())
    scale = 10 ** rng.uniform(-2, 2, K.shape[0])
    row = np.repeat(np.arange(K.shape[0]), np.diff(K.indptr))
    uneven = csr_array((K.data * scale[row] * scale[K.indices], K.indices, K.indptr), K.shape)
    factor = factor.update(uneven)
    assert factor.solve(b, throw=False).residual < 1e-6


@pytest.mark.parametrize("solver", SOLVERS)
def test_two_factors_do_not_disturb_each_other(system, solver):
    """The `spsolve` of pypardiso shares one solver; a factor here stays valid beside others."""
    K, modes = system
    other = csr_array((3 * K.data, K.indices, K.indptr), K.shape)
    b = np.random.default_rng(2).normal(size=K.shape[0])
    one = factorise(K, near_null=modes, block=3, solver=solver)
    before = one.solve(b).x
    two = factorise(other, near_null=modes, block=3, solver=solver)
    np.testing.assert_allclose(3 * two.solve(b).x, before, atol=1e-7 * abs(before).max())
    two.free()
    np.testing.assert_array_equal(one.solve(b).x, before)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_solid_that_can_move_is_singular(free_system, solver):
    K, modes = free_system
    with pytest.raises(FeaError, match="Stiffness is singular"):
        factorise(K, near_null=modes, block=3, solver=solver)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_dof_without_stiffness_is_singular(solver):
    K = csr_array((np.array([1.0, 0.0, 2.0]), np.arange(3), np.arange(4)), (3, 3))
    with pytest.raises(FeaError, match="singular"):
        factorise(K, solver=solver)


@pytest.mark.parametrize("solver", SOLVERS)
def test_stiffness_that_is_not_a_number_is_refused(solver):
    K = csr_array((np.array([1.0, np.nan]), np.arange(2), np.arange(3)), (2, 2))
    with pytest.raises(FeaError, match="NaN"):
        factorise(K, solver=solver)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_fully_supported_model_has_nothing_to_solve(solver):
    K = csr_array((0, 0))
    assert factorise(K, solver=solver).solve(np.zeros((0, 2))).x.shape == (0, 2)


def test_multigrid_starts_from_a_given_solution_and_repeats_itself(system):
    K, modes = system
    b = np.random.default_rng(3).normal(size=K.shape[0])
    cold = factorise(K, near_null=modes, block=3, solver="amg").solve(b)
    factor = factorise(K, near_null=modes, block=3, solver="amg")
    np.testing.assert_array_equal(factor.solve(b).x, cold.x)
    warm = factor.solve(b, x0=cold.x)
    assert warm.iterations <= 1 < cold.iterations


def test_multigrid_leaves_the_global_generator_alone(system):
    K, modes = system
    before = np.random.get_state()[1].copy()  # noqa: NPY002 - the state that must not change
    factorise(K, near_null=modes, block=3, solver="amg")
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002


def test_failure_is_a_result_when_not_thrown(system, monkeypatch):
    from fea.linear_solve import amg

    K, modes = system
    monkeypatch.setattr(amg, "MAX_ITERATIONS", 2)
    factor = factorise(K, near_null=modes, block=3, solver="amg")
    b = np.random.default_rng(4).normal(size=K.shape[0])
    assert factor.solve(b, throw=False).result is SolveResult.NOT_CONVERGED
    with pytest.raises(FeaError, match="did not converge"):
        factor.solve(b)


def test_unknown_and_missing_solvers_are_refused(monkeypatch):
    with pytest.raises(FeaError, match="choose one of"):
        choice.chosen(10, "lu", block=3, has_modes=True)
    monkeypatch.setattr(choice, "is_installed", lambda: False)
    with pytest.raises(FeaError, match="install pypardiso"):
        choice.chosen(10, "pardiso", block=3, has_modes=True)
    assert choice.chosen(10, "auto", block=3, has_modes=True) == "superlu"


def test_auto_takes_the_direct_solver_for_small_and_multigrid_for_large_models(monkeypatch):
    monkeypatch.setattr(choice, "is_installed", lambda: True)
    for dofs, block, name in [
        (1_000, 3, "pardiso"),
        (90_000, 3, "pardiso"),
        (90_000, 6, "amg"),
        (150_000, 3, "amg"),
    ]:
        assert choice.chosen(dofs, "auto", block=block, has_modes=True) == name
    # Without rigid-body modes multigrid is too slow to be chosen.
    assert choice.chosen(150_000, "auto", block=3, has_modes=False) == "pardiso"
