"""3MF beam lattices as the 3MF Consortium's library reads them."""

import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from read_by_lib3mf import MILLIMETRE, read_package

from texmap_opt.errors import OutputError
from texmap_opt.export.beam_lattice import BEAMS, write_beam_lattice
from texmap_opt.export.metadata import Metadata
from texmap_opt.imports.beam_lattice import read_beam_lattice
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.structure import Structure

CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"


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


def scattered(count: int = 500) -> Structure:
    rng = np.random.default_rng(5)
    pairs = np.stack(np.triu_indices(200, 1), axis=1)
    struts = rng.permutation(rng.choice(pairs, count, replace=False), axis=1)
    return Structure(
        rng.normal(size=(200, 3)) * 30,
        struts,
        rng.uniform(0.1, 2, (count, 2)),
        np.zeros(200, bool),
        np.ones(count),
    )


def ball(radius: float) -> TriMesh:
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=radius)
    return TriMesh(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64))


def shell(radius: float) -> TriMesh:
    """A ball with a cavity of nine tenths of its radius."""
    outer, inner = ball(radius), ball(0.9 * radius)
    return TriMesh(
        np.concatenate([outer.vertices, inner.vertices]),
        np.concatenate([outer.faces, inner.faces[:, ::-1] + len(outer.vertices)]),
    )


def frusta(joints: np.ndarray, struts: np.ndarray, radii: np.ndarray) -> float:
    """Volume of all conical frusta [mm³]: pi L (r1^2 + r1 r2 + r2^2) / 3 each."""
    first, last = joints[struts].swapaxes(0, 1)
    a, b = radii.T
    return float(np.pi / 3 * (np.linalg.norm(last - first, axis=1) * (a * a + a * b + b * b)).sum())


def test_every_strut_has_both_radii_and_round_ends(tmp_path: Path, bow: Structure):
    """3MF Beam Lattice Extension 1.2.0, section 2.1.1: caps are spheres of the radii at both ends."""
    write_beam_lattice(tmp_path / "l.3mf", bow)
    with zipfile.ZipFile(tmp_path / "l.3mf") as package:
        root = ElementTree.fromstring(package.read("3D/3dmodel.model"))
    assert root.get("unit") == "millimeter"
    assert root.get("requiredextensions") == "b"
    vertices = [[float(v.get(c)) for c in "xyz"] for v in root.iter(f"{CORE}vertex")]
    np.testing.assert_array_equal(vertices, bow.joints[[0, 2, 3]])
    beams = list(root.iter(f"{{{BEAMS}}}beam"))
    assert [(int(b.get("v1")), int(b.get("v2"))) for b in beams] == [(0, 1), (2, 1)]
    np.testing.assert_array_equal(
        [[float(b.get("r1")), float(b.get("r2"))] for b in beams], bow.radii
    )
    (lattice,) = root.iter(f"{{{BEAMS}}}beamlattice")
    assert lattice.get("cap") == "sphere"
    assert lattice.get("clippingmode") is None
    assert float(lattice.get("minlength")) > 0


def test_lib3mf_reads_struts_and_their_volume_without_warnings(tmp_path: Path):
    structure = scattered()
    assert write_beam_lattice(tmp_path / "l.3mf", structure) == ()
    package = read_package(tmp_path / "l.3mf")
    assert package.warnings == ()
    assert package.unit == MILLIMETRE
    assert package.built == ("lattice",)
    assert package.metadata["Title"] == "l"
    found = package.objects["lattice"]
    assert len(found.beams) == len(structure.struts)
    assert found.caps == {"Sphere"}
    assert found.clipping == ("NoClipMode", None)
    assert found.preview is None
    # lib3mf holds numbers in float32, which rounds them by up to 6e-8 of their size.
    volume = frusta(structure.joints, structure.struts, structure.radii)
    assert frusta(found.mesh.vertices, found.beams, found.radii) == pytest.approx(volume, rel=1e-6)
    np.testing.assert_allclose(found.radii, structure.radii, rtol=1e-7)


def test_skin_clipping_and_preview_are_objects_of_their_own(tmp_path: Path):
    structure, skin = scattered(), shell(20.0)
    write_beam_lattice(
        tmp_path / "l.3mf",
        structure,
        clipping=ball(20.0),
        skin=skin,
        preview=ball(19.0),
        metadata=Metadata("ball", "of struts"),
    )
    package = read_package(tmp_path / "l.3mf")
    assert package.warnings == ()
    assert package.built == ("skin", "lattice")
    assert package.metadata["Description"] == "of struts"
    found = package.objects["lattice"]
    assert found.clipping == ("Inside", "clipping")
    assert found.preview == "preview"
    assert len(found.beams) == len(structure.struts)
    assert not len(found.mesh.faces)
    for name, wanted in (("clipping", ball(20.0)), ("skin", skin), ("preview", ball(19.0))):
        mesh = package.objects[name]
        assert mesh.manifold
        assert mesh.mesh.volume == pytest.approx(wanted.volume, rel=1e-6)
        np.testing.assert_array_equal(mesh.mesh.faces, wanted.faces)
    # And our own reader finds the struts in the assembly.
    own = read_beam_lattice(tmp_path / "l.3mf")
    assert len(own.structure.struts) == len(structure.struts)
    assert own.notes == (
        "object 3 has no beams and was left out",
        "object 4: beams were not clipped inside its clipping mesh",
    )


def test_without_a_skin_the_clipped_struts_are_all_that_is_built(tmp_path: Path, bow: Structure):
    write_beam_lattice(tmp_path / "l.3mf", bow, clipping=ball(5.0))
    package = read_package(tmp_path / "l.3mf")
    assert package.warnings == ()
    assert package.built == ("lattice",)
    assert package.objects["lattice"].clipping == ("Inside", "clipping")


def test_struts_without_length_in_single_precision_are_left_out_and_told(tmp_path: Path):
    """lib3mf warns of them: float32 numbers near 100 are 7.6e-6 apart."""
    joints = np.array([[0.0, 0, 0], [100, 0, 0], [100.000002, 0, 0], [100, 5, 0]])
    struts = np.array([[0, 1], [1, 2], [2, 3]])
    structure = Structure(joints, struts, np.full((3, 2), 0.3), np.zeros(4, bool), np.ones(3))
    notes = write_beam_lattice(tmp_path / "l.3mf", structure)
    assert notes == ("1 struts shorter than 1e-06 mm were left out",)
    package = read_package(tmp_path / "l.3mf")
    assert package.warnings == ()
    assert len(package.objects["lattice"].beams) == 2
    with pytest.raises(OutputError, match=r"l\.3mf: no strut is longer than 1e-06 mm"):
        write_beam_lattice(
            tmp_path / "l.3mf",
            Structure(joints, struts[1:2], np.full((1, 2), 0.3), np.zeros(4, bool), np.ones(1)),
        )


@pytest.mark.parametrize(
    ("section", "words"),
    [("square", 'round struts only, these are "square"'), ("wall", "these are walls; write their")],
)
def test_what_is_not_round_is_refused(section: str, words: str, tmp_path: Path, bow: Structure):
    other = Structure(bow.joints, bow.struts, bow.radii, bow.cut, bow.cell_size, section)
    with pytest.raises(OutputError, match=words):
        write_beam_lattice(tmp_path / "l.3mf", other)
    assert not list(tmp_path.iterdir())
