"""Lowest positive eigenvalues of K x = lambda B x: copies, signs, and how failures end."""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse import bsr_array, diags_array, eye_array, kron

from fea import FeaError, factorise
from fea import eigenpairs as module
from fea.eigenpairs import EigenResult, lowest_eigenpairs

# Nodes along a side of a square membrane, enough for the iterative way.
SIDE = 24


def membrane(side: int = SIDE) -> bsr_array:
    """The five-point Laplacian of a square, held at its edge."""
    line = diags_array(
        [-np.ones(side - 1), 2 * np.ones(side), -np.ones(side - 1)], offsets=[-1, 0, 1]
    )
    one = eye_array(side)
    return bsr_array((kron(line, one) + kron(one, line)).tobsr((1, 1)))


def membrane_eigenvalues(side: int = SIDE) -> np.ndarray:
    """Closed form: sums of two eigenvalues of the line; most come twice."""
    line = 2 - 2 * np.cos(np.arange(1, side + 1) * np.pi / (side + 1))
    return np.sort((line[:, None] + line).ravel())


def diagonal(values: np.ndarray) -> bsr_array:
    return bsr_array(diags_array(values).tobsr((1, 1)))


@pytest.mark.parametrize("side", [12, SIDE])  # dense, iterative
@pytest.mark.parametrize("modes", [1, 2, 7])
def test_every_copy_of_a_repeated_eigenvalue_is_found(side, modes):
    K = membrane(side)
    found = lowest_eigenpairs(factorise(K), diagonal(np.ones(side**2)), modes=modes)
    assert found.result is EigenResult.CONVERGED
    assert (found.steps == 0) is (side**2 <= module.DENSE)
    # An eigenvalue's error is the square of the residual, 1e-8: rounding is left.
    np.testing.assert_allclose(found.values, membrane_eigenvalues(side)[:modes], rtol=1e-12)
    assert found.residual.max() <= module.RELATIVE_RESIDUAL
    gram = found.vectors.T @ (K @ found.vectors)
    np.testing.assert_allclose(gram, np.eye(modes), atol=1e-8)


def test_positive_eigenvalues_are_found_below_larger_negative_ones():
    """A reversed load that would buckle at a tenth of the factor must not be taken for it."""
    K = membrane()
    x = np.linspace(0, 1, SIDE)
    B = diagonal(np.where(x[:, None] + 0 * x < 0.4, 1.0, -10.0).ravel())
    found = lowest_eigenpairs(factorise(K), B, modes=3)
    mu = eigh(B.toarray(), K.toarray(), eigvals_only=True)
    assert mu[0] < -10 * mu[-1]
    np.testing.assert_allclose(found.values, 1 / mu[::-1][:3], rtol=1e-10)


@pytest.mark.parametrize("side", [6, SIDE])
def test_nothing_positive_is_a_result_and_an_error(side):
    factor, B = factorise(membrane(side)), diagonal(-np.ones(side**2))
    found = lowest_eigenpairs(factor, B, modes=2, throw=False)
    assert found.result is EigenResult.NONE_POSITIVE
    assert np.isnan(found.values).all()
    with pytest.raises(FeaError, match=r"nothing is in compression.*0 of 2 modes"):
        lowest_eigenpairs(factor, B, modes=2)


@pytest.mark.parametrize("side", [6, SIDE])
def test_fewer_modes_than_asked_for(side):
    """Mass at two nodes only: two frequencies."""
    mass = np.zeros(side**2)
    mass[[3, side**2 // 2]] = 1.0
    found = lowest_eigenpairs(factorise(membrane(side)), diagonal(mass), modes=4, throw=False)
    assert found.result is EigenResult.TOO_FEW
    assert np.isfinite(found.values).tolist() == [True, True, False, False]
    mu = eigh(np.diag(mass), membrane(side).toarray(), eigvals_only=True)
    np.testing.assert_allclose(found.values[:2], 1 / mu[::-1][:2], rtol=1e-10)


@pytest.mark.parametrize("side", [12, SIDE])
def test_vectors_to_leave_out_are_left_out(side):
    factor, B = factorise(membrane(side)), diagonal(np.ones(side**2))
    first = lowest_eigenpairs(factor, B, modes=3)
    rest = lowest_eigenpairs(factor, B, modes=2, without=first.vectors)
    np.testing.assert_allclose(rest.values, membrane_eigenvalues(side)[3:5], rtol=1e-10)


@pytest.mark.parametrize("side", [12, SIDE])
def test_an_almost_singular_matrix_without_its_softest_vector(side):
    """A membrane free at its edge, on a foundation a billion times softer."""
    ends = 2 * np.ones(side)
    ends[[0, -1]] = 1.0
    line = diags_array([-np.ones(side - 1), ends, -np.ones(side - 1)], offsets=[-1, 0, 1])
    one, soft = eye_array(side), 1e-9
    K = bsr_array((kron(line, one) + kron(one, line) + soft * kron(one, one)).tobsr((1, 1)))
    flat = np.ones((side**2, 1))
    found = lowest_eigenpairs(
        factorise(K, definite=True), diagonal(np.ones(side**2)), modes=3, without=flat
    )
    waves = 2 - 2 * np.cos(np.arange(side) * np.pi / side)
    exact = np.sort((waves[:, None] + waves).ravel())[1:4] + soft
    np.testing.assert_allclose(found.values, exact, rtol=1e-10)


def test_an_iterative_factor_gives_the_same():
    """Solves of a hundredth's accuracy only slow the outer iteration down."""
    K, B = membrane(), diagonal(np.ones(SIDE**2))
    rough = factorise(K, near_null=np.ones((SIDE**2, 1)), solver="amg")
    found = lowest_eigenpairs(rough, B, modes=4)
    np.testing.assert_allclose(found.values, membrane_eigenvalues()[:4], rtol=1e-12)


def test_the_basis_may_be_condensed_on_the_way(monkeypatch):
    monkeypatch.setattr(module, "BASIS_BLOCKS", 4)
    monkeypatch.setattr(module, "KEPT_BLOCKS", 2)
    found = lowest_eigenpairs(factorise(membrane()), diagonal(np.ones(SIDE**2)), modes=5)
    np.testing.assert_allclose(found.values, membrane_eigenvalues()[:5], rtol=1e-12)


def test_an_unfinished_iteration_says_so(monkeypatch):
    monkeypatch.setattr(module, "STEPS", 2)
    factor, B = factorise(membrane()), diagonal(np.ones(SIDE**2))
    found = lowest_eigenpairs(factor, B, modes=3, throw=False)
    assert found.result is EigenResult.NOT_CONVERGED
    with pytest.raises(FeaError, match=r"did not converge.*3 of 3 modes found, residual"):
        lowest_eigenpairs(factor, B, modes=3)


def test_runs_are_repeatable():
    factor, B = factorise(membrane()), diagonal(np.ones(SIDE**2))
    one, two = (lowest_eigenpairs(factor, B, modes=2) for _ in range(2))
    np.testing.assert_array_equal(one.vectors, two.vectors)


def test_impossible_questions_are_refused():
    factor = factorise(membrane(4))
    with pytest.raises(FeaError, match="modes = 0; ask for at least one"):
        lowest_eigenpairs(factor, diagonal(np.ones(16)), modes=0)
    with pytest.raises(FeaError, match="NaN or infinite"):
        lowest_eigenpairs(factor, diagonal(np.full(16, np.nan)), modes=1)
