"""Trapped powder, limits and the STL round trip; `texmap check` on sound and broken files."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

from texmap_opt.cli import main
from texmap_opt.combine.boolean import difference
from texmap_opt.errors import InputError
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.float32_solid import printable_mesh
from texmap_opt.solid.printability import Printability, PrintLimits, printability
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.solid.validity import validity
from texmap_opt.solid.voids import closed_voids


def surface(mesh: trimesh.Trimesh) -> TriMesh:
    return TriMesh(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64))


def box(*edges: float, at=(0, 0, 0)) -> TriMesh:
    return surface(trimesh.creation.box(edges).apply_translation(at))


def measured(mesh: TriMesh, **limits) -> Printability:
    found = printability(mesh, validity(mesh), limits=PrintLimits(**limits))
    assert found is not None
    return found


PLATE = box(20, 20, 4)
HOLLOW = difference(
    PLATE, box(4, 4, 2, at=(-6, 0, 0)), box(3, 3, 3, at=(0, 0, 0)), box(1, 1, 1, at=(6, 0, 0))
)


def test_closed_voids_are_listed_by_volume_with_a_point_in_each():
    found = closed_voids(SignedDistance(HOLLOW))
    assert found.count == 3
    np.testing.assert_allclose(found.total_mm3, 32 + 27 + 1)
    np.testing.assert_allclose([void.volume_mm3 for void in found.largest], [32, 27, 1])
    for void, (middle, half) in zip(
        found.largest,
        [([-6, 0, 0], [2, 2, 1]), ([0, 0, 0], [1.5] * 3), ([6, 0, 0], [0.5] * 3)],
        strict=True,
    ):
        assert (np.abs(np.array(void.inside_mm) - middle) < half).all()


def test_trapped_powder_is_told_with_its_remedy_and_an_opened_void_is_none():
    (warning,) = [w for w in measured(HOLLOW).warnings if "trapped" in w]
    assert "60 mm³" in warning
    assert "3 closed voids" in warning
    assert "drain holes" in warning
    drilled = difference(PLATE, box(4, 4, 9))
    assert measured(drilled).closed_voids.count == 0
    assert not [w for w in measured(drilled).warnings if "trapped" in w]


def test_limits_hold_at_their_value_and_are_violated_above_it():
    slotted = difference(PLATE, box(0.5, 10, 10))
    assert measured(slotted, wall_mm=4.0, gap_mm=0.5).violations == []
    wall, gap = measured(slotted, wall_mm=4.1, gap_mm=0.51).violations
    assert "wall or strut is 4 mm" in wall
    assert "4.1 mm asked for" in wall
    assert "gap is 0.5 mm" in gap


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"wall_mm": 0.0}, "--min-wall 0: must be a length above 0"),
        ({"gap_mm": float("nan")}, "--min-gap nan: must be a length above 0"),
        ({"overhang_deg": 91.0}, "--overhang 91: must be an angle from 0 to 90"),
        ({"build_direction": (0.0, 0.0, 0.0)}, "not all zero"),
    ],
)
def test_impossible_limits_are_refused(limits, message):
    with pytest.raises(InputError, match=message):
        PrintLimits(**limits)


def test_a_wall_thinner_than_any_process_prints_is_told_of():
    assert any("below the 0.1 mm that print" in w for w in measured(box(9, 9, 0.09)).warnings)
    assert not measured(box(9, 9, 0.11)).warnings


def test_a_better_build_direction_is_told_of():
    """A cone that stands on its tip."""
    tip = surface(
        trimesh.convex.convex_hull(
            np.array([[5, 5, 9], [-5, 5, 9], [-5, -5, 9], [5, -5, 9], [0, 0, 6.0]])
        )
    )
    (warning,) = measured(tip, overhang_deg=70.0).warnings
    assert "built along (0, 0, -1) it is 0 %" in warning


def test_float32_keeps_a_solid_near_the_origin_and_spoils_a_fine_one_far_away():
    """At 3000 mm float32 steps are 0.00024 mm and the facets 0.0004 mm."""
    ball = surface(trimesh.creation.icosphere(subdivisions=5, radius=0.01))
    near = measured(TriMesh(1000 * ball.vertices, ball.faces)).after_stl
    assert near.same
    assert near.printable
    assert 0 < near.snapped_mm < 1e-6
    far = measured(TriMesh(ball.vertices + 3000.0, ball.faces))
    assert not far.after_stl.same
    assert far.after_stl.lost_vertices > 0
    assert "name a vertex twice" in " ".join(far.after_stl.faults)
    assert any("another solid" in w for w in far.warnings)
    mended, _ = printable_mesh(TriMesh(ball.vertices + 3000.0, ball.faces))
    again = measured(mended).after_stl
    assert (again.same, again.snapped_mm, again.lost_vertices) == (True, 0.0, 0)


# `texmap check` -------------------------------------------------------------------------------

VERTICES = box(10, 10, 2).vertices
FACES = box(10, 10, 2).faces


def spoilt(value: float) -> np.ndarray:
    vertices = VERTICES.copy()
    vertices[0, 0] = value
    return vertices


# What is wrong, the triangles, and the fault that is told.
BROKEN = {
    "NaN": (spoilt(np.nan), FACES, "not a finite number"),
    "infinite": (spoilt(np.inf), FACES, "not a finite number"),
    "beyond any printer": (VERTICES * 1e30, FACES, "beyond 1e\\+09 mm"),
    "open": (VERTICES, FACES[1:], "3 edges lack a neighbour"),
    "a triangle twice": (VERTICES, np.vstack([FACES, FACES[:1]]), "more than two triangles"),
    "a triangle without area": (VERTICES, np.vstack([FACES, [[0, 0, 1]]]), "name a vertex twice"),
    "all in one point": (0 * VERTICES, FACES, "name a vertex twice"),
    "all in one plane": (VERTICES * [1, 1, 0], FACES, "more than two triangles"),
    "inside out": (VERTICES, FACES[:, ::-1], "inside out"),
    "one triangle": (VERTICES, FACES[:1], "3 edges lack a neighbour"),
}


def stl(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    """A binary STL without a check of any kind."""
    triangle = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    records = np.zeros(len(faces), dtype=triangle)
    records["corners"] = vertices[faces]
    path.write_bytes(bytes(80) + np.uint32(len(faces)).tobytes() + records.tobytes())
    return path


def check(capsys: pytest.CaptureFixture, *arguments: object) -> tuple[int, dict, str]:
    """Exit code, what was printed, and what was said."""
    with pytest.raises(SystemExit) as end:
        main(["check", *map(str, arguments)])
    printed = capsys.readouterr()
    assert isinstance(end.value.code, int)
    return end.value.code, json.loads(printed.out) if printed.out else {}, printed.err


@pytest.mark.parametrize("name", BROKEN)
def test_check_answers_a_broken_file_with_its_faults_as_json(name, tmp_path, capsys):
    vertices, faces, fault = BROKEN[name]
    code, report, said = check(capsys, stl(tmp_path / "broken.stl", vertices, faces))
    assert code == 1
    assert report["printable"] is False
    assert report["printability"] is None
    assert said == ""
    assert any(re.search(fault, one) for one in report["faults"])


def test_check_measures_a_sound_file_and_keeps_to_the_limits(tmp_path, capsys):
    sound = stl(tmp_path / "sound.stl", VERTICES, FACES)
    code, report, said = check(capsys, sound, "--min-wall", 2, "--min-gap", 1)
    assert (code, said) == (0, "")
    assert report["watertight"]
    np.testing.assert_allclose(report["printability"]["walls"]["smallest_mm"], 2)
    assert report["printability"]["gaps"]["smallest_mm"] is None
    assert report["printability"]["after_stl"]["same"]
    code, report, said = check(capsys, sound, "--min-wall", 2.1)
    assert code == 1
    assert report["printable"]
    assert report["printability"]["violations"]
    assert said.startswith("texmap: sound.stl: the smallest wall or strut is 2 mm")


def test_check_turns_the_part_by_the_build_direction(tmp_path, capsys):
    sound = stl(tmp_path / "sound.stl", VERTICES + np.array([0, 0, 20.0]), FACES)
    code, report, _ = check(capsys, sound, "--build-direction=1,0,2", "--overhang", 70)
    assert code == 0
    found = report["printability"]["overhang"]
    np.testing.assert_allclose(found["build_direction"], np.array([1, 0, 2]) / np.sqrt(5))
    # Bottom at 26.6 degrees to the plate, one narrow side at 63.4.
    np.testing.assert_allclose(found["area_mm2"], 100 + 20)


@pytest.mark.parametrize("content", [b"", b"hello"])
def test_check_refuses_what_is_no_surface_file(content, tmp_path, capsys):
    (tmp_path / "no.stl").write_bytes(content)
    code, report, said = check(capsys, tmp_path / "no.stl")
    assert (code, report) == (2, {})
    assert said.startswith("texmap: no.stl: ")
