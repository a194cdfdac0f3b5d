"""A printable solid is recognised, and each way of not being one is seen (negative controls)."""

import numpy as np
import pytest
import trimesh

from texmap_opt.errors import SolidError
from texmap_opt.solid.float32_solid import float32_step, printable_mesh
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.solid.validity import require_printable, validity


def surface(mesh: trimesh.Trimesh) -> TriMesh:
    return TriMesh(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64))


def together(*meshes: TriMesh) -> TriMesh:
    starts = np.cumsum([0] + [len(m.vertices) for m in meshes])
    faces = [m.faces + start for m, start in zip(meshes, starts, strict=False)]
    return TriMesh(np.concatenate([m.vertices for m in meshes]), np.concatenate(faces))


def moved(mesh: TriMesh, *shift: float) -> TriMesh:
    return TriMesh(mesh.vertices + np.array(shift), mesh.faces)


BOX = surface(trimesh.creation.box((10, 10, 10)))
BALL = surface(trimesh.creation.icosphere(subdivisions=3, radius=4.0))


def test_a_torus_is_printable_and_has_genus_one():
    report = validity(surface(trimesh.creation.torus(10, 3)))
    assert report.printable
    assert report.watertight
    assert (report.genus, report.connected_components, report.closed_voids) == (1, 1, 0)


def test_a_ball_with_a_void_is_one_component_with_one_closed_void():
    void = TriMesh(0.5 * BALL.vertices, BALL.faces[:, ::-1])
    report = validity(together(BALL, void))
    assert report.printable, report.faults
    assert (report.connected_components, report.closed_voids, report.genus) == (1, 1, 0)
    np.testing.assert_allclose(report.volume_mm3, BALL.volume * (1 - 1 / 8))


BAD = {
    "empty": (TriMesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64)), "no triangles"),
    "open": (TriMesh(BALL.vertices, BALL.faces[1:]), "3 edges lack a neighbour"),
    "one triangle turned over": (
        TriMesh(BALL.vertices, np.vstack([BALL.faces[:1, ::-1], BALL.faces[1:]])),
        "lack a neighbour|more than two",
    ),
    "inside out": (TriMesh(BALL.vertices, BALL.faces[:, ::-1]), "inside out"),
    "a triangle twice": (
        TriMesh(BALL.vertices, np.vstack([BALL.faces, BALL.faces[:1]])),
        "more than two triangles",
    ),
    "overlapping shells": (together(BOX, moved(BOX, 3, 1, 2)), "overlap by 504"),
    "not a number": (moved(BALL, np.nan, 0, 0), "not a finite number"),
    "a vertex named twice": (
        TriMesh(BALL.vertices, np.vstack([BALL.faces, [[0, 0, 1]]])),
        "name a vertex twice",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_each_fault_is_seen_and_named(name):
    mesh, message = BAD[name]
    with pytest.raises(SolidError, match=message):
        require_printable(mesh, name)


def edge_touching_boxes() -> TriMesh:
    """Two boxes that share one edge of the mesh: four triangles meet there."""
    pair = together(BOX, moved(BOX, 10, 10, 0))
    vertices, index = np.unique(pair.vertices, axis=0, return_inverse=True)
    return TriMesh(vertices, index.reshape(-1)[pair.faces])


def corner_touching_boxes() -> TriMesh:
    pair = together(BOX, moved(BOX, 10, 10, 10))
    vertices, index = np.unique(pair.vertices, axis=0, return_inverse=True)
    return TriMesh(vertices, index.reshape(-1)[pair.faces])


def test_four_triangles_at_an_edge_and_two_fans_at_a_vertex_are_faults():
    assert "2 edges" not in " ".join(validity(BOX).faults)
    assert any("more than two triangles" in f for f in validity(edge_touching_boxes()).faults)
    assert any("only touch" in f for f in validity(corner_touching_boxes()).faults)


def test_a_surface_that_crosses_itself_in_one_shell_is_seen():
    """The top of a ball is pushed out through its bottom; the volume stays positive."""
    ball = BALL.vertices.copy()
    ball[ball[:, 2] > 3.0, 2] -= 9.0
    assert any("crosses itself" in f for f in validity(TriMesh(ball, BALL.faces)).faults)


def test_rounding_a_fine_mesh_far_from_the_origin_stays_closed_and_within_the_resolution():
    """At 3000 mm float32 steps are 0.00024 mm; edges of 0.0003 mm collapse or survive."""
    fine = trimesh.creation.icosphere(subdivisions=5, radius=0.01)
    far = moved(surface(fine), 3000.0, 3000.0, 3000.0)
    mesh, displaced = printable_mesh(far)
    assert validity(mesh).printable, validity(mesh).faults
    assert displaced <= 20 * float32_step(far.vertices)
    np.testing.assert_array_equal(mesh.vertices, mesh.vertices.astype(np.float32))
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)
    assert len(mesh.faces) < len(far.faces)


@pytest.mark.parametrize("gap", [0.0, 1e-9])
def test_surfaces_that_only_touch_are_moved_apart(gap):
    """Two boxes whose corners meet are two shells after the weld that every reader does."""
    pair = together(BOX, moved(BOX, 10 + gap, 10 + gap, 10 + gap))
    mesh, displaced = printable_mesh(pair)
    report = validity(mesh)
    assert report.printable, report.faults
    assert report.connected_components == 2
    assert displaced < 1e-5


def test_what_is_thinner_than_float32_can_say_is_refused():
    flat = TriMesh(BOX.vertices * [1, 1, 1e-9] + [0, 0, 100.0], BOX.faces)
    with pytest.raises(SolidError, match="single precision"):
        printable_mesh(flat)
