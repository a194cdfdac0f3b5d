"""Controls: what the tests of the mesher look at does find broken solids."""

import numpy as np
import pytest
from exact_union import Star
from lattices import octet, structure
from sound_solid import assert_sound, winding_numbers

from texmap_opt.solid.lattice_solid import lattice_solid
from texmap_opt.solid.strut_ends import StrutEnds
from texmap_opt.solid.tri_mesh import TriMesh

LATTICE = octet(1, 5.0, 0.4)


@pytest.fixture(scope="module")
def solid() -> TriMesh:
    return lattice_solid(LATTICE, tolerance_mm=0.05, segments=8).surface


def test_the_solid_itself_passes(solid):
    assert_sound(solid, LATTICE)


def test_a_triangle_turned_over_is_found(solid):
    faces = solid.faces.copy()
    faces[1234] = faces[1234, ::-1]
    with pytest.raises(AssertionError, match="lack a neighbour"):
        assert_sound(TriMesh(solid.vertices, faces), LATTICE)


def test_a_joint_without_its_surface_is_found(solid):
    """Its triangles taken out: holes where its struts begin."""
    faces = solid.faces
    centre = solid.vertices[faces].mean(axis=1)
    at = np.linalg.norm(centre - LATTICE.joints[0], axis=1) < 0.5
    assert at.any()
    with pytest.raises(AssertionError, match="lack a neighbour"):
        assert_sound(TriMesh(solid.vertices, faces[~at]), LATTICE)


def test_a_vertex_pushed_through_the_other_side_is_found(solid):
    """The surface is closed still, and crosses itself: twice enclosed, or inside out."""
    vertices = solid.vertices.copy()
    lowest = int(np.argmin(vertices.sum(axis=1)))
    vertices[lowest] += 3.0
    with pytest.raises(AssertionError, match=r"crosses itself|enclosed"):
        assert_sound(TriMesh(vertices, solid.faces), LATTICE, points=4000)


def test_a_strut_too_many_is_found(solid):
    fewer = structure(LATTICE.joints, LATTICE.struts[1:], LATTICE.radii[1:])
    with pytest.raises(AssertionError):
        assert_sound(solid, fewer)


def test_corners_of_a_ring_changed_over_are_found(solid):
    """The first eight vertices are those of a ring: the strut and its joint are drawn across."""
    vertices = solid.vertices.copy()
    vertices[[0, 3]] = vertices[[3, 0]]
    with pytest.raises(AssertionError, match=r"crosses itself|enclosed"):
        assert_sound(TriMesh(vertices, solid.faces), LATTICE, points=4000)


def test_rings_that_meet_are_found(monkeypatch):
    """40 % wider than to the crotch: no triangulation of the directions lies between them.

    Such struts are taken for ones that cannot be meshed alone.
    """
    star = Star.of_equal(np.eye(3), length=10.0, radius=0.5).structure()
    assert lattice_solid(star, tolerance_mm=0.05).clusters == 0
    true = StrutEnds._shared
    monkeypatch.setattr(StrutEnds, "_shared", lambda *given: 1.4 * true(*given))
    united = lattice_solid(star, tolerance_mm=0.05)
    assert united.clusters == 1
    assert_sound(united.surface, star)


def test_winding_numbers_of_a_tetrahedron():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    points = np.array([[0.1, 0.1, 0.1], [1.0, 1, 1], [-0.1, 0.2, 0.2]])
    np.testing.assert_allclose(
        winding_numbers(TriMesh(corners, faces), points), [1, 0, 0], atol=1e-12
    )
    inside_out = TriMesh(corners, faces[:, ::-1].copy())
    np.testing.assert_allclose(winding_numbers(inside_out, points), [-1, 0, 0], atol=1e-12)
