import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fea import FeaError
from fea.assembly import Pattern, Reduced, node_pairs

NODES = 12


def elements(seed, corners, block):
    """Random symmetric positive definite element matrices on random nodes, all nodes connected."""
    rng = np.random.default_rng(seed)
    chain = (np.arange(NODES)[:, None] + np.arange(corners)) % NODES
    extra = np.array([rng.choice(NODES, corners, replace=False) for _ in range(10)])
    owners = rng.permuted(np.concatenate([chain, extra]), axis=1)
    A = rng.normal(size=(len(owners), corners * block, corners * block))
    return owners, A @ A.transpose(0, 2, 1)


def as_pairs(values, corners, block):
    a, b = node_pairs(corners)
    blocks = values.reshape(-1, corners, block, corners, block)
    return np.stack([blocks[:, i, :, j] for i, j in zip(a, b, strict=True)], axis=1)


def assembled(seed, corners, block):
    owners, values = elements(seed, corners, block)
    pattern = Pattern.from_groups([owners], NODES)
    return pattern, pattern.assemble(as_pairs(values, corners, block)), owners, values


def dense(owners, values, block):
    K = np.zeros((NODES * block, NODES * block))
    for nodes, value in zip(owners, values, strict=True):
        dof = (block * nodes[:, None] + np.arange(block)).ravel()
        K[np.ix_(dof, dof)] += value
    return K


@settings(max_examples=20, derandomize=True, deadline=None)
@given(seed=st.integers(0, 1000), block=st.sampled_from([1, 3, 6]), corners=st.sampled_from([2, 4]))
def test_assembly_is_the_sum_of_element_matrices(seed, block, corners):
    _, K, owners, values = assembled(seed, corners, block)
    expected = dense(owners, values, block)
    np.testing.assert_allclose(K.toarray(), expected, atol=1e-12 * np.abs(expected).max())
    for row in np.split(K.indices, K.indptr[1:-1]):
        assert (np.diff(row) > 0).all()


def test_a_pair_taken_without_its_transpose_is_noticed():
    """Negative control: element blocks handed over the wrong way round."""
    owners, values = elements(0, 4, 3)
    pattern = Pattern.from_groups([owners], NODES)
    wrong = as_pairs(values, 4, 3).transpose(0, 1, 3, 2)
    assert np.abs(pattern.assemble(wrong).toarray() - dense(owners, values, 3)).max() > 0.1


def test_nodes_out_of_range_are_refused():
    with pytest.raises(FeaError, match="nodes 0 to 5"):
        Pattern.from_groups([np.array([[0, 6]])], 6)


def test_a_node_without_elements_is_an_explicit_zero_pivot():
    K = Pattern.from_groups([np.array([[0, 1]])], 3).assemble(np.ones((1, 3, 2, 2)))
    assert K.indptr[3] - K.indptr[2] == 1
    assert not K.toarray()[4:].any()


@settings(max_examples=20, derandomize=True, deadline=None)
@given(seed=st.integers(0, 1000))
def test_elimination_solves_the_constrained_problem(seed):
    """Against the textbook partition K_ff u_f = f_f - K_fp p, with partly fixed nodes."""
    rng = np.random.default_rng(seed)
    pattern, K, _, _ = assembled(seed, 4, 3)
    fixed = rng.random((NODES, 3)) < 0.3
    fixed[:2] = True
    value = rng.normal(size=(NODES, 3))
    forces = rng.normal(size=(2, NODES, 3))

    full, free, p = K.toarray(), ~fixed.ravel(), fixed.ravel()
    expected = np.where(p, value.ravel(), 0.0)[None].repeat(2, axis=0)
    load = forces.reshape(2, -1) - full[:, p] @ value.ravel()[p]
    expected[:, free] = np.linalg.solve(full[np.ix_(free, free)], load[:, free].T).T

    reduced = Reduced.from_pattern(pattern, fixed)
    small = reduced.matrix(K).toarray()
    np.testing.assert_array_equal(small, small.T)
    moved = (full @ np.where(fixed, value, 0.0).ravel()).reshape(NODES, 3)
    rhs = reduced.restrict(np.moveaxis(forces - moved, 0, -1))
    u = reduced.expand(np.linalg.solve(small, rhs), value)
    np.testing.assert_allclose(u.reshape(2, -1), expected, atol=1e-8 * np.abs(expected).max())


def test_the_reduced_matrix_of_a_definite_matrix_is_definite():
    pattern, K, _, _ = assembled(3, 4, 3)
    fixed = np.zeros((NODES, 3), dtype=bool)
    fixed[4] = True
    fixed[7, 1] = True
    small = Reduced.from_pattern(pattern, fixed).matrix(K).toarray()
    assert len(small) == 3 * (NODES - 1)
    assert np.linalg.eigvalsh(small).min() > 0
