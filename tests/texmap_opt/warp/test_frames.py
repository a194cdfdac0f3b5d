"""The frame of a cell: polar rotation of its edges."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from texmap_opt.warp.frames import rotations


def random_edges(d, count, seed):
    """Right-handed edges as rows, singular values within a factor of 20 of each other."""
    rng = np.random.default_rng(seed)
    U, V = (np.linalg.qr(rng.normal(size=(count, d, d)))[0] for _ in range(2))
    edges = (U * rng.uniform(0.1, 2, (count, 1, d))) @ V
    edges[:, 0] *= np.sign(np.linalg.det(edges))[:, None]
    return edges


@pytest.mark.parametrize("d", [2, 3])
def test_the_frame_is_the_polar_factor(d):
    """Against SciPy's, which takes a singular value decomposition (Higham 1986, section 3.1)."""
    edges = random_edges(d, 200, 0)
    expected = np.stack([polar(each)[0] for each in edges])
    np.testing.assert_allclose(rotations(jnp.asarray(edges)), expected, atol=1e-12)


def test_the_frame_of_a_turned_and_stretched_cell_is_its_rotation():
    R = Rotation.from_rotvec([0.4, -1.0, 0.7]).as_matrix()
    edges = np.diag([20.0, 1.0, 3.0]) @ R
    np.testing.assert_allclose(rotations(jnp.asarray(edges[None]))[0], R, atol=1e-12)


def test_a_cell_sheared_by_60_degrees_turns_by_half_the_slope():
    """Simple shear by g in two dimensions has the polar angle arctan(g / 2)."""
    g = np.tan(np.radians(60))
    frame = rotations(jnp.asarray([[[1.0, 0.0], [g, 1.0]]]))[0]
    angle = np.arctan(g / 2)
    expected = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    np.testing.assert_allclose(frame, expected, atol=1e-12)


@pytest.mark.parametrize("d", [2, 3])
def test_frames_do_not_depend_on_the_scale_of_cells(d):
    edges = jnp.asarray(random_edges(d, 20, 1))
    np.testing.assert_allclose(rotations(1e-6 * edges), rotations(edges), atol=1e-12)


@pytest.mark.parametrize("d", [2, 3])
def test_the_frames_derivative_is_that_of_central_differences(d):
    edges = jnp.asarray(random_edges(d, 5, 2))
    direction = jnp.asarray(np.random.default_rng(3).normal(size=edges.shape))
    _, derivative = jax.jvp(rotations, (edges,), (direction,))
    h = 1e-5
    difference = (rotations(edges + h * direction) - rotations(edges - h * direction)) / (2 * h)
    # Truncation: h² times the third derivative, which grows with the cube of 1/0.1.
    np.testing.assert_allclose(derivative, difference, atol=1e-5)
