"""structure.npz: bits survive, equal structures give equal files, nothing else passes for one."""

import io
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt.errors import StructureError
from texmap_opt.structure.structure import Extrusion, Origin, Structure
from texmap_opt.structure.structure_npz import read_structure_npz, write_structure_npz

PROVENANCE = {"cell": "octet", "note": "ä\r\n\x07\ud800"}


def tripod() -> Structure:
    """Three struts to one joint, with all the digits a float can have, from two kinds of cells."""
    rng = np.random.default_rng(1)
    return Structure(
        joints=rng.normal(size=(4, 3)),
        struts=np.array([[3, 0], [3, 1], [3, 2]]),
        radii=rng.uniform(0.1, 0.2, (3, 2)),
        cut=np.array([True, False, True, False]),
        cell_size=rng.uniform(0.9, 1.1, 3),
        section="square",
        origin=Origin(np.array([5, 0, 5]), np.array([1, 0, 0]), ("ä", "transition")),
    )


def walls() -> Structure:
    """The same on the ground, as walls."""
    s = tripod()
    extrusion = Extrusion(np.array([0.0, 0, 1]), -1.5, 1.5, np.array([3.0, 1 / 3, 2]))
    joints = s.joints * [1, 1, 0]
    return replace(s, joints=joints, section="wall", origin=None, extrusion=extrusion)


@pytest.mark.parametrize("s", [tripod(), walls()], ids=["struts", "walls"])
def test_what_is_read_is_bit_for_bit_what_was_written(s: Structure, tmp_path: Path):
    write_structure_npz(tmp_path / "s.npz", s, provenance=PROVENANCE)
    again, provenance = read_structure_npz(tmp_path / "s.npz")
    assert provenance == PROVENANCE
    assert again.section == s.section
    for name in ("joints", "struts", "radii", "cut", "cell_size"):
        a, b = getattr(again, name), getattr(s, name)
        np.testing.assert_array_equal(a, b)
        assert a.dtype == b.dtype
        assert a.flags.writeable
    if s.origin is not None and again.origin is not None:
        np.testing.assert_array_equal(again.origin.cell, s.origin.cell)
        np.testing.assert_array_equal(again.origin.kind, s.origin.kind)
        assert again.origin.kinds == s.origin.kinds
    if s.extrusion is not None and again.extrusion is not None:
        np.testing.assert_array_equal(again.extrusion.axis, s.extrusion.axis)
        np.testing.assert_array_equal(again.extrusion.depth, s.extrusion.depth)
        assert (again.extrusion.low, again.extrusion.high) == (-1.5, 1.5)
    assert (again.origin is None, again.extrusion is None) == (
        s.origin is None,
        s.extrusion is None,
    )


def test_equal_structures_give_equal_bytes_that_numpy_reads(tmp_path: Path):
    for name in ("a.npz", "b.npz"):
        write_structure_npz(tmp_path / name, tripod(), provenance=PROVENANCE)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with np.load(tmp_path / "a.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["joints"], tripod().joints)


def arrays_of(s: Structure, folder: Path) -> dict[str, np.ndarray]:
    write_structure_npz(folder / "whole.npz", s, provenance=PROVENANCE)
    with np.load(folder / "whole.npz") as arrays:
        return dict(arrays)


NOTHING = np.zeros(0)
MISTAKES = {
    "missing": (tripod, {"radii": None}, "lacks radii"),
    "half an origin": (tripod, {"cell": None}, "lacks cell"),
    "unknown": (tripod, {"colour": NOTHING}, "arrays beyond a structure's"),
    "version": (tripod, {"version": np.array([2])}, r"version \[2\], known is 1"),
    "type": (tripod, {"joints": np.zeros((4, 3), np.float32)}, "float32 .*must be float64, n x 3"),
    "shape": (tripod, {"joints": np.zeros((4, 2))}, "must be float64, n x 3"),
    "no axis": (tripod, {"cut": np.array(True)}, "must be bool, n"),
    "rows": (tripod, {"radii": np.ones((2, 2))}, '"radii" has 2 rows and needs 3'),
    "objects": (tripod, {"cell_size": np.array([None])}, "array of objects"),
    "columns": (tripod, {"joints": np.asfortranarray(np.ones((4, 3)))}, "Fortran order"),
    "not JSON": (tripod, {"provenance": np.zeros(3, np.uint8)}, "is not a structure"),
    "a list": (tripod, {"provenance": np.frombuffer(b"[1]", np.uint8)}, "not a table of texts"),
    "invariant": (tripod, {"cell_size": np.array([1, 1, -1.0])}, "strut 2 has a cell size"),
    "origin": (tripod, {"kind": np.array([0, 0, 2])}, "strut 2 is of a kind that does not exist"),
    "origin's length": (tripod, {"kind": np.array([0, 0])}, '"kind" has 2 rows and needs 3'),
    "depth": (walls, {"depth": np.array([1.0, 1, 4])}, "wall 2 has a depth"),
    "heights": (walls, {"heights": np.ones(3)}, '"heights" has 3 rows and needs 2'),
}


@pytest.mark.parametrize("mistake", sorted(MISTAKES))
def test_a_mistake_is_named_with_the_file(mistake: str, tmp_path: Path):
    of, change, words = MISTAKES[mistake]
    arrays = {k: v for k, v in (arrays_of(of(), tmp_path) | change).items() if v is not None}
    np.savez(tmp_path / "s.npz", **arrays)
    with pytest.raises(StructureError, match=rf"s\.npz: .*{words}"):
        read_structure_npz(tmp_path / "s.npz")


def test_what_numpy_writes_itself_is_read(tmp_path: Path):
    """Control of the test above: the same road without a mistake."""
    np.savez(tmp_path / "s.npz", **arrays_of(tripod(), tmp_path))
    np.testing.assert_array_equal(read_structure_npz(tmp_path / "s.npz")[0].radii, tripod().radii)


def test_compressed_arrays_are_refused_because_they_could_grow(tmp_path: Path):
    np.savez_compressed(tmp_path / "s.npz", **arrays_of(tripod(), tmp_path))
    with pytest.raises(StructureError, match="is compressed; write it without"):
        read_structure_npz(tmp_path / "s.npz")


def test_an_array_that_announces_more_than_it_holds_takes_no_memory(tmp_path: Path):
    """A shape of eight terabytes in the header of an empty array."""
    header = io.BytesIO()
    shape = {"descr": "<f8", "fortran_order": False, "shape": (10**12, 1)}
    np.lib.format.write_array_header_1_0(header, shape)
    arrays_of(tripod(), tmp_path)
    with (
        zipfile.ZipFile(tmp_path / "whole.npz") as whole,
        zipfile.ZipFile(tmp_path / "s.npz", "w") as package,
    ):
        for name in whole.namelist():
            content = header.getvalue() if name == "joints.npy" else whole.read(name)
            package.writestr(name, content)
    with pytest.raises(StructureError, match="is not a structure in NumPy's format"):
        read_structure_npz(tmp_path / "s.npz")


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(StructureError, match=r"no\.npz: structure file cannot be read"):
        read_structure_npz(tmp_path / "no.npz")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes]:
    path = tmp_path_factory.mktemp("npz") / "s.npz"
    write_structure_npz(path, walls(), provenance=PROVENANCE)
    return path.with_name("broken.npz"), path.read_bytes()


@settings(max_examples=60)
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_file_that_breaks_off_is_refused(whole: tuple[Path, bytes], share: float):
    path, content = whole
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(StructureError):
        read_structure_npz(path)


@settings(max_examples=150)
@given(place=st.integers(0, 10**6), byte=st.integers(0, 255))
def test_a_wrong_byte_is_read_or_refused_and_never_a_crash(
    whole: tuple[Path, bytes], place: int, byte: int
):
    path, content = whole
    broken = bytearray(content)
    broken[place % len(content)] = byte
    path.write_bytes(bytes(broken))
    found = outcome(path)
    if isinstance(found, StructureError):
        assert "broken.npz" in str(found)
    else:
        # What checksums do not cover tells nothing about the structure.
        np.testing.assert_array_equal(found.joints, walls().joints)


def outcome(path: Path) -> Structure | StructureError:
    try:
        return read_structure_npz(path)[0]
    except StructureError as failure:
        return failure
