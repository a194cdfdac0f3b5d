"""How far joints reach: the exact union without fillets, a ball's resting place with them."""

import numpy as np
import pytest
from exact_union import Star, closing_reach, named_stars, random_star, sphere_points
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from texmap_opt.solid.joint_shape import FILLET_PRECISION, JointShapes, nearest_step
from texmap_opt.solid.struts import frames

seeds = st.integers(0, 2**20)


def shape(star: Star, fillet: float = 0.0) -> JointShapes:
    """A round joint with the ball of its thickest strut."""
    one = star.axes[None]
    return JointShapes(
        one,
        frames(star.axes)[0][None],
        star.radii[None, :, 0].copy(),
        star.slopes[None],
        False,
        np.array([star.ball]),
        np.zeros((1, len(star.axes))),
        np.array([fillet]),
    )


def cross(axes: np.ndarray, radius: float = 0.5) -> Star:
    return Star.of_equal(axes, length=1e6, radius=radius)


def reach(joint: JointShapes, directions: np.ndarray) -> np.ndarray:
    return joint.reach(directions, np.zeros(len(directions), np.int64))


@settings(max_examples=20, deadline=None, derandomize=True)
@given(seeds)
def test_without_fillets_it_is_the_exact_union(seed):
    star = random_star(seed)
    directions = sphere_points(3000)
    # Inside the caps struts go on; where both end at the lid the mesher does not ask.
    free = (directions @ star.axes.T).max(axis=1) < np.cos(np.deg2rad(2))
    expected = star.reach(directions[free])
    lid = (expected[:, None] * (directions[free] @ star.axes.T) > 0.999 * star.lengths).any(axis=1)
    found = reach(shape(star), directions[free][~lid])
    np.testing.assert_allclose(found, expected[~lid], rtol=1e-9)


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.floats(25.0, 150.0), st.floats(0.1, 2.0))
def test_between_two_struts_a_ball_rests_on_both(angle, fillet):
    """Its centre is (r + rho)/sin(theta/2) from the joint, on the line that halves the angle."""
    theta, r = np.deg2rad(angle), 0.5
    # Wider balls rest beside the plane of the struts (test_exact_union).
    assume(fillet < 0.7 * (r + fillet) * np.sin(theta / 2))
    joint = shape(cross([[1.0, 0, 0], [np.cos(theta), np.sin(theta), 0]], r), fillet)
    middle = np.array([[np.cos(theta / 2), np.sin(theta / 2), 0]])
    expected = (r + fillet) / np.sin(theta / 2) - fillet
    np.testing.assert_allclose(reach(joint, middle), expected, atol=2 * FILLET_PRECISION * fillet)


@pytest.mark.parametrize("fillet", [0.05, 0.4, 2.0])
def test_between_three_struts_a_ball_rests_on_all(fillet):
    """Along x, y and z: the centre c (1, 1, 1) is r + rho from each axis, c sqrt(2) = r + rho."""
    joint = shape(cross(np.eye(3)), fillet)
    diagonal = np.ones((1, 3)) / np.sqrt(3)
    expected = (0.5 + fillet) * np.sqrt(3 / 2) - fillet
    np.testing.assert_allclose(reach(joint, diagonal), expected, atol=2 * FILLET_PRECISION * fillet)


def test_between_a_ball_and_a_thin_strut_the_fillet_is_an_arc():
    """A ball of R and a strut of r: the centre is R + rho from the joint and r + rho from the axis."""
    R, r, rho = 1.0, 0.3, 0.4
    star = Star(np.array([[0.0, 0, 1], [0, 0, -1]]), np.full(2, 1e6), np.array([[r, r], [R, R]]))
    joint = shape(star, rho)
    centre = np.array([r + rho, 0, np.sqrt((R + rho) ** 2 - (r + rho) ** 2)])
    along = centre / np.linalg.norm(centre)
    expected = np.linalg.norm(centre) - rho
    np.testing.assert_allclose(expected, R, rtol=1e-12)  # it touches the ball there
    # Half way from there to where it touches the strut.
    touch = np.array([r, 0, centre[2]])
    inward = (along * R + touch) / 2 - centre
    point = centre + rho * inward / np.linalg.norm(inward)
    size = np.linalg.norm(point)
    np.testing.assert_allclose(
        reach(joint, (point / size)[None]), size, atol=2 * FILLET_PRECISION * rho
    )


def test_between_square_struts_the_fillet_is_a_quarter_of_a_circle():
    """Half side h, sides along the axes: the centre is h + rho from both."""
    h, rho = 0.5, 0.3
    axes = np.array([[1.0, 0, 0], [0, 1.0, 0]])
    u, v = frames(axes)
    corner = ((u + v) / np.sqrt(2))[None]
    joint = JointShapes(
        axes[None], corner, np.full((1, 2), h * np.sqrt(2)), np.zeros((1, 2)), True,
        np.zeros(1), np.full((1, 2), 0.3), np.array([rho]),
    )  # fmt: skip
    middle = np.array([[1.0, 1, 0]]) / np.sqrt(2)
    expected = np.sqrt(2) * (h + rho) - rho
    np.testing.assert_allclose(reach(joint, middle), expected, atol=2 * FILLET_PRECISION * rho)


def beside_struts(star: Star, degrees: float, count: int) -> np.ndarray:
    """Directions at least so far from every strut's axis."""
    directions = sphere_points(count)
    return directions[(directions @ star.axes.T).max(axis=1) < np.cos(np.deg2rad(degrees))]


@pytest.mark.parametrize("name", named_stars())
@pytest.mark.parametrize("fillet", [0.1, 0.2, 0.4])
def test_filleted_joints_reach_as_far_as_the_closing(name, fillet):
    """Within 2 % of the fillet's radius, across the surface."""
    star = named_stars()[name]
    free = beside_struts(star, 12, 150)
    expected, cosine = closing_reach(star, fillet, free)
    off = (reach(shape(star, fillet), free) - expected) * cosine
    assert np.abs(off).max() < 0.02 * fillet
    # The control: of the union without fillets.
    assert np.abs((star.reach(free) - expected) * cosine).max() > 0.1 * fillet


@pytest.mark.parametrize("name", named_stars())
def test_fillets_only_add_and_larger_ones_add_more(name):
    star = named_stars()[name]
    free = beside_struts(star, 12, 600)
    none, small, large = (reach(shape(star, rho), free) for rho in (0.0, 0.2, 0.35))
    assert (small >= none).all()
    assert (large >= small - 0.01 * 0.35).all()
    assert (large > small).any()


@pytest.mark.parametrize("name", named_stars())
@pytest.mark.parametrize("fillet", [0.0, 0.3])
def test_points_on_the_surface_are_no_distance_from_it(name, fillet):
    star = named_stars()[name]
    joint = shape(star, fillet)
    free = beside_struts(star, 12, 600)
    at = np.zeros(len(free), np.int64)
    distance = joint.distance(joint.reach(free, at)[:, None] * free, at)
    # The ball's place is found in three steps there, in up to twelve here.
    np.testing.assert_allclose(distance, 0, atol=max(1e-9, 0.02 * fillet))


def test_distance_from_a_cylinder_and_from_a_fillet():
    r, rho = 0.5, 0.4
    on_axis = np.array([[r + 0.25, 0, 3.0], [0, r - 0.1, 3.0]])
    lone = shape(cross([[0.0, 0, 1]], r))
    np.testing.assert_allclose(lone.distance(on_axis, np.zeros(2, np.int64)), [0.25, 0.1])
    joint = shape(cross([[1.0, 0, 0], [0, 1.0, 0]], r), rho)
    middle = np.array([[1.0, 1, 0]]) / np.sqrt(2)
    size = (r + rho) * np.sqrt(2) - rho
    off = np.concatenate([(size + 0.05) * middle, (size - 0.05) * middle])
    np.testing.assert_allclose(joint.distance(off, np.zeros(2, np.int64)), 0.05, atol=1e-6)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(seeds, st.integers(1, 3))
def test_the_nearest_step_is_that_of_the_least_distance_program(seed, rests):
    """Smallest |s| with N s >= w, by non-negative least squares.

    Lawson and Hanson, Solving Least Squares Problems (1974), chapter 23: the residual of
    [N^T; w^T] u = (0, 0, 0, 1), u >= 0, gives s = -r[:3]/r[3].
    """
    random = np.random.default_rng(seed)
    normal = random.normal(size=(1, rests, 3))
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    wanted = random.normal(size=(1, rests))
    system = np.concatenate([normal[0].T, wanted])
    target = np.array([0.0, 0, 0, 1])
    push, _ = nnls(system, target)
    residual = system @ push - target
    expected = -residual[:3] / residual[3]
    np.testing.assert_allclose(nearest_step(normal, wanted)[0], expected, atol=1e-6)
