"""Natural frequencies of frames and their skins: K x = omega² M x, undamped, without prestress.

A structure that nothing holds moves rigidly at frequency zero. Those motions are known, so they are left
out of the iteration, and K + s M, s of the size of the lowest omega², takes the place of the singular
stiffness: its eigenvalues are omega² + s, its modes the same (Bathe, Finite Element Procedures, 2nd ed.,
section 10.2.3).
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.sparse import bsr_array

from fea.adjoint import ArrayLike
from fea.eigenpairs import EigenPairs, EigenResult, lowest_eigenpairs
from fea.equilibrium import on_host
from fea.errors import FeaError
from fea.frame import FrameProblem
from fea.frame_eigen import Inertia, check_simple, eigenvalue_gradient
from fea.linear_solve import factorise
from fea.linear_solve.element_operator import MATRIX_FREE
from fea.mechanisms import describe_mode
from fea.precision import require_x64
from fea.rigid_motion import extent_of, null_space, rigid_body_modes, rigid_modes
from fea.stability import scaled
from fea.system import Assembled, times

# Smallest shift of a free structure, as a share of K over M of a typical dof: far above rounding.
LEAST_SHIFT = 1e-9

# Share of the shift below which omega² is rounding.
NOTHING = 1e-10


@dataclass(frozen=True, eq=False)
class Vibration:
    """The lowest natural frequencies of a frame.

    Attributes:
        frequencies: ascending, repeated ones repeated [Hz]; without the rigid motions of a structure
            that is not held; NaN beyond those that exist.
        shapes: the modes, the largest displacement of a joint being one.
        residual: largest |K x - omega² M x| / |K x| of them, with K + s M for K where nothing holds
            the structure.
        result: how the analysis ended.
        effective_mass: part of the mass that each mode moves when the supports shake along x, y, z
            [tonne]; over all modes they sum to the mass that is not on supports.
        mass: all of it [tonne].
    """

    frequencies: Float[np.ndarray, " modes"]
    shapes: Float[np.ndarray, "modes joints 6"]
    residual: float
    result: EigenResult
    effective_mass: Float[np.ndarray, "modes 3"]
    mass: float


def vibration(
    frame: FrameProblem,
    inertia: Inertia,
    *,
    modes: int = 1,
    solver: str = "auto",
    throw: bool = True,
) -> Vibration:
    """Find the lowest natural frequencies of a frame; its loads do not matter.

    Args:
        frame: the frame, held or free.
        inertia: what has mass.
        modes: how many frequencies.
        solver: see `fea.linear_solve.factorise`; one that assembles the stiffness.
        throw: raise when there are not so many or they do not converge; otherwise the result says
            so.

    Raises:
        FeaError: when the frame is malformed, falls into pieces that nothing holds, or nothing has
            mass; when `throw` as said there.
    """
    system = _System.of(frame, inertia, solver)
    found = system.modes(modes, throw=throw)
    form = system.form
    shapes = scaled(form.expand(found.vectors, np.zeros(frame.fixed.shape)))
    unit = np.zeros((3, *frame.fixed.shape))
    unit[np.arange(3), :, np.arange(3)] = 1.0
    moved = times(system.M, unit)
    modal = np.einsum("mji,mji->m", shapes, times(system.M, shapes))
    share = np.einsum("mji,kji->mk", shapes, moved)
    effective = share**2 / np.where(modal > 0, modal, np.nan)[:, None]
    return Vibration(
        np.sqrt(found.values) / (2 * np.pi),
        shapes,
        float(np.nanmax(found.residual, initial=0.0)),
        found.result,
        effective,
        float(np.vdot(unit[0], moved[0])),
    )


def frequency(
    frame: FrameProblem,
    inertia: Inertia,
    *,
    mode: int = 0,
    solver: str = "auto",
    **parameters: ArrayLike,
) -> Float[Array, ""]:
    """A natural frequency [Hz] as a function that JAX differentiates.

    As `fea.displacement`: outside `jax.jit` and `jax.vmap`, for the parameters given by name.

    Args:
        frame: gives all that is not replaced.
        inertia: what has mass.
        mode: which frequency, 0 being the lowest.
        solver: see `vibration`.
        **parameters: values to use and to differentiate by: any of `frame.parameters`.

    Raises:
        FeaError: as `vibration` does, for an unknown parameter, and when a repeated frequency is to be
            differentiated.
    """
    for name, value in parameters.items():
        known = frame.parameters
        if name not in known or np.shape(value) != known[name].shape:
            choice = ", ".join(f"{key} {own.shape}" for key, own in known.items())
            raise FeaError(
                f'"{name}" of shape {np.shape(value)} is no parameter of this frame; choose from '
                f"{choice}."
            )
    values = {name: jnp.asarray(value) for name, value in parameters.items()}
    squared = jnp.asarray(_squared(_Wanted(frame, inertia, mode, solver), values))
    return jnp.sqrt(squared) / (2 * np.pi)


@dataclass(frozen=True, eq=False)
class _System:
    """Stiffness and mass, ready for eigenvalues.

    Attributes:
        frame: the frame.
        form: how supports leave its matrices.
        K: the reduced stiffness.
        M: the mass without supports removed.
        rigid: motions that nothing resists, on the reduced dofs.
    """

    frame: FrameProblem
    form: Assembled
    K: bsr_array
    M: bsr_array
    rigid: Float[np.ndarray, "dofs free"]
    solver: str

    @classmethod
    def of(cls, frame: FrameProblem, inertia: Inertia, solver: str) -> "_System":
        """Check and assemble."""
        require_x64()
        if solver == MATRIX_FREE:
            raise FeaError(f'Frequencies need an assembled stiffness; "{MATRIX_FREE}" has none.')
        host = {name: on_host(name, value) for name, value in frame.parameters.items()}
        frame = cast(FrameProblem, frame.with_parameters(host))
        _check(frame)
        inertia.check(frame)
        form = Assembled.of(frame)
        _, K = form.stiffness(frame)
        M = inertia.matrix(frame, form.pattern)
        return cls(frame, form, K, M, _on_reduced(form, _free(frame)), solver)

    def modes(self, modes: int, *, throw: bool) -> EigenPairs:
        """Eigenvalues omega² of the motions that are not rigid."""
        frame, form = self.frame, self.form
        M = form.reduced(self.M, eigen=True)
        shift = _shift(frame, self.K, M) if self.rigid.shape[1] else 0.0
        K = bsr_array((self.K.data + shift * M.data, self.K.indices, self.K.indptr), self.K.shape)
        all_motions = rigid_body_modes(frame.joints, rotations=True).reshape(
            len(frame.joints), 6, 6
        )
        definite = frame.proves_definite or bool(self.rigid.shape[1])
        near_null = _on_reduced(form, all_motions)
        factor = factorise(K, near_null=near_null, solver=self.solver, definite=definite)
        found = lowest_eigenpairs(factor, M, modes=modes, without=self.rigid, throw=throw)
        # x' M x = 1 instead of x' (K + s M) x = 1
        vectors = found.vectors * np.sqrt(np.nan_to_num(found.values))
        squared = found.values - shift
        loose = np.flatnonzero(squared <= NOTHING * shift)
        if len(loose):
            shape = form.expand(found.vectors[:, loose[:1]], np.zeros(frame.fixed.shape))[0]
            raise FeaError(
                "The frame moves without resistance, and not as one rigid body: "
                f"{describe_mode(frame.joints, shape[:, :3])}; join its parts."
            )
        return EigenPairs(squared, vectors, found.residual, found.result, found.steps)


def _free(frame: FrameProblem) -> Float[np.ndarray, "joints 6 free"]:
    """Rigid motions of the whole frame that its supports leave."""
    centre = frame.joints.mean(axis=0)
    extent = extent_of(frame.joints, centre)
    motions = rigid_modes(frame.joints, centre, extent, rotations=True)
    weighed = motions.copy()
    weighed[:, 3:] *= extent  # angles weigh as much as displacements
    return motions @ null_space(weighed[frame.fixed])


def _check(frame: FrameProblem) -> None:
    """Refuse all that a solve refuses, but not that a whole frame is free."""
    sound = np.isfinite(frame.joints).all() and frame.fixed.shape == (len(frame.joints), 6)
    free = sound and _free(frame).shape[2]
    (_anchored(frame) if free else frame).check()


def _anchored(frame: FrameProblem) -> FrameProblem:
    """A free frame with one joint held, so that a second piece would still be free."""
    followers = [coupling.followers for coupling in frame.couplings]
    joints = np.unique(np.concatenate([group.ravel() for group in frame.groups]))
    own = np.setdiff1d(joints, np.concatenate([np.zeros(0, dtype=joints.dtype), *followers]))
    fixed = frame.fixed.copy()
    fixed[own[:1]] = True
    return replace(frame, fixed=fixed)


def _on_reduced(
    form: Assembled, motions: Float[np.ndarray, "joints 6 columns"]
) -> Float[np.ndarray, "dofs columns"]:
    return form.restrict(np.moveaxis(motions, -1, 0))


def _shift(frame: FrameProblem, K: bsr_array, M: bsr_array) -> float:
    """About the lowest omega² of a free frame [1/s²], no matter how roughly.

    Of a slender beam it falls from that of one element, K over M, with the fourth power of their
    number along it; of a body with the second.
    """
    k, m = (np.asarray(A.diagonal(), dtype=np.float64) for A in (K, M))
    typical = float(np.median(np.divide(k[m > 0], m[m > 0])))
    ends = np.concatenate([group[:, :2] for group in frame.groups])
    element = np.linalg.norm(np.diff(frame.joints[ends], axis=1)[:, 0], axis=1).mean()
    size = np.ptp(frame.joints, axis=0).max()
    return typical * max(float(element / size) ** 4, LEAST_SHIFT)


@dataclass(frozen=True, eq=False)
class _Wanted:
    frame: FrameProblem
    inertia: Inertia
    mode: int
    solver: str

    def system(self, values: dict[str, Array]) -> _System:
        """The system at other parameters."""
        host = {name: on_host(name, value) for name, value in values.items()}
        return _System.of(self.frame.with_parameters(host), self.inertia, self.solver)


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _squared(wanted: _Wanted, values: dict[str, Array]) -> Array:
    found = wanted.system(values).modes(wanted.mode + 1, throw=True)
    return jnp.asarray(found.values[wanted.mode])


def _forward(wanted: _Wanted, values: dict[str, Array]) -> tuple[Array, dict[str, Array]]:
    system, mode = wanted.system(values), wanted.mode
    # One more, to see whether the frequency is simple.
    found = system.modes(mode + 2, throw=False)
    check_simple(found, mode, "Square of the angular frequency")
    squared = float(found.values[mode])
    frame, form = system.frame, system.form
    x = form.expand(found.vectors[:, [mode]], np.zeros(frame.fixed.shape))[0]
    by, _ = eigenvalue_gradient(frame, form, wanted.inertia, squared, x)
    return jnp.asarray(squared), {name: jnp.asarray(by[name]) for name in values}


def _backward(
    wanted: _Wanted, slopes: dict[str, Array], cotangent: Array
) -> tuple[dict[str, Array]]:
    return ({name: cotangent * slope for name, slope in slopes.items()},)


_squared.defvjp(_forward, _backward)
