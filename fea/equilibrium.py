"""K u = f of any linear structure: several load cases on one factor.

A structure is a problem: its parameters (node positions, moduli, radii ...), what is prescribed, and
its forces. `fea.adjoint` differentiates its solution.
"""

import abc
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, TypeVar, cast

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse import bsr_array

from fea.assembly import Pattern, Reduced
from fea.boundary_conditions import check_loads, load_on_supports
from fea.couplings import AbstractCoupling
from fea.errors import FeaError, position_text
from fea.linear_solve import Factor, factorise
from fea.linear_solve.element_operator import MATRIX_FREE, ElementOperator, matrix_shape
from fea.linear_solve.interface import Matrix, SingularStiffness
from fea.linear_solve.mkl_sparse import multiply
from fea.mechanisms import describe_mode
from fea.precision import as_float64, require_x64
from fea.rigid_motion import rigid_body_modes
from fea.transfer import Transfer

ArrayLike = Array | np.ndarray


# Largest difference between ∂g/∂u and a multiple of the forces that is rounding, relative.
SAME_DIRECTION = 1e-13


class AbstractProblem(abc.ABC):
    """A linear structure, its supports and its loads.

    A leaf is a frozen dataclass with, beside its parameters, the fields

    * `fixed: Bool[nodes, block]`: which dofs are prescribed,
    * `value: Float[nodes, block]`: their values, ignored on free dofs,
    * `forces: Float[cases, nodes, block]`: what acts on each dof.

    Attributes:
        positions: name of the parameter that holds `points`.
        couplings: what makes nodes follow others; structures of six dofs a node only.
    """

    positions: ClassVar[str]
    couplings: tuple[AbstractCoupling, ...] = ()

    fixed: Bool[np.ndarray, "nodes block"]
    value: Float[np.ndarray, "nodes block"]
    forces: Float[np.ndarray, "cases nodes block"]

    @property
    @abc.abstractmethod
    def proves_definite(self) -> bool:
        """Whether `check` shows that no motion is free, so that the solver need not look for one."""

    @property
    @abc.abstractmethod
    def points(self) -> Float[np.ndarray, "nodes 3"]:
        """Positions of the nodes [mm]."""

    @property
    @abc.abstractmethod
    def groups(self) -> tuple[Int[np.ndarray, "_ _"], ...]:
        """Nodes of each element, group by group; all elements of a group have equally many."""

    @property
    @abc.abstractmethod
    def loads(self) -> Float[np.ndarray, "cases nodes block"]:
        """All that acts on the nodes: `forces`, and the consistent forces of other loads."""

    @property
    @abc.abstractmethod
    def parameters(self) -> dict[str, np.ndarray]:
        """What the stiffness depends on and can be differentiated by, by name."""

    @abc.abstractmethod
    def with_parameters(self, values: Mapping[str, np.ndarray]) -> "AbstractProblem":
        """The same problem with some parameters, `forces` or `value` replaced."""

    @abc.abstractmethod
    def check(self) -> None:
        """Refuse what cannot be solved, by name.

        Raises:
            FeaError: with what is wrong, where, and the remedy.
        """

    @abc.abstractmethod
    def stiffness(self, pattern: Pattern) -> bsr_array:
        """K of the structure without its supports, in whole blocks of a node's dofs."""

    @abc.abstractmethod
    def operator(self, fixed: Bool[np.ndarray, "nodes block"]) -> ElementOperator:
        """K as a rule for products that is never assembled; fixed dofs act as identity."""

    @abc.abstractmethod
    def solved(self, *, previous: Any = None, solver: str = "auto") -> "AbstractSolution":
        """The solution, by `equilibrium`."""

    @abc.abstractmethod
    def bilinear_gradient(
        self,
        v: Float[np.ndarray, "cases nodes block"],
        u: Float[np.ndarray, "cases nodes block"],
    ) -> dict[str, np.ndarray]:
        """Derivative of sum_c v_c' K u_c by each of `parameters`, v and u held."""

    @abc.abstractmethod
    def load_gradient(self, v: Float[np.ndarray, "cases nodes block"]) -> dict[str, np.ndarray]:
        """Derivative of sum_c v_c' loads_c by `forces` and the parameters that loads depend on."""


Problem = TypeVar("Problem", bound=AbstractProblem)


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


@dataclass(frozen=True, eq=False)
class AbstractSolution(abc.ABC):
    """A solved problem.

    Attributes:
        problem: what was solved.
        displacement: of each dof: [mm], and [rad] where nodes carry rotations.
        residual: largest true |f - K u| / |f| of the reduced system over the cases.
        iterations: of an iterative solver; 0 for a direct one.
        system: for the next solve of the same structure, and for adjoint solves.
    """

    problem: AbstractProblem
    displacement: Float[np.ndarray, "cases nodes block"]
    residual: float
    iterations: int
    system: System

    @cached_property
    def compliance(self) -> Float[np.ndarray, " cases"]:
        """Work u.f of the forces of each case [N mm]."""
        return np.einsum("cni,cni->c", self.problem.loads, self.displacement)

    @cached_property
    def reaction(self) -> Float[np.ndarray, "cases nodes block"]:
        """What the supports exert on the structure [N, N mm]; zero on free dofs."""
        inner = times(self.system.K, self.displacement) - self.problem.loads
        return np.where(self.problem.fixed, self.system.form.gathered(inner), 0.0)

    @cached_property
    def load_on_supports(self) -> Float[np.ndarray, " cases"]:
        """Share of each case's forces that acts on fixed dofs and so loads nothing."""
        gathered = self.system.form.gathered(self.problem.loads)
        return load_on_supports(self.problem.fixed, gathered)

    def adjoint(
        self, load: Float[np.ndarray, "cases nodes block"]
    ) -> Float[np.ndarray, "cases nodes block"]:
        """K⁻¹ load with all supports at zero, by the factor at hand.

        Cases whose load is a multiple of the problem's loads, on free dofs, cost nothing when the
        supports do not move.

        Raises:
            FeaError: when the factor went into a later solution, or the solve fails.
        """
        free, form = ~self.problem.fixed, self.system.form
        at_rest = not _moves(self.problem)
        gathered, forces = form.gathered(load), form.gathered(self.problem.loads)
        result = np.zeros_like(load)
        unknown = []
        for case in range(len(load)):
            b, f = gathered[case][free], forces[case][free]
            share = (b @ f) / (f @ f) if at_rest and f.any() else 0.0
            if np.abs(b - share * f).max(initial=0.0) <= SAME_DIRECTION * np.abs(b).max(
                initial=0.0
            ):
                result[case] = share * self.displacement[case]
            else:
                unknown.append(case)
        if unknown:
            x = self.system.factor.solve(form.restrict(gathered[unknown])).x
            result[unknown] = form.expand(x, np.zeros_like(self.problem.value))
        return result


def equilibrium(
    problem: Problem, *, previous: AbstractSolution | None = None, solver: str = "auto"
) -> tuple[Problem, Float[np.ndarray, "cases nodes block"], float, int, System]:
    """Solve all load cases with one factor.

    Args:
        problem: what to solve.
        previous: solution of a problem with the same elements and supports and other values; its
            pattern, the symbolic part of its factor or its multigrid hierarchy are reused, and its
            displacements are the first guess. It can still be read afterwards, but its factor is
            spent.
        solver: see `fea.linear_solve.factorise`; with `previous`, that of its factor.

    Returns:
        The fields of a solution: the problem, its numbers in float64, displacements, largest
        residual, most iterations, and the system.

    Raises:
        FeaError: when the problem is malformed, can move freely, or the solve fails.
    """
    require_x64()
    problem = _checked(problem)
    if previous is not None:
        _check_same(problem, previous, solver)
    problem.check()
    # Loads within elements act, and moved supports do, whatever is fixed.
    active = _moves(problem) or bool((problem.loads != problem.forces).any())
    check_loads(problem.fixed, problem.loads, moved=active, points=problem.points)
    form = _form(problem, solver) if previous is None else previous.system.form.at(problem)
    gathered = form.gathered(problem.loads)
    if problem.couplings:
        check_loads(problem.fixed, gathered, moved=active, points=problem.points)
    K, reduced = form.stiffness(problem)
    value = np.where(problem.fixed, problem.value, 0.0)
    if value.any():
        moved = form.expand(np.zeros((matrix_shape(reduced)[0], 1)), value)
        gathered = gathered - form.gathered(times(K, moved))
    guess = None
    if previous is not None and previous.displacement.shape == gathered.shape:
        guess = form.restrict(previous.displacement)
    try:
        if previous is None:
            factor = factorise(
                reduced,
                near_null=_rigid_modes(problem, form),
                solver=solver,
                definite=problem.proves_definite,
            )
        else:
            factor = previous.system.factor.update(reduced)
        solved = factor.solve(form.restrict(gathered), x0=guess)
    except SingularStiffness as failure:
        raise _named(failure, problem, form) from failure
    u = form.expand(solved.x, value)
    return problem, u, solved.residual, solved.iterations, System(form, K, factor)


def _form(problem: AbstractProblem, solver: str) -> AbstractForm:
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


def _checked(problem: Problem) -> Problem:
    """The problem with all its numbers in float64 on the host, and of matching shapes."""
    given = {**problem.parameters, "forces": problem.forces, "value": problem.value}
    host = {name: on_host(name, value) for name, value in given.items()}
    changed = {name: host[name] for name in host if host[name] is not given[name]}
    if changed:
        problem = cast(Problem, problem.with_parameters(changed))
    nodes, fixed = len(problem.points), problem.fixed.shape
    if fixed[0] != nodes:
        raise FeaError(f'"fixed" has shape {fixed}; {nodes} nodes need as many rows.')
    if problem.value.shape != fixed:
        raise FeaError(f'"value" has shape {problem.value.shape}; {nodes} nodes need {fixed}.')
    held = np.argwhere(problem.fixed & ~np.isfinite(problem.value))
    if len(held):
        node, dof = held[0]
        raise FeaError(
            f"The displacement prescribed at node {node}, {position_text(problem.points[node])} mm, dof "
            f"{dof}, is {problem.value[node, dof]}, not a number; give one, or free the dof."
        )
    return problem


def _rigid_modes(problem: AbstractProblem, form: AbstractForm) -> Float[np.ndarray, "dofs 6"]:
    block = problem.fixed.shape[1]
    modes = rigid_body_modes(problem.points, rotations=block == 6)
    return form.restrict(np.moveaxis(modes.reshape(-1, block, 6), -1, 0))


def _named(
    failure: SingularStiffness, problem: AbstractProblem, form: AbstractForm
) -> SingularStiffness:
    """The same failure, with the motion that nothing resists in words."""
    if failure.mode is None:
        return failure
    mode = form.expand(failure.mode[:, None], np.zeros_like(problem.value))[0, :, :3]
    if not mode.any():  # joints that turn on the spot
        return failure
    words = describe_mode(problem.points, mode)
    return SingularStiffness(f"{failure} What moves: {words}.", failure.mode)


def _moves(problem: AbstractProblem) -> bool:
    """Whether a support prescribes more than standing still."""
    return bool((problem.fixed & (problem.value != 0)).any())


def _check_same(problem: AbstractProblem, previous: AbstractSolution, solver: str) -> None:
    before = previous.problem
    same = {
        "elements": len(problem.groups) == len(before.groups)
        and all(map(_equal, problem.groups, before.groups)),
        "supports": _equal(problem.fixed, before.fixed),
        "couplings": problem.couplings == before.couplings,
    }
    for word, agrees in same.items():
        if not agrees:
            raise FeaError(f"The previous solution has other {word}; solve without it.")
    used = previous.system.factor.name
    if solver not in ("auto", used):
        raise FeaError(
            f'The previous solution was solved by "{used}", not by "{solver}"; solve without it.'
        )


def _equal(a: np.ndarray, b: np.ndarray) -> bool:
    return a is b or np.array_equal(a, b)


def times(
    K: Matrix, u: Float[np.ndarray, "cases nodes block"]
) -> Float[np.ndarray, "cases nodes block"]:
    """K u of several fields."""
    return (K @ u.reshape(len(u), -1).T).T.reshape(u.shape)


def on_host(name: str, value: ArrayLike) -> np.ndarray:
    """A float64 array that the solver can read.

    Raises:
        FeaError: when JAX is tracing it, or it is in single precision.
    """
    try:
        return as_float64(value, f'Values of "{name}"')
    except jax.errors.TracerArrayConversionError as failure:
        raise FeaError(
            f'"{name}" is being traced by JAX, but the solver runs on the host: give it to '
            "fea.displacement by name, and call that outside jax.jit, jax.vmap and jax.jacrev "
            "(take rows of a Jacobian by jax.grad)."
        ) from failure
