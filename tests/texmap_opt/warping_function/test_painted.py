"""Painted regions: the factor inside, its fall-off, overlaps, and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from texmap_opt.box import Box
from texmap_opt.errors import CaseError
from texmap_opt.region import Box as BoxRegion
from texmap_opt.region import Cylinder, Intersection, Normal, Plane, Sphere, Stl
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warp.quality import achieved_sizes
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.driven_field import combined, formula_field
from texmap_opt.warping_function.painted import FALLOFF_IN_SMOOTHINGS, PaintedRegion, painted
from texmap_opt.warping_function.size_law import SizeLaw

BOX = Box.aligned(np.array([[0.0, 0, 0], [20, 20, 20]]))
GRID = BackgroundGrid.covering(BOX, 1.0)
MIDDLE = np.array([10.0, 10, 10])
BALL = Sphere(MIDDLE, 4.0)
WHERE = "case.toml: [[paint]] 1"


def paint(region, value=2.0, falloff_mm=0.0, grid=GRID, smoothing_mm=1.0):
    given = PaintedRegion(region, value, falloff_mm, WHERE)
    return painted([given], grid, smoothing_mm=smoothing_mm)


def factor(field):
    return np.exp(np.asarray(field.log_f))


def tetrahedron(size):
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    return Stl(TriMesh(5 + size * corners, faces), "tetrahedron.stl")


REGIONS = [
    BALL,
    BoxRegion(MIDDLE - 3, MIDDLE + 3),
    Cylinder(np.array([10.0, 10, 5]), np.array([10.0, 10, 15]), 3.0),
    Plane(MIDDLE, np.array([0.6, 0.8, 0.0]), 2.0),
    tetrahedron(9.0),
    Intersection((BALL, Plane(MIDDLE, np.array([0.0, 0, 1]), 1.0))),
]


@pytest.mark.parametrize("region", REGIONS, ids=lambda region: type(region).__name__)
def test_f_is_the_value_inside_and_one_beyond_the_fall_off(region):
    field = factor(paint(region, value=3.0, falloff_mm=6.0))
    points = GRID.positions.reshape(-1, 3)
    inside = region.contains(points, None, slack=0.0).reshape(GRID.shape)
    assert inside.any()
    np.testing.assert_allclose(field[inside], 3, rtol=1e-12)
    beyond = region.distance(points).reshape(GRID.shape) > 6
    assert beyond.any()
    np.testing.assert_allclose(field[beyond], 1, rtol=1e-12)
    between = ~inside & ~beyond
    assert between.any()
    assert np.all((field[between] > 1 - 1e-12) & (field[between] < 3 + 1e-12))


def test_a_wide_fall_off_is_kept_and_passes_half_way_at_half_its_width():
    """The smoothstep is symmetric: log f is half its value in the middle."""
    grid = BackgroundGrid.covering(BOX, 1.0)
    field = np.asarray(paint(BALL, value=4.0, falloff_mm=6.0).log_f)
    along = np.linalg.norm(grid.positions - MIDDLE, axis=-1)
    np.testing.assert_allclose(field[np.isclose(along, 7.0)], np.log(4) / 2, rtol=1e-12)


def test_a_jump_becomes_no_steeper_than_its_average_over_the_smoothing_length():
    """A step averaged with a Gaussian has the steepest slope 1 / (sigma sqrt(2 pi))."""
    grid = BackgroundGrid.covering(BOX, 0.1 + 19.9 * 0.02)
    field = np.asarray(paint(Plane(MIDDLE, np.array([1.0, 0, 0]), 2.0), np.e, grid=grid).log_f)
    steepest = np.abs(np.diff(field, axis=0)).max() / grid.spacing[0]
    np.testing.assert_allclose(steepest, 1 / np.sqrt(2 * np.pi), rtol=0.01)  # between two nodes
    assert (
        np.abs(np.diff(np.asarray(paint(BALL, np.e, grid=grid).log_f), axis=0)).max() < 0.41 * 0.5
    )


def test_the_painted_function_is_twice_continuously_differentiable():
    """The steepest change of its second derivative does not grow as the steps get smaller."""
    f = paint(BALL, 3.0).function(GRID, SizeLaw(contrast=5.0))
    x = jnp.stack(
        [jnp.linspace(2.0, 18.0, 2001), *(jnp.full(2001, c) for c in (10.2, 9.9))], axis=1
    )
    size = lambda x: f.size(x[None])[0]  # noqa: E731
    bend = np.asarray(jax.jit(jax.vmap(lambda x: jax.hessian(size)(x)[0, 0]))(x))
    steps = [np.abs(np.diff(bend[::every])).max() for every in (1, 2, 4)]
    # Halved steps halve the change; a jump would leave it.
    assert steps[0] < 0.6 * steps[1] < 0.4 * steps[2]


def test_a_region_smaller_than_a_cell_still_counts_in_full():
    """Averaging would leave the share of its volume, 0.03 %, of log f."""
    f = paint(Sphere(MIDDLE + 0.5, 0.1), 2.0).function(GRID, SizeLaw(contrast=100.0))
    asked = f.size(np.array([[1.0, 1, 1]])) / f.size(MIDDLE[None] + 0.5)
    # The node next to its centre is 0.87 mm away, 1/5 of the fall-off: 1 - S = 0.06, and less by spline.
    np.testing.assert_allclose(asked, 2, rtol=0.06)


def test_overlapping_regions_multiply():
    ball, plane = PaintedRegion(BALL, 2.0, 5.0, WHERE), REGIONS[3]
    both = painted([ball, PaintedRegion(plane, 0.5, 0.0, WHERE)], GRID, smoothing_mm=1.0)
    single = factor(paint(BALL, 2.0, 5.0)) * factor(paint(plane, 0.5))
    np.testing.assert_allclose(factor(both), single, rtol=1e-12)
    assert np.all(factor(painted([], GRID, smoothing_mm=1.0)) == 1)


def test_a_value_of_one_paints_nothing():
    np.testing.assert_array_equal(factor(paint(BALL, 1.0)), 1)


def test_the_wanted_sizes_have_the_asked_ratio():
    f = paint(BALL, 2.0, 4.0).function(GRID, SizeLaw(contrast=4.0))
    sizes = f.size(np.array([[10.0, 10, 10], [13, 10, 10], [1, 1, 1]]))
    # log 2 is half the width of the window, which is somewhere over it: the limit takes 0.05 % of a
    # value in its middle, and 1 % of one at 3/4.
    np.testing.assert_allclose(sizes[2] / sizes[:2], 2, rtol=0.01)


def test_cells_in_a_painted_sphere_are_smaller_by_the_asked_ratio():
    """Mean edge of a cell, the cube root of its volume, over that far from the sphere."""
    grid = Grid.uniform(BOX, (10, 10, 10))
    background = BackgroundGrid.covering(BOX, float(grid.uniform_edge[0]) / 2)
    field = paint(BALL, 2.0, 3.0, background, float(grid.uniform_edge[0]) / 2)
    f = field.function(background, SizeLaw(contrast=4.0))
    warped = LeastSquares().fit(grid, f).grid
    edge, away = achieved_sizes(warped), np.linalg.norm(warped.centres - MIDDLE, axis=1)
    ratio = edge[away > 4 + 3 + 1].mean() / edge[away < 4].mean()
    np.testing.assert_allclose(ratio, 2, rtol=0.1)


def test_in_two_dimensions_a_region_paints_where_it_is_met_along_the_extrusion():
    plate = Box.aligned(BOX.bounds, extrusion="z")
    grid = BackgroundGrid.covering(plate, 1.0)
    low = factor(paint(Sphere(np.array([10.0, 10, 0]), 4.0), grid=grid))
    middle = factor(paint(BALL, grid=grid))
    assert low.ndim == 2
    # The ball at the end of the extrusion shows its largest circle too.
    np.testing.assert_allclose(low, middle, rtol=1e-12)
    np.testing.assert_allclose(middle[grid.shape[0] // 2, grid.shape[1] // 2], 2)


def test_turning_box_and_region_turns_the_paint():
    R = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    R *= np.sign(np.linalg.det(R))
    turned = BackgroundGrid.covering(Box(R.T.copy(), BOX.bounds), 1.0)
    region = Cylinder(np.array([3.0, 4, 5]), np.array([15.0, 9, 12]), 3.0)
    moved = Cylinder(R @ region.start, R @ region.end, 3.0)
    found = factor(paint(moved, grid=turned))
    np.testing.assert_allclose(found, factor(paint(region)), rtol=1e-10)


def test_size_has_the_derivative_by_the_painted_value_that_differences_confirm():
    points = BOX.low + 20 * np.random.default_rng(0).random((50, 3))
    weights = np.random.default_rng(1).normal(size=50)
    grid = BackgroundGrid.covering(BOX, 2.0)

    @jax.jit
    @jax.value_and_grad
    def total(values):
        regions = [
            PaintedRegion(BALL, values[0], 2.0, WHERE),
            PaintedRegion(REGIONS[1], values[1], 5.0, WHERE),
        ]
        field = painted(regions, grid, smoothing_mm=1.0)
        return jnp.sum(field.function(grid, SizeLaw(contrast=3.0)).size(points) * weights)

    at, h = jnp.asarray([1.7, 0.8]), 1e-5
    differences = [(total(at + step)[0] - total(at - step)[0]) / (2 * h) for step in h * np.eye(2)]
    # Differences of numbers near 1 by 1e-5: rounding of 1e-11 in the quotient, h² of the curvature.
    np.testing.assert_allclose(total(at)[1], differences, rtol=1e-6)


def test_paint_multiplies_with_another_driver():
    waves = formula_field(lambda p: np.exp(np.sin(p[:, 0] / 3)), GRID)
    both = combined([waves, paint(BALL, 3.0)])
    ratio = np.asarray(both.log_f - waves.log_f)
    np.testing.assert_allclose(np.ptp(ratio), np.log(3), rtol=1e-12)


@pytest.mark.parametrize(
    ("region", "words"),
    [
        (
            Sphere(np.array([40.0, 0, 0]), 5.0),
            r"the sphere of radius 5 mm about \[40, 0, 0\] mm lies",
        ),
        (BoxRegion(np.full(3, 30.0), np.full(3, 31.0)), "the box from"),
        (Plane(np.array([0.0, 0, 90]), np.array([0.0, 0, 1])), "of the plane through"),
        (tetrahedron(-90.0), "lies outside the warp's box"),
    ],
)
def test_a_region_outside_the_box_is_refused_with_both_places(region, words):
    if isinstance(region, Stl):
        region = Stl(TriMesh(region.surface.vertices - 50, region.surface.faces[:, ::-1]), "t.stl")
    with pytest.raises(CaseError, match=words) as failure:
        paint(region)
    assert "box, 20 x 20 x 20 mm about (10, 10, 10) mm" in str(failure.value)
    assert str(failure.value).startswith(WHERE)


def test_a_region_that_reaches_into_the_box_is_not_refused():
    paint(Sphere(np.array([24.0, 10, 10]), 5.0))


def test_a_region_of_the_surface_alone_is_refused():
    up = Normal(np.array([0.0, 0, 1]))
    for region in (up, Intersection((BALL, up))):
        with pytest.raises(
            CaseError, match=r"\[\[paint\]\] 1 region: the surface facing .* no inside"
        ):
            paint(region)


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_a_value_that_is_no_factor_is_refused(value):
    with pytest.raises(CaseError, match=r"1 value = .* must be a positive number"):
        paint(BALL, value)


@pytest.mark.parametrize("falloff", [-1.0, float("nan"), float("inf")])
def test_a_fall_off_that_is_no_length_is_refused(falloff):
    with pytest.raises(CaseError, match=r"falloff_mm = .* at least 0"):
        paint(BALL, 2.0, falloff)


def test_the_least_fall_off_is_that_of_the_steepest_slope():
    """The smoothstep's steepest slope is 15/8 of its mean slope 1 / w."""
    t = np.linspace(0, 1, 100_001)
    steepest = np.abs(np.diff(1 - t**3 * (10 - 15 * t + 6 * t**2))).max() / (t[1] - t[0])
    np.testing.assert_allclose(FALLOFF_IN_SMOOTHINGS, steepest * np.sqrt(2 * np.pi), rtol=1e-6)
