"""Our warp: nonlinear least squares for shape, size and direction that never leaves the fold-free set."""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from texmap_opt.errors import WarpError
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.warp.alignment import AbstractAlignment, Unaligned
from texmap_opt.warp.conforming import Conforming
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.least_squares_problem import Energies, LeastSquaresProblem
from texmap_opt.warp.levels import coarser, prolonged
from texmap_opt.warp.modes import SlidingModes
from texmap_opt.warp.variables import Variables
from texmap_opt.warp.warp import AbstractWarp, WarpResult, require_layers
from texmap_opt.warping_function.concrete import is_concrete
from texmap_opt.warping_function.warping_function import WarpingFunction

# Steps L-BFGS remembers; each costs the memory of two grids. Rough fields need a third more steps
# with 10, a tenth less with 100.
HISTORY = 30

# Where f is symmetric the uniform grid lies among symmetric grids, which the search would never leave
# although the best of them may be a saddle; and cells that lie just the wrong way have no gradient to
# turn. So the search starts this far off, in variables of which 1 strains cells by about 1. Under
# torsion 0.1 is too little for cells to turn 45 degrees; 0.3 costs a few steps.
OFF_SYMMETRY = 0.3

# Grids on the way to the finest are solved to this gain only.
GAIN_ON_THE_WAY = 1e-3

# The contrast is raised by at most this factor at a time, so that every start is near its end.
CONTRAST_STEP = math.sqrt(3.0)

# Decrease of the objective, per component of a node, below which a grid is perfect: rounding of the
# residuals, whose squares of order one cancel.
ROUNDING = 1e-14

# Newton's method on the gradient, for the derivative of the minimiser: it ends where a step moves
# the variables (about 1 each where a cell is strained by 1) by less than this.
POLISHED = 1e-10


class LeastSquares(AbstractWarp):
    """Cells as close as possible to turned cubes of the wanted size, and none folded.

    Minimises `LeastSquaresProblem` by L-BFGS in the variables of `Variables`, from coarse grids to
    the one asked for. The coarsest starts at the uniform grid and raises the contrast in steps. A
    trial grid with a Bezier coefficient of det J that is not positive has an infinite objective, so
    the line search turns back: every accepted grid is certified.

    Attributes:
        size_weight: w, weight of the size (and barrier) residual against shape. At contrast 3 on
            12³ cells the log-log slope of achieved against wanted size is 0.91 with 1 and 0.98 with
            10; cells become longer for it.
        alignment: what turns the cells, with its weight.
        surface: a part whose surface nodes near it are to follow; None: they need not.
        surface_weight: of the residual that makes them.
        gtol: gain of another step, half the squared norm of the gradient in the variables over the
            objective, at which to stop.
        max_steps: trial grids of any one size after which to give up.

    Raises:
        WarpError: a weight of the size, tolerance or number of steps that is not positive.
    """

    size_weight: float | Float[Array, ""] = 10.0
    alignment: AbstractAlignment = Unaligned()
    surface: TriMesh | None = None
    surface_weight: float | Float[Array, ""] = 10.0
    gtol: float = 1e-4
    max_steps: int = 1000

    def __check_init__(self) -> None:
        if is_concrete(self.size_weight) and not 0 < float(self.size_weight) < math.inf:
            raise WarpError(
                f"The weight of the cells' size is {float(self.size_weight):g}, but must be a "
                "positive number: it also keeps cells from folding; give one such as 10."
            )
        if not 0 < self.gtol < math.inf:
            raise WarpError(
                f"The least-squares warp's tolerance is {self.gtol:g}, but must be a positive number: "
                "rounding lets no gain reach 0; give one such as 1e-4."
            )
        if self.max_steps < 1:
            raise WarpError(
                f"The least-squares warp may take {self.max_steps} steps, but needs at least 1: give a "
                'number such as 1000, or use the method "uniform".'
            )

    def fit(self, grid: Grid, f: WarpingFunction) -> WarpResult:
        """Minimises from the uniform grid over the box of `grid`.

        Raises:
            WarpError: if there is only one cell along an axis.
        """
        end, problem = self._minimum(grid, f)
        parts = {f"objective_{part}": float(value) for part, value in vars(end.energies).items()}
        measures = {
            "gradient_norm": end.gradient_norm,
            "gain": end.gain,
            "tolerance": self.gtol,
            "objective": parts.pop("objective_total"),
            **parts,
        }
        moved = end.moved(grid)
        if self.surface is not None and problem.surface is not None:
            measures |= vars(problem.surface.measure(moved, self.surface))
        converged = end.gain < self.gtol
        message = ""
        if not converged:
            message = (
                f"least-squares stopped after {end.steps} step{'s' * (end.steps > 1)} although another "
                f"could lower the objective by {end.gain:.1e} of its value (limit {self.gtol:.0e}); the "
                "grid has no folds but is not the best: lower the contrast, smooth f more, or allow "
                "more steps."
            )
        return WarpResult(moved, "least-squares", end.steps, converged, message, measures)

    def nodes(self, grid: Grid, f: WarpingFunction) -> Float[Array, "*nodes d"]:
        """The minimising nodes [mm], which JAX can differentiate.

        By everything in `f` (the values it was built of, exponent, contrast), by `size_weight`,
        `surface_weight` and the weight of the alignment; which nodes follow the surface is taken as
        given. The derivative is that of the implicit function: one solve with the Hessian by
        conjugate gradients, however many steps the search took.

        The search runs on the host: `jax.grad`, `jax.jvp` and `jax.vjp` work, `jax.jit` and
        `jax.vmap` around it do not.

        Raises:
            WarpError: if the minimum is not reached, if there is only one cell along an axis, or
                under `jax.jit`.
        """
        still = jax.tree_util.tree_map(
            lambda x: jax.lax.stop_gradient(x) if eqx.is_array(x) else x, (self, f)
        )
        if not all(is_concrete(leaf) for leaf in jax.tree_util.tree_leaves(still)):
            raise WarpError(
                "The least-squares warp searches on the host and cannot be traced by jax.jit or "
                "jax.vmap: take the derivative of a function that calls it, without either."
            )
        end, problem = still[0]._minimum(grid, still[1])
        variables = still[0]._variables(end.nodes, grid)
        # Built of the values without derivatives, like the search; the weight is to have one.
        surface = problem.surface
        if surface is not None:
            weight = jnp.asarray(self.surface_weight, dtype=jnp.float64)
            surface = eqx.tree_at(lambda conforming: conforming.weight, surface, weight)
        problem = self._problem(grid, f, surface)
        nodes, reached = _polished(problem, variables, end.energies.total)
        if not bool(reached):
            raise WarpError(
                "Newton's method does not reach the minimum of the least-squares warp from a gain "
                f"of {end.gain:.1e}: lower the contrast or smooth f more, or allow more steps."
            )
        return jnp.moveaxis(nodes, 0, -1)

    def _problem(
        self, grid: Grid, f: WarpingFunction, surface: Conforming | None = None
    ) -> LeastSquaresProblem:
        problem = LeastSquaresProblem.of(
            grid, f, size_weight=self.size_weight, alignment=self.alignment, surface=surface
        )
        # What came of Python's numbers has a weak type in JAX, for which all would be compiled again.
        return jax.tree_util.tree_map(
            lambda x: jnp.asarray(x, dtype=x.dtype) if eqx.is_array(x) else x, problem
        )

    def _minimum(self, grid: Grid, f: WarpingFunction) -> tuple["_Minimum", LeastSquaresProblem]:
        """The best certified grid found, and the problem it is the minimum of."""
        require_layers(grid, "least-squares")
        levels = coarser(grid)
        on_the_way = max(self.gtol, GAIN_ON_THE_WAY)
        spread = _log_spread(levels[0], f)
        nodes = self._off_symmetry(levels[0], spread)
        for share in _shares(spread)[:-1]:
            problem = self._problem(levels[0], f.softened(share))
            nodes = self._search(problem, levels[0], nodes, on_the_way).nodes
        for level, finer in pairwise(levels):
            end = self._search(self._problem(level, f), level, nodes, on_the_way)
            nodes = prolonged(end.nodes, finer)
        problem = self._problem(grid, f)
        end = self._search(problem, grid, nodes, self.gtol)
        if self.surface is None:
            return end, problem
        # Which nodes are near the surface shows only now.
        surface = Conforming.of(end.moved(grid), self.surface, self.surface_weight)
        problem = self._problem(grid, f, surface)
        return self._search(problem, grid, end.nodes, self.gtol), problem

    def _off_symmetry(self, grid: Grid, spread: float) -> Float[Array, " d *nodes"]:
        """Nodes next to the uniform grid's; the same ones where there is nothing to gain."""
        start = jnp.asarray(np.moveaxis(grid.nodes, -1, 0))
        off = OFF_SYMMETRY
        if isinstance(self.alignment, Unaligned):
            off *= min(1.0, spread)
        noise = np.random.default_rng(0).standard_normal(start.shape)
        return self._variables(start, grid).at(jnp.asarray(off * noise))

    def _variables(self, nodes: Float[Array, " d *nodes"], grid: Grid) -> Variables:
        modes = SlidingModes.of(
            grid,
            size_weight=float(self.size_weight),
            alignment_weight=float(self.alignment.weight),
        )
        return Variables.about(nodes, grid, modes)

    def _search(
        self,
        problem: LeastSquaresProblem,
        grid: Grid,
        nodes: Float[Array, " d *nodes"],
        gtol: float,
    ) -> "_Minimum":
        """L-BFGS from certified nodes."""
        variables = self._variables(nodes, grid)
        nodes, steps, energies, norm = _descended(
            problem, variables, jnp.asarray(gtol), self.max_steps
        )
        return _Minimum(nodes, int(steps), energies, float(norm))


class _Minimum(eqx.Module):
    """Where a search ended.

    Attributes:
        nodes: of the grid, component first [mm].
        steps: number of trial grids of this size.
        energies: their sum, the objective, and its parts.
        gradient_norm: in the variables about the end.
    """

    nodes: Float[Array, " d *nodes"]
    steps: int
    energies: Energies
    gradient_norm: float

    def moved(self, grid: Grid) -> Grid:
        """The grid with its nodes where the search ended."""
        return grid.with_nodes(np.asarray(jnp.moveaxis(self.nodes, 0, -1)))

    @property
    def gain(self) -> float:
        """Estimated relative decrease of the objective by another step."""
        squared = jnp.asarray(self.gradient_norm**2)
        return float(_gain(squared, self.energies.total, self.nodes.size))


class _LBFGS(optx.AbstractLBFGS):
    """Optimistix's L-BFGS, ended by the gain of another step instead of the last one's size."""

    gtol: Float[Array, ""]
    rtol: float = 0.0
    atol: float = 0.0
    norm: Callable[[Any], Any] = optx.max_norm
    use_inverse: bool = True
    history_length: int = HISTORY
    descent: optx.NewtonDescent = optx.NewtonDescent()
    search: optx.BacktrackingArmijo = optx.BacktrackingArmijo()
    verbose: Callable[..., None] = eqx.field(default=lambda **_: None, static=True)

    def terminate(
        self, fn: Any, y: Any, args: Any, options: Any, state: Any, tags: Any
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        """Whether the gain is below the tolerance; not before anything was evaluated."""
        squared = jnp.sum(state.f_info.grad**2)
        small = _gain(squared, state.f_info.f, y.size) < self.gtol
        return ~state.first_step & small, state.result


def _gain(
    squared_gradient: Float[Array, ""], objective: Float[Array, ""], size: int
) -> Float[Array, ""]:
    """Share of the objective by which another step could lower it; zero where that is rounding.

    The Hessian in the variables is about the identity, so a Newton step gains about half the squared
    gradient.

    Args:
        squared_gradient: in the variables.
        objective: half the sum of squares.
        size: number of variables.
    """
    gained = 0.5 * squared_gradient
    return jnp.where(gained < ROUNDING * size, 0.0, gained / objective)


def _shares(spread: float) -> list[float]:
    """Powers of the wanted size on the way to 1; the contrast grows by `CONTRAST_STEP` at most.

    Args:
        spread: logarithm of the contrast of the whole.
    """
    count = max(1, math.ceil(spread / math.log(CONTRAST_STEP) - 1e-9))
    return [(k + 1) / count for k in range(count)]


def _log_spread(grid: Grid, f: WarpingFunction) -> float:
    """Logarithm of the ratio of the largest to the smallest wanted size."""
    return float(np.ptp(np.log(np.asarray(f.size(grid.centres)))))


@eqx.filter_jit
def _descended(
    problem: LeastSquaresProblem, variables: Variables, gtol: Float[Array, ""], max_steps: int
) -> tuple[Float[Array, " d *nodes"], Int[Array, ""], Energies, Float[Array, ""]]:
    """From the origin: the nodes, the number of steps, the energies and the gradient's norm."""
    solution = optx.minimise(
        _energies_in_variables,
        _LBFGS(gtol=gtol),
        jnp.zeros_like(problem.start),
        args=(problem, variables),
        has_aux=True,
        max_steps=max_steps,
        throw=False,
    )
    # `solution.aux` is that of the step before the last.
    end, norm = solution.state.aux, jnp.sqrt(jnp.sum(solution.state.f_info.grad**2))
    return variables.at(solution.value), solution.stats["num_steps"], end, norm


@eqx.filter_jit
def _polished(
    problem: LeastSquaresProblem, variables: Variables, objective: Float[Array, ""]
) -> tuple[Float[Array, " d *nodes"], Bool[Array, ""]]:
    """The minimum near the origin of the variables by Newton's method, and whether it was reached.

    As a function of the problem it is differentiable (implicitly). `objective` is that of the
    origin; where none of the gradient is left, but the objective is higher, is a saddle or a fold.
    """
    solver = lx.CG(rtol=1e-10, atol=1e-14)
    solution = optx.root_find(
        jax.grad(_objective_in_variables),
        optx.Newton(rtol=0.0, atol=POLISHED, norm=optx.max_norm, linear_solver=solver),
        jnp.zeros_like(problem.start),
        args=(problem, jax.lax.stop_gradient(variables)),
        adjoint=optx.ImplicitAdjoint(linear_solver=solver),
        tags=frozenset({lx.positive_semidefinite_tag}),
        max_steps=30,
        throw=False,
    )
    nodes = variables.at(solution.value)
    still = jax.tree_util.tree_map(jax.lax.stop_gradient, (problem, nodes))
    rounding = ROUNDING * nodes.size
    lower = still[0].energies(still[1]).total <= objective * (1 + ROUNDING) + rounding
    return nodes, (solution.result == optx.RESULTS.successful) & lower


def _energies_in_variables(
    z: Float[Array, " d *nodes"], args: tuple[LeastSquaresProblem, Variables]
) -> tuple[Float[Array, ""], Energies]:
    """The objective, and its parts beside it."""
    problem, variables = args
    energies = problem.energies(variables.at(z))
    return energies.total, energies


def _objective_in_variables(
    z: Float[Array, " d *nodes"], args: tuple[LeastSquaresProblem, Variables]
) -> Float[Array, ""]:
    return _energies_in_variables(z, args)[0]
