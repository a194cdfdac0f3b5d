"""Integrals along tapered struts against quadrature."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import jv, yv

from fea.taper import SERIES_LIMIT, AbstractTaper, OneEdge, Similar

TAPERS = [Similar(), OneEdge()]


def integrals(taper: AbstractTaper, a: float, b: float) -> np.ndarray:
    """Stretch, both turns and cross by Gauss's rule, exact to rounding at ratios up to 12."""
    x, w = np.polynomial.legendre.leggauss(80)
    x, w = (x + 1) / 2, w / 2
    size = a + (b - a) * x
    moment = taper.moment(size)
    values = [1 / taper.area(size), (1 - x) ** 2 / moment, x**2 / moment, x * (1 - x) / moment]
    return np.array(values) @ w


compiled = eqx.filter_jit(lambda taper, ends: taper.flexibility(ends))


def closed(taper: AbstractTaper, a: float, b: float) -> np.ndarray:
    f = compiled(taper, jnp.array([a, b]))
    np.testing.assert_allclose(f.determinant, f.turn[0] * f.turn[1] - f.cross**2, rtol=1e-11)
    return np.array([1 / f.area, *(f.turn / f.moment), f.cross / f.moment])


@pytest.mark.parametrize("taper", TAPERS)
@settings(max_examples=20, derandomize=True, deadline=None)
@given(st.floats(0.05, 20), st.floats(-2.5, 2.5))
def test_flexibility_is_that_of_quadrature(taper, a, log_ratio):
    b = a * float(np.exp(log_ratio))
    # One digit of cancellation near the limit of the series.
    np.testing.assert_allclose(closed(taper, a, b), integrals(taper, a, b), rtol=1e-11)


@pytest.mark.parametrize("c", [0.0, 1e-9, 1e-3, SERIES_LIMIT**0.5 * (1 - 1e-12)])
def test_series_and_logarithm_agree_where_they_meet(c):
    """Just below and just above the limit of the series, and where both ends are alike."""
    a, b = 1 - c, 1 + c
    np.testing.assert_allclose(closed(OneEdge(), a, b), integrals(OneEdge(), a, b), rtol=1e-12)
    above = SERIES_LIMIT**0.5 * (1 + 1e-12)
    np.testing.assert_allclose(
        closed(OneEdge(), 1 - above, 1 + above),
        integrals(OneEdge(), 1 - above, 1 + above),
        rtol=1e-12,
    )


def test_the_other_taper_would_be_seen():
    """Negative control: a wall taken for a bar is 10 % off."""
    assert abs(closed(Similar(), 1.0, 1.3)[0] / closed(OneEdge(), 1.0, 1.3)[0] - 1) > 0.1


@pytest.mark.parametrize("taper", TAPERS)
@pytest.mark.parametrize("ends", [(0.7, 0.7), (0.7, 0.71), (0.4, 1.5), (1.5, 0.4)])
def test_flexibility_can_be_differentiated(taper, ends):
    """Central differences, also where both ends are alike and on both sides of the series' limit."""

    def value(a: float, b: float) -> jax.Array:
        f = taper.flexibility(jnp.array([a, b]))
        return 1 / f.area + (f.turn[0] + 2 * f.turn[1] + 3 * f.cross + 4 * f.determinant) / f.moment

    value = jax.jit(value)
    found = jax.jit(jax.grad(value, argnums=(0, 1)))(*ends)
    h = 1e-5
    expected = [
        (value(ends[0] + h, ends[1]) - value(ends[0] - h, ends[1])) / (2 * h),
        (value(ends[0], ends[1] + h) - value(ends[0], ends[1] - h)) / (2 * h),
    ]
    # h² times the third derivative over the first, 1/size² and more.
    np.testing.assert_allclose(found, expected, rtol=2e-8)


@pytest.mark.parametrize("taper", TAPERS)
def test_a_column_buckles_with_the_mean_of_one_over_the_root(taper):
    a, b = 0.6, 1.7
    mean = quad(lambda x: taper.moment(np.array([a + (b - a) * x]))[0] ** -0.5, 0, 1)[0]
    found = taper.column(np.array([a]), np.array([b]))[0]
    np.testing.assert_allclose(found, mean**-2, rtol=1e-12)


def hinged_wall(a: float, b: float) -> float:
    """Lowest P of E I v'' + P v = 0, v = 0 at both ends, over π² E/L²: I = s³, s from a to b.

    v = √s Z_1(m/√s), Z_1 any Bessel function of order one, m² = 4 P/(E (b - a)²) for L = 1: twice
    differentiating √s Z_1(m/√s) gives -(m²/4) s^-3 times itself.
    """

    def both(m: float) -> float:
        x, y = m / a**0.5, m / b**0.5
        return float(jv(1, x) * yv(1, y) - jv(1, y) * yv(1, x))

    guess = np.pi / abs(a**-0.5 - b**-0.5)
    m = brentq(both, guess * 0.9, guess * 1.2)
    return (m / 2 * (b - a) / np.pi) ** 2


@pytest.mark.parametrize(
    ("ratio", "below"), [(1.2, 1e-3), (2.0, 9.1e-3), (3.0, 0.023), (5.0, 0.046)]
)
def test_the_load_of_a_tapered_wall_is_a_little_on_the_safe_side(ratio, below):
    """The limits are those of the docstring."""
    share = OneEdge().column(np.ones(1), np.array([ratio]))[0] / hinged_wall(1.0, ratio)
    assert 1 - below < share < 1
