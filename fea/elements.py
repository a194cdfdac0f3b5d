"""Lagrange elements on the reference triangle and tetrahedron, in the node order of VTK.

VTK order: corners first, then mid-edge nodes of the edges listed in `EDGES`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from fea.assembly import node_pairs
from fea.quadrature import (
    TETRAHEDRON_1,
    TETRAHEDRON_2,
    TRIANGLE_2,
    TRIANGLE_4,
    Quadrature,
)
from fea.voigt import COMPONENT

# Ends of the edge each mid-edge node sits on.
TRIANGLE_EDGES = np.array([[0, 1], [1, 2], [2, 0]])
TETRAHEDRON_EDGES = np.array([[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]])

# Faces of a tetrahedron of positive volume, counter-clockwise seen from outside: corners, then
# the mid-edge nodes of the face in the order of TRIANGLE_EDGES.
FACES_OF_TETRAHEDRON = np.array(
    [[0, 2, 1, 6, 5, 4], [0, 1, 3, 4, 8, 7], [1, 2, 3, 5, 9, 8], [0, 3, 2, 7, 9, 6]]
)

# Strain 6-vector from the displacement gradient: STRAIN[v, i, j] u_i,j; engineering shear.
STRAIN = np.zeros((6, 3, 3))
STRAIN[[0, 1, 2], [0, 1, 2], [0, 1, 2]] = 1
STRAIN[[3, 3, 4, 4, 5, 5], [1, 2, 0, 2, 0, 1], [2, 1, 2, 0, 1, 0]] = 1

ShapeFunction = Callable[[Float[np.ndarray, "n dim"]], np.ndarray]


@dataclass(frozen=True, eq=False)
class Element:
    """Shape functions of one element and the quadrature that integrates its stiffness exactly.

    Attributes:
        name: "tet4", "tet10", "tri3" or "tri6".
        nodes: reference positions of the nodes.
        shape: values of all shape functions at points, [n, corners].
        gradient: their reference gradients at points, [n, corners, dim].
        quadrature: exact for the stiffness of straight-sided elements (tetrahedra), or for a
            linear traction (triangles).
    """

    name: str
    nodes: Float[np.ndarray, "corners dim"]
    shape: ShapeFunction
    gradient: ShapeFunction
    quadrature: Quadrature

    @cached_property
    def shape_at_quadrature(self) -> Float[np.ndarray, "quad corners"]:
        """Shape functions at the quadrature points."""
        return self.shape(self.quadrature.points)

    @cached_property
    def gradient_at_quadrature(self) -> Float[np.ndarray, "quad corners dim"]:
        """Reference gradients at the quadrature points."""
        return self.gradient(self.quadrature.points)

    @cached_property
    def extrapolation(self) -> Float[np.ndarray, "corners quad"]:
        """Values at the nodes from values at the quadrature points.

        The polynomial fitted is constant for one point and linear for four; both are the order
        of the element's own strain.
        """
        if len(self.quadrature.weights) == 1:
            return np.ones((len(self.nodes), 1))
        linear = barycentric(self.quadrature.points)
        return barycentric(self.nodes) @ np.linalg.inv(linear)


def barycentric(points: Float[np.ndarray, "n dim"]) -> Float[np.ndarray, "n simplex"]:
    """Barycentric coordinates, of the origin's corner first."""
    return np.concatenate([1 - points.sum(axis=1, keepdims=True), points], axis=1)


def _barycentric_gradient(dim: int) -> Float[np.ndarray, "simplex dim"]:
    return np.concatenate([-np.ones((1, dim)), np.eye(dim)])


def _linear(points: Float[np.ndarray, "n dim"]) -> Float[np.ndarray, "n corners"]:
    return barycentric(points)


def _linear_gradient(points: Float[np.ndarray, "n dim"]) -> Float[np.ndarray, "n corners dim"]:
    n, dim = points.shape
    return np.broadcast_to(_barycentric_gradient(dim), (n, dim + 1, dim))


def _edges(dim: int) -> Int[np.ndarray, "edges 2"]:
    return TRIANGLE_EDGES if dim == 2 else TETRAHEDRON_EDGES


def _quadratic(points: Float[np.ndarray, "n dim"]) -> Float[np.ndarray, "n corners"]:
    """L(2L - 1) at corners, 4 L_a L_b on edges."""
    L = barycentric(points)
    a, b = _edges(points.shape[1]).T
    return np.concatenate([L * (2 * L - 1), 4 * L[:, a] * L[:, b]], axis=1)


def _quadratic_gradient(points: Float[np.ndarray, "n dim"]) -> Float[np.ndarray, "n corners dim"]:
    L, dL = barycentric(points), _barycentric_gradient(points.shape[1])
    a, b = _edges(points.shape[1]).T
    corner = (4 * L - 1)[:, :, None] * dL
    edge = 4 * (L[:, a, None] * dL[b] + L[:, b, None] * dL[a])
    return np.concatenate([corner, edge], axis=1)


def _nodes(dim: int, *, quadratic: bool) -> Float[np.ndarray, "corners dim"]:
    corners = np.concatenate([np.zeros((1, dim)), np.eye(dim)])
    if not quadratic:
        return corners
    return np.concatenate([corners, corners[_edges(dim)].mean(axis=1)])


TET4 = Element("tet4", _nodes(3, quadratic=False), _linear, _linear_gradient, TETRAHEDRON_1)
TET10 = Element("tet10", _nodes(3, quadratic=True), _quadratic, _quadratic_gradient, TETRAHEDRON_2)
TRI3 = Element("tri3", _nodes(2, quadratic=False), _linear, _linear_gradient, TRIANGLE_2)
TRI6 = Element("tri6", _nodes(2, quadratic=True), _quadratic, _quadratic_gradient, TRIANGLE_4)

TETRAHEDRA = {4: TET4, 10: TET10}
TRIANGLES = {3: TRI3, 6: TRI6}


def physical_gradients(
    x: Float[Array, "cells corners 3"], reference: Float[np.ndarray, "quad corners 3"]
) -> tuple[Float[Array, "cells quad corners 3"], Float[Array, "cells quad"]]:
    """Gradients of the shape functions in space, and det J, by the isoparametric map.

    Args:
        x: node positions of each cell [mm].
        reference: reference gradients at the quadrature points.
    """
    J = jnp.einsum("cnx,qnr->cqxr", x, reference)  # cell, node, space, quad point, reference
    # The inverse by cofactors: rows of `cofactor` are cross products of the columns of J.
    a, b, c = J[..., 0], J[..., 1], J[..., 2]
    cofactor = jnp.stack([jnp.cross(b, c), jnp.cross(c, a), jnp.cross(a, b)], axis=-2)
    det = jnp.einsum("cqx,cqx->cq", a, cofactor[..., 0, :])
    return jnp.einsum("qnr,cqrx->cqnx", reference, cofactor / det[..., None, None]), det


def gradient_products(
    x: Float[Array, "cells corners 3"],
    modulus: Float[Array, "cells samples"],
    element: Element,
) -> Float[Array, "cells pairs 3 3"]:
    """∫ E ∇N_a ⊗ ∇N_b dV of the node pairs (a, b) of `fea.assembly.node_pairs`.

    The stiffness of the pair is linear in this: K_ab[i, k] = C[ijkl] ∫ E N_a,j N_b,l dV. So where
    C is one for the whole solid, it is applied after these have been summed over the cells.

    Args:
        x: node positions of each cell [mm].
        modulus: relative modulus E at the quadrature points, or one a cell.
        element: shape functions and quadrature.
    """
    gradients, det = physical_gradients(x, element.gradient_at_quadrature)
    cells, quad, corners, _ = gradients.shape
    weight = modulus * (det * element.quadrature.weights[None, :])
    a, b = node_pairs(corners)
    if quad == 1:
        # One product each: XLA fuses this, where it would call a matrix product for a sum.
        one = gradients[:, 0]
        return (weight[:, :, None] * one)[:, a, :, None] * one[:, b, None, :]
    columns = gradients.reshape(cells, quad, 3 * corners)
    whole = jnp.einsum("cqm,cqn->cmn", weight[:, :, None] * columns, columns)
    return whole.reshape(cells, corners, 3, corners, 3).transpose(0, 1, 3, 2, 4)[:, a, b]


def displacement_gradients(
    x: Float[Array, "cells corners 3"],
    u: Float[Array, "*cases cells corners 3"],
    element: Element,
) -> tuple[Float[Array, "*cases cells quad 3 3"], Float[Array, "cells quad"]]:
    """du_i/dx_j at the quadrature points, and the volume that each stands for [mm³]."""
    gradients, det = physical_gradients(x, element.gradient_at_quadrature)
    H = jnp.einsum("...cni,cqnj->...cqij", u, gradients)
    return H, det * element.quadrature.weights[None, :]


def strain(
    displacement_gradient: Float[Array, "*shape 3 3"],
) -> Float[Array, "*shape 6"]:
    """Strain 6-vector with engineering shears."""
    return jnp.einsum("vij,...ij->...v", STRAIN, displacement_gradient)


def elasticity_tensor(C: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "3 3 3 3"]:
    """C[ijkl] with stress_ij = C[ijkl] du_k/dx_l, from the elasticity matrix."""
    return np.einsum("vij,vw,wkl->ijkl", STRAIN, C, STRAIN)


def cell_forces(
    displacement_gradient: Float[Array, "cells quad 3 3"],
    gradients: Float[Array, "cells quad corners 3"],
    weight: Float[Array, "cells quad"],
    C: Float[Array | np.ndarray, "6 6"],
) -> Float[Array, "cells corners 3"]:
    """Nodal forces ∫ stress ∇N dV that hold a displacement [N].

    Args:
        displacement_gradient: du_i/dx_j at the quadrature points.
        gradients: of the shape functions in space.
        weight: relative modulus times the volume that each point stands for [mm³].
        C: elasticity matrix [MPa].
    """
    stress = jnp.einsum("vw,cqw->cqv", C, strain(displacement_gradient))
    tensor = stress[..., COMPONENT] * weight[..., None, None]
    return jnp.einsum("cqij,cqnj->cni", tensor, gradients)
