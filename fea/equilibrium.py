"""K u = f of any linear structure: several load cases on one factor.

A structure is a problem: its parameters (node positions, moduli, radii ...), what is prescribed, and
its forces. `fea.adjoint` differentiates its solution.
"""

import abc
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.boundary_conditions import check_loads, load_on_supports
from fea.errors import FeaError, position_text
from fea.linear_solve import factorise
from fea.linear_solve.element_operator import matrix_shape
from fea.linear_solve.interface import SingularStiffness
from fea.mechanisms import describe_mode
from fea.precision import as_float64, require_x64
from fea.problem import AbstractProblem
from fea.rigid_motion import rigid_body_modes
from fea.system import AbstractForm, System, form_of, times

ArrayLike = Array | np.ndarray


# Largest difference between ∂g/∂u and a multiple of the forces that is rounding, relative.
SAME_DIRECTION = 1e-13


Problem = TypeVar("Problem", bound=AbstractProblem)


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
    form = form_of(problem, solver) if previous is None else previous.system.form.at(problem)
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


def known_parameters(
    given: Mapping[str, ArrayLike], known: Mapping[str, np.ndarray], owner: str
) -> dict[str, Array]:
    """Parameters given by name, in JAX.

    Args:
        given: by the user.
        known: the owner's own, by name.
        owner: what has parameters, for messages: "this problem".

    Raises:
        FeaError: for a name that the owner does not have, or another shape.
    """
    for name, value in given.items():
        if name not in known:
            raise FeaError(f'"{name}" is no parameter of {owner}; choose from {", ".join(known)}.')
        if np.shape(value) != np.shape(known[name]):
            raise FeaError(
                f'"{name}" has shape {np.shape(value)} here; {owner} needs {np.shape(known[name])}.'
            )
    return {name: jnp.asarray(value) for name, value in given.items()}
