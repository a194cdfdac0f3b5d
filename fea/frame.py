"""Networks of struts with rigid joints: several load cases on one factorisation, adjoint gradients.

Every joint has six degrees of freedom: displacement [mm] and rotation [rad]; a load is a force [N]
and a moment [N mm]. Assembly and solvers are those of solids; the element is `fea.beam`.
"""

from dataclasses import dataclass, replace
from functools import cached_property, partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from fea.assembly import Pattern, Reduced
from fea.beam import beam_end_forces, beam_stiffnesses, bilinear_gradient
from fea.errors import FeaError
from fea.linear_solve import Factor, factorise
from fea.precision import require_x64
from fea.rigid_motion import free_motion, rigid_body_modes
from fea.sections import AbstractSection

# Degrees of freedom of a joint.
BLOCK = 6


@dataclass(frozen=True, eq=False)
class FrameProblem:
    """A frame under loads.

    Attributes:
        joints: positions [mm].
        struts: the two joints of each strut.
        radii: section radius at both ends of each strut [mm].
        E: Young's modulus [MPa].
        nu: Poisson's ratio.
        section: shape of all sections.
        fixed: degrees of freedom whose value is prescribed.
        value: prescribed displacement [mm] and rotation [rad]; ignored where not fixed.
        forces: forces [N] and moments [N mm] on the joints, of each load case.
    """

    joints: Float[np.ndarray, "joints 3"]
    struts: Int[np.ndarray, "struts 2"]
    radii: Float[np.ndarray, "struts 2"]
    E: float
    nu: float
    section: AbstractSection
    fixed: Bool[np.ndarray, "joints 6"]
    value: Float[np.ndarray, "joints 6"]
    forces: Float[np.ndarray, "cases joints 6"]

    @property
    def material(self) -> tuple[float, float, AbstractSection]:
        """What the element needs beside the geometry."""
        return self.E, self.nu, self.section


@dataclass(frozen=True, eq=False)
class FrameSystem:
    """What stays the same when only radii, positions and forces change.

    Attributes:
        pattern: where element matrices go.
        reduced: how supports are eliminated.
        factor: of the reduced stiffness.
    """

    pattern: Pattern
    reduced: Reduced
    factor: Factor


@dataclass(frozen=True, eq=False)
class FrameSolution:
    """The solved frame.

    Attributes:
        problem: what was solved.
        displacement: displacement [mm] and rotation [rad] of the joints.
        adjoint: K⁻¹ f with all supports at zero; the displacement itself where nothing else is
            prescribed. Gradients need it.
        residual: largest relative residual |f - K u|/|f| of the reduced system over the cases.
        iterations: of an iterative solver; 0 for a direct one.
        system: for the next solve of the same frame.
    """

    problem: FrameProblem
    displacement: Float[np.ndarray, "cases joints 6"]
    adjoint: Float[np.ndarray, "cases joints 6"]
    residual: float
    iterations: int
    system: FrameSystem

    @cached_property
    def compliance(self) -> Float[np.ndarray, " cases"]:
        """Work u.f of the loads [N mm]."""
        return np.einsum("cji,cji->c", self.problem.forces, self.displacement)

    @cached_property
    def end_forces(self) -> Float[np.ndarray, "cases struts 12"]:
        """What the joints exert on each strut: force and moment at its first and second end.

        In global axes; `fea.strut_strength` splits them along and across the strut.
        """
        frame = self.problem
        K = beam_stiffnesses(frame.joints, frame.struts, frame.radii, *frame.material)
        return np.asarray(beam_end_forces(K, self.displacement, frame.struts))

    @cached_property
    def reaction(self) -> Float[np.ndarray, "cases joints 6"]:
        """Forces [N] and moments [N mm] of the supports; zero where nothing is prescribed."""
        frame = self.problem
        inner = np.zeros_like(frame.forces)
        for case, ends in enumerate(self.end_forces):
            np.add.at(inner[case], frame.struts, ends.reshape(-1, 2, BLOCK))
        return np.where(frame.fixed, inner - frame.forces, 0.0)


@dataclass(frozen=True, eq=False)
class FrameGradient:
    """Derivatives of a weighted sum of the cases' compliances.

    Attributes:
        joints: with respect to joint positions [N].
        radii: with respect to end radii [N].
        forces: with respect to forces [mm] and moments [rad].
    """

    joints: Float[np.ndarray, "joints 3"]
    radii: Float[np.ndarray, "struts 2"]
    forces: Float[np.ndarray, "cases joints 6"]


def solve_frame(
    frame: FrameProblem, *, previous: FrameSolution | None = None, solver: str = "auto"
) -> FrameSolution:
    """Solve all load cases with one factorisation.

    Args:
        frame: the frame and its loads.
        previous: solution of the same frame (struts and supports) with other radii, positions or
            forces; its pattern and symbolic factor are reused and its displacement is the first
            guess. It can still be read afterwards, but its `system` is spent.
        solver: see `fea.linear_solve.factorise`.

    Raises:
        FeaError: when the frame is malformed, can move freely, or the solve fails.
    """
    require_x64()
    _check(frame)
    values = beam_stiffnesses(frame.joints, frame.struts, frame.radii, *frame.material)
    if previous is None:
        pattern = Pattern.from_nodes(frame.struts, len(frame.joints), block=BLOCK)
        K = pattern.assemble(np.asarray(values))
        reduced = Reduced.from_matrix(K, frame.fixed.reshape(-1), block=BLOCK)
        modes = reduced.restrict(rigid_body_modes(frame.joints, rotations=True))
        factor = factorise(reduced.matrix(K), near_null=modes, block=BLOCK, solver=solver)
    else:
        _check_same(frame, previous.problem)
        pattern, reduced = previous.system.pattern, previous.system.reduced
        K = pattern.assemble(np.asarray(values))
        factor = previous.system.factor.update(reduced.matrix(K))
    system = FrameSystem(pattern, reduced, factor)
    return _solve_cases(frame, system, K, previous)


def compliance_gradient(
    solution: FrameSolution, weights: Float[np.ndarray, " cases"] | None = None
) -> FrameGradient:
    """Adjoint gradient of sum_c w_c (u.f)_c; needs no further solve.

    With v = K⁻¹ f (supports at zero) and u the displacement, d(f.u) = -v'(dK)u + (u + v).df.

    Args:
        solution: the solved frame.
        weights: of the load cases; ones by default.
    """
    frame = solution.problem
    w = np.ones(len(frame.forces)) if weights is None else weights
    v = -w[:, None, None] * solution.adjoint
    joints, radii = bilinear_gradient(
        frame.joints, frame.radii, frame.struts, (v, solution.displacement), frame.material
    )
    forces = w[:, None, None] * (solution.displacement + solution.adjoint)
    return FrameGradient(np.asarray(joints), np.asarray(radii), forces)


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def compliance(
    frame: FrameProblem,
    joints: Float[Array, "joints 3"],
    radii: Float[Array, "struts 2"],
    forces: Float[Array, "cases joints 6"],
) -> Float[Array, " cases"]:
    """Work u.f of each load case [N mm], differentiable by JAX in all but the first argument.

    The linear solve runs on the host: call and differentiate this outside `jax.jit`.

    Args:
        frame: gives struts, supports, material; its joints, radii and forces are replaced.
        joints: positions [mm].
        radii: radius at both ends [mm].
        forces: forces [N] and moments [N mm].
    """
    return _compliance_forward(frame, joints, radii, forces)[0]


def _compliance_forward(frame: FrameProblem, joints: Array, radii: Array, forces: Array):
    host = {name: np.asarray(a) for name, a in zip(_VARIED, (joints, radii, forces), strict=True)}
    solution = solve_frame(replace(frame, **host))
    fields = (solution.displacement, solution.adjoint)
    return jnp.asarray(solution.compliance), (joints, radii, *map(jnp.asarray, fields))


def _compliance_backward(frame: FrameProblem, kept: tuple, cotangent: Array):
    joints, radii, u, v = kept
    w = cotangent[:, None, None]
    into = bilinear_gradient(joints, radii, frame.struts, (-w * v, u), frame.material)
    return (*into, w * (u + v))


_VARIED = ("joints", "radii", "forces")
compliance.defvjp(_compliance_forward, _compliance_backward)


def free_frame_motion(frame: FrameProblem) -> str | None:
    """The rigid motion that the supports leave to a connected part of the frame, in words.

    A frame with rigid joints has no other mechanism, so None means that it can be solved.

    Returns:
        Words that follow "the frame", such as "slides along x"; see `fea.rigid_motion`.
    """
    number = len(frame.joints)
    a, b = frame.struts.T
    graph = csr_array((np.ones(len(a)), (a, b)), shape=(number, number))
    parts, part_of = connected_components(graph, directed=False)
    for part in range(parts):
        inside = part_of == part
        motion = free_motion(frame.joints[inside], frame.fixed[inside])
        if motion is not None:
            return motion if parts == 1 else f"falls into {parts} pieces, of which one {motion}"
    return None


def _solve_cases(
    frame: FrameProblem, system: FrameSystem, K: csr_array, previous: FrameSolution | None
) -> FrameSolution:
    """Displacement and adjoint as columns of one right-hand side."""
    cases, number = len(frame.forces), len(frame.joints)
    reduced = system.reduced
    forces = frame.forces.reshape(cases, -1).T
    value = np.where(frame.fixed, frame.value, 0.0).reshape(-1)
    moved = bool(value.any())
    prescribed = np.tile(value[:, None], (1, cases))
    rhs = reduced.load(K, forces, prescribed)
    if moved:
        rhs = np.hstack([rhs, reduced.restrict(forces)])
    guess = None
    if previous is not None and previous.problem.forces.shape == frame.forces.shape:
        fields = (previous.displacement, previous.adjoint)[: 1 + moved]
        guess = np.hstack([reduced.restrict(f.reshape(cases, -1).T) for f in fields])
    solved = system.factor.solve(rhs, x0=guess)

    def full(x: np.ndarray, prescribed: np.ndarray) -> Float[np.ndarray, "cases joints 6"]:
        return np.ascontiguousarray(reduced.expand(x, prescribed).T).reshape(cases, number, BLOCK)

    u = full(solved.x[:, :cases], prescribed)
    v = full(solved.x[:, cases:], np.zeros_like(prescribed)) if moved else u
    return FrameSolution(frame, u, v, solved.residual, solved.iterations, system)


def _check(frame: FrameProblem) -> None:
    length = np.linalg.norm(np.diff(frame.joints[frame.struts], axis=1)[:, 0], axis=1)
    if len(length) == 0:
        raise FeaError("The frame has no struts; give at least one.")
    if not length.min() > 0:
        raise FeaError(f"Strut {int(np.argmin(length))} has no length; weld its joints.")
    if not frame.radii.min() > 0:
        worst = int(np.argmin(frame.radii.min(axis=1)))
        raise FeaError(
            f"Strut {worst} has radius {frame.radii[worst].min():g} mm; radii must be positive."
        )
    if not (frame.E > 0 and -1 < frame.nu <= 0.5):
        raise FeaError(f"E = {frame.E:g}, nu = {frame.nu:g}: need E > 0 and -1 < nu <= 0.5.")
    unused = np.setdiff1d(np.arange(len(frame.joints)), frame.struts)
    if len(unused) and not frame.fixed[unused].all():
        raise FeaError(f"Joint {int(unused[0])} has no strut; remove it or fix it.")


def _check_same(frame: FrameProblem, previous: FrameProblem) -> None:
    for name in ("struts", "fixed"):
        now, before = getattr(frame, name), getattr(previous, name)
        if now is not before and not np.array_equal(now, before):
            raise FeaError(f"The previous solution has other {name}; solve without it.")
