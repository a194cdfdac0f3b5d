"""Our warp: nonlinear least squares for shape and size that never leaves the fold-free set."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from texmap_opt.warp.certificate import (
    bezier_coefficients,
    cross,
    determinants,
    edge_matrices,
)
from texmap_opt.warp.hex_grid import HexGrid
from texmap_opt.warp.modes import SlidingModes
from texmap_opt.warp.warp import AbstractWarp, WarpResult
from texmap_opt.warping_function.warping_function import WarpingFunction

# The shape residual is the mean over the corners of a cell (the quadrature of the energy), the size
# residual the sum over its 27 coefficients; weights in the literature of this project assume this.
CORNERS = 8

# Weight of the displacement itself: makes the Hessian definite; moving a node by a whole cell costs
# as much as a strain of 1e-3 in one cell.
TIKHONOV = 1e-6

# Steps L-BFGS remembers; each costs the memory of two grids.
HISTORY = 10

# Converged means: what another step could gain is below this part of the objective.
LEAST_GAIN = 1e-2

# Objective of a grid that is perfect up to rounding.
ROUNDING = 1e-20


class Residuals(eqx.Module):
    """The residuals of all cells; the objective is half the sum of their squares.

    Attributes:
        shape: T - T^-T at the eight corners: component, column, corner (2 2 2), cell.
        size: sqrt(w) (B^1/2 - B^-1/2) of the 27 Bezier coefficients.
        identity: sqrt(TIKHONOV) times the displacement in uniform cells.
        unfolded: whether all B are positive; the residuals mean nothing otherwise.
    """

    shape: Float[Array, "3 3 2 2 2 *cells"]
    size: Float[Array, "3 3 3 *cells"]
    identity: Float[Array, " 3 *nodes"]
    unfolded: Bool[Array, ""]

    def objective(self) -> Float[Array, ""]:
        """Half the sum of squares; infinite where a cell is not certified free of folds."""
        parts = (self.shape, self.size, self.identity)
        total = sum((jnp.sum(part**2) for part in parts), jnp.asarray(0.0))
        return jnp.where(self.unfolded, 0.5 * total, jnp.inf)


class LeastSquaresProblem(eqx.Module):
    """The objective of `LeastSquares` as a function of the nodes.

    Attributes:
        f: the warping function.
        start: nodes of the uniform grid, component first [mm].
        uniform_edge: edges of a uniform cell [mm].
        size_weight: w.
    """

    f: WarpingFunction
    start: Float[Array, " 3 *nodes"]
    uniform_edge: Float[Array, " 3"]
    size_weight: Float[Array, ""]

    @classmethod
    def of(cls, grid: HexGrid, f: WarpingFunction, size_weight: float) -> "LeastSquaresProblem":
        """The problem of a box and its number of cells."""
        start = jnp.moveaxis(jnp.asarray(HexGrid.uniform(grid.box, grid.cells).nodes), -1, 0)
        return cls(f, start, jnp.asarray(grid.uniform_edge), jnp.asarray(float(size_weight)))

    def residuals(self, nodes: Float[Array, " 3 *nodes"]) -> Residuals:
        """All residuals at nodes given component first [mm].

        With J the edge matrix, s the wanted size at the centre of the cell where it is now, and
        T = J / s (Design and derivation: docs/theory/warp.md).
        """
        columns = edge_matrices(nodes, self.uniform_edge)
        s = self._wanted_size(nodes)
        B = bezier_coefficients(determinants(columns)) / s[None, None, None] ** 3
        unfolded = jnp.all(B > 0)
        # A trial that folds is refused as a whole; 1 keeps its roots real until then.
        B = jnp.where(B > 0, B, 1.0)
        size = jnp.sqrt(self.size_weight) * (jnp.sqrt(B) - 1.0 / jnp.sqrt(B))
        # The corners are the points 0 and 1 of 0, 1/2, 1 along each axis.
        corners = [c[:, ::2, ::2, ::2] / s[None, None, None, None] for c in columns]
        det = B[::2, ::2, ::2][None]
        shape = jnp.sqrt(1.0 / CORNERS) * jnp.stack(
            [
                corners[k] - cross(corners[(k + 1) % 3], corners[(k + 2) % 3]) / det
                for k in range(3)
            ],
            axis=1,
        )
        moved = (nodes - self.start) / self.uniform_edge[:, None, None, None]
        return Residuals(shape, size, jnp.sqrt(TIKHONOV) * moved, unfolded)

    def objective(self, nodes: Float[Array, " 3 *nodes"]) -> Float[Array, ""]:
        """Half the sum of squares of all residuals."""
        return self.residuals(nodes).objective()

    def _wanted_size(self, nodes: Float[Array, " 3 *nodes"]) -> Float[Array, "*cells"]:
        centres = nodes
        for axis in (1, 2, 3):
            low = jax.lax.slice_in_dim(centres, 0, -1, axis=axis)
            centres = (low + jax.lax.slice_in_dim(centres, 1, None, axis=axis)) / 2
        return self.f.size(centres.reshape(3, -1).T).reshape(centres.shape[1:])


class LeastSquares(AbstractWarp):
    """Cells as close as possible to rotated cubes of the wanted size, and none folded.

    Minimises the residuals of `LeastSquaresProblem` by L-BFGS in the variables of `SlidingModes`,
    starting from the uniform grid. A trial grid with a Bezier coefficient of det J that is not
    positive has an infinite objective, so the line search turns back: every accepted grid is
    certified.

    Attributes:
        size_weight: w, weight of the size (and barrier) residual against shape. At contrast 3 on
            12³ cells the log-log slope of achieved against wanted size is 0.91 with 1 and 0.98 with
            10; cells become longer for it.
        max_steps: when to give up.
        rtol: relative change of the objective and of the variables at which to stop.
    """

    size_weight: float = 10.0
    max_steps: int = 1000
    rtol: float = 1e-3

    def fit(self, grid: HexGrid, f: WarpingFunction) -> WarpResult:
        """Minimises from the uniform grid over the box of `grid`."""
        problem = LeastSquaresProblem.of(grid, f, self.size_weight)
        modes = SlidingModes.of(grid, _stiffness_at_identity(self.size_weight))
        minimum = _minimise(problem, modes, self.rtol, self.max_steps)
        steps, gain = int(minimum.steps), float(minimum.gain)
        converged = bool(minimum.stopped) and gain < LEAST_GAIN
        message = ""
        if not converged:
            message = (
                f"least-squares stopped after {steps} steps although another could lower the "
                f"objective by {gain:.1e} of its value (limit {LEAST_GAIN:.0e}); the grid has no "
                "folds but not the best: lower the contrast, smooth f more, or allow more steps."
            )
        result = HexGrid(np.asarray(jnp.moveaxis(minimum.nodes, 0, -1)), grid.box)
        return WarpResult(result, "least-squares", steps, converged, message)


class _Minimum(eqx.Module):
    """Where L-BFGS ended.

    Attributes:
        nodes: of the grid, component first [mm].
        steps: number of trial grids.
        stopped: whether it stopped by itself.
        gain: estimated relative decrease of the objective by another step.
    """

    nodes: Float[Array, " 3 *nodes"]
    steps: Int[Array, ""]
    stopped: Bool[Array, ""]
    gain: Float[Array, ""]


@eqx.filter_jit
def _minimise(
    problem: LeastSquaresProblem, modes: SlidingModes, rtol: float, max_steps: int
) -> _Minimum:
    """L-BFGS from the uniform grid."""

    def objective(z, args):
        problem, modes = args
        return problem.objective(problem.start + modes.displacement(z))

    args = (problem, modes)
    start = modes.at_rest()
    solution = optx.minimise(
        objective,
        optx.LBFGS(rtol=rtol, atol=rtol, norm=optx.rms_norm, history_length=HISTORY),
        start,
        args=args,
        max_steps=max_steps,
        throw=False,
    )
    # The Hessian in z is about the identity, so a Newton step would gain about half the squared
    # gradient.
    gain = 0.5 * optx.two_norm(solution.state.f_info.grad) ** 2
    nodes = problem.start + modes.displacement(solution.value)
    return _Minimum(
        nodes=nodes,
        steps=solution.stats["num_steps"],
        stopped=solution.result == optx.RESULTS.successful,
        gain=gain / (solution.state.f_info.f + ROUNDING),
    )


def _stiffness_at_identity(size_weight: float) -> float:
    """Second derivative of the objective by a strain of one mode, shared among the 3 directions.

    Around T = I + E the eight shape residuals are E + E^T and the 27 size residuals sqrt(w) tr E.
    """
    return 2 + 27 * size_weight / 3
