"""How linear solves end, what may be given to them, and what a caller may vouch for."""

import jax
import numpy as np
import pytest
from scipy.sparse import bsr_array, bsr_matrix, coo_array, csc_array, csr_array, csr_matrix

from fea import FeaError, SolveResult, Support, TetMesh, factorise, material, rigid_body_modes
from fea.linear_solve import SingularStiffness, amg, cg_jax, interface
from fea.linear_solve.direct_pardiso import is_installed
from fea.linear_solve.element_operator import MATRIX_FREE
from fea.solid import SolidProblem
from fea.system import Assembled

needs_mkl = pytest.mark.skipif(not is_installed(), reason="pypardiso not installed")
PARDISO = pytest.param("pardiso", marks=needs_mkl)
ITERATIVE = ["amg", MATRIX_FREE]
DIRECT = [PARDISO, "superlu"]
SOLVERS = [*DIRECT, *ITERATIVE]


def bar(length, cells, *, held=True):
    """A bar of tet4, 10 x 10 mm, clamped at one end or not at all: stiffness and rigid motions."""
    mesh = TetMesh.box((length, 10.0, 10.0), cells)
    clamp = Support.clamp(np.flatnonzero(mesh.nodes[:, 0] < 1e-9))
    forces = np.zeros((1, *mesh.nodes.shape))
    supports = [clamp] if held else []
    problem = SolidProblem.from_supports(mesh, material("steel"), supports, forces)
    form = Assembled.of(problem)
    modes = rigid_body_modes(mesh.nodes).reshape(-1, 3, 6)
    return form.stiffness(problem)[1], form.restrict(np.moveaxis(modes, -1, 0))


@pytest.fixture(scope="module")
def system():
    return bar(40.0, (8, 2, 2))


@pytest.fixture(scope="module")
def slender():
    """1000 times as long as thick: rounding of the solution alone leaves residuals of 1e-7."""
    return bar(10_000.0, (40, 1, 1))


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_residual_that_rounding_keeps_up_is_judged_alike_for_all_solvers(slender, solver):
    K, modes = slender
    b = np.random.default_rng(0).normal(size=K.shape[0])
    factor = factorise(K, near_null=modes, solver=solver)
    solution = factor.solve(b)
    assert 1e-9 < solution.residual < interface.RESIDUAL_LIMIT
    assert solution.result is SolveResult.CONVERGED
    # Whoever asks for less gets it or an error; the figures say by how much it is missed.
    result = factor.solve(b, rtol=1e-10, throw=False).result
    assert result is SolveResult.TOLERANCE_MISSED
    with pytest.raises(
        FeaError, match=r"misses the tolerance.*\(residual \d\S*e-0[78].*rtol 1e-10"
    ) as told:
        factor.solve(b, rtol=1e-10)
    assert ("iterations" in str(told.value).split("(")[-1]) == (solver in ITERATIVE)
    assert factor.solve(b, rtol=1e-6).residual <= 1e-6


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_residual_above_the_limit_is_an_error_with_its_figures(slender, solver, monkeypatch):
    monkeypatch.setattr(interface, "RESIDUAL_LIMIT", 1e-9)
    K, modes = slender
    b = np.random.default_rng(0).normal(size=K.shape[0])
    factor = factorise(K, near_null=modes, solver=solver)
    with pytest.raises(FeaError, match=r"near 0\.5.*\(residual \d.*limit 1e-09"):
        factor.solve(b)
    result = factor.solve(b, throw=False).result
    assert result in (SolveResult.INACCURATE, SolveResult.NOT_CONVERGED)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("rtol", [1e-4, 1e-8, 1e-10])
def test_a_tolerance_asked_for_is_kept(system, solver, rtol):
    K, modes = system
    b = np.random.default_rng(1).normal(size=(K.shape[0], 2))
    assert factorise(K, near_null=modes, solver=solver).solve(b, rtol=rtol).residual <= rtol


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_spent_factor_says_what_to_use_instead(system, solver):
    K, modes = system
    b = np.ones(K.shape[0])
    old = factorise(K, near_null=modes, solver=solver)
    new = old.update(K)
    with pytest.raises(FeaError, match="use that one"):
        old.solve(b)
    with pytest.raises(FeaError, match="use that one"):
        old.update(K)
    old.free()  # does not touch what the new factor uses
    new.solve(b)
    new.free()
    new.free()
    with pytest.raises(FeaError, match="was freed; factorise"):
        new.solve(b)


@pytest.mark.parametrize("solver", SOLVERS)
def test_loads_that_are_not_numbers_are_a_result(system, solver):
    K, modes = system
    b = np.ones(K.shape[0])
    b[7] = np.inf
    factor = factorise(K, near_null=modes, solver=solver)
    solution = factor.solve(b, throw=False)
    assert solution.result is SolveResult.NOT_FINITE
    assert np.isnan(solution.x).all()
    with pytest.raises(FeaError, match="NaN"):
        factor.solve(b)


@pytest.mark.parametrize("solver", ITERATIVE)
def test_failure_is_a_result_when_not_thrown(system, solver, monkeypatch):
    K, modes = system
    monkeypatch.setattr({"amg": amg, MATRIX_FREE: cg_jax}[solver], "MAX_ITERATIONS", 2)
    factor = factorise(K, near_null=modes, solver=solver)
    b = np.random.default_rng(4).normal(size=K.shape[0])
    solution = factor.solve(b, throw=False)
    assert solution.result is SolveResult.NOT_CONVERGED
    assert solution.iterations == 2
    with pytest.raises(FeaError, match="did not converge"):
        factor.solve(b)


def test_a_factor_whose_update_failed_says_so(system):
    K, modes = system
    factor = factorise(K, near_null=modes)
    nothing = bsr_array((0 * K.data, K.indices, K.indptr), K.shape)
    with pytest.raises(SingularStiffness):
        factor.update(nothing)
    with pytest.raises(FeaError, match="its update failed; factorise the stiffness afresh"):
        factor.solve(np.ones(K.shape[0]))
    factor.free()


def test_a_motion_too_soft_to_trust_is_refused_with_its_energy():
    """A spring that rounding of the stiff ones beside it all but hides."""
    soft = 5e-15
    K = csr_array(np.array([[1.0 + soft, -1.0], [-1.0, 1.0 + soft]]))
    with pytest.raises(FeaError, match=r"too many digits.*times the energy .* limit 100"):
        factorise(K, solver="superlu")


@pytest.mark.parametrize("form", [csr_matrix, csc_array, coo_array, bsr_matrix, np.asarray])
def test_any_kind_of_matrix_is_taken(system, form):
    K, modes = system
    given = form(K.toarray() if form is np.asarray else K)
    b = np.random.default_rng(2).normal(size=K.shape[0])
    factor = factorise(given, near_null=modes)
    np.testing.assert_allclose(factor.solve(b).x, factorise(K).solve(b).x, atol=1e-9)
    factor = factor.update(2 * given)
    np.testing.assert_allclose(2 * factor.solve(b).x, factorise(K).solve(b).x, atol=1e-9)


def test_entries_given_twice_are_added():
    K = csr_array((np.array([1.0, 1.0, 4.0]), np.array([0, 0, 1]), np.array([0, 2, 3])), (2, 2))
    np.testing.assert_allclose(factorise(K).solve(np.array([2.0, 4.0])).x, 1.0)
    assert K.nnz == 3


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(
    "load", [[2, 0, 1], [2.0, 0.0, 1.0], np.array([2, 0, 1]), jax.numpy.array([2.0, 0.0, 1.0])]
)
def test_loads_may_be_lists_whole_numbers_or_arrays_of_jax(load, solver):
    K = csr_matrix(np.array([[2, -1, 0], [-1, 2, -1], [0, -1, 2]]))
    np.testing.assert_allclose(factorise(K, solver=solver).solve(load).x, [1.75, 1.5, 1.25])


def test_what_is_no_matrix_no_load_and_no_tolerance_is_refused():
    with pytest.raises(FeaError, match="complex128, which is no real"):
        factorise(csr_array(np.eye(3) * 1j))
    with pytest.raises(FeaError, match="is a ndarray"):
        factorise(np.ones(3))
    factor = factorise(csr_array(np.eye(3)))
    with pytest.raises(FeaError, match="Loads are not a rectangular"):
        factor.solve([1.0, [2.0, 3.0], 4.0])
    with pytest.raises(FeaError, match="Loads are <U1"):
        factor.solve(["a", "b", "c"])
    with pytest.raises(FeaError, match=r"have shape \(3, 1, 1\)"):
        factor.solve(np.ones((3, 1, 1)))
    with pytest.raises(FeaError, match="starting point has shape"):
        factor.solve(np.ones((3, 2)), x0=np.ones(3))
    with pytest.raises(FeaError, match="rtol is 0"):
        factor.solve(np.ones(3), rtol=0.0)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_start_that_is_not_a_number_is_refused(system, solver):
    K, modes = system
    b = np.ones(K.shape[0])
    with pytest.raises(FeaError, match="NaN"):
        factorise(K, near_null=modes, solver=solver).solve(b, x0=np.nan * b)


@pytest.mark.parametrize("solver", SOLVERS)
def test_free_motions_are_looked_for_unless_the_caller_vouches_that_none_is(
    system, solver, monkeypatch
):
    K, modes = system
    b = np.random.default_rng(3).normal(size=K.shape[0])
    expected = factorise(K, near_null=modes, solver=solver).solve(b).x
    looked = []
    for check in ("check_rigid_motion", "check_held", "check_definite"):
        monkeypatch.setattr(interface, check, lambda *_, name=check: looked.append(name))
    factor = factorise(K, near_null=modes, solver=solver, definite=True)
    np.testing.assert_allclose(factor.solve(b).x, expected, atol=1e-7 * abs(expected).max())
    factor = factor.update(bsr_array((2 * K.data, K.indices, K.indptr), K.shape))
    np.testing.assert_allclose(2 * factor.solve(b).x, expected, atol=1e-7 * abs(expected).max())
    assert not looked
    factorise(K, near_null=modes, solver=solver)
    assert looked


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_caller_who_vouches_wrongly_gets_an_error_and_no_number(solver):
    """A load that sets a free motion going: the pivots, the iteration or the answer show it."""
    K, modes = bar(40.0, (8, 2, 2), held=False)
    with pytest.raises(FeaError):
        factorise(K, near_null=modes, solver=solver, definite=True).solve(np.ones(len(modes)))


def test_a_caller_who_vouches_still_may_not_give_stiffness_that_is_none(system):
    K, _ = system
    for data, words in ((np.nan * K.data, "NaN"), (-K.data, "singular")):
        with pytest.raises(FeaError, match=words):
            factorise(bsr_array((data, K.indices, K.indptr), K.shape), definite=True)
