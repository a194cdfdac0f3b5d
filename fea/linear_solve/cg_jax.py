"""Conjugate gradients in JAX, unchanged on CPU and GPU, for stiffness that need not be assembled.

The preconditioner is the inverse of the nodes' diagonal blocks (block Jacobi).
"""

from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse import bsr_array

from fea.linear_solve.conjugate_gradients import ROUNDS
from fea.linear_solve.element_operator import ElementOperator, Matrix
from fea.linear_solve.interface import AbstractMethod
from fea.linear_solve.mkl_sparse import diagonal_blocks
from fea.linear_solve.solve_result import Applied, SolveFailure, SolveResult
from fea.precision import require_x64

# Iterations grow with the number of nodes along the longest path through the part; a solid of
# 210k dofs takes 500, slender lattices take ten times as many.
MAX_ITERATIONS = 20_000


class State(NamedTuple):
    """What one iteration hands to the next."""

    x: Float[Array, "n block"]
    r: Float[Array, "n block"]
    p: Float[Array, "n block"]
    rz: Float[Array, ""]
    iterations: Int[Array, ""]
    broken: Bool[Array, ""]


class JaxCG(AbstractMethod):
    """Block-Jacobi conjugate gradients; compiled once for each size and kind of operator."""

    direct: ClassVar[bool] = False
    probed: ClassVar[bool] = False

    _operator: ElementOperator
    _inverse: Float[Array, "n block block"]

    def update(self, K: Matrix) -> None:
        """Invert the diagonal blocks."""
        require_x64()
        self._operator = K if isinstance(K, ElementOperator) else assembled_operator(K)
        self._inverse, definite = _inverted(self._operator.diagonal)
        if not bool(definite):
            raise SolveFailure(SolveResult.SINGULAR)

    def apply(
        self,
        rhs: Float[np.ndarray, "dofs columns"],
        x0: Float[np.ndarray, "dofs columns"] | None,
        rtol: float,
    ) -> Applied:
        """Conjugate gradients, column by column."""
        shape = self._operator.diagonal.shape[:2]
        x, most, cut_off = np.zeros_like(rhs), 0, False
        for column in range(rhs.shape[1]):
            b = jnp.asarray(rhs[:, column].reshape(shape))
            start = jnp.zeros_like(b) if x0 is None else jnp.asarray(x0[:, column].reshape(shape))
            state, target = _solve(
                self._operator,
                self._inverse,
                b,
                start,
                jnp.asarray(rtol),
                jnp.asarray(MAX_ITERATIONS),
            )
            if bool(state.broken):
                raise SolveFailure(SolveResult.SINGULAR, np.asarray(state.p).reshape(-1))
            x[:, column] = np.asarray(state.x).reshape(-1)
            most = max(most, int(state.iterations))
            spent = int(state.iterations) == MAX_ITERATIONS
            cut_off = cut_off or (spent and not bool(jnp.linalg.norm(state.r) <= target))
        return Applied(x, most, cut_off)

    def free(self) -> None:
        """Drop the operator and its blocks."""
        del self._operator, self._inverse


def assembled_operator(K: bsr_array) -> ElementOperator:
    """Products with an assembled matrix, block by block."""
    row = np.repeat(np.arange(len(K.indptr) - 1), np.diff(K.indptr))
    parts = jnp.asarray(K.data), jnp.asarray(row), jnp.asarray(K.indices)
    return ElementOperator(
        jax.tree_util.Partial(_block_product, *parts), jnp.asarray(diagonal_blocks(K))
    )


def _block_product(
    blocks: Float[Array, "blocks k k"],
    row: Int[Array, " blocks"],
    column: Int[Array, " blocks"],
    x: Float[Array, "n k"],
) -> Float[Array, "n k"]:
    terms = jnp.einsum("bij,bj->bi", blocks, x[column])
    return jax.ops.segment_sum(terms, row, len(x), indices_are_sorted=True)


@jax.jit
def _inverted(
    blocks: Float[Array, "n block block"],
) -> tuple[Float[Array, "n block block"], Bool[Array, ""]]:
    """Inverses of the blocks, and whether all are positive definite."""
    L = jnp.linalg.cholesky(blocks)
    half = jax.scipy.linalg.solve_triangular(
        L, jnp.broadcast_to(jnp.eye(blocks.shape[1]), blocks.shape), lower=True
    )
    return jnp.einsum("nki,nkj->nij", half, half), jnp.isfinite(half).all()


@eqx.filter_jit
def _solve(
    operator: ElementOperator,
    inverse: Float[Array, "n block block"],
    b: Float[Array, "n block"],
    x0: Float[Array, "n block"],
    rtol: Float[Array, ""],
    limit: Int[Array, ""],
) -> tuple[State, Float[Array, ""]]:
    """Iterate until the true residual is small enough; the last state, and what it should be."""
    K = operator.matvec
    target = jnp.maximum(rtol, jnp.finfo(b.dtype).eps) * jnp.linalg.norm(b)
    Kx = K(x0)
    energy = jnp.vdot(x0, Kx)
    # The multiple of x0 with the least energy of the error.
    scale = jnp.where(energy > 0, jnp.vdot(x0, b) / jnp.where(energy > 0, energy, 1.0), 0.0)

    def unfinished(state: State) -> Bool[Array, ""]:
        return (jnp.linalg.norm(state.r) > target) & (state.iterations < limit) & ~state.broken

    def iteration(state: State) -> State:
        z = jnp.einsum("nij,nj->ni", inverse, state.r)
        rz = jnp.vdot(state.r, z)
        p = z + (rz / state.rz) * state.p
        Kp = K(p)
        energy = jnp.vdot(p, Kp)
        # A direction without stiffness ends the iteration before it is divided by.
        broken = ~(energy > 0)
        step = jnp.where(broken, 0.0, rz / jnp.where(broken, 1.0, energy))
        x, r = state.x + step * p, state.r - step * Kp
        return State(x, r, p, rz, state.iterations + 1, broken)

    def one_round(_: Int[Array, ""], state: State) -> State:
        # The direction that broke the iteration is kept: it is the answer then.
        direction = jnp.where(state.broken, state.p, 0.0)
        fresh = state._replace(p=direction, rz=jnp.ones_like(state.rz))
        state = jax.lax.while_loop(unfinished, iteration, fresh)
        return state._replace(r=b - K(state.x))

    start = State(
        x=scale * x0,
        r=b - scale * Kx,
        p=jnp.zeros_like(b),
        rz=jnp.ones((), b.dtype),
        iterations=jnp.zeros((), int),
        broken=jnp.zeros((), bool),
    )
    return jax.lax.fori_loop(0, ROUNDS, one_round, start), target
