"""The oracle itself, against closed forms."""

import numpy as np
import pytest
from exact_union import (
    Star,
    closing_reach,
    exact_volume,
    named_stars,
    planar_seam_reach,
    random_star,
    sphere_points,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.ndimage import distance_transform_edt

# The sums below have 400,000 terms over kinks, and err by less than this where compared with
# closed forms.
QUADRATURE = 1e-3


@settings(max_examples=10, deadline=None, derandomize=True)
@given(st.integers(0, 1000), st.integers(2, 14))
def test_equal_struts_meet_in_planes(seed, valence):
    """Their union is |x|² = R² + max(0, x . d_i)²: struts i and j are equally far in a plane."""
    axes = np.random.default_rng(seed).normal(size=(valence, 3))
    star = Star.of_equal(axes, length=1e9, radius=0.7)
    directions = sphere_points(2000)
    expected = planar_seam_reach(star.axes, 0.7, directions)
    np.testing.assert_allclose(star.reach(directions), expected, rtol=1e-9)


@pytest.mark.parametrize("angle", [90.0, 60.0, 35.0])
def test_two_cylinders_share_steinmetzs_solid(angle):
    """16 r³/(3 sin(theta)) (Archimedes for 90 degrees; sheared along one axis for others)."""
    r, theta = 0.8, np.deg2rad(angle)
    along = np.array([[1.0, 0, 0], [np.cos(theta), np.sin(theta), 0]])
    cross = Star.of_equal(np.concatenate([along, -along]), length=20.0, radius=r)
    expected = 16 * r**3 / (3 * np.sin(theta))
    np.testing.assert_allclose(cross.overlap(), expected, rtol=QUADRATURE)


def test_a_lone_strut_is_a_capsule():
    r, L = 0.6, 7.0
    capsule = np.pi * r**2 * L + 4 / 3 * np.pi * r**3
    lone = Star.of_equal([[1.0, 2, -1]], length=L, radius=r)
    np.testing.assert_allclose(lone.volume(), capsule, rtol=1e-4)


@pytest.mark.parametrize("radii", [(0.4, 0.9), (0.9, 0.4)])
def test_a_tapered_lone_strut_is_a_body_of_revolution(radii):
    """The profile is the largest of frustum and two balls."""
    (a, b), L = radii, 3.0

    def squared(z: float) -> float:
        frustum = a + (b - a) * z / L if 0 <= z <= L else 0.0
        return max(frustum**2, a**2 - z**2, b**2 - (L - z) ** 2)

    expected = np.pi * quad(squared, -a, L + b, points=[0, L], limit=400)[0]
    lone = Star(np.array([[0.0, 0, 1]]), np.array([L]), np.array([radii]))
    np.testing.assert_allclose(lone.volume(), expected, rtol=1e-4)


def test_the_quadrature_has_converged_where_struts_lie_close():
    """Families with 5 degrees between struts: four times the directions, the same volume."""
    for seed in (3, 11, 17):
        star = random_star(seed)
        np.testing.assert_allclose(star.volume(100_000), star.volume(), rtol=2e-4)


def test_the_families_are_as_wide_as_promised():
    stars = [random_star(seed) for seed in range(60)]
    valences = {len(star.axes) for star in stars}
    assert min(valences) == 1 and max(valences) == 20
    cosines = [star.axes @ star.axes.T - 3 * np.eye(len(star.axes)) for star in stars]
    least = min(np.rad2deg(np.arccos(min(c.max(), 1))) for c in cosines if len(c) > 1)
    assert 5 <= least < 5.5
    assert max(star.radii[:, 0].max() / star.radii[:, 0].min() for star in stars) > 3.3


def test_the_volume_of_a_lattice_is_that_of_its_joints_one_by_one():
    """A family is a lattice of one joint and free ends."""
    for seed in (3, 11):
        star = random_star(seed)
        whole = exact_volume(star.structure(), 100_000)
        np.testing.assert_allclose(whole, star.volume(), rtol=5e-4)


def test_between_two_struts_the_closing_ends_where_a_ball_rests_on_both():
    """Centre (r + rho)/sin(theta/2) from the joint; between three at 90 degrees (r + rho) sqrt(3/2)."""
    r, rho = 0.5, 0.3
    for theta in np.deg2rad([60, 90, 130]):
        two = Star.of_equal([[1.0, 0, 0], [np.cos(theta), np.sin(theta), 0]], length=1e6, radius=r)
        middle = np.array([[np.cos(theta / 2), np.sin(theta / 2), 0]])
        found, cosine = closing_reach(two, rho, middle)
        np.testing.assert_allclose(found, (r + rho) / np.sin(theta / 2) - rho, rtol=3e-4)
        np.testing.assert_allclose(cosine, 1, rtol=1e-3)
    three = Star.of_equal(np.eye(3), length=1e6, radius=r)
    found, _ = closing_reach(three, rho, np.ones((1, 3)) / np.sqrt(3))
    np.testing.assert_allclose(found, (r + rho) * np.sqrt(1.5) - rho, rtol=3e-4)


def test_between_two_struts_at_a_narrow_angle_the_ball_rests_beside_their_plane():
    """Its rests form an ellipse, the seam of struts of radius r + rho.

    It is s = (r + rho)/sin(theta/2) away in the plane, s sqrt(1 - (h/(r + rho))²) at a height h.
    Where it is curved more than the ball, sin(theta/2) < rho/(r + rho), a ball at a height reaches
    nearer to the joint than the one in the plane: s(h) - sqrt(rho² - h²) is least elsewhere.
    """
    r, rho, half = 0.5, 0.8, np.deg2rad(20)
    two = Star.of_equal(
        [[np.cos(half), np.sin(half), 0], [np.cos(half), -np.sin(half), 0]], length=1e6, radius=r
    )
    height = np.linspace(0, rho, 100_001)
    nearest = np.sqrt((r + rho) ** 2 - height**2) / np.sin(half) - np.sqrt(rho**2 - height**2)
    found, _ = closing_reach(two, rho, np.array([[1.0, 0, 0]]))
    np.testing.assert_allclose(found, nearest.min(), rtol=1e-4)
    assert nearest.min() < nearest[0] - 0.1 * rho


@pytest.mark.parametrize("name", ["fcc", "uneven"])
def test_the_closing_is_what_growing_and_shrinking_on_a_grid_leaves(name):
    """Chen (2007): offset outwards, then inwards; here by distance transforms of voxels.

    Voxels are told apart but within one and a half of their diagonals from the surface.
    """
    rho, edge, half = 0.4, 0.05, 2.4
    star = named_stars()[name]
    ticks = np.arange(-half, half + edge / 2, edge)
    points = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), -1).reshape(-1, 3)
    points += 0.01 * edge  # no voxel at the joint itself
    size = np.linalg.norm(points, axis=1)
    shape = (len(ticks),) * 3
    solid = np.concatenate(
        [star.reach(chunk) for chunk in np.array_split(points / size[:, None], 40)]
    )
    solid = (size < solid).reshape(shape)
    grown = distance_transform_edt(~solid) * edge < rho
    closed = (distance_transform_edt(grown) * edge > rho).reshape(-1)
    solid = solid.reshape(-1)
    # The grid's border cuts struts off: what grows and shrinks there is not looked at.
    inner = (size < half - 2 * rho) & (size > 0.5)
    away = (points / size[:, None] @ star.axes.T).max(axis=1) < np.cos(np.deg2rad(10))
    random = np.random.default_rng(0)
    chosen = np.concatenate(
        [
            random.choice(np.flatnonzero(inner & away & some), 150, replace=False)
            for some in (closed & ~solid, ~closed)
        ]
    )
    reach, cosine = closing_reach(star, rho, points[chosen] / size[chosen, None])
    depth = (reach - size[chosen]) * cosine
    clear = np.abs(depth) > 1.5 * np.sqrt(3) * edge
    assert clear.sum() > 50
    np.testing.assert_array_equal(closed[chosen][clear], (depth > 0)[clear])
    # The control: the union without fillets is smaller, here where the closing adds the most.
    deep = chosen[clear & (depth > 0)]
    assert len(deep) and not solid[deep].all()
