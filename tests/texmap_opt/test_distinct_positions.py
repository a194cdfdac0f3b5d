"""Welding by one number a vertex gives what sorting rows gives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from texmap_opt import part_file
from texmap_opt.part_file import distinct_positions


def agrees(vertices: np.ndarray) -> None:
    rows, index = np.unique(vertices + 0.0, axis=0, return_inverse=True)
    found, place = distinct_positions(vertices)
    np.testing.assert_array_equal(found, rows)
    np.testing.assert_array_equal(place, index.reshape(-1))


@settings(max_examples=60, derandomize=True, deadline=None)
@given(
    arrays(
        np.float64,
        st.tuples(st.integers(0, 30), st.just(3)),
        elements=st.sampled_from([0.0, -0.0, 1.0, -1.0, 1 + 2**-52, 1e-320, 3e8, -7.5]),
    )
)
def test_positions_and_places_are_those_of_sorted_rows(vertices):
    agrees(vertices)


@pytest.mark.parametrize("oblique", [(1.0, 1.0, 1.0), (0.0, 0.0, 1.0)])
def test_positions_of_equal_height_are_told_apart(monkeypatch, oblique):
    """Along a diagonal most points of a grid share their height."""
    monkeypatch.setattr(part_file, "OBLIQUE", oblique)
    agrees(np.random.default_rng(3).integers(-3, 4, (500, 3)).astype(float))
