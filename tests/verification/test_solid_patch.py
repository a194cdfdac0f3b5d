"""Constant strain is reproduced exactly on a distorted mesh.

R. H. MacNeal and R. L. Harder, "A proposed standard set of problems to test finite element
accuracy", Finite Elements in Analysis and Design 1 (1985) 3-20, the three-dimensional patch.
"""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from fea import Material, SolidModel, Support, TetMesh, solve_solid
from fea.stress_recovery import quadrature_stress

# The inner nodes of MacNeal and Harder's cube.
INNER = np.array(
    [
        [0.249, 0.342, 0.192],
        [0.826, 0.288, 0.288],
        [0.850, 0.649, 0.263],
        [0.273, 0.750, 0.230],
        [0.320, 0.186, 0.643],
        [0.677, 0.305, 0.683],
        [0.788, 0.693, 0.644],
        [0.165, 0.745, 0.702],
    ]
)
CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
MATERIAL = Material(E=1e6, nu=0.25, density=0.0)

# Solved in double precision on 16 nodes: rounding is 1e-14; the reference demands 1e-10.
RTOL = 1e-10


def prescribed(x):
    """Displacement 1e-3 (2x + y + z)/2 and its cyclic companions: every strain is 1e-3."""
    return 0.5e-3 * (x + x.sum(axis=1, keepdims=True))


def patch(element):
    nodes = np.concatenate([CORNERS, INNER])
    tets = Delaunay(nodes).simplices.astype(np.int64)
    edges = nodes[tets[:, 1:]] - nodes[tets[:, :1]]
    volume = np.linalg.det(edges)
    tets = tets[np.abs(volume) > 1e-9]  # the cube's faces hold flat tetrahedra of no volume
    flip = np.linalg.det(nodes[tets[:, 1:]] - nodes[tets[:, :1]]) < 0
    tets[flip] = tets[flip][:, [1, 0, 2, 3]]
    mesh = TetMesh(nodes, tets)
    return mesh if element == "tet4" else mesh.to_tet10()


def supports(mesh):
    """Prescribe the linear field at every boundary node."""
    boundary = np.unique(mesh.boundary_facets)
    u = prescribed(mesh.nodes)
    everything = np.ones(3, dtype=bool)
    return [Support(np.array([n]), everything, u[n]) for n in boundary]


@pytest.mark.parametrize("element", ["tet4", "tet10"])
def test_macneal_harder_patch_has_2000_normal_and_400_shear_stress(element):
    mesh = patch(element)
    np.testing.assert_allclose(mesh.volume, 1.0, rtol=1e-12)
    solution = solve_solid(mesh, MATERIAL, supports(mesh), np.zeros((1, *mesh.nodes.shape)))
    np.testing.assert_allclose(
        solution.displacement[0], prescribed(mesh.nodes), rtol=RTOL, atol=RTOL * 1e-3
    )
    stress = quadrature_stress(mesh, MATERIAL.stiffness, solution.displacement)[0]
    expected = np.array([2000.0, 2000.0, 2000.0, 400.0, 400.0, 400.0])
    np.testing.assert_allclose(stress, np.broadcast_to(expected, stress.shape), rtol=RTOL)
    np.testing.assert_allclose(
        solution.stress[0], np.broadcast_to(expected, solution.stress[0].shape), rtol=RTOL
    )


def test_the_patch_test_notices_a_wrong_mid_edge_order():
    """Negative control: two mid-edge nodes exchanged, and the field is no longer linear."""
    mesh = patch("tet10")
    wrong = mesh.tets.copy()
    wrong[:, [5, 7]] = wrong[:, [7, 5]]
    good = SolidModel.from_supports(mesh, MATERIAL, supports(mesh))
    u = prescribed(mesh.nodes)[None]
    np.testing.assert_allclose(good.K @ u.ravel(), _boundary_only(good, u), atol=1e-9)
    stress = quadrature_stress(TetMesh(mesh.nodes, wrong), MATERIAL.stiffness, u**2)
    assert np.ptp(stress[..., 0]) > 1.0


def _boundary_only(model, u):
    """Forces of a constant stress act on the boundary alone."""
    forces = model.K @ u.ravel()
    return np.where(model.fixed.ravel(), forces, 0.0)
