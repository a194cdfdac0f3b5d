"""Distance and side against the closed forms of a box and a ball."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt import signed_distance as module
from texmap_opt.builtin_part import builtin_part
from texmap_opt.signed_distance import SignedDistance, signed_distance, winding_number
from texmap_opt.solid.tri_mesh import TriMesh

SIZE = {"length_mm": 4.0, "width_mm": 3.0, "height_mm": 2.0}


def box_distance(points):
    """Signed distance to the box [0, 4] x [0, 3] x [0, 2]."""
    half = np.array([4.0, 3.0, 2.0]) / 2
    q = np.abs(points - half) - half
    outside = np.linalg.norm(np.maximum(q, 0), axis=1)
    return outside + np.minimum(q.max(axis=1), 0)


def ball(steps=64):
    """A ball of radius 1 by longitude and latitude, its chords within 0.0025 of the sphere."""
    theta = np.pi * np.arange(1, steps // 2) / (steps // 2)
    phi = 2 * np.pi * np.arange(steps) / steps
    t, p = np.meshgrid(theta, phi, indexing="ij")
    rings = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    vertices = np.concatenate([[[0, 0, 1.0]], rings.reshape(-1, 3), [[0, 0, -1.0]]])
    number = 1 + np.arange(len(theta) * steps).reshape(len(theta), steps)
    right = np.roll(number, -1, axis=1)
    top = np.stack([np.zeros(steps, int), number[0], right[0]], axis=1)
    low = np.stack([np.full(steps, len(vertices) - 1), right[-1], number[-1]], axis=1)
    a, b, c, d = (x.reshape(-1) for x in (number[:-1], number[1:], right[1:], right[:-1]))
    return TriMesh(
        vertices,
        np.concatenate([top, np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1), low]),
    )


def test_distance_to_a_box_is_its_closed_form():
    points = np.random.default_rng(0).uniform(-2, 6, (3000, 3))
    distance, face, closest = signed_distance(builtin_part("cantilever", SIZE), points)
    np.testing.assert_allclose(distance, box_distance(points), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(points - closest, axis=1), np.abs(distance))
    assert ((face >= 0) & (face < 12)).all()


def test_distance_to_a_ball_is_that_of_the_sphere_within_its_chords():
    points = np.random.default_rng(1).uniform(-1.5, 1.5, (3000, 3))
    distance, _, _ = signed_distance(ball(), points)
    np.testing.assert_allclose(distance, np.linalg.norm(points, axis=1) - 1, atol=0.0025)


def test_points_within_rounding_of_the_surface_get_the_right_side():
    """The fast winding number alone is not trusted near one half."""
    surface = builtin_part("torsion-bar", {})
    center = surface.vertices[surface.faces].mean(axis=1)
    query = SignedDistance(surface)
    assert query.contains(center - 1e-6 * surface.face_normals).all()
    assert not query.contains(center + 1e-6 * surface.face_normals).any()


def test_winding_number_counts_a_void_as_outside():
    outer = builtin_part("cantilever", SIZE)
    inner = TriMesh(1.0 + outer.vertices / 4, outer.faces[:, ::-1])
    hollow = TriMesh(
        np.concatenate([outer.vertices, inner.vertices]),
        np.concatenate([outer.faces, inner.faces + len(outer.vertices)]),
    )
    points = np.array([[0.5, 0.5, 0.5], [1.3, 1.2, 1.2], [9.0, 0, 0]])
    np.testing.assert_allclose(winding_number(hollow, points), [1, 0, 0], atol=0.005)
    distance, _, _ = signed_distance(hollow, points)
    assert list(np.sign(distance)) == [-1, 1, 1]


def test_many_points_give_what_few_do(monkeypatch):
    points = np.random.default_rng(2).uniform(-2, 6, (100, 3))
    whole = signed_distance(builtin_part("cantilever", SIZE), points)
    monkeypatch.setattr(module, "POINTS_PER_CHUNK", 7)
    for one, other in zip(
        whole, signed_distance(builtin_part("cantilever", SIZE), points), strict=True
    ):
        np.testing.assert_array_equal(one, other)


def test_no_points_give_no_distances():
    distance, face, closest = signed_distance(builtin_part("cantilever", SIZE), np.zeros((0, 3)))
    assert distance.shape == (0,) and face.shape == (0,) and closest.shape == (0, 3)


def test_rays_hit_the_opposite_wall_or_nothing():
    query = SignedDistance(builtin_part("cantilever", SIZE))
    origins = np.array([[1.0, 1.3, 1.1], [1.0, 1.3, 5.0]])
    path, face = query.first_hit(origins, np.array([[2.0, 0, 0], [0, 0, 1.0]]))
    np.testing.assert_allclose(path, [1.5, np.inf])
    assert face[0] >= 0 and face[1] == -1


@settings(derandomize=True, max_examples=20, deadline=None)
@given(
    shift=st.tuples(*[st.floats(-100, 100)] * 3),
    scale=st.floats(0.01, 100),
    angle=st.floats(0, 2 * np.pi),
)
def test_distance_moves_turns_and_scales_with_the_surface(shift, scale, angle):
    surface = builtin_part("l-bracket", {})
    points = np.random.default_rng(3).uniform(-20, 100, (50, 3))
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])

    def place(x):
        return scale * x @ turn.T + np.array(shift)

    before, _, _ = signed_distance(surface, points)
    after, _, _ = signed_distance(TriMesh(place(surface.vertices), surface.faces), place(points))
    size = scale * 100 + np.abs(shift).max()
    np.testing.assert_allclose(after, scale * before, atol=1e-12 * size, rtol=1e-9)


def test_an_inside_out_surface_contains_nothing():
    """Negative control of the sign."""
    surface = builtin_part("cantilever", SIZE)
    turned = TriMesh(surface.vertices, surface.faces[:, ::-1])
    distance, _, _ = signed_distance(turned, np.array([[1.0, 1.0, 1.0]]))
    assert distance[0] == pytest.approx(1.0)
