"""Overhanging area, supports and struts against closed forms."""

import numpy as np
import pytest
import trimesh

from texmap_opt.combine.boolean import union
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.overhang import DIRECTIONS, UP, overhang, strut_overhang
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.structure import Structure

Z = np.array(UP)


def surface(mesh: trimesh.Trimesh) -> TriMesh:
    return TriMesh(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64))


def box(*edges: float, at=(0, 0, 0)) -> TriMesh:
    return surface(trimesh.creation.box(edges).apply_translation(at))


def tilted_plate(angle_deg: float) -> TriMesh:
    """A plate 20 x 20 x 1, turned about x."""
    turn = trimesh.transformations.rotation_matrix(np.radians(angle_deg), [1, 0, 0])
    return surface(trimesh.creation.box((20, 20, 1)).apply_transform(turn))


def hanging(mesh: TriMesh, **options):
    return overhang(SignedDistance(mesh), **({"direction": Z} | options))


# Bottom 400 mm² at the angle to the plate, the lower narrow side 20 mm² at 90 degrees less it.
@pytest.mark.parametrize(
    ("angle", "area"), [(0, 0), (30, 400), (44.5, 400), (45, 0), (45.5, 20), (60, 20), (80, 20)]
)
def test_a_tilted_plate_hangs_over_by_the_side_below_the_limit(angle, area):
    found = hanging(tilted_plate(angle))
    np.testing.assert_allclose(found.area_mm2, area, rtol=1e-9)
    np.testing.assert_allclose(found.share, area / 880, rtol=1e-9)


def test_the_limit_decides():
    assert hanging(tilted_plate(30), limit_deg=25.0).area_mm2 == 0
    np.testing.assert_allclose(hanging(tilted_plate(30), limit_deg=80.0).area_mm2, 420)


def test_supports_of_a_tilted_plate_fill_the_wedge_below_it():
    """Half of 20 x 20 cos(30) x 20 sin(30); rays in even strata: 0.5 %."""
    found = hanging(tilted_plate(30))
    expected = 0.5 * 20 * 20 * np.cos(np.pi / 6) * 20 * np.sin(np.pi / 6)
    np.testing.assert_allclose(found.support_volume_mm3, expected, rtol=5e-3)
    assert found.support_samples


def test_supports_of_a_table_end_on_the_floor_or_on_what_is_below():
    """A top 10 x 10 on a leg 2 x 2 x 5 on a foot 6 x 6 x 1: (100 - 36) 6 + (36 - 4) 5."""
    parts = [
        box(10, 10, 2, at=(0, 0, 7)),
        box(2, 2, 5.2, at=(0, 0, 3.5)),
        box(6, 6, 1, at=(0, 0, 0.5)),
    ]
    found = hanging(union(parts))
    np.testing.assert_allclose(found.area_mm2, 96)
    np.testing.assert_allclose(found.support_volume_mm3, 64 * 6 + 32 * 5, rtol=5e-3)
    # Standing on an edge, all its sides are at 45 degrees or upright.
    np.testing.assert_allclose(found.best_direction, [np.sqrt(0.5), np.sqrt(0.5), 0])
    assert found.best_share == 0


def test_a_ball_hangs_over_by_its_cap():
    """Cap of 45 degrees: (1 - cos 45°)/2 of the area; facets of 2 degrees change it by 1 %."""
    found = hanging(surface(trimesh.creation.icosphere(5, 10.0)))
    np.testing.assert_allclose(found.share, (1 - np.cos(np.pi / 4)) / 2, rtol=0.02)


def test_the_best_of_26_directions_stands_a_pyramid_on_its_base():
    base = [(x, y, 10) for x in (-5, 5) for y in (-5, 5)]
    pyramid = surface(trimesh.convex.convex_hull(np.array([*base, (0, 0, 0)], dtype=float)))
    found = hanging(pyramid, limit_deg=70.0)
    assert found.share > 0.4
    assert found.best_direction == [0, 0, -1]
    assert found.best_share == 0
    assert len(DIRECTIONS) == 26
    assert DIRECTIONS[0].tolist() == [0, 0, 1]


def test_a_vertex_that_no_triangle_uses_is_not_the_build_plate():
    plate = box(10, 10, 2)
    lower = TriMesh(np.vstack([plate.vertices, [[0, 0, -50.0]]]), plate.faces)
    assert hanging(lower).area_mm2 == 0


def cube_lattice(cells: int, edge: float, radius: float) -> Structure:
    joints = edge * np.array(list(np.ndindex(*[cells + 1] * 3)), dtype=float)
    gaps = np.linalg.norm(joints[:, None] - joints[None], axis=2)
    struts = np.argwhere(np.triu(np.isclose(gaps, edge)))
    radii = np.full((len(struts), 2), radius)
    return Structure(
        joints, struts, radii, np.zeros(len(joints), bool), np.ones(len(struts)), "round"
    )


def test_struts_of_a_cube_lattice_lie_or_stand():
    """Of 18 struts an axis those along x and y lie, 12 of them on the plate."""
    found = strut_overhang(cube_lattice(2, 5.0, 0.4), direction=Z)
    assert found.count == 24
    np.testing.assert_allclose([found.length_mm, found.share], [120, 120 / 270])


def test_a_cube_lattice_built_along_an_edge_has_its_struts_at_45_degrees_or_flat():
    """Those along x and y are at the limit; of 18 along z two lie on the plate."""
    along = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    lattice = cube_lattice(2, 5.0, 0.4)
    assert strut_overhang(lattice, direction=along).count == 16
    assert strut_overhang(lattice, direction=along, limit_deg=46.0).count == 16 + 36


def test_walls_stand_along_their_axis_and_lie_across_it():
    """A cross of two walls in the plane: along z both stand; along x one stands and one lies."""
    joints = np.array([[-5.0, 0, 5], [5, 0, 5], [0, -5, 5], [0, 5, 5]])
    cross = Structure(
        joints,
        np.array([[0, 1], [2, 3]]),
        np.full((2, 2), 0.4),
        np.zeros(4, bool),
        np.ones(2),
        "round",
    ).extruded(Z, np.array([0.0, 10.0]))
    assert strut_overhang(cross, direction=Z).count == 0
    found = strut_overhang(cross, direction=np.array([1.0, 0.0, 0.0]))
    assert found.count == 1
    np.testing.assert_allclose(found.share, 0.5)
