"""Cholesky factorisation by MKL PARDISO; the only user of pypardiso."""

import importlib.util
import sys

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array, triu

from fea.linear_solve.interface import (
    AbstractMethod,
    SolveFailure,
    SolveResult,
    check_definite,
    order,
)

# Real, symmetric, positive definite: PARDISO factorises the upper triangle without pivoting and
# says so when a pivot is not positive (MKL Developer Reference, "pardiso", mtype).
POSITIVE_DEFINITE = 2

# Phases of PARDISO.
ANALYSE, FACTORISE, SOLVE, RELEASE = 11, 22, 33, -1

# Error codes of PARDISO.
ZERO_PIVOT, NO_MEMORY, NO_MEMORY_ORDERING, INDEX_OVERFLOW = -4, -2, -3, -8


def is_installed() -> bool:
    """Whether pypardiso can be imported and finds the MKL library."""
    if importlib.util.find_spec("pypardiso") is None:
        return False
    try:
        import pypardiso  # noqa: F401 - finding MKL is what is tried
    except (ImportError, OSError):
        return False
    return True


class Pardiso(AbstractMethod):
    """A PARDISO factorisation of its own, released with the object.

    pypardiso's module-level `spsolve` shares one solver and recognises matrices by hash; here
    each factor has a solver, and a new matrix on the old pattern costs the numeric phase only.
    """

    def __init__(self, K: csr_array):
        from pypardiso import PyPardisoSolver

        self._solver = PyPardisoSolver(mtype=POSITIVE_DEFINITE)
        # Fill-in ordering by the threaded nested dissection (0-based 1: 3), two-level threaded
        # factorisation (23: 1), up to two steps of iterative refinement (7: 2); 0: 1 says that
        # these are set.
        self._solver.iparm[[0, 1, 7, 23]] = [1, 3, 2, 1]
        self._upper: csr_array | None = None
        self._analysed = False
        self.update(K)

    def update(self, K: csr_array) -> None:
        """Factorise new values; the ordering is kept."""
        if not np.isfinite(K.data).all():
            raise SolveFailure(SolveResult.NOT_FINITE)
        # PARDISO reads beyond its arrays when a diagonal entry is missing, so check here.
        if order(K) == 0:
            return
        if not (K.diagonal() > 0).all():
            raise SolveFailure(SolveResult.SINGULAR)
        self._upper = csr_array(triu(K, format="csr"))
        self._upper.sort_indices()
        nothing = np.zeros((order(K), 1))
        if not self._analysed:
            self._call(ANALYSE, nothing)
            self._analysed = True
        self._call(FACTORISE, nothing)
        check_definite(self, K)

    def apply(
        self,
        K: csr_array,
        rhs: Float[np.ndarray, "dofs columns"],
        x0: Float[np.ndarray, "dofs columns"] | None,
        rtol: float,
    ) -> tuple[Float[np.ndarray, "dofs columns"], int]:
        """Forward and back substitution."""
        if rhs.size == 0:
            return np.zeros_like(rhs), 0
        return self._call(SOLVE, np.asfortranarray(rhs)), 0

    def free(self) -> None:
        """Hand the factor's memory back to MKL."""
        if self._analysed and self._upper is not None:
            self._analysed = False
            self._call(RELEASE, np.zeros((order(self._upper), 1)))
            self._upper = None

    @property
    def failure(self) -> SolveResult:
        """Positive pivots but a large residual."""
        return SolveResult.INACCURATE

    def _call(self, phase: int, rhs: Float[np.ndarray, "dofs columns"]):
        # pypardiso's public methods offer neither the numeric phase alone nor a solve that does
        # not compare the matrix with its copy first, hence the call below them.
        from pypardiso.pardiso_wrapper import PyPardisoError

        self._solver.set_phase(phase)
        try:
            return self._solver._call_pardiso(self._upper, rhs)
        except PyPardisoError as error:
            if error.value in (NO_MEMORY, NO_MEMORY_ORDERING, INDEX_OVERFLOW):
                raise SolveFailure(SolveResult.OUT_OF_MEMORY) from error
            raise SolveFailure(SolveResult.SINGULAR) from error

    def __del__(self):
        # At interpreter exit MKL may be gone already, and the process returns its memory anyway.
        if getattr(self, "_analysed", False) and not sys.is_finalizing():
            self.free()
