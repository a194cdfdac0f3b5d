"""One measurement of `benchmarks/warp.py`, alone in its process: prints a line of JSON."""

import argparse
import json
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.ndimage import map_coordinates
from scipy.optimize import OptimizeResult, minimize
from stopwatch import Stopwatch, peak_memory_gb

from texmap_opt.box import Box
from texmap_opt.errors import WarpError
from texmap_opt.warp.alignment import NoShear, Unaligned
from texmap_opt.warp.certificate import folded, grid_coefficients
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.inverse_map import grid_coordinates, positions_at
from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warp.least_squares_problem import LeastSquaresProblem
from texmap_opt.warp.quality import quality
from texmap_opt.warp.successive_approximation import WEIGHTS, SuccessiveApproximation
from texmap_opt.warp.warp import WarpResult
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.stress_driver import StressSamples, stress_driver
from texmap_opt.warping_function.warping_function import WarpingFunction

UNIT_CUBE = Box.aligned(np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))
LAW = SizeLaw(contrast=3.0)

# Points per axis at which the stress is handed over, as an analysis on a mesh of its own would.
SAMPLES = 30

# For derivatives: so wide that the window of the limit does not hang on single values of f, a kink.
WIDE_LAW = SizeLaw(contrast=9.0)

# Gain at which the search hands over to Newton's method, for derivatives.
GTOL_OF_GRADIENT = 1e-6

ALIGNMENT_WEIGHT = 10.0

# Evaluations after which the peer gives up.
MOST_EVALUATIONS = 2000

# Sweeps in one measurement: enough that what is done once per fit does not count; and repeats of it.
SWEEPS, SWEEP_REPEATS = 20, 5

POINTS = 100_000

# Step of the central difference that checks the derivative: on 8³ cells the relative difference falls
# with its square, from 6e-3 at 1e-3 to 6e-7 here; rounding of the nodes is 1e-10 or so.
DIFFERENCE_STEP = 1e-5


def fit(subject: str, cells: int) -> dict[str, Any]:
    """Warping function and least squares from cold, compilation included."""
    clock, before = Stopwatch(), peak_memory_gb()
    f, result = _fitted(clock, subject, cells)
    row = _row(clock, before, result.grid)
    measured = quality(result.grid, f)
    names = ("size_slope", "size_correlation", "min_jacobian", "folded_cells", "max_aspect")
    row |= {name: getattr(measured, name) for name in names}
    if f.cases:
        row |= {"turn_uniform_deg": measured.turn_uniform_deg, "turn_deg": measured.turn_deg}
    return row | _end(result)


def peer(subject: str, cells: int) -> dict[str, Any]:
    """The same, then the same objective by SciPy's L-BFGS-B on the nodes as they are.

    From the uniform grid until the objective is as low as ours. The variables are the free
    components of the nodes, in edges of a uniform cell. SciPy takes no infinite value: where a cell
    may fold it is told twice the objective of the uniform grid, and no slope; the interpolation of its
    line search then turns back to a smaller, but not a tiny, step.
    """
    clock, before = Stopwatch(), peak_memory_gb()
    f, result = _fitted(clock, subject, cells)
    grid, target = result.grid.at_rest, result.measures["objective"]
    with clock.stage("peer"):
        found = _minimised(_problem(grid, f, _warp(f)), grid, target)
    with clock.stage("fit, compiled"):
        _warp(f).fit(grid, f)
    with clock.stage("peer, compiled"):
        _minimised(_problem(grid, f, _warp(f)), grid, target)
    return _row(clock, before, grid) | _end(result) | {
        "peer_objective": float(found.fun),
        "peer_evaluations": int(found.nfev),
        "peer_steps": int(found.nit),
        "peer_reached": bool(found.fun <= target),
    }  # fmt: skip


def certificate(_: str, cells: int) -> dict[str, Any]:
    """Bezier coefficients of every cell, and which cells fold, from cold."""
    grid = _waved(cells)
    clock, before = Stopwatch(), peak_memory_gb()
    with clock.stage("coefficients"):
        coefficients = grid_coefficients(grid)
    with clock.stage("folded"):
        bad = folded(coefficients)
    return _row(clock, before, grid) | {
        "cells_certified": grid.cell_count,
        "folded_cells": int(bad.sum()),
        "smallest_coefficient": float(coefficients.min()),
    }


def sweeps(subject: str, cells: int) -> dict[str, Any]:
    """Successive approximation, compiled before, and the same sweeps by NumPy and SciPy."""
    grid, f = Grid.uniform(UNIT_CUBE, (cells,) * 3), _function(subject, cells)
    clock, before = Stopwatch(), peak_memory_gb()
    least: dict[str, list[float]] = {}
    difference = 0.0
    for weights in WEIGHTS:
        warp = SuccessiveApproximation(weights=weights, eps=1e-12, max_sweeps=SWEEPS)
        warp.fit(grid, f)
        for _ in range(SWEEP_REPEATS):
            with clock.stage(weights):
                ours = warp.fit(grid, f)
            with clock.stage(f"{weights}, NumPy"):
                nodes = _swept(f, grid, weights)
            for stage, spent in clock.seconds.items():
                least[stage] = list(map(min, least.get(stage, spent), spent))
            clock.clear()
            difference = max(difference, float(np.abs(ours.grid.nodes - nodes).max() * cells))
    clock.seconds = least
    return _row(clock, before, grid) | {"sweeps": SWEEPS, "difference": difference}


def inverse(_: str, cells: int) -> dict[str, Any]:
    """Coordinates in the grid of points in space, against those they were made of."""
    grid = _waved(cells)
    xi = np.random.default_rng(0).uniform(0.0, cells, (POINTS, 3))
    # Between nodes the map is linear along each axis, and so is SciPy's interpolation.
    place = np.stack([map_coordinates(grid.nodes[..., c], xi.T, order=1) for c in range(3)], axis=1)
    clock, before = Stopwatch(), peak_memory_gb()
    with clock.stage("inverse"):
        found = grid_coordinates(grid, grid.box.positions(place))
    row = _row(clock, before, grid)
    back = positions_at(grid, found.xi[found.found]) - place[found.found]
    return row | {
        "points": POINTS,
        "not_found": int((~found.found).sum()),
        "error_cells": float(np.abs(found.xi - xi)[found.found].max()),
        "error_mm": float(np.abs(back).max()),
        "smallest_coefficient": float(grid_coefficients(grid).min()),
    }


def gradient(_: str, cells: int) -> dict[str, Any]:
    """Derivative by all values of log f, through the minimiser, of a number made of the nodes; the fit."""
    grid, background = (
        Grid.uniform(UNIT_CUBE, (cells,) * 3),
        BackgroundGrid.covering(UNIT_CUBE, 1 / cells),
    )
    warp = LeastSquares(gtol=GTOL_OF_GRADIENT)
    rng = np.random.default_rng(0)
    weights = jnp.asarray(rng.standard_normal(grid.nodes.shape))
    wished, direction = (
        jnp.asarray(_log_lopsided(background)),
        rng.standard_normal(background.shape),
    )

    def number(log_f: Float[Array, "*controls"]) -> Float[Array, ""]:
        f = WarpingFunction.on_grid(background, log_f, WIDE_LAW)
        return jnp.sum(weights * warp.nodes(grid, f))

    clock, before = Stopwatch(), peak_memory_gb()
    for cold in ("", ", compiled"):
        with clock.stage(f"fit{cold}"):
            result = warp.fit(grid, WarpingFunction.on_grid(background, wished, WIDE_LAW))
        with clock.stage(f"gradient{cold}"):
            slopes = np.asarray(jax.grad(number)(wished))
    row = _row(clock, before, grid)
    h = DIFFERENCE_STEP
    ahead, behind = (float(number(wished + side * h * direction)) for side in (1, -1))
    along = float(np.sum(slopes * direction))
    difference = abs(along / ((ahead - behind) / (2 * h)) - 1)
    return row | _end(result) | {"parameters": wished.size, "difference": difference}


def _function(subject: str, cells: int) -> WarpingFunction:
    """What is to be followed; background grid and smoothing of one cell."""
    if subject == "ball":
        return WarpingFunction.from_formula(_ball, UNIT_CUBE, spacing_mm=1 / cells, law=LAW)
    background = BackgroundGrid.covering(UNIT_CUBE, 1 / cells)
    field = stress_driver(_bending(), background, smoothing_mm=1 / cells)
    return field.function(background, LAW)


def _ball(points: Float[np.ndarray, "samples 3"]) -> Float[np.ndarray, " samples"]:
    """F = 3^exp(-(r / 0.25)²) about the middle of the cube."""
    return 3.0 ** np.exp(-np.sum(((points - 0.5) / 0.25) ** 2, axis=1))


def _log_lopsided(background: BackgroundGrid) -> Float[np.ndarray, "*controls"]:
    """Values of log f without symmetry.

    The search for the ball's grid ends near a symmetric saddle, from which Newton's method need not
    reach a minimum.
    """
    x, y, z = np.moveaxis(background.positions, -1, 0)
    return 0.4 * np.sin(2 * x + 3 * y) + 0.3 * x * np.cos(2 * z)


def _bending() -> StressSamples:
    """Sxx = 12 (1 - x) (y - 1/2), txy = -3/4 (1 - 4 (y - 1/2)²): a beam under a tip load."""
    middles = (np.arange(SAMPLES) + 0.5) / SAMPLES
    points = np.stack(np.meshgrid(*[middles] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    x, y, _ = points.T
    stress = np.zeros((1, len(points), 6))
    stress[0, :, 0] = 12 * (1 - x) * (y - 0.5)
    stress[0, :, 5] = -0.75 * (1 - 4 * (y - 0.5) ** 2)
    return StressSamples(points, np.full(len(points), 1 / len(points)), stress)


def _waved(cells: int) -> Grid:
    """A grid of the cube moved by a formula, without folds, each face onto itself."""
    grid = Grid.uniform(UNIT_CUBE, (cells,) * 3)
    moved = grid.nodes.copy()
    for c in range(3):
        wave = np.sin(np.pi * grid.nodes[..., c])
        for other in (k for k in range(3) if k != c):
            wave = wave * np.cos(2 * np.pi * grid.nodes[..., other])
        moved[..., c] += 0.1 * wave
    return grid.with_nodes(moved)


def _warp(f: WarpingFunction) -> LeastSquares:
    """Least squares with its defaults, aligned where a stress is known."""
    return LeastSquares(
        alignment=NoShear(jnp.asarray(ALIGNMENT_WEIGHT)) if f.cases else Unaligned()
    )


def _fitted(clock: Stopwatch, subject: str, cells: int) -> tuple[WarpingFunction, WarpResult]:
    with clock.stage("f"):
        f = jax.block_until_ready(_function(subject, cells))
    with clock.stage("fit"):
        result = _warp(f).fit(Grid.uniform(UNIT_CUBE, (cells,) * 3), f)
    return f, result


def _problem(grid: Grid, f: WarpingFunction, warp: LeastSquares) -> LeastSquaresProblem:
    return LeastSquaresProblem.of(grid, f, size_weight=warp.size_weight, alignment=warp.alignment)


@eqx.filter_jit
def _objective(
    nodes: Float[Array, " d *nodes"], problem: LeastSquaresProblem
) -> tuple[Float[Array, ""], Float[Array, " d *nodes"]]:
    return jax.value_and_grad(lambda nodes, problem: problem.energies(nodes).total)(nodes, problem)


def _minimised(problem: LeastSquaresProblem, grid: Grid, target: float) -> OptimizeResult:
    """SciPy's end: the objective is no larger than `target`, or it gave up."""
    free, start = grid.free, np.asarray(problem.start)
    edge = np.broadcast_to(grid.uniform_edge[:, None, None, None], start.shape)[free]
    refused = 2 * float(_objective(problem.start, problem)[0])

    def value_and_slope(z: np.ndarray) -> tuple[float, np.ndarray]:
        nodes = start.copy()
        nodes[free] += z * edge
        value, slope = _objective(jnp.asarray(nodes), problem)
        if not np.isfinite(value):
            return refused, np.zeros_like(z)
        return float(value), np.asarray(slope)[free] * edge

    def stop_there(intermediate_result: OptimizeResult) -> None:
        if intermediate_result.fun <= target:
            raise StopIteration

    options = {"maxfun": MOST_EVALUATIONS, "maxiter": MOST_EVALUATIONS, "ftol": 0.0, "gtol": 0.0}
    return minimize(
        value_and_slope, np.zeros(len(edge)), method="L-BFGS-B", jac=True, callback=stop_there,
        options=options,
    )  # fmt: skip


def _swept(f: WarpingFunction, grid: Grid, weights: str) -> Float[np.ndarray, "*nodes d"]:
    """Nodes after some sweeps of equation 4.2, all nodes at once, by NumPy and SciPy."""
    values = _limited_spline(f)
    nodes = np.ascontiguousarray(np.moveaxis(grid.nodes, -1, 0))
    for _ in range(SWEEPS):
        total = np.zeros((4, *nodes.shape[1:]))
        pulls = _weighted(values(nodes), nodes) if weights == "printed" else None
        for axis in (1, 2, 3):
            lower, upper = _ends(axis)
            if pulls is not None:
                total[upper] += pulls[lower]
                total[lower] += pulls[upper]
            else:
                weight = values((nodes[lower] + nodes[upper]) / 2)
                total[upper] += _weighted(weight, nodes[lower])
                total[lower] += _weighted(weight, nodes[upper])
        step = total[:3]
        step /= total[3]
        step -= nodes
        for axis in range(3):
            step[(axis, *[slice(None)] * axis, slice(None, None, grid.cells[axis]))] = 0.0
        # The stopping rule of the method: it costs a sweep its share too.
        if max(step.max(), -step.min()) < 1e-12:
            break
        nodes += step
    return np.moveaxis(nodes, 0, -1)


def _limited_spline(f: WarpingFunction) -> Callable[[np.ndarray], np.ndarray]:
    """F at points, component first, by SciPy's cubic splines."""
    coefficients = np.asarray(f.log_f.coefficients)[..., 0]
    origin, spacing = (
        np.asarray(v)[:, None, None, None] for v in (f.log_f.origin, f.log_f.spacing)
    )
    centre, limit = float(f.centre), float(f.limit)

    def values(points: np.ndarray) -> np.ndarray:
        at = (points - origin) / spacing
        v = map_coordinates(coefficients, at, order=3, prefilter=False, mode="nearest")
        v -= centre
        # v (1 + (v / L)^8)^(-1/8) by squares and roots, far faster than powers.
        u = v / limit
        for _ in range(3):
            u *= u
        u += 1.0
        for _ in range(3):
            np.sqrt(u, out=u)
        v /= u
        return np.exp(v, out=v)

    return values


def _weighted(weight: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    return np.concatenate([weight * nodes, weight[None]])


def _ends(axis: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Where the lower and the upper nodes of the edges along an axis of an array are."""
    all_of = (slice(None),) * axis
    return (*all_of, slice(None, -1)), (*all_of, slice(1, None))


def _end(result: WarpResult) -> dict[str, Any]:
    return {
        "steps": result.iterations,
        "converged": result.converged,
        "objective": result.measures["objective"],
        "gain": result.measures["gain"],
        "tolerance": result.measures["tolerance"],
    }


def _row(clock: Stopwatch, before: float, grid: Grid) -> dict[str, Any]:
    """What every measurement tells; to be asked before anything else needs memory."""
    return {
        "unknowns": int(grid.free.sum()),
        "stages": clock.rows(),
        "peak_memory_gb": peak_memory_gb(),
        "memory_before_gb": before,
    }


RUNS = {
    "fit": fit,
    "peer": peer,
    "certificate": certificate,
    "sweeps": sweeps,
    "inverse": inverse,
    "gradient": gradient,
}
SUBJECTS = ("ball", "bending", "lopsided", "waves")


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", choices=list(RUNS))
    parser.add_argument("subject", choices=SUBJECTS)
    parser.add_argument("cells", type=int, help="along each edge of the cube")
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    # Cold means that nothing compiled by an earlier process is found.
    jax.config.update("jax_enable_compilation_cache", False)
    try:
        row = RUNS[asked.run](asked.subject, asked.cells)
    except WarpError as failure:
        row = {"failure": str(failure)}
    about = {"run": asked.run, "subject": asked.subject, "cells": asked.cells}
    print(json.dumps(about | row))


if __name__ == "__main__":
    main()
