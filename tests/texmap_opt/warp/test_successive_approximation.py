"""The paper's iteration, equation 4.2, and its sweep against one written with SciPy."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from texmap_opt.box import Box
from texmap_opt.errors import WarpError
from texmap_opt.warp.certificate import folded, grid_coefficients
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.successive_approximation import WEIGHTS, SuccessiveApproximation, f_at
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.size_law import LIMIT_POWER, SizeLaw
from texmap_opt.warping_function.warping_function import WarpingFunction

UNIT = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
BOXES = {2: Box.aligned(UNIT, extrusion="z"), 3: Box.aligned(UNIT)}


def wave(p):
    return np.exp(0.5 * np.sin(2 * p[:, 0] + 1) + 0.3 * np.cos(3 * p[:, 1] * p[:, 2]))


def along_x(p):
    return np.exp(0.4 * np.sin(2 * np.pi * p[:, 0]))


def function(f, box=BOXES[3], law=None):
    law = law or SizeLaw(contrast=1e3)
    return WarpingFunction.from_formula(f, box, spacing_mm=0.05, law=law)


def numpy_values(f, points):
    """Of f at points [samples, d], by SciPy's cubic splines and the formula of the contrast limit."""
    coefficients = np.asarray(f.log_f.coefficients)[..., 0]
    t = (points - np.asarray(f.log_f.origin)) / np.asarray(f.log_f.spacing)
    t = np.clip(t, 1, np.array(coefficients.shape) - 2)
    v = map_coordinates(coefficients, t.T, order=3, prefilter=False) - float(f.centre)
    return np.exp(v * (1 + (v / float(f.limit)) ** LIMIT_POWER) ** (-1 / LIMIT_POWER))


def numpy_mean(f, nodes, weights):
    """Weighted mean of the grid neighbours of every node [*nodes, d], vectorised."""
    d = nodes.shape[-1]
    total, weight = np.zeros_like(nodes), np.zeros((*nodes.shape[:-1], 1))
    at_nodes = numpy_values(f, nodes.reshape(-1, d)).reshape(weight.shape)
    for axis in range(d):
        lower = (*[slice(None)] * axis, slice(None, -1))
        upper = (*[slice(None)] * axis, slice(1, None))
        w_lower, w_upper = at_nodes[lower], at_nodes[upper]
        if weights == "midpoint":
            middle = (nodes[lower] + nodes[upper]) / 2
            w_lower = w_upper = numpy_values(f, middle.reshape(-1, d)).reshape(w_lower.shape)
        total[upper] += w_lower * nodes[lower]
        weight[upper] += w_lower
        total[lower] += w_upper * nodes[upper]
        weight[lower] += w_upper
    return total / weight


@pytest.mark.parametrize("weights", WEIGHTS)
@pytest.mark.parametrize("dimensions", [2, 3])
def test_sweeps_are_those_of_a_sweep_written_with_scipy(dimensions, weights):
    """An independent spline, an independent sum: equal to rounding after three sweeps."""
    box = BOXES[dimensions]
    f, grid = function(wave, box), Grid.uniform(box, (5, 4, 6)[:dimensions])
    result = SuccessiveApproximation(weights=weights, max_sweeps=3).fit(grid, f)
    nodes = grid.nodes
    for _ in range(3):
        nodes = np.where(np.moveaxis(grid.free, 0, -1), numpy_mean(f, nodes, weights), nodes)
    np.testing.assert_allclose(result.grid.nodes, nodes, atol=1e-13)
    assert np.abs(nodes - grid.nodes).max() > 1e-2


@pytest.mark.parametrize("dimensions", [2, 3])
def test_the_fast_values_are_those_of_the_warping_function(dimensions):
    """At points inside and outside the background grid, under a contrast limit that binds."""
    f = function(wave, BOXES[dimensions], law=SizeLaw(contrast=1.5))
    points = np.random.default_rng(2).uniform(-0.5, 1.5, (500, dimensions))
    values = f_at(f, jnp.asarray(points.T))
    np.testing.assert_allclose(values, f.f(points), rtol=1e-13)


@pytest.mark.parametrize("weights", WEIGHTS)
@pytest.mark.parametrize("dimensions", [2, 3])
def test_constant_f_leaves_the_uniform_grid(dimensions, weights):
    grid = Grid.uniform(BOXES[dimensions], (4, 3, 5)[:dimensions])
    f = function(lambda p: np.full(len(p), 2.0), BOXES[dimensions])
    result = SuccessiveApproximation(weights=weights).fit(grid, f)
    assert result.converged
    np.testing.assert_allclose(result.grid.nodes, grid.nodes, atol=1e-12)


@pytest.mark.parametrize(("weights", "exponent"), [("printed", 2), ("midpoint", 1)])
def test_in_one_dimension_the_size_follows_f_to_the_exponent_of_the_weights(weights, exponent):
    """Design section 4, item 1; f varies along x, and 40 cells are O(h²) from the limit."""
    f = function(along_x, BOXES[2])
    grid = Grid.uniform(BOXES[2], (40, 2))
    result = SuccessiveApproximation(weights=weights).fit(grid, f)
    assert result.converged
    x = result.grid.nodes[:, 0, 0]
    middle = np.stack([(x[1:] + x[:-1]) / 2, np.full(40, 0.5)], axis=1)
    slope = np.polyfit(np.log(f.f(middle)), np.log(np.diff(x)), 1)[0]
    # Measured 1.986 and 1.000 here, 1.994 and 1.000 with 60 cells.
    np.testing.assert_allclose(slope, -exponent, rtol=0.02)


@pytest.mark.parametrize(("weights", "exponent"), [("printed", 2), ("midpoint", 1)])
def test_in_three_dimensions_only_the_edges_along_f_follow_it(weights, exponent):
    """Nodes slide on the box's faces, so cells are equally wide and only one edge of three varies.

    So the cube root of the volume follows f to a third of the exponent.
    """
    f = function(along_x)
    result = SuccessiveApproximation(weights=weights).fit(Grid.uniform(BOXES[3], (30, 2, 2)), f)
    volume = grid_coefficients(result.grid).mean(axis=1)
    slope = np.polyfit(np.log(f.f(result.grid.centres)), np.log(volume) / 3, 1)[0]
    np.testing.assert_allclose(slope, -exponent / 3, rtol=0.02)


def test_at_rest_every_inner_node_is_the_weighted_mean_of_its_six_neighbours():
    """Equation 4.2 itself, one node at a time."""
    f = function(wave)
    nodes = SuccessiveApproximation(eps=1e-10).fit(Grid.uniform(BOXES[3], (4, 4, 4)), f).grid.nodes
    weight = np.asarray(f.f(nodes.reshape(-1, 3))).reshape(5, 5, 5)
    steps = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])
    for i in np.ndindex(3, 3, 3):
        near = [tuple(np.array(i) + 1 + step) for step in steps]
        mean = sum(weight[j] * nodes[j] for j in near) / sum(weight[j] for j in near)
        np.testing.assert_allclose(nodes[i[0] + 1, i[1] + 1, i[2] + 1], mean, atol=1e-8)


def test_outer_nodes_slide_on_their_faces_and_corners_stay():
    grid = Grid.uniform(BOXES[3], (4, 4, 4))
    nodes = SuccessiveApproximation().fit(grid, function(wave)).grid.nodes
    for axis in range(3):
        faces = np.moveaxis(nodes[..., axis], axis, 0)
        assert np.all(faces[0] == 0) and np.all(faces[-1] == 1)
    np.testing.assert_array_equal(nodes[::4, ::4, ::4], grid.nodes[::4, ::4, ::4])
    assert np.abs(nodes[0, :, :, 1:] - grid.nodes[0, :, :, 1:]).max() > 1e-3


def test_nodes_of_a_fixed_face_stay_and_those_of_the_others_slide():
    fixed = np.array([[True, False], [False, False]])
    grid = Grid.uniform(BOXES[2], (4, 4), fixed=fixed)
    nodes = SuccessiveApproximation().fit(grid, function(wave, BOXES[2])).grid.nodes
    np.testing.assert_array_equal(nodes[0], grid.nodes[0])
    assert np.abs(nodes[-1, :, 1] - grid.nodes[-1, :, 1]).max() > 1e-3


def test_the_exponent_of_the_size_law_has_no_say():
    """The weights are f itself; only a contrast limit that binds would differ."""
    grid = Grid.uniform(BOXES[3], (4, 4, 4))
    once = SuccessiveApproximation().fit(grid, function(wave, law=SizeLaw(contrast=1e6)))
    law = SizeLaw(exponent=2.0, contrast=1e12)
    twice = SuccessiveApproximation().fit(grid, function(wave, law=law))
    np.testing.assert_allclose(twice.grid.nodes, once.grid.nodes, atol=1e-9)


@pytest.mark.parametrize("weights", WEIGHTS)
def test_turning_the_box_and_f_turns_the_grid(weights):
    c, s = np.cos(0.7), np.sin(0.7)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    turned = Box.around(UNIT @ R.T, R.T)
    warp = SuccessiveApproximation(weights=weights)
    here = warp.fit(Grid.uniform(BOXES[3], (3, 4, 3)), function(wave)).grid
    f = function(lambda p: wave(p @ R), turned)
    there = warp.fit(Grid.uniform(turned, (3, 4, 3)), f).grid
    np.testing.assert_allclose(there.positions, here.positions @ R.T, atol=1e-10)


def test_permuting_the_axes_permutes_the_grid():
    there = SuccessiveApproximation().fit(Grid.uniform(BOXES[3], (3, 4, 5)), function(wave))
    f = function(lambda p: wave(p[:, [1, 2, 0]]))
    back = SuccessiveApproximation().fit(Grid.uniform(BOXES[3], (5, 3, 4)), f)
    expected = there.grid.nodes.transpose(2, 0, 1, 3)[..., [2, 0, 1]]
    np.testing.assert_allclose(back.grid.nodes, expected, atol=1e-9)


def test_under_relaxation_has_the_same_rest():
    grid, f = Grid.uniform(BOXES[2], (5, 5)), function(wave, BOXES[2])
    full, half = (SuccessiveApproximation(relaxation=r, eps=1e-11).fit(grid, f) for r in (1.0, 0.5))
    assert half.iterations > full.iterations
    np.testing.assert_allclose(half.grid.nodes, full.grid.nodes, atol=1e-9)


def test_running_out_of_sweeps_is_reported():
    f = function(wave)
    result = SuccessiveApproximation(max_sweeps=3).fit(Grid.uniform(BOXES[3], (6, 6, 6)), f)
    assert not result.converged and result.iterations == 3
    assert "stopped after 3 sweeps" in result.message
    assert result.measures["movement"] > 1e-6


def test_a_grid_that_rests_is_reported_by_its_last_movement():
    grid = Grid.uniform(BOXES[2], (4, 4))
    result = SuccessiveApproximation(eps=1e-4).fit(grid, function(wave, BOXES[2]))
    assert result.converged and result.message == ""
    assert result.measures["movement"] < 1e-4


@pytest.mark.parametrize("weights", WEIGHTS)
def test_rough_f_folds_cells_in_three_dimensions(weights):
    """Design section 4, item 2: lognormal, sigma 2, correlation length 0.1 of the box."""
    background = BackgroundGrid.covering(BOXES[3], 0.05)
    # White noise through a Gaussian is correlated over sqrt(2) of its width.
    width = 0.1 / 0.05 / np.sqrt(2)
    white = np.random.default_rng(0).standard_normal(background.shape)
    noise = gaussian_filter(white, width, mode="wrap")
    f = WarpingFunction.on_grid(background, 2.0 * noise / noise.std(), SizeLaw(contrast=1e3))
    warp = SuccessiveApproximation(weights=weights, relaxation=0.5, max_sweeps=1000)
    result = warp.fit(Grid.uniform(BOXES[3], (8, 8, 8)), f)
    assert folded(grid_coefficients(result.grid)).sum() > 0
    assert not result.converged


def test_one_cell_along_an_axis_is_refused():
    with pytest.raises(WarpError, match="only one along y"):
        SuccessiveApproximation().fit(Grid.uniform(BOXES[2], (4, 1)), function(wave, BOXES[2]))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"weights": "vertices"}, '"vertices", but must be'),
        ({"relaxation": 0.0}, "above 0"),
        ({"relaxation": 1.5}, "at most 1"),
        ({"eps": 0.0}, "must be positive"),
        ({"max_sweeps": 0}, "at least 1"),
    ],
)
def test_impossible_options_are_refused(options, message):
    with pytest.raises(WarpError, match=message):
        SuccessiveApproximation(**options)
