"""The least-squares warp: sizes, no folds, and how it ends (design section 4, items 2 and 4)."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from texmap_opt.box import Box
from texmap_opt.errors import WarpError
from texmap_opt.warp.alignment import Unaligned
from texmap_opt.warp.certificate import folded, grid_coefficients
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warp.least_squares_problem import LeastSquaresProblem
from texmap_opt.warp.levels import coarser, prolonged
from texmap_opt.warp.quality import achieved_sizes
from texmap_opt.warp.successive_approximation import SuccessiveApproximation
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.warping_function import WarpingFunction

BOUNDS = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
CUBE = Box.aligned(BOUNDS)


def ball(p):
    """An f that asks for cells three times finer in the middle of the unit cube than far away."""
    return np.exp(np.log(3) * np.exp(-np.sum(((p - 0.5) / 0.25) ** 2, axis=1)))


def lopsided(p):
    """No symmetry between the axes."""
    x, y, z = p.T
    return np.exp(0.4 * np.sin(2 * x + 3 * y) + 0.3 * np.cos(2 * z) * x)


# Most of the time goes into compiling for a size of grid, so tests share theirs.
EIGHT = (8, 8, 8)


def from_formula(f, box=CUBE, contrast=3.0, cells=8):
    spacing = float(box.extent.max()) / cells / 2
    return WarpingFunction.from_formula(f, box, spacing_mm=spacing, law=SizeLaw(contrast=contrast))


def rough(seed):
    """Lognormal f, sigma(log f) = 1.5, correlation length 0.1 of the cube (design section 4, 2)."""
    grid = BackgroundGrid.covering(CUBE, 1 / 16)
    noise = np.random.default_rng(seed).standard_normal(grid.shape)
    # Filtering white noise by a Gaussian of width l / sqrt(2) gives the correlation exp(-r²/2l²).
    log_f = gaussian_filter(noise, 0.1 * 16 / np.sqrt(2), mode="reflect")
    log_f *= 1.5 / log_f.std()
    return WarpingFunction.on_grid(grid, log_f, SizeLaw(contrast=1e6))


def size_slope(grid, f):
    """Slope of log achieved against log wanted size."""
    achieved = np.log(grid_coefficients(grid).mean(axis=1)) / grid.dimensions
    wanted = np.log(np.asarray(f.size(grid.centres)))
    return np.polyfit(wanted, achieved, 1)[0]


@pytest.mark.parametrize("d", [2, 3])
def test_constant_f_leaves_the_uniform_grid(d):
    box = Box.aligned(BOUNDS * 7, extrusion="y" if d == 2 else None)
    grid = Grid.uniform(box, EIGHT[:d])
    result = LeastSquares().fit(grid, from_formula(lambda p: np.full(len(p), 3.0), box))
    assert result.converged
    # Only the rounding of s could move anything.
    np.testing.assert_allclose(result.grid.nodes, grid.nodes, atol=7e-12)


@pytest.mark.parametrize(("size_weight", "slope"), [(1.0, 0.91), (10.0, 0.98)])
def test_cells_get_the_size_they_ask_for(size_weight, slope):
    """Design section 4, item 4b: 12³ cells, contrast 3; two digits are stated, so 0.01."""
    f = from_formula(ball, cells=12)
    result = LeastSquares(size_weight=size_weight).fit(Grid.uniform(CUBE, (12, 12, 12)), f)
    assert result.converged and not folded(grid_coefficients(result.grid)).any()
    np.testing.assert_allclose(size_slope(result.grid, f), slope, atol=0.01)


def test_outer_nodes_slide_on_their_faces_and_fixed_ones_rest():
    fixed = np.zeros((2, 3), dtype=bool)
    fixed[0, 0] = True
    grid = Grid.uniform(CUBE, EIGHT, fixed=fixed)
    nodes = LeastSquares().fit(grid, from_formula(ball)).grid.nodes
    for axis in range(3):
        faces = np.moveaxis(nodes[..., axis], axis, 0)
        np.testing.assert_array_equal(faces[0], 0)
        np.testing.assert_allclose(faces[-1], 1, atol=1e-15)
    np.testing.assert_array_equal(nodes[0], grid.nodes[0])
    assert np.abs(nodes[-1] - grid.nodes[-1]).max() > 0.01


def test_rough_f_folds_the_printed_iteration_but_never_least_squares():
    """Design section 4, item 2: 9³ nodes; the study studies/warp counts many more."""
    grid = Grid.uniform(CUBE, (8, 8, 8))
    folding = 0
    for seed in range(3):
        f = rough(seed)
        printed = SuccessiveApproximation(relaxation=0.5, max_sweeps=3000).fit(grid, f)
        folding += folded(grid_coefficients(printed.grid)).any()
        ours = LeastSquares(max_steps=50).fit(grid, f)
        assert grid_coefficients(ours.grid).min() > 0
    assert folding >= 1


def test_scaling_the_box_scales_the_grid():
    small = LeastSquares().fit(Grid.uniform(CUBE, EIGHT), from_formula(lopsided))
    large_box = Box.aligned(BOUNDS * 40 - 3)
    f = from_formula(lambda p: lopsided((p + 3) / 40), large_box)
    large = LeastSquares().fit(Grid.uniform(large_box, EIGHT), f)
    # Rounding differs, and grows with the steps; far below the tolerance of the solver.
    np.testing.assert_allclose(large.grid.nodes, small.grid.nodes * 40 - 3, atol=40 * 1e-6)


def objective(grid, f):
    """Of the nodes of a grid, with the weights that `LeastSquares` has by itself."""
    problem = LeastSquaresProblem.of(grid, f, size_weight=10.0, alignment=Unaligned())
    return problem.energies(jnp.moveaxis(jnp.asarray(grid.nodes), -1, 0))


def test_too_few_steps_are_reported_with_the_best_grid_so_far_and_no_fold():
    f, grid = from_formula(ball), Grid.uniform(CUBE, EIGHT)
    result = LeastSquares(max_steps=5).fit(grid, f)
    assert not result.converged
    assert "stopped after 5 steps" in result.message
    assert result.measures["gain"] > result.measures["tolerance"]
    assert grid_coefficients(result.grid).min() > 0
    found = objective(result.grid, f)
    # The nodes are the same to rounding; the objective is stationary in nothing here.
    np.testing.assert_allclose(result.measures["objective"], found.total, rtol=1e-9)
    for part in ("shape", "size", "alignment", "rest", "surface"):
        value = result.measures[f"objective_{part}"]
        np.testing.assert_allclose(value, getattr(found, part), rtol=1e-9)
    assert found.total < objective(grid, f).total


@pytest.mark.parametrize("exponent", [0.5, 2.0])
def test_the_exponent_says_how_the_size_follows_f(exponent):
    """Along a bar, where cells are free to change along it alone and size counts far above shape."""
    bar = Box.aligned(np.array([[0.0, 0, 0], [24.0, 2, 2]]))
    f = WarpingFunction.from_formula(
        lambda p: np.exp(0.2 * np.sin(p[:, 0] / 4)),
        bar,
        spacing_mm=1.0,
        law=SizeLaw(exponent=exponent, contrast=10.0),
    )
    grid = LeastSquares(size_weight=100.0).fit(Grid.uniform(bar, (24, 2, 2)), f).grid
    log_f = 0.2 * np.sin(grid.centres[:, 0] / 4)
    slope = np.polyfit(log_f, np.log(achieved_sizes(grid)), 1)[0]
    np.testing.assert_allclose(slope, -exponent, rtol=0.05)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"size_weight": -1.0}, "size is -1, but must be a positive number"),
        ({"size_weight": jnp.asarray(0.0)}, "size is 0, but"),
        ({"size_weight": float("nan")}, "size is nan, but"),
        ({"gtol": 0.0}, "tolerance is 0, but"),
        ({"gtol": float("nan")}, "tolerance is nan, but"),
        ({"max_steps": 0}, "may take 0 steps, but needs at least 1"),
    ],
)
def test_impossible_settings_are_refused(arguments, words):
    with pytest.raises(WarpError, match=words) as failure:
        LeastSquares(**arguments)
    # One sentence.
    assert str(failure.value).count(". ") == 0


def test_one_cell_along_an_axis_is_refused():
    with pytest.raises(WarpError, match="only one along y"):
        LeastSquares().fit(Grid.uniform(CUBE, (4, 1, 4)), from_formula(lopsided))


def test_a_finer_grid_starts_as_the_map_of_the_coarser_one():
    """Cells that divide cells keep the map, so its coefficients stay positive (de Casteljau)."""
    coarse = Grid.uniform(CUBE, (4, 4, 4))
    bump = np.random.default_rng(0).uniform(-0.05, 0.05, coarse.nodes.shape)
    coarse = coarse.with_nodes(coarse.nodes + bump * np.moveaxis(coarse.free, 0, -1))
    assert grid_coefficients(coarse).min() > 0
    fine = Grid.uniform(CUBE, EIGHT)
    nodes = np.moveaxis(
        np.asarray(prolonged(jnp.asarray(np.moveaxis(coarse.nodes, -1, 0)), fine)), 0, -1
    )
    np.testing.assert_allclose(nodes[::2, ::2, ::2], coarse.nodes, atol=1e-14)
    assert (
        grid_coefficients(fine.with_nodes(nodes)).min() >= grid_coefficients(coarse).min() - 1e-12
    )
    assert [level.cells for level in coarser(Grid.uniform(CUBE, (33, 32, 20)))] == [
        (17, 16, 10),
        (33, 32, 20),
    ]
