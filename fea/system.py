"""How the stiffness of a structure is held, without its supports and dependent nodes."""

import abc
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse import bsr_array

from fea.assembly import Pattern, Reduced
from fea.errors import FeaError
from fea.linear_solve import Factor
from fea.linear_solve.element_operator import MATRIX_FREE, ElementOperator
from fea.linear_solve.interface import Matrix
from fea.linear_solve.mkl_sparse import multiply
from fea.problem import AbstractProblem
from fea.transfer import Transfer


class AbstractForm(abc.ABC):
    """How a stiffness is held, and what becomes of it and of fields without the supports."""

    @abc.abstractmethod
    def stiffness(self, problem: AbstractProblem) -> tuple[Matrix, Matrix]:
        """K, and K without the prescribed and the dependent dofs."""

    @abc.abstractmethod
    def at(self, problem: AbstractProblem) -> "AbstractForm":
        """The form of the same structure with other positions."""

    @abc.abstractmethod
    def gathered(self, forces: Float[np.ndarray, "columns nodes block"]) -> np.ndarray:
        """Forces on the nodes that couplings leave, zero on the others."""

    @abc.abstractmethod
    def restrict(self, fields: Float[np.ndarray, "columns nodes block"]) -> np.ndarray:
        """Displacements, or gathered forces, as columns on the dofs of the reduced matrix.

        Zero on fixed dofs.
        """

    @abc.abstractmethod
    def expand(
        self, x: Float[np.ndarray, "dofs columns"], value: Float[np.ndarray, "nodes block"]
    ) -> Float[np.ndarray, "columns nodes block"]:
        """The inverse of `restrict` for displacements, with the prescribed value on fixed dofs."""


@dataclass(frozen=True, eq=False)
class Assembled(AbstractForm):
    """A sparse matrix on a fixed pattern.

    Attributes:
        pattern: where node pairs go.
        transfer: how dependent nodes follow the others; None without couplings.
        reduction: how supports and dependent nodes are eliminated.
    """

    pattern: Pattern
    transfer: Transfer | None
    reduction: Reduced

    @classmethod
    def of(cls, problem: AbstractProblem) -> "Assembled":
        """Find the pattern."""
        pattern = Pattern.from_groups(problem.groups, len(problem.points))
        transfer = _transfer(problem)
        if transfer is None:
            return cls(pattern, None, Reduced.from_pattern(pattern, problem.fixed))
        block = problem.fixed.shape[1]
        shape = (
            np.zeros((len(pattern.upper), block, block)),
            np.zeros((pattern.nodes, block, block)),
        )
        coupled = _congruent(transfer.matrix, pattern.matrix(*shape))
        gone = problem.fixed | transfer.dependent[:, None]
        return cls(pattern, transfer, Reduced.from_pattern(coupled, gone))

    def at(self, problem: AbstractProblem) -> "Assembled":
        """Couplings follow the positions."""
        return self if self.transfer is None else replace(self, transfer=_transfer(problem))

    def stiffness(self, problem: AbstractProblem) -> tuple[bsr_array, bsr_array]:
        """Assemble."""
        K = problem.stiffness(self.pattern)
        return K, self.reduced(K)

    def reduced(self, matrix: bsr_array, *, eigen: bool = False) -> bsr_array:
        """A matrix on the pattern without prescribed and dependent dofs, Tᵀ A T.

        Args:
            matrix: A.
            eigen: whether it is the right-hand matrix of an eigenproblem; see `Reduced.matrix`.
        """
        if self.transfer is not None:
            matrix = _congruent(self.transfer.matrix, matrix)
        return self.reduction.matrix(matrix, eigen=eigen)

    def gathered(self, forces: Float[np.ndarray, "columns nodes block"]) -> np.ndarray:
        """Tᵀ f."""
        return forces if self.transfer is None else self.transfer.gathered(forces)

    def restrict(self, fields: Float[np.ndarray, "columns nodes block"]) -> np.ndarray:
        """Independent nodes with a free dof only."""
        return self.reduction.restrict(np.moveaxis(fields, 0, -1))

    def expand(
        self, x: Float[np.ndarray, "dofs columns"], value: Float[np.ndarray, "nodes block"]
    ) -> Float[np.ndarray, "columns nodes block"]:
        """Whole fields."""
        if self.transfer is None:
            return self.reduction.expand(x, value)
        independent = np.where(self.transfer.dependent[:, None], 0.0, value)
        return self.transfer.spread(self.reduction.expand(x, independent))


@dataclass(frozen=True, eq=False)
class MatrixFree(AbstractForm):
    """Products of elements, never summed into a matrix; fixed dofs stay as uncoupled unknowns.

    Attributes:
        fixed: dofs whose displacement is prescribed.
    """

    fixed: Bool[np.ndarray, "nodes block"]

    def stiffness(self, problem: AbstractProblem) -> tuple[ElementOperator, ElementOperator]:
        """Two rules, with and without supports."""
        return problem.operator(np.zeros_like(self.fixed)), problem.operator(self.fixed)

    def at(self, problem: AbstractProblem) -> "MatrixFree":
        """The same."""
        return self

    def gathered(self, forces: Float[np.ndarray, "columns nodes block"]) -> np.ndarray:
        """All of them: there are no couplings."""
        return forces

    def restrict(self, fields: Float[np.ndarray, "columns nodes block"]) -> np.ndarray:
        """All nodes."""
        return np.where(self.fixed, 0.0, fields).reshape(len(fields), -1).T.copy()

    def expand(
        self, x: Float[np.ndarray, "dofs columns"], value: Float[np.ndarray, "nodes block"]
    ) -> Float[np.ndarray, "columns nodes block"]:
        """Whole fields."""
        return np.where(self.fixed, value, x.T.reshape(-1, *self.fixed.shape))


@dataclass(frozen=True, eq=False)
class System:
    """What a solved problem leaves for the next: the same elements and supports, other values.

    Attributes:
        form: pattern and elimination of supports.
        K: stiffness without supports.
        factor: of the reduced stiffness.
    """

    form: AbstractForm
    K: Matrix
    factor: Factor


def form_of(problem: AbstractProblem, solver: str) -> AbstractForm:
    """The form of a structure that is solved for the first time.

    Raises:
        FeaError: for couplings and a solver that takes none.
    """
    if solver != MATRIX_FREE:
        return Assembled.of(problem)
    if problem.couplings:
        raise FeaError(
            f'Solver "{MATRIX_FREE}" takes no couplings; choose "auto", or leave the couplings out.'
        )
    return MatrixFree(problem.fixed)


def _transfer(problem: AbstractProblem) -> Transfer | None:
    if not problem.couplings:
        return None
    return Transfer.of(problem.couplings, problem.points)


def _congruent(T: bsr_array, A: bsr_array) -> bsr_array:
    """Tᵀ A T in the blocks of A, its columns sorted."""
    mirror = bsr_array(T.T)
    return multiply(multiply(mirror, A, ordered=False), T)


def times(
    K: Matrix, u: Float[np.ndarray, "cases nodes block"]
) -> Float[np.ndarray, "cases nodes block"]:
    """K u of several fields."""
    return (K @ u.reshape(len(u), -1).T).T.reshape(u.shape)
