"""Derivatives of anything made of displacements, by the adjoint method, for JAX and without it.

With u the solution of K u = f and g(u) any scalar, the adjoint λ solves K λ = ∂g/∂u with all supports
at zero, and

    dg = λ.df - λ'(dK) u + (∂g/∂u - K λ).du_prescribed,

(Haftka and Gürdal, Elements of Structural Optimization, 3rd ed., section 7.2), so one more solve with
the factor that is there gives the derivative with respect to everything. Where ∂g/∂u is a multiple
of the forces, as for compliance, λ is the same multiple of u and even that solve is saved.
"""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.equilibrium import AbstractSolution, known_parameters, on_host
from fea.problem import AbstractProblem
from fea.system import Assembled, times

ArrayLike = Array | np.ndarray


def compliance_gradient(
    solution: AbstractSolution, weights: Float[np.ndarray, " cases"] | None = None
) -> dict[str, np.ndarray]:
    """Derivatives of sum_c w_c (u.f)_c by each parameter, by `forces` and by `value`.

    Args:
        solution: the solved problem.
        weights: of the load cases; ones by default.

    Raises:
        FeaError: when supports move and the factor for the further solve is gone.
    """
    w = np.ones(len(solution.displacement)) if weights is None else weights
    w = w[:, None, None]
    gradient = _pulled_back(solution, w * solution.problem.loads)
    # u.f depends on the loads directly, too.
    return added(gradient, solution.problem.load_gradient(w * solution.displacement))


class Sequence:
    """Remembers, on purpose, the last solution of a sequence of similar problems.

    Each next one starts from it: symbolic factor or multigrid hierarchy are kept, the displacement
    is the first guess of an iterative solver. Answers differ by the solver's residual only. For one
    structure, and one `fea.displacement` in each evaluation of an objective: the factor serves
    the backward pass until the next forward pass takes it over.

    Attributes:
        last: the last solution; None before the first, and after a failure.
    """

    def __init__(self):
        self.last: AbstractSolution | None = None

    def solved(self, problem: AbstractProblem, *, solver: str) -> AbstractSolution:
        """The problem's solution, starting from the last one."""
        previous, self.last = self.last, None
        solution: AbstractSolution = problem.solved(previous=previous, solver=solver)
        self.last = solution
        return solution


def displacement(
    problem: AbstractProblem,
    *,
    solver: str = "auto",
    sequence: Sequence | None = None,
    **parameters: ArrayLike,
) -> Float[Array, "cases nodes block"]:
    """Displacements of every load case, as a function that JAX differentiates.

    `jax.grad` of any scalar made from them just works; its backward pass reuses the factor. The
    linear solver runs on the host: call and differentiate this outside `jax.jit` and `jax.vmap`.
    What else depends on a parameter, such as stress on `nodes`, must be given it too.

    Args:
        problem: gives all that is not replaced.
        solver: see `fea.linear_solve.factorise`.
        sequence: for an optimiser's steps; gives this solution a start, and the next one.
        **parameters: values to use and to differentiate by: any of `problem.parameters`, `forces`
            and `value`.

    Raises:
        FeaError: an unknown parameter, a call inside `jax.jit`, or what `equilibrium` raises.
    """
    known = {**problem.parameters, "forces": problem.forces, "value": problem.value}
    values = known_parameters(parameters, known, "this problem")
    return _displacement(problem, _Options(solver, sequence or Sequence()), values)


@dataclass(frozen=True, eq=False)
class _Options:
    solver: str
    sequence: Sequence


@jax.tree_util.register_static
@dataclass(frozen=True, eq=False)
class _Solved:
    """What the backward pass needs: nothing that JAX looks into."""

    solution: AbstractSolution
    names: tuple[str, ...]


@partial(jax.custom_vjp, nondiff_argnums=(0, 1))
def _displacement(problem: AbstractProblem, options: _Options, values: dict[str, Array]) -> Array:
    return _forward(problem, options, values)[0]


def _forward(problem: AbstractProblem, options: _Options, values: dict[str, Array]):
    host = {name: on_host(name, value) for name, value in values.items()}
    solution = options.sequence.solved(problem.with_parameters(host), solver=options.solver)
    return jnp.asarray(solution.displacement), _Solved(solution, tuple(values))


def _backward(problem: AbstractProblem, options: _Options, solved: _Solved, cotangent: Array):
    gradient = _pulled_back(solved.solution, on_host("cotangent", cotangent))
    return ({name: jnp.asarray(gradient[name]) for name in solved.names},)


_displacement.defvjp(_forward, _backward)


def _pulled_back(
    solution: AbstractSolution, cotangent: Float[np.ndarray, "cases nodes block"]
) -> dict[str, np.ndarray]:
    """From ∂g/∂u to the derivatives of g by everything that u depends on.

    With couplings, u = T q: what T changes of u works against what is not in balance without T,
    which are the forces that the couplings exert.
    """
    problem, form = solution.problem, solution.system.form
    u, K = solution.displacement, solution.system.K
    adjoint = solution.adjoint(np.where(problem.fixed, 0.0, cotangent))
    gradient = problem.bilinear_gradient(-adjoint, u)
    gradient = added(gradient, problem.load_gradient(adjoint))
    unbalanced = cotangent - times(K, adjoint)
    if isinstance(form, Assembled) and form.transfer is not None:
        exerted = problem.loads - times(K, u)
        by_points = form.transfer.gradient(unbalanced, u) + form.transfer.gradient(exerted, adjoint)
        gradient = added(gradient, {problem.positions: by_points})
    gradient["value"] = np.where(problem.fixed, form.gathered(unbalanced), 0.0).sum(axis=0)
    return gradient


def added(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The sum of two gradients; a name that one of them lacks counts as zero there."""
    return a | {name: a[name] + b[name] if name in a else b[name] for name in b}
