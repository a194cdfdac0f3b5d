"""From scattered samples to a field on a grid: averages, extends, and leaves no range."""

import numpy as np
import pytest

from texmap_opt.box import Box
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.normalised_convolution import deposit, normalised_convolution

BOX = Box.aligned(np.array([[-1.0, -1.0, -1.0], [5.0, 3.0, 3.0]]))
PLATE = Box.aligned(BOX.bounds, extrusion="z")
BOTH = pytest.mark.parametrize("box", [BOX, PLATE], ids=["3-D", "2-D"])

# Random samples in a part that fills the middle of the box, along its axes.
POINTS = np.array([4.0, 2, 2]) * np.random.default_rng(0).random((4000, 3))
VOLUMES = np.full(4000, 16 / 4000)


def averaged(grid, values, smoothing_mm):
    points = grid.box.coordinates(POINTS)
    return normalised_convolution(grid, points, VOLUMES, values, smoothing_mm=smoothing_mm)


def test_outside_the_part_the_field_stays_within_the_range_inside():
    grid = BackgroundGrid.covering(Box.aligned(np.array([[-20.0, -20, -20], [25, 25, 25]])), 1.0)
    field = np.asarray(averaged(grid, np.exp(POINTS[:, :1] / 4), 1.0)[..., 0])
    assert np.all(np.isfinite(field))
    assert field.min() >= 1 and field.max() <= np.e
    # ... and smooth: no step between nodes is larger than the steepest slope inside, e/4 per mm.
    assert max(np.abs(np.diff(field, axis=axis)).max() for axis in range(3)) < np.e / 4


@BOTH
def test_a_constant_is_reproduced_everywhere(box):
    grid = BackgroundGrid.covering(box, 0.5)
    np.testing.assert_allclose(averaged(grid, np.full((4000, 1), 7.0), 0.5), 7, rtol=1e-12)


def test_samples_count_by_their_volume():
    """Two samples at one place: their weighted mean, everywhere."""
    grid = BackgroundGrid.covering(BOX, 0.5)
    field = normalised_convolution(
        grid, np.ones((2, 3)), np.array([3.0, 1.0]), np.array([[2.0], [6.0]]), smoothing_mm=0.5
    )
    np.testing.assert_allclose(field, 3, rtol=1e-9)


@BOTH
def test_deposit_keeps_the_total_and_the_centre_of_gravity(box):
    """Weights linear along each axis reproduce linear functions."""
    grid = BackgroundGrid.covering(box, 0.5)
    points = box.coordinates(POINTS)
    amount = deposit(grid, points, VOLUMES)
    np.testing.assert_allclose(amount.sum(), 16, rtol=1e-12)
    centre = (amount[..., None] * grid.points).reshape(-1, box.dimensions).sum(axis=0) / 16
    np.testing.assert_allclose(centre, points.mean(axis=0), rtol=1e-12)
