"""Forces, moments and stress recovered in skins."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shell_cases.mapped_skin import mapped_square

from fea.shell_stress import shell_stress, skin_stress
from fea.skin import Skin

E, NU, THICKNESS = 70_000.0, 0.3, 0.4
MESH = mapped_square((2, 3), lambda s, t: [5 * s + t, 4 * t + s * t, 0 * s])
SKIN = MESH.skin(THICKNESS, E, NU)


def motion(kind: str) -> np.ndarray:
    """Uniaxial membrane force 3 N/mm along x, or cylindrical moment 3 N mm/mm about y."""
    x, y, z = MESH.points.T
    if kind == "tension":
        strain = 3 / (E * THICKNESS)
        return np.stack([strain * x, -NU * strain * y, z, z, z, z], axis=1)
    # Moment along x alone: curvatures -w_xx = M/(D (1 - nu²)), -w_yy = -nu of it; w = -(k x² - nu k y²)/2.
    k = 3 / (E * THICKNESS**3 / 12)
    w_x, w_y = -k * x, NU * k * y
    return np.stack([z, z, -k * (x**2 - NU * y**2) / 2, w_y, -w_x, z], axis=1)


@pytest.mark.parametrize("angles", [(0, 0, 0), (0.7, -1.1, 2.0)], ids=["level", "turned"])
@pytest.mark.parametrize("kind", ["tension", "bending"])
def test_constant_forces_and_moments_are_recovered_in_global_axes(kind, angles):
    turn = Rotation.from_rotvec(angles)
    u = turn.apply(motion(kind).reshape(-1, 3)).reshape(1, -1, 6)
    found = skin_stress(SKIN, turn.apply(MESH.points), u)
    axis = turn.apply([1.0, 0, 0])
    rows, columns = [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]
    expected = 3 * np.outer(axis, axis)[rows, columns] * np.ones((1, len(MESH.triangles), 1))
    carried = found.membrane_forces if kind == "tension" else found.bending_moments
    other = found.bending_moments if kind == "tension" else found.membrane_forces
    # Constant strain and curvature are exact; rounding of strains 1e-4 of rotations.
    np.testing.assert_allclose(carried, expected, atol=1e-10)
    np.testing.assert_allclose(other, 0, atol=1e-10)
    layers = [3, 3, 3] if kind == "tension" else [-18 / THICKNESS, 0, 18 / THICKNESS]
    scale = THICKNESS if kind == "tension" else 1.0
    expected = expected[..., None, :] / 3 * (np.array(layers) / scale)[:, None]
    thickness = 1.0 if kind == "tension" else THICKNESS
    np.testing.assert_allclose(found.stress, expected / thickness, atol=1e-9)
    np.testing.assert_allclose(
        found.von_mises,
        np.abs(layers) / scale / thickness * np.ones((1, len(MESH.triangles), 1)),
        atol=1e-9,
    )


def test_stress_does_not_depend_on_numbering_and_turning_the_normal_over_swaps_top_and_bottom():
    rng = np.random.default_rng(0)
    points = MESH.points + rng.normal(size=MESH.points.shape)
    u = rng.normal(size=(2, len(points), 6))
    own = skin_stress(SKIN, points, u)

    def renumbered(order: list[int]):
        return skin_stress(Skin(MESH.triangles[:, order], SKIN.thickness, E, NU), points, u)

    size = np.abs(own.stress).max()
    np.testing.assert_allclose(renumbered([1, 2, 0]).stress, own.stress, atol=1e-11 * size)
    over = renumbered([1, 0, 2])
    np.testing.assert_allclose(over.stress, own.stress[..., ::-1, :], atol=1e-11 * size)
    np.testing.assert_allclose(over.bending_moments, -own.bending_moments, atol=1e-11 * size)


def test_load_cases_are_recovered_one_by_one():
    u = np.random.default_rng(1).normal(size=(3, len(MESH.points), 6))
    together = skin_stress(SKIN, MESH.points, u)
    for case in range(3):
        alone = skin_stress(SKIN, MESH.points, u[case])
        np.testing.assert_allclose(together.stress[case], alone.stress, rtol=1e-12, atol=1e-9)


def test_stress_has_a_second_order_taylor_remainder_in_points_displacement_and_thickness():
    rng = np.random.default_rng(2)
    u = rng.normal(size=(len(MESH.points), 6))
    at = (jnp.asarray(MESH.points), jnp.asarray(u), jnp.asarray(SKIN.thickness))
    direction = tuple(jnp.asarray(rng.normal(size=x.shape)) * 0.1 for x in at)

    @jax.jit
    def value(points: jax.Array, u: jax.Array, thickness: jax.Array) -> jax.Array:
        return skin_stress(SKIN, points, u, thickness=thickness).von_mises.mean()

    exact, slope = jax.jvp(value, at, direction)
    steps = 1e-2 * 0.5 ** np.arange(4)
    remainders = [
        abs(value(*(x + s * d for x, d in zip(at, direction, strict=True))) - exact - s * slope)
        for s in steps
    ]
    orders = np.log2(np.array(remainders[:-1]) / np.array(remainders[1:]))
    np.testing.assert_allclose(orders, 2, atol=0.1)


def test_stress_of_triangles_is_that_of_the_skin():
    u = np.random.default_rng(3).normal(size=(len(MESH.points), 6))
    triangles = SKIN.triangle_values(MESH.points)
    alone = shell_stress(triangles, E, NU, jnp.asarray(u[MESH.triangles].reshape(-1, 18)))
    np.testing.assert_array_equal(alone.stress, skin_stress(SKIN, MESH.points, u).stress)
