"""The warping function: smooth, limited in contrast, normalised."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from texmap_opt.errors import WarpError
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.cubic_spline import CubicSpline
from texmap_opt.warping_function.warping_function import SizeLaw, WarpingFunction

BOX = np.array([[0.0, 0.0, 0.0], [4.0, 2.0, 3.0]])


def hump(p):
    return np.exp(np.sin(p[:, 0]) + 0.5 * np.cos(2 * p[:, 1]) * p[:, 2])


def painted(law):
    return WarpingFunction.painted(hump, BOX, spacing_mm=0.2, law=law)


def random_points(count, seed=0):
    return BOX[0] + (BOX[1] - BOX[0]) * np.random.default_rng(seed).random((count, 3))


def test_a_spline_takes_its_values_at_its_nodes():
    grid = BackgroundGrid.covering(BOX, 0.5)
    values = np.random.default_rng(0).standard_normal((*grid.shape, 2))
    inner = (slice(1, -1),) * 3  # the outermost nodes lie beyond the spline's own interval
    found = CubicSpline.through(values, grid)(grid.points[inner].reshape(-1, 3))
    np.testing.assert_allclose(found, values[inner].reshape(-1, 2), atol=1e-12)


def test_a_spline_is_twice_continuously_differentiable_across_a_knot():
    grid = BackgroundGrid.covering(BOX, 0.5)
    spline = CubicSpline.through(np.random.default_rng(0).standard_normal((*grid.shape, 1)), grid)
    value = lambda x: spline(jnp.stack([x, jnp.asarray(0.7), jnp.asarray(1.1)])[None])[0, 0]  # noqa: E731
    knot, tiny = 2.0, 1e-9
    for order in range(3):
        below, above = value(jnp.asarray(knot - tiny)), value(jnp.asarray(knot + tiny))
        # Lipschitz: the next derivative is below 1e3 here, times 2e-9.
        np.testing.assert_allclose(below, above, atol=1e-5, err_msg=f"derivative {order}")
        value = jax.grad(value)


def test_a_spline_of_a_smooth_field_converges_with_fourth_order():
    """Source: de Boor, "A Practical Guide to Splines" (2001), chapter V: cubic, error O(h⁴)."""
    points = random_points(300)
    field = lambda p: np.sin(1.3 * p[..., 0]) * np.cos(p[..., 1] + p[..., 2])  # noqa: E731
    error = []
    for h in (0.25, 0.125):
        grid = BackgroundGrid.covering(BOX, h)
        found = CubicSpline.through(field(grid.points)[..., None], grid)(points)[:, 0]
        middle = np.all((points > BOX[0] + 0.5) & (points < BOX[1] - 0.5), axis=1)
        error.append(np.abs(np.asarray(found) - field(points))[middle].max())
    assert np.log2(error[0] / error[1]) > 3.5


def test_size_follows_f_with_the_exponent():
    points = random_points(200)
    for exponent in (0.5, 1.0, 2.0):
        f = painted(SizeLaw(exponent=exponent, contrast=1e9))
        slope = np.polyfit(np.log(hump(points)), np.log(f.size(points)), 1)[0]
        np.testing.assert_allclose(slope, -exponent, rtol=1e-3)


def test_largest_over_smallest_size_keeps_to_the_contrast():
    sizes = np.asarray(painted(SizeLaw(contrast=3.0)).size(random_points(20_000)))
    assert 2.5 < sizes.max() / sizes.min() <= 3.0


def test_contrast_one_asks_for_one_size():
    sizes = painted(SizeLaw(contrast=1.0)).size(random_points(100))
    np.testing.assert_allclose(sizes, 1, atol=1e-8)


def test_the_box_holds_as_many_cells_as_before():
    """Mean of s^-3 over the box, by Monte Carlo: 1 / sqrt(200,000) times its spread of about 3."""
    f = painted(SizeLaw(contrast=3.0))
    np.testing.assert_allclose(
        np.mean(np.asarray(f.size(random_points(200_000))) ** -3), 1, rtol=0.01
    )


def test_only_ratios_of_f_matter():
    points = random_points(50)
    f, g = (
        WarpingFunction.painted(lambda p, a=a: a * hump(p), BOX, spacing_mm=0.2, law=SizeLaw())
        for a in (1.0, 1e6)
    )
    np.testing.assert_allclose(f.size(points), g.size(points), rtol=1e-9)
    np.testing.assert_allclose(f.f(points), g.f(points), rtol=1e-9)


@pytest.mark.parametrize(
    ("law", "word"), [({"exponent": 0.0}, "exponent"), ({"contrast": 0.5}, "contrast")]
)
def test_impossible_laws_are_refused(law, word):
    with pytest.raises(WarpError, match=word):
        SizeLaw(**law)


def test_a_negative_f_is_refused():
    with pytest.raises(WarpError, match="not finite numbers or not positive"):
        WarpingFunction.painted(lambda p: p[:, 0] - 1, BOX, spacing_mm=0.5, law=SizeLaw())


def test_a_grid_too_fine_is_refused_with_a_remedy():
    with pytest.raises(WarpError, match="Smooth over a longer distance"):
        BackgroundGrid.covering(BOX, 0.001)
