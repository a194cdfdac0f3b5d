"""Conjugate gradients preconditioned by smoothed-aggregation multigrid; the only user of pyamg.

Vaněk, Mandel, Brezina, "Algebraic multigrid by smoothed aggregation for second and fourth order
elliptic problems", Computing 56 (1996) 179-196: the coarse spaces reproduce given near-null
vectors, for elasticity the six rigid-body modes.

Displacements and rotations, thick and thin struts differ by many orders; the polynomials that
smooth damp with one number per level. So every level is scaled, K -> S K Sᵀ, such that its diagonal
blocks are identities: 25 instead of 29 iterations with unit diagonal only on a solid, 237 instead of
398 on a frame of slender struts.

The cycle itself runs in single precision, half the memory to hold and to move. It only improves
residuals that conjugate gradients compute in double precision: octet and slender bcc blocks, bars and
bricks take the same iterations to 1e-8, and where double precision itself ends (residuals of 1e-7:
plates 2000 times as long as thick) 170 instead of 153.
"""

import math
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from scipy.sparse import bsr_array, csr_array

from fea.linear_solve.conjugate_gradients import conjugate_gradients
from fea.linear_solve.interface import AbstractMethod
from fea.linear_solve.mkl_sparse import (
    ThreadedMatrix,
    diagonal_blocks,
    in_blocks,
    merged_blocks,
    multiply,
    single,
)
from fea.linear_solve.solve_result import Applied, SolveFailure, SolveResult
from fea.linear_solve.v_cycle import Level, VCycle, largest_eigenvalue

# Nodes of the coarsest level; its six unknowns each are solved densely.
COARSEST = 50

# Damping of the step of Jacobi's iteration that smooths the prolongation, over the largest
# eigenvalue (Vaněk et al., section 4).
PROLONGATION_DAMPING = 4 / 3

# Stiffness of an aggregate below this share of the largest is rounding: a field that its few nodes
# cannot hold, such as the rotation of a single one.
NOTHING = 1e-12

# Blocks that are scaled at a time: their copies stay in the cache.
BLOCKS_AT_ONCE = 4096

# Lattices with slender struts need a few hundred (bcc 16x16x16, radius 0.01 of the cell: 237).
MAX_ITERATIONS = 1500

# A hierarchy kept for new values is rebuilt once it needs this many times the iterations it
# needed when it was new: a build costs about as much as twenty-five iterations.
REBUILD_FACTOR = 2.0


class MultigridCG(AbstractMethod):
    """Hierarchy and iteration for one matrix, or for a sequence on one pattern."""

    direct: ClassVar[bool] = False
    probed: ClassVar[bool] = True

    _matrix: ThreadedMatrix
    _preconditioner: "Multigrid"

    def __init__(self, near_null: Float[np.ndarray, "dofs modes"]):
        self._near_null = near_null
        self._built = self._stale = False
        self._iterations_when_new: int | None = None

    def update(self, K: bsr_array) -> None:
        """Build the hierarchy; later keep it, and rebuild it in `apply` when it no longer pays."""
        self._matrix = ThreadedMatrix(K)
        if self._built:
            self._stale = True
        else:
            self._rebuild()

    def apply(
        self,
        rhs: Float[np.ndarray, "dofs columns"],
        x0: Float[np.ndarray, "dofs columns"] | None,
        rtol: float,
    ) -> Applied:
        """Conjugate gradients, column by column."""
        x, most, cut_off = np.zeros_like(rhs), 0, False
        for column in range(rhs.shape[1]):
            b = np.ascontiguousarray(rhs[:, column])
            start = None if x0 is None else np.ascontiguousarray(x0[:, column])
            x[:, column], count, ended = self._solve(b, start, rtol)
            most, cut_off = max(most, count), cut_off or ended
        return Applied(x, most, cut_off)

    def free(self) -> None:
        """Drop the hierarchy."""
        del self._matrix, self._preconditioner

    def _solve(
        self, b: Float[np.ndarray, " dofs"], x0: Float[np.ndarray, " dofs"] | None, rtol: float
    ) -> tuple[Float[np.ndarray, " dofs"], int, bool]:
        count, new = 0, self._iterations_when_new
        if self._stale and new is not None:
            x0, count, cut_off = self._iterate(b, x0, rtol, int(REBUILD_FACTOR * new))
            if not cut_off:
                return x0, count, False
        if self._stale:
            self._rebuild()
        x, more, cut_off = self._iterate(b, x0, rtol, MAX_ITERATIONS)
        if self._iterations_when_new is None and x0 is None and more:
            self._iterations_when_new = more
        return x, count + more, cut_off

    def _iterate(
        self,
        b: Float[np.ndarray, " dofs"],
        x0: Float[np.ndarray, " dofs"] | None,
        rtol: float,
        limit: int,
    ) -> tuple[Float[np.ndarray, " dofs"], int, bool]:
        return conjugate_gradients(
            self._matrix.times, self._preconditioner, b, x0, rtol=rtol, limit=limit
        )

    def _rebuild(self) -> None:
        if self._built:
            del self._preconditioner  # so that old and new are not in memory together
        self._preconditioner = Multigrid(self._matrix.matrix, self._near_null)
        self._built, self._stale, self._iterations_when_new = True, False, None


class Multigrid:
    """K⁻¹, approximately: z = Sᵀ V(S r) with a V-cycle for S K Sᵀ."""

    def __init__(self, K: bsr_array, near_null: Float[np.ndarray, "dofs modes"]):
        S, back = _cholesky_scaling(diagonal_blocks(K))
        self._scale = ThreadedMatrix(single(_block_diagonal(S)))
        self._scale_transposed = ThreadedMatrix(single(_block_diagonal(S.transpose(0, 2, 1))))
        scaled, fields = _congruent(S, K), _block_diagonal(back) @ near_null
        del S, back  # what follows needs most memory
        self._cycle = _v_cycle(scaled, fields)

    def __call__(self, r: Float[np.ndarray, " dofs"]) -> Float[np.ndarray, " dofs"]:
        """One preconditioning."""
        # Residuals of any unit fit into single precision once their size is taken out.
        size = max(-float(r.min()), float(r.max()))
        if size == 0:
            return np.zeros_like(r)
        z = self._scale.times((r / size).astype(np.float32))
        z = self._scale_transposed.times(self._cycle(z)).astype(np.float64)
        z *= size
        return z


def _v_cycle(K: bsr_array, near_null: Float[np.ndarray, "dofs modes"]) -> VCycle:
    """Coarsen until the rest can be solved densely.

    Args:
        K: its diagonal blocks are identities.
        near_null: fields of almost no energy.
    """
    levels = []
    while len(K.indptr) > COARSEST + 1:
        level, K, near_null = _coarsened(K, near_null)
        levels.append(level)
    dense = K.toarray()
    # Directions that an aggregate of few nodes cannot hold are zero rows, and stay zero.
    nothing = np.flatnonzero(dense.diagonal() == 0)
    dense[nothing, nothing] = 1.0
    try:
        inverse = np.linalg.inv(dense)
    except np.linalg.LinAlgError as error:
        raise SolveFailure(SolveResult.SINGULAR) from error
    return VCycle(tuple(levels), ((inverse + inverse.T) / 2).astype(np.float32))


def _coarsened(
    K: bsr_array, near_null: Float[np.ndarray, "dofs modes"]
) -> tuple[Level, bsr_array, Float[np.ndarray, "coarse modes"]]:
    """A level, and matrix and fields of the next coarser one."""
    largest = largest_eigenvalue(ThreadedMatrix(K))
    T, coarse_null = _tentative_prolongation(K, near_null)
    modes = near_null.shape[1]
    size = math.gcd(K.blocksize[0], modes)
    small = in_blocks(K, size)
    P = _smoothed_prolongation(small, T, PROLONGATION_DAMPING / largest)
    R = _transposed(P)
    coarse = merged_blocks(multiply(R, multiply(small, P, ordered=False)), modes)
    S, back = _eigen_scaling(diagonal_blocks(coarse))
    R = multiply(in_blocks(_block_diagonal(S), size), R, ordered=False)
    P = multiply(P, in_blocks(_block_diagonal(S.transpose(0, 2, 1)), size), ordered=False)
    A, P, R = (ThreadedMatrix(single(one)) for one in (K, P, R))
    level = Level(A, P, R, largest)
    return level, _congruent(S, coarse), _block_diagonal(back) @ coarse_null


def _tentative_prolongation(
    K: bsr_array, near_null: Float[np.ndarray, "dofs modes"]
) -> tuple[bsr_array, Float[np.ndarray, "coarse modes"]]:
    """Aggregates of coupled nodes, and an orthonormal basis of the fields on each."""
    from pyamg.aggregation.aggregate import standard_aggregation
    from pyamg.aggregation.tentative import fit_candidates

    nodes = len(K.indptr) - 1
    graph = csr_array((np.ones(len(K.indices)), K.indices, K.indptr), (nodes, nodes))
    return fit_candidates(standard_aggregation(graph)[0], near_null)


def _smoothed_prolongation(K: bsr_array, T: bsr_array, damping: float) -> bsr_array:
    """P = T - damping K T, in the blocks of K; T has at most one block in each row."""
    size = K.blocksize[0]
    down, along = T.blocksize[0] // size, T.blocksize[1] // size
    small = in_blocks(T, size)
    P = multiply(K, small)
    P.data *= -damping
    aggregate = np.full(len(T.indptr) - 1, -1)
    aggregate[np.diff(T.indptr) > 0] = T.indices
    # K has its diagonal, so the blocks of T are among those of K T, and in the same order.
    own = np.repeat(np.repeat(aggregate, down), np.diff(P.indptr)) == P.indices // along
    P.data[own] += small.data
    return P


def _cholesky_scaling(
    blocks: Float[np.ndarray, "nodes k k"],
) -> tuple[Float[np.ndarray, "nodes k k"], Float[np.ndarray, "nodes k k"]]:
    """S = L⁻¹ with the Cholesky factors of the diagonal blocks, and S⁻ᵀ = Lᵀ."""
    try:
        L = np.linalg.cholesky(blocks)
    except np.linalg.LinAlgError as error:
        raise SolveFailure(SolveResult.SINGULAR, _softest_node(blocks)) from error
    return _lower_inverse(L), L.transpose(0, 2, 1)


def _lower_inverse(L: Float[np.ndarray, "nodes k k"]) -> Float[np.ndarray, "nodes k k"]:
    """L⁻¹ by forward substitution for all blocks at once, faster than LAPACK one by one."""
    inverse = np.zeros_like(L)
    for row in range(L.shape[1]):
        pivot = 1 / L[:, row, row]
        inverse[:, row, row] = pivot
        for column in range(row):
            between = slice(column, row)
            left = np.einsum("nk,nk->n", L[:, row, between], inverse[:, between, column])
            inverse[:, row, column] = -pivot * left
    return inverse


def _softest_node(blocks: Float[np.ndarray, "nodes k k"]) -> Float[np.ndarray, " dofs"]:
    """The motion of one node alone that its diagonal block resists least."""
    energy, motion = np.linalg.eigh(blocks)
    node = int(np.argmin(energy[:, 0] / energy[:, -1]))
    mode = np.zeros(blocks.shape[:2])
    mode[node] = motion[node, :, 0]
    return mode.reshape(-1)


def _eigen_scaling(
    blocks: Float[np.ndarray, "nodes k k"],
) -> tuple[Float[np.ndarray, "nodes k k"], Float[np.ndarray, "nodes k k"]]:
    """S with identities, or zeros where there is no stiffness, as S B Sᵀ of each block; S⁻ᵀ."""
    energy, motion = np.linalg.eigh(blocks)
    there = energy > NOTHING * energy[:, -1:].max(axis=0)
    root = np.sqrt(np.where(there, energy, 1.0))
    V = motion.transpose(0, 2, 1)
    S = np.where(there, 1 / root, 0.0)[:, :, None] * V
    return S, np.where(there, root, 0.0)[:, :, None] * V


def _congruent(S: Float[np.ndarray, "nodes k k"], K: bsr_array) -> bsr_array:
    """S K Sᵀ of the block-diagonal matrix of S."""
    row = np.repeat(np.arange(len(K.indptr) - 1), np.diff(K.indptr))
    mirror = S.transpose(0, 2, 1)
    data = np.zeros_like(K.data)
    for first in range(0, len(row), BLOCKS_AT_ONCE):
        run = slice(first, first + BLOCKS_AT_ONCE)
        data[run] = S[row[run]] @ K.data[run] @ mirror[K.indices[run]]
    return bsr_array((data, K.indices, K.indptr), K.shape)


def _block_diagonal(blocks: Float[np.ndarray, "nodes k k"]) -> bsr_array:
    nodes, size = blocks.shape[:2]
    place = np.arange(nodes + 1, dtype=np.int32)
    return bsr_array((np.ascontiguousarray(blocks), place[:-1], place), (nodes * size,) * 2)


def _transposed(matrix: bsr_array) -> bsr_array:
    mirror = bsr_array(matrix.T)
    return bsr_array(
        (np.ascontiguousarray(mirror.data), mirror.indices, mirror.indptr), mirror.shape
    )
