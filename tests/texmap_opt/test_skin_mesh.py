"""The middle surface of a skin: half a thickness below the part's, never folded."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fea import TetMesh
from texmap_opt.skin_mesh import SkinMesh


def ball(radius: float, cells: int = 8) -> TetMesh:
    """A cube of tets, each shell of it drawn onto a sphere."""
    box = TetMesh.box((2.0, 2.0, 2.0), (cells,) * 3, origin=(-1.0, -1.0, -1.0))
    shell = np.abs(box.nodes).max(axis=1, keepdims=True)
    length = np.linalg.norm(box.nodes, axis=1, keepdims=True)
    return box.with_nodes(radius * box.nodes * shell / np.maximum(length, 1e-12))


def turned(skin: SkinMesh) -> np.ndarray:
    """Cosine between each triangle's normal and that of the part's triangle above it."""
    x = skin.outside[skin.surface.faces]
    before = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    before /= np.linalg.norm(before, axis=1, keepdims=True)
    return np.einsum("fi,fi->f", before, skin.surface.face_normals)


def test_the_skin_of_a_box_is_the_smaller_box():
    """Edges and corners, where two and three planes meet, too."""
    skin = SkinMesh.of(TetMesh.box((20.0, 10.0, 8.0), (10, 5, 4)), 0.5)
    # Planes give way to evenness by up to two per cent of half a thickness.
    slack = 0.02 * 0.25
    np.testing.assert_allclose(skin.surface.bounds, [[0.25] * 3, [19.75, 9.75, 7.75]], atol=slack)
    np.testing.assert_allclose(skin.surface.volume, 19.5 * 9.5 * 7.5, rtol=slack)
    np.testing.assert_array_equal(skin.thickness, 0.5)
    assert (skin.thin_share, skin.held_back) == (0, 0)


def test_only_corners_of_quadratic_tets_become_vertices():
    mesh = TetMesh.box((4.0, 2.0, 2.0), (4, 2, 2))
    a, b = SkinMesh.of(mesh, 0.2), SkinMesh.of(mesh.to_tet10(), 0.2)
    np.testing.assert_allclose(a.surface.vertices, b.surface.vertices)
    np.testing.assert_array_equal(mesh.nodes[a.nodes], a.outside)


def test_the_skin_of_a_ball_is_half_a_thickness_below_it():
    """Planes of facets that meet at small angles move together; their offset is right to angle²."""
    skin = SkinMesh.of(ball(10.0, 12), 1.0)
    # The planes of a 9-degree facet pass 1 - cos(4.5 degrees) inside the vertex.
    radius = np.linalg.norm(skin.surface.vertices, axis=1)
    np.testing.assert_allclose(radius, 9.5, atol=0.02)
    assert turned(skin).min() > 0.999


@pytest.mark.parametrize("wall", [0.7, 0.4])
def test_two_skins_share_a_wall_that_is_too_thin_for_both(wall: float):
    """In a plate of 0.7 or 0.4 mm skins of 0.5 mm are half as thick, in its middle planes."""
    skin = SkinMesh.of(TetMesh.box((10.0, 10.0, wall), (10, 10, 1)), 0.5)
    middle = np.abs(skin.surface.face_normals[:, 2]) > 0.9
    np.testing.assert_allclose(skin.thickness[middle], wall / 2, rtol=2e-2)
    below = np.minimum(skin.surface.vertices[:, 2], wall - skin.surface.vertices[:, 2])
    np.testing.assert_allclose(below, wall / 4, rtol=2e-2)
    assert skin.thin_share > 0.8
    # The mass is that of the solid plate but for its rim, which is counted on top.
    mass = skin.thickness @ skin.surface.face_areas
    assert mass == pytest.approx(100 * wall, rel=4 * wall / 10)


def test_triangles_smaller_than_the_skin_shrink_evenly():
    """Vertices of an edge go five times as far as the next row is away; the rows give way."""
    skin = SkinMesh.of(TetMesh.box((4.0, 4.0, 4.0), (40, 40, 40)), 1.0)
    assert skin.held_back == 0
    assert turned(skin).min() > 0.99
    np.testing.assert_allclose(skin.surface.bounds, [[0.5] * 3, [3.5] * 3], atol=0.02 * 0.5)
    areas = skin.surface.face_areas / 0.1**2 * 2
    # Least at corners, where three planes pull.
    np.testing.assert_allclose(np.median(areas), (3 / 4) ** 2, rtol=0.1)
    assert areas.min() > 0.1


def test_triangles_that_would_fold_over_are_held_back():
    """A spike that is thinner than its facets are long: what cannot move stays, and is counted."""
    mesh = ball(3.0, 6)
    rough = mesh.nodes * (1 + 0.25 * np.random.default_rng(1).uniform(-1, 1, (len(mesh.nodes), 1)))
    skin = SkinMesh.of(mesh.with_nodes(rough), 2.0)
    assert skin.held_back > 0
    assert turned(skin).min() > 0


@settings(max_examples=10, derandomize=True, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.05, 3.0))
def test_no_skin_of_a_crumpled_ball_folds(seed: int, skin_mm: float):
    """Nodes of the surface moved at random, triangles down to slivers, skins up to the radius."""
    rng = np.random.default_rng(seed)
    mesh = ball(3.0, 6)
    rough = mesh.nodes * (1 + 0.1 * rng.uniform(-1, 1, (len(mesh.nodes), 1)))
    skin = SkinMesh.of(mesh.with_nodes(rough), skin_mm)
    x = skin.surface.vertices[skin.surface.faces]
    area = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    x = skin.outside[skin.surface.faces]
    before = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    assert (np.einsum("fi,fi->f", area, before) > 0).all()
    assert (skin.thickness > 0).all()
    assert (skin.thickness <= skin_mm * (1 + 1e-12)).all()
    assert 0 < skin.surface.volume < mesh.with_nodes(rough).volume * (1 + 1e-9)
