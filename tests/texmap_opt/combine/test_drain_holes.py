"""Drain holes: they open the void, take the skin's share of a cylinder, and say when they cannot."""

import numpy as np
import pytest
import trimesh

from texmap_opt.case_openings import Drain, drain_from_text
from texmap_opt.combine import boolean
from texmap_opt.combine.drain_holes import DrainHole, drain_holes
from texmap_opt.combine.part_with_lattice import Result, plate_result, rod_result
from texmap_opt.errors import InputError
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.float32_solid import printable_mesh
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.solid.validity import validity

TOLERANCE = 0.1
SIZES = {"skin_mm": 1.0, "tolerance_mm": TOLERANCE}


def surface(mesh: trimesh.Trimesh) -> TriMesh:
    return TriMesh(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64))


def column(x: float, y: float, width: float) -> TriMesh:
    """A square column along z that stands out of the cube."""
    moved = trimesh.transformations.translation_matrix([x, y, 0.0])
    return surface(trimesh.creation.box((width, width, 30), moved))


CUBE = surface(trimesh.creation.box((20, 20, 20)))
POST = column(-5.0, -5.0, 2.0)


@pytest.fixture(scope="module")
def closed() -> Result:
    return rod_result(CUBE, POST, **SIZES)


def test_a_hole_opens_the_void_and_takes_the_skins_share_of_a_cylinder(closed):
    """The skin loses pi/4 d² times its thickness there; the section is a polygon of that area."""
    assert validity(closed.surface).closed_voids == 1
    diameter = 3.0
    drain = drain_from_text(f"4,3,11,{diameter}")
    drained = rod_result(CUBE, POST, drains=[drain], **SIZES)
    report = validity(printable_mesh(drained.surface)[0])
    assert report.printable, report.faults
    assert (report.closed_voids, report.connected_components) == (0, 1)
    thickness = 10 - ceiling_over(closed.surface, 4.0, 3.0)
    assert abs(thickness - 1.0) < TOLERANCE
    lost = closed.surface.volume - drained.surface.volume
    np.testing.assert_allclose(lost, np.pi / 4 * diameter**2 * thickness, rtol=0.01)
    (hole,) = drained.skin.drains
    np.testing.assert_allclose(hole.point, [4, 3, 10], atol=1e-12)
    np.testing.assert_allclose(hole.direction, [0, 0, -1], atol=1e-12)
    assert hole.open_share == pytest.approx(1.0, abs=1e-6)
    assert 1.0 - TOLERANCE < hole.length_mm < 1.0 + 4 * TOLERANCE


def ceiling_over(result: TriMesh, x: float, y: float) -> float:
    """Height of the ceiling of the void over a place [mm]."""
    up = np.array([[0.0, 0.0, 1.0]])
    path, _ = SignedDistance(result).first_hit(np.array([[x, y, 0.0]]), up)
    return float(path[0])


def test_a_slanting_hole_is_longer_by_the_slant(closed):
    """Through 1 mm at 45 degrees: 1.41 mm along the axis, of area pi/4 d² across it."""
    slanting = drain_from_text("4,3,10,1,1,0,-1")
    drained = rod_result(CUBE, POST, drains=[slanting], **SIZES)
    thickness = 10 - ceiling_over(closed.surface, 5.0, 3.0)
    lost = closed.surface.volume - drained.surface.volume
    np.testing.assert_allclose(lost, np.pi / 4 * np.sqrt(2) * thickness, rtol=0.01)
    assert validity(drained.surface).closed_voids == 0


def test_each_of_two_voids_of_a_plate_needs_its_hole():
    hollows = TriMesh(
        np.concatenate([column(-5, -5, 4).vertices, column(5, 5, 4).vertices]),
        np.concatenate([POST.faces, POST.faces + len(POST.vertices)]),
    )
    one = plate_result(CUBE, hollows, drains=[drain_from_text("5,5,-10,2")], **SIZES)
    both = plate_result(
        CUBE, hollows, drains=[drain_from_text("5,5,-10,2"), drain_from_text("-5,-5,10,2")], **SIZES
    )
    assert validity(one.surface).closed_voids == 1
    assert validity(both.surface).closed_voids == 0


INNER = surface(trimesh.creation.box((18, 18, 18)))


def holes(text: str, part: TriMesh = CUBE) -> tuple[DrainHole, ...]:
    """Drain holes of a part whose inner wall is known, with the post as the lattice."""

    def void(solid: TriMesh) -> TriMesh:
        return boolean.difference(boolean.intersection(solid, INNER), POST)

    return drain_holes(part, INNER, [drain_from_text(text)], void=void, **SIZES)


def test_half_a_hole_beside_a_post_is_half_open():
    """The post covers x < -4; its section is a polygon of 16 corners, symmetric about the line."""
    (hole,) = holes("-4,-5,10,1")
    np.testing.assert_allclose(hole.open_share, 0.5, atol=1e-6)


def test_holes_that_cannot_be_made_say_why():
    fin = trimesh.creation.box((10, 1, 20), trimesh.transformations.translation_matrix([14, 0, 0]))
    cube = trimesh.creation.box((20, 20, 20))
    finned = surface(trimesh.boolean.union([cube, fin], engine="manifold"))
    for text, part, reason in (
        ("-5,-5,10,1", CUBE, "only 0 % of the hole leads into the void"),
        ("4,3,10,1,0,0,1", CUBE, "leads out of the part"),
        ("15,0.5,0,0.5", finned, "no hollow within"),
        ("10,0.7,0,1", finned, "rises"),
    ):
        with pytest.raises(InputError, match=reason):
            holes(text, part)
    with pytest.raises(InputError, match="no skin to open"):
        rod_result(
            CUBE, POST, skin_mm=0.0, tolerance_mm=TOLERANCE, drains=[drain_from_text("4,3,10,1")]
        )


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("1,2,3", "has 3 numbers"),
        ("1,2,3,x", "must be numbers"),
        ("1,2,3,nan", "must be numbers"),
        ("1,2,3,0", "must be above 0"),
        ("1,2,3,1,0,0,0", "has no length"),
    ],
)
def test_text_that_is_no_drain_is_refused(text, reason):
    with pytest.raises(InputError, match=reason):
        drain_from_text(text)


def test_a_drain_on_a_round_part_goes_through_the_whole_skin():
    """On a ball of radius 8 the rim of a hole of 4 mm lies 0.25 mm below its middle."""
    ball = surface(trimesh.creation.icosphere(subdivisions=4, radius=8.0))
    drain = Drain("here", np.array([0.0, 0.0, 9.0]), 4.0, np.array([0.0, 0.0, -1.0]))
    result = rod_result(ball, POST, drains=[drain], **SIZES)
    assert validity(result.surface).closed_voids == 0
    points = np.array([[1.9 * np.cos(a), 1.9 * np.sin(a), 6.6] for a in np.arange(12)])
    assert not SignedDistance(result.surface).contains(points).any()
