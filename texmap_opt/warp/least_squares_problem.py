"""The objective of the least-squares warp: shape, size, barrier and alignment, cell by cell."""

import math
from collections.abc import Callable
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
# in the processor's cache, and the memory does not grow with the grid. On 32³ cells twice or eight times
# as many take 1.2 and 1.7 times as long; numbers of cells without divisors are no slower.
BLOCK_CELLS = 512


class Energies(eqx.Module):
    """Half the sums of squares of the residuals; docs/theory/warp.md derives each.

    Attributes:
        total: the objective, their sum.
        shape: of T - T^-T, mean over the corners.
        size: of sqrt(w) (B^1/2 - B^-1/2), over the Bezier coefficients.
        alignment: of what turns the cells.
        rest: of sqrt(TIKHONOV) times the displacement in uniform cells.
        surface: of what makes nodes follow the part's surface.
    """

    total: Float[Array, ""]
    shape: Float[Array, ""]
    size: Float[Array, ""]
    alignment: Float[Array, ""]
    rest: Float[Array, ""]
    surface: Float[Array, ""]


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

    def energies(self, nodes: Float[Array, " d *nodes"]) -> Energies:
        """The parts of the objective; infinite where a cell is not certified free of folds.

        The derivative of `total` is that of the whole; the parts by themselves have none.
        """
        total, parts = _total_and_parts(self, nodes)
        return Energies(total, *parts)

    def _parts(self, nodes: Float[Array, " d *nodes"]) -> Float[Array, " 5"]:
        """Shape, size, alignment, rest and surface, summed over the cells block by block."""

        @jax.checkpoint
        def add(total, block):
            return total + self._of_cells(block), None

        blocks = nodes[(slice(None), *_blocks(nodes))]
        sums, _ = jax.lax.scan(add, jnp.zeros(3), blocks.swapaxes(0, 1))
        return jnp.concat([sums, self._of_nodes(nodes)])

    def _of_nodes(self, nodes: Float[Array, " d *nodes"]) -> Float[Array, " 2"]:
        """The parts that belong to nodes: rest and surface."""
        edge = self.uniform_edge.reshape(-1, *[1] * (nodes.ndim - 1))
        rest = 0.5 * TIKHONOV * jnp.sum(((nodes - self.start) / edge) ** 2)
        surface = jnp.zeros(()) if self.surface is None else self.surface.energy(nodes)
        return jnp.stack([rest, surface])

    def _parts_with_gradient(
        self, nodes: Float[Array, " d *nodes"]
    ) -> tuple[Float[Array, " 5"], Float[Array, " d *nodes"]]:
        """Parts and the gradient of their sum, both of one block after the other.

        No block is visited twice.
        """
        blocks = (slice(None), *_blocks(nodes))

        @jax.checkpoint
        def add(total, block):
            slope, parts = jax.grad(_summed(self._of_cells), has_aux=True)(block)
            return total + parts, slope

        sums, slopes = jax.lax.scan(add, jnp.zeros(3), nodes[blocks].swapaxes(0, 1))
        gradient, of_nodes = jax.grad(_summed(self._of_nodes), has_aux=True)(nodes)
        return jnp.concat([sums, of_nodes]), gradient.at[blocks].add(slopes.swapaxes(0, 1))

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


def _blocks(
    nodes: Float[Array, " d *nodes"],
) -> tuple[Int[np.ndarray, "blocks _ 1"], Int[np.ndarray, "blocks 1 _"]]:
    """Which nodes each block of cells needs, along the first two axes; neighbours share a layer."""
    n, m, *rest = (k - 1 for k in nodes.shape[1:])
    rows = _thickness(m, BLOCK_CELLS // math.prod(rest))
    layers = _thickness(n, BLOCK_CELLS // (rows * math.prod(rest)))
    first = np.arange(0, n, layers)[:, None] + np.arange(layers + 1)
    second = np.arange(0, m, rows)[:, None] + np.arange(rows + 1)
    first, second = np.repeat(first, len(second), axis=0), np.tile(second, (len(first), 1))
    return first[:, :, None], second[:, None, :]


def _thickness(cells: int, most: int) -> int:
    """The largest divisor of a number of cells that is at most `most`, and at least 1."""
    return max(k for k in range(1, cells + 1) if cells % k == 0 and k <= max(1, most))


def _summed(
    parts: Callable[[Array], Array],
) -> Callable[[Array], tuple[Float[Array, ""], Array]]:
    """The sum of what a function returns, and what it returns."""

    def total(nodes: Array) -> tuple[Float[Array, ""], Array]:
        values = parts(nodes)
        return jnp.sum(values), values

    return total


@eqx.filter_custom_jvp
def _total_and_parts(
    problem: LeastSquaresProblem, nodes: Float[Array, " d *nodes"]
) -> tuple[Float[Array, ""], Float[Array, " 5"]]:
    parts = problem._parts(nodes)
    return jnp.sum(parts), parts


@_total_and_parts.def_jvp
def _total_and_parts_jvp(primals, tangents):
    problem, nodes = primals
    by_problem, by_nodes = tangents
    parts, gradient = problem._parts_with_gradient(nodes)
    change = jnp.zeros(()) if by_nodes is None else jnp.sum(gradient * by_nodes)
    if jax.tree_util.tree_leaves(by_problem):
        held = jax.tree_util.tree_map(lambda x: x is None, by_problem, is_leaf=lambda x: x is None)
        fixed, moved = eqx.partition(problem, held)
        _, by = jax.jvp(
            lambda moved: jnp.sum(eqx.combine(moved, fixed)._parts(nodes)), (moved,), (by_problem,)
        )
        change = change + by
    return (jnp.sum(parts), parts), (change, jnp.zeros_like(parts))
