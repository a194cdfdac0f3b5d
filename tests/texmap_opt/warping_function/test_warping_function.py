"""The warping function: smooth, limited in contrast, normalised, in two and three dimensions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from texmap_opt.box import Box
from texmap_opt.errors import WarpError
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.warping_function import WarpingFunction

BOX = Box.aligned(np.array([[0.0, 0.0, 0.0], [4.0, 2.0, 3.0]]))
PLATE = Box.aligned(BOX.bounds, extrusion="z")
BOTH = pytest.mark.parametrize("box", [BOX, PLATE], ids=["3-D", "2-D"])


def hump(p, height=1.0):
    xp = p.__array_namespace__()
    return xp.exp(height * (xp.sin(p[:, 0]) + 0.5 * xp.cos(2 * p[:, 1]) * p[:, 2]))


def of_formula(law, box=BOX, f=hump):
    return WarpingFunction.from_formula(f, box, spacing_mm=0.25, law=law)


def points_in(box, count, seed=0):
    return box.low + box.extent * np.random.default_rng(seed).random((count, box.dimensions))


@BOTH
def test_size_follows_f_with_the_exponent(box):
    points = points_in(box, 200)
    for exponent in (0.5, 1.0, 2.0):
        f = of_formula(SizeLaw(exponent=exponent, contrast=1e9), box)
        slope = np.polyfit(np.log(hump(box.positions(points))), np.log(f.size(points)), 1)[0]
        np.testing.assert_allclose(slope, -exponent, rtol=1e-3)


@BOTH
def test_largest_over_smallest_size_keeps_to_the_contrast(box):
    sizes = np.asarray(of_formula(SizeLaw(contrast=3.0), box).size(points_in(box, 20_000)))
    assert 2.5 < sizes.max() / sizes.min() <= 3.0


def test_contrast_one_asks_for_one_size():
    sizes = of_formula(SizeLaw(contrast=1.0)).size(points_in(BOX, 100))
    np.testing.assert_allclose(sizes, 1, atol=1e-8)


@BOTH
def test_a_uniform_f_is_constant_to_rounding(box):
    f = of_formula(SizeLaw(), box, lambda p: np.full(len(p), 1e-7))
    points = points_in(box, 200)
    np.testing.assert_allclose(f.size(points), 1, rtol=1e-12)
    np.testing.assert_allclose(f.f(points), 1, rtol=1e-12)


@BOTH
def test_the_box_holds_as_many_cells_as_before(box):
    """Mean of s^-d over the box, by Monte Carlo: its spread of about 3 over sqrt(200,000)."""
    f = of_formula(SizeLaw(contrast=3.0), box)
    sizes = np.asarray(f.size(points_in(box, 200_000)))
    np.testing.assert_allclose(np.mean(sizes**-box.dimensions), 1, rtol=0.01)


def test_only_ratios_of_f_matter():
    points = points_in(BOX, 50)
    f, g = (of_formula(SizeLaw(), f=lambda p, a=a: a * hump(p)) for a in (1.0, 1e6))
    np.testing.assert_allclose(f.f(points), g.f(points), rtol=1e-9)
    np.testing.assert_allclose(f.size(points), g.size(points), rtol=1e-9)


def test_a_turned_box_sees_the_same_function_of_space():
    """The formula is of space: a box turned with it, and its points, give the same sizes."""
    axes = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    axes *= np.sign(np.linalg.det(axes))
    turned = Box(axes, BOX.bounds)
    points = points_in(BOX, 100)
    f = of_formula(SizeLaw())
    g = of_formula(SizeLaw(), turned, lambda p: hump(p @ axes.T))
    # Rounding of p @ axes.T, through the limit and the quantiles.
    np.testing.assert_allclose(g.size(points), f.size(points), rtol=1e-10)


@BOTH
def test_size_has_the_derivatives_that_differences_confirm(box):
    """With respect to the formula's parameter, the exponent and the contrast."""
    at = jnp.asarray([1.3, 0.9, 2.5])
    points, weights = points_in(box, 40), np.random.default_rng(1).normal(size=40)

    @jax.jit
    @jax.value_and_grad
    def total(parameters):
        height, exponent, contrast = parameters
        formula = lambda p: hump(jnp.asarray(p), height)  # noqa: E731
        law = SizeLaw(exponent=exponent, contrast=contrast)
        f = WarpingFunction.from_formula(formula, box, spacing_mm=0.5, law=law)
        return jnp.sum(f.size(points) * weights)

    h = 1e-5
    differences = [(total(at + step)[0] - total(at - step)[0]) / (2 * h) for step in h * np.eye(3)]
    # Differences of numbers near 1 by 1e-5: rounding of 1e-11 in the quotient, h² of the curvature.
    np.testing.assert_allclose(total(at)[1], differences, rtol=1e-6)


def test_size_is_twice_differentiable_in_the_point_and_its_derivatives_are_right():
    f = of_formula(SizeLaw(contrast=2.0))
    x = jnp.asarray(points_in(BOX, 1)[0])
    size = lambda x: f.size(x[None])[0]  # noqa: E731
    along = jnp.asarray([0.3, -0.5, 0.8])
    h = 1e-4
    both = jax.jit(jax.value_and_grad(size))
    (above, rising), (below, falling) = both(x + h * along), both(x - h * along)
    np.testing.assert_allclose(both(x)[1] @ along, (above - below) / (2 * h), rtol=1e-6)
    bend = (rising - falling) / (2 * h)
    # A cubic spline: the second derivative is continuous but has kinks, so first order in h.
    np.testing.assert_allclose(jax.jit(jax.hessian(size))(x) @ along, bend, rtol=1e-3)


def test_a_formula_that_is_not_positive_is_refused_with_the_count():
    grid = BackgroundGrid.covering(BOX, 0.5)
    bad = int(np.sum(grid.positions[..., 0] <= 1))
    for f in (lambda p: p[:, 0] - 1, lambda p: np.where(p[:, 0] > 1, 1.0, np.nan)):
        with pytest.raises(
            WarpError, match=f"{bad} of {np.prod(grid.shape)} values .* not positive"
        ):
            WarpingFunction.from_formula(f, BOX, spacing_mm=0.5, law=SizeLaw())


def test_values_on_the_grid_that_are_not_finite_are_refused():
    grid = BackgroundGrid.covering(BOX, 0.5)
    log_f = np.zeros(grid.shape)
    log_f[3, 3, 3] = -np.inf
    with pytest.raises(WarpError, match="has 1 values that are not finite"):
        WarpingFunction.on_grid(grid, log_f, SizeLaw())
