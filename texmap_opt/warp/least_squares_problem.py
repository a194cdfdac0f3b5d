"""The objective of the least-squares warp: shape, size, barrier and alignment, cell by cell."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from texmap_opt.warp.alignment import AbstractAlignment
from texmap_opt.warp.certificate import bezier_coefficients, cofactors, determinants, edge_matrices
from texmap_opt.warp.conforming import Conforming
from texmap_opt.warp.grid import Grid
from texmap_opt.warping_function.warping_function import WarpingFunction

# Weight of the displacement itself: makes the Hessian definite; moving a node by a whole cell costs
# as much as a strain of 1e-3 in one cell.
TIKHONOV = 1e-6

# Cells that are evaluated together. One block's intermediate values (some 300 numbers a cell) stay
# in the processor's cache, and the memory does not grow with the grid.
BLOCK_CELLS = 4096


class Energies(eqx.Module):
    """Half the sums of squares of the residuals; docs/theory/warp.md derives each.

    Attributes:
        shape: of T - T^-T, mean over the corners.
        size: of sqrt(w) (B^1/2 - B^-1/2), over the Bezier coefficients.
        alignment: of what turns the cells.
        rest: of sqrt(TIKHONOV) times the displacement in uniform cells.
        surface: of what makes nodes follow the part's surface.
    """

    shape: Float[Array, ""]
    size: Float[Array, ""]
    alignment: Float[Array, ""]
    rest: Float[Array, ""]
    surface: Float[Array, ""]

    @property
    def total(self) -> Float[Array, ""]:
        """The objective."""
        return self.shape + self.size + self.alignment + self.rest + self.surface


class LeastSquaresProblem(eqx.Module):
    """The objective of `LeastSquares` as a function of the nodes.

    Attributes:
        f: the warping function.
        start: nodes of the uniform grid, component first [mm].
        uniform_edge: edges of a uniform cell [mm].
        size_weight: w.
        alignment: what turns the cells, with its weight.
        surface: which nodes are to follow the part's surface; None: none.
    """

    f: WarpingFunction
    start: Float[Array, " d *nodes"]
    uniform_edge: Float[Array, " d"]
    size_weight: Float[Array, ""]
    alignment: AbstractAlignment
    surface: Conforming | None = None

    @classmethod
    def of(
        cls,
        grid: Grid,
        f: WarpingFunction,
        *,
        size_weight: float | Float[Array, ""],
        alignment: AbstractAlignment,
        surface: Conforming | None = None,
    ) -> "LeastSquaresProblem":
        """The problem of a box and its number of cells."""
        return cls(
            f,
            jnp.moveaxis(jnp.asarray(grid.at_rest.nodes), -1, 0),
            jnp.asarray(grid.uniform_edge),
            jnp.asarray(size_weight, dtype=jnp.float64),
            alignment,
            surface,
        )

    def objective(self, nodes: Float[Array, " d *nodes"]) -> Float[Array, ""]:
        """Half the sum of squares; infinite where a cell is not certified free of folds."""
        return _objective(self, nodes)

    def energies(self, nodes: Float[Array, " d *nodes"]) -> Energies:
        """The parts of the objective, summed over the cells block by block."""

        @jax.checkpoint
        def add(total, block):
            return total + self._of_cells(block), None

        sums, _ = jax.lax.scan(add, jnp.zeros(3), nodes[:, _layers(nodes)].swapaxes(0, 1))
        return Energies(sums[0], sums[1], sums[2], *self._of_nodes(nodes))

    def _of_nodes(
        self, nodes: Float[Array, " d *nodes"]
    ) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """The parts that belong to nodes: rest and surface."""
        edge = self.uniform_edge.reshape(-1, *[1] * (nodes.ndim - 1))
        rest = 0.5 * TIKHONOV * jnp.sum(((nodes - self.start) / edge) ** 2)
        return rest, jnp.zeros(()) if self.surface is None else self.surface.energy(nodes)

    def _with_gradient(
        self, nodes: Float[Array, " d *nodes"]
    ) -> tuple[Float[Array, ""], Float[Array, " d *nodes"]]:
        """Objective and gradient, both of one block after the other: no block is visited twice."""
        layers = _layers(nodes)

        @jax.checkpoint
        def add(total, block):
            value, slope = jax.value_and_grad(lambda b: jnp.sum(self._of_cells(b)))(block)
            return total + value, slope

        total, slopes = jax.lax.scan(add, jnp.asarray(0.0), nodes[:, layers].swapaxes(0, 1))
        of_nodes, gradient = jax.value_and_grad(lambda x: sum(self._of_nodes(x)))(nodes)
        return total + of_nodes, gradient.at[:, layers].add(slopes.swapaxes(0, 1))

    def _of_cells(self, nodes: Float[Array, " d *nodes"]) -> Float[Array, " 3"]:
        """Shape, size and alignment of the cells of one block; infinite where one may fold."""
        d = len(nodes)
        columns = edge_matrices(nodes, self.uniform_edge)
        centres = _centres(nodes)
        points = centres.reshape(d, -1).T
        s = self.f.size(points).reshape(centres.shape[1:])
        B = bezier_coefficients(determinants(columns), d) / s[(None,) * d] ** d
        unfolded = jnp.all(B > 0)
        # A trial that folds is refused as a whole; 1 keeps the derivatives finite until then.
        B = jnp.where(B > 0, B, 1.0)
        size = 0.5 * self.size_weight * jnp.sum(B + 1.0 / B - 2.0)
        # The corners are the points 0 and 1 of 0, 1/2, 1 along each axis.
        corners = (slice(None), *[slice(None, None, 2)] * d)
        T = tuple(column[corners] / s[(None,) * (d + 1)] for column in columns)
        # |T|² and |T^-1|² = |cof T|² / det² at every corner; a column broadcasts along its own axis.
        stretch = sum(jnp.sum(t**2, axis=0) for t in T)
        inverse = sum(jnp.sum(t**2, axis=0) for t in cofactors(T)) / B[corners[1:]] ** 2
        shape = 0.5 * jnp.sum(jnp.asarray(stretch + inverse) - 2.0 * d) / 2**d
        turned = self.alignment.energy(_mean_edges(columns), self.f, points)
        return jnp.where(unfolded, jnp.stack([shape, size, turned]), jnp.inf)


def _mean_edges(columns: tuple[Any, ...]) -> Float[Array, "samples d d"]:
    """Mean of the edges of each cell along each axis, as rows: the columns of J at its centre."""
    d = len(columns)
    middle = [
        column[(slice(None), *[n // 2 for n in column.shape[1 : 1 + d]])] for column in columns
    ]
    return jnp.moveaxis(jnp.stack(middle).reshape(d, d, -1), -1, 0)


def _centres(nodes: Float[Array, " d *nodes"]) -> Float[Array, " d *cells"]:
    """Mean of the corners of each cell."""
    for axis in range(1, nodes.ndim):
        low = jax.lax.slice_in_dim(nodes, 0, -1, axis=axis)
        nodes = (low + jax.lax.slice_in_dim(nodes, 1, None, axis=axis)) / 2
    return nodes


def _layers(nodes: Float[Array, " d *nodes"]) -> Int[np.ndarray, "blocks _"]:
    """Which layers of nodes along the first axis each block of cells needs; neighbours share one."""
    n, *rest = (k - 1 for k in nodes.shape[1:])
    most = max(1, BLOCK_CELLS // math.prod(rest))
    thick = max(k for k in range(1, n + 1) if n % k == 0 and k <= most)
    return np.arange(0, n, thick)[:, None] + np.arange(thick + 1)


@eqx.filter_custom_jvp
def _objective(problem: LeastSquaresProblem, nodes: Float[Array, " d *nodes"]) -> Float[Array, ""]:
    return problem.energies(nodes).total


@_objective.def_jvp
def _objective_jvp(primals, tangents):
    problem, nodes = primals
    by_problem, by_nodes = tangents
    total, gradient = problem._with_gradient(nodes)
    change = jnp.zeros(()) if by_nodes is None else jnp.sum(gradient * by_nodes)
    if jax.tree_util.tree_leaves(by_problem):
        varied = jax.tree_util.tree_map(
            lambda x: x is None, by_problem, is_leaf=lambda x: x is None
        )
        fixed, moved = eqx.partition(problem, varied)
        _, by = jax.jvp(
            lambda moved: eqx.combine(moved, fixed).energies(nodes).total, (moved,), (by_problem,)
        )
        change = change + by
    return total, change
