"""The warp of the paper: every node moves to the weighted mean of its neighbours."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from texmap_opt.warp.hex_grid import HexGrid
from texmap_opt.warp.warp import AbstractWarp, WarpResult
from texmap_opt.warping_function.warping_function import WarpingFunction


class SuccessiveApproximation(AbstractWarp):
    """Equation 4.2 of Chen, "3D Texture Mapping for Rapid Manufacturing" (2007), as printed.

    v_i <- sum_j f(v_j) v_j / sum_j f(v_j) over the grid neighbours j of node i, f at the
    neighbouring vertices where they are now. A node on a face of the box moves by the same formula
    and is put back on the face, so it slides; corners stay. All nodes move at once (Jacobi: the
    paper speaks of successive approximation and gives no order), until none moves by more than eps.

    Faithful, with the paper's weaknesses: in one dimension the size follows f^-2, whatever exponent
    the size law has; cells may fold in three dimensions; and the number of sweeps grows with the
    square of the number of cells along an edge. See docs/theory/warp.md.

    Attributes:
        relaxation: part of each movement that is made. 1 is the paper's iteration; less has the
            same fixed points and calms the swinging that rough f can set off.
        eps: largest movement of a node at which to stop, relative to the edges of a uniform cell.
        max_sweeps: when to give up.
    """

    relaxation: float = 1.0
    eps: float = 1e-6
    max_sweeps: int = 20_000

    def fit(self, grid: HexGrid, f: WarpingFunction) -> WarpResult:
        """Sweeps from the uniform grid until the nodes rest."""
        start = HexGrid.uniform(grid.box, grid.cells)
        nodes, movement, sweeps = _sweep_until_rest(
            f,
            jnp.asarray(start.nodes),
            jnp.asarray(start.uniform_edge),
            jnp.asarray(float(self.relaxation)),
            jnp.asarray(self.eps),
            jnp.asarray(self.max_sweeps),
        )
        converged = bool(movement < self.eps)
        message = ""
        if not converged:
            message = (
                f"successive-approximation stopped after {int(sweeps)} sweeps with a node still "
                f"moving by {float(movement):.1e} of a cell (limit {self.eps:.0e}): lower the "
                'contrast, take fewer cells, or use the method "least-squares".'
            )
        result = start.with_nodes(np.asarray(nodes))
        return WarpResult(result, "successive-approximation", int(sweeps), converged, message)


@eqx.filter_jit
def _sweep_until_rest(
    f: WarpingFunction,
    start: Float[Array, "*nodes 3"],
    uniform_edge: Float[Array, " 3"],
    relaxation: Float[Array, ""],
    eps: Float[Array, ""],
    max_sweeps: Int[Array, ""],
) -> tuple[Float[Array, "*nodes 3"], Float[Array, ""], Int[Array, ""]]:
    held = jnp.asarray(_held_by_faces(start.shape))

    def moving(state):
        _, movement, sweeps = state
        return (movement >= eps) & (sweeps < max_sweeps)

    def sweep(state):
        nodes, _, sweeps = state
        step = jnp.where(held, 0.0, _weighted_mean_of_neighbours(f, nodes) - nodes)
        movement = jnp.max(jnp.abs(step) / uniform_edge[None, None, None])
        return nodes + relaxation * step, movement, sweeps + 1

    return jax.lax.while_loop(moving, sweep, (start, jnp.asarray(jnp.inf), jnp.asarray(0)))


def _weighted_mean_of_neighbours(
    f: WarpingFunction, nodes: Float[Array, "*nodes 3"]
) -> Float[Array, "*nodes 3"]:
    """Right-hand side of equation 4.2 for every node; neighbours beyond a face do not count."""
    weight = f.f(nodes.reshape(-1, 3)).reshape(*nodes.shape[:3], 1)
    # Sum of f(v_j) v_j and of f(v_j) over the up to six neighbours, in one array.
    padded = jnp.pad(jnp.concatenate([weight * nodes, weight], axis=-1), [(1, 1)] * 3 + [(0, 0)])
    total = jnp.zeros((*nodes.shape[:3], 4))
    for axis in range(3):
        for start in (0, 2):
            window = [start if d == axis else 1 for d in range(3)]
            total = total + jax.lax.dynamic_slice(padded, [*window, 0], total.shape)
    return total[..., :3] / total[..., 3:]


def _held_by_faces(shape: tuple[int, ...]) -> Bool[np.ndarray, "*nodes 3"]:
    """Which components of which nodes are fixed: the normal one on each face of the box."""
    held = np.zeros(shape, dtype=bool)
    for axis in range(3):
        ends = np.moveaxis(held[..., axis], axis, 0)
        ends[[0, -1]] = True
    return held
