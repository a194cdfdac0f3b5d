"""Beam decks: what is read back is what was written; decks of other programs; their mistakes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fea import Material
from texmap_opt.errors import InputError, StructureError
from texmap_opt.export.beam_deck import write_beam_deck
from texmap_opt.imports.beam_deck import read_beam_deck
from texmap_opt.imports.imported import Imported
from texmap_opt.structure.structure import Extrusion, Structure

# CalculiX reads thirteen digits.
SAME = 1e-12


def star(section: str = "round") -> Structure:
    """Struts from one joint in many directions, three of them along the axes; two sizes."""
    rng = np.random.default_rng(2)
    tips = np.concatenate([10 * np.eye(3), rng.normal(size=(9, 3)) * 10])
    radius = np.where(np.arange(12) % 3 == 0, 0.4, 1 / 3)
    return Structure(
        joints=np.concatenate([np.zeros((1, 3)), tips]),
        struts=np.stack([np.zeros(12, np.int64), np.arange(1, 13)], axis=1),
        radii=np.repeat(radius[:, None], 2, axis=1),
        cut=np.zeros(13, bool),
        cell_size=np.ones(12),
        section=section,
    )


def walls() -> Structure:
    """A star in the plane y = 3, three of its walls along the axes of the plane."""
    s = star("wall")
    joints = s.joints * [1, 0, 1]
    joints[2] = [-7, 0, 0]
    depth = np.linspace(4, 8, 12)
    extrusion = Extrusion(np.array([0.0, 1, 0]), -1.0, 7.0, depth)
    return replace(s, joints=joints + np.array([0.0, 3, 0]), extrusion=extrusion)


def read(path: Path, text: str | None = None, *, mm_per_unit: float = 1.0) -> Imported:
    if text is not None:
        path.write_text(text)
    return read_beam_deck(path, mm_per_unit=mm_per_unit)


@pytest.mark.parametrize("solver", ["abaqus", "calculix"])
@pytest.mark.parametrize("s", [star(), star("square"), walls()], ids=lambda s: s.section)
def test_what_is_read_is_what_was_written(solver: str, s: Structure, tmp_path: Path):
    write_beam_deck(tmp_path / "s.inp", s, solver=solver)
    again = read(tmp_path / "s.inp").structure
    assert again.section == s.section
    np.testing.assert_array_equal(again.struts, s.struts)
    np.testing.assert_allclose(again.joints, s.joints, rtol=SAME)
    np.testing.assert_allclose(again.radii, s.radii, rtol=SAME)
    if s.extrusion is not None and again.extrusion is not None:
        np.testing.assert_allclose(again.extrusion.depth, s.extrusion.depth, rtol=SAME)
        np.testing.assert_allclose(again.extrusion.axis, s.extrusion.axis, rtol=SAME)
        assert (again.extrusion.low, again.extrusion.high) == pytest.approx((-1, 7))


@pytest.mark.parametrize("solver", ["abaqus", "calculix"])
def test_segments_divide_struts_and_follow_their_taper(solver: str, tmp_path: Path):
    """Four elements of a strut from 0.2 to 1 have the radii at their middles."""
    s = star()
    s = s.with_radii(np.repeat([[0.2, 1.0]], 12, axis=0))
    # An element of a quarter of the taper is 0.1 off at its ends.
    (note,) = write_beam_deck(tmp_path / "s.inp", s, solver=solver, segments=4)
    assert note.startswith("12 struts taper")
    assert note.endswith("changed by up to 0.1 mm")
    again = read(tmp_path / "s.inp").structure
    assert len(again.struts) == 48
    assert again.lengths().sum() == pytest.approx(s.lengths().sum())
    np.testing.assert_allclose(again.radii[:4, 0], [0.3, 0.5, 0.7, 0.9], rtol=SAME)
    assert "Some struts taper" in (tmp_path / "s.inp").read_text()


def test_sections_agree_in_four_digits_and_are_as_few_as_that_allows(tmp_path: Path):
    """A thousand radii between 1 and 1.002: 21 sections or, with three axes, at most 63."""
    rng = np.random.default_rng(5)
    count = 1000
    joints = np.concatenate([np.zeros((1, 3)), rng.normal(size=(count, 3)) * 9])
    radii = np.repeat(rng.uniform(1, 1.002, (count, 1)), 2, axis=1)
    struts = np.stack([np.zeros(count, np.int64), np.arange(1, count + 1)], axis=1)
    s = Structure(joints, struts, radii, np.zeros(count + 1, bool), np.ones(count))
    (note,) = write_beam_deck(tmp_path / "s.inp", s)
    assert (tmp_path / "s.inp").read_text().count("*BEAM SECTION") <= 63
    again = read(tmp_path / "s.inp").structure
    assert note.endswith(f"changed by up to {np.abs(again.radii - radii).max():.3g} mm")
    # Half a unit of the fourth digit to its rounded value, and that much again to the mean.
    np.testing.assert_allclose(again.radii, radii, atol=1e-3)
    assert np.abs(again.radii - radii).max() > 1e-5  # control: sections are shared


def test_the_first_axis_of_a_section_is_never_along_a_beam(tmp_path: Path):
    """Abaqus stops at a beam along its own first axis; here none is nearer than 54 degrees."""
    write_beam_deck(tmp_path / "s.inp", star())
    lines = (tmp_path / "s.inp").read_text().splitlines()
    nodes, members, smallest = {}, {}, 90.0
    for number, line in enumerate(lines):
        if line.startswith("*ELEMENT"):
            current = members.setdefault(line.rpartition("=")[2], [])
            keyword = "element"
        elif line.startswith("*NODE"):
            keyword = "node"
        elif line.startswith("*BEAM SECTION"):
            normal = np.array([float(x) for x in lines[number + 2].split(",")])
            for a, b in members[line.split("ELSET=")[1].split(",")[0]]:
                along = nodes[b] - nodes[a]
                cosine = abs(along @ normal) / np.linalg.norm(along) / np.linalg.norm(normal)
                smallest = min(smallest, np.degrees(np.arccos(cosine)))
            keyword = ""
        elif line.startswith("*"):
            keyword = ""
        elif keyword == "node":
            first, *x = line.split(",")
            nodes[first] = np.array([float(c) for c in x])
        elif keyword == "element":
            current.append([entry.strip() for entry in line.split(",")[1:]])
    assert 54 < smallest < 90


def test_a_material_and_the_dialects_differ_where_the_programs_do(tmp_path: Path):
    material = Material(E=1700.0, nu=0.4, density=1.01e-9)
    write_beam_deck(tmp_path / "a.inp", star(), material=material)
    write_beam_deck(tmp_path / "c.inp", star(), solver="calculix")
    abaqus, calculix = ((tmp_path / f"{name}.inp").read_text() for name in "ac")
    assert "TYPE=B31," in abaqus and "SECTION=CIRC\n0.4\n" in abaqus
    assert "*ELASTIC\n1700, 0.4\n*DENSITY\n1.01e-09\n" in abaqus
    assert "TYPE=B32R," in calculix and "SECTION=CIRC\n0.8, 0.8\n" in calculix
    assert "*MATERIAL, " not in calculix
    assert "define it, with *MATERIAL" in calculix


@pytest.mark.parametrize(
    ("options", "words"),
    [({"solver": "nastran"}, "known: abaqus, calculix"), ({"segments": 0}, "at least 1 element")],
)
def test_impossible_options_are_refused(options: dict, words: str, tmp_path: Path):
    with pytest.raises(InputError, match=words):
        write_beam_deck(tmp_path / "s.inp", star(), **options)
    assert not list(tmp_path.iterdir())


# As Abaqus/CAE writes it: one part, not moved; quoted names, sets of sets, ranges, a shell beside.
FOREIGN = """*Heading
** Job name: frame
*Part, name="Part 1"
*Node
      1,           0.,           0.,           0.
      2,  1.,  0.
      3,  1.,  1.
      4,  0.,  1.,  -0.
*Element, type=B31
 7, 1, 2
 3, 2, 3
*Element, type=B33
12, 3, 4, 1
*Element, type=S4R
20, 1, 2, 3, 4
*Elset, elset="two of them", generate
 3, 7, 4
*Elset, elset=all
 "two of them", 12
*Beam Section, elset=all, material=Steel, temperature=GRADIENTS, section=CIRC
0.05
0.,0.,-1.
*End Part
*Assembly, name=Assembly
*Instance, name=Part-1-1, part="Part 1"
*End Instance
*Node
      1, 9., 9., 9.
*End Assembly
*Material, name=Steel
*Elastic
 2.1e+11, 0.3
"""


def test_a_deck_of_another_program_in_metres(tmp_path: Path):
    found = read(tmp_path / "f.inp", FOREIGN, mm_per_unit=1000.0)
    s = found.structure
    np.testing.assert_allclose(
        s.joints, 1000 * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    )
    # In the order of their numbers 3, 7, 12.
    np.testing.assert_array_equal(s.struts, [[1, 2], [0, 1], [2, 3]])
    np.testing.assert_allclose(s.radii, 50)
    assert found.notes == ("1 elements that are no beams in space were left out",)


def test_a_mark_of_byte_order_is_no_part_of_the_first_keyword(tmp_path: Path):
    flat = FOREIGN[FOREIGN.index("*Node") : FOREIGN.index("*End Part")]
    again = read(tmp_path / "f.inp", "\ufeff" + flat, mm_per_unit=1000.0).structure
    assert len(again.struts) == 3


def test_rows_and_keywords_go_on_after_a_comma(tmp_path: Path):
    """Abaqus Keywords Guide, "Input syntax rules": both end with a comma where they go on."""
    text = FOREIGN
    for whole, divided in {
        " 3, 2, 3\n": " 3, 2,\n** a comment\n 3\n",
        " 7, 1, 2\n": " 7,\n 1,\n 2,\n",
        "20, 1, 2, 3, 4": "20, 1, 2,\n 3, 4,",
        "material=Steel, temp": "material=Steel,\n temp",
        "12, 3, 4, 1\n": "12, 3, 4,\n 1\n",
        "*Elset, elset=all\n": "*Restart,\n*Elset, elset=all\n",
    }.items():
        assert whole in text
        text = text.replace(whole, divided)
    whole, divided = read(tmp_path / "f.inp", FOREIGN), read(tmp_path / "g.inp", text)
    np.testing.assert_array_equal(divided.structure.struts, whole.structure.struts)
    np.testing.assert_array_equal(divided.structure.radii, whole.structure.radii)
    # The shell of two rows is one element.
    assert divided.notes == whole.notes


def test_walls_are_told_their_height_in_millimetres(tmp_path: Path):
    write_beam_deck(tmp_path / "s.inp", walls())
    (note,) = read(tmp_path / "s.inp", mm_per_unit=10.0).notes
    assert note.endswith("as high as the deepest of them, 80 mm")


MISTAKES = {
    "no beams": ("type=B3", "type=T3D", "f.inp: holds no beams"),
    "node": (" 7, 1, 2", " 7, 1, 8", "line 10: beam 7 ends at node 8"),
    "number": ("1.,  1.", "1.,  x", "line 7: .* must be finite numbers"),
    "inf": ("1.,  1.", "1.,  inf", "line 7: .* must be finite numbers"),
    "huge": (" 7, 1", f" {'7' * 30}, 1", "line 10: .* must be a whole number"),
    "entries": (
        " 3, 2, 3",
        " 3, 2",
        "line 11: a B31 has 2 nodes, not 1; a row goes on in the next",
    ),
    "not continued": (" 3, 2, 3", " 3, 2,", "line 11: a B31 has 2 nodes, not 1"),
    "nothing": (" 3, 2, 3", ",", "line 11: .* must be a whole number"),
    "twice": (" 3, 2, 3", " 7, 2, 3", "line 11: a second beam 7"),
    "node twice": ("      4,", "      3,", "line 8: a second node 3"),
    "same beam": (" 3, 2, 3", " 3, 2, 1", "repeats an earlier strut"),
    "set": ("elset=all, material", "elset=none, material", "line 20: set NONE, which a section"),
    "set of sets": ('"two of them", 12', '"three of them"', "line 20: set THREE OF THEM"),
    "without section": ('"two of them", 12', '"two of them"', "beam 12 has no .BEAM SECTION"),
    "shape": ("section=CIRC", "section=I", "line 20: section I is not understood"),
    "size": ("0.05\n", "-0.05\n", "line 20: the sizes of the section must be positive"),
    "ellipse": ("0.05\n", "0.05, 0.04\n", "an ellipse of 0.05 by 0.04"),
    "no walls": ("CIRC\n0.05\n0.,0.", "RECT\n1, 2\n0.,1.", "all beams must lie in one plane"),
    "two sections": ("*End Part", "*Beam Section, elset=all, section=CIRC\n1\n", "section already"),
    "no shape": (", section=CIRC", "", "line 20: .BEAM SECTION lacks SECTION="),
    "moved": ("*End Instance", "0., 0., 1.\n*End Instance", "an instance that is moved"),
    "two parts": ("*Assembly", "*Part, name=b\n*Assembly", "a second part"),
    "generated": ("*Elset, elset=all", "*Elgen, elset=all", r"line 18: .ELGEN is not followed"),
    "included": ("*Elset, elset=all", "*Include, input=b", r"line 18: .INCLUDE is not followed"),
    "cylinder": ("*Node\n      1,           0", "*Node, system=C\n 1, 0", "rectangular"),
    "half a range": (" 3, 7, 4\n", " 3\n", "line 17: a range of a set is its first and last"),
    "nameless": ("*Elset, elset=all", "*Elset", "line 18: .ELSET lacks ELSET="),
}


@pytest.mark.parametrize("mistake", sorted(MISTAKES))
def test_a_mistake_is_named(mistake: str, tmp_path: Path):
    old, new, words = MISTAKES[mistake]
    assert old in FOREIGN
    with pytest.raises(StructureError, match=words):
        read(tmp_path / "f.inp", FOREIGN.replace(old, new))


def test_round_and_square_beams_do_not_mix(tmp_path: Path):
    text = FOREIGN.replace("elset=all, material", 'elset="two of them", material')
    more = "*Beam Section, elset=rest, section=RECT\n1, 1\n*Elset, elset=rest\n12\n*End Part"
    with pytest.raises(StructureError, match="round and rectangular"):
        read(tmp_path / "f.inp", text.replace("*End Part", more))


def test_sets_that_name_each_other_come_to_an_end(tmp_path: Path):
    text = FOREIGN.replace('"two of them", 12', '"two of them", 12, ALL, b')
    text = text.replace("*Beam", "*Elset, elset=b\nall\n*Beam")
    assert len(read(tmp_path / "f.inp", text).structure.struts) == 3


def test_a_curved_beam_is_refused(tmp_path: Path):
    write_beam_deck(tmp_path / "s.inp", star(), solver="calculix")
    text = (tmp_path / "s.inp").read_text().replace("14, 5, 0, 0", "14, 5, 1, 0")
    with pytest.raises(StructureError, match="beam 1 is curved"):
        read(tmp_path / "c.inp", text)


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(StructureError, match=r"no\.inp: cannot be read"):
        read(tmp_path / "no.inp")


@pytest.fixture(scope="module")
def deck(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes]:
    path = tmp_path_factory.mktemp("inp") / "s.inp"
    write_beam_deck(path, walls())
    return path.with_name("broken.inp"), path.read_bytes()


@settings(max_examples=150)
@given(place=st.integers(0, 10**6), byte=st.integers(0, 255), end=st.sampled_from([0, 10**6]))
def test_broken_bytes_are_read_or_refused_and_never_a_crash(
    deck: tuple[Path, bytes], place: int, byte: int, end: int
):
    path, content = deck
    place %= len(content)
    # The rest of the deck, or nothing.
    path.write_bytes(content[:place] + bytes([byte]) + content[place + 1 : end])
    found = outcome(path)
    if isinstance(found, StructureError):
        assert "broken.inp" in str(found)
    else:
        found.structure.validate()


def outcome(path: Path) -> Imported | StructureError:
    try:
        return read(path)
    except StructureError as failure:
        return failure
