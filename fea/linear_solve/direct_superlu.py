"""LU factorisation by SuperLU, which comes with SciPy: available everywhere, slow when large."""

from typing import ClassVar

import numpy as np
from jaxtyping import Float
from scipy.sparse import bsr_array
from scipy.sparse.linalg import SuperLU as SuperLUFactor
from scipy.sparse.linalg import splu

from fea.linear_solve.interface import AbstractMethod
from fea.linear_solve.solve_result import Applied, SolveFailure, SolveResult


class SuperLU(AbstractMethod):
    """SuperLU in symmetric mode: pivots on the diagonal, ordering by minimum degree of K + Kᵀ."""

    direct: ClassVar[bool] = True
    probed: ClassVar[bool] = False

    _factor: SuperLUFactor
    _K: bsr_array

    def update(self, K: bsr_array) -> None:
        """Factorise new values; SuperLU keeps nothing of the last factorisation."""
        self._K = K
        try:
            factor = splu(
                K.tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:  # "Factor is exactly singular"
            raise SolveFailure(SolveResult.SINGULAR) from error
        # The pivots of a positive definite matrix are positive.
        if not (factor.U.diagonal() > 0).all():
            raise SolveFailure(SolveResult.SINGULAR)
        self._factor = factor

    def apply(
        self,
        rhs: Float[np.ndarray, "dofs columns"],
        x0: Float[np.ndarray, "dofs columns"] | None,
        rtol: float,
    ) -> Applied:
        """Substitution, and one step of iterative refinement."""
        x = self._factor.solve(rhs)
        x += self._factor.solve(rhs - self._K @ x)
        return Applied(x, 0)

    def free(self) -> None:
        """Drop the factor."""
        del self._factor, self._K
