"""`texmap convert`: every format to every other, and what it says."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from texmap_opt import cli
from texmap_opt.errors import InputError, OutputError, StructureError
from texmap_opt.imports.imported import Imported
from texmap_opt.structure.structure import Extrusion, Origin, Structure
from texmap_opt.structure_file import (
    WRITE_ENDINGS,
    BeamDeck,
    Reading,
    read_structure_file,
    write_structure_file,
)

# 3MF holds nine digits, INP thirteen, the others all.
SAME = {".3mf": 1e-8, ".inp": 1e-12, ".xml": 0, ".npz": 0, ".vtp": 0}


def ladder(section: str = "round") -> Structure:
    """Four joints, out of true, of which the first strut does not name the first."""
    joints = np.array([[0.1, 0, 0], [7, 1 / 3, 0], [0, 9, 0.2], [8, 8, 1]])
    struts = np.array([[2, 1], [0, 1], [2, 3], [0, 2]])
    radii = np.repeat([[0.5], [0.4], [1 / 3], [0.5]], 2, axis=1)
    origin = Origin(np.arange(4), np.zeros(4, np.int64), ("octet",))
    return Structure(joints, struts, radii, np.zeros(4, bool), np.ones(4), section, origin)


def walls() -> Structure:
    s = ladder("wall")
    extrusion = Extrusion(np.array([0.0, 0, 1]), -2.0, 2.0, np.array([4.0, 3, 2, 1]))
    return replace(s, joints=s.joints * [1, 1, 0], extrusion=extrusion)


@pytest.mark.parametrize("ending", WRITE_ENDINGS)
@pytest.mark.parametrize("s", [ladder(), ladder("square"), walls()], ids=lambda s: s.section)
def test_what_is_read_is_what_was_written_or_writing_is_refused(
    ending: str, s: Structure, tmp_path: Path
):
    path, source = tmp_path / f"s{ending}", Imported(s, provenance={"cell": "octet"})
    if ending == ".3mf" and s.section != "round":
        with pytest.raises(OutputError, match="round struts only"):
            write_structure_file(path, source)
        return
    write_structure_file(path, source)
    reading = Reading(section=s.section)
    if ending == ".vtp" and s.section == "wall":
        with pytest.raises(StructureError, match="are walls"):
            read_structure_file(path, reading)
        return
    found = read_structure_file(path, reading)
    again = found.structure
    assert again.section == s.section
    tolerance = {"rtol": SAME[ending], "atol": SAME[ending]}
    np.testing.assert_allclose(again.joints[again.struts], s.joints[s.struts], **tolerance)
    np.testing.assert_allclose(again.radii, s.radii, **tolerance)
    assert len(again.joints) == 4
    if s.extrusion is not None and again.extrusion is not None:
        np.testing.assert_allclose(again.extrusion.depth, s.extrusion.depth, **tolerance)
    keeps = ending in (".xml", ".npz")
    assert found.provenance == ({"cell": "octet"} if keeps else {"file": path.name})
    assert (again.origin is not None) == keeps


@pytest.mark.parametrize("name", ["s.stl", "s.xml.gz", "s"])
def test_other_endings_are_refused_with_those_that_are_known(name: str, tmp_path: Path):
    with pytest.raises(
        InputError, match=r"is not one of \.xml, \.npz, \.inp, \.3mf, \.ltcx, \.vtp"
    ):
        read_structure_file(tmp_path / name)
    with pytest.raises(InputError, match=r"is not one of \.xml, \.npz, \.inp, \.3mf, \.vtp;"):
        write_structure_file(tmp_path / name, Imported(ladder()))


@pytest.mark.parametrize("unit", ["mm", "in"])
def test_the_unit_of_a_deck_is_told(unit: str, tmp_path: Path):
    write_structure_file(tmp_path / "s.inp", Imported(ladder()), BeamDeck(solver="calculix"))
    s = read_structure_file(tmp_path / "s.inp", Reading(unit=unit)).structure
    factor = {"mm": 1.0, "in": 25.4}[unit]
    np.testing.assert_allclose(s.joints, factor * ladder().joints, rtol=1e-12)
    np.testing.assert_allclose(s.radii, factor * ladder().radii, rtol=1e-12)


FAR = {
    ".inp": ("8, 8, 1\n", "8, 1e200, 1\n"),
    ".xml": ("8.0 8.0 1.0", "8.0 1e200 1.0"),
}


@pytest.mark.parametrize("ending", sorted(FAR))
def test_numbers_whose_squares_overflow_are_refused(ending: str, tmp_path: Path):
    write_structure_file(tmp_path / f"s{ending}", Imported(ladder()))
    old, new = FAR[ending]
    text = (tmp_path / f"s{ending}").read_text()
    assert old in text
    (tmp_path / f"s{ending}").write_text(text.replace(old, new))
    with pytest.raises(
        StructureError, match=r"joint 3 has a coordinate that is not .* within 1e.09"
    ):
        read_structure_file(tmp_path / f"s{ending}")


def convert(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main(["convert", *map(str, arguments)])
    return int(ended.value.code or 0)


def test_the_command_converts_and_says_what_was_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    write_structure_file(tmp_path / "s.xml", Imported(ladder()))
    deck = tmp_path / "s.inp"
    options = ("--solver", "calculix", "--segments", 2, "--material", "PA12")
    assert convert(tmp_path / "s.xml", "-o", deck, *options) == 0
    assert capsys.readouterr().out == (
        "note: s.inp: not kept, for want of a place: the cell and kind of each strut\n"
        f"{deck}: 4 joints, 4 round struts\n"
    )
    assert "*ELASTIC" in deck.read_text()
    lattice, again = tmp_path / "s.3mf", tmp_path / "t.npz"
    assert convert(deck, "-o", lattice, "--unit", "cm") == 0
    assert capsys.readouterr().out == f"{lattice}: 8 joints, 8 round struts\n"
    assert convert(lattice, "-o", again) == 0
    assert capsys.readouterr().out == f"{again}: 8 joints, 8 round struts\n"
    lengths = read_structure_file(again).structure.lengths()
    assert lengths.sum() == pytest.approx(10 * ladder().lengths().sum())


def test_a_unit_that_is_not_known_is_refused():
    with pytest.raises(InputError, match=r'unit = "km"; did you mean "m"|unit = "km"; known: cm'):
        Reading(unit="km")


def whole(s: Structure) -> Imported:
    """With all that only our own files keep."""
    s = replace(s, cut=np.arange(4) == 2, cell_size=np.full(4, 2.0))
    return Imported(s, provenance={"cell": "octet", "file": "a.xml"})


LOST = [
    "the cell and kind of each",
    "the size of cells",
    "which joints were cut",
    "how the structure",
]


@pytest.mark.parametrize("ending", WRITE_ENDINGS)
def test_what_a_format_cannot_keep_is_said(ending: str, tmp_path: Path):
    """And what reading gives back shows that it was lost, or that nothing was."""
    source = whole(ladder())
    notes = write_structure_file(tmp_path / f"s{ending}", source)
    again = read_structure_file(tmp_path / f"s{ending}")
    same = (
        again.structure.origin is not None
        and (again.structure.cut == source.structure.cut).all()
        and (again.structure.cell_size == source.structure.cell_size).all()
        and again.provenance == source.provenance
    )
    assert same == (not notes)
    if notes:
        assert len(notes) == len(LOST)
        for note, words in zip(notes, LOST, strict=True):
            assert words in note


def test_what_was_never_there_is_not_said_to_be_lost(tmp_path: Path):
    plain = Imported(replace(ladder(), origin=None), provenance={"file": "a.3mf"})
    for ending in WRITE_ENDINGS:
        assert write_structure_file(tmp_path / f"s{ending}", plain) == ()


def test_sections_tapers_and_heights_that_are_lost_are_said(tmp_path: Path):
    square, high = replace(ladder("square"), origin=None), replace(walls(), origin=None)
    (note,) = write_structure_file(tmp_path / "s.vtp", Imported(square))
    assert "read it with --section square" in note
    (note,) = write_structure_file(tmp_path / "s.vtp", Imported(high))
    assert "the direction and heights of the walls were not kept" in note
    # The deepest wall is as high as the extrusion, so that reading finds the heights again.
    assert write_structure_file(tmp_path / "s.inp", Imported(high)) == ()
    assert high.extrusion is not None
    high = replace(high, extrusion=replace(high.extrusion, high=3.0))
    (note,) = write_structure_file(tmp_path / "s.inp", Imported(high))
    assert "the heights of the extrusion, -2 to 3 mm" in note
    tapered = square.with_radii(square.radii * [1, 3])
    (note,) = write_structure_file(tmp_path / "s.inp", Imported(tapered))
    # A strut from 0.5 to 1.5 has 1 in the middle.
    assert note == (
        "4 struts taper, an element has one radius, that of its middle: radii changed by up to 0.5 mm"
    )


MISTAKES = {
    "ending": (["s.xml", "-o", "s.stl"], 'the ending ".stl" is not one of'),
    "material": (["s.xml", "-o", "s.inp", "--material", "PA13"], 'did you mean "PA12"'),
    "segments": (["s.xml", "-o", "s.inp", "--segments", "0"], "at least 1 element"),
    "radius": (["s.vtk", "-o", "s.inp", "--radius", "-1"], "--radius -1: must be above 0"),
    "unit of our own": (
        ["s.xml", "-o", "t.npz", "--unit", "m"],
        "--unit: is for reading .inp, .vtp",
    ),
    "radius of a deck": (
        ["d.inp", "-o", "t.npz", "--radius", "3"],
        "--radius: is for reading .ltcx",
    ),
    "section of a deck": (["d.inp", "-o", "t.npz", "--section", "round"], "d.inp tells its own"),
    "radius for radii": (
        ["d.vtp", "-o", "t.npz", "--radius", "3"],
        "has radii in radius_mm; leave",
    ),
    "solver": (["s.xml", "-o", "t.3mf", "--solver", "abaqus"], "--solver: is for writing .inp"),
    "segments of npz": (["s.xml", "-o", "t.npz", "--segments", "1"], "--segments: is for writing"),
    "material of vtp": (
        ["s.xml", "-o", "t.vtp", "--material", "PA12"],
        "--material: is for writing",
    ),
    "tiling": (["s.xml", "-o", "t.xml", "--tiling", "mirror"], "--tiling: is of a unit cell"),
    "tiling misspelt": (
        ["s.xml", "-o", "t.xml", "--cell", "t", "--tiling", "mirror glide mirror"],
        'tiling is "glide"',
    ),
    "cell as npz": (["s.xml", "-o", "t.npz", "--cell", "t"], "a unit cell is written as XML"),
    "segments of a cell": (
        ["s.xml", "-o", "t.xml", "--cell", "t", "--segments", "2"],
        "leave it out",
    ),
    "broken": (["b.xml", "-o", "s.npz"], "b.xml, line 3: is not XML"),
    "missing": (["c.xml", "-o", "s.npz"], "cannot be read"),
}


@pytest.mark.parametrize("mistake", sorted(MISTAKES))
def test_a_mistake_is_one_sentence_with_code_2_and_no_file(
    mistake: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.chdir(tmp_path)
    write_structure_file(tmp_path / "s.xml", Imported(ladder()))
    write_structure_file(tmp_path / "d.inp", Imported(ladder()))
    write_structure_file(tmp_path / "d.vtp", Imported(ladder()))
    text = (tmp_path / "s.xml").read_text()
    (tmp_path / "b.xml").write_text("\n".join(text.splitlines()[:2]) + "\n")
    before = sorted(tmp_path.iterdir())
    arguments, words = MISTAKES[mistake]
    assert convert(*arguments) == 2
    said = capsys.readouterr()
    assert words in said.err
    assert said.err.startswith("texmap: ")
    assert said.out == ""
    assert sorted(tmp_path.iterdir()) == before
