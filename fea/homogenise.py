"""Effective stiffness of a periodic frame, and its derivatives.

Under a uniform mean strain E the displacement of a periodic frame is E x plus a field that repeats
with the period; rotations repeat. So one number stands for all images of a joint, and a strut that
leaves the period sees its second joint displaced by E times the periods it spans. Unit strains, six in
space and three in the plane, on one factor give the energies

    C_ij = (1/V) sum over struts of u_i' K u_j,

(Vigliotti, Pasini, Mech. Mater. 46 (2012) 57; Hutchinson, Fleck, J. Mech. Phys. Solids 54 (2006) 756
for the kinematics). The fields are in equilibrium, so the derivative of C_ij by anything that K
depends on is (1/V) u_i' dK u_j, without an adjoint solve.

In the plane a joint has three of the six dofs, two displacements and the rotation about the axis of
extrusion, and a strut is the wall in the depth of the period, so that C holds per unit depth. Walls are
in plane stress: nothing hinders them along the axis of extrusion.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.sparse import bsr_array

from fea.beam import BLOCK, Strut, StrutMaterial, beam_end_forces, beam_stiffnesses
from fea.equilibrium import known_parameters, on_host
from fea.errors import position_text
from fea.linear_solve import SingularStiffness, factorise
from fea.periodic_frame import PeriodicFrame
from fea.periodicity import UNIT_STRAINS, held, summed_blocks
from fea.precision import require_x64
from fea.rigid_motion import rigid_body_modes

ArrayLike = Array | np.ndarray
Kind = TypeVar("Kind", np.ndarray, Array)

# A joint of a free motion turns, rather than moves, when its rotation over the longest period makes up
# this share of it.
TURNS = 0.5

# Struts are padded to a multiple of this: one compilation serves all unit cells of a few dozen.
STRUTS_STEP = 64

# Dofs of a joint, and Voigt components of a strain, that there are in the plane.
PLANE_DOFS = (0, 1, 5)
PLANE_STRAINS = (0, 1, 5)


@dataclass(frozen=True, eq=False)
class HomogenisedFrame:
    """What unit strains do to a periodic frame.

    There are six in space, xx, yy, zz, yz, xz, xy, and three in the plane, xx, yy, xy. Joints have six
    dofs, ux, uy, uz, rx, ry, rz, and in the plane three, ux, uy, rz.

    Attributes:
        frame: what was homogenised.
        C: effective elasticity matrix [MPa].
        displacement: of the joints under each unit strain [mm] and [rad], one joint at rest.
        residual: largest true |f - K u| / |f| over all strains.
    """

    frame: PeriodicFrame
    C: Float[np.ndarray, "cases cases"]
    displacement: Float[np.ndarray, "cases joints dofs"]
    residual: float

    @property
    def strut_displacement(self) -> Float[np.ndarray, "cases struts _"]:
        """Displacements and rotations of both joints of each strut under each unit strain."""
        return _strut_displacement(self.frame, self.displacement)

    @property
    def end_forces(self) -> Float[np.ndarray, "cases struts _"]:
        """What the joints exert on each strut under each unit strain [N, N mm], global axes."""
        u = jnp.asarray(self.strut_displacement)
        return np.asarray(_end_forces(_Topology.of(self.frame), self.frame.parameters, u))


def homogenise_frame(frame: PeriodicFrame, *, solver: str = "auto") -> HomogenisedFrame:
    """Effective stiffness of a periodic frame, in space or in the plane.

    Args:
        frame: one period.
        solver: see `fea.linear_solve.factorise`.

    Raises:
        FeaError: when the frame is malformed or falls apart.
        SingularStiffness: when a joint can move or turn at no cost, with the place.
    """
    require_x64()
    frame.check()
    stiffness = _stiffnesses(frame)
    cases, block = len(_unit_strains(frame)), len(_dofs(frame))
    affine = _strut_displacement(frame, np.zeros((cases, len(frame.joints), block)))
    force = np.einsum("sij,csj->csi", stiffness, affine).reshape(cases, -1, block)
    load = np.zeros((len(frame.joints), block, cases))
    np.subtract.at(load, frame.struts.ravel(), np.moveaxis(force, 0, -1))
    load[0, : frame.dimensions] = 0.0
    K = held(_assembled(frame, stiffness), displacements=frame.dimensions)
    try:
        factor = factorise(K, near_null=_near_null(frame), solver=solver)
        solved = factor.solve(load.reshape(-1, cases))
    except SingularStiffness as failure:
        raise _named(failure, frame) from failure
    u = solved.x.T.reshape(cases, -1, block)
    whole = _strut_displacement(frame, u)
    C = np.einsum("isa,sab,jsb->ij", whole, stiffness, whole, optimize=True) / frame.volume
    return HomogenisedFrame(frame, (C + C.T) / 2, u, solved.residual)


def homogenised_gradient(
    solution: HomogenisedFrame, weights: Float[np.ndarray, "cases cases"]
) -> dict[str, np.ndarray]:
    """Derivative of sum_ij w_ij C_ij by each of the frame's parameters, without a further solve.

    Args:
        solution: the homogenised frame.
        weights: w; the derivative of a function of C by C.

    Returns:
        By joint positions [mm], radii [mm], rigid ends [mm] and relative modulus, those given.
    """
    u = solution.strut_displacement
    v = np.einsum("ij,isa->jsa", (weights + weights.T) / 2, u)
    frame = solution.frame
    fields = (jnp.asarray(v), jnp.asarray(u))
    gradient = _bilinear_gradient(_Topology.of(frame), frame.parameters, fields)
    return {name: np.asarray(value) / frame.volume for name, value in gradient.items()}


def homogenised(
    frame: PeriodicFrame, *, solver: str = "auto", **parameters: ArrayLike
) -> Float[Array, "cases cases"]:
    """Effective elasticity matrix [MPa], as a function that JAX differentiates.

    Call and differentiate it outside `jax.jit` and `jax.vmap`: the solver runs on the host.

    Args:
        frame: gives all that is not replaced.
        solver: see `fea.linear_solve.factorise`.
        **parameters: values to use and to differentiate by, any of `frame.parameters`.

    Raises:
        FeaError: for a parameter that the frame does not have, and what `homogenise_frame` raises.
    """
    values = known_parameters(parameters, frame.parameters, "this periodic frame")
    return _homogenised(_Static(frame, solver), values)


@dataclass(frozen=True, eq=False)
class _Static:
    frame: PeriodicFrame
    solver: str


@jax.tree_util.register_static
@dataclass(frozen=True, eq=False)
class _Solved:
    """What the backward pass needs: nothing that JAX looks into."""

    solution: HomogenisedFrame
    names: tuple[str, ...]


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _homogenised(static: _Static, values: dict[str, Array]) -> Array:
    return _forward(static, values)[0]


def _forward(static: _Static, values: dict[str, Array]):
    host = {name: on_host(name, value) for name, value in values.items()}
    solution = homogenise_frame(replace(static.frame, **host), solver=static.solver)
    return jnp.asarray(solution.C), _Solved(solution, tuple(values))


def _backward(static: _Static, solved: _Solved, cotangent: Array):
    gradient = homogenised_gradient(solved.solution, on_host("cotangent", cotangent))
    return ({name: jnp.asarray(gradient[name]) for name in solved.names},)


_homogenised.defvjp(_forward, _backward)


class _Topology(eqx.Module):
    """What the struts are made of beside the parameters, all of it in space."""

    struts: Int[Array, "struts 2"]
    shift: Float[Array, "struts 3"]
    material: StrutMaterial
    dofs: tuple[int, ...] = eqx.field(static=True)

    @classmethod
    def of(cls, frame: PeriodicFrame) -> "_Topology":
        """That of a frame."""
        shift = jnp.asarray(_in_space(frame.offsets @ frame.periods))
        return cls(jnp.asarray(frame.struts), shift, frame.material, _both(_dofs(frame)))

    def values(self, parameters: Mapping[str, ArrayLike]) -> Strut:
        """The struts with some parameters."""
        count = len(self.struts)
        joints = _in_space(jnp.asarray(parameters["joints"]))
        return Strut(
            ends=joints[self.struts].at[:, 1].add(self.shift),
            radii=jnp.asarray(parameters["radii"]),
            rigid_ends=jnp.asarray(parameters.get("rigid_ends", np.zeros((count, 2)))),
            modulus=jnp.asarray(parameters.get("modulus", np.ones(count))),
        )

    def stiffnesses(self, parameters: Mapping[str, ArrayLike]) -> Float[Array, "struts dofs dofs"]:
        """Of all struts, in the dofs that there are."""
        dofs = np.array(self.dofs)
        return beam_stiffnesses(self.values(parameters), self.material)[:, dofs[:, None], dofs]


def _in_space(points: Float[Kind, "*points d"]) -> Float[Kind, "*points 3"]:
    """Points of the plane with a third coordinate of zero; points in space as they are."""
    xp = points.__array_namespace__()
    return xp.pad(points, [(0, 0)] * (points.ndim - 1) + [(0, 3 - points.shape[-1])])


def _dofs(frame: PeriodicFrame) -> tuple[int, ...]:
    return PLANE_DOFS if frame.dimensions == 2 else tuple(range(BLOCK))


def _both(dofs: tuple[int, ...]) -> tuple[int, ...]:
    """Those of both joints of a strut."""
    return (*dofs, *(BLOCK + dof for dof in dofs))


def _unit_strains(frame: PeriodicFrame) -> Float[np.ndarray, "cases d d"]:
    if frame.dimensions == 3:
        return UNIT_STRAINS
    return UNIT_STRAINS[list(PLANE_STRAINS), :2, :2]


def _near_null(frame: PeriodicFrame) -> Float[np.ndarray, "dofs modes"]:
    """Rigid motions of the joints, joint 0 at rest."""
    dofs = list(_dofs(frame))
    modes = rigid_body_modes(_in_space(frame.joints), rotations=True)
    modes = modes.reshape(-1, BLOCK, BLOCK)[:, dofs][:, :, dofs]
    modes[0, : frame.dimensions] = 0.0
    return modes.reshape(-1, len(dofs))


def _stiffnesses(frame: PeriodicFrame) -> Float[np.ndarray, "struts dofs dofs"]:
    """Of all struts, in the dofs that there are."""
    count = len(frame.struts)
    rigid = np.zeros((count, 2)) if frame.rigid_ends is None else frame.rigid_ends
    modulus = np.ones(count) if frame.modulus is None else frame.modulus
    values = Strut(*map(_padded, (_in_space(frame.ends), frame.radii, rigid, modulus)))
    dofs = np.array(_both(_dofs(frame)))
    return np.asarray(beam_stiffnesses(values, frame.material))[:count, dofs[:, None], dofs]


def _padded(values: Float[np.ndarray, "struts ..."]) -> Float[Array, "_ ..."]:
    """The last one repeated to a multiple of `STRUTS_STEP`."""
    more = -len(values) % STRUTS_STEP
    return jnp.asarray(np.concatenate([values, np.repeat(values[-1:], more, axis=0)]))


@eqx.filter_jit
def _end_forces(
    topology: _Topology, parameters: Mapping[str, ArrayLike], u: Float[Array, "cases struts dofs"]
) -> Float[Array, "cases struts dofs"]:
    dofs = np.array(topology.dofs)
    whole = jnp.zeros((*u.shape[:2], 2 * BLOCK)).at[:, :, dofs].set(u)
    return beam_end_forces(topology.values(parameters), topology.material, whole)[:, :, dofs]


@eqx.filter_jit
def _bilinear_gradient(
    topology: _Topology, parameters: Mapping[str, ArrayLike], fields: tuple[Array, Array]
) -> dict[str, Array]:
    def value(parameters: dict[str, Array]) -> Array:
        K = topology.stiffnesses(parameters)
        return jnp.einsum("csi,sij,csj->", fields[0], K, fields[1])  # case, strut, dof

    return jax.grad(value)({name: jnp.asarray(v) for name, v in parameters.items()})


def _strut_displacement(
    frame: PeriodicFrame, u: Float[np.ndarray, "cases joints dofs"]
) -> Float[np.ndarray, "cases struts _"]:
    """Of both ends of each strut: the joints' and, at the second, E times the periods it spans."""
    ends = u[:, frame.struts]
    spanned = frame.offsets @ frame.periods
    # Case, strut.
    ends[:, :, 1, : frame.dimensions] += np.einsum("cxy,sy->csx", _unit_strains(frame), spanned)
    return ends.reshape(len(u), len(frame.struts), -1)


def _assembled(frame: PeriodicFrame, stiffness: Float[np.ndarray, "struts dofs dofs"]) -> bsr_array:
    block = len(_dofs(frame))
    blocks = stiffness.reshape(-1, 2, block, 2, block).transpose(0, 1, 3, 2, 4)
    rows = np.repeat(frame.struts, 2, axis=1).ravel()
    columns = np.tile(frame.struts, 2).ravel()
    return summed_blocks(rows, columns, blocks.reshape(-1, block, block), len(frame.joints))


def _named(failure: SingularStiffness, frame: PeriodicFrame) -> SingularStiffness:
    """The same failure, with the joint that moves most."""
    if failure.mode is None:
        return failure
    moves = frame.dimensions
    mode = failure.mode.reshape(len(frame.joints), -1)
    reach = float(np.linalg.norm(frame.periods, axis=1).max())
    displacement = np.linalg.norm(mode[:, :moves], axis=1)
    rotation = np.linalg.norm(mode[:, moves:], axis=1) * reach
    joint = int(np.argmax(np.maximum(displacement, rotation)))
    does = "turn" if rotation[joint] > TURNS * (displacement + rotation)[joint] else "move"
    return SingularStiffness(
        f"The periodic frame is a mechanism: joint {joint} at {position_text(frame.joints[joint])} mm "
        f"can {does} at no cost; add struts that resist it.",
        failure.mode,
    )
