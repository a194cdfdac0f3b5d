import numpy as np
import pytest

from fea import TetMesh, material, nodal_stress
from fea.errors import FeaError
from fea.precision import require_x64
from fea.stress_recovery import quadrature_stress

C = material("steel").stiffness


def bent(mesh):
    """Pure bending about y, exact in three dimensions: sigma_xx = E z / R, all else zero."""
    x, y, z = mesh.nodes.T
    nu, R = 0.3, 1e4
    u = np.stack(
        [x * z, -nu * y * z, -(x**2 + nu * (z**2 - y**2)) / 2],
        axis=1,
    )
    return u[None] / R, 210e3 / R * z


def test_pure_bending_is_exact_at_the_nodes_of_quadratic_cells():
    """Timoshenko and Goodier, Theory of Elasticity, section 102: the field is quadratic."""
    mesh = TetMesh.box((4.0, 1.0, 2.0), (2, 1, 2), origin=(0.0, -0.5, -1.0)).to_tet10()
    u, sigma_xx = bent(mesh)
    stress = nodal_stress(mesh, C, u)[0]
    np.testing.assert_allclose(stress[:, 0], sigma_xx, atol=1e-10)
    np.testing.assert_allclose(stress[:, 1:], 0, atol=1e-10)


def test_linear_cells_approach_pure_bending_with_refinement():
    """A constant per cell, averaged: the mean error falls, at first order or better."""
    error = []
    for n in (2, 4, 8):
        mesh = TetMesh.box((1.0, 1.0, 1.0), (n, n, n), origin=(0.0, -0.5, -0.5))
        u, sigma_xx = bent(mesh)
        error.append(np.abs(nodal_stress(mesh, C, u)[0, :, 0] - sigma_xx).mean())
    assert error[0] > 1.6 * error[1] > 1.6**2 * error[2]


@pytest.mark.parametrize("element", ["tet4", "tet10"])
def test_a_rigid_motion_has_no_stress(element):
    mesh = TetMesh.box((1.0, 2.0, 3.0), (1, 2, 2))
    mesh = mesh if element == "tet4" else mesh.to_tet10()
    turn = np.cross(np.array([1.0, -2.0, 0.5]), mesh.nodes)
    motion = 1e-3 * (turn + np.array([3.0, 1.0, 2.0]))
    assert np.abs(quadrature_stress(mesh, C, motion[None])).max() < 1e-8


def test_float32_is_refused(monkeypatch):
    import jax

    monkeypatch.setattr(jax.config, "read", lambda name: False)
    with pytest.raises(FeaError, match="float32"):
        require_x64()
