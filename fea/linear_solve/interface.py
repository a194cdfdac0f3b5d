"""One interface to all linear solvers: a method to implement, a factor to use."""

import abc
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from scipy.sparse import bsr_array

from fea.errors import FeaError
from fea.linear_solve.element_operator import ElementOperator, matrix_shape
from fea.linear_solve.element_operator import Matrix as Matrix
from fea.linear_solve.solve_result import (
    Applied,
    SingularStiffness,
    Solution,
    SolveFailure,
    SolveResult,
)
from fea.linear_solve.stiffness_checks import (
    check_definite,
    check_held,
    check_matrix,
    check_rigid_motion,
    check_solution,
    shifted,
    softest_motion,
)
from fea.precision import refuse_single_precision

# Wanted |b - K x| / |b|. Loads and reactions then balance to about the same figure; double
# precision leaves two more digits for well-shaped solids.
RELATIVE_RESIDUAL = 1e-10

# Largest |b - K x| / |b| that still counts as solved. Rounding of x alone gives about
# eps cond(K), 1e-7 for slender struts; beyond 1e-6 three digits of a compliance are in danger.
RESIDUAL_LIMIT = 1e-6


class AbstractMethod(abc.ABC):
    """A way to apply K⁻¹: a factorisation, or a preconditioner with an iteration.

    The matrices it gets are checked: finite, not empty, positive on the diagonal, no rigid motion
    free.

    Attributes:
        direct: whether `apply` is exact to rounding, so that it can be asked for the softest motion.
        probed: whether it is iterative and fast enough to be asked for free motions.
    """

    direct: ClassVar[bool]
    probed: ClassVar[bool]

    @abc.abstractmethod
    def update(self, K: bsr_array) -> None:
        """Make ready for K; after the first time, keep what depends on its pattern only.

        Raises:
            SolveFailure: when K cannot be factorised.
        """

    @abc.abstractmethod
    def apply(
        self,
        rhs: Float[np.ndarray, "dofs columns"],
        x0: Float[np.ndarray, "dofs columns"] | None,
        rtol: float,
    ) -> Applied:
        """Approximate K⁻¹ rhs for the last K.

        Raises:
            SolveFailure: when K turns out to be singular.
        """

    @abc.abstractmethod
    def free(self) -> None:
        """Release the memory of the factorisation; the method cannot be applied afterwards."""


class Factor:
    """K, ready to be solved with any number of right-hand sides; made by `factorise`.

    Attributes:
        K: the matrix.
        name: the solver chosen, "pardiso", "superlu", "amg" or "jax-cg".
    """

    def __init__(
        self,
        K: Matrix,
        method: AbstractMethod,
        name: str,
        near_null: Float[np.ndarray, "dofs modes"] | None,
    ):
        self.K = K
        self.name = name
        self._method = method
        self._near_null = near_null
        self._spent = ""

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
            rtol: wanted |rhs - K x| / |rhs| of an iterative solver.
            throw: raise when the solve fails; otherwise the result says so.

        Raises:
            FeaError: the sentence of the `SolveResult`, when the solve failed and `throw`; always
                when the factor is spent, or sizes or precision of the right-hand side are wrong.
        """
        self._refuse_when_spent()
        refuse_single_precision(rhs, "Loads")
        if len(rhs) != matrix_shape(self.K)[0]:
            raise FeaError(
                f"The load has {len(rhs)} rows, but the stiffness {matrix_shape(self.K)[0]}; give every dof "
                "its load."
            )
        b = rhs[:, None] if rhs.ndim == 1 else rhs
        start = None if x0 is None else x0.reshape(b.shape)
        mode = None
        try:
            x, iterations, result = self._applied(b, start, rtol)
        except SolveFailure as failure:
            x, iterations, result = np.full_like(b, np.nan), 0, failure.result
            mode = failure.mode
        residual = relative_residual(self.K, x, b)
        # `not <=` so that NaN fails.
        if result is SolveResult.CONVERGED and not residual <= max(rtol, RESIDUAL_LIMIT):
            result = SolveResult.INACCURATE
        if throw:
            _throw(result, mode)
        return Solution(x.reshape(rhs.shape), residual, result, iterations)

    def update(self, K: Matrix) -> "Factor":
        """Factor of a matrix with the same pattern and other values; this one is spent afterwards.

        A direct solver keeps its ordering and symbolic factor, multigrid its hierarchy as long as
        that still converges well, JAX what it has compiled.

        Raises:
            FeaError: when K is singular, of another size, or this factor is spent.
        """
        self._refuse_when_spent()
        if matrix_shape(K) != matrix_shape(self.K):
            raise FeaError(
                f"The new stiffness has {matrix_shape(K)[0]} dofs, the old one "
                f"{matrix_shape(self.K)[0]}; factorise it afresh."
            )
        self._spent = "went into the factor that its update returned; use that one"
        return prepared(K, self._method, self.name, self._near_null, first=False)

    def free(self) -> None:
        """Release the memory of the factorisation now rather than at garbage collection."""
        if not self._spent:
            self._spent = "was freed; factorise the stiffness again"
            if matrix_shape(self.K)[0]:
                self._method.free()

    def _applied(
        self,
        b: Float[np.ndarray, "dofs columns"],
        x0: Float[np.ndarray, "dofs columns"] | None,
        rtol: float,
    ) -> Applied:
        if not np.isfinite(b).all():
            raise SolveFailure(SolveResult.NOT_FINITE)
        if b.size == 0:
            return Applied(np.zeros_like(b), 0, SolveResult.CONVERGED)
        applied = self._method.apply(b, x0, rtol)
        if not self._method.direct:
            check_solution(self.K, applied.x, b)
        return applied

    def _refuse_when_spent(self) -> None:
        if self._spent:
            raise FeaError(f"This factor cannot be used again: it {self._spent}.")


def prepared(
    K: Matrix,
    method: AbstractMethod,
    name: str,
    near_null: Float[np.ndarray, "dofs modes"] | None,
    *,
    first: bool = True,
) -> Factor:
    """Check a stiffness, whatever the solver, and make the method ready for it.

    Args:
        K: the stiffness.
        method: new, or the one that served a matrix of the same pattern.
        name: of the method.
        near_null: fields of almost no energy.
        first: whether the pattern is new, and with it what can move.

    Raises:
        SingularStiffness: with the free motion where it is known.
        FeaError: when K is not finite or in single precision, or memory ran out.
    """
    try:
        check_matrix(K)
        if matrix_shape(K)[0]:
            if near_null is not None:
                check_rigid_motion(K, near_null)
            _make_ready(method, K, first=first)
    except SolveFailure as failure:
        _throw(failure.result, failure.mode)
    except MemoryError as error:
        raise FeaError(SolveResult.OUT_OF_MEMORY.value) from error
    return Factor(K, method, name, near_null)


def _make_ready(method: AbstractMethod, K: Matrix, *, first: bool) -> None:
    """Factorise; a singular matrix once more, a little stiffer, to find the motion that is free."""

    def solve(
        rhs: Float[np.ndarray, "dofs columns"], rtol: float = RELATIVE_RESIDUAL
    ) -> Float[np.ndarray, "dofs columns"]:
        return method.apply(rhs, None, rtol).x

    if not method.direct or isinstance(K, ElementOperator):
        # `factorise` gives operators to methods that take them.
        method.update(K)  # pyright: ignore[reportArgumentType]
        if first and method.probed:
            check_held(K, solve)
        return
    try:
        method.update(K)
        check_definite(K, solve)
    except SolveFailure as failure:
        if failure.result is not SolveResult.SINGULAR or failure.mode is not None:
            raise
        method.update(shifted(K))
        raise SolveFailure(SolveResult.SINGULAR, softest_motion(K, solve)) from failure


def relative_residual(
    K: Matrix, x: Float[np.ndarray, "dofs columns"], b: Float[np.ndarray, "dofs columns"]
) -> float:
    """Largest |b - K x| / |b| over the columns; |b - K x| itself where b is zero."""
    if b.size == 0:
        return 0.0
    norm = np.linalg.norm(b, axis=0)
    return float((np.linalg.norm(b - K @ x, axis=0) / np.where(norm > 0, norm, 1.0)).max())


def _throw(result: SolveResult, mode: Float[np.ndarray, " dofs"] | None) -> None:
    if result is SolveResult.SINGULAR:
        raise SingularStiffness(result.value, mode)
    if result is not SolveResult.CONVERGED:
        raise FeaError(result.value)
