"""Cell sizes, views, tubes and arrows: the geometry behind the pictures."""

import numpy as np
import pytest

from texmap_opt.report.glyphs import ARROW_LENGTH, diagonal, glyph, spread_points
from texmap_opt.report.overlay import colour_range
from texmap_opt.report.scenes import Action, Mark, triangles_of_facets
from texmap_opt.report.tubes import tube_values, tubes, wall_values, walls
from texmap_opt.report.view import HALF_ANGLE_DEG, Eye, Frame, best_eye, eye_along, fitted_view
from texmap_opt.solid.tri_mesh import TriMesh

SQUARE = TriMesh(
    np.array([[0.0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
)


def test_six_node_facets_become_four_triangles_of_the_same_area():
    corners = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0]])
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    nodes = np.concatenate([corners, middles])
    faces = triangles_of_facets(np.arange(6)[None])
    mesh = TriMesh(nodes, faces)
    np.testing.assert_allclose(mesh.face_areas, 0.5)
    np.testing.assert_allclose(mesh.face_normals, [[0, 0, 1]] * 4)


def test_compact_keeps_positions_and_drops_the_rest():
    small = SQUARE.select(slice(1, None))
    assert len(small.vertices) == 3
    np.testing.assert_array_equal(small.vertices[small.faces], SQUARE.vertices[SQUARE.faces[1:]])


def test_a_scale_round_a_middle_reaches_equally_far_to_both_sides():
    assert colour_range(np.array([0.8, 1.0, 1.5]), middle=1.0)[:2] == pytest.approx(
        (0.5, 1.5), 0.01
    )
    # Rounding is not shown as an error.
    assert colour_range(np.array([1.0, 1.0 + 1e-9]), middle=1.0) == (0.95, 1.05, None)
    low, high, peak = colour_range(np.append(np.full(999, 1.1), 4.0), middle=1.0)
    assert (low, high, peak) == pytest.approx((0.9, 1.1, 4.0))


def test_all_points_appear_in_the_frame_and_two_touch_it():
    points = np.random.default_rng(1).uniform(-1, 1, (500, 3)) * [50, 10, 20]
    frame = Frame(left=0.1, right=0.7, bottom=0.2, top=0.9)
    direction = np.array([-0.4, -0.8, 0.5])
    direction /= np.linalg.norm(direction)
    aspect = 4 / 3
    view = fitted_view(points, Eye(direction, np.array([0.0, 0, 1])), frame=frame, aspect=aspect)
    right = np.cross([0, 0, 1.0], direction)
    right /= np.linalg.norm(right)
    up = np.cross(direction, right)
    eye = points - view.position
    t = np.tan(np.radians(HALF_ANGLE_DEG))
    x = (eye @ right) / (-eye @ direction) / (t * aspect) + view.centre[0]
    y = (eye @ up) / (-eye @ direction) / t + view.centre[1]
    low = np.array([2 * frame.left - 1, 2 * frame.bottom - 1])
    high = np.array([2 * frame.right - 1, 2 * frame.top - 1])
    seen = np.stack([x, y], 1)
    assert (seen > low - 1e-9).all() and (seen < high + 1e-9).all()
    gap = np.minimum(seen.min(axis=0) - low, high - seen.max(axis=0))
    assert np.abs(gap).min() < 1e-9


def test_the_view_turns_to_where_the_marks_are():
    extent = np.array([40.0, 10, 10])
    for side in (1, -1):
        end = TriMesh(SQUARE.vertices[:, [2, 0, 1]], SQUARE.faces[:, ::side])
        mark = Mark(Action.SUPPORT, "", end, np.zeros(3))
        assert np.sign(best_eye(extent, [mark]).direction[0]) == side


@pytest.mark.parametrize("pressed", [True, False])
def test_a_part_that_stands_on_its_y_side_and_is_pressed_down_is_shown_upright(pressed):
    """Scans, such as the statue of the paper, often have y up."""
    base = TriMesh(SQUARE.vertices[:, [0, 2, 1]], SQUARE.faces)
    np.testing.assert_allclose(base.face_normals, [[0, -1, 0]] * 2)
    force = np.array([0.0, -9, 0]) if pressed else np.array([0.0, 0, -9])
    marks = [
        Mark(Action.SUPPORT, "", base, np.zeros(3)),
        Mark(Action.FORCE, "", base, force),
    ]
    eye = best_eye(np.array([4.0, 9, 4]), marks)
    np.testing.assert_array_equal(eye.up, [0, 1, 0] if pressed else [0, 0, 1])
    assert eye.direction @ eye.up > 0


def test_tubes_have_their_radius_and_point_outward():
    rng = np.random.default_rng(2)
    joints = rng.normal(size=(6, 3)) * 10
    struts = np.array([[0, 1], [2, 3], [4, 5]])
    radii = np.array([[0.5, 0.2], [0.1, 0.1], [0.3, 0.4]])
    mesh, normals = tubes(joints, struts, radii, sides=40)
    length = np.linalg.norm(joints[struts[:, 1]] - joints[struts[:, 0]], axis=1)
    a, b = radii.T
    cones = np.pi * length * (a * a + a * b + b * b) / 3
    # A polygon of 40 sides has 0.4 % less area than its circle.
    assert mesh.volume == pytest.approx(cones.sum(), rel=5e-3)
    facing = np.einsum("fi,fi->f", mesh.face_normals, normals[mesh.faces].mean(axis=1))
    assert (facing > 0.5).all()
    values = tube_values(radii, sides=40)
    assert len(values) == len(mesh.vertices)
    ring = np.linalg.norm(mesh.vertices[:40] - joints[0], axis=1)
    np.testing.assert_allclose(ring, values[:40])


def test_points_spread_over_a_patch_and_lie_on_it():
    points, normals = spread_points(SQUARE, 4.0)
    assert 4 <= len(points) <= 12
    assert (points[:, :2] >= 0).all() and (points[:, :2] <= 10).all()
    np.testing.assert_array_equal(normals, [[0, 0, 1]] * len(points))


@pytest.mark.parametrize(
    ("action", "direction", "touching"),
    [
        (Action.FORCE, (0, 0, -5), "low"),
        (Action.FORCE, (0, 0, 5), "low"),
        (Action.PRESSURE, (0, 0, 0), "low"),
        (Action.SUCTION, (0, 0, 0), "low"),
    ],
)
def test_arrows_stand_on_the_loaded_side_of_the_surface(action, direction, touching):
    part = TriMesh(np.concatenate([SQUARE.vertices, SQUARE.vertices - [0, 0, 30]]), SQUARE.faces)
    part = TriMesh(part.vertices, np.concatenate([SQUARE.faces, SQUARE.faces[:, ::-1] + 4]))
    arrows = glyph(Mark(action, "", SQUARE, np.array(direction, float)), part).shape
    low, high = arrows.bounds[:, 2]
    assert low == pytest.approx(0, abs=1e-9)
    assert high == pytest.approx(ARROW_LENGTH * diagonal(part), rel=0.02)
    # The head is wider than the shaft: it is below for what pushes, above for what pulls.
    wide = arrows.vertices[:, 2][np.abs(arrows.vertices[:, 2] - low) < 0.5 * (high - low)]
    pushes = action is Action.PRESSURE or direction[2] < 0
    assert (len(wide) > len(arrows.vertices) / 2) == pushes
    assert touching == "low"


def test_the_colour_scale_ends_before_a_singular_peak_and_says_so():
    values = np.concatenate([np.linspace(0, 100, 2000), [900.0]])
    low, high, beyond = colour_range(values, from_zero=True)
    assert low == 0 and high < 101 and beyond == 900
    low, high, beyond = colour_range(values[:-1])
    assert (low, high, beyond) == (0, 100, None)


def test_equal_values_still_have_a_scale():
    low, high, beyond = colour_range(np.full(5, 0.5))
    assert low < 0.5 < high and beyond is None


def test_walls_are_closed_prisms_with_outward_normals():
    """A wall 5 long, 0.4 thick at one end and 0.8 at the other, twice the rise of 1.5 high."""
    joints = np.array([[1.0, 2, 0], [4.0, 6, 0], [4.0, 9, 0]])
    rise = np.array([0.0, 0, 1.5])
    radii = np.array([[0.2, 0.4], [0.5, 0.5]])
    mesh, normals = walls(joints, np.array([[0, 1], [1, 2]]), radii, rise)
    assert mesh.volume == pytest.approx(5 * 0.6 * 3 + 3 * 1.0 * 3)
    np.testing.assert_allclose(normals[mesh.faces[:, 0]], mesh.face_normals, atol=1e-12)
    values = wall_values(np.array([[1.0, 2], [3, 4]]))
    near = np.linalg.norm(mesh.vertices[:24, :2] - [1, 2], axis=1) < 1
    np.testing.assert_array_equal(values[:24], np.where(near, 1, 2))
    assert set(values[24:]) == {3, 4}


@pytest.mark.parametrize("axis", [[0.0, 0, 1], [0.0, 2, 0], [1.0, 0, 0], [0.0, -0.6, 0.8]])
def test_the_eye_along_an_axis_stays_on_its_side_and_upright(axis: list):
    usual = Eye(np.array([0.6, -0.64, 0.48]), np.array([0.0, 0, 1]))
    eye = eye_along(np.array(axis), usual)
    assert np.linalg.norm(np.cross(eye.direction, axis)) == pytest.approx(0, abs=1e-12)
    assert eye.direction @ usual.direction > 0
    assert eye.up @ eye.direction == pytest.approx(0, abs=1e-12)
    upright = np.array([0.0, 1, 0]) if axis == [0, 0, 1] else usual.up
    assert eye.up @ upright > 0.5
