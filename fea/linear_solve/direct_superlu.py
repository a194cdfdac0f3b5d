"""LU factorisation by SuperLU, which comes with SciPy: available everywhere, slow when large."""

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array
from scipy.sparse.linalg import SuperLU as SuperLUFactor
from scipy.sparse.linalg import splu

from fea.linear_solve.interface import (
    AbstractMethod,
    SolveFailure,
    SolveResult,
    check_definite,
    order,
)


class SuperLU(AbstractMethod):
    """SuperLU in symmetric mode: pivots on the diagonal, ordering by minimum degree of K + Kᵀ."""

    def __init__(self, K: csr_array):
        self._factor: SuperLUFactor | None = None
        self.update(K)

    def update(self, K: csr_array) -> None:
        """Factorise new values; SuperLU keeps nothing of the last factorisation."""
        if not np.isfinite(K.data).all():
            raise SolveFailure(SolveResult.NOT_FINITE)
        if order(K) == 0:
            return
        if not (K.diagonal() > 0).all():
            raise SolveFailure(SolveResult.SINGULAR)
        try:
            factor = splu(
                K.tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except MemoryError as error:
            raise SolveFailure(SolveResult.OUT_OF_MEMORY) from error
        except RuntimeError as error:  # "Factor is exactly singular"
            raise SolveFailure(SolveResult.SINGULAR) from error
        # The pivots of a positive definite matrix are positive.
        if not (factor.U.diagonal() > 0).all():
            raise SolveFailure(SolveResult.SINGULAR)
        self._factor = factor
        check_definite(self, K)

    def apply(
        self,
        K: csr_array,
        rhs: Float[np.ndarray, "dofs columns"],
        x0: Float[np.ndarray, "dofs columns"] | None,
        rtol: float,
    ) -> tuple[Float[np.ndarray, "dofs columns"], int]:
        """Substitution, and one step of iterative refinement."""
        if self._factor is None:
            return np.zeros_like(rhs), 0
        x = self._factor.solve(rhs)
        return x + self._factor.solve(rhs - K @ x), 0

    def free(self) -> None:
        """Drop the factor."""
        self._factor = None

    @property
    def failure(self) -> SolveResult:
        """Positive pivots but a large residual."""
        return SolveResult.INACCURATE
