"""Preconditioned conjugate gradients for one right-hand side, down to the true residual.

Hestenes, Stiefel, "Methods of conjugate gradients for solving linear systems", Journal of Research
of the National Bureau of Standards 49 (1952) 409-436.
"""

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from fea.linear_solve.solve_result import SolveFailure, SolveResult

# The residual that the iteration carries along drifts from b - K x by rounding; from there the
# iteration is started once more.
ROUNDS = 2


def conjugate_gradients(
    product: Callable[[np.ndarray], np.ndarray],
    precondition: Callable[[np.ndarray], np.ndarray],
    b: Float[np.ndarray, " dofs"],
    x0: Float[np.ndarray, " dofs"] | None,
    *,
    rtol: float,
    limit: int,
) -> tuple[Float[np.ndarray, " dofs"], int, bool]:
    """Solve K x = b.

    Args:
        product: K times a vector.
        precondition: an approximation of K⁻¹ times a vector, symmetric positive definite.
        b: right-hand side.
        x0: starting point; its best multiple is taken.
        rtol: wanted |b - K x| / |b|.
        limit: largest number of iterations.

    Returns:
        x, the number of iterations, and whether `limit` cut them off. Where rounding keeps the
        residual above the one wanted, x is as good as it gets and the caller looks at its residual.

    Raises:
        SolveFailure: when a direction without stiffness turns up; it is the free motion.
    """
    target = max(rtol, np.finfo(float).eps) * _norm(b)
    x, r = _start(product, b, x0)
    count = 0
    for _ in range(ROUNDS):
        p, rz = np.zeros_like(b), 1.0
        while _norm(r) > target:
            if count == limit:
                return x, count, True
            count += 1
            z = precondition(r)
            before, rz = rz, _dot(r, z)
            p *= rz / before
            p += z
            Kp = product(p)
            energy = _dot(p, Kp)
            if not energy > 0:
                raise SolveFailure(SolveResult.SINGULAR, p)
            step = rz / energy
            x += step * p
            Kp *= step
            r -= Kp
        r = b - product(x)
        if _norm(r) <= target:
            break
    return x, count, False


def _start(
    product: Callable[[np.ndarray], np.ndarray],
    b: Float[np.ndarray, " dofs"],
    x0: Float[np.ndarray, " dofs"] | None,
) -> tuple[Float[np.ndarray, " dofs"], Float[np.ndarray, " dofs"]]:
    """The multiple of x0 with the least energy of the error, and its residual."""
    if x0 is not None:
        Kx = product(x0)
        energy = _dot(x0, Kx)
        if energy > 0:
            scale = _dot(x0, b) / energy
            return scale * x0, b - scale * Kx
    return np.zeros_like(b), b.copy()


def _dot(a: Float[np.ndarray, " dofs"], b: Float[np.ndarray, " dofs"]) -> float:
    # Not `a @ b`: the threads of NumPy's BLAS wait for cores that MKL's threads still hold, and on
    # two cores a product of 0.1 ms takes 10 ms.
    return float(np.einsum("i,i", a, b))


def _norm(a: Float[np.ndarray, " dofs"]) -> float:
    return math.sqrt(_dot(a, a))
