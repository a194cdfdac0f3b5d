"""Curved parts against closed forms and published targets; meshes are mapped boxes."""

import numpy as np
import pytest

from fea import Material, Support, TetMesh, pressure_forces, solve_solid, traction_forces
from fea.voigt import tensor

AXES = np.eye(3, dtype=bool)


def mapped(cells, function):
    """A unit box mesh with quadratic cells, every node moved by a smooth map."""
    mesh = TetMesh.box((1.0, 1.0, 1.0), cells).to_tet10()
    return TetMesh(function(*mesh.nodes.T), mesh.tets)


def slide(mesh, axis, where):
    """No displacement along an axis at the nodes that a mask selects."""
    return Support(np.flatnonzero(where), AXES[axis], np.zeros(3))


def facets_where(mesh, test):
    """Boundary facets all of whose nodes pass a test of their positions."""
    inside = test(mesh.nodes)[mesh.boundary_facets].all(axis=1)
    return mesh.boundary_facets[inside]


def quarter_cylinder(nu):
    """Lamé: plane strain, inner pressure 1, a = 3, b = 9, E = 1000."""

    def polar(s, t, z):
        # Cells grow with the radius as the stress gradient falls.
        r, angle = 3.0 * 3.0**s, t * np.pi / 2
        return np.stack([r * np.cos(angle), r * np.sin(angle), 0.5 * z], axis=1)

    mesh = mapped((8, 8, 1), polar)
    x, y, z = mesh.nodes.T
    supports = [
        slide(mesh, 0, np.abs(x) < 1e-9),
        slide(mesh, 1, np.abs(y) < 1e-9),
        slide(mesh, 2, (np.abs(z) < 1e-9) | (np.abs(z - 0.5) < 1e-9)),
    ]
    bore = facets_where(mesh, lambda p: np.abs(np.hypot(p[:, 0], p[:, 1]) - 3) < 1e-9)
    forces = pressure_forces(mesh, bore, 1.0)
    return mesh, solve_solid(mesh, Material(1000.0, nu, 0.0), supports, forces[None])


@pytest.mark.parametrize(
    ("nu", "u_a"), [(0.3, 4.5825e-3), (0.49, 5.0399e-3), (0.499, 5.0602e-3), (0.4999, 5.0623e-3)]
)
def test_lame_cylinder_does_not_lock_with_quadratic_cells(nu, u_a):
    """u(a) of Lamé's thick cylinder in plane strain, also nearly incompressible."""
    mesh, solution = quarter_cylinder(nu)
    bore = np.abs(np.hypot(mesh.nodes[:, 0], mesh.nodes[:, 1]) - 3) < 1e-9
    radial = np.einsum("nx,nx->n", solution.displacement[0, bore], mesh.nodes[bore]) / 3
    np.testing.assert_allclose(radial.mean(), u_a, rtol=0.01)


def test_lame_cylinder_hoop_stress_at_the_bore():
    """Hoop stress (a² + b²)/(b² - a²) = 1.25 at r = a."""
    mesh, solution = quarter_cylinder(0.3)
    x, y, _ = mesh.nodes.T
    bore = np.abs(np.hypot(x, y) - 3) < 1e-9
    hoop = np.stack([-y, x, 0 * x], axis=1)[bore] / 3
    stress = tensor(solution.stress[0, bore])
    value = np.einsum("ni,nij,nj->n", hoop, stress, hoop)
    # The mean over the bore to 1 %, single nodes at the corners of the mesh to 3 %.
    np.testing.assert_allclose(value.mean(), 1.25, rtol=0.01)
    np.testing.assert_allclose(value, 1.25, rtol=0.03)


def octant_of_a_sphere(cells):
    """Three mapped boxes, one for each face of the cube that the octant is the corner of."""
    mesh = TetMesh.box((1.0, 1.0, 1.0), (cells, cells, cells)).to_tet10()
    s, t, w = mesh.nodes.T
    # Equal angles rather than equal lengths on the cube's face.
    direction = np.stack([np.ones_like(s), np.tan(s * np.pi / 4), np.tan(t * np.pi / 4)], axis=1)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    third = direction * (2.0**w)[:, None]
    nodes = np.concatenate([np.roll(third, k, axis=1) for k in range(3)])
    tets = np.concatenate([mesh.tets + k * len(third) for k in range(3)])
    _, first, number = np.unique(
        np.round(nodes, 9) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    return TetMesh(nodes[first], number.ravel()[tets])


def test_lame_sphere_under_inner_pressure():
    """Lamé: p = 1, E = 1000, nu = 0.3, a = 1, b = 2: u(a) = 8e-4, u(b) = 3e-4, hoop 5/7, 3/14."""
    mesh = octant_of_a_sphere(5)
    radius = np.linalg.norm(mesh.nodes, axis=1)
    supports = [slide(mesh, k, np.abs(mesh.nodes[:, k]) < 1e-9) for k in range(3)]
    bore = facets_where(mesh, lambda p: np.abs(np.linalg.norm(p, axis=1) - 1) < 1e-9)
    forces = pressure_forces(mesh, bore, 1.0)
    solution = solve_solid(mesh, Material(1000.0, 0.3, 0.0), supports, forces[None])
    for r, u, hoop in [(1.0, 8.0e-4, 0.7142857), (2.0, 3.0e-4, 0.2142857)]:
        at = np.abs(radius - r) < 1e-9
        radial = np.einsum("nx,nx->n", solution.displacement[0, at], mesh.nodes[at]) / r
        np.testing.assert_allclose(radial, u, rtol=0.01)
        sigma = tensor(solution.stress[0, at])
        n = mesh.nodes[at] / r
        normal = np.einsum("ni,nij,nj->n", n, sigma, n)
        # Mean of the two hoop stresses: what of the trace is not radial.
        mean_hoop = (np.trace(sigma, axis1=1, axis2=2) - normal) / 2
        np.testing.assert_allclose(mean_hoop.mean(), hoop, rtol=0.01)


def test_nafems_le1_elliptic_membrane():
    """NAFEMS, Standard Benchmarks, LE1: 92.7 MPa at (2, 0), 0.1 m thick, 210 GPa, nu = 0.3."""

    def ellipses(s, t, z):
        angle = t * np.pi / 2
        a, b = 2.0 + s * 1.25, 1.0 + s * 1.75
        return np.stack([a * np.cos(angle), b * np.sin(angle), 0.1 * z], axis=1)

    mesh = mapped((20, 24, 1), ellipses)
    x, y, _ = mesh.nodes.T
    supports = [
        slide(mesh, 0, np.abs(x) < 1e-9),
        slide(mesh, 1, np.abs(y) < 1e-9),
        Support(np.array([0]), AXES[2], np.zeros(3)),
    ]
    outer = facets_where(mesh, lambda p: (p[:, 0] / 3.25) ** 2 + (p[:, 1] / 2.75) ** 2 > 1 - 1e-9)
    forces = pressure_forces(mesh, outer, -10.0)
    # Symmetry planes leave a motion along z: one node holds it, its reaction is zero.
    solution = solve_solid(mesh, Material(210e3, 0.3, 0.0), supports, forces[None])
    at = (np.abs(x - 2.0) < 1e-9) & (np.abs(y) < 1e-9)
    np.testing.assert_allclose(solution.stress[0, at, 1].mean(), 92.7, rtol=0.03)


@pytest.mark.parametrize(("nu", "u_y"), [(0.3333, 32.20), (0.4999, 27.5)])
def test_cooks_membrane_in_plane_strain(nu, u_y):
    """CoFEA benchmark: shear 6.25 MPa on the right edge; deflection of its top corner."""

    def trapezoid(s, t, z):
        return np.stack([48 * s, 44 * s + t * (44 - 28 * s), 5 * z], axis=1)

    mesh = mapped((24, 24, 1), trapezoid)
    x, _, z = mesh.nodes.T
    supports = [
        Support.clamp(np.flatnonzero(np.abs(x) < 1e-9)),
        slide(mesh, 2, (np.abs(z) < 1e-9) | (np.abs(z - 5) < 1e-9)),
    ]
    right = facets_where(mesh, lambda p: np.abs(p[:, 0] - 48) < 1e-9)
    forces = traction_forces(mesh, right, np.array([0.0, 6.25, 0.0]))
    solution = solve_solid(mesh, Material(70.0, nu, 0.0), supports, forces[None])
    corner = np.linalg.norm(mesh.nodes[:, :2] - [48, 60], axis=1) < 1e-9
    np.testing.assert_allclose(solution.displacement[0, corner, 1].mean(), u_y, rtol=0.02)
