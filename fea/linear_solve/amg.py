"""Conjugate gradients preconditioned by smoothed-aggregation multigrid; the only user of pyamg.

Vaněk, Mandel, Brezina, "Algebraic multigrid by smoothed aggregation for second and fourth order
elliptic problems", Computing 56 (1996) 179-196: the coarse spaces reproduce given near-null
vectors, for elasticity the six rigid-body modes.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from jaxtyping import Float
from scipy.sparse import bsr_array, csr_array
from scipy.sparse.linalg import LinearOperator, cg

from fea.linear_solve.interface import FREE_MOTION, AbstractMethod, SolveFailure, SolveResult, order

# Couplings below this fraction of the diagonal are ignored in aggregation; 0 keeps all, which
# for elasticity gives the largest aggregates and the leanest hierarchy.
STRENGTH = 0.0

# Nodes of the coarsest level; its six unknowns each are solved densely.
COARSEST = 100

# Matrix products of one smoothing sweep. Degree 3 took 0.83 s where a symmetric block Gauss-Seidel
# sweep took 1.45 s (tet10, 57k dofs, 36 and 35 iterations).
SMOOTHER_DEGREE = 3

# Lattices with slender struts need a few hundred (bcc 16x16x16, radius 0.01 of the cell: 377).
MAX_ITERATIONS = 1500

# A hierarchy kept for new values is rebuilt once it needs this many times the iterations it
# needed when it was new: a build costs about as much as twenty iterations.
REBUILD_FACTOR = 2.0


class MultigridCG(AbstractMethod):
    """Hierarchy and iteration for one matrix, or for a sequence on one pattern."""

    def __init__(self, K: csr_array, near_null: Float[np.ndarray, "dofs modes"], block: int):
        self._near_null = near_null
        self._block = block
        self._iterations_when_new: int | None = None
        self._precondition: Callable[[np.ndarray], np.ndarray] | None = None
        self._rebuild(K)

    def update(self, K: csr_array) -> None:
        """Keep the hierarchy for new values; `apply` rebuilds it when it no longer pays."""
        self._check(K)
        self._matrix = self._blocks(K)
        self._stale = True

    def apply(
        self,
        K: csr_array,
        rhs: Float[np.ndarray, "dofs columns"],
        x0: Float[np.ndarray, "dofs columns"] | None,
        rtol: float,
    ) -> tuple[Float[np.ndarray, "dofs columns"], int]:
        """Conjugate gradients, column by column."""
        x = np.zeros_like(rhs) if x0 is None else x0.copy()
        most = 0
        for column in range(rhs.shape[1]):
            limit = MAX_ITERATIONS
            if self._stale and self._iterations_when_new is not None:
                limit = int(REBUILD_FACTOR * self._iterations_when_new)
            x[:, column], count, done = self._cg(rhs[:, column], x[:, column], rtol, limit)
            if not done and self._stale:
                self._rebuild(K)
                x[:, column], count, done = self._cg(
                    rhs[:, column], x[:, column], rtol, MAX_ITERATIONS
                )
            if self._iterations_when_new is None:
                self._iterations_when_new = count
            most = max(most, count)
        return x, most

    def free(self) -> None:
        """Drop the hierarchy."""
        self._precondition = None

    @property
    def failure(self) -> SolveResult:
        """Too many iterations."""
        return SolveResult.NOT_CONVERGED

    def _rebuild(self, K: csr_array) -> None:
        from pyamg import smoothed_aggregation_solver

        self._check(K)
        self._matrix = self._blocks(K)
        self._stale = False
        self._iterations_when_new = None
        if order(K) == 0:
            return
        # Displacements and rotations, thick and thin struts differ by many orders; the polynomial
        # smoother damps with one number per level, so it works on K with unit diagonal.
        root = np.sqrt(K.diagonal())
        row = np.repeat(np.arange(order(K)), np.diff(K.indptr))
        unit = K.data / (root[row] * root[K.indices])
        smoother = ("chebyshev", {"degree": SMOOTHER_DEGREE})
        with _reproducible():
            hierarchy = smoothed_aggregation_solver(
                self._blocks(csr_array((unit, K.indices, K.indptr), K.shape)),
                B=root[:, None] * self._near_null,
                symmetry="symmetric",
                strength=("symmetric", {"theta": STRENGTH}),  # pyright: ignore[reportArgumentType]
                smooth=("jacobi", {"omega": 4.0 / 3.0}),  # pyright: ignore[reportArgumentType]
                presmoother=smoother,
                postsmoother=smoother,
                improve_candidates=None,
                max_coarse=COARSEST,
                coarse_solver="pinv",
            )
        cycle = hierarchy.aspreconditioner(cycle="V")
        self._precondition = lambda r: np.asarray(cycle @ (r / root)) / root

    def _cg(
        self, b: Float[np.ndarray, " dofs"], x0: Float[np.ndarray, " dofs"], rtol: float, limit: int
    ) -> tuple[Float[np.ndarray, " dofs"], int, bool]:
        if not b.any():
            return np.zeros_like(b), 0, True
        count = 0

        def counted(_: np.ndarray) -> None:
            nonlocal count
            count += 1

        M = LinearOperator(self._matrix.shape, self._precondition, dtype=np.float64)  # pyright: ignore
        x, info = cg(
            self._matrix, b, x0=x0, rtol=rtol, atol=0.0, maxiter=limit, M=M, callback=counted
        )
        return x, count, info == 0

    def _blocks(self, K: csr_array) -> bsr_array | csr_array:
        if self._block == 1:
            return K
        return K.tobsr(blocksize=(self._block, self._block))

    def _check(self, K: csr_array) -> None:
        if not np.isfinite(K.data).all():
            raise SolveFailure(SolveResult.NOT_FINITE)
        if order(K) == 0:
            return
        diagonal = K.diagonal()
        if not (diagonal > 0).all():
            raise SolveFailure(SolveResult.SINGULAR)
        # Conjugate gradients converge on a singular system when the load happens to be
        # consistent, so free motion has to be looked for.
        v, _ = np.linalg.qr(np.sqrt(diagonal)[:, None] * self._near_null)
        w = v / np.sqrt(diagonal)[:, None]
        if np.linalg.eigvalsh(w.T @ (K @ w)).min() < FREE_MOTION:
            raise SolveFailure(SolveResult.SINGULAR)


@contextmanager
def _reproducible() -> Iterator[None]:
    """Give pyamg's power iterations the same start each time, and leave the generator as it was.

    pyamg draws from NumPy's global generator; without this, two runs differ in the last digits.
    """
    state = np.random.get_state()  # noqa: NPY002 - the generator pyamg draws from
    np.random.seed(0)  # noqa: NPY002
    try:
        with warnings.catch_warnings():
            # The Krylov space of a tiny level is exhausted early; its eigenvalue is then exact.
            warnings.filterwarnings("ignore", "Breakdown occurred", UserWarning)
            yield
    finally:
        np.random.set_state(state)  # noqa: NPY002
