"""Files appear whole or not at all, whenever the disk is full and whoever writes."""

import errno
import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import trimesh

from texmap_opt.errors import OutputError
from texmap_opt.export.beam_lattice import write_beam_lattice
from texmap_opt.export.solid_file import WRITERS, Solid
from texmap_opt.export.vtk import write_struts
from texmap_opt.export.whole_file import whole_file
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.structure_npz import write_structure_npz
from texmap_opt.structure.structure_xml import write_structure


@contextmanager
def full_after(size: int) -> Iterator[None]:
    """No file can grow beyond so many bytes: the system refuses the write, as on a full disk."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def ball() -> TriMesh:
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=7.3)
    return TriMesh(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64))


def chain(count: int = 4000) -> Structure:
    joints = np.random.default_rng(3).normal(size=(count + 1, 3)) * 20
    struts = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
    return Structure(
        joints, struts, np.full((count, 2), 0.3), np.zeros(count + 1, bool), np.ones(count)
    )


WRITTEN: dict[str, Callable[[Path], object]] = {
    **{f"solid{ending}": lambda path: Solid(ball()).save(path) for ending in WRITERS},
    "lattice.3mf": lambda path: write_beam_lattice(path, chain(), clipping=ball(), skin=ball()),
    "structure.xml": lambda path: write_structure(chain(), path, provenance={}),
    "structure.npz": lambda path: write_structure_npz(path, chain(), provenance={}),
    "struts.vtp": lambda path: write_struts(path, chain(), strut_data={}),
}


@pytest.mark.parametrize("name", WRITTEN)
def test_a_disk_that_fills_up_leaves_the_old_file_and_nothing_else(name: str, tmp_path: Path):
    """At any moment: in the first bytes, in the middle, and in the last ones, written on closing."""
    path, write = tmp_path / name, WRITTEN[name]
    write(path)
    whole = path.read_bytes()
    for room in (0, 70, len(whole) // 2, len(whole) - 1):
        with (
            full_after(room),
            pytest.raises(OutputError, match=rf"{name} cannot be written: .*free some space"),
        ):
            write(path)
        assert [p.name for p in tmp_path.iterdir()] == [name]
        assert path.read_bytes() == whole
    # The negative control: with room for its last byte it is written.
    path.unlink()
    with full_after(len(whole)):
        write(path)
    assert path.read_bytes() == whole


def test_a_failing_writer_leaves_the_old_file_and_nothing_else(tmp_path: Path):
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


def test_a_full_disk_is_one_sentence_with_the_file(tmp_path: Path):
    with (
        pytest.raises(OutputError, match=r"part\.stl cannot be written: No space.*free some space"),
        whole_file(tmp_path / "part.stl"),
    ):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert not list(tmp_path.iterdir())


def test_a_missing_folder_is_one_sentence():
    with pytest.raises(OutputError, match="cannot be written"), whole_file(Path("/nowhere/a.stl")):
        pass


def test_a_name_that_is_a_folder_is_one_sentence(tmp_path: Path):
    (tmp_path / "a.stl").mkdir()
    with pytest.raises(OutputError, match=r"a\.stl cannot be written: Is a directory"):
        Solid(ball()).save(tmp_path / "a.stl")
    assert [p.name for p in tmp_path.iterdir()] == ["a.stl"]
