"""The residuals of the least-squares warp against their definitions (docs/theory/warp.md)."""

from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from texmap_opt.box import Box
from texmap_opt.warp.alignment import EqualStretch, LeastEnergy, NoShear, Unaligned
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.least_squares_problem import TIKHONOV, LeastSquaresProblem
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.warping_function import WarpingFunction

BOUNDS = np.array([[0.0, 0.0, 0.0], [1.0, 1.2, 0.8]])
CELLS = {2: (3, 4), 3: (3, 4, 2)}


def box(d):
    return Box.aligned(BOUNDS, extrusion="z" if d == 2 else None)


def lopsided(p):
    """No symmetry between the axes."""
    x, y, z = p.T
    return np.exp(0.4 * np.sin(2 * x + 3 * y) + 0.3 * np.cos(2 * z) * x)


def lopsided_function(d):
    """An f without symmetries, with a stress that varies in space."""
    grid = BackgroundGrid.covering(box(d), 0.2)
    p = grid.positions
    stress = np.stack([np.sin(3 * p[..., 0] + k) * np.cos(k * p[..., 1]) for k in range(12)], -1)
    log_f = np.log(lopsided(p.reshape(-1, 3))).reshape(grid.shape)
    return WarpingFunction.on_grid(grid, log_f, SizeLaw(), stress=0.3 * stress)


def problem_of(d, *, alignment=None, size_weight=10.0, f=None):
    grid = Grid.uniform(box(d), CELLS[d])
    f = f or lopsided_function(d)
    return LeastSquaresProblem.of(
        grid, f, size_weight=size_weight, alignment=alignment or Unaligned()
    )


def bumped(problem, seed=1):
    rng = np.random.default_rng(seed)
    return problem.start + jnp.asarray(rng.uniform(-0.03, 0.03, problem.start.shape))


def compliance(d):
    """Of no symmetry, so that no other way to turn a cell has its energy."""
    A = np.random.default_rng(4).standard_normal((6, 6) if d == 3 else (3, 3))
    return A @ A.T + np.eye(len(A))


def turning(d):
    """All that can turn cells."""
    w = jnp.asarray(7.0)
    return {
        "no shear": NoShear(w),
        "no shear, by energy": NoShear(w, by_energy=True),
        "equal stretch": EqualStretch(w),
        "least energy": LeastEnergy(w, jnp.asarray(compliance(d))),
    }


def turning_energy(name, f, centre, mean):
    """The same written out for one cell, whose mean edges are the columns of `mean`."""
    d = len(mean)
    unit = mean / np.linalg.norm(mean, axis=0)
    if name == "least energy":
        U, _, Vt = np.linalg.svd(mean)
        rotation, C = U @ Vt, compliance(d)
        total = 0.0
        for S in np.asarray(f.stress(centre))[:, 0, :d, :d]:
            A = rotation.T @ S @ rotation
            pull = A[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]] if d == 3 else A[[0, 1, 0], [0, 1, 1]]
            total += 0.5 * 7.0 * pull @ C @ pull
        return total
    stress = f.direction(centre) if name == "no shear" else f.deviator(centre)
    total = 0.0
    for S in np.asarray(stress)[:, 0]:
        A = unit.T @ S @ unit
        pairs = [(i, j) for i in range(d) for j in range(i)]
        if name == "no shear, by energy":
            pairs *= 2  # the stress has both components
        if name == "equal stretch":
            pairs = [(i, i) for i in range(d)]
        total += 0.5 * 7.0 * sum(A[pair] ** 2 for pair in pairs)
    return total


def edge_matrix(x, cell, at):
    """J of one cell at a point with coordinates in 0..1: sums over its edges, written out."""
    d = len(cell)
    J = np.zeros((d, d))
    for axis in range(d):
        for corner in product((0, 1), repeat=d):
            weight = np.prod(
                [
                    t if c else 1 - t
                    for k, (c, t) in enumerate(zip(corner, at, strict=True))
                    if k != axis
                ]
            )
            sign = 1 if corner[axis] else -1
            J[:, axis] += sign * weight * x[tuple(np.array(cell) + corner)]
    return J


@pytest.mark.parametrize("kind", turning(2))
@pytest.mark.parametrize("d", [2, 3])
def test_energies_are_half_the_sums_of_squares_of_the_residuals(d, kind):
    problem = problem_of(d, alignment=turning(d)[kind])
    nodes = bumped(problem)
    x, h = np.moveaxis(np.asarray(nodes), 0, -1), np.asarray(problem.uniform_edge)
    shape = size = turned = 0.0
    for cell in np.ndindex(*CELLS[d]):
        corners = [x[tuple(np.array(cell) + c)] for c in product((0, 1), repeat=d)]
        centre = np.mean(corners, axis=0)[None]
        s = float(problem.f.size(centre)[0])
        T = [edge_matrix(x, cell, at) / h / s for at in product((0, 1), repeat=d)]
        shape += 0.5 * np.mean([np.sum((t - np.linalg.inv(t).T) ** 2) for t in T])
        # Bezier coefficients by interpolation: det J at 3^d points against the Bernstein basis.
        bernstein = np.array([[1, 0, 0], [0.25, 0.5, 0.25], [0, 0, 1]])
        det = np.array(
            [np.linalg.det(edge_matrix(x, cell, at) / h) for at in product((0, 0.5, 1), repeat=d)]
        ).reshape([3] * d)
        for axis in range(d):
            det = np.moveaxis(np.tensordot(np.linalg.inv(bernstein), det, (1, axis)), 0, axis)
        B = det / s**d
        size += 0.5 * 10.0 * np.sum((np.sqrt(B) - 1 / np.sqrt(B)) ** 2)
        mean = edge_matrix(x, cell, [0.5] * d) / h
        turned += turning_energy(kind, problem.f, centre, mean)
    moved = np.moveaxis(np.asarray(nodes - problem.start), 0, -1) / h
    rest = 0.5 * TIKHONOV * np.sum(moved**2)
    found = problem.energies(nodes)
    # Sums over a few hundred terms: rounding only.
    np.testing.assert_allclose(found.shape, shape, rtol=1e-11)
    np.testing.assert_allclose(found.size, size, rtol=1e-11)
    np.testing.assert_allclose(found.alignment, turned, rtol=1e-11)
    np.testing.assert_allclose(found.rest, rest, rtol=1e-11)
    assert found.surface == 0
    np.testing.assert_allclose(found.total, shape + size + turned + rest, rtol=1e-11)


@pytest.mark.parametrize("d", [2, 3])
def test_a_rotated_uniform_block_has_no_shape_and_no_size_energy(d):
    even = WarpingFunction.from_formula(
        lambda p: np.ones(len(p)), box(d), spacing_mm=0.2, law=SizeLaw()
    )
    problem = problem_of(d, f=even)
    R = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    R = R if d == 3 else np.array([[0.6, -0.8], [0.8, 0.6]])
    turned = jnp.tensordot(jnp.asarray(R), problem.start, axes=1)
    found = problem.energies(turned)
    np.testing.assert_allclose([found.shape, found.size], 0, atol=1e-12)


def test_an_inverted_cell_is_refused_with_an_infinite_objective():
    problem = problem_of(3)
    assert np.isfinite(problem.energies(problem.start).total)
    folded = problem.start.at[0, 1, 1, 1].set(1.2)
    assert np.isposinf(problem.energies(folded).total)


def test_blocks_of_cells_add_up_to_the_whole(monkeypatch):
    """However the cells are divided: objective and gradient are the same."""
    problem = problem_of(3, alignment=NoShear(jnp.asarray(7.0)))
    nodes = bumped(problem)
    found = []
    for cells in (1, 8, 10_000):
        monkeypatch.setattr("texmap_opt.warp.least_squares_problem.BLOCK_CELLS", cells)
        found.append(jax.value_and_grad(lambda x: problem.energies(x).total)(nodes))
    for value, gradient in found[:-1]:
        np.testing.assert_allclose(value, found[-1][0], rtol=1e-13)
        np.testing.assert_allclose(gradient, found[-1][1], rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("kind", turning(2))
@pytest.mark.parametrize("d", [2, 3])
def test_gradient_of_the_objective_has_a_second_order_taylor_remainder(d, kind):
    """With respect to the nodes, through s and S at the moving centres as well."""
    problem = problem_of(d, alignment=turning(d)[kind])
    x = bumped(problem, seed=2)
    v = jnp.asarray(np.random.default_rng(3).standard_normal(problem.start.shape))
    objective = jax.jit(lambda x: problem.energies(x).total)
    slope = float(jnp.sum(jax.grad(objective)(x) * v))
    value = objective(x)
    steps = 1e-3 * 0.5 ** np.arange(5)
    remainder = [abs(float(objective(x + t * v) - value) - t * slope) for t in steps]
    orders = np.log2(np.array(remainder[:-1]) / np.array(remainder[1:]))
    np.testing.assert_allclose(orders, 2, atol=0.1)


def test_derivative_by_the_weights_is_that_of_the_energies():
    """The objective is told its derivative by the nodes; the other parameters take the usual way."""
    nodes = bumped(problem_of(2))

    def objective(w):
        alignment = NoShear(w[1])
        return problem_of(2, alignment=alignment, size_weight=w[0]).energies(nodes).total

    w = jnp.asarray([10.0, 7.0])
    parts = problem_of(2, alignment=NoShear(w[1])).energies(nodes)
    expected = [parts.size / 10.0, parts.alignment / 7.0]
    np.testing.assert_allclose(jax.grad(objective)(w), expected, rtol=1e-12)
