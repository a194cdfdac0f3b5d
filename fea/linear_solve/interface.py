"""One interface to all linear solvers: a method to implement, a factor to use."""

import abc
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Array, Float, Num
from scipy.sparse import bsr_array

from fea.errors import FeaError
from fea.linear_solve.element_operator import (
    ElementOperator,
    GivenMatrix,
    as_matrix,
    matrix_shape,
)
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
from fea.precision import as_float64

# |b - K x| / |b| wanted unless the caller says otherwise. Loads and reactions then balance to about
# the same figure; double precision leaves two more digits for well-shaped solids.
RELATIVE_RESIDUAL = 1e-10

# Largest |b - K x| / |b| that still counts as solved then. Rounding of x alone gives about
# eps cond(K), 1e-7 for slender struts; beyond 1e-6 three digits of a compliance are in danger.
RESIDUAL_LIMIT = 1e-6

# Iterations stop at this share of the residual wanted: it is measured by another product, in another
# order of summation.
AIM = 0.9

# A right-hand side or a starting point, as it may be given.
Columns = Num[np.ndarray, "dofs ..."] | Num[Array, "dofs ..."] | Sequence[Any]


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
        K: the matrix, until the factor is spent.
        name: the solver chosen, "pardiso", "superlu", "amg" or "jax-cg".
    """

    def __init__(
        self,
        K: Matrix,
        method: AbstractMethod,
        name: str,
        near_null: Float[np.ndarray, "dofs modes"] | None,
        *,
        definite: bool,
    ):
        self.K = K
        self.name = name
        self._method = method
        self._near_null = near_null
        self._definite = definite
        self._spent = ""

    def solve(
        self,
        rhs: Columns,
        *,
        x0: Columns | None = None,
        rtol: float | None = None,
        throw: bool = True,
    ) -> Solution:
        """Solve K x = rhs; K is symmetric, so this is the adjoint solve too.

        One rule for all solvers: what counts is the true residual |rhs - K x| / |rhs|. Without
        `rtol`, 1e-10 is wanted and up to `RESIDUAL_LIMIT` accepted, since rounding of x alone leaves
        eps cond(K). With `rtol`, a residual above it is an error, of a direct solver too:
        `TOLERANCE_MISSED` up to `RESIDUAL_LIMIT`. Beyond that limit a miss is `NOT_CONVERGED` where
        the iterations ran out, else `INACCURATE`.

        Args:
            rhs: one right-hand side, or one a column.
            x0: starting point of an iterative solver.
            rtol: largest |rhs - K x| / |rhs|.
            throw: raise when the solve fails; otherwise the result says so.

        Raises:
            FeaError: the sentence of the `SolveResult` with the figures, when the solve failed and
                `throw`; always when the factor is spent, or a right-hand side, a starting point or
                `rtol` is malformed.
        """
        self.refuse_when_spent()
        if rtol is not None and not rtol > 0:
            raise FeaError(f"rtol is {rtol}; give a number above zero.")
        given = self._columns(rhs, "Loads")
        b = given[:, None] if given.ndim == 1 else given
        start = None if x0 is None else self._columns(x0, "Displacements to start from")
        if start is not None and start.shape != given.shape:
            raise FeaError(
                f"The starting point has shape {start.shape}, the load {given.shape}; give one for "
                "each load."
            )
        mode, figures = None, ""
        try:
            applied = self._applied(b, None if start is None else start.reshape(b.shape), rtol)
        except SolveFailure as failure:
            applied, result = Applied(np.full_like(b, np.nan), 0), failure.result
            mode, figures, residual = failure.mode, failure.figures, np.nan
        else:
            residual = relative_residual(self.K, applied.x, b)
            result = _judged(residual, rtol, cut_off=applied.cut_off)
            limit = f"limit {RESIDUAL_LIMIT:g}" if rtol is None else f"rtol {rtol:g}"
            figures = f"residual {residual:.2g}, {limit}"
            if not self._method.direct:
                figures += f", iterations {applied.iterations}"
        if throw:
            _throw(result, mode, figures)
        return Solution(applied.x.reshape(given.shape), residual, result, applied.iterations)

    def update(self, K: GivenMatrix) -> "Factor":
        """Factor of a matrix with the same pattern and other values; this one is spent afterwards.

        A direct solver keeps its ordering and symbolic factor, multigrid its hierarchy as long as
        that still converges well, JAX what it has compiled.

        Raises:
            FeaError: when K is singular, of another size, or this factor is spent. After a K that
                cannot be factorised this factor is lost, too.
        """
        self.refuse_when_spent()
        K = as_matrix(K)
        if matrix_shape(K) != matrix_shape(self.K):
            raise FeaError(
                f"The new stiffness has {matrix_shape(K)[0]} dofs, the old one "
                f"{matrix_shape(self.K)[0]}; factorise it afresh."
            )
        # Until that has succeeded the method is half old, half new.
        self._spent = "was lost when its update failed; factorise the stiffness afresh"
        del self.K  # so that a problem and the solution it starts from hold two matrices, not three
        factor = prepared(
            K, self._method, self.name, self._near_null, definite=self._definite, first=False
        )
        self._spent = "went into the factor that its update returned; use that one"
        return factor

    def free(self) -> None:
        """Release the memory of the factorisation now rather than at garbage collection."""
        if not self._spent:
            self._spent = "was freed; factorise the stiffness again"
            if matrix_shape(self.K)[0]:
                self._method.free()

    def _columns(self, given: Columns, what: str) -> Float[np.ndarray, "dofs ..."]:
        """What the caller gave, as float64, with a row for each dof."""
        values = as_float64(given, what)
        dofs = matrix_shape(self.K)[0]
        if values.ndim not in (1, 2) or len(values) != dofs:
            raise FeaError(
                f"{what} have shape {values.shape}, but the stiffness has {dofs} rows; give every dof "
                "one number a case."
            )
        return values

    def _applied(
        self,
        b: Float[np.ndarray, "dofs columns"],
        x0: Float[np.ndarray, "dofs columns"] | None,
        rtol: float | None,
    ) -> Applied:
        if not np.isfinite(b).all():
            raise SolveFailure(SolveResult.NOT_FINITE)
        if b.size == 0:
            return Applied(np.zeros_like(b), 0)
        if x0 is not None and not np.isfinite(x0).all():
            raise SolveFailure(SolveResult.NOT_FINITE)
        applied = self._method.apply(b, x0, AIM * (RELATIVE_RESIDUAL if rtol is None else rtol))
        if self._definite or not self._method.direct:
            check_solution(self.K, applied.x, b)
        return applied

    def refuse_when_spent(self) -> None:
        """Raise when this factor's matrix or factorisation is gone.

        Raises:
            FeaError: with what became of it.
        """
        if self._spent:
            raise FeaError(f"This factor cannot be used again: it {self._spent}.")


def prepared(
    K: Matrix,
    method: AbstractMethod,
    name: str,
    near_null: Float[np.ndarray, "dofs modes"] | None,
    *,
    definite: bool,
    first: bool = True,
) -> Factor:
    """Check a stiffness, whatever the solver, and make the method ready for it.

    Args:
        K: the stiffness.
        method: new, or the one that served a matrix of the same pattern.
        name: of the method.
        near_null: fields of almost no energy.
        definite: whether it is known that no motion is free.
        first: whether the pattern is new, and with it what can move.

    Raises:
        SingularStiffness: with the free motion where it is known.
        FeaError: when K is not finite or in single precision, or memory ran out.
    """
    try:
        check_matrix(K)
        if matrix_shape(K)[0]:
            if near_null is not None and not definite:
                check_rigid_motion(K, near_null)
            _make_ready(method, K, first=first, definite=definite)
    except SolveFailure as failure:
        _throw(failure.result, failure.mode, failure.figures)
    except MemoryError as error:
        raise FeaError(SolveResult.OUT_OF_MEMORY.value) from error
    return Factor(K, method, name, near_null, definite=definite)


def _make_ready(method: AbstractMethod, K: Matrix, *, first: bool, definite: bool) -> None:
    """Factorise; a singular matrix once more, a little stiffer, to find the motion that is free."""

    def solve(
        rhs: Float[np.ndarray, "dofs columns"], rtol: float = RELATIVE_RESIDUAL
    ) -> Float[np.ndarray, "dofs columns"]:
        return method.apply(rhs, None, rtol).x

    if not method.direct or isinstance(K, ElementOperator):
        # `factorise` gives operators to methods that take them.
        method.update(K)  # pyright: ignore[reportArgumentType]
        if first and method.probed and not definite:
            check_held(K, solve)
        return
    try:
        method.update(K)
        if not definite:
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


def _judged(residual: float, rtol: float | None, *, cut_off: bool) -> SolveResult:
    """The rule of `Factor.solve`; comparisons are such that NaN fails."""
    if residual <= (RESIDUAL_LIMIT if rtol is None else rtol):
        return SolveResult.CONVERGED
    if residual <= RESIDUAL_LIMIT:
        return SolveResult.TOLERANCE_MISSED
    return SolveResult.NOT_CONVERGED if cut_off else SolveResult.INACCURATE


def _throw(result: SolveResult, mode: Float[np.ndarray, " dofs"] | None, figures: str) -> None:
    if result is SolveResult.SINGULAR:
        raise SingularStiffness(result.value, mode)
    if result is not SolveResult.CONVERGED:
        raise FeaError(f"{result.value} ({figures})" if figures else result.value)
