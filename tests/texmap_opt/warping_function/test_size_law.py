"""The size law: its exponent, the contrast, and what the contrast limit leaves alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt.errors import WarpError
from texmap_opt.warping_function.size_law import SizeLaw, limited, window_centre

L = jnp.asarray(0.6)


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ({"exponent": 0.0}, "exponent is 0, but must be a positive number"),
        ({"exponent": float("nan")}, "exponent is nan"),
        ({"contrast": 0.5}, "contrast is 0.5, .* must be at least 1"),
        ({"contrast": float("inf")}, "contrast is inf"),
    ],
)
def test_impossible_laws_are_refused(law, words):
    with pytest.raises(WarpError, match=words):
        SizeLaw(**law)


def test_the_window_is_as_wide_as_exponent_and_contrast_say():
    """Size runs from exp(-pL) to exp(pL): their ratio is exp(2pL), the contrast."""
    for exponent, contrast in ((1.0, 3.0), (0.5, 2.0), (2.0, 10.0)):
        law = SizeLaw(exponent=exponent, contrast=contrast)
        np.testing.assert_allclose(np.exp(2 * exponent * law.limit), contrast, rtol=1e-12)


@settings(max_examples=25, deadline=None)  # JAX compiles in the first
@given(st.floats(-20, 20))
def test_the_limit_is_odd_monotone_and_never_exceeded(v):
    value, slope = jax.value_and_grad(lambda v: limited(v, L))(jnp.asarray(v))
    # Far beyond the limit it is reached to rounding.
    assert abs(value) <= L * (1 + 1e-15) and slope >= 0
    np.testing.assert_allclose(limited(jnp.asarray(-v), L), -value, rtol=1e-14)


def test_the_limit_leaves_small_values_alone():
    """(1 + 2^-8)^(-1/8) = 0.99951 at half the limit."""
    half = limited(L / 2, L) / (L / 2)
    np.testing.assert_allclose(half, (1 + 2.0**-8) ** (-1 / 8), rtol=1e-14)
    assert 1 - half < 5e-4


def centre(log_f, importance=None, limit=L):
    log_f = jnp.asarray(log_f)
    importance = np.ones(log_f.shape) if importance is None else importance
    return float(window_centre(log_f, jnp.asarray(importance), jnp.asarray(limit)))


def test_a_range_that_fits_the_window_is_not_cut():
    log_f = np.random.default_rng(0).uniform(0, 1, 500) ** 3  # skewed, width 1 < 2L
    c = centre(log_f)
    assert log_f.max() <= c + 0.6 + 1e-12 and log_f.min() >= c - 0.6 - 1e-12


def test_the_window_follows_the_volume_and_not_a_single_peak():
    log_f = np.concatenate([np.random.default_rng(0).uniform(-1, 1, 1000), [9.0]])
    assert abs(centre(log_f)) < 0.1
    outside = log_f > 0
    # ... and only where there is a part: without the upper half the middle is about -1/2.
    assert abs(centre(log_f, np.where(outside, 0.0, 1.0), 0.3) + 0.5) < 0.1


def test_the_window_moves_with_f_and_has_a_derivative():
    log_f = jnp.asarray(np.random.default_rng(0).normal(0, 1, 400))
    importance = np.random.default_rng(1).random(400)
    np.testing.assert_allclose(centre(log_f + 5, importance) - centre(log_f, importance), 5)
    along = jnp.asarray(np.random.default_rng(2).normal(0, 1, 400))
    of = lambda t: window_centre(log_f + t * along, jnp.asarray(importance), L)  # noqa: E731
    h = 1e-4
    difference = (of(h) - of(-h)) / (2 * h)
    # The centre's third derivative is below 1 / QUANTILE_BLUR² = 400: an error of h² 400 / 6.
    np.testing.assert_allclose(jax.grad(of)(0.0), difference, rtol=1e-5)
