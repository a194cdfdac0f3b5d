"""The least-squares warp: size, no folds, direction, derivatives (design section 4, item 4)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from texmap_opt.errors import WarpError
from texmap_opt.warp.alignment import NoShear
from texmap_opt.warp.box import Box
from texmap_opt.warp.certificate import folded, grid_coefficients
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warp.levels import coarser, prolonged
from texmap_opt.warp.successive_approximation import SuccessiveApproximation
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.stress_driver import StressSamples, stress_driver
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


SMALL = Box.aligned(np.array([[0.0, 0, 0], [1.0, 0.8, 0.9]]))


def stressed_points():
    """Points in a box with a stress that varies in space."""
    points = np.random.default_rng(0).uniform(size=(200, 3)) * SMALL.extent
    waves = [np.sin(3 * points[:, 0] + k) + np.cos(2 * points[:, 1] * k) for k in range(6)]
    return points, np.stack(waves, axis=1)


def driven(points, stress, box, law):
    """The warping function of a stress [cases, samples, 6] given at points of equal volume."""
    background = BackgroundGrid.covering(box, 0.25)
    samples = StressSamples(points, np.full(len(points), 1 / len(points)), stress)
    return stress_driver(samples, background, smoothing_mm=0.25).function(background, law)


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
    parts = {k: v for k, v in result.measures.items() if k.startswith("objective_")}
    np.testing.assert_allclose(result.measures["objective"], sum(parts.values()))
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


def test_turning_the_box_and_its_stress_turns_the_grid():
    """Positions in space, with alignment: nothing in the program prefers the axes of space."""
    points, stress = stressed_points()
    R = Rotation.from_rotvec([0.4, -0.3, 0.8]).as_matrix()
    tensors = stress[:, np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])]
    turned = np.einsum("ia,nab,jb->nij", R, tensors, R)
    turned = turned[:, [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]

    def warped(points, stress, axes):
        box = Box(axes, SMALL.bounds)
        f = driven(points, stress[None], box, SizeLaw())
        warp = LeastSquares(alignment=NoShear(jnp.asarray(5.0)))
        return warp.fit(Grid.uniform(box, (4, 3, 3)), f).grid.positions

    there = warped(points, stress, np.eye(3))
    back = warped(points @ R.T, turned, R.T)
    np.testing.assert_allclose(back, there @ R.T, atol=1e-6)


def bending(p):
    """Stress sxx = 12 (1 - x) (y - 1/2), txy = -0.75 (1 - 4 (y - 1/2)²), section 4, item 3."""
    x, y, _ = p.T
    stress = np.zeros((len(p), 6))
    stress[:, 0], stress[:, 5] = 12 * (1 - x) * (y - 0.5), -0.75 * (1 - 4 * (y - 0.5) ** 2)
    return stress


def mean_angle(grid):
    """In-plane angle between the first axis of cells and the nearest principal axis, mean [deg]."""
    corners = grid.nodes.reshape(-1, 3)[grid.corners]
    edge = corners[:, [1, 2, 5, 6]].mean(axis=1) - corners[:, [0, 3, 4, 7]].mean(axis=1)
    stress = bending(grid.centres)
    principal = 0.5 * np.arctan2(2 * stress[:, 5], stress[:, 0] - stress[:, 1])
    angle = np.arctan2(edge[:, 1], edge[:, 0]) - principal
    return np.degrees(np.abs((angle + np.pi / 4) % (np.pi / 2) - np.pi / 4)).mean()


def test_cells_turn_along_the_principal_stresses():
    """From 22 degrees to at most 8, no cell smaller than a fifth of what is wanted."""
    grid = Grid.uniform(CUBE, (12, 12, 12))
    background = BackgroundGrid.covering(CUBE, 1 / 12)
    points = background.positions.reshape(-1, 3)
    points = points[np.all((points > -1e-9) & (points < 1 + 1e-9), axis=1)]
    samples = StressSamples(points, np.full(len(points), 1 / len(points)), bending(points)[None])
    f = stress_driver(samples, background, smoothing_mm=1 / 12).function(background, SizeLaw())
    np.testing.assert_allclose(mean_angle(grid), 22.05, atol=0.01)
    warp = LeastSquares(size_weight=1.0, alignment=NoShear(jnp.asarray(200.0)))
    result = warp.fit(grid, f)
    relative = (
        grid_coefficients(result.grid) / np.asarray(f.size(result.grid.centres))[:, None] ** 3
    )
    assert mean_angle(result.grid) < 8
    assert relative.min() > 0.2


def test_too_few_steps_are_reported_and_still_give_no_fold():
    f = from_formula(ball, cells=12)
    result = LeastSquares(max_steps=8).fit(Grid.uniform(CUBE, (12, 12, 12)), f)
    assert not result.converged
    assert "stopped after 8 steps" in result.message
    assert result.measures["gain"] > result.measures["tolerance"]
    assert grid_coefficients(result.grid).min() > 0


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


@pytest.mark.parametrize("d", [2, 3])
def test_implicit_derivative_agrees_with_central_differences(d):
    """By the stress values, exponent, contrast, weight of the alignment and of the size."""
    box = Box.aligned(SMALL.bounds, extrusion="z" if d == 2 else None)
    grid = Grid.uniform(box, (4, 3, 3)[:d])
    points, stress = stressed_points()
    rng = np.random.default_rng(1)
    towards, weights = rng.standard_normal(stress.shape), rng.standard_normal(grid.nodes.shape)

    def moved(parameters):
        by, exponent, contrast, alignment, size = parameters
        there = jnp.asarray(stress)[None] + by * jnp.asarray(towards)[None]
        f = driven(points, there, box, SizeLaw(exponent=exponent, contrast=contrast))
        warp = LeastSquares(size_weight=size, alignment=NoShear(alignment))
        return jnp.sum(jnp.asarray(weights) * warp.nodes(grid, f))

    at = jnp.asarray([0.0, 1.0, 2.0, 5.0, 10.0])
    gradient = np.asarray(jax.grad(moved)(at))
    for k, step in enumerate(1e-4 * np.maximum(1, np.asarray(at))):
        aside = [moved(at.at[k].add(sign * step)) for sign in (1, -1)]
        # Both minima are exact to 1e-10, so the difference is to 1e-6; its own error is step².
        np.testing.assert_allclose(float(aside[0] - aside[1]) / (2 * step), gradient[k], rtol=1e-4)


def test_the_derivative_is_refused_under_jit():
    f = from_formula(lopsided)
    with pytest.raises(WarpError, match=r"jax\.jit"):
        jax.jit(lambda w: LeastSquares(size_weight=w).nodes(Grid.uniform(CUBE, (3, 3, 3)), f))(10.0)
