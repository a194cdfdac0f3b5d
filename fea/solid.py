"""Linear elasticity of a solid on tetrahedra: displacement, stress, reactions, compliance."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.sparse import csr_array

from fea.assembly import Pattern, Reduced
from fea.boundary_conditions import Support, prescribed_dofs
from fea.elements import TETRAHEDRA, physical_gradients, strain_displacement
from fea.errors import FeaError
from fea.linear_solve import Factor, factorise
from fea.materials import Material
from fea.precision import require_x64
from fea.rigid_motion import free_motion, rigid_body_modes
from fea.stress_recovery import nodal_stress
from fea.tet_mesh import TetMesh

# Cells whose element matrices are computed at once: 100 MB of strain matrices for tet10.
CELLS_AT_ONCE = 8192


@dataclass(frozen=True, eq=False)
class SolidSolution:
    """What the load cases do to a solid.

    Attributes:
        displacement: [mm].
        stress: recovered at the nodes [MPa], Voigt order.
        reaction: total force of the supports on the solid [N]; balances the loads.
        compliance: sum of u.f over the nodal forces of each case [N mm].
        residual: largest |f - K u| / |f| of the linear solve over the cases.
    """

    displacement: Float[np.ndarray, "cases nodes 3"]
    stress: Float[np.ndarray, "cases nodes 6"]
    reaction: Float[np.ndarray, "cases 3"]
    compliance: Float[np.ndarray, " cases"]
    residual: float


@dataclass(frozen=True, eq=False)
class SolidModel:
    """A supported solid, factorised: ready for any number of loads.

    Attributes:
        mesh: the mesh.
        material: the material of all cells.
        K: stiffness of the free-floating solid, rows ux, uy, uz of each node [N/mm].
        fixed: which displacements are prescribed.
        prescribed: their values [mm].
        reduced: K without the prescribed dofs.
        factor: factor of the reduced matrix.
    """

    mesh: TetMesh
    material: Material
    K: csr_array
    fixed: Bool[np.ndarray, "nodes 3"]
    prescribed: Float[np.ndarray, "nodes 3"]
    reduced: Reduced
    factor: Factor

    @classmethod
    def from_supports(
        cls,
        mesh: TetMesh,
        material: Material,
        supports: Sequence[Support],
        *,
        solver: str = "auto",
    ) -> "SolidModel":
        """Assemble, remove the supports, factorise.

        Args:
            mesh: tetrahedra of positive volume.
            material: the material of all cells.
            supports: prescribed displacements; together they hold every rigid motion.
            solver: see `fea.linear_solve.factorise`.

        Raises:
            FeaError: for inverted cells, nodes outside all cells, supports that contradict each
                other or leave a rigid motion, or a solver that fails.
        """
        require_x64()
        _check_mesh(mesh)
        fixed, prescribed = prescribed_dofs(tuple(supports), len(mesh.nodes))
        pattern = Pattern.from_nodes(mesh.tets, len(mesh.nodes), block=3)
        _check_supports(mesh, pattern, fixed)
        K = pattern.assemble(element_stiffness(mesh, material.stiffness))
        reduced = Reduced.from_matrix(K, fixed.ravel(), block=3)
        modes = reduced.restrict(rigid_body_modes(mesh.nodes))
        factor = factorise(reduced.matrix(K), near_null=modes, block=3, solver=solver)
        return cls(mesh, material, K, fixed, prescribed, reduced, factor)

    def solve(
        self,
        forces: Float[np.ndarray, "cases nodes 3"],
        *,
        start: Float[np.ndarray, "cases nodes 3"] | None = None,
    ) -> SolidSolution:
        """Solve all load cases with the one factor.

        Args:
            forces: nodal forces [N].
            start: displacements to start an iterative solver from [mm].

        Raises:
            FeaError: when forces are not numbers or the solver fails.
        """
        shape = forces.shape
        if shape[1:] != self.mesh.nodes.shape:
            raise FeaError(
                f"Forces are given for {shape[1]} nodes, but the mesh has {len(self.mesh.nodes)}."
            )
        f = forces.reshape(shape[0], -1).T  # dof, case
        p = np.repeat(self.prescribed.reshape(-1, 1), shape[0], axis=1)
        x0 = None
        if start is not None:
            x0 = self.reduced.restrict(start.reshape(shape[0], -1).T)
        solution = self.factor.solve(self.reduced.load(self.K, f, p), x0=x0)
        u = self.reduced.expand(solution.x, p)
        unbalanced = np.where(self.fixed.ravel()[:, None], self.K @ u - f, 0.0)
        displacement = np.ascontiguousarray(u.T).reshape(shape)
        return SolidSolution(
            displacement=displacement,
            stress=nodal_stress(self.mesh, self.material.stiffness, displacement),
            reaction=unbalanced.T.reshape(shape).sum(axis=1),
            compliance=np.einsum("dc,dc->c", u, f),
            residual=solution.residual,
        )


def solve_solid(
    mesh: TetMesh,
    material: Material,
    supports: Sequence[Support],
    forces: Float[np.ndarray, "cases nodes 3"],
    *,
    solver: str = "auto",
) -> SolidSolution:
    """Displacement, nodal stress, reaction and compliance of every load case.

    Args:
        mesh: tetrahedra of positive volume; tet4 locks in bending and near nu = 0.5, so stresses
            for design come from tet10.
        material: the material of all cells.
        supports: prescribed displacements; together they hold every rigid motion.
        forces: nodal forces [N], made by `fea.boundary_conditions`.
        solver: "auto", "pardiso", "superlu" or "amg".

    Raises:
        FeaError: for inverted cells, supports that contradict each other or leave a rigid motion,
            forces that are not numbers, or a solver that fails.
    """
    model = SolidModel.from_supports(mesh, material, supports, solver=solver)
    solution = model.solve(forces)
    model.factor.free()
    return solution


def element_stiffness(mesh: TetMesh, C: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "cells k k"]:
    """Stiffness matrices of all cells [N/mm], rows ux, uy, uz of each node.

    K_e = ∫ Bᵀ C B dV (Bathe, Finite Element Procedures, 2nd ed., equation 4.33).
    """
    require_x64()
    cells, corners = mesh.tets.shape
    # Blocks of one size, so that JAX compiles once; a power of two, so that meshes share it.
    size = min(CELLS_AT_ONCE, 1 << (cells - 1).bit_length())
    K = np.zeros((cells, 3 * corners, 3 * corners))
    for first in range(0, cells, size):
        cell = np.arange(first, first + size) % cells
        block = np.asarray(_stiffness(mesh.nodes[mesh.tets[cell]], C, corners=corners))
        K[first : first + size] = block[: cells - first]
    return K


@partial(jax.jit, static_argnames="corners")
def _stiffness(
    x: Float[Array | np.ndarray, "cells corners 3"],
    C: Float[Array | np.ndarray, "6 6"],
    *,
    corners: int,
) -> Float[Array, "cells k k"]:
    element = TETRAHEDRA[corners]
    gradients, det = physical_gradients(jnp.asarray(x), element.gradient_at_quadrature)
    B = strain_displacement(gradients)
    weighted = B * (det * element.quadrature.weights[None, :])[:, :, None, None]
    # cell, quad point, Voigt, dof
    CB = jnp.einsum("vw,cqwj->cqvj", C, weighted)
    return jnp.einsum("cqvi,cqvj->cij", B, CB)


def _check_mesh(mesh: TetMesh) -> None:
    if not np.isfinite(mesh.nodes).all():
        raise FeaError("Some mesh nodes have positions that are not numbers.")
    inverted = int((~(mesh.jacobians > 0)).any(axis=1).sum())
    if inverted:
        raise FeaError(
            f"{inverted} of {len(mesh.tets)} tetrahedra are flat or inverted; remesh, or reverse "
            "the order of two of their nodes."
        )
    outside = len(mesh.nodes) - len(np.unique(mesh.tets))
    if outside:
        raise FeaError(f"{outside} mesh nodes belong to no tetrahedron; remove them.")


def _check_supports(mesh: TetMesh, pattern: Pattern, fixed: Bool[np.ndarray, "nodes 3"]) -> None:
    """Every connected part must be held on its own."""
    if not fixed.any():
        raise FeaError("No displacement is prescribed; add a support.")
    part = pattern.components()
    parts = int(part.max()) + 1
    for number in range(parts):
        nodes = part == number
        motion = free_motion(mesh.nodes[nodes], fixed[nodes])
        if motion is None:
            continue
        which = "the solid" if parts == 1 else f"piece {number + 1} of {parts} separate pieces"
        raise FeaError(
            f"Supports leave a rigid motion: {which} {motion}; add a support that holds it."
        )
