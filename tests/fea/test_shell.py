"""The flat triangular shell: published elements, patch tests, invariances, rank, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation
from shell_cases.mapped_skin import mapped_square, whole_matrix

from fea.rigid_motion import rigid_body_modes
from fea.shell import BATCH, PAIRS, Triangle, shell_pairs, shell_stiffness, weighted_strains
from fea.shell_plane import PlaneTriangle

E, NU, THICKNESS = 70_000.0, 0.3, 0.4
RIGHT = np.array([[0.0, 0, 0], [3, 0, 0], [0, 2, 0]])
SCALENE = np.array([[0.3, -1, 2], [2.5, 0.2, 1.1], [0.9, 1.7, 3.0]])
FLAT = np.array([[0.0, 0, 0], [1, 0, 0], [0.4, 0.01, 0]])

# The inner nodes of the patch of MacNeal and Harder (1985), figure 1.
PATCH = np.array(
    [
        [0, 0],
        [0.24, 0],
        [0.24, 0.12],
        [0, 0.12],
        [0.04, 0.02],
        [0.18, 0.03],
        [0.16, 0.08],
        [0.08, 0.08],
    ]
)

one_stiffness = jax.jit(shell_stiffness)
stiffnesses = jax.jit(jax.vmap(shell_stiffness, in_axes=(0, None, None)))


def stiffness(corners: np.ndarray, thickness: float = THICKNESS, nu: float = NU) -> np.ndarray:
    return np.asarray(one_stiffness(triangle(corners, thickness), E, nu))


def triangle(corners: np.ndarray, thickness: float = THICKNESS) -> Triangle:
    return Triangle(jnp.asarray(corners), jnp.asarray(thickness))


def turned(field: np.ndarray, turn: Rotation) -> np.ndarray:
    return turn.apply(field.reshape(-1, 3)).reshape(field.shape)


def felippa_membrane(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Felippa (2003), equations 12, 16, 22, 29, 32, 42 in his notation; u, v, theta by corner."""

    def d(a: np.ndarray, i: int, j: int) -> float:
        return a[i - 1] - a[j - 1]

    A = (d(y, 2, 1) * d(x, 1, 3) - d(x, 2, 1) * d(y, 1, 3)) / 2
    l2 = {ij: d(x, *ij) ** 2 + d(y, *ij) ** 2 for ij in ((2, 1), (3, 2), (1, 3))}
    alpha, beta = 1.5, [0, 1, 2, 1, 0, 1, -1, -1, -1, -2]
    L = np.zeros((9, 3))
    for row, (i, j, k) in enumerate(((1, 2, 3), (2, 3, 1), (3, 1, 2))):
        L[3 * row] = [d(y, j, k), 0, d(x, k, j)]
        L[3 * row + 1] = [0, d(x, k, j), d(y, j, k)]
        L[3 * row + 2] = [
            alpha / 6 * d(y, j, k) * (d(y, i, k) - d(y, j, i)),
            alpha / 6 * d(x, k, j) * (d(x, k, i) - d(x, i, j)),
            alpha / 3 * (d(x, k, i) * d(y, i, k) - d(x, i, j) * d(y, j, i)),
        ]
    L *= THICKNESS / 2
    C = E / (1 - NU**2) * np.array([[1, NU, 0], [NU, 1, 0], [0, 0, (1 - NU) / 2]])
    T = np.tile(
        [d(x, 3, 2), d(y, 3, 2), 0, d(x, 1, 3), d(y, 1, 3), 0, d(x, 2, 1), d(y, 2, 1), 0], (3, 1)
    ) / (4 * A)
    T[range(3), [2, 5, 8]] += 1
    Te = np.array(
        [
            [d(y, 2, 3) * d(y, 1, 3), d(y, 3, 1) * d(y, 2, 1), d(y, 1, 2) * d(y, 3, 2)],
            [d(x, 2, 3) * d(x, 1, 3), d(x, 3, 1) * d(x, 2, 1), d(x, 1, 2) * d(x, 3, 2)],
            [
                d(y, 2, 3) * d(x, 3, 1) + d(x, 3, 2) * d(y, 1, 3),
                d(y, 3, 1) * d(x, 1, 2) + d(x, 1, 3) * d(y, 2, 1),
                d(y, 1, 2) * d(x, 2, 3) + d(x, 2, 1) * d(y, 3, 2),
            ],
        ]
    )
    lengths = np.array([l2[2, 1], l2[3, 2], l2[1, 3]])
    Te = Te * lengths / (4 * A**2)
    natural = Te.T @ C @ Te
    rows = [
        [[1, 2, 3], [4, 5, 6], [7, 8, 9]],
        [[9, 7, 8], [3, 1, 2], [6, 4, 5]],
        [[5, 6, 4], [8, 9, 7], [2, 3, 1]],
    ]
    Q = [2 * A / 3 * np.array(beta)[np.array(r)] / lengths[:, None] for r in rows]
    middle = [(Q[i] + Q[j]) / 2 for i, j in ((0, 1), (1, 2), (2, 0))]
    K_theta = A * THICKNESS * sum(q.T @ natural @ q for q in middle)
    beta_0 = (1 - 4 * NU**2) / 2
    return L @ C @ L.T / (A * THICKNESS) + 3 / 4 * beta_0 * T.T @ K_theta @ T


def batoz_bending(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Batoz, Bathe, Ho (1980), in their notation; w, theta_x, theta_y by corner."""
    x23, x31, x12 = x[1] - x[2], x[2] - x[0], x[0] - x[1]
    y23, y31, y12 = y[1] - y[2], y[2] - y[0], y[0] - y[1]
    xs, ys = np.array([x23, x31, x12]), np.array([y23, y31, y12])
    l2 = xs**2 + ys**2
    P, t, q, r = -6 * xs / l2, -6 * ys / l2, 3 * xs * ys / l2, 3 * ys**2 / l2
    (P4, P5, P6), (t4, t5, t6), (q4, q5, q6), (r4, r5, r6) = P, t, q, r
    A2 = x31 * y12 - x12 * y31

    def B(xi: float, eta: float) -> np.ndarray:
        a, b = 1 - 2 * xi, 1 - 2 * eta
        Hx_xi = [
            P6 * a + (P5 - P6) * eta,
            q6 * a - (q5 + q6) * eta,
            -4 + 6 * (xi + eta) + r6 * a - eta * (r5 + r6),
            -P6 * a + eta * (P4 + P6),
            q6 * a - eta * (q6 - q4),
            -2 + 6 * xi + r6 * a + eta * (r4 - r6),
            -eta * (P5 + P4),
            eta * (q4 - q5),
            -eta * (r5 - r4),
        ]
        Hy_xi = [
            t6 * a + eta * (t5 - t6),
            1 + r6 * a - eta * (r5 + r6),
            -q6 * a + eta * (q5 + q6),
            -t6 * a + eta * (t4 + t6),
            -1 + r6 * a + eta * (r4 - r6),
            -q6 * a - eta * (q4 - q6),
            -eta * (t4 + t5),
            eta * (r4 - r5),
            -eta * (q4 - q5),
        ]
        Hx_eta = [
            -P5 * b - xi * (P6 - P5),
            q5 * b - xi * (q5 + q6),
            -4 + 6 * (xi + eta) + r5 * b - xi * (r5 + r6),
            xi * (P4 + P6),
            xi * (q4 - q6),
            -xi * (r6 - r4),
            P5 * b - xi * (P4 + P5),
            q5 * b + xi * (q4 - q5),
            -2 + 6 * eta + r5 * b + xi * (r4 - r5),
        ]
        Hy_eta = [
            -t5 * b - xi * (t6 - t5),
            1 + r5 * b - xi * (r5 + r6),
            -q5 * b + xi * (q5 + q6),
            xi * (t4 + t6),
            xi * (r4 - r6),
            -xi * (q4 - q6),
            t5 * b - xi * (t4 + t5),
            -1 + r5 * b + xi * (r4 - r5),
            -q5 * b - xi * (q4 - q5),
        ]
        Hx_xi, Hy_xi, Hx_eta, Hy_eta = map(np.array, (Hx_xi, Hy_xi, Hx_eta, Hy_eta))
        return (
            np.stack(
                [
                    y31 * Hx_xi + y12 * Hx_eta,
                    -x31 * Hy_xi - x12 * Hy_eta,
                    -x31 * Hx_xi - x12 * Hx_eta + y31 * Hy_xi + y12 * Hy_eta,
                ]
            )
            / A2
        )

    D = (
        E
        * THICKNESS**3
        / 12
        / (1 - NU**2)
        * np.array([[1, NU, 0], [NU, 1, 0], [0, 0, (1 - NU) / 2]])
    )
    return A2 / 6 * sum(B(*p).T @ D @ B(*p) for p in ((0.5, 0), (0, 0.5), (0.5, 0.5)))


def test_the_membrane_is_felippas_optimal_triangle():
    x, y = np.array([0.2, 3.0, 0.9]), np.array([-0.1, 0.4, 2.2])
    K = stiffness(np.stack([x, y, 0 * x], axis=1)).reshape(3, 6, 3, 6)
    own = K[:, [0, 1, 5]][:, :, :, [0, 1, 5]].reshape(9, 9)
    expected = felippa_membrane(x, y)
    # Two ways to round the same sums.
    np.testing.assert_allclose(own, expected, atol=1e-12 * np.abs(expected).max())


def test_bending_is_the_discrete_kirchhoff_triangle_of_batoz_bathe_and_ho():
    x, y = np.array([0.2, 3.0, 0.9]), np.array([-0.1, 0.4, 2.2])
    K = stiffness(np.stack([x, y, 0 * x], axis=1)).reshape(3, 6, 3, 6)
    own = K[:, [2, 3, 4]][:, :, :, [2, 3, 4]].reshape(9, 9)
    expected = batoz_bending(x, y)
    np.testing.assert_allclose(own, expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("corners", [RIGHT, SCALENE, FLAT], ids=["right", "scalene", "flat"])
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_a_free_triangle_has_exactly_six_zero_energy_motions(corners, nu):
    K = stiffness(corners, nu=nu)
    np.testing.assert_allclose(K, K.T, atol=1e-15 * np.abs(K).max())
    singular = np.linalg.svd(
        np.asarray(weighted_strains(triangle(corners), E, nu)).reshape(18, 18), compute_uv=False
    )
    # Rounding is 1e-16 of the largest; the flat one is 100 times wider than high, and nu = 1/2 leaves
    # 1 % of the higher order stiffness.
    assert singular[12] < 1e-13 * singular[0]
    assert singular[11] > 1e-6 * singular[0]
    modes = rigid_body_modes(corners, rotations=True)
    assert np.abs(K @ modes).max() < 1e-12 * np.abs(K).max() * np.abs(modes).max()


@pytest.mark.parametrize("angles", [(0, 0, 0), (0.7, -1.1, 2.0)], ids=["level", "turned"])
@pytest.mark.parametrize("kind", ["membrane", "bending"])
def test_constant_strain_and_constant_curvature_are_exact_on_any_patch(angles, kind):
    """MacNeal and Harder (1985), section 4: the membrane and the bending patch test."""
    x, y = PATCH.T
    z = np.zeros_like(x)
    if kind == "membrane":
        u = np.stack([1e-3 * (x + y / 2), 1e-3 * (y + x / 2), z, z, z, z], axis=1)
    else:
        w = 1e-3 * (x**2 + x * y + y**2) / 2
        u = np.stack([z, z, w, 1e-3 * (y + x / 2), -1e-3 * (x + y / 2), z], axis=1)
    turn = Rotation.from_rotvec(angles)
    points, u = turned(np.stack([x, y, z], axis=1), turn), turned(u, turn)
    triangles = Delaunay(PATCH).simplices
    K = whole_matrix(
        triangles,
        stiffnesses(
            Triangle(jnp.asarray(points[triangles]), jnp.full(len(triangles), 0.001)), 1e6, 0.25
        ),
        8,
    )
    inner = np.arange(24, 48)
    load = -K[np.ix_(inner, np.arange(24))] @ u.ravel()[:24]
    found = np.linalg.solve(K[np.ix_(inner, inner)], load)
    # Stretching is 1e5 times as stiff as bending here, so that rounding of 1e-16 grows to 1e-10.
    np.testing.assert_allclose(found, u.ravel()[24:], atol=1e-8 * np.abs(u).max())


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.45])
@pytest.mark.parametrize("aspect", [0.25, 1.0, 4.0, 16.0])
def test_two_triangles_bend_in_their_plane_as_a_beam_at_any_aspect_ratio(nu, aspect):
    """Felippa (2003), section 5.1: what the free parameters were chosen for."""
    corners = np.array([[-aspect, -1, 0], [aspect, -1, 0], [aspect, 1, 0], [-aspect, 1, 0]]) / 2
    x, y, z = corners.T
    u = np.stack([-x * y, x**2 / 2, z, z, z, x], axis=1)
    energy = sum(
        u[ends].ravel() @ stiffness(corners[ends], nu=nu) @ u[ends].ravel() / 2
        for ends in ([0, 1, 2], [0, 2, 3])
    )
    np.testing.assert_allclose(energy, E * THICKNESS / 12 * aspect / 2, rtol=1e-10)


@settings(max_examples=20, derandomize=True, deadline=None)
@given(
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.permutations(range(3)),
    st.booleans(),
)
def test_stiffness_follows_when_the_triangle_is_turned_mirrored_or_renumbered(
    angles, order, mirror
):
    turn = Rotation.from_rotvec(angles).as_matrix() * (-1 if mirror else 1)
    # Rotations are axial vectors: they keep their sign under inversion.
    axial = turn * (-1 if mirror else 1)
    zero = np.zeros((3, 3))
    T = np.kron(np.eye(3), np.block([[turn, zero], [zero, axial]]))
    K = stiffness(SCALENE)
    moved = stiffness((SCALENE @ turn.T + [10, -20, 5])[order])
    expected = (T @ K @ T.T).reshape(3, 6, 3, 6)[order][:, :, order].reshape(18, 18)
    np.testing.assert_allclose(moved, expected, atol=1e-10 * np.abs(K).max())


def test_a_free_flat_skin_has_exactly_six_zero_energy_motions():
    """Rotations about the normal have a stiffness of their own where all triangles are coplanar."""
    mesh = mapped_square((3, 3), lambda s, t: [3 * s, 2 * t + s * t, 0 * s])
    triangles = mesh.skin(THICKNESS, E, NU).triangle_values(mesh.points)
    K = whole_matrix(mesh.triangles, stiffnesses(triangles, E, NU), 16)
    energy = np.linalg.eigvalsh(K) / np.abs(K).max()
    assert np.abs(energy[:6]).max() < 1e-13
    assert energy[6] > 1e-6
    drilling = np.arange(5, 96, 6)
    assert np.linalg.eigvalsh(K[np.ix_(drilling, drilling)])[0] > 1e-3 * np.abs(K).max()


@pytest.mark.parametrize("faces", [1, BATCH, BATCH + 7])
def test_pairs_are_the_blocks_of_the_stiffness_of_each_triangle(faces):
    rng = np.random.default_rng(0)
    triangles = Triangle(
        jnp.asarray(rng.normal(size=(faces, 3, 3))), jnp.asarray(rng.uniform(0.1, 1, faces))
    )
    pairs = np.asarray(shell_pairs(triangles, E, NU))
    assert pairs.shape == (faces, 6, 6, 6)
    for face in {0, faces // 2, faces - 1}:
        K = stiffness(np.asarray(triangles.corners[face]), float(triangles.thickness[face]))
        blocks = K.reshape(3, 6, 3, 6).transpose(0, 2, 1, 3)[PAIRS]
        np.testing.assert_allclose(pairs[face], blocks, atol=1e-12 * np.abs(K).max())


def test_scaling_all_lengths_scales_the_stiffness_as_dimensions_demand():
    a = 3.0
    scale = np.tile([1, 1, 1, a, a, a], 3)
    large = stiffness(a * SCALENE, a * THICKNESS)
    expected = a * scale[:, None] * stiffness(SCALENE) * scale
    np.testing.assert_allclose(large, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())


def test_energy_has_a_second_order_taylor_remainder_in_corners_and_thickness():
    rng = np.random.default_rng(3)
    u, v = rng.normal(size=(2, 18))
    direction = triangle(rng.normal(size=(3, 3)), 0.3)

    def energy(each: Triangle) -> jax.Array:
        return v @ one_stiffness(each, E, NU) @ u

    at = triangle(SCALENE)
    value, slope = jax.jvp(energy, (at,), (direction,))
    steps = 1e-2 * 0.5 ** np.arange(4)
    remainders = [
        abs(energy(jax.tree.map(lambda x, d, s=s: x + s * d, at, direction)) - value - s * slope)
        for s in steps
    ]
    orders = np.log2(np.array(remainders[:-1]) / np.array(remainders[1:]))
    np.testing.assert_allclose(orders, 2, atol=0.1)


def test_axes_are_orthonormal_and_the_area_is_that_of_the_triangle():
    plane = PlaneTriangle.of(jnp.asarray(SCALENE))
    np.testing.assert_allclose(plane.axes @ plane.axes.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(plane.axes), 1, rtol=1e-14)
    normal = np.cross(SCALENE[1] - SCALENE[0], SCALENE[2] - SCALENE[0])
    np.testing.assert_allclose(plane.area * plane.axes[2], normal / 2, rtol=1e-13)
    np.testing.assert_allclose(plane.gradients.sum(axis=0), 0, atol=1e-14)
