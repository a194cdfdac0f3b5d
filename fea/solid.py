"""Linear elasticity of a solid on tetrahedra: displacement, stress, reactions, compliance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse import bsr_array, csc_array

from fea.assembly import Pattern, node_pairs
from fea.batches import batches
from fea.boundary_conditions import Support, prescribed_dofs
from fea.elements import (
    STRAIN,
    TETRAHEDRA,
    cell_forces,
    displacement_gradients,
    elasticity_tensor,
    gradient_products,
    physical_gradients,
    strain,
)
from fea.equilibrium import AbstractSolution, equilibrium
from fea.error_estimate import ErrorEstimate, estimate_error
from fea.errors import FeaError
from fea.linear_solve.element_operator import ElementOperator, masked_blocks
from fea.materials import AbstractMaterial
from fea.mechanisms import free_body
from fea.problem import AbstractProblem
from fea.stress_recovery import RecoveredStress, recovered_stress
from fea.tet_mesh import TetMesh

ArrayLike = Array | np.ndarray

# Cells computed at once: their arrays stay in the processor's cache (tet4: 6 MB of products), and
# JAX compiles once for all meshes.
CELLS_AT_ONCE = 8192


@dataclass(frozen=True, eq=False)
class SolidProblem(AbstractProblem):
    """A supported solid under loads.

    Attributes:
        mesh: tetrahedra of positive volume; tet4 locks in bending and near nu = 0.5, so stresses
            for design come from tet10.
        material: the material of all cells.
        fixed: which displacements are prescribed.
        value: prescribed displacement [mm]; ignored where not fixed.
        forces: nodal forces [N] of each load case, made by `fea.boundary_conditions`.
        modulus: factor on the material's stiffness: one a cell, or one at each of its quadrature
            points (`TetMesh.quadrature_points`).

    Supports, and the displacements they prescribe, are the same in every load case.
    """

    positions: ClassVar[str] = "nodes"

    mesh: TetMesh
    material: AbstractMaterial
    fixed: Bool[np.ndarray, "nodes 3"]
    value: Float[np.ndarray, "nodes 3"]
    forces: Float[np.ndarray, "cases nodes 3"]
    modulus: Float[np.ndarray, "cells samples"]

    @classmethod
    def from_supports(
        cls,
        mesh: TetMesh,
        material: AbstractMaterial,
        supports: Sequence[Support],
        forces: Float[np.ndarray, "*cases nodes 3"],
        *,
        modulus: Float[np.ndarray, "cells samples"] | None = None,
    ) -> "SolidProblem":
        """A problem from supports on nodes.

        Args:
            mesh: tetrahedra.
            material: the material of all cells.
            supports: prescribed displacements; together they hold every rigid motion.
            forces: nodal forces [N] of one load case, or of several.
            modulus: factor on the material's stiffness; ones by default.

        Raises:
            FeaError: when supports contradict each other or name nodes that do not exist.
        """
        fixed, value = prescribed_dofs(tuple(supports), len(mesh.nodes))
        if modulus is None:
            modulus = np.ones((len(mesh.tets), 1))
        cases = forces if np.ndim(forces) == 3 else np.asarray(forces)[None]
        return cls(mesh, material, fixed, value, cases, modulus)

    @property
    def points(self) -> Float[np.ndarray, "nodes 3"]:
        """Positions of the nodes [mm]."""
        return self.mesh.nodes

    @property
    def groups(self) -> tuple[Int[np.ndarray, "cells corners"]]:
        """Nodes of each cell."""
        return (self.mesh.tets,)

    @property
    def loads(self) -> Float[np.ndarray, "cases nodes 3"]:
        """The nodal forces [N]."""
        return self.forces

    @property
    def parameters(self) -> dict[str, np.ndarray]:
        """Node positions [mm] and relative modulus."""
        return {"nodes": self.mesh.nodes, "modulus": self.modulus}

    @property
    def proves_definite(self) -> bool:
        """Yes: `free_body` is exact."""
        return True

    def with_parameters(self, values: Mapping[str, np.ndarray]) -> "SolidProblem":
        """The same problem with other nodes, modulus, forces or prescribed values."""
        given = dict(values)
        nodes = given.pop("nodes", None)
        mesh = self.mesh if nodes is None else self.mesh.with_nodes(nodes)
        return replace(self, mesh=mesh, **given)

    def check(self) -> None:
        """Refuse impossible meshes, moduli and supports.

        Raises:
            FeaError: for inverted cells, nodes outside all cells, a modulus that is not positive,
                or supports that leave a motion free.
        """
        self.mesh.check()
        cells, quad = len(self.mesh.tets), len(self.mesh.element_type.quadrature.weights)
        if self.modulus.shape not in {(cells, 1), (cells, quad)}:
            raise FeaError(
                f"Relative moduli have shape {self.modulus.shape}; give ({cells}, 1), one a cell"
                f"{'' if quad == 1 else f', or ({cells}, {quad}), one at each quadrature point'}."
            )
        if not (self.modulus > 0).all() or not np.isfinite(self.modulus).all():
            cell = int(np.argmin(np.where(np.isfinite(self.modulus), self.modulus, -np.inf).min(1)))
            raise FeaError(
                f"The relative modulus of cell {cell} is {self.modulus[cell].min():g}; moduli must "
                "be positive numbers (a void is a small one, such as 1e-6)."
            )
        if not self.fixed.any():
            raise FeaError("No displacement is prescribed; add a support.")
        body = free_body(self.mesh, self.fixed)
        if body:
            raise FeaError(f"Supports leave a free motion: {body}; add a support that holds it.")

    def solved(
        self, *, previous: "SolidSolution | None" = None, solver: str = "auto"
    ) -> "SolidSolution":
        """See `solve_solid`."""
        return SolidSolution(*equilibrium(self, previous=previous, solver=solver))

    def stiffness(self, pattern: Pattern) -> bsr_array:
        """K of the free-floating solid, rows ux, uy, uz of each node [N/mm].

        K_e = ∫ Bᵀ C B dV (Bathe, Finite Element Procedures, 2nd ed., equation 4.33), assembled as
        explained in `gradient_products`.
        """
        element, mesh = self.mesh.element_type, self.mesh
        pairs = len(node_pairs(len(element.nodes))[0])
        products = np.zeros((len(mesh.tets), pairs, 3, 3))
        for cells, some in batches(len(mesh.tets), CELLS_AT_ONCE):
            block = _products(mesh.nodes[mesh.tets[some]], self.modulus[some])
            products[cells] = np.asarray(block)[: len(products[cells])]
        C = elasticity_tensor(self.material.stiffness)
        apply = C.transpose(1, 3, 0, 2).reshape(9, 9)  # (j, l) -> (i, k)
        edges, nodes = (
            (blocks.reshape(-1, 9) @ apply).reshape(-1, 3, 3) for blocks in pattern.sums(products)
        )
        return pattern.matrix(edges, nodes)

    def operator(self, fixed: Bool[np.ndarray, "nodes 3"]) -> ElementOperator:
        """K as products of cells: 12 (tet4) or 124 (tet10) numbers a cell are kept."""
        mesh = self.mesh
        element = mesh.element_type
        gradients, det = _physical_gradients(mesh.nodes[mesh.tets])
        weight = self.modulus * det * element.quadrature.weights[None, :]
        C, free = jnp.asarray(self.material.stiffness), jnp.asarray(~fixed)
        cells = (gradients, weight, jnp.asarray(mesh.tets), C, free)
        return ElementOperator(Partial(_product, cells), _diagonal(cells))

    def bilinear_gradient(
        self, v: Float[np.ndarray, "cases nodes 3"], u: Float[np.ndarray, "cases nodes 3"]
    ) -> dict[str, np.ndarray]:
        """Derivative of sum_c v_c' K u_c by node positions [N] and relative modulus [N mm]."""
        tets = self.mesh.tets
        C = self.material.stiffness
        by_position = np.zeros((*tets.shape, 3))
        by_modulus = np.zeros(self.modulus.shape)
        for cells, some in batches(len(tets), CELLS_AT_ONCE):
            at = tets[some]
            fields = (v[:, at], u[:, at])
            dx, dE = _bilinear_gradient(self.mesh.nodes[at], self.modulus[some], fields, C)
            by_position[cells] = np.asarray(dx)[: len(by_position[cells])]
            by_modulus[cells] = np.asarray(dE)[: len(by_modulus[cells])]
        corners = tets.size
        gather = csc_array(
            (np.ones(corners), tets.ravel(), np.arange(corners + 1)),
            shape=(len(self.mesh.nodes), corners),
        )
        return {"nodes": gather @ by_position.reshape(-1, 3), "modulus": by_modulus}

    def load_gradient(self, v: Float[np.ndarray, "cases nodes 3"]) -> dict[str, np.ndarray]:
        """Derivative of sum_c v_c' f_c by the forces."""
        return {"forces": v}


@dataclass(frozen=True, eq=False)
class SolidSolution(AbstractSolution):
    """What the load cases do to a solid; see `AbstractSolution` for displacement and reaction."""

    problem: SolidProblem

    @cached_property
    def quadrature_stress(self) -> Float[np.ndarray, "cases cells quad 6"]:
        """Stress at the quadrature points of each cell [MPa], Voigt order.

        These are the points of best accuracy (Barlow 1976).
        """
        problem, mesh = self.problem, self.problem.mesh
        quad = len(mesh.element_type.quadrature.weights)
        stress = np.zeros((len(self.displacement), len(mesh.tets), quad, 6))
        for cells, some in batches(len(mesh.tets), CELLS_AT_ONCE):
            at = mesh.tets[some]
            block = _stress(
                mesh.nodes[at],
                problem.modulus[some],
                self.displacement[:, at],
                problem.material.stiffness,
            )
            stress[:, cells] = np.asarray(block)[:, : stress[:, cells].shape[1]]
        return stress

    @cached_property
    def recovered(self) -> RecoveredStress:
        """Stress recovered on each side of jumps of the modulus; see `fea.stress_recovery`."""
        problem = self.problem
        return recovered_stress(problem.mesh, self.quadrature_stress, modulus=problem.modulus)

    @property
    def stress(self) -> Float[np.ndarray, "cases nodes 6"]:
        """Stress recovered at the nodes [MPa], Voigt order.

        On a jump of the modulus, that of the stiffest side; `recovered` has the others.
        """
        return self.recovered.at_nodes

    @cached_property
    def error_estimate(self) -> ErrorEstimate:
        """Estimated error of each cell and of each load case; see `fea.error_estimate`."""
        problem = self.problem
        return estimate_error(
            problem.mesh,
            problem.material.stiffness,
            self.quadrature_stress,
            self.recovered,
            modulus=problem.modulus,
        )


def solve_solid(
    problem: SolidProblem, *, previous: SolidSolution | None = None, solver: str = "auto"
) -> SolidSolution:
    """Displacement, stress, reaction and compliance of every load case.

    Args:
        problem: the solid and its loads.
        previous: solution of the same cells and supports with other node positions, modulus,
            prescribed values or forces; what can be reused is. Its factor is spent afterwards.
        solver: "auto", "pardiso", "superlu", "amg" or "jax-cg"; see `fea.linear_solve.factorise`.

    Raises:
        FeaError: for inverted cells, supports that leave a rigid motion, numbers that are none, or
            a solver that fails; the message names the place and the remedy.
    """
    return problem.solved(previous=previous, solver=solver)


def quadrature_stress(
    problem: SolidProblem,
    displacement: Float[ArrayLike, "cases nodes 3"],
    *,
    nodes: Float[ArrayLike, "nodes 3"] | None = None,
    modulus: Float[ArrayLike, "cells samples"] | None = None,
) -> Float[Array, "cases cells quad 6"]:
    """Stress at the quadrature points of each cell [MPa], for JAX to differentiate.

    Stress depends on positions and modulus also directly: what `fea.displacement` was given by name
    must be given here too, or the derivative lacks that part.

    Args:
        problem: gives cells and material, and what the arguments leave out.
        displacement: of the nodes [mm].
        nodes: their positions [mm].
        modulus: relative modulus.

    Raises:
        FeaError: when an argument is of another mesh.
    """
    mesh = problem.mesh
    x = jnp.asarray(mesh.nodes if nodes is None else nodes)
    E = jnp.asarray(problem.modulus if modulus is None else modulus)
    u = jnp.asarray(displacement)
    # JAX would take the last node for any number beyond it.
    for name, given, wanted in (
        ("displacement", u.shape[1:], mesh.nodes.shape),
        ("nodes", x.shape, mesh.nodes.shape),
        ("modulus", E.shape[:1], mesh.tets.shape[:1]),
    ):
        if given != wanted:
            raise FeaError(f'"{name}" has shape {given} here; this mesh needs {wanted}.')
    return _stress(x[mesh.tets], E, u[:, mesh.tets], problem.material.stiffness)


@jax.jit
def _physical_gradients(x: ArrayLike) -> tuple[Array, Array]:
    return physical_gradients(jnp.asarray(x), TETRAHEDRA[x.shape[1]].gradient_at_quadrature)


def _product(cells: tuple[Array, ...], u: Float[Array, "nodes 3"]) -> Float[Array, "nodes 3"]:
    gradients, weight, tets, C, free = cells
    moving = jnp.where(free, u, 0.0)
    H = jnp.einsum("cni,cqnj->cqij", moving[tets], gradients)
    forces = jnp.zeros_like(u).at[tets].add(cell_forces(H, gradients, weight, C))
    return jnp.where(free, forces, u)


@jax.jit
def _diagonal(cells: tuple[Array, ...]) -> Float[Array, "nodes 3 3"]:
    gradients, weight, tets, C, free = cells
    B = jnp.einsum("vij,cqnj->cqnvi", STRAIN, gradients)
    own = jnp.einsum("cq,cqnvi,vw,cqnwj->cnij", weight, B, C, B)
    blocks = jnp.zeros((len(free), 3, 3)).at[tets].add(own)
    return masked_blocks(blocks, free)


@jax.jit
def _products(x: ArrayLike, modulus: ArrayLike) -> Array:
    return gradient_products(jnp.asarray(x), jnp.asarray(modulus), TETRAHEDRA[x.shape[1]])


@jax.jit
def _stress(
    x: Float[ArrayLike, "cells corners 3"],
    modulus: Float[ArrayLike, "cells samples"],
    u: Float[ArrayLike, "cases cells corners 3"],
    C: Float[ArrayLike, "6 6"],
) -> Float[Array, "cases cells quad 6"]:
    H, _ = displacement_gradients(jnp.asarray(x), jnp.asarray(u), TETRAHEDRA[x.shape[1]])
    return jnp.asarray(modulus)[None, :, :, None] * jnp.einsum("vw,...w->...v", C, strain(H))


@jax.jit
def _bilinear_gradient(
    x: Float[ArrayLike, "cells corners 3"],
    modulus: Float[ArrayLike, "cells samples"],
    fields: tuple[ArrayLike, ArrayLike],
    C: Float[ArrayLike, "6 6"],
) -> tuple[Float[Array, "cells corners 3"], Float[Array, "cells samples"]]:
    v, u = (jnp.asarray(field) for field in fields)

    def energy(x: Array, modulus: Array) -> Array:
        Hv, volume = displacement_gradients(x, v, TETRAHEDRA[x.shape[1]])
        Hu, _ = displacement_gradients(x, u, TETRAHEDRA[x.shape[1]])
        density = jnp.einsum("scqv,vw,scqw->cq", strain(Hv), C, strain(Hu))
        return jnp.sum(modulus * volume * density)

    return jax.grad(energy, argnums=(0, 1))(jnp.asarray(x), jnp.asarray(modulus))
