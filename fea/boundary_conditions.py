"""Supports, loads as consistent nodal forces, and the rigid motions that supports leave.

Every load is integrated against the shape functions, so the resultant force and moment of the
nodal forces are those of the load, whatever the mesh.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from fea.elements import TRIANGLES
from fea.errors import FeaError
from fea.quadrature import TETRAHEDRON_5
from fea.rigid_motion import free_motion as free_motion
from fea.rigid_motion import rigid_body_modes as rigid_body_modes
from fea.tet_mesh import TetMesh


@dataclass(frozen=True, eq=False)
class Support:
    """Nodes whose displacement is prescribed.

    Attributes:
        nodes: the nodes.
        fixed: which of x, y, z are prescribed.
        value: prescribed displacement [mm]; read where `fixed`.
    """

    nodes: Int[np.ndarray, " nodes"]
    fixed: Bool[np.ndarray, " 3"]
    value: Float[np.ndarray, " 3"]

    @classmethod
    def clamp(cls, nodes: Int[np.ndarray, " nodes"]) -> "Support":
        """All three displacements zero."""
        return cls(nodes, np.ones(3, dtype=bool), np.zeros(3))


def traction_forces(
    mesh: TetMesh,
    facets: Int[np.ndarray, "facets corners"],
    traction: Float[np.ndarray, " 3"],
) -> Float[np.ndarray, "nodes 3"]:
    """Nodal forces [N] of a uniform traction [MPa] on facets."""
    _, normal = mesh.facet_points(facets)
    weight = np.linalg.norm(normal, axis=-1)
    return _spread(mesh, facets, weight[..., None] * traction)


def pressure_forces(
    mesh: TetMesh, facets: Int[np.ndarray, "facets corners"], pressure: float
) -> Float[np.ndarray, "nodes 3"]:
    """Nodal forces [N] of a pressure [MPa]; positive pushes against the outward normal."""
    _, normal = mesh.facet_points(facets)
    return _spread(mesh, facets, -pressure * normal)


def force_on_facets(
    mesh: TetMesh, facets: Int[np.ndarray, "facets corners"], force: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "nodes 3"]:
    """Nodal forces [N] of a resultant force [N] spread over facets as a uniform traction.

    Raises:
        FeaError: when the facets have no area.
    """
    return traction_forces(mesh, facets, force / _area(mesh, facets))


def moment_on_facets(
    mesh: TetMesh, facets: Int[np.ndarray, "facets corners"], moment: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "nodes 3"]:
    """Nodal forces [N] of a moment [N mm] about the facets' centroid, with zero resultant force.

    The traction is t = a x (x - c), c the centroid; then M = J a with the facets' second moment
    of area J = ∫ |r|² 1 - r rᵀ, r = x - c.

    Raises:
        FeaError: when the facets have no area.
    """
    area = _area(mesh, facets)
    x, normal = mesh.facet_points(facets)
    weight = np.linalg.norm(normal, axis=-1)
    r = x - np.einsum("fq,fqx->x", weight, x) / area
    second = np.einsum("fq,fqx,fqy->xy", weight, r, r)
    a = np.linalg.solve(np.trace(second) * np.eye(3) - second, moment)
    return _spread(mesh, facets, weight[..., None] * np.cross(a, r))


def gravity_forces(
    mesh: TetMesh, density: float, g: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "nodes 3"]:
    """Nodal forces [N] of the weight, for a density [tonne/mm³] and an acceleration [mm/s²]."""
    element = mesh.element_type
    share = np.einsum(
        "cq,q,qn->cn", mesh.jacobians, element.quadrature.weights, element.shape_at_quadrature
    )
    return _accumulate(mesh, mesh.tets, share[..., None] * (density * g))


def body_forces(
    mesh: TetMesh,
    force: Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, "n 3"]],
) -> Float[np.ndarray, "nodes 3"]:
    """Nodal forces [N] of a force per volume [N/mm³] given as a function of position [mm]."""
    element, rule = mesh.element_type, TETRAHEDRON_5
    N, dN = element.shape(rule.points), element.gradient(rule.points)
    corners = mesh.nodes[mesh.tets]
    x = np.einsum("cnx,qn->cqx", corners, N)
    det = np.linalg.det(np.einsum("cnx,qnr->cqxr", corners, dN, optimize=True))
    b = force(x.reshape(-1, 3)).reshape(x.shape)
    return _accumulate(
        mesh, mesh.tets, np.einsum("cq,q,cqx,qn->cnx", det, rule.weights, b, N, optimize=True)
    )


def prescribed_dofs(
    supports: list[Support] | tuple[Support, ...], nodes: int
) -> tuple[Bool[np.ndarray, "nodes 3"], Float[np.ndarray, "nodes 3"]]:
    """Which displacements are prescribed, and their values [mm].

    Args:
        supports: they may overlap where they agree.
        nodes: number of nodes of the mesh.

    Raises:
        FeaError: when supports name nodes that do not exist, or contradict each other.
    """
    fixed = np.zeros((nodes, 3), dtype=bool)
    value = np.zeros((nodes, 3))
    for number, support in enumerate(supports, start=1):
        if support.nodes.size and not 0 <= support.nodes.min() <= support.nodes.max() < nodes:
            raise FeaError(f"Support {number} names a node outside 0 to {nodes - 1}.")
        if not np.isfinite(support.value[support.fixed]).all():
            raise FeaError(f"Support {number} prescribes a displacement that is not a number.")
        for axis in np.flatnonzero(support.fixed):
            known = support.nodes[fixed[support.nodes, axis]]
            clash = known[value[known, axis] != support.value[axis]]
            if clash.size:
                raise FeaError(
                    f"Support {number} prescribes {support.value[axis]:g} mm along {'xyz'[axis]} "
                    f"at node {clash[0]}, where another support prescribes "
                    f"{value[clash[0], axis]:g} mm; let their regions not overlap."
                )
            fixed[support.nodes, axis] = True
            value[support.nodes, axis] = support.value[axis]
    return fixed, value


def _area(mesh: TetMesh, facets: Int[np.ndarray, "facets corners"]) -> float:
    area = float(mesh.facet_integrals(facets)[0].sum())
    if not area > 0:
        raise FeaError("A load acts on facets without area; choose a region with facets in it.")
    return area


def _spread(
    mesh: TetMesh,
    facets: Int[np.ndarray, "facets corners"],
    weighted_traction: Float[np.ndarray, "facets quad 3"],
) -> Float[np.ndarray, "nodes 3"]:
    N = TRIANGLES[facets.shape[1]].shape_at_quadrature
    return _accumulate(mesh, facets, np.einsum("fqx,qn->fnx", weighted_traction, N))


def _accumulate(
    mesh: TetMesh,
    owners: Int[np.ndarray, "elements corners"],
    forces: Float[np.ndarray, "elements corners 3"],
) -> Float[np.ndarray, "nodes 3"]:
    total = np.zeros_like(mesh.nodes)
    np.add.at(total, owners, forces)
    return total
