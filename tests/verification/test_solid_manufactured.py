"""Observed orders of convergence against a manufactured solution.

FeenoX test suite, method of manufactured solutions for linear elasticity: u = sin(pi x)/10,
v = y² z/2, w = x log(1 + y)/5 on the unit cube, displacement prescribed on the whole boundary.
"""

import numpy as np
import pytest

from fea import Material, Support, TetMesh, body_forces, solve_solid
from fea.quadrature import TETRAHEDRON_5

MATERIAL = Material(E=1.0, nu=0.3, density=0.0)


def exact(p):
    x, y, z = p.T
    return np.stack([np.sin(np.pi * x) / 10, y**2 * z / 2, x * np.log1p(y) / 5], axis=1)


def exact_gradient(p):
    """[n, i, j] = du_i/dx_j."""
    x, y, z = p.T
    H = np.zeros((len(p), 3, 3))
    H[:, 0, 0] = np.pi * np.cos(np.pi * x) / 10
    H[:, 1, 1], H[:, 1, 2] = y * z, y**2 / 2
    H[:, 2, 0], H[:, 2, 1] = np.log1p(y) / 5, x / (1 + y) / 5
    return H


def body_force(p):
    """Force per volume -(lambda + mu) grad div u - mu laplace u, by hand from `exact`.

    div u = pi cos(pi x)/10 + y z, so grad div u = (-pi² sin(pi x)/10, z, y);
    laplace u = (-pi² sin(pi x)/10, z, -x/(5 (1 + y)²)).
    """
    lam, mu = MATERIAL.lame
    x, y, z = p.T
    first = -(np.pi**2) * np.sin(np.pi * x) / 10
    grad_div = np.stack([first, z, y], axis=1)
    laplace = np.stack([first, z, -x / (5 * (1 + y) ** 2)], axis=1)
    return -(lam + mu) * grad_div - mu * laplace


def errors(element, cells):
    """L2 norm of the displacement error, and of the error of its gradient."""
    mesh = TetMesh.box((1.0, 1.0, 1.0), (cells, cells, cells))
    mesh = mesh if element == "tet4" else mesh.to_tet10()
    u = exact(mesh.nodes)
    supports = [
        Support(np.array([n]), np.ones(3, dtype=bool), u[n])
        for n in np.unique(mesh.boundary_facets)
    ]
    forces = body_forces(mesh, body_force)[None]
    uh = solve_solid(mesh, MATERIAL, supports, forces).displacement[0]
    # The degree-5 rule is one order above the square of a quadratic element's error.
    kind, rule = mesh.element_type, TETRAHEDRON_5
    corners = mesh.nodes[mesh.tets]
    x = np.einsum("cnx,qn->cqx", corners, kind.shape(rule.points))
    J = np.einsum("cnx,qnr->cqxr", corners, kind.gradient(rule.points))
    weight = np.linalg.det(J) * rule.weights
    value = np.einsum("cni,qn->cqi", uh[mesh.tets], kind.shape(rule.points))
    reference = np.einsum("cni,qnr->cqir", uh[mesh.tets], kind.gradient(rule.points))
    gradient = reference @ np.linalg.inv(J)
    e0 = value - exact(x.reshape(-1, 3)).reshape(x.shape)
    e1 = gradient - exact_gradient(x.reshape(-1, 3)).reshape(gradient.shape)
    return (
        np.sqrt((weight * (e0**2).sum(axis=-1)).sum()),
        np.sqrt((weight * (e1**2).sum(axis=(-1, -2))).sum()),
    )


@pytest.mark.parametrize(
    ("element", "cells", "L2", "H1"), [("tet4", (6, 12), 2, 1), ("tet10", (3, 6), 3, 2)]
)
def test_orders_of_convergence_are_those_of_theory(element, cells, L2, H1):
    coarse, fine = errors(element, cells[0]), errors(element, cells[1])
    order = np.log2(np.array(coarse) / np.array(fine))
    # 0.15: what the reference suite allows for meshes that are not yet asymptotic.
    np.testing.assert_allclose(order, [L2, H1], atol=0.15)
