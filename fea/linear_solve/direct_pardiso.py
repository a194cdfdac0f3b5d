"""Cholesky factorisation by MKL PARDISO; the only user of pypardiso."""

import copy
import ctypes
import importlib.util
import sys
from collections.abc import Callable
from functools import cache
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import bsr_array, csr_array

from fea.linear_solve.element_operator import matrix_shape
from fea.linear_solve.interface import AbstractMethod
from fea.linear_solve.solve_result import Applied, SolveFailure, SolveResult

# Real, symmetric, positive definite: PARDISO factorises the upper triangle without pivoting and
# says so when a pivot is not positive (MKL Developer Reference, "pardiso", mtype).
POSITIVE_DEFINITE = 2

# Phases of PARDISO.
ANALYSE, FACTORISE, SOLVE, RELEASE = 11, 22, 33, -1

# Error codes of PARDISO.
ZERO_PIVOT, NO_MEMORY, NO_MEMORY_ORDERING, INDEX_OVERFLOW = -4, -2, -3, -8


@cache
def _blank_solver() -> Any:
    """A solver of pypardiso that has seen no matrix; None when it or MKL is not installed.

    Made once: it looks for MKL in all folders of the Python installation, 0.2 s.
    """
    if importlib.util.find_spec("pypardiso") is None:
        return None
    try:
        from pypardiso import PyPardisoSolver
    except (ImportError, OSError):
        return None
    return PyPardisoSolver(mtype=POSITIVE_DEFINITE)


def mkl_library() -> ctypes.CDLL | None:
    """The MKL library that pypardiso loads; None when one of the two is not installed."""
    blank = _blank_solver()
    return None if blank is None else blank.libmkl


def is_installed() -> bool:
    """Whether pypardiso can be imported and finds the MKL library."""
    return mkl_library() is not None


class Pardiso(AbstractMethod):
    """A PARDISO factorisation of its own, released with the object.

    pypardiso's module-level `spsolve` shares one solver and recognises matrices by hash; here
    each factor has a solver, and a new matrix on the old pattern costs the numeric phase only.
    """

    direct: ClassVar[bool] = True
    probed: ClassVar[bool] = False

    def __init__(self):
        blank = _blank_solver()
        # PARDISO's memory hangs on `pt`, which each solver must have of its own, as its settings.
        self._solver = copy.copy(blank)
        self._solver.pt, self._solver.iparm = blank.pt.copy(), blank.iparm.copy()
        # Fill-in ordering by the threaded nested dissection (0-based 1: 3), two-level threaded
        # factorisation (23: 1), up to two steps of iterative refinement (7: 2); 0: 1 says that
        # these are set.
        self._solver.iparm[[0, 1, 7, 23]] = [1, 3, 2, 1]
        self._upper: csr_array | None = None
        self._places: Int[np.ndarray, " entries"] = np.zeros(0, int)

    def update(self, K: bsr_array) -> None:
        """Factorise new values; the ordering is kept."""
        nothing = np.zeros((matrix_shape(K)[0], 1))
        if self._upper is None:
            self._upper, self._places = _upper_triangle(K)
            self._call(ANALYSE, nothing)
        else:
            self._upper.data = K.data.reshape(-1)[self._places]
        self._call(FACTORISE, nothing)

    def apply(
        self,
        rhs: Float[np.ndarray, "dofs columns"],
        x0: Float[np.ndarray, "dofs columns"] | None,
        rtol: float,
    ) -> Applied:
        """Forward and back substitution."""
        return Applied(self._call(SOLVE, np.asfortranarray(rhs)), 0)

    def free(self) -> None:
        """Hand the factor's memory back to MKL."""
        if self._upper is not None:
            self._call(RELEASE, np.zeros((matrix_shape(self._upper)[0], 1)))
            self._upper = None

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

    def __del__(self, is_finalizing: Callable[[], bool] = sys.is_finalizing):
        # At interpreter exit MKL may be gone already, even the name `sys`, and the process returns
        # its memory anyway.
        if getattr(self, "_upper", None) is not None and not is_finalizing():
            self.free()


def _upper_triangle(K: bsr_array) -> tuple[csr_array, Int[np.ndarray, " entries"]]:
    """Upper triangle with the diagonal, and where its entries stand in the data of K."""
    places = np.arange(K.data.size).reshape(K.data.shape)
    entries = bsr_array((places, K.indices, K.indptr), K.shape).tocsr()
    size = matrix_shape(K)[0]
    row = np.repeat(np.arange(size, dtype=np.int32), np.diff(entries.indptr))
    above = entries.indices >= row
    places = np.asarray(entries.data[above], np.int64)
    indptr = np.concatenate([[0], np.cumsum(np.bincount(row[above], minlength=size))])
    upper = (K.data.reshape(-1)[places], entries.indices[above], indptr.astype(np.int32))
    return csr_array(upper, K.shape), places
