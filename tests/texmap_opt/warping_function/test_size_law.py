"""The size law: its exponent, the contrast, and what the contrast limit leaves alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt.errors import WarpError
from texmap_opt.warping_function.size_law import (
    EXTREME_BLUR,
    SizeLaw,
    limited,
    window_centre,
)

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


CENTRE = jax.jit(window_centre)  # its steps one by one take longer to compile


def centre(log_f, importance=None, limit=L):
    log_f = jnp.asarray(log_f)
    importance = np.ones(log_f.shape) if importance is None else importance
    return float(CENTRE(log_f, jnp.asarray(importance), jnp.asarray(limit)))


def test_a_range_that_fits_the_window_is_not_cut():
    log_f = np.random.default_rng(0).uniform(0, 1, 500) ** 3  # skewed, width 1 < 2L
    c = centre(log_f)
    assert log_f.max() <= c + 0.6 + 1e-12 and log_f.min() >= c - 0.6 - 1e-12


def test_a_window_that_fits_the_range_stays_in_it():
    """Nearly all of the volume at the upper end, which a quantile alone would centre on."""
    log_f = np.concatenate([np.linspace(0, 2, 40), np.full(4000, 2.0)])  # width 2 > 2L
    c = centre(log_f)
    # Smooth clips stop short of the end, by the widths they are given.
    assert 2 - L - 0.05 * L <= c <= 2 - L + EXTREME_BLUR * L


def peak(contrast):
    """Log f of 3^exp(-(r / 0.25)²) over a unit square, at the nodes of a grid; from 0 to its peak."""
    x = np.linspace(-0.5, 0.5, 21)
    bell = np.exp(-(x[:, None] ** 2 + x**2) / 0.25**2)
    return jnp.asarray(np.log(contrast) * (bell - bell.min()) / np.ptp(bell))


@jax.jit
@jax.value_and_grad
def moved_centre(t, log_f, along, law):
    """The centre, and its derivative by a number that moves log f and the contrast."""
    L = SizeLaw(contrast=law * (1 + 0.7 * t)).limit
    return window_centre(log_f + t * along, jnp.ones(log_f.shape), L)


def assert_smooth_at(log_f, along, law):
    """The derivative is that of differences, and the same on both sides.

    A blurred extreme changes within tau = 0.02 L / log(nodes), here 2e-3: so a step h of 1e-5
    errs by about (h / tau)², the derivative may change by 2 h / tau over two steps, and rounding of the
    centre counts 1e-16 / h. A kink changes the derivative by some tenths at once.
    """
    h = 1e-5
    (before, falling), (_, slope), (after, rising) = (
        moved_centre(t, log_f, along, law) for t in (-h, 0.0, h)
    )
    np.testing.assert_allclose((after - before) / (2 * h), slope, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose([falling, rising], slope, atol=0.02)


@pytest.mark.parametrize("share", [0.99, 1.0, 1.01])
def test_the_centre_is_smooth_where_the_range_is_as_wide_as_the_window(share):
    """A contrast of 3 of f and of the law: max - L and min + L change places there."""
    along = np.random.default_rng(0).normal(0, 1, (21, 21))
    assert_smooth_at(peak(3.0), along, 3.0**share)


def test_the_centre_has_no_kink_as_the_contrast_passes_the_range_of_f():
    """Between the contrasts, 2e-4 of L apart, its slope changes by 1 % of what it does in all."""
    shares = jnp.linspace(0.9, 1.1, 1001)
    slopes = jax.vmap(
        jax.grad(lambda share: window_centre(peak(3.0), jnp.ones((21, 21)), share * L))
    )
    changes = np.abs(np.diff(slopes(shares * np.log(3.0) / 2 / L)))
    assert changes.sum() > 0.5 and changes.max() < 0.02 * changes.sum()


def test_the_centre_is_smooth_where_two_nodes_exchange_the_extreme():
    assert_smooth_at(np.append(np.linspace(0, 1, 50), 1.0), np.append(np.zeros(50), 1.0), 2.7)


@pytest.mark.parametrize("shift", [-16.0, 3.7])
def test_a_factor_on_f_moves_the_window_with_it(shift):
    for log_f in (peak(3.0), peak(20.0), jnp.asarray(np.random.default_rng(3).normal(0, 1, 300))):
        np.testing.assert_allclose(centre(log_f + shift) - shift, centre(log_f), atol=1e-13)


@pytest.mark.parametrize("contrast", [1.0, 3.0])
def test_a_uniform_f_is_its_own_centre(contrast):
    log_f = np.full(500, -1.3)
    np.testing.assert_allclose(
        centre(log_f, limit=SizeLaw(contrast=contrast).limit), -1.3, rtol=1e-15
    )


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
    of = lambda t: CENTRE(log_f + t * along, jnp.asarray(importance), L)  # noqa: E731
    h = 1e-4
    difference = (of(h) - of(-h)) / (2 * h)
    # The centre's third derivative is below 1 / QUANTILE_BLUR² = 400: an error of h² 400 / 6.
    np.testing.assert_allclose(jax.grad(of)(0.0), difference, rtol=1e-5)
