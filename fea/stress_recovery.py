"""Stress from displacements: at quadrature points, and one continuous value at each node."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.sparse import csr_array

from fea.elements import TETRAHEDRA, physical_gradients, strain_displacement
from fea.precision import require_x64
from fea.tet_mesh import TetMesh

# Cells at once, as for the stiffness; gradients are ten times smaller than B'CB.
CELLS_AT_ONCE = 32768


def quadrature_stress(
    mesh: TetMesh, C: Float[np.ndarray, "6 6"], displacement: Float[np.ndarray, "cases nodes 3"]
) -> Float[np.ndarray, "cases cells quad 6"]:
    """Stress C B u at the quadrature points of each cell [MPa].

    These are the points of best accuracy (Barlow 1976).
    """
    require_x64()
    cells, corners = mesh.tets.shape
    quad = len(TETRAHEDRA[corners].quadrature.weights)
    size = min(CELLS_AT_ONCE, 1 << (cells - 1).bit_length())
    stress = np.zeros((len(displacement), cells, quad, 6))
    for first in range(0, cells, size):
        cell = np.arange(first, first + size) % cells
        tets = mesh.tets[cell]
        block = _stress(mesh.nodes[tets], displacement[:, tets], C, corners=corners)
        stress[:, first : first + size] = np.asarray(block)[:, : cells - first]
    return stress


def nodal_stress(
    mesh: TetMesh, C: Float[np.ndarray, "6 6"], displacement: Float[np.ndarray, "cases nodes 3"]
) -> Float[np.ndarray, "cases nodes 6"]:
    """Stress at the nodes [MPa]: extrapolated in each cell, averaged with the cells' volumes.

    Extrapolation from the quadrature points follows Hinton and Campbell, Int. J. Numer. Meth.
    Eng. 8 (1974) 461-480. The average smooths jumps between materials too: one material only.
    """
    at_quadrature = quadrature_stress(mesh, C, displacement)
    in_cells = np.einsum(
        "nq,scqv->scnv", mesh.element_type.extrapolation, at_quadrature, optimize=True
    )
    cells, corners = mesh.tets.shape
    weight = np.repeat(mesh.volumes, corners)
    average = csr_array(
        (weight, (mesh.tets.ravel(), np.arange(cells * corners))),
        shape=(len(mesh.nodes), cells * corners),
    )
    total = average.sum(axis=1)[:, None]
    return np.stack([average @ case.reshape(-1, 6) / total for case in in_cells])


@partial(jax.jit, static_argnames="corners")
def _stress(
    x: Float[Array | np.ndarray, "cells corners 3"],
    u: Float[Array | np.ndarray, "cases cells corners 3"],
    C: Float[Array | np.ndarray, "6 6"],
    *,
    corners: int,
) -> Float[Array, "cases cells quad 6"]:
    element = TETRAHEDRA[corners]
    gradients, _ = physical_gradients(jnp.asarray(x), element.gradient_at_quadrature)
    B = strain_displacement(gradients)
    dofs = jnp.asarray(u).reshape(u.shape[0], u.shape[1], -1)
    return jnp.einsum("vw,cqwd,scd->scqv", C, B, dofs)
