"""Openings of a skin against their definition; the rest of the surface; refusals."""

import numpy as np
import pytest
import trimesh

from texmap_opt.case_openings import Opening, opening_from_text
from texmap_opt.combine.opened_surface import opened_surface
from texmap_opt.combine.part_with_lattice import plate_result, rod_result
from texmap_opt.combine.region_cut import cut_by_region
from texmap_opt.errors import CaseError, InputError
from texmap_opt.region import AbstractRegion, Box, Cylinder, Intersection, Normal, Sphere, Stl
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.float32_solid import printable_mesh
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.solid.validity import validity

TOLERANCE = 0.1
SIZES = {"skin_mm": 1.0, "tolerance_mm": TOLERANCE}


def surface(mesh: trimesh.Trimesh) -> TriMesh:
    return TriMesh(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64))


CUBE = surface(trimesh.creation.box((20, 20, 20)))
UP = np.array([0.0, 0.0, 1.0])
POST = surface(trimesh.creation.box((2, 2, 30)))
TOP = Opening("here", Normal(UP))


def at(*numbers: float) -> np.ndarray:
    return np.array(numbers, dtype=np.float64)


@pytest.mark.parametrize(
    ("region", "area"),
    [
        (Sphere(at(0, 0, 10), 4.0), np.pi * 16),
        (Sphere(at(0, 0, 12), 4.0), np.pi * 12),
        (Box(at(-3, -4, 9), at(3, 4, 11)), 48.0),
        (Box(at(-3, -4, -11), at(3, 4, 11)), 96.0),
        (Box(at(5, 5, 5), at(11, 11, 11)), 75.0),
        (Cylinder(at(-11, 0, 0), at(11, 0, 0), 3.0), 18 * np.pi),
        (Normal(UP), 400.0),
        (Intersection((Normal(UP), Box(at(-11, -11, 0), at(0, 0, 11)))), 100.0),
        (Stl(surface(trimesh.creation.box((6, 6, 40))), "bar.stl"), 72.0),
    ],
)
def test_a_surface_is_cut_along_the_border_of_a_region(region: AbstractRegion, area: float):
    """Areas on a cube of 20 mm; the cut is within 0.01 mm of borders of at most 60 mm."""
    inside, outside = cut_by_region(CUBE, region, 0.01)
    np.testing.assert_allclose(inside.face_areas.sum(), area, atol=0.6, rtol=2e-3)
    np.testing.assert_allclose(inside.face_areas.sum() + outside.face_areas.sum(), 2400, rtol=1e-12)
    assert len(inside.faces) + len(outside.faces) < 8000


@pytest.mark.parametrize(
    "text", ["sphere = { center = [0, 0, 10], radius = 5 }", "normal = [0, 0, 1]"]
)
def test_the_skin_is_what_lies_within_its_thickness_of_the_rest_of_the_surface(text):
    """At random points more than the tolerance from the border of that set."""
    opening = opening_from_text(text)
    result = rod_result(CUBE, POST, openings=[opening], **SIZES)
    report = validity(printable_mesh(result.surface)[0])
    assert report.printable, report.faults
    assert (report.closed_voids, report.connected_components) == (0, 1)
    kept = opened_surface(CUBE, [opening], **SIZES).kept
    points = np.random.default_rng(1).uniform(-10, 10, (10_000, 3))
    depth, _, _ = SignedDistance(kept).unsigned(points)
    post = np.abs(points[:, :2]).max(axis=1)
    sure = (np.abs(depth - 1.0) > TOLERANCE) & (np.abs(post - 1.0) > 1e-9)
    solid = (depth < 1.0) | (post < 1.0)
    found = SignedDistance(result.surface).contains(points)
    assert np.array_equal(found[sure], solid[sure])
    assert 0.1 < solid.mean() < 0.5


def test_the_walls_beside_an_open_face_keep_their_thickness_to_the_rim():
    """An open box: its mouth is 18 x 18, its volume that of five walls, and the post."""
    result = rod_result(CUBE, POST, openings=[TOP], **SIZES)
    expected = 20**3 - 18 * 18 * 19 + 4 * 19
    np.testing.assert_allclose(result.surface.volume, expected, rtol=0.01)
    np.testing.assert_allclose(result.skin.opened.mouths_mm2, [18 * 18], rtol=0.01)


def test_facets_away_from_an_opening_are_the_designers_own():
    result = rod_result(CUBE, POST, openings=[TOP], **SIZES).surface
    ours = triangles(result)
    side = CUBE.select(CUBE.face_normals[:, 2] < 0.5)
    assert triangles(side) <= ours
    top = CUBE.select(CUBE.face_normals[:, 2] > 0.5)
    assert not triangles(top) & ours


def triangles(mesh: TriMesh) -> set[frozenset[tuple[float, ...]]]:
    return {frozenset(map(tuple, corners.tolist())) for corners in mesh.vertices[mesh.faces]}


def test_an_opening_of_a_plate_lets_its_void_out():
    closed = plate_result(CUBE, POST, **SIZES).surface
    opened = plate_result(CUBE, POST, openings=[TOP], **SIZES).surface
    assert validity(closed).closed_voids == 1
    assert validity(opened).closed_voids == 0
    np.testing.assert_allclose(closed.volume - opened.volume, 4.0, rtol=0.05)


def test_openings_that_open_nothing_are_refused():
    def refused(text: str, reason: str, **changes) -> None:
        with pytest.raises(InputError, match=reason):
            rod_result(CUBE, POST, openings=[opening_from_text(text)], **(SIZES | changes))

    refused("sphere = { center = [0, 0, 0], radius = 5 }", "holds nothing of the part's surface")
    refused("sphere = { center = [0, 0, 10], radius = 0.9 }", "opens nothing: .* than 0.8")
    refused("box = [[-11, -11, -11], [11, 11, 11]]", "leaves nothing of the surface")
    refused("normal = [0, 0, 1]", "no skin to open", skin_mm=0.0)


def test_text_that_is_no_region_is_refused():
    with pytest.raises(InputError, match="is not the entry"):
        opening_from_text("box: 1 2 3")
    with pytest.raises(CaseError, match="there is no such region"):
        opening_from_text("bax = [[0, 0, 0], [1, 1, 1]]")
