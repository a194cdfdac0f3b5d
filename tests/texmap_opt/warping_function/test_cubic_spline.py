"""The spline of a field on the background grid: interpolates, C2, of fourth order."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from texmap_opt.box import Box
from texmap_opt.errors import WarpError
from texmap_opt.warping_function.background_grid import PADDING, BackgroundGrid
from texmap_opt.warping_function.cubic_spline import CubicSpline

BOX = Box.aligned(np.array([[0.0, 0.0, 0.0], [4.0, 2.0, 3.0]]))
PLATE = Box.aligned(BOX.bounds, extrusion="z")
BOTH = pytest.mark.parametrize("box", [BOX, PLATE], ids=["3-D", "2-D"])


def points_in(box, count, seed=0):
    return box.low + box.extent * np.random.default_rng(seed).random((count, box.dimensions))


def wavy(p):
    return np.sin(1.3 * p[..., 0]) * np.cos(p[..., 1] + p[..., -1])


@BOTH
def test_a_spline_takes_its_values_at_its_nodes(box):
    grid = BackgroundGrid.covering(box, 0.5)
    values = np.random.default_rng(0).standard_normal((*grid.shape, 2))
    inner = (slice(1, -1),) * box.dimensions  # the outermost nodes lie beyond the spline's interval
    found = CubicSpline.through(values, grid)(grid.points[inner].reshape(-1, box.dimensions))
    np.testing.assert_allclose(found, values[inner].reshape(-1, 2), atol=1e-12)


@BOTH
def test_a_constant_stays_one_to_the_last_digits(box):
    grid = BackgroundGrid.covering(box, 0.5)
    found = CubicSpline.through(np.full((*grid.shape, 1), 7.0), grid)(points_in(box, 100))
    np.testing.assert_allclose(found, 7.0, rtol=1e-13)


@BOTH
def test_a_spline_is_twice_continuously_differentiable_across_a_knot(box):
    grid = BackgroundGrid.covering(box, 0.5)
    spline = CubicSpline.through(np.random.default_rng(0).standard_normal((*grid.shape, 1)), grid)
    rest = jnp.asarray([0.7, 1.1][: box.dimensions - 1])
    value = lambda x: spline(jnp.concatenate([x[None], rest])[None])[0, 0]  # noqa: E731
    knot, tiny = 2.0, 1e-9
    for order in range(3):
        here = jax.jit(value)
        below, above = here(jnp.asarray(knot - tiny)), here(jnp.asarray(knot + tiny))
        # Lipschitz: the next derivative is below 1e3 here, times 2e-9.
        np.testing.assert_allclose(below, above, atol=1e-5, err_msg=f"derivative {order}")
        value = jax.grad(value)
    # The third derivative of a cubic spline through random values does jump: the test can fail.
    third = float(jax.jit(value)(knot + tiny) - jax.jit(value)(knot - tiny))
    assert abs(third) > 1


@BOTH
def test_a_spline_of_a_smooth_field_converges_with_fourth_order(box):
    """Source: de Boor, "A Practical Guide to Splines" (2001), chapter V: cubic, error O(h⁴)."""
    points = points_in(box, 300)
    # The mirror condition at the border of the grid fades by 0.27 a node: look at the middle.
    middle = np.all((points > box.low + 0.5) & (points < box.high - 0.5), axis=1)
    error = []
    for h in (0.25, 0.125):
        grid = BackgroundGrid.covering(box, h)
        found = CubicSpline.through(wavy(grid.points)[..., None], grid)(points)[:, 0]
        error.append(np.abs(np.asarray(found) - wavy(points))[middle].max())
    assert np.log2(error[0] / error[1]) > 3.5


def test_far_outside_it_keeps_the_value_at_the_border_of_the_grid():
    grid = BackgroundGrid.covering(BOX, 0.5)
    spline = CubicSpline.through(wavy(grid.points)[..., None], grid)
    border = grid.box.high + (PADDING - 1) * grid.spacing
    far = border + np.array([[0.0, 0, 0], [50, 50, 50]])
    assert spline(far)[0] == spline(far)[1]


def test_single_precision_is_refused():
    grid = BackgroundGrid.covering(BOX, 0.5)
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(WarpError, match="double precision"):
            CubicSpline.through(np.zeros((*grid.shape, 1)), grid)
    finally:
        jax.config.update("jax_enable_x64", True)


def test_a_grid_too_fine_or_a_box_without_volume_is_refused_with_a_remedy():
    with pytest.raises(WarpError, match="Smooth over a longer distance"):
        BackgroundGrid.covering(BOX, 0.001)
    with pytest.raises(WarpError, match="must be positive"):
        BackgroundGrid.covering(Box.aligned(np.array([[0.0, 0, 0], [1, 0, 1]])), 0.5)
