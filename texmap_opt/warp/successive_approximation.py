"""The warp of the paper: every node moves to the weighted mean of its neighbours."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from texmap_opt.errors import WarpError
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.warp import AbstractWarp, WarpResult, require_layers
from texmap_opt.warping_function.size_law import limited
from texmap_opt.warping_function.warping_function import WarpingFunction

METHOD = "successive-approximation"

# Where f is taken.
WEIGHTS = ("printed", "midpoint")


class SuccessiveApproximation(AbstractWarp):
    """Equation 4.2 of Chen, "3D Texture Mapping for Rapid Manufacturing" (2007).

    As printed: v_i <- sum_j f(v_j) v_j / sum_j f(v_j) over the grid neighbours j of node i, f at
    the neighbouring vertices where they are now. A node on a face of the box moves by the same
    formula, over the neighbours it has, and is put back on the face, so it slides; corners and the
    nodes of fixed faces stay. All nodes move at once (Jacobi: the paper speaks of successive
    approximation and gives no order), until none moves by more than eps.

    In one dimension the size follows f^-2 with the printed weights. With f at the midpoints of the
    edges instead, f(m_ij), frozen in each sweep, it follows f^-1, which is what the paper's text
    promises. The exponent of the size law has no say in either.

    Faithful, with the paper's weaknesses: cells may fold in three dimensions, rough f can set off a
    swinging that never ends, and the number of sweeps grows with the square of the number of cells
    along an edge. So does what is left of the way to the end when a sweep moves no node by more
    than eps: up to about 2 d (n/pi)^2 eps. See docs/theory/warp.md.

    Attributes:
        weights: one of `WEIGHTS`.
        relaxation: part of each movement that is made, above 0 to 1. 1 is the paper's iteration;
            less has the same fixed points and calms the swinging.
        eps: largest movement of a node at which to stop, relative to the edges of a uniform cell;
            of the whole movement, also where only a part of it is made.
        max_sweeps: when to give up.
    """

    weights: str = eqx.field(static=True, default="printed")
    relaxation: float = 1.0
    eps: float = 1e-6
    max_sweeps: int = 20_000

    def __check_init__(self) -> None:
        if self.weights not in WEIGHTS:
            raise WarpError(
                f'The weights of the warp "{METHOD}" are "{self.weights}", but must be '
                '"printed", f at the neighbouring nodes, or "midpoint", f half way to them.'
            )
        if not 0 < self.relaxation <= 1:
            raise WarpError(
                f'The relaxation of the warp "{METHOD}" is {self.relaxation:g}, but must be above '
                "0 and at most 1: 1 is the paper's iteration, 0.5 calms one that swings."
            )
        if not self.eps > 0 or self.max_sweeps < 1:
            raise WarpError(
                f'The warp "{METHOD}" was asked to stop at a movement of {self.eps:g} or after '
                f"{self.max_sweeps} sweeps: the first must be positive, the second at least 1."
            )

    def fit(self, grid: Grid, f: WarpingFunction) -> WarpResult:
        """Sweeps from the uniform grid until the nodes rest.

        Raises:
            WarpError: if the grid has only one cell along an axis.
        """
        require_layers(grid, METHOD)
        start = grid.at_rest
        nodes, movement, sweeps = _sweep_until_rest(
            f,
            jnp.asarray(np.moveaxis(start.nodes, -1, 0)),
            jnp.asarray(start.free),
            jnp.asarray(start.uniform_edge),
            self,
        )
        moved = float(movement)
        converged = moved < self.eps
        message = ""
        if not converged:
            message = (
                f"{METHOD} stopped after {int(sweeps)} sweeps with a node still moving by "
                f"{moved:.1e} of a cell (limit {self.eps:.0e}): allow more sweeps, lower the "
                'contrast or the relaxation, or use the method "least-squares".'
            )
        return WarpResult(
            start.with_nodes(np.moveaxis(np.asarray(nodes), 0, -1)),
            METHOD,
            int(sweeps),
            converged,
            message,
            {"movement": moved},
        )


@eqx.filter_jit
def _sweep_until_rest(
    f: WarpingFunction,
    start: Float[Array, " d *nodes"],
    free: Bool[Array, " d *nodes"],
    uniform_edge: Float[Array, " d"],
    method: SuccessiveApproximation,
) -> tuple[Float[Array, " d *nodes"], Float[Array, ""], Int[Array, ""]]:
    """Nodes at rest, the last sweep's largest movement relative to a cell, number of sweeps."""
    mean = {"printed": mean_by_vertices, "midpoint": mean_by_midpoints}[method.weights]
    per_edge = 1.0 / uniform_edge.reshape(-1, *[1] * (start.ndim - 1))

    def moving(state):
        _, movement, sweeps = state
        return (movement >= method.eps) & (sweeps < method.max_sweeps)

    def sweep(state):
        nodes, _, sweeps = state
        step = jnp.where(free, mean(f, nodes) - nodes, 0.0)
        movement = jnp.max(jnp.abs(step) * per_edge)
        return nodes + method.relaxation * step, movement, sweeps + 1

    return jax.lax.while_loop(moving, sweep, (start, jnp.asarray(jnp.inf), jnp.asarray(0)))


def mean_by_vertices(
    f: WarpingFunction, nodes: Float[Array, " d *nodes"]
) -> Float[Array, " d *nodes"]:
    """Right-hand side of equation 4.2 as printed for every node.

    Args:
        f: the warping function.
        nodes: coordinates, component first [mm].
    """
    weight = f_at(f, nodes)[None]
    # Sum of f(v_j) v_j and of f(v_j) over the up to 2 d neighbours, in one array.
    pulls = jnp.concatenate([weight * nodes, weight])
    total = jnp.zeros_like(pulls)
    for axis in range(1, nodes.ndim):
        lower, upper = _ends(pulls, axis)
        total = total + _to_upper(lower, axis) + _to_lower(upper, axis)
    return total[:-1] / total[-1:]


def mean_by_midpoints(
    f: WarpingFunction, nodes: Float[Array, " d *nodes"]
) -> Float[Array, " d *nodes"]:
    """The same with f at the midpoint of the edge to each neighbour.

    Args:
        f: the warping function.
        nodes: coordinates, component first [mm].
    """
    total = jnp.zeros((nodes.shape[0] + 1, *nodes.shape[1:]))
    for axis in range(1, nodes.ndim):
        lower, upper = _ends(nodes, axis)
        weight = f_at(f, (lower + upper) / 2)[None]
        to_upper = jnp.concatenate([weight * lower, weight])
        to_lower = jnp.concatenate([weight * upper, weight])
        total = total + _to_upper(to_upper, axis) + _to_lower(to_lower, axis)
    return total[:-1] / total[-1:]


def f_at(f: WarpingFunction, points: Float[Array, " d *nodes"]) -> Float[Array, "*nodes"]:
    """What `WarpingFunction.f` gives, fast at a great many points, but not to be differentiated.

    Args:
        f: the warping function.
        points: coordinates, component first [mm].
    """
    log_f = f.log_f.first_channel(points.reshape(len(points), -1).T)
    return jnp.exp(limited(log_f - f.centre, f.limit)).reshape(points.shape[1:])


def _ends(
    values: Float[Array, "..."], axis: int
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Values at the lower and at the upper node of every edge along an axis of the array."""
    lower = jax.lax.slice_in_dim(values, 0, -1, axis=axis)
    return lower, jax.lax.slice_in_dim(values, 1, None, axis=axis)


def _to_lower(values: Float[Array, "..."], axis: int) -> Float[Array, "..."]:
    """Values of edges along an axis at the lower node of each; zero where no edge begins."""
    return jnp.pad(values, [(0, int(k == axis)) for k in range(values.ndim)])


def _to_upper(values: Float[Array, "..."], axis: int) -> Float[Array, "..."]:
    """Values of edges along an axis at the upper node of each; zero where no edge ends."""
    return jnp.pad(values, [(int(k == axis), 0) for k in range(values.ndim)])
