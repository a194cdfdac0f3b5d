"""Stiffness and displacement agree with scikit-fem on the same mesh, to rounding."""

import numpy as np
import pytest
import skfem
from skfem.models.elasticity import lame_parameters, linear_elasticity

from fea import Material, SolidModel, Support, TetMesh, force_on_facets, solve_solid
from fea.elements import TETRAHEDRON_EDGES

MATERIAL = Material(E=210e3, nu=0.3, density=0.0)


def distorted(element):
    """A box mesh whose inner nodes are moved, so that no two cells are alike."""
    mesh = TetMesh.box((3.0, 2.0, 1.0), (4, 3, 2))
    inner = np.setdiff1d(np.arange(len(mesh.nodes)), np.unique(mesh.boundary_facets))
    nodes = mesh.nodes.copy()
    nodes[inner] += np.random.default_rng(3).uniform(-0.1, 0.1, (len(inner), 3))
    mesh = TetMesh(nodes, mesh.tets)
    return mesh if element == "tet4" else mesh.to_tet10()


def oracle(mesh):
    """scikit-fem's stiffness in this project's dof order."""
    theirs = skfem.MeshTet(mesh.nodes[np.unique(mesh.tets[:, :4])].T.copy(), mesh.tets[:, :4].T)
    scalar = skfem.ElementTetP1() if mesh.element == "tet4" else skfem.ElementTetP2()
    # Order 2 integrates the product of two linear strains exactly.
    basis = skfem.Basis(theirs, skfem.ElementVector(scalar), intorder=2)
    A = linear_elasticity(*lame_parameters(MATERIAL.E, MATERIAL.nu)).assemble(basis).tocsr()
    # Their dofs by location: corner nodes, then mid-edge nodes; components run fastest.
    where = basis.doflocs.T.reshape(-1, 3, 3)[:, 0]
    from scipy.spatial import cKDTree

    distance, node = cKDTree(where).query(mesh.nodes)
    assert distance.max() < 1e-12
    dofs = (3 * node[:, None] + np.arange(3)).ravel()
    return A[dofs][:, dofs]


def supported(mesh):
    clamp = Support.clamp(np.flatnonzero(mesh.nodes[:, 0] < 1e-9))
    end = mesh.boundary_facets[mesh.facet_centroids[:, 0] > 3 - 1e-9]
    return clamp, force_on_facets(mesh, end, np.array([10.0, -20.0, 30.0]))


@pytest.mark.parametrize("element", ["tet4", "tet10"])
def test_stiffness_equals_that_of_scikit_fem(element):
    mesh = distorted(element)
    clamp, _ = supported(mesh)
    K = SolidModel.from_supports(mesh, MATERIAL, [clamp]).K
    # Both sum the same products in another order: rounding only, relative to the largest entry.
    assert abs(K - oracle(mesh)).max() <= 1e-12 * abs(K).max()


@pytest.mark.parametrize("element", ["tet4", "tet10"])
def test_displacement_equals_that_of_scikit_fem(element):
    mesh = distorted(element)
    clamp, forces = supported(mesh)
    u = solve_solid(mesh, MATERIAL, [clamp], forces[None]).displacement[0]
    fixed = (3 * clamp.nodes[:, None] + np.arange(3)).ravel()
    theirs = skfem.solve(*skfem.condense(oracle(mesh), forces.ravel(), D=fixed))
    # Condition number 1e4 times rounding, with two digits to spare.
    np.testing.assert_allclose(u.ravel(), theirs, rtol=1e-9, atol=1e-9 * abs(theirs).max())


def test_mid_edge_nodes_lie_between_the_ends_vtk_names():
    mesh = distorted("tet10")
    ends = mesh.nodes[mesh.tets[:, TETRAHEDRON_EDGES]]
    np.testing.assert_allclose(mesh.nodes[mesh.tets[:, 4:]], ends.mean(axis=2), atol=1e-15)
