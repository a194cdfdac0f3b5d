"""What linear solvers take and return: a factor to reuse, a solution with its true residual."""

import abc
from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array

from fea.errors import FeaError

# Wanted |b - K x| / |b|. Loads and reactions then balance to about the same figure; double
# precision leaves two more digits for well-shaped solids.
RELATIVE_RESIDUAL = 1e-10

# Largest |b - K x| / |b| that still counts as solved. Rounding of x alone gives about
# eps cond(K), 1e-7 for slender struts; beyond 1e-6 three digits of a compliance are in danger.
RESIDUAL_LIMIT = 1e-6


# Smallest eigenvalue of K scaled to unit diagonal, below which a motion counts as free. Measured:
# 1e-16 for a truly free motion, 1e-9 for a clamped solid bar 60 times as long as thick, 3e-6 for a
# slender lattice (bcc 16x16x16, radius 0.01 of the cell).
FREE_MOTION = 1e-13


class SolveResult(Enum):
    """How a linear solve ended; the value is the sentence for the user, empty when all is well."""

    CONVERGED = ""
    SINGULAR = "Stiffness is singular: some part can move freely. Add supports."
    NOT_CONVERGED = (
        "The iterative solver did not converge: elements are badly shaped or stiffnesses differ "
        'too much. Use the direct solver (solver="pardiso" or "superlu").'
    )
    INACCURATE = (
        "The direct solver lost too many digits: elements are badly shaped or stiffnesses differ "
        "too much. Improve the mesh or add supports."
    )
    NOT_FINITE = "Stiffness or loads contain NaN or infinite numbers. Check material and loads."
    OUT_OF_MEMORY = (
        'The direct solver ran out of memory. Use the iterative solver (solver="amg") or a '
        "coarser model."
    )


class SolveFailure(Exception):
    """Raised inside a solver; `Factor` turns it into a `FeaError` or a result."""

    def __init__(self, result: SolveResult):
        super().__init__(result.value)
        self.result = result


@dataclass(frozen=True, eq=False)
class Solution:
    """Solution of K x = b.

    Attributes:
        x: solution, shaped as the right-hand side.
        residual: largest |b - K x| / |b| over the columns, computed from x itself.
        result: how the solve ended.
        iterations: largest number of iterations over the columns; 0 for a direct solver.
    """

    x: Float[np.ndarray, "dofs ..."]
    residual: float
    result: SolveResult
    iterations: int


class AbstractMethod(abc.ABC):
    """A way to apply K⁻¹: a factorisation, or a preconditioner with an iteration."""

    @abc.abstractmethod
    def apply(
        self,
        K: csr_array,
        rhs: Float[np.ndarray, "dofs columns"],
        x0: Float[np.ndarray, "dofs columns"] | None,
        rtol: float,
    ) -> tuple[Float[np.ndarray, "dofs columns"], int]:
        """Approximate K⁻¹ rhs, and the largest number of iterations used."""

    @abc.abstractmethod
    def update(self, K: csr_array) -> None:
        """Make ready for new values on the same pattern, keeping what depends on the pattern.

        Raises:
            SolveFailure: when K cannot be factorised.
        """

    @abc.abstractmethod
    def free(self) -> None:
        """Release the memory of the factorisation; the method cannot be applied afterwards."""

    @property
    @abc.abstractmethod
    def failure(self) -> SolveResult:
        """What to report when the residual stays too large."""


class Factor:
    """K, ready to be solved with any number of right-hand sides.

    Attributes:
        K: the matrix.
        name: the solver chosen, "pardiso", "superlu" or "amg".
    """

    def __init__(self, K: csr_array, method: AbstractMethod, name: str):
        self.K = K
        self.name = name
        self._method = method

    def solve(
        self,
        rhs: Float[np.ndarray, "dofs ..."],
        *,
        x0: Float[np.ndarray, "dofs ..."] | None = None,
        rtol: float = RELATIVE_RESIDUAL,
        throw: bool = True,
    ) -> Solution:
        """Solve K x = rhs; K is symmetric, so this is the adjoint solve too.

        Args:
            rhs: one right-hand side, or one a column.
            x0: starting point of an iterative solver.
            rtol: wanted |rhs - K x| / |rhs|.
            throw: raise when the solve fails; otherwise the result says so.

        Raises:
            FeaError: the sentence of the `SolveResult`, when the solve failed and `throw`.
        """
        b = rhs.reshape(len(rhs), 1) if rhs.ndim == 1 else rhs
        start = None if x0 is None else x0.reshape(b.shape)
        if not np.isfinite(b).all():
            x, iterations, residual, result = np.zeros_like(b), 0, np.inf, SolveResult.NOT_FINITE
        else:
            x, iterations = self._method.apply(self.K, b, start, rtol)
            residual = relative_residual(self.K, x, b)
            # `not <=` so that NaN fails.
            failed = not residual <= max(rtol, RESIDUAL_LIMIT)
            result = self._method.failure if failed else SolveResult.CONVERGED
        if throw and result is not SolveResult.CONVERGED:
            raise FeaError(result.value)
        return Solution(x.reshape(rhs.shape), float(residual), result, iterations)

    def update(self, K: csr_array) -> "Factor":
        """Factor of a matrix with the same pattern and other values.

        A direct solver keeps its ordering and symbolic factor, multigrid its hierarchy as long as
        that still converges well. The old factor must not be used afterwards.

        Raises:
            FeaError: when K is singular.
        """
        try:
            self._method.update(K)
        except SolveFailure as failure:
            raise FeaError(failure.result.value) from failure
        return Factor(K, self._method, self.name)

    def free(self) -> None:
        """Release the memory of the factorisation now rather than at garbage collection."""
        self._method.free()


def check_definite(method: AbstractMethod, K: csr_array) -> None:
    """Tell a singular matrix from a definite one after a direct factorisation.

    Rounding can turn the zero pivots of a free motion into small positive ones. One step of
    inverse iteration from a rough field finds such a motion: y = K⁻¹ c grows without bound, and
    its Rayleigh quotient c.y / y.y (K of unit diagonal) drops to rounding.

    Raises:
        SolveFailure: when a motion is free.
    """
    if order(K) == 0:
        return
    root = np.sqrt(K.diagonal())
    c = np.random.default_rng(0).standard_normal(order(K))  # the same field every time
    y = root * method.apply(K, (root * c)[:, None], None, 0.0)[0][:, 0]
    if not np.isfinite(y).all() or not c @ y > FREE_MOTION * (y @ y):
        raise SolveFailure(SolveResult.SINGULAR)


def order(K: csr_array) -> int:
    """Number of rows of K."""
    return len(K.indptr) - 1


def relative_residual(
    K: csr_array, x: Float[np.ndarray, "dofs columns"], b: Float[np.ndarray, "dofs columns"]
) -> float:
    """Largest |b - K x| / |b| over the columns; |b - K x| itself where b is zero."""
    if b.size == 0:
        return 0.0
    norm = np.linalg.norm(b, axis=0)
    return float((np.linalg.norm(b - K @ x, axis=0) / np.where(norm > 0, norm, 1.0)).max())
