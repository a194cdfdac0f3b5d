"""How linear solves end: results with their sentences, the solution, and the failures inside."""

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from fea.errors import FeaError


class SolveResult(Enum):
    """How a linear solve ended; the value is the sentence for the user, empty when all is well.

    Errors add the figures: residual, its limit, iterations.
    """

    CONVERGED = ""
    SINGULAR = "Stiffness is singular: some part can move freely. Add supports."
    NOT_CONVERGED = (
        "The iterative solver did not converge: elements are badly shaped, the material is nearly "
        "incompressible (nu near 0.5) or stiffnesses differ by many orders. Use the direct solver "
        '(solver="pardiso" or "superlu").'
    )
    INACCURATE = (
        "The linear solver lost too many digits: elements are badly shaped, the material is nearly "
        "incompressible (nu near 0.5) or stiffnesses differ by many orders. Improve the mesh, use a "
        "smaller nu or ratio of stiffnesses, or add supports."
    )
    TOLERANCE_MISSED = (
        "The linear solve misses the tolerance asked for: rounding or the largest number of "
        "iterations ended it above. Ask for a larger rtol, or for none."
    )
    NOT_FINITE = (
        "Stiffness, loads or the starting point contain NaN or infinite numbers. Check material "
        "and loads."
    )
    OUT_OF_MEMORY = (
        'The linear solver ran out of memory. Use the iterative solver (solver="amg") or a '
        "coarser model."
    )


class SolveFailure(Exception):
    """Raised inside a solver; `Factor` turns it into a `FeaError` or a result.

    Attributes:
        result: what went wrong.
        mode: the free motion, when that is what went wrong and it is known.
        figures: what was measured, for the message.
    """

    def __init__(
        self,
        result: SolveResult,
        mode: Float[np.ndarray, " dofs"] | None = None,
        figures: str = "",
    ):
        super().__init__(result.value)
        self.result = result
        self.mode = mode
        self.figures = figures


class SingularStiffness(FeaError):
    """The stiffness is singular.

    Attributes:
        mode: the motion that no stiffness resists, largest entry one; None when it is not known.
    """

    def __init__(self, message: str, mode: Float[np.ndarray, " dofs"] | None = None):
        super().__init__(message)
        self.mode = None if mode is None else mode / np.abs(mode).max()


@dataclass(frozen=True, eq=False)
class Solution:
    """Solution of K x = b.

    Attributes:
        x: solution, shaped as the right-hand side; NaN when there is none.
        residual: largest |b - K x| / |b| over the columns, computed from x itself.
        result: how the solve ended.
        iterations: largest number of iterations over the columns; 0 for a direct solver.
    """

    x: Float[np.ndarray, "dofs ..."]
    residual: float
    result: SolveResult
    iterations: int


class Applied(NamedTuple):
    """What a method makes of right-hand sides.

    Attributes:
        x: solutions, one a column.
        iterations: largest number over the columns.
        cut_off: whether an iteration ended at its largest number, rather than at the residual
            wanted or where rounding let it fall no further.
    """

    x: Float[np.ndarray, "dofs columns"]
    iterations: int
    cut_off: bool = False
