"""Files say what was written, and appear whole or not at all."""

import errno
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import pyvista
import trimesh

from texmap_opt.errors import OutputError
from texmap_opt.export.beam_lattice import BALLS, BEAMS, write_beam_lattice
from texmap_opt.export.stl import write_stl
from texmap_opt.export.three_mf import write_three_mf
from texmap_opt.export.vtk import write_grid, write_stress, write_struts
from texmap_opt.export.whole_file import whole_file
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.structure import Structure


@pytest.fixture
def ball() -> TriMesh:
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=7.3)
    vertices = np.asarray(mesh.vertices, dtype=np.float32).astype(np.float64)
    return TriMesh(vertices, np.asarray(mesh.faces, dtype=np.int64))


@pytest.fixture
def bow() -> Structure:
    """Two struts that share a joint, and a joint no strut uses."""
    return Structure(
        joints=np.array([[0.0, 0, 0], [9, 9, 9], [4, 0, 0], [4, 3, 0]]),
        struts=np.array([[0, 2], [3, 2]]),
        radii=np.array([[0.5, 0.25], [0.3, 0.4]]),
        cut=np.zeros(4, dtype=bool),
        cell_size=np.ones(2),
    )


def test_stl_holds_every_triangle_in_order(tmp_path, ball):
    write_stl(tmp_path / "a.stl", ball)
    back = trimesh.load(tmp_path / "a.stl", process=False)
    np.testing.assert_array_equal(back.triangles, ball.vertices[ball.faces])
    assert (tmp_path / "a.stl").stat().st_size == 84 + 50 * len(ball.faces)
    np.testing.assert_allclose(back.face_normals, ball.face_normals, atol=1e-6)  # float32 normals


def test_3mf_reads_back_with_its_unit_and_float32_vertices_exact(tmp_path, ball):
    write_three_mf(tmp_path / "a.3mf", ball)
    back = trimesh.load(tmp_path / "a.3mf", force="mesh", process=False)
    np.testing.assert_array_equal(np.asarray(back.vertices, np.float32), ball.vertices)
    np.testing.assert_array_equal(back.faces, ball.faces)
    assert back.units in ("mm", "millimeter", "millimeters")


def test_equal_surfaces_give_equal_3mf_bytes(tmp_path, ball):
    write_three_mf(tmp_path / "a.3mf", ball)
    write_three_mf(tmp_path / "b.3mf", ball)
    assert (tmp_path / "a.3mf").read_bytes() == (tmp_path / "b.3mf").read_bytes()


def test_beam_lattice_has_every_strut_with_both_radii_and_a_ball_at_every_used_joint(tmp_path, bow):
    """3MF Beam Lattice Extension 1.2.0, sections 2.1.1 and 2.1.2."""
    write_beam_lattice(tmp_path / "l.3mf", bow)
    with zipfile.ZipFile(tmp_path / "l.3mf") as package:
        root = ElementTree.fromstring(package.read("3D/3dmodel.model"))
    assert root.get("unit") == "millimeter"
    assert root.get("requiredextensions") == "b b2"
    core = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
    vertices = [[float(v.get(c)) for c in "xyz"] for v in root.iter(f"{core}vertex")]
    np.testing.assert_array_equal(vertices, bow.joints[[0, 2, 3]])
    beams = list(root.iter(f"{{{BEAMS}}}beam"))
    assert [(int(b.get("v1")), int(b.get("v2"))) for b in beams] == [(0, 1), (2, 1)]
    np.testing.assert_array_equal(
        [[float(b.get("r1")), float(b.get("r2"))] for b in beams], bow.radii
    )
    balls = [float(b.get("r")) for b in root.iter(f"{{{BALLS}}}ball")]
    np.testing.assert_array_equal(balls, [0.5, 0.4, 0.3])
    (lattice,) = root.iter(f"{{{BEAMS}}}beamlattice")
    assert lattice.get(f"{{{BALLS}}}ballmode") == "all"
    assert float(lattice.get("minlength")) > 0


def test_beam_lattice_refuses_square_struts(tmp_path, bow):
    square = Structure(bow.joints, bow.struts, bow.radii, bow.cut, bow.cell_size, "square")
    with pytest.raises(OutputError, match="round struts only"):
        write_beam_lattice(tmp_path / "l.3mf", square)
    assert not list(tmp_path.iterdir())


def test_beam_lattice_refuses_walls(tmp_path, bow):
    walls = Structure(bow.joints, bow.struts, bow.radii, bow.cut, bow.cell_size, "wall")
    with pytest.raises(OutputError, match=r"these are walls; write their solid instead"):
        write_beam_lattice(tmp_path / "l.3mf", walls)
    assert not list(tmp_path.iterdir())


def test_a_failing_writer_leaves_the_old_file_and_nothing_else(tmp_path):
    target = tmp_path / "report.json"
    target.write_bytes(b"old")

    def interrupted() -> None:
        with whole_file(target) as file:
            file.write(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [p.name for p in tmp_path.iterdir()] == ["report.json"]
    assert target.read_bytes() == b"old"
    with whole_file(target) as file:
        file.write(b"new")
    assert target.read_bytes() == b"new"


def test_a_full_disk_is_one_sentence_with_the_file(tmp_path):
    with (
        pytest.raises(OutputError, match=r"part\.stl cannot be written: No space.*free some space"),
        whole_file(tmp_path / "part.stl"),
    ):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert not list(tmp_path.iterdir())


def test_a_missing_folder_is_one_sentence():
    with pytest.raises(OutputError, match="cannot be written"), whole_file(Path("/nowhere/a.stl")):
        pass


def test_vtk_reads_back_what_was_written(tmp_path, bow):
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    tets = np.array([[0, 1, 2, 3]])
    stress = np.arange(48.0).reshape(2, 4, 6)
    write_stress(
        tmp_path / "s.vtu",
        mesh=(nodes, tets),
        case_names=["lift", "brake & turn"],
        displacement=np.arange(24.0).reshape(2, 4, 3),
        stress=stress,
        von_mises=np.arange(8.0).reshape(2, 4),
    )
    mesh = pyvista.read(tmp_path / "s.vtu")
    assert mesh.n_cells == 1
    assert mesh.volume == pytest.approx(1 / 6)
    np.testing.assert_array_equal(mesh["von_mises_MPa brake & turn"], [4, 5, 6, 7])
    np.testing.assert_array_equal(mesh["stress_MPa lift"][:, 3], stress[0][:, 5])  # xy
    grid = np.stack(np.meshgrid([0.0, 1, 3], [0.0, 2], [0.0, 1], indexing="ij"), axis=-1)
    write_grid(tmp_path / "g.vtu", nodes=grid, cell_data={"size": np.array([[[1.0]], [[2.0]]])})
    mesh = pyvista.read(tmp_path / "g.vtu")
    np.testing.assert_allclose(mesh.compute_cell_sizes()["Volume"], [2, 4])
    np.testing.assert_array_equal(mesh["size"], [1, 2])
    write_struts(tmp_path / "s.vtp", bow, strut_data={"utilisation": np.array([0.1, 0.9])})
    lines = pyvista.read(tmp_path / "s.vtp")
    np.testing.assert_allclose(lines.compute_cell_sizes()["Length"], [4, 3])
    np.testing.assert_array_equal(lines["radius_mm"], bow.radii.ravel())
    np.testing.assert_array_equal(lines["utilisation"], [0.1, 0.9])
