"""Networks of struts with rigid joints, with a skin or without: several load cases on one factor.

Every joint has six degrees of freedom: displacement [mm] and rotation [rad]; a load is a force [N]
and a moment [N mm]. Assembly and solvers are those of solids; the elements are `fea.beam` and, for
the skin, `fea.shell`, whose nodes are joints as well. `fea.couplings` fasten strut ends to triangles
and regions to a reference joint.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse import bsr_array

from fea.abstract_section import AbstractSection
from fea.assembly import Pattern
from fea.batches import batches
from fea.beam import (
    BLOCK,
    Strut,
    StrutMaterial,
    beam_end_forces,
    beam_forces,
    beam_pairs,
    beam_stiffnesses,
    strut_displacements,
)
from fea.couplings import AbstractCoupling, Tie, check_couplings
from fea.equilibrium import AbstractSolution, equilibrium
from fea.errors import FeaError
from fea.frame_checks import (
    check_held,
    check_modulus,
    check_radii,
    check_rigid_ends,
    check_strut_loads,
    check_struts,
    check_used,
    pieces_of,
)
from fea.frame_operator import diagonal_blocks, product
from fea.linear_solve.element_operator import ElementOperator
from fea.plane_checks import check_plane_loads, check_walls
from fea.problem import AbstractProblem
from fea.sections import Wall
from fea.shell import Triangle, shell_pairs, shell_stiffness, weighted_strains
from fea.skin import Skin
from fea.strut_loads import strut_joint_loads, strut_load_forces

ArrayLike = Array | np.ndarray

# Elements differentiated at once.
AT_ONCE = 32_768


@dataclass(frozen=True, eq=False)
class FrameProblem(AbstractProblem):
    """A frame under loads.

    Attributes:
        joints: positions of the joints, nodes of the skin among them [mm].
        struts: the two joints of each strut; none, of shape (0, 2), for a skin alone.
        radii: section radius at both ends of each strut [mm], linear between.
        E: Young's modulus of the struts [MPa].
        nu: Poisson's ratio of the struts.
        section: shape of all sections.
        fixed: degrees of freedom whose value is prescribed.
        value: prescribed displacement [mm] and rotation [rad]; ignored where not fixed.
        forces: forces [N] and moments [N mm] on the joints, of each load case.
        rigid_ends: length at each end of a strut that does not deform [mm]; None: none.
        modulus: factor on E of each strut; None: ones.
        strut_loads: force per length of each load case on each strut [N/mm], global axes, at its first
            joint, its middle and its second joint, quadratic between; None: none.
        skin: triangles of a shell; None: no skin.
        couplings: what makes joints follow others.
    """

    positions: ClassVar[str] = "joints"

    joints: Float[np.ndarray, "joints 3"]
    struts: Int[np.ndarray, "struts 2"]
    radii: Float[np.ndarray, "struts 2"]
    E: float
    nu: float
    section: AbstractSection
    fixed: Bool[np.ndarray, "joints 6"]
    value: Float[np.ndarray, "joints 6"]
    forces: Float[np.ndarray, "cases joints 6"]
    rigid_ends: Float[np.ndarray, "struts 2"] | None = None
    modulus: Float[np.ndarray, " struts"] | None = None
    strut_loads: Float[np.ndarray, "cases struts 3 3"] | None = None
    skin: Skin | None = None
    couplings: tuple[AbstractCoupling, ...] = ()

    @property
    def strut_material(self) -> StrutMaterial:
        """What all struts have in common."""
        return StrutMaterial(self.E, self.nu, self.section)

    @property
    def points(self) -> Float[np.ndarray, "joints 3"]:
        """Positions of the joints [mm]."""
        return self.joints

    @property
    def groups(self) -> tuple[Int[np.ndarray, "_ _"], ...]:
        """Joints of each strut, and nodes of each triangle of the skin."""
        return (self.struts,) if self.skin is None else (self.struts, self.skin.triangles)

    @property
    def links(self) -> tuple[Int[np.ndarray, "_ _"], ...]:
        """Joints that each strut, triangle and coupling connects."""
        return (*self.groups, *(coupling.links for coupling in self.couplings))

    @property
    def parameters(self) -> dict[str, np.ndarray]:
        """Joint positions and end radii [mm], and what else is given."""
        more = {
            "rigid_ends": self.rigid_ends,
            "modulus": self.modulus,
            "strut_loads": self.strut_loads,
            "thickness": None if self.skin is None else self.skin.thickness,
        }
        given = {name: value for name, value in more.items() if value is not None}
        return {"joints": self.joints, "radii": self.radii, **given}

    def with_parameters(self, values: Mapping[str, np.ndarray]) -> "FrameProblem":
        """The same frame with other joints, radii, forces or prescribed values."""
        given: dict[str, Any] = dict(values)
        thickness = given.pop("thickness", None)
        if thickness is not None and self.skin is not None:
            given["skin"] = replace(self.skin, thickness=thickness)
        return replace(self, **given)

    def strut_values(self, **parameters: ArrayLike) -> Strut:
        """All struts as the element sees them, in JAX.

        Args:
            **parameters: values to use instead of the frame's own: `joints`, `radii`, `rigid_ends`,
                `modulus`; others are ignored.
        """
        given = self.parameters | parameters
        radii = jnp.asarray(given["radii"])
        return Strut(
            ends=jnp.asarray(given["joints"])[self.struts],
            radii=radii,
            rigid_ends=jnp.asarray(given.get("rigid_ends", np.zeros(self.struts.shape))),
            modulus=jnp.asarray(given.get("modulus", np.ones(len(self.struts)))),
        )

    def triangle_values(self, **parameters: ArrayLike) -> Triangle:
        """All triangles of the skin as the element sees them, in JAX.

        Args:
            **parameters: values to use instead: `joints`, `thickness`; others are ignored.

        Raises:
            ValueError: when the frame has no skin.
        """
        if self.skin is None:
            raise ValueError("the frame has no skin")
        given = self.parameters | parameters
        return self.skin.triangle_values(given["joints"], given["thickness"])

    @property
    def proves_definite(self) -> bool:
        """Whether `check` is exact: all joints are rigid, but not what follows several bodies."""
        if not all(coupling.joins for coupling in self.couplings):
            return False
        ties = [coupling.corners for coupling in self.couplings if isinstance(coupling, Tie)]
        if not ties:
            return True
        others = (coupling.links for coupling in self.couplings if not isinstance(coupling, Tie))
        _, piece_of = pieces_of(len(self.joints), (*self.groups, *others))
        pieces = piece_of[np.concatenate(ties)]
        return bool((pieces == pieces[:, :1]).all())

    def check(self) -> None:
        """Refuse impossible struts, materials and supports.

        Raises:
            FeaError: for struts without length or thickness, repeated struts, constants that no
                material has, joints that nothing holds, motions that the supports leave free, and
                walls that can leave their plane.
        """
        joints, struts = self.joints, self.struts
        if len(struts) == 0 and self.skin is None:
            raise FeaError("The frame has no struts; give at least one.")
        check_struts(joints, struts)
        check_radii(joints, struts, self.radii)
        if self.modulus is not None:
            check_modulus(struts, self.modulus)
        if self.rigid_ends is not None:
            check_rigid_ends(joints, struts, self.rigid_ends)
        if self.strut_loads is not None:
            check_strut_loads(struts, self.strut_loads, len(self.forces))
        if not (0 < self.E < np.inf and -1 < self.nu <= 0.5):
            raise FeaError(f"E = {self.E:g}, nu = {self.nu:g}: need E > 0 and -1 < nu <= 0.5.")
        if self.skin is not None:
            self.skin.check(joints)
        check_couplings(self.couplings, joints, self.fixed)
        if isinstance(self.section, Wall):
            own = np.ones(len(joints), bool)
            for coupling in self.couplings:
                own[coupling.followers] = False
            normal = check_walls(joints, self.fixed, self.value, own)
            check_plane_loads(joints, self.forces, self.strut_loads, normal)
        check_used(joints, self.fixed, self.links)
        check_held(joints, self.fixed, self.links)

    def solved(
        self, *, previous: "FrameSolution | None" = None, solver: str = "auto"
    ) -> "FrameSolution":
        """See `solve_frame`."""
        return FrameSolution(*equilibrium(self, previous=previous, solver=solver))

    def stiffness(self, pattern: Pattern) -> bsr_array:
        """K of the frame without supports [N/mm, N, N mm]."""
        return pattern.assemble_runs(self._pairs(), block=BLOCK)

    def _pairs(self) -> Iterator[np.ndarray]:
        """Blocks of the struts, then those of the triangles, a run at a time."""
        struts = jax.tree.map(np.asarray, self.strut_values())
        for run, some in batches(len(self.struts), AT_ONCE):
            part = jax.tree.map(lambda leaf, some=some: leaf[some], struts)
            yield np.asarray(beam_pairs(part, self.strut_material))[: run.stop - run.start]
        if self.skin is not None:
            yield np.asarray(shell_pairs(self.triangle_values(), self.skin.E, self.skin.nu))

    def operator(self, fixed: Bool[np.ndarray, "joints 6"]) -> ElementOperator:
        """K as products of struts and triangles."""
        groups = [beam_stiffnesses(self.strut_values(), self.strut_material)]
        if self.skin is not None:
            E, nu = self.skin.E, self.skin.nu
            groups.append(jax.vmap(lambda one: shell_stiffness(one, E, nu))(self.triangle_values()))
        nodes = tuple(jnp.asarray(group) for group in self.groups)
        elements = (tuple(groups), nodes, jnp.asarray(~fixed))
        return ElementOperator(Partial(product, elements), diagonal_blocks(elements))

    @property
    def loads(self) -> Float[np.ndarray, "cases joints 6"]:
        """Forces and moments on the joints, those of strut loads included."""
        return self.forces if self.strut_loads is None else self._all_loads

    @cached_property
    def _all_loads(self) -> Float[np.ndarray, "cases joints 6"]:
        return self.forces + np.asarray(self._strut_load_forces(self.parameters))

    def _strut_load_forces(self, parameters: Mapping[str, ArrayLike]) -> Array:
        """Consistent forces of the strut loads, of all of the frame's parameters."""
        return strut_load_forces(
            self.strut_values(**parameters),
            self.strut_material,
            self.struts,
            len(self.joints),
            jnp.asarray(parameters["strut_loads"]),
        )

    def bilinear_gradient(
        self, v: Float[np.ndarray, "cases joints 6"], u: Float[np.ndarray, "cases joints 6"]
    ) -> dict[str, np.ndarray]:
        """Derivative of sum_c v_c' K u_c by joint positions, end radii and what else is given."""
        struts = jax.tree.map(np.asarray, self.strut_values())
        by = jax.tree.map(lambda leaf: np.zeros(leaf.shape), struts)
        for run, some in batches(len(self.struts), AT_ONCE):
            fields = element_dofs(v, self.struts[some]), element_dofs(u, self.struts[some])
            part = jax.tree.map(lambda leaf, some=some: leaf[some], struts)
            _keep(by, _strut_gradient(part, self.strut_material, fields), run)
        gradient = {
            "joints": _summed(len(self.joints), self.struts, by.ends),
            "radii": by.radii,
            "rigid_ends": by.rigid_ends,
            "modulus": by.modulus,
        }
        if self.strut_loads is not None:
            gradient["strut_loads"] = np.zeros(self.strut_loads.shape)
        if self.skin is not None:
            skin = self.skin
            triangles = jax.tree.map(np.asarray, self.triangle_values())
            by = jax.tree.map(lambda leaf: np.zeros(leaf.shape), triangles)
            for run, some in batches(len(skin.triangles), AT_ONCE):
                fields = (
                    element_dofs(v, skin.triangles[some]),
                    element_dofs(u, skin.triangles[some]),
                )
                part = jax.tree.map(lambda leaf, some=some: leaf[some], triangles)
                _keep(by, _triangle_gradient(part, skin.E, skin.nu, fields), run)
            gradient["joints"] += _summed(len(self.joints), skin.triangles, by.corners)
            gradient["thickness"] = by.thickness
        return {name: gradient[name] for name in self.parameters}

    def load_gradient(self, v: Float[np.ndarray, "cases joints 6"]) -> dict[str, np.ndarray]:
        """Derivative of sum_c v_c' loads_c by forces and by what strut loads depend on."""
        if self.strut_loads is None:
            return {"forces": v}
        parameters = {k: jnp.asarray(x) for k, x in self.parameters.items() if k != "thickness"}
        _, pull = jax.vjp(self._strut_load_forces, parameters)
        (gradient,) = pull(jnp.asarray(v))
        return {"forces": v} | {name: np.asarray(value) for name, value in gradient.items()}


@dataclass(frozen=True, eq=False)
class FrameSolution(AbstractSolution):
    """The solved frame; see `AbstractSolution` for displacement and reaction."""

    problem: FrameProblem

    @cached_property
    def end_forces(self) -> Float[np.ndarray, "cases struts 12"]:
        """What the joints exert on each strut: force and moment at its first and second joint.

        In global axes. Consistent forces of strut loads are taken off, so that these are the true
        forces; `fea.member_forces` has them along the strut.
        """
        frame = self.problem
        u = strut_displacements(self.displacement, frame.struts)
        struts, material = frame.strut_values(), frame.strut_material
        forces = np.asarray(beam_end_forces(struts, material, u))
        if frame.strut_loads is None:
            return forces
        loads = jnp.asarray(frame.strut_loads)
        return forces - np.asarray(strut_joint_loads(struts, material, loads))


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


def element_dofs(
    fields: Float[np.ndarray, "cases joints 6"], nodes: Int[np.ndarray, "elements corners"]
) -> Float[np.ndarray, "cases elements dofs"]:
    """Fields of whole elements, node after node."""
    return fields[:, nodes].reshape(len(fields), len(nodes), -1)


def _keep(into: Any, batch: Any, run: slice) -> None:
    """Write the gradients of a batch of elements to their places."""
    for target, values in zip(jax.tree.leaves(into), jax.tree.leaves(batch), strict=True):
        target[run] = np.asarray(values)[: run.stop - run.start]


def _summed(
    joints: int,
    nodes: Int[np.ndarray, "elements corners"],
    values: Float[np.ndarray, "elements corners 3"],
) -> Float[np.ndarray, "joints 3"]:
    at = nodes.ravel()
    return np.stack(
        [np.bincount(at, values[..., k].ravel(), minlength=joints) for k in range(3)], axis=1
    ).astype(float)  # of no values, NumPy makes whole numbers


@eqx.filter_jit
def _strut_gradient(
    struts: Strut, material: StrutMaterial, fields: tuple[ArrayLike, ArrayLike]
) -> Strut:
    """Derivative of v' K u, by struts, v and u held."""

    def work(strut: Strut, v: Float[Array, "cases 12"], u: Float[Array, "cases 12"]) -> Array:
        force = jax.vmap(lambda case: beam_forces(strut, material, case))(u)
        return jnp.sum(v * force)

    v, u = (jnp.asarray(field) for field in fields)
    return jax.vmap(jax.grad(work), in_axes=(0, 1, 1))(struts, v, u)


@eqx.filter_jit
def _triangle_gradient(
    triangles: Triangle, E: float, nu: float, fields: tuple[ArrayLike, ArrayLike]
) -> Triangle:
    """Derivative of v' K u, by triangles, v and u held."""

    def work(triangle: Triangle, v: Float[Array, "cases 18"], u: Float[Array, "cases 18"]) -> Array:
        F = weighted_strains(triangle, E, nu).reshape(-1, 3 * BLOCK)
        return jnp.sum((v @ F.T) * (u @ F.T))

    v, u = (jnp.asarray(field) for field in fields)
    return jax.vmap(jax.grad(work), in_axes=(0, 1, 1))(triangles, v, u)
