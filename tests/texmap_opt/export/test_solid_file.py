"""Every format gives back what was written: triangle for triangle, vertices bit for bit, unit, metadata."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
import pyvista
import trimesh
from read_by_lib3mf import MILLIMETRE, read_package

from texmap_opt.errors import InputError, OutputError
from texmap_opt.export import obj, ply, stl
from texmap_opt.export.metadata import Metadata
from texmap_opt.export.solid_file import WRITERS, Solid, check_ending
from texmap_opt.part_file import ENDINGS, read_part_file
from texmap_opt.solid.tri_mesh import TriMesh

# Signs that XML, comments and ASCII cannot take as they are.
ABOUT = Metadata("Träger <1> & \n2", "of PA12", datetime(2026, 11, 23, 9, 30, tzinfo=UTC))
TITLE = "Träger <1> &  2"


def ball() -> TriMesh:
    """Every coordinate a float32 with all its digits; some tiny, some large, one zero of each sign."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=7.3)
    vertices = np.asarray(mesh.vertices) * [1, 1e-7, 1e6] + [3, 0, 0]
    vertices[0, 1], vertices[1, 1] = 0.0, -0.0
    return TriMesh(vertices.astype(np.float32).astype(np.float64), np.asarray(mesh.faces, np.int64))


def same_bits(found: np.ndarray, wanted: np.ndarray, kind: type = np.float32) -> None:
    np.testing.assert_array_equal(
        np.ascontiguousarray(found, kind).view(np.uint8),
        np.ascontiguousarray(wanted, kind).view(np.uint8),
    )


def test_stl_holds_every_triangle_in_order_as_float32(tmp_path: Path):
    surface = ball()
    Solid(surface).save(tmp_path / "a.stl", ABOUT)
    back = trimesh.load(tmp_path / "a.stl", process=False)
    same_bits(back.triangles, surface.vertices[surface.faces])
    content = (tmp_path / "a.stl").read_bytes()
    assert len(content) == 84 + 50 * len(surface.faces)
    assert content[:80].startswith(b"binary STL, unit millimetre, written by texmap-opt ")
    assert b": Tr?ger <1> &" in content[:80]
    normals = np.frombuffer(content[84:], stl.TRIANGLE)["normal"]
    np.testing.assert_allclose(normals, surface.face_normals, atol=1e-6)  # float32 normals


@pytest.mark.parametrize("ending", [".obj", ".ply"])
def test_obj_and_ply_hold_vertices_and_triangles_as_float32(ending: str, tmp_path: Path):
    surface, path = ball(), tmp_path / f"a{ending}"
    Solid(surface).save(path, ABOUT)
    back = trimesh.load(path, process=False, maintain_order=True)
    same_bits(back.vertices, surface.vertices)
    np.testing.assert_array_equal(back.faces, surface.faces)
    # VTK's reader is another one.
    seen = pyvista.read(path)
    same_bits(seen.points, surface.vertices)
    np.testing.assert_array_equal(seen.regular_faces, surface.faces)
    head = path.read_bytes()[:300].decode("utf-8", "replace")
    sign, title = ("# ", TITLE) if ending == ".obj" else ("comment ", TITLE.replace("ä", "?"))
    for line in ("Unit: millimetre", f"Title: {title}", "Description: of PA12"):
        assert f"\n{sign}{line}\n" in f"\n{head}"


def test_vtp_holds_vertices_as_float64_with_unit_and_metadata(tmp_path: Path):
    rng = np.random.default_rng(1)
    surface = TriMesh(ball().vertices * rng.normal(size=3), ball().faces)
    Solid(surface).save(tmp_path / "a.vtp", ABOUT)
    back = pyvista.read(tmp_path / "a.vtp")
    same_bits(back.points, surface.vertices, np.float64)
    np.testing.assert_array_equal(back.regular_faces, surface.faces)
    said = {name: back.field_data[name][0] for name in back.field_data}
    assert said["Unit"] == "millimetre"
    assert said["Title"] == TITLE
    assert said["Description"] == "of PA12"


def test_3mf_is_read_by_lib3mf_without_warnings_as_float32(tmp_path: Path):
    surface = ball()
    Solid(surface).save(tmp_path / "a.3mf", ABOUT)
    package = read_package(tmp_path / "a.3mf")
    assert package.warnings == ()
    assert package.unit == MILLIMETRE
    assert package.built == ("part",)
    found = package.objects["part"]
    assert found.manifold
    same_bits(found.mesh.vertices, surface.vertices)
    np.testing.assert_array_equal(found.mesh.faces, surface.faces)
    application = package.metadata.pop("Application")
    assert application.startswith("texmap-opt ")
    assert package.metadata == {
        "Title": TITLE, "Description": "of PA12", "CreationDate": "2026-11-23T09:30:00+00:00",
    }  # fmt: skip


def test_lib3mf_sees_a_hole(tmp_path: Path):
    """The negative control of "manifold"."""
    surface = ball()
    Solid(TriMesh(surface.vertices, surface.faces[1:])).save(tmp_path / "a.3mf")
    assert not read_package(tmp_path / "a.3mf").objects["part"].manifold


@pytest.mark.parametrize("ending", ENDINGS)
def test_what_is_written_can_be_read_as_a_part(ending: str, tmp_path: Path):
    """The reader welds, so vertices come in another order; what they bound is the same."""
    assert ending in WRITERS
    surface = ball()
    Solid(surface).save(tmp_path / f"a{ending}")
    back = read_part_file(tmp_path / f"a{ending}")
    assert back.unit == ("mm" if ending == ".3mf" else None)
    same_bits(back.surface.bounds, surface.bounds)
    # Nine digits tell any two float32 apart, but a reader in float64 sees them rounded by 5e-9.
    assert back.surface.volume == pytest.approx(surface.volume, rel=1e-8)


@pytest.mark.parametrize("ending", WRITERS)
def test_equal_surfaces_give_equal_bytes_and_the_name_is_the_title(ending: str, tmp_path: Path):
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        Solid(ball()).save(tmp_path / folder / f"bracket{ending}")
    one, two = ((tmp_path / k / f"bracket{ending}").read_bytes() for k in ("one", "two"))
    assert one == two
    Solid(ball()).save(tmp_path / f"other{ending}")
    assert (tmp_path / f"other{ending}").read_bytes() != one


@pytest.mark.parametrize("ending", WRITERS)
def test_pieces_written_one_after_another_join(
    ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    Solid(ball()).save(tmp_path / f"a{ending}")
    monkeypatch.setattr(stl, "TRIANGLES_PER_CHUNK", 7)
    monkeypatch.setattr(obj, "TRIANGLES_PER_CHUNK", 7)
    monkeypatch.setattr(ply, "ROWS_PER_CHUNK", 7)
    monkeypatch.setattr("texmap_opt.export.vtk._CHUNK", 7)
    monkeypatch.setattr("texmap_opt.export.rows_text.ROWS_PER_CHUNK", 7)
    (tmp_path / "small").mkdir()
    Solid(ball()).save(tmp_path / "small" / f"a{ending}")
    # Of 3MF the text, as deflate sees the pieces.
    read = (lambda p: p.read_bytes()) if ending != ".3mf" else trimesh_bytes
    assert read(tmp_path / f"a{ending}") == read(tmp_path / "small" / f"a{ending}")


def trimesh_bytes(path: Path) -> bytes:
    mesh = trimesh.load(path, force="mesh", process=False)
    return np.asarray(mesh.vertices).tobytes() + np.asarray(mesh.faces).tobytes()


@pytest.mark.parametrize("ending", WRITERS)
def test_a_surface_without_triangles_is_written(ending: str, tmp_path: Path):
    WRITERS[ending](
        tmp_path / f"a{ending}", TriMesh(np.zeros((0, 3)), np.zeros((0, 3), int)), ABOUT
    )
    assert (tmp_path / f"a{ending}").stat().st_size > 80


def test_an_unknown_ending_is_refused_with_those_there_are(tmp_path: Path):
    with pytest.raises(
        InputError, match=r'"\.step" is not one of \.stl, \.3mf, \.obj, \.ply, \.vtp;'
    ):
        check_ending(tmp_path / "a.step")


def test_too_many_triangles_for_the_format_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(stl, "MAX_TRIANGLES", 319)
    monkeypatch.setattr(ply, "MAX_VERTICES", 161)
    with pytest.raises(OutputError, match=r"a\.stl: 320 triangles; STL holds at most 319"):
        Solid(ball()).save(tmp_path / "a.stl")
    with pytest.raises(OutputError, match=r"a\.ply: 162 vertices; PLY numbers at most 161"):
        Solid(ball()).save(tmp_path / "a.ply")
    assert not list(tmp_path.iterdir())
