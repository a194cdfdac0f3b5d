import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fea import FeaError
from fea.assembly import Pattern, Reduced


def springs(seed, nodes=12, elements=30, block=3):
    """Random positive definite element matrices between random pairs of nodes."""
    rng = np.random.default_rng(seed)
    chain = np.stack([np.arange(nodes - 1), np.arange(1, nodes)], axis=1)
    extra = np.array([rng.choice(nodes, 2, replace=False) for _ in range(elements)])
    pairs = np.concatenate([chain, extra])
    A = rng.normal(size=(len(pairs), 2 * block, 2 * block))
    return pairs, A @ A.transpose(0, 2, 1)


def dense(pairs, values, nodes, block):
    K = np.zeros((nodes * block, nodes * block))
    for pair, value in zip(pairs, values, strict=True):
        dof = (block * pair[:, None] + np.arange(block)).ravel()
        K[np.ix_(dof, dof)] += value
    return K


@settings(max_examples=20, derandomize=True, deadline=None)
@given(seed=st.integers(0, 1000), block=st.sampled_from([1, 3, 6]))
def test_assembly_is_the_sum_of_element_matrices(seed, block):
    pairs, values = springs(seed, block=block)
    K = Pattern.from_nodes(pairs, 12, block=block).assemble(values)
    np.testing.assert_allclose(K.toarray(), dense(pairs, values, 12, block), atol=1e-12)
    sorted_copy = K.copy()
    sorted_copy.has_sorted_indices = False
    sorted_copy.sort_indices()
    np.testing.assert_array_equal(K.indices, sorted_copy.indices)


def test_dofs_and_blocks_give_the_same_matrix():
    pairs, values = springs(1)
    dofs = (3 * pairs[:, :, None] + np.arange(3)).reshape(len(pairs), -1)
    by_dof = Pattern.from_elements(dofs, 36).assemble(values)
    by_block = Pattern.from_elements(dofs, 36, block=3).assemble(values)
    np.testing.assert_allclose(by_dof.toarray(), by_block.toarray(), atol=1e-12)


def test_dofs_out_of_range_or_out_of_blocks_are_refused():
    with pytest.raises(FeaError, match="0 to 5"):
        Pattern.from_elements(np.array([[0, 6]]), 6)
    with pytest.raises(FeaError, match="blocks of 3"):
        Pattern.from_elements(np.array([[0, 2, 1]]), 6, block=3)


@settings(max_examples=20, derandomize=True, deadline=None)
@given(seed=st.integers(0, 1000))
def test_elimination_solves_the_constrained_problem(seed):
    """Against the textbook partition K_ff u_f = f_f - K_fp p, with partly fixed nodes."""
    rng = np.random.default_rng(seed)
    pairs, values = springs(seed)
    K = Pattern.from_nodes(pairs, 12, block=3).assemble(values)
    fixed = np.zeros(36, dtype=bool)
    fixed[:4] = True
    fixed[rng.choice(36, 5)] = True
    p, f = rng.normal(size=(36, 2)), rng.normal(size=(36, 2))
    reduced = Reduced.from_matrix(K, fixed, block=3)
    k = reduced.matrix(K)
    assert k.shape[0] % 3 == 0
    assert abs(k - k.T).max() < 1e-12
    assert np.linalg.eigvalsh(k.toarray()).min() > 0
    u = reduced.expand(np.linalg.solve(k.toarray(), reduced.load(K, f, p)), p)
    D, free = K.toarray(), ~fixed
    expected = p.copy()
    expected[free] = np.linalg.solve(
        D[np.ix_(free, free)], f[free] - D[np.ix_(free, fixed)] @ p[fixed]
    )
    np.testing.assert_allclose(u, expected, atol=1e-9 * np.abs(expected).max())


def test_reduction_is_reused_for_other_values_on_the_pattern():
    pairs, values = springs(5)
    pattern = Pattern.from_nodes(pairs, 12, block=3)
    fixed = np.zeros(36, dtype=bool)
    fixed[[0, 1, 2, 7]] = True
    reduced = Reduced.from_matrix(pattern.assemble(values), fixed, block=3)
    twice = reduced.matrix(pattern.assemble(2 * values))
    np.testing.assert_allclose(
        twice.toarray(), 2 * reduced.matrix(pattern.assemble(values)).toarray()
    )


def test_components_are_counted():
    pairs = np.array([[0, 1], [2, 3], [3, 4]])
    part = Pattern.from_nodes(pairs, 6, block=1).components()
    assert len(np.unique(part)) == 3
    assert part[0] == part[1] != part[2] == part[3] == part[4] != part[5]
