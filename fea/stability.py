"""Linear buckling of frames and their skins: at which multiple of a load they lose their stability.

The stiffness under lambda times the load is K + lambda Kg, with Kg, the geometric stiffness, linear in
the displacements of the load: that of struts, of skins and of the arms of couplings, which a force along
them turns (Cook, Malkus, Plesha, Witt, Concepts and Applications of Finite Element
Analysis, 4th ed., chapter 18). Where it is first singular, K x = lambda (-Kg) x, the structure buckles
in the shape x. Deflections before that are neglected, imperfections too: real structures fail earlier.
A strut between two joints is one element here: its own load comes out 22 % high between ends that turn
freely, and not at all between ends that cannot turn; with two elements a strut 0.75 %, with four 0.05 %
high. `fea.strut_strength` has Euler's load of each strut.
"""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.adjoint import Sequence, displacement
from fea.eigenpairs import EigenPairs, EigenResult, lowest_eigenpairs
from fea.errors import FeaError
from fea.frame import FrameProblem, FrameSolution
from fea.frame_eigen import Prestress, assembled, check_simple, eigenvalue_gradient

ArrayLike = Array | np.ndarray

# Share of its displacement by which a strut may get shorter for the solver's residual alone. A strut that
# is bent 1000 times as long as thick, under as much force along as across, gets shorter by 1e-6 of it.
NO_GROWTH = 1e-9


@dataclass(frozen=True, eq=False)
class Buckling:
    """The lowest buckling factors of one load case.

    Attributes:
        factors: multiples of the load at which the structure buckles, ascending, repeated ones
            repeated; NaN beyond those that exist.
        shapes: how it buckles, the largest displacement of a joint being one.
        residual: largest |(K + factor Kg) x| / |K x| of them.
        result: how the analysis ended.
    """

    factors: Float[np.ndarray, " modes"]
    shapes: Float[np.ndarray, "modes joints 6"]
    residual: float
    result: EigenResult


def buckling(
    solution: FrameSolution, *, case: int = 0, modes: int = 1, throw: bool = True
) -> Buckling:
    """Find the lowest positive factors of a load case at which a frame buckles.

    Args:
        solution: the solved frame; its factor is used and stays usable.
        case: which load is multiplied, prescribed displacements with it.
        modes: how many factors.
        throw: raise when there are not so many or they do not converge; otherwise the result says
            so.

    Raises:
        FeaError: when nothing is in compression, when `throw` as said there, for a load case that does
            not exist, and for a solution without assembled stiffness or whose factor is spent.
    """
    found = _eigenpairs(solution, case, modes, throw=throw)
    shapes = _fields(solution, found.vectors)
    residual = float(np.nanmax(found.residual, initial=0.0))
    return Buckling(found.values, scaled(shapes), residual, found.result)


def buckling_factor(
    problem: FrameProblem,
    *,
    case: int = 0,
    mode: int = 0,
    solver: str = "auto",
    sequence: Sequence | None = None,
    **parameters: ArrayLike,
) -> Float[Array, ""]:
    """A buckling factor as a function that JAX differentiates.

    As `fea.displacement`, which it calls: outside `jax.jit` and `jax.vmap`, for the parameters that
    are given by name. The derivative holds what the parameters change of the forces in the struts,
    at the cost of one more solve.

    Args:
        problem: gives all that is not replaced.
        case: which load is multiplied.
        mode: which factor, 0 being the lowest.
        solver: see `fea.linear_solve.factorise`.
        sequence: for an optimiser's steps; see `fea.displacement`.
        **parameters: values to use and to differentiate by.

    Raises:
        FeaError: as `buckling` does, and when a repeated factor is to be differentiated.
    """
    steps = sequence or Sequence()
    u = displacement(problem, solver=solver, sequence=steps, **parameters)
    values = {name: jnp.asarray(value) for name, value in parameters.items()}
    return _factor(_Wanted(steps, case, mode), values, u)


def scaled(shapes: Float[np.ndarray, "modes joints 6"]) -> Float[np.ndarray, "modes joints 6"]:
    """Modes with the largest displacement of a joint one, its largest component positive.

    A mode that only turns its joints has the largest rotation one.
    """
    result = np.zeros_like(shapes)
    for mode, shape in enumerate(shapes):
        turns = not shape[:, :3].any()
        size = np.linalg.norm(shape[:, 3:] if turns else shape[:, :3], axis=1)
        joint = int(size.argmax())
        if size[joint] > 0:
            part = shape[joint, 3:] if turns else shape[joint, :3]
            result[mode] = shape / (size[joint] * np.sign(part[np.abs(part).argmax()]))
    return result


def _eigenpairs(solution: FrameSolution, case: int, modes: int, *, throw: bool) -> EigenPairs:
    frame, system = solution.problem, solution.system
    form = assembled(system.form)
    if not 0 <= case < len(solution.displacement):
        raise FeaError(
            f"Load case {case} does not exist; the frame has cases 0 to "
            f"{len(solution.displacement) - 1}."
        )
    right = Prestress(solution, case)
    B = form.reduced(right.matrix(frame, form.pattern), eigen=True)
    turned = right.arms is not None and _loaded(frame, case, right.arms)
    if frame.skin is None and not turned and not _compressed(frame, right.displacement):
        B.data[:] = 0.0  # what is left of it is rounding
    return lowest_eigenpairs(system.factor, B, modes=modes, throw=throw)


def _compressed(frame: FrameProblem, u: Float[np.ndarray, "joints 6"]) -> bool:
    """Whether any strut gets shorter."""
    axis = np.diff(frame.joints[frame.struts], axis=1)[:, 0]
    ends = u[frame.struts, :3]
    growth = np.einsum("si,si->s", axis, ends[:, 1] - ends[:, 0]) / np.linalg.norm(axis, axis=1)
    return bool((growth < -NO_GROWTH * np.linalg.norm(ends, axis=2).max(axis=1)).any())


def _loaded(frame: FrameProblem, case: int, arms: Float[np.ndarray, "joints 3 3"]) -> bool:
    """Whether arms of couplings carry more than what the solver's residual makes of no force."""
    moment = np.abs(frame.loads[case, :, :3]).max() * np.ptp(frame.joints, axis=0).max()
    return bool(np.abs(arms).max() > NO_GROWTH * moment)


def _fields(
    solution: FrameSolution, vectors: Float[np.ndarray, "dofs modes"]
) -> Float[np.ndarray, "modes joints 6"]:
    return solution.system.form.expand(vectors, np.zeros_like(solution.problem.value))


@dataclass(frozen=True, eq=False)
class _Wanted:
    sequence: Sequence
    case: int
    mode: int

    @property
    def solution(self) -> FrameSolution:
        """The solution that the displacements come from."""
        last = self.sequence.last
        if not isinstance(last, FrameSolution):
            raise FeaError("Buckling factors are those of a FrameProblem; give one.")
        return last


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _factor(wanted: _Wanted, values: dict[str, Array], u: Array) -> Array:
    found = _eigenpairs(wanted.solution, wanted.case, wanted.mode + 1, throw=True)
    return jnp.asarray(found.values[wanted.mode])


def _forward(
    wanted: _Wanted, values: dict[str, Array], u: Array
) -> tuple[Array, tuple[dict[str, Array], Array]]:
    solution, mode = wanted.solution, wanted.mode
    # One more, to see whether the factor is simple.
    found = _eigenpairs(solution, wanted.case, mode + 2, throw=False)
    check_simple(found, mode, "Buckling factor")
    factor = float(found.values[mode])
    x = _fields(solution, found.vectors[:, [mode]])[0] * np.sqrt(factor)
    right = Prestress(solution, wanted.case)
    form = assembled(solution.system.form)
    by, by_u = eigenvalue_gradient(solution.problem, form, right, factor, x)
    gradient = {
        name: jnp.asarray(by[name]) if name in by else jnp.zeros_like(value)
        for name, value in values.items()
    }
    return jnp.asarray(factor), (gradient, jnp.zeros_like(u).at[wanted.case].set(by_u))


def _backward(
    wanted: _Wanted, slopes: tuple[dict[str, Array], Array], cotangent: Array
) -> tuple[dict[str, Array], Array]:
    return jax.tree.map(lambda slope: cotangent * slope, slopes)


_factor.defvjp(_forward, _backward)
