"""The least-squares warp: shape, size, no folds (design section 4, items 4a, 4b and 4d)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from texmap_opt.warp.certificate import grid_coefficients
from texmap_opt.warp.hex_grid import HexGrid
from texmap_opt.warp.least_squares import LeastSquares, LeastSquaresProblem
from texmap_opt.warp.quality import quality
from texmap_opt.warp.successive_approximation import SuccessiveApproximation
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.warping_function import SizeLaw, WarpingFunction

CUBE = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])


@eqx.filter_jit
def residuals(problem, nodes):
    return problem.residuals(nodes)


def ball(p):
    """An f that asks for cells three times finer in the middle of the unit cube than far away."""
    return np.exp(np.log(3) * np.exp(-np.sum(((p - 0.5) / 0.25) ** 2, axis=1)))


def lopsided(p):
    """No symmetry between the axes."""
    x, y, z = p.T
    return np.exp(0.4 * np.sin(2 * x + 3 * y) + 0.3 * np.cos(2 * z) * x)


def painted(f, box=CUBE, contrast=3.0, cells=12):
    spacing = float((box[1] - box[0]).max()) / cells / 2
    return WarpingFunction.painted(f, box, spacing_mm=spacing, law=SizeLaw(contrast=contrast))


def rough(seed):
    """Lognormal f, sigma(log f) = 1.5, correlation length 0.1 of the cube (design section 4, 2)."""
    grid = BackgroundGrid.covering(CUBE, 0.04)
    noise = np.random.default_rng(seed).standard_normal(grid.shape)
    # Filtering white noise by a Gaussian of width l / sqrt(2) gives the correlation exp(-r²/2l²).
    log_f = gaussian_filter(noise, 0.1 / 0.04 / np.sqrt(2), mode="reflect")
    log_f *= 1.5 / log_f.std()
    law = SizeLaw(contrast=1e6)
    return WarpingFunction.on_grid(
        grid, log_f, np.zeros((*grid.shape, 0)), np.ones(grid.shape), law
    )


def test_constant_f_leaves_the_uniform_grid():
    grid = HexGrid.uniform(CUBE * 7, (4, 3, 5))
    result = LeastSquares().fit(grid, painted(lambda p: np.full(len(p), 3.0), CUBE * 7))
    assert result.converged
    # Only the rounding of s moves anything.
    np.testing.assert_allclose(result.grid.nodes, grid.nodes, atol=1e-9)


@pytest.mark.parametrize(("size_weight", "slope"), [(1.0, 0.91), (10.0, 0.98)])
def test_cells_get_the_size_they_ask_for(size_weight, slope):
    """Design section 4, item 4b: 12³ cells, contrast 3; two digits are stated, so 0.01."""
    f = painted(ball)
    result = LeastSquares(size_weight=size_weight).fit(HexGrid.uniform(CUBE, (12, 12, 12)), f)
    measured = quality(result.grid, f)
    assert result.converged and measured.folded_cells == 0
    assert measured.size_slope is not None
    np.testing.assert_allclose(measured.size_slope, slope, atol=0.01)


def test_outer_nodes_slide_on_their_faces():
    grid = HexGrid.uniform(CUBE, (12, 12, 12))
    nodes = LeastSquares().fit(grid, painted(ball)).grid.nodes
    for axis in range(3):
        faces = np.moveaxis(nodes[..., axis], axis, 0)
        np.testing.assert_allclose(faces[0], 0, atol=1e-12)
        np.testing.assert_allclose(faces[-1], 1, atol=1e-12)
    moved = nodes - grid.nodes
    assert np.abs(moved[0, :, :, 1:]).max() > 0.01


def test_rough_f_folds_the_printed_iteration_but_never_least_squares():
    """Design section 4, item 2: 9³ nodes; 9 of 10 exact solutions there have inverted cells."""
    grid = HexGrid.uniform(CUBE, (8, 8, 8))
    folding = 0
    for seed in range(5):
        f = rough(seed)
        printed = SuccessiveApproximation(relaxation=0.5, max_sweeps=5000).fit(grid, f)
        folding += quality(printed.grid, f).folded_cells > 0
        ours = LeastSquares(max_steps=200).fit(grid, f)
        assert grid_coefficients(ours.grid).min() > 0
        assert quality(ours.grid, f).folded_cells == 0
    assert folding >= 3


def test_scaling_the_box_scales_the_grid():
    small = LeastSquares().fit(HexGrid.uniform(CUBE, (5, 5, 5)), painted(lopsided, cells=5))
    large_box = CUBE * 40 - 3
    f = painted(lambda p: lopsided((p + 3) / 40), large_box, cells=5)
    large = LeastSquares().fit(HexGrid.uniform(large_box, (5, 5, 5)), f)
    # Rounding differs, and where L-BFGS stops with it; far below its tolerance of 1e-3.
    np.testing.assert_allclose(large.grid.nodes, small.grid.nodes * 40 - 3, atol=40 * 1e-6)


def test_permuting_the_axes_permutes_the_grid():
    """The only rotations of a box onto a box."""
    box = np.array([[0.0, 0.0, 0.0], [1.0, 1.5, 0.75]])
    cells = (4, 6, 3)
    there = LeastSquares().fit(HexGrid.uniform(box, cells), painted(lopsided, box, cells=6))
    turned = painted(lambda p: lopsided(p[:, [1, 2, 0]]), box[:, [2, 0, 1]], cells=6)
    back = LeastSquares().fit(HexGrid.uniform(box[:, [2, 0, 1]], (3, 4, 6)), turned)
    expected = there.grid.nodes.transpose(2, 0, 1, 3)[..., [2, 0, 1]]
    np.testing.assert_allclose(back.grid.nodes, expected, atol=1e-6)


def test_residual_of_shape_is_the_symmetric_dirichlet_energy():
    """|T - T^-T|² = |T|² + |T^-1|² - 6 at every corner; docs/theory/warp.md."""
    grid = HexGrid.uniform(CUBE, (3, 2, 2))
    problem = LeastSquaresProblem.of(grid, painted(lopsided, cells=3), 10.0)
    bump = np.random.default_rng(1).uniform(-0.03, 0.03, problem.start.shape)
    nodes = problem.start + jnp.asarray(bump)
    shape = np.asarray(residuals(problem, nodes).shape)
    x, s = np.moveaxis(np.asarray(nodes), 0, -1), np.asarray(problem.f.size(_centres(nodes)))
    s = s.reshape(grid.cells)
    for i, j, k in np.ndindex(*grid.cells):
        for a, b, c in np.ndindex(2, 2, 2):
            J = np.stack(
                [
                    x[i + 1, j + b, k + c] - x[i, j + b, k + c],
                    x[i + a, j + 1, k + c] - x[i + a, j, k + c],
                    x[i + a, j + b, k + 1] - x[i + a, j + b, k],
                ],
                axis=1,
            )
            T = J / grid.uniform_edge / s[i, j, k]
            energy = np.sum(T**2) + np.sum(np.linalg.inv(T) ** 2) - 6
            ours = 8 * np.sum(shape[:, :, a, b, c, i, j, k] ** 2)
            np.testing.assert_allclose(ours, energy, rtol=1e-9)


def test_a_rotated_uniform_block_has_no_shape_and_no_size_residual():
    grid = HexGrid.uniform(CUBE, (2, 2, 2))
    problem = LeastSquaresProblem.of(grid, painted(lambda p: np.ones(len(p)), cells=2), 10.0)
    R = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    turned = jnp.einsum("cd,dxyz->cxyz", jnp.asarray(R), problem.start)
    found = residuals(problem, turned)
    np.testing.assert_allclose(found.shape, 0, atol=1e-12)
    np.testing.assert_allclose(found.size, 0, atol=1e-12)


def test_an_inverted_cell_is_refused_with_an_infinite_objective():
    grid = HexGrid.uniform(CUBE, (2, 2, 2))
    problem = LeastSquaresProblem.of(grid, painted(lopsided, cells=2), 10.0)
    assert np.isfinite(residuals(problem, problem.start).objective())
    folded = problem.start.at[0, 1, 1, 1].set(1.2)
    assert np.isposinf(residuals(problem, folded).objective())


def test_gradient_of_the_objective_has_a_second_order_taylor_remainder():
    """With respect to the nodes, through s at the moving centres as well."""
    grid = HexGrid.uniform(CUBE, (3, 3, 2))
    problem = LeastSquaresProblem.of(grid, painted(lopsided, cells=3), 10.0)
    rng = np.random.default_rng(2)
    x = problem.start + jnp.asarray(rng.uniform(-0.03, 0.03, problem.start.shape))
    v = jnp.asarray(rng.standard_normal(problem.start.shape))
    objective = jax.jit(lambda x: problem.objective(x))
    gradient = jax.grad(objective)(x)
    value = objective(x)
    steps = 1e-3 * 0.5 ** np.arange(5)
    slope = float(jnp.sum(gradient * v))
    remainder = [abs(float(objective(x + t * v) - value) - t * slope) for t in steps]
    orders = np.log2(np.array(remainder[:-1]) / np.array(remainder[1:]))
    np.testing.assert_allclose(orders, 2, atol=0.1)


def test_too_few_steps_are_reported_and_still_give_no_fold():
    f = painted(ball)
    result = LeastSquares(max_steps=6).fit(HexGrid.uniform(CUBE, (12, 12, 12)), f)
    assert not result.converged
    assert "stopped after 6 steps" in result.message
    assert quality(result.grid, f).folded_cells == 0


def _centres(nodes):
    x = np.moveaxis(np.asarray(nodes), 0, -1)
    for axis in range(3):
        n = x.shape[axis]
        x = (np.take(x, range(n - 1), axis) + np.take(x, range(1, n), axis)) / 2
    return x.reshape(-1, 3)
