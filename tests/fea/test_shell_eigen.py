"""Geometric stiffness and mass of the flat triangular shell."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fea.rigid_motion import rigid_body_modes
from fea.shell import Triangle, shell_stiffness
from fea.shell_eigen import CUBIC, QUADRATIC, shell_geometric_stiffness, shell_mass

E, NU, THICKNESS, DENSITY = 70_000.0, 0.3, 0.4, 2.7e-9
SCALENE = np.array([[0.3, -1, 2], [2.5, 0.2, 1.1], [0.9, 1.7, 3.0]])
AREA = np.linalg.norm(np.cross(SCALENE[1] - SCALENE[0], SCALENE[2] - SCALENE[0])) / 2
NORMAL = np.cross(SCALENE[1] - SCALENE[0], SCALENE[2] - SCALENE[0]) / (2 * AREA)

geometric_stiffness = jax.jit(shell_geometric_stiffness)
mass = jax.jit(shell_mass)


def triangle(corners: np.ndarray) -> Triangle:
    return Triangle(jnp.asarray(corners), jnp.asarray(THICKNESS))


def uniform(gradient: np.ndarray) -> np.ndarray:
    """Corner displacements and rotations of a field with this gradient."""
    spin = np.array([gradient[2, 1], gradient[0, 2], gradient[1, 0]])
    spin = (spin - [gradient[1, 2], gradient[2, 0], gradient[0, 1]]) / 2
    return np.concatenate([SCALENE @ gradient.T, np.tile(spin, (3, 1))], axis=1).ravel()


def stretched(forces: np.ndarray) -> np.ndarray:
    """Displacements with these membrane forces [N/mm], a tensor in the plane of the triangle."""
    plane = np.eye(3) - np.outer(NORMAL, NORMAL)
    strain = ((1 + NU) * forces - NU * np.trace(forces) * plane) / (E * THICKNESS)
    return uniform(strain)


def plane_tensor(rng: np.random.Generator) -> np.ndarray:
    """A random symmetric tensor in the plane of the triangle."""
    along = np.linalg.qr(np.stack([NORMAL, *rng.normal(size=(2, 3))]).T)[0][:, 1:]
    values = rng.normal(size=(2, 2))
    return along @ (values + values.T) @ along.T


def test_means_of_products_of_shapes_are_those_of_dirichlet():
    """The mean of l1^a l2^b l3^c over a triangle is 2 a! b! c!/(a + b + c + 2)!."""
    np.testing.assert_allclose(QUADRATIC[0, :3], [1 / 6, 1 / 12, 1 / 12], rtol=1e-13)
    np.testing.assert_allclose(QUADRATIC[3, 3:], np.array([2, 1, 1]) * 4 / 45, rtol=1e-13)
    # (l1 l2 (l1 + l3/2))²: 2 (4! 2! + 3! 2! + 2!^3/4)/8!.
    np.testing.assert_allclose(CUBIC[3, 3], 2 * (48 + 12 + 2) / 40320, rtol=1e-13)


def test_the_mass_of_a_translation_is_that_of_the_triangle():
    M = np.asarray(mass(triangle(SCALENE), DENSITY))
    for axis in np.eye(3):
        move = np.tile(np.concatenate([axis, np.zeros(3)]), 3)
        np.testing.assert_allclose(move @ M @ move, DENSITY * THICKNESS * AREA, rtol=1e-12)


def test_the_mass_of_a_rotation_is_the_inertia_of_the_plate():
    """About a point and any axis: ∫ |omega x r|² of the middle surface, and h²/12 of the section."""
    rng = np.random.default_rng(0)
    omega = rng.normal(size=3)
    spin = np.cross(np.eye(3), omega).T
    M = np.asarray(mass(triangle(SCALENE), DENSITY))
    u = uniform(-spin)
    corners = np.cross(omega, SCALENE)
    # Of a linear field v, the mean square is (sum v_i² + |sum v_i|²)/12.
    mean_square = ((corners**2).sum() + (corners.sum(axis=0) ** 2).sum()) / 12
    section = THICKNESS**2 / 12 * (omega @ omega)
    expected = DENSITY * THICKNESS * AREA * (mean_square + section)
    np.testing.assert_allclose(u @ M @ u, expected, rtol=1e-12)


def test_mass_is_symmetric_and_positive_definite():
    M = np.asarray(mass(triangle(SCALENE), 1.0))
    np.testing.assert_allclose(M, M.T, atol=1e-15 * np.abs(M).max())
    assert np.linalg.eigvalsh(M)[0] > 1e-5 * np.abs(M).max()


def test_geometric_stiffness_is_symmetric_linear_in_u_and_zero_for_rigid_motion_and_bending():
    rng = np.random.default_rng(1)
    u, v = rng.normal(size=(2, 18))

    def G(u: np.ndarray) -> np.ndarray:
        return np.asarray(geometric_stiffness(triangle(SCALENE), E, NU, jnp.asarray(u)))

    size = np.abs(G(u)).max()
    np.testing.assert_allclose(G(u), G(u).T, atol=1e-13 * size)
    np.testing.assert_allclose(G(2 * u - 3 * v), 2 * G(u) - 3 * G(v), atol=1e-12 * size)
    for mode in rigid_body_modes(SCALENE, rotations=True).T:
        assert np.abs(G(mode)).max() < 1e-12 * size
    bend = np.concatenate(
        [np.outer(rng.normal(size=3), NORMAL), np.cross(NORMAL, rng.normal(size=(3, 3)))], 1
    )
    assert np.abs(G(bend.ravel())).max() < 1e-12 * size


def test_tension_stiffens_and_compression_softens():
    plane = np.eye(3) - np.outer(NORMAL, NORMAL)
    for sign in (1, -1):
        u = jnp.asarray(stretched(sign * plane))
        G = geometric_stiffness(triangle(SCALENE), E, NU, u)
        energy = np.linalg.eigvalsh(sign * np.asarray(G))
        assert energy[0] > -1e-12 * energy[-1]
        assert energy[-1] > 0


def test_a_rigid_rotation_turns_the_forces_of_a_stretched_triangle():
    """The work of membrane forces N on a rotation omega: A N : (W' W), W the gradient omega x.

    It is that of the nodal forces, A N grad lambda_i, turned with the triangle. No force is left over.
    """
    rng = np.random.default_rng(2)
    N = plane_tensor(rng)
    G = np.asarray(geometric_stiffness(triangle(SCALENE), E, NU, jnp.asarray(stretched(N))))
    W = np.cross(np.eye(3), rng.normal(size=3)).T
    spin = uniform(W)
    np.testing.assert_allclose(spin @ G @ spin, AREA * np.trace(W @ N @ W.T), rtol=1e-12)
    translations = rigid_body_modes(SCALENE, rotations=True)[:, :3]
    np.testing.assert_allclose(translations.T @ G, 0, atol=1e-12 * np.abs(G).max())


@pytest.mark.parametrize("what", ["mass", "geometric"])
def test_matrices_turn_with_the_triangle_and_do_not_depend_on_the_numbering(what):
    rng = np.random.default_rng(4)
    u = rng.normal(size=(3, 6))
    turn = Rotation.from_rotvec([0.4, -1.0, 2.0]).as_matrix()
    T = np.kron(np.eye(6), turn)
    order = [1, 0, 2]

    def matrix(corners: np.ndarray, u: np.ndarray) -> np.ndarray:
        if what == "mass":
            return np.asarray(mass(triangle(corners), DENSITY))
        return np.asarray(geometric_stiffness(triangle(corners), E, NU, jnp.asarray(u.ravel())))

    own = matrix(SCALENE, u)
    moved = matrix((SCALENE @ turn.T)[order], (T @ u.ravel()).reshape(3, 6)[order])
    expected = (T @ own @ T.T).reshape(3, 6, 3, 6)[order][:, :, order].reshape(18, 18)
    np.testing.assert_allclose(moved, expected, atol=1e-11 * np.abs(own).max())


def test_no_motion_of_a_triangle_has_a_low_spurious_frequency():
    """The lowest elastic motions are bending; drilling is far above them."""
    M = np.asarray(mass(triangle(SCALENE), DENSITY))
    K = np.asarray(shell_stiffness(triangle(SCALENE), E, NU))
    drill = np.concatenate([np.zeros((3, 3)), np.outer([1, -1, 0], NORMAL)], axis=1).ravel()
    bend = np.concatenate(
        [np.zeros((3, 3)), np.outer([1, -1, 0], SCALENE[1] - SCALENE[0])], 1
    ).ravel()

    def rayleigh(u: np.ndarray) -> float:
        return (u @ K @ u) / (u @ M @ u)

    assert rayleigh(drill) > 10 * rayleigh(bend)
