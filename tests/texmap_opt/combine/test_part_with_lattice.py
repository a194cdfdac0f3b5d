"""Rod and plate results against set identities; chips and loose pieces."""

import numpy as np
import pytest
import trimesh

from texmap_opt.combine import boolean
from texmap_opt.combine.offset import offset_inward
from texmap_opt.combine.part_with_lattice import plate_result, rod_result
from texmap_opt.errors import SolidError
from texmap_opt.signed_distance import signed_distance
from texmap_opt.solid.float32_solid import printable_mesh
from texmap_opt.solid.lattice_solid import lattice_solid
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.solid.validity import validity
from texmap_opt.structure.structure import Structure

TOLERANCE = 0.1


def surface(mesh: trimesh.Trimesh) -> TriMesh:
    return TriMesh(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64))


PART = surface(trimesh.creation.box((20, 14, 12)))


def grid_lattice(radius: float = 0.6) -> TriMesh:
    """A cubic grid of struts 4 mm apart that stands out of the part on all sides."""
    axes = [np.arange(-12, 13, 4.0), np.arange(-8, 9, 4.0), np.arange(-8, 9, 4.0)]
    joints = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    gap = np.abs(joints[:, None] - joints).sum(axis=2)
    struts = np.argwhere(np.triu(np.isclose(gap, 4.0)))
    count = len(struts)
    structure = Structure(
        joints, struts, np.full((count, 2), radius), np.zeros(len(joints), bool), np.ones(count)
    )
    return lattice_solid(structure, tolerance_mm=TOLERANCE).surface


@pytest.fixture(scope="module")
def lattice() -> TriMesh:
    return grid_lattice()


def test_rods_under_a_skin_equal_the_shell_plus_the_lattice_in_the_part(lattice):
    """M - (O - S) = (M - O) + (S and M), by volume: 1e-9 is rounding."""
    result = rod_result(PART, lattice, skin_mm=1.0, tolerance_mm=TOLERANCE)
    inner = offset_inward(PART, 1.0, TOLERANCE).surface
    assert inner is not None
    shell = boolean.difference(PART, inner)
    expected = boolean.union([shell, boolean.intersection(lattice, PART)])
    np.testing.assert_allclose(result.surface.volume, expected.volume, rtol=1e-9)
    report = validity(printable_mesh(result.surface)[0])
    assert report.printable, report.faults
    assert report.connected_components == 1


def test_the_outer_surface_stays_the_designers(lattice):
    """Every vertex of the part is still there, and nothing lies outside of it."""
    result = rod_result(PART, lattice, skin_mm=1.0, tolerance_mm=TOLERANCE).surface
    distance, _, _ = signed_distance(PART, result.vertices)
    assert distance.max() <= 1e-12
    corners = {tuple(v) for v in result.vertices}
    assert all(tuple(v) in corners for v in PART.vertices)


RING = surface(trimesh.creation.torus(8, 4, major_sections=32, minor_sections=16))


def triangles(mesh: TriMesh) -> set[frozenset[tuple[float, ...]]]:
    corners = mesh.vertices[mesh.faces]
    return {frozenset(map(tuple, triangle)) for triangle in corners.tolist()}


@pytest.mark.parametrize("combine", [rod_result, plate_result])
@pytest.mark.parametrize("part", [PART, RING])
def test_the_outer_triangles_are_the_designers_own(lattice, part, combine):
    """As sets of corners, bit for bit; the lattice stands out of the parts all round."""
    result = combine(part, lattice, skin_mm=1.0, tolerance_mm=TOLERANCE).surface
    centroids = result.vertices[result.faces].mean(axis=1)
    # The inner wall lies 1 mm deeper.
    outer = result.select(signed_distance(part, centroids)[0] > -0.5)
    assert triangles(outer) == triangles(part)
    assert len(outer.faces) == len(part.faces)


def test_pieces_and_genus_do_not_change_when_the_tolerance_is_halved(lattice):
    """A ring with a skin around a grid of rods, by one boolean and as shell plus clipped lattice."""
    found = set()
    for tolerance in (TOLERANCE, TOLERANCE / 2):
        result = rod_result(RING, lattice, skin_mm=1.0, tolerance_mm=tolerance)
        inner = result.skin.offset.surface
        shell = boolean.difference(RING, inner)
        exact = boolean.union([shell, boolean.intersection(lattice, RING)])
        np.testing.assert_allclose(result.surface.volume, exact.volume, rtol=1e-9)
        for solid in (result.surface, printable_mesh(exact)[0], printable_mesh(result.surface)[0]):
            report = validity(solid)
            found.add((report.connected_components, report.closed_voids, report.genus))
    assert len(found) == 1, found


def test_rods_and_plate_without_skin_make_up_the_part(lattice):
    """(M and S) + (M - S) = M."""
    rods = rod_result(PART, lattice, skin_mm=0.0, tolerance_mm=TOLERANCE)
    plate = plate_result(PART, lattice, skin_mm=0.0, tolerance_mm=TOLERANCE)
    total = rods.surface.volume + plate.surface.volume
    np.testing.assert_allclose(total, PART.volume, rtol=1e-9)


def test_a_plate_with_skin_keeps_the_void_at_the_skins_depth(lattice):
    result = plate_result(PART, lattice, skin_mm=1.0, tolerance_mm=TOLERANCE).surface
    distance, _, _ = signed_distance(PART, result.vertices)
    void = distance < -1e-9
    assert distance[void].max() <= -1.0 + TOLERANCE
    assert validity(printable_mesh(result)[0]).printable


def test_a_skin_thicker_than_the_part_is_refused_with_the_largest_radius(lattice):
    with pytest.raises(SolidError, match=r"skin_mm = 7 leaves no room: .* radius is 5.9"):
        rod_result(PART, lattice, skin_mm=7.0, tolerance_mm=TOLERANCE)


def test_a_lattice_beside_the_part_is_refused(lattice):
    beside = TriMesh(lattice.vertices + 100.0, lattice.faces)
    with pytest.raises(SolidError, match="does not meet the part"):
        rod_result(PART, beside, skin_mm=0.0, tolerance_mm=TOLERANCE)


def test_chips_are_removed_and_counted_and_larger_pieces_refused(lattice):
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    chip = TriMesh(np.asarray(box.vertices) + 2.0, np.asarray(box.faces, np.int64))
    result = rod_result(PART, boolean.union([lattice, chip]), skin_mm=0.0, tolerance_mm=TOLERANCE)
    assert result.chips == 1
    np.testing.assert_allclose(result.chip_volume_mm3, 1e-3, rtol=1e-6)
    assert validity(result.surface).connected_components == 1
    ball = surface(trimesh.creation.icosphere(radius=0.9))
    loose = TriMesh(ball.vertices + 2.0, ball.faces)
    with pytest.raises(SolidError, match="falls into 2 pieces"):
        rod_result(PART, boolean.union([lattice, loose]), skin_mm=0.0, tolerance_mm=TOLERANCE)
