"""Inner offsets against closed forms; thin parts and impossible skins."""

import re

import numpy as np
import pytest
import trimesh

from texmap_opt.combine import boolean
from texmap_opt.combine.offset import offset_inward, spread_points
from texmap_opt.combine.solid_regions import solid_regions
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
    assert not len(solid_regions(box, offset.surface, 1.0).volumes_mm3)


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


def finned_cube() -> TriMesh:
    """A cube of 10 mm with fins, 10 x 1 x 10 on one side and 4 x 1 x 10 on the opposite one."""
    cube = trimesh.creation.box((10, 10, 10))
    # The fins reach into the cube by 0.02 mm.
    fins = [
        trimesh.creation.box((length, 1, 10), trimesh.transformations.translation_matrix([x, 0, 0]))
        for length, x in ((10.02, 9.99), (4.02, -6.99))
    ]
    return surface(trimesh.boolean.union([cube, *fins], engine="manifold"))


def test_thin_walls_become_solid_and_are_reported_with_place_and_volume():
    """There is no room for a 1 mm skin in fins of 1 mm.

    What lies within two skins of the cube's inner wall is not counted: the first 1 mm of each fin,
    bounded by arcs; 9 of the 10 mm and 3 of the 4 mm stand out of them.
    """
    part = finned_cube()
    offset = offset_inward(part, 1.0, 0.05)
    assert offset.surface is not None
    np.testing.assert_allclose(offset.surface.volume, 8**3, rtol=0.01)
    found = solid_regions(part, offset.surface, 1.0)
    np.testing.assert_allclose(found.volumes_mm3, [90.0, 30.0], rtol=0.05)
    np.testing.assert_allclose(found.centres, [[10.5, 0, 0], [-7.5, 0, 0]], atol=0.2)


def test_depth_is_within_the_tolerance_at_ten_thousand_points_of_the_wall():
    """Issue: 10,000 random samples; of a part with flat, round and hollow walls and a fin."""
    ball = surface(trimesh.creation.icosphere(subdivisions=3, radius=5.0))
    part = boolean.union([finned_cube(), TriMesh(ball.vertices + 4.0, ball.faces)])
    offset = offset_inward(part, 1.2, 0.05)
    assert offset.surface is not None
    points = spread_points(offset.surface, 10_000)
    depth, _, _ = SignedDistance(part)(points)
    assert np.abs(depth + 1.2).max() <= 0.05
    assert np.abs(depth + 1.2).max() <= 1.5 * offset.error_mm


def test_shells_and_genus_of_the_wall_do_not_change_when_the_tolerance_is_halved():
    """A torus joined to a cube by a bar too thin to be hollow: a ball and a torus inside."""
    torus = surface(trimesh.creation.torus(6, 2.5, major_sections=48, minor_sections=24))
    cube = surface(trimesh.creation.box((6, 6, 6)))
    bar = surface(trimesh.creation.box((6, 1, 1)))
    part = boolean.union(
        [
            torus,
            TriMesh(cube.vertices + np.array([14.0, 0, 0]), cube.faces),
            TriMesh(bar.vertices + np.array([10.0, 0, 0]), bar.faces),
        ]
    )
    for tolerance in (0.2, 0.1):
        offset = offset_inward(part, 1.0, tolerance)
        assert offset.surface is not None
        report = validity(offset.surface)
        assert report.printable, report.faults
        assert (report.connected_components, report.closed_voids, report.genus) == (2, 0, 1)


def test_a_vertex_beside_a_crease_is_on_the_level():
    """The cube whose wall was 0.103 mm off: an edge of the lattice crosses wall and crease."""
    offset = offset_inward(surface(trimesh.creation.box((20, 20, 20))), 1.0, 0.1)
    assert offset.error_mm <= 0.1


def test_too_much_memory_is_told_with_a_tolerance_that_fits(monkeypatch):
    ball = surface(trimesh.creation.icosphere(subdivisions=3, radius=10.0))
    monkeypatch.setattr("texmap_opt.combine.offset.MAX_TETS", 30_000)
    with pytest.raises(SolidError, match=r"needs .* GB of memory or more") as refusal:
        offset_inward(ball, 2.0, 0.001)
    suggested = re.search(r"tolerance_mm = (\S+) would fit", str(refusal.value))
    assert suggested is not None
    fitting = float(suggested[1])
    assert offset_inward(ball, 2.0, fitting).error_mm <= fitting
    # It is no more than a few times what is needed.
    with pytest.raises(SolidError, match="GB of memory"):
        offset_inward(ball, 2.0, fitting / 8)


def test_a_part_no_thicker_than_the_tolerance_is_refused():
    with pytest.raises(SolidError, match=r"20 x 20 x 0.04 mm, is no thicker than tolerance_mm"):
        offset_inward(surface(trimesh.creation.box((20, 20, 0.04))), 0.01, 0.05)


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
