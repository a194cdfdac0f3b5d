"""Drivers combined: products, sums and maxima of fields."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from texmap_opt.box import Box
from texmap_opt.errors import WarpError
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.driven_field import DrivenField, combined, formula_field
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.warping_function import WarpingFunction

BOX = Box.aligned(np.array([[0.0, 0.0, 0.0], [4.0, 2.0, 3.0]]))
GRID = BackgroundGrid.covering(BOX, 0.5)
VOLUME = np.random.default_rng(0).random(GRID.shape)


def field(formula, importance=VOLUME, cases=0):
    given = formula_field(formula, GRID)
    stress = jnp.full((*GRID.shape, 6 * cases), 0.1 * cases)
    return DrivenField(given.log_f, importance, stress)


def first(p):
    return np.exp(np.sin(p[:, 0]))


def second(p):
    return 50 * np.exp(np.cos(2 * p[:, 1] + p[:, 2]))


def scaled(of):
    """A formula's values over their geometric mean over the volume."""
    values = of(GRID.positions.reshape(-1, 3)).reshape(GRID.shape)
    return values / np.exp(np.average(np.log(values), weights=VOLUME))


def test_products_sums_and_maxima_are_what_they_say():
    fields, w = [field(first), field(second)], [0.7, 1.9]
    a, b = scaled(first), scaled(second)
    product = np.exp(combined(fields, how="product", weights=w).log_f)
    np.testing.assert_allclose(product, a**0.7 * b**1.9, rtol=1e-12)
    total = np.exp(combined(fields, how="sum", weights=w).log_f)
    np.testing.assert_allclose(total, 0.7 * a + 1.9 * b, rtol=1e-12)
    largest = np.exp(combined(fields, how="maximum", weights=w).log_f)
    exact = np.maximum(0.7 * a, 1.9 * b)
    # The 16-norm of two: at most 2^(1/16) above the larger.
    assert np.all(largest >= exact * (1 - 1e-12))
    assert np.all(largest <= exact * 2 ** (1 / 16) * (1 + 1e-12))


@pytest.mark.parametrize("how", ["product", "sum", "maximum"])
def test_only_ratios_over_space_matter(how):
    one = combined([field(first), field(second)], how=how).log_f
    other = combined([field(lambda p: 1e6 * first(p)), field(second)], how=how).log_f
    np.testing.assert_allclose(one, other, atol=1e-9)


@pytest.mark.parametrize("how", ["product", "sum", "maximum"])
def test_one_driver_alone_stays_itself(how):
    alone, whole = field(first), combined([field(first)], how=how)
    difference = np.asarray(whole.log_f - alone.log_f)
    np.testing.assert_allclose(difference, difference.flat[0], atol=1e-12)


def test_the_first_driver_that_knows_the_part_or_its_stress_has_the_say_over_it():
    painted = field(first, importance=None)
    scalar, own = field(second), field(second, 2 * VOLUME, cases=1)
    assert combined([painted, scalar, own]).importance is scalar.importance
    assert combined([painted, scalar, own, field(first, cases=2)]).stress.shape[-1] == 6
    assert combined([painted]).importance is None
    # What is painted is measured over the part as well.
    given = combined([painted, scalar], how="sum").log_f
    np.testing.assert_allclose(np.exp(given), scaled(first) + scaled(second), rtol=1e-12)


@pytest.mark.parametrize("how", ["product", "sum", "maximum"])
def test_size_has_the_derivatives_by_weights_and_parameters_that_differences_confirm(how):
    points = BOX.extent * np.random.default_rng(1).random((30, 3))
    weights = np.random.default_rng(2).normal(size=30)

    @jax.jit
    @jax.value_and_grad
    def total(parameters):
        a, b, height = parameters
        grown = formula_field(lambda p: jnp.exp(height * jnp.sin(jnp.asarray(p[:, 0]))), GRID)
        field_ = combined([grown, field(second)], how=how, weights=[a, b])
        return jnp.sum(field_.function(GRID, SizeLaw(contrast=4.0)).size(points) * weights)

    at, h = jnp.asarray([0.9, 0.6, 1.1]), 1e-5
    differences = [(total(at + step)[0] - total(at - step)[0]) / (2 * h) for step in h * np.eye(3)]
    # Differences of numbers near 1 by 1e-5: rounding of 1e-11 in the quotient, h² of the curvature.
    np.testing.assert_allclose(total(at)[1], differences, rtol=1e-6)


def test_a_formula_drives_as_it_does_alone():
    points = BOX.extent * np.random.default_rng(1).random((30, 3))
    alone = WarpingFunction.from_formula(first, BOX, spacing_mm=0.5, law=SizeLaw())
    field_ = formula_field(first, GRID)
    np.testing.assert_array_equal(field_.function(GRID, SizeLaw()).size(points), alone.size(points))


def test_a_formula_that_is_not_positive_is_refused():
    with pytest.raises(WarpError, match="not finite numbers or not positive, such as -2"):
        formula_field(lambda p: np.full(len(p), -2.0), GRID)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"how": "min"}, 'cannot be combined by "min"'),
        ({"how": "maximums"}, 'did you mean "maximum"'),
        ({"weights": [1.0]}, "2 drivers but 1 weights"),
        ({"weights": [1.0, 0.0]}, "weight is 0, but must be a positive"),
        ({"weights": [1.0, float("nan")]}, "weight is nan"),
    ],
)
def test_impossible_combinations_are_refused(options, words):
    with pytest.raises(WarpError, match=words):
        combined([field(first), field(second)], **options)


def test_no_driver_is_refused():
    with pytest.raises(WarpError, match="at least one driver"):
        combined([])
