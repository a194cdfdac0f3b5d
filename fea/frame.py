"""Networks of struts with rigid joints: several load cases on one factorisation, adjoint gradients.

Every joint has six degrees of freedom: displacement [mm] and rotation [rad]; a load is a force [N]
and a moment [N mm]. Assembly and solvers are those of solids; the element is `fea.beam`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse import bsr_array, csr_array
from scipy.sparse.csgraph import connected_components

from fea.assembly import Pattern, node_pairs
from fea.beam import beam_end_forces, beam_stiffnesses, bilinear_gradient
from fea.equilibrium import AbstractProblem, AbstractSolution, equilibrium
from fea.errors import FeaError
from fea.linear_solve.element_operator import ElementOperator, masked_blocks
from fea.rigid_motion import free_motion
from fea.sections import AbstractSection

# Degrees of freedom of a joint.
BLOCK = 6

# Ends of a strut whose blocks its stiffness hands over.
PAIRS = node_pairs(2)


@dataclass(frozen=True, eq=False)
class FrameProblem(AbstractProblem):
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

    proves_definite: ClassVar[bool] = False

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

    @property
    def points(self) -> Float[np.ndarray, "joints 3"]:
        """Positions of the joints [mm]."""
        return self.joints

    @property
    def connectivity(self) -> Int[np.ndarray, "struts 2"]:
        """Joints of each strut."""
        return self.struts

    @property
    def parameters(self) -> dict[str, np.ndarray]:
        """Joint positions and end radii [mm]."""
        return {"joints": self.joints, "radii": self.radii}

    def with_parameters(self, values: Mapping[str, np.ndarray]) -> "FrameProblem":
        """The same frame with other joints, radii, forces or prescribed values."""
        return replace(self, **values)

    def solved(
        self, *, previous: "FrameSolution | None" = None, solver: str = "auto"
    ) -> "FrameSolution":
        """See `solve_frame`."""
        return FrameSolution(*equilibrium(self, previous=previous, solver=solver))

    def stiffness(self, pattern: Pattern) -> bsr_array:
        """K of the frame without supports [N/mm, N, N mm]."""
        K = np.asarray(beam_stiffnesses(self.joints, self.struts, self.radii, *self.material))
        ends = K.reshape(-1, 2, BLOCK, 2, BLOCK)
        return pattern.assemble(
            np.stack([ends[:, a, :, b] for a, b in zip(*PAIRS, strict=True)], 1)
        )

    def operator(self, fixed: Bool[np.ndarray, "joints 6"]) -> ElementOperator:
        """K as products of struts."""
        K = beam_stiffnesses(self.joints, self.struts, self.radii, *self.material)
        struts = (K, jnp.asarray(self.struts), jnp.asarray(~fixed))
        return ElementOperator(Partial(_product, struts), _diagonal(struts))

    def bilinear_gradient(
        self, v: Float[np.ndarray, "cases joints 6"], u: Float[np.ndarray, "cases joints 6"]
    ) -> dict[str, np.ndarray]:
        """Derivative of sum_c v_c' K u_c by joint positions and end radii [N]."""
        joints, radii = bilinear_gradient(
            self.joints, self.radii, self.struts, (v, u), self.material
        )
        return {"joints": np.asarray(joints), "radii": np.asarray(radii)}

    def check(self) -> None:
        """Refuse impossible struts, materials and supports.

        Raises:
            FeaError: for struts without length or thickness, constants that no material has, or
                joints that nothing holds.
        """
        count = len(self.joints)
        if self.struts.size and not 0 <= self.struts.min() <= self.struts.max() < count:
            raise FeaError(
                f"Struts refer to joints {self.struts.min()} to {self.struts.max()}, but the frame "
                f"has joints 0 to {count - 1}."
            )
        if self.radii.shape != self.struts.shape:
            raise FeaError(
                f"Radii have shape {self.radii.shape}; give {self.struts.shape}, one at each end."
            )
        lost = np.flatnonzero(~np.isfinite(self.joints).all(axis=1))
        if lost.size:
            raise FeaError(f"The position of joint {lost[0]} is not a number.")
        length = np.linalg.norm(np.diff(self.joints[self.struts], axis=1)[:, 0], axis=1)
        if len(length) == 0:
            raise FeaError("The frame has no struts; give at least one.")
        if not length.min() > 0:
            raise FeaError(f"Strut {int(np.argmin(length))} has no length; weld its joints.")
        if not self.radii.min() > 0:
            worst = int(np.argmin(self.radii.min(axis=1)))
            raise FeaError(
                f"Strut {worst} has radius {self.radii[worst].min():g} mm; radii must be positive."
            )
        if not (self.E > 0 and -1 < self.nu <= 0.5):
            raise FeaError(f"E = {self.E:g}, nu = {self.nu:g}: need E > 0 and -1 < nu <= 0.5.")
        unused = np.setdiff1d(np.arange(len(self.joints)), self.struts)
        if len(unused) and not self.fixed[unused].all():
            raise FeaError(f"Joint {int(unused[0])} has no strut; remove it or fix it.")


@dataclass(frozen=True, eq=False)
class FrameSolution(AbstractSolution):
    """The solved frame; see `AbstractSolution` for displacement and reaction."""

    problem: FrameProblem

    @cached_property
    def end_forces(self) -> Float[np.ndarray, "cases struts 12"]:
        """What the joints exert on each strut: force and moment at its first and second end.

        In global axes; `fea.strut_strength` splits them along and across the strut.
        """
        frame = self.problem
        K = beam_stiffnesses(frame.joints, frame.struts, frame.radii, *frame.material)
        return np.asarray(beam_end_forces(K, self.displacement, frame.struts))


def solve_frame(
    frame: FrameProblem, *, previous: FrameSolution | None = None, solver: str = "auto"
) -> FrameSolution:
    """Solve all load cases with one factorisation.

    Args:
        frame: the frame and its loads.
        previous: solution of the same frame (struts and supports) with other radii, positions or
            forces; what can be reused is. Its factor is spent afterwards.
        solver: see `fea.linear_solve.factorise`.

    Raises:
        FeaError: when the frame is malformed, can move freely, or the solve fails.
    """
    return frame.solved(previous=previous, solver=solver)


def _product(struts: tuple[Array, ...], u: Float[Array, "joints 6"]) -> Float[Array, "joints 6"]:
    K, ends, free = struts
    moving = jnp.where(free, u, 0.0)[ends].reshape(-1, 2 * BLOCK)
    forces = jnp.einsum("sij,sj->si", K, moving).reshape(-1, 2, BLOCK)
    return jnp.where(free, jnp.zeros_like(u).at[ends].add(forces), u)


@jax.jit
def _diagonal(struts: tuple[Array, ...]) -> Float[Array, "joints 6 6"]:
    K, ends, free = struts
    own = jnp.stack([K[:, :BLOCK, :BLOCK], K[:, BLOCK:, BLOCK:]], axis=1)
    blocks = jnp.zeros((len(free), BLOCK, BLOCK)).at[ends].add(own)
    return masked_blocks(blocks, free)


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
