"""Nodal forces of loads: quadrature over facets and cells, against the shape functions."""

from typing import Any

import numpy as np
from jaxtyping import Array, Float, Int, Num

from fea.elements import TETRAHEDRA, TRIANGLES
from fea.errors import FeaError
from fea.isoparametric import cell_points, facet_points
from fea.load_values import namespace, numbers
from fea.quadrature import TRIANGLE_4, Quadrature
from fea.tet_mesh import TetMesh

# N times the normal of a curved tri6 has degree 4, and N times a quadratic load on a straight one.
FACET_RULE = TRIANGLE_4

Nodes = Num[np.ndarray | Array, "nodes 3"]
# Of the kind of what goes in: NumPy, or JAX where anything that goes in is.
Forces = Float[Any, "nodes 3"]
Facets = Int[np.ndarray, "facets corners"]


def on_facets(
    mesh: TetMesh, facets: Facets, nodes: Nodes | None, load: object
) -> tuple[Float[Any, "facets quad 3"], Float[Any, "facets quad 3"]]:
    """Quadrature points of facets [mm], and normals times the area that each stands for [mm²].

    Args:
        mesh: the mesh.
        facets: rows of `mesh.boundary_facets`.
        nodes: positions to use instead of the mesh's.
        load: what will act there; the result is a JAX array where it, or `nodes`, is.

    Raises:
        FeaError: when facets or nodes are not of this mesh.
    """
    corners = 3 if mesh.element == "tet4" else 6
    if facets.ndim != 2 or facets.shape[1] != corners:
        raise FeaError(
            f"Facets have shape {facets.shape}; a {mesh.element} mesh takes {corners} nodes a row, "
            "as in mesh.boundary_facets[chosen] or mesh.facets_where(test)."
        )
    if facets.size and not 0 <= facets.min() <= facets.max() < len(mesh.nodes):
        raise FeaError(
            f"Facets refer to nodes {facets.min()} to {facets.max()}, but the mesh has nodes 0 to "
            f"{len(mesh.nodes) - 1}; take them from this mesh."
        )
    return facet_points(_positions(mesh, nodes, load)[facets], FACET_RULE)


def in_cells(
    mesh: TetMesh, nodes: Nodes | None, rule: Quadrature, *loads: object
) -> tuple[Float[Any, "cells quad 3"], Float[Any, "cells quad"]]:
    """Quadrature points of all cells [mm], and the volume that each stands for [mm³].

    Args:
        mesh: the mesh.
        nodes: positions to use instead of the mesh's.
        rule: the points.
        *loads: what will act there; the result is a JAX array where any, or `nodes`, is.

    Raises:
        FeaError: when nodes are not of this mesh.
    """
    return cell_points(_positions(mesh, nodes, *loads)[mesh.tets], rule)


def _positions(mesh: TetMesh, nodes: Nodes | None, *loads: object) -> Any:
    x = mesh.nodes if nodes is None else numbers(nodes, "array `nodes`")
    if x.shape != mesh.nodes.shape:
        raise FeaError(f"`nodes` has shape {x.shape}, but the mesh has {mesh.nodes.shape}.")
    return namespace(x, *loads).asarray(x)


def check_area(mesh: TetMesh, facets: Facets) -> None:
    """Raise unless facets have an area, by the mesh's own nodes, as moved ones may be traced.

    Raises:
        FeaError: when there are none, or they are flat.
    """
    if not (facets.size and mesh.facet_integrals(facets)[0].sum() > 0):
        raise FeaError("A load acts on facets without area; choose a region with facets in it.")


def norms(vectors: Float[Any, "*shape 3"]) -> Float[Any, "*shape"]:
    """Lengths of vectors."""
    return vectors.__array_namespace__().linalg.norm(vectors, axis=-1)


def forces_of_facets(mesh: TetMesh, facets: Facets, load: Float[Any, "facets quad 3"]) -> Forces:
    """Nodal forces of loads at the facets' quadrature points, each times the area it stands for."""
    return _accumulate(mesh, facets, load, TRIANGLES[facets.shape[1]].shape(FACET_RULE.points))


def forces_of_cells(mesh: TetMesh, load: Float[Any, "cells quad 3"], rule: Quadrature) -> Forces:
    """Nodal forces of loads at the cells' quadrature points, each times its volume."""
    return _accumulate(mesh, mesh.tets, load, TETRAHEDRA[mesh.tets.shape[1]].shape(rule.points))


def _accumulate(
    mesh: TetMesh, owners: Int[np.ndarray, "elements corners"], load: Any, N: np.ndarray
) -> Any:
    xp = load.__array_namespace__()
    forces = xp.einsum("eqx,qn->enx", load, N).reshape(-1, 3)
    node, count = owners.ravel(), len(mesh.nodes)
    if xp is np:
        columns = [np.bincount(node, weights=column, minlength=count) for column in forces.T]
        return np.stack(columns, axis=1)
    return xp.zeros((count, 3)).at[node].add(forces)
