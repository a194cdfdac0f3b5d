"""Inner offsets against closed forms; thin parts and impossible skins."""

import numpy as np
import pytest
import trimesh

from texmap_opt.combine import boolean
from texmap_opt.combine.offset import offset_inward
from texmap_opt.errors import SolidError
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.solid.validity import validity


def surface(mesh: trimesh.Trimesh) -> TriMesh:
    return TriMesh(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64))


def l_profile() -> TriMesh:
    """An L of two 20 mm legs 8 mm wide, 10 mm deep: convex edges and one concave edge."""
    legs = [trimesh.creation.box((20, 8, 10)), trimesh.creation.box((8, 20, 10))]
    return boolean.union(
        [TriMesh(surface(leg).vertices + leg.extents / 2, surface(leg).faces) for leg in legs]
    )


def test_the_offset_of_a_box_is_the_smaller_box_with_sharp_edges():
    box = surface(trimesh.creation.box((30, 20, 10)))
    offset = offset_inward(box, 1.0, 0.05)
    assert offset.surface is not None
    np.testing.assert_allclose(offset.surface.volume, 28 * 18 * 8, rtol=2e-3)
    assert offset.error_mm <= 0.05
    corners = np.abs(offset.surface.bounds)
    np.testing.assert_allclose(corners, [[14, 9, 4]] * 2, atol=0.05)
    assert offset.solid_share == 0.0


def test_the_offset_of_a_ball_is_the_smaller_ball():
    """Radius 10 - 2; the facets of the ball itself lie up to 0.03 mm inside the sphere."""
    ball = surface(trimesh.creation.icosphere(subdivisions=4, radius=10.0))
    offset = offset_inward(ball, 2.0, 0.05)
    assert offset.surface is not None
    radii = np.linalg.norm(offset.surface.vertices, axis=1)
    assert radii.min() > 8.0 - 0.1
    assert radii.max() < 8.0 + 0.05
    np.testing.assert_allclose(offset.surface.volume, 4 / 3 * np.pi * 8**3, rtol=0.015)


def test_the_offset_of_a_torus_is_the_thinner_torus():
    """2 pi² R (r - d)²; 48 x 96 facets enclose 1 % less."""
    torus = surface(trimesh.creation.torus(20, 5, major_sections=96, minor_sections=48))
    offset = offset_inward(torus, 1.0, 0.1)
    assert offset.surface is not None
    report = validity(offset.surface)
    assert report.printable, report.faults
    assert report.genus == 1
    np.testing.assert_allclose(offset.surface.volume, 2 * np.pi**2 * 20 * 16, rtol=0.02)


def test_depth_is_right_everywhere_also_at_a_concave_edge():
    part = l_profile()
    offset = offset_inward(part, 1.5, 0.05)
    assert offset.surface is not None
    faces = offset.surface.vertices[offset.surface.faces]
    depth, _, _ = SignedDistance(part)(
        np.concatenate([faces.mean(axis=1), offset.surface.vertices])
    )
    np.testing.assert_allclose(depth, -1.5, atol=0.05)


def test_a_thin_wall_becomes_solid_and_is_counted():
    """A 1 mm fin, 10 x 10, on a 10 mm cube: 100 of 1100 mm³ have no room for a 1 mm skin."""
    cube = trimesh.creation.box((10, 10, 10))
    fin = trimesh.creation.box(
        (10.02, 1, 10), trimesh.transformations.translation_matrix([10, 0, 0])
    )
    part = surface(trimesh.boolean.union([cube, fin], engine="manifold"))
    offset = offset_inward(part, 1.0, 0.05)
    assert offset.surface is not None
    np.testing.assert_allclose(offset.surface.volume, 8**3, rtol=0.01)
    # Points of the fin within two skins of the cube's inner wall are not counted: 9 of 10 mm are.
    np.testing.assert_allclose(offset.solid_share, 90 / 1100, rtol=0.1)


def test_a_sheet_just_thicker_than_two_skins_keeps_its_thin_hollow():
    """0.3 mm of hollow between two skins, a fifth of a coarse cube: found, not lost."""
    plate = surface(trimesh.creation.box((20, 20, 2.3)))
    offset = offset_inward(plate, 1.0, 0.05)
    assert offset.surface is not None
    np.testing.assert_allclose(offset.surface.volume, 18 * 18 * 0.3, rtol=0.1)
    assert validity(offset.surface).connected_components == 1


def test_a_skin_thicker_than_the_part_leaves_nothing_and_says_what_would_fit():
    plate = surface(trimesh.creation.box((20, 20, 3)))
    offset = offset_inward(plate, 2.0, 0.05)
    assert offset.surface is None
    np.testing.assert_allclose(offset.inscribed_radius_mm, 1.5, rtol=0.05)


@pytest.mark.parametrize(("depth", "tolerance"), [(0.0, 0.1), (-1.0, 0.1), (1.0, 0.0)])
def test_impossible_numbers_are_refused(depth, tolerance):
    box = surface(trimesh.creation.box((3, 3, 3)))
    with pytest.raises(SolidError, match="above 0"):
        offset_inward(box, depth, tolerance)
