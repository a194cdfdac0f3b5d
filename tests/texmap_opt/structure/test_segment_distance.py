"""Distances of straight segments."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from texmap_opt.structure.segment_distance import segment_distance


def one(a: list, b: list) -> float:
    return float(segment_distance(np.array([a], float), np.array([b], float))[0])


def test_crossing_parallel_and_end_to_end():
    assert one([[0, 0], [1, 1]], [[0, 1], [1, 0]]) == 0
    assert one([[0, 0, 0], [2, 0, 0]], [[1, -1, 3], [1, 1, 3]]) == 3
    assert one([[0, 0], [2, 0]], [[1, 1], [3, 1]]) == 1
    assert one([[0, 0], [1, 0]], [[4, 4], [8, 8]]) == 5
    assert one([[0, 0], [2, 0]], [[1, 0], [3, 0]]) == 0


@settings(max_examples=40, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10_000), d=st.sampled_from([2, 3]))
def test_no_point_of_one_is_nearer_to_the_other(seed, d):
    """Against bounded linear least squares in the positions along both."""
    a, b = np.random.default_rng(seed).normal(size=(2, 2, d))
    best = lsq_linear(np.stack([a[1] - a[0], b[0] - b[1]], axis=1), b[0] - a[0], bounds=(0, 1))
    # The active-set solver stops at 1e-10 of the square.
    np.testing.assert_allclose(
        segment_distance(a[None], b[None])[0], np.sqrt(2 * best.cost), atol=1e-5
    )
