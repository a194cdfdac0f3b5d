"""Solids cut in two by a plane; the planes that can be typed; `texmap split`."""

import zipfile

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt import cli
from texmap_opt.combine.halves import halves, middle_plane, plane_from_text
from texmap_opt.errors import InputError
from texmap_opt.export.solid_file import Solid
from texmap_opt.part_file import read_part_file
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.solid.validity import validity


def surface(mesh: trimesh.Trimesh) -> TriMesh:
    return TriMesh(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64))


TORUS = surface(trimesh.creation.torus(10, 3, major_sections=24, minor_sections=12))
component = st.floats(-1, 1)


@settings(max_examples=20, deadline=None)
@given(st.tuples(component, component, component), st.floats(-0.8, 0.8))
def test_both_pieces_are_closed_and_make_up_the_solid(direction, share):
    normal = np.array(direction) + np.array([1e-3, 0, 0])
    if np.linalg.norm(normal) < 1e-2:
        normal = np.array([1.0, 0, 0])
    normal /= np.linalg.norm(normal)
    offset = share * float((TORUS.vertices @ normal).max())
    behind, front = halves(TORUS, normal, offset)
    np.testing.assert_allclose(behind.volume + front.volume, TORUS.volume, rtol=1e-12)
    # Rounding of positions of 13 mm.
    assert (behind.vertices @ normal).max() <= offset + 1e-12
    assert (front.vertices @ normal).min() >= offset - 1e-12
    for piece in (behind, front):
        assert validity(piece).watertight


def test_halves_lie_across_the_longest_side():
    bar = surface(trimesh.creation.box((4, 30, 5)))
    normal, offset = middle_plane(TriMesh(bar.vertices + np.array([0, 7.0, 0]), bar.faces))
    np.testing.assert_array_equal(normal, [0, 1, 0])
    assert offset == 7.0


def test_the_offset_is_a_length_whatever_the_normals_length():
    normal, offset = plane_from_text("0,0,5,2.5")
    np.testing.assert_array_equal(normal, [0, 0, 1])
    assert offset == 2.5


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("1,2,3", "four finite numbers"),
        ("1,0,0,inf", "four finite numbers"),
        ("a,0,0,1", "must be numbers"),
        ("0,0,0,1", "no length"),
    ],
)
def test_text_that_is_no_plane_is_refused(text, reason):
    with pytest.raises(InputError, match=reason):
        plane_from_text(text)


def test_a_plane_beside_the_solid_is_refused_with_its_extent():
    with pytest.raises(InputError, match=r"reaches from -3 to 3 mm"):
        halves(TORUS, np.array([0.0, 0, 1]), 3.0)


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as end:
        cli.main([str(argument) for argument in arguments])
    return end.value.code


def test_the_command_writes_two_files_or_one_package(tmp_path, capsys):
    """A 3MF file is read back as both pieces."""
    part, both = tmp_path / "torus.stl", tmp_path / "both.3mf"
    Solid(TORUS).save(part)
    pieces = [tmp_path / "a.stl", tmp_path / "b.ply"]
    assert run("split", part, "-o", *pieces) == 0
    volumes = [read_part_file(piece).surface.volume for piece in pieces]
    np.testing.assert_allclose(volumes, TORUS.volume / 2, rtol=1e-5)
    assert run("split", part, "-o", both, "--plane", "0,0,1,1.5") == 0
    np.testing.assert_allclose(read_part_file(both).surface.volume, TORUS.volume, rtol=1e-5)
    with zipfile.ZipFile(both) as package:
        assert package.read("3D/3dmodel.model").count(b"<item ") == 2
    assert "both.3mf" in capsys.readouterr().out
    assert run("split", part, "-o", pieces[0]) == 2
    assert run("split", part, "-o", pieces[0], pieces[0]) == 2
    assert "two different files" in capsys.readouterr().err
