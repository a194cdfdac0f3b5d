"""One multigrid V-cycle with Chebyshev smoothing, on matrices whose diagonal blocks are identities."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fea.linear_solve.element_operator import matrix_shape
from fea.linear_solve.mkl_sparse import ThreadedMatrix

# Degree of the smoothing polynomial. On two cores degree 1, 2 and 3 took 39, 25 and 22 iterations of
# 3, 5 and 7 products with K (tet4, 210k dofs), 350, 237 and 203 (frame of slender struts).
DEGREE = 2

# The smoother damps the part of the spectrum above the largest eigenvalue over this number; between
# 6 and 30 iterations hardly change.
DAMPED_RANGE = 12.0

# Steps of Lanczos' iteration for the largest eigenvalue, and what they may fall short by: 12 steps
# came within 3 % of the limit of 60 on solids and frames.
LANCZOS_STEPS = 12
LANCZOS_MARGIN = 1.05


@dataclass(frozen=True, eq=False)
class Level:
    """A level above the coarsest.

    Attributes:
        matrix: symmetric positive definite, its diagonal blocks identities.
        prolong: from the next coarser level to this.
        restrict: its transpose.
        largest: bound of the eigenvalues of the matrix from above.
    """

    matrix: ThreadedMatrix
    prolong: ThreadedMatrix
    restrict: ThreadedMatrix
    largest: float


@dataclass(frozen=True, eq=False)
class VCycle:
    """A symmetric positive definite approximation of the inverse of the finest matrix.

    Attributes:
        levels: finest first.
        coarsest: inverse of the matrix below the last of them.
    """

    levels: tuple[Level, ...]
    coarsest: Float[np.ndarray, "coarse coarse"]

    def __call__(self, b: Float[np.ndarray, " dofs"]) -> Float[np.ndarray, " dofs"]:
        """Smooth, correct on the coarser levels, smooth: one cycle from zero."""
        return self._cycle(b, 0)

    def _cycle(self, b: Float[np.ndarray, " dofs"], depth: int) -> Float[np.ndarray, " dofs"]:
        if depth == len(self.levels):
            return self.coarsest @ b
        level = self.levels[depth]
        A, r = level.matrix, b.copy()
        x, step = _smoothed(level, r)
        A.times(step, r, alpha=-1.0, beta=1.0)
        correction = level.prolong.times(self._cycle(level.restrict.times(r), depth + 1))
        A.times(correction, r, alpha=-1.0, beta=1.0)
        x += correction
        x += _smoothed(level, r)[0]
        return x


def largest_eigenvalue(matrix: ThreadedMatrix) -> float:
    """Bound from above of the eigenvalues of a symmetric matrix, by Lanczos' iteration."""
    q = np.random.default_rng(0).standard_normal(
        matrix_shape(matrix.matrix)[0]
    )  # the same every time
    q /= math.sqrt(np.einsum("i,i", q, q))
    before = np.zeros_like(q)
    diagonal: list[float] = []
    beside = [0.0]
    for _ in range(min(LANCZOS_STEPS, len(q))):
        w = matrix.times(q)
        w -= beside[-1] * before
        diagonal.append(float(np.einsum("i,i", w, q)))
        w -= diagonal[-1] * q
        beside.append(math.sqrt(np.einsum("i,i", w, w)))
        # The Krylov space is exhausted, and the eigenvalue exact.
        if beside[-1] <= np.finfo(float).eps * diagonal[-1]:
            break
        before, q = q, w / beside[-1]
    off = beside[1 : len(diagonal)]
    T = np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1)
    return LANCZOS_MARGIN * float(np.linalg.eigvalsh(T)[-1])


def _smoothed(
    level: Level, r: Float[np.ndarray, " dofs"]
) -> tuple[Float[np.ndarray, " dofs"], Float[np.ndarray, " dofs"]]:
    """Chebyshev's iteration from zero, and its last step, which is not yet in the residual r.

    Saad, Iterative Methods for Sparse Linear Systems, 2nd ed., algorithm 12.1.
    """
    high, low = level.largest, level.largest / DAMPED_RANGE
    centre, half = (high + low) / 2, (high - low) / 2
    rho = half / centre
    step = r / centre
    x = step.copy()
    for _ in range(DEGREE - 1):
        level.matrix.times(step, r, alpha=-1.0, beta=1.0)
        rho, before = 1 / (2 * centre / half - rho), rho
        step *= rho * before
        step += (2 * rho / half) * r
        x += step
    return x, step
