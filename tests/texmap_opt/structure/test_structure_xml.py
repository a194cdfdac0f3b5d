"""structure.xml: bits survive the round trip, mistakes are named with file and line."""

import io
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xmlschema
from hypothesis import example, given, settings
from hypothesis import strategies as st

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.drawn_cell import drawn_cell
from texmap_opt.errors import StructureError
from texmap_opt.structure import structure_xml
from texmap_opt.structure.structure import TRANSITION, Extrusion, Origin, Structure
from texmap_opt.structure.structure_xml import (
    read_provenance,
    read_structure,
    write_structure,
)

SCHEMA = Path(__file__).parents[3] / "library/structure.xsd"
# XML metacharacters, line breaks of both kinds, and a character that XML cannot hold.
PROVENANCE = {"cell": "octet", "note": 'a < b & "c"', "case": "[part]\r\nä = 1\n", "bell": "x\x07"}


def structure(repeat: int = 2) -> Structure:
    """Octet cells with all the digits a float can have, and some cut joints."""
    rng = np.random.default_rng(7)
    s = drawn_cell(unit_cell("octet"), repeat=repeat)
    return replace(
        s,
        joints=s.joints + rng.normal(size=s.joints.shape) * 1e-3,
        radii=rng.uniform(0.1, 1, size=s.radii.shape),
        cut=rng.random(len(s.joints)) < 0.2,
        cell_size=rng.uniform(0.5, 2, size=len(s.struts)),
        section="square",
    )


def with_origin(s: Structure) -> Structure:
    """Two kinds, one with characters that XML escapes, in any order of cells."""
    rng = np.random.default_rng(8)
    count = len(s.struts)
    cell, kind = rng.integers(0, 10**12, count), rng.integers(0, 2, count)
    return replace(s, origin=Origin(cell, kind, (TRANSITION, 'a "cell" <of> mine')))


def walls() -> Structure:
    """Three walls around a triangle in a slanted plane."""
    axis = np.array([2.0, 3.0, 6.0]) / 7
    low, high = 0.1, 7.3
    across = np.linalg.svd(axis[None])[2][1:]
    corners = np.array([[0.0, 0], [10, 0.3], [4, 9.1]])
    return Structure(
        joints=corners @ across + (low + high) / 2 * axis,
        struts=np.array([[0, 1], [1, 2], [2, 0]]),
        radii=np.array([[0.5, 0.4], [0.3, 0.3], [1 / 3, 0.1]]),
        cut=np.array([True, False, True]),
        cell_size=np.array([1.0, 1.1, 0.9]),
        section="wall",
        extrusion=Extrusion(axis, low, high, np.array([7.2, 1 / 3, 5.0])),
    )


def plain(s: Structure) -> Structure:
    """Without what is optional in a file."""
    return replace(s, origin=None, cut=np.zeros(len(s.joints), bool))


def assert_equal(a: Structure, b: Structure) -> None:
    """Bit for bit."""
    for name in ("joints", "struts", "radii", "cut", "cell_size"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert a.section == b.section
    assert (a.origin is None, a.extrusion is None) == (b.origin is None, b.extrusion is None)
    if a.origin is not None and b.origin is not None:
        np.testing.assert_array_equal(a.origin.cell, b.origin.cell)
        np.testing.assert_array_equal(a.origin.kind, b.origin.kind)
        assert a.origin.kinds == b.origin.kinds
    if a.extrusion is not None and b.extrusion is not None:
        np.testing.assert_array_equal(a.extrusion.axis, b.extrusion.axis)
        np.testing.assert_array_equal(a.extrusion.depth, b.extrusion.depth)
        assert (a.extrusion.low, a.extrusion.high) == (b.extrusion.low, b.extrusion.high)


def text_of(s: Structure) -> str:
    file = io.StringIO()
    write_structure(s, file, provenance=PROVENANCE)
    return file.getvalue()


STRUCTURES = {
    "with origin": with_origin(structure()),
    "plain": plain(structure()),
    "walls": walls(),
    "nothing": plain(structure()).select(np.zeros(len(structure().struts), bool)),
}


@pytest.mark.parametrize("name", sorted(STRUCTURES))
def test_what_is_read_is_bit_for_bit_what_was_written(name: str, tmp_path: Path):
    s = STRUCTURES[name]
    write_structure(s, tmp_path / "s.xml", provenance=PROVENANCE)
    assert_equal(read_structure(tmp_path / "s.xml"), s)
    assert read_provenance(tmp_path / "s.xml") == {**PROVENANCE, "bell": "x\\x07"}


@pytest.mark.parametrize("name", sorted(STRUCTURES))
def test_what_is_written_follows_the_schema(name: str, tmp_path: Path):
    write_structure(STRUCTURES[name], tmp_path / "s.xml", provenance=PROVENANCE)
    xmlschema.validate(tmp_path / "s.xml", SCHEMA)


def test_a_failing_writer_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """No partial result: writing ends after the joints."""
    path = tmp_path / "s.xml"
    path.write_text("old")
    monkeypatch.setattr(structure_xml, "_strut_values", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_structure(structure(), path, provenance={})
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["s.xml"]


def test_joints_may_be_numbered_in_any_way():
    text = text_of(plain(structure(1))).replace('id="0"', 'id="900"').replace('="0"', '="900"')
    again = read_structure(io.BytesIO(text.encode()))
    np.testing.assert_array_equal(again.struts, structure(1).struts)


MISTAKES = {
    "wrong root": ("structure", "lattice", 2, "<lattice> where <structure> is expected"),
    "unit": ('unit="mm"', 'unit="inch"', 2, 'unit is "inch"; known: mm'),
    "section": ('"square"', '"sqare"', 2, 'did you mean "square"?'),
    "document type": ("<structure ", "<!DOCTYPE structure>\n<structure ", 2, "document type"),
    "cut off": ("  </struts>\n</structure>\n", "", 64, "is not XML"),
    "text between": ("<joints ", "hello<joints ", 11, 'text "hello"'),
    "unknown joint": ('from="0"', 'from="99"', 28, "ends at joint 99"),
    "not finite": ('id="0">', 'id="0">nan ', 12, "needs 3 finite numbers"),
    "radius": ('radius_from="', 'radius_from="-', 28, "must be positive"),
    "repeated id": ('id="1"', 'id="0"', 13, "second joint with id 0"),
    "unknown attribute": ("radius_to", "radius_too", 28, 'lacks its attribute "radius_to"'),
    "count": ('count="36"', 'count="37"', 64, "announces 37 and holds 36"),
    "too large a number": ('id="0"', f'id="{"9" * 5000}"', 12, "must be a whole number"),
    "not Python's numbers": ('id="0">', 'id="0">1_0 ', 12, "needs 3 finite numbers"),
    "endless joint": ('id="0">', 'id="0">' + "7" * 2000, 12, "more text than three coordinates"),
    "unknown encoding": ("UTF-8", "UTF-9", 1, "unknown encoding: UTF-9"),
    "encoding of no text": ("UTF-8", "rot13", 1, "cannot be decoded"),
    "origin without kinds": (
        ' cell_size="',
        ' cell="1" cell_size="',
        28,
        "needs an element <kinds>",
    ),
    "depth of a bar": (
        ' cell_size="',
        ' depth="1" cell_size="',
        28,
        "needs an element <extrusion>",
    ),
    "wall without extrusion": ('"square"', '"wall"', 11, "which needs an <extrusion>"),
    "second section": ("  <provenance>", "  <provenance></provenance><provenance>", 3, "order is"),
}


ORIGIN_MISTAKES = {
    "unknown kind": (f'kind="{TRANSITION}"', 'kind="octet"', 'kind is "octet"; known: a'),
    "no kind": (f' kind="{TRANSITION}"', "", 'lacks its attribute "kind"'),
    "negative cell": (' cell="', ' cell="-', "must be a whole number, 0 or more"),
    "kind twice": (
        f"<kind>{TRANSITION}</kind>",
        f"<kind>{TRANSITION}</kind>" * 2,
        "names must differ",
    ),
    "kinds after joints": ("<kinds>", "<joints/><kinds>", 'lacks its attribute "count"'),
}
WALL_MISTAKES = {
    "bars": ('section="wall"', 'section="round"', 'section is "round", which needs no <extrusion>'),
    "no depth": (' depth="5.0"', "", 'lacks its attribute "depth"'),
    "zero depth": (' depth="5.0"', ' depth="0"', "it must be positive"),
    "too deep": (
        ' depth="5.0"',
        ' depth="8"',
        "wall 2 has a depth that is not between 0 and 7.2 mm",
    ),
    "upside down": ('low="0.1"', 'low="9"', "walls stand from 9 to 7.3 mm"),
    "long axis": ('axis="0', 'axis="1', "is not a unit vector"),
    "off the middle": (
        'low="0.1"',
        'low="0"',
        "joint 0 is not half way between the heights 0 and 7.3",
    ),
}


def refused(text: str, path: Path) -> str:
    path.write_text(text, encoding="utf-8")
    with pytest.raises(StructureError) as caught:
        read_structure(path)
    return str(caught.value)


@pytest.mark.parametrize("mistake", sorted(MISTAKES))
def test_a_mistake_is_named_with_file_and_line(mistake: str, tmp_path: Path):
    old, new, line, words = MISTAKES[mistake]
    text = text_of(plain(structure(1)))
    assert old in text
    message = refused(text.replace(old, new), tmp_path / "s.xml")
    assert f"s.xml, line {line}: " in message
    assert words in message


@pytest.mark.parametrize("mistake", sorted(ORIGIN_MISTAKES))
def test_a_mistake_in_the_origin_of_struts_is_named(mistake: str, tmp_path: Path):
    old, new, words = ORIGIN_MISTAKES[mistake]
    text = text_of(with_origin(structure(1)))
    assert old in text
    assert words in refused(text.replace(old, new), tmp_path / "s.xml")


@pytest.mark.parametrize("mistake", sorted(WALL_MISTAKES))
def test_a_mistake_in_walls_is_named(mistake: str, tmp_path: Path):
    old, new, words = WALL_MISTAKES[mistake]
    text = text_of(walls())
    assert old in text
    assert words in refused(text.replace(old, new), tmp_path / "s.xml")


def test_an_entity_cannot_grow_a_file(tmp_path: Path):
    """The billion laughs: refused at the document type, before its first entity is defined."""
    laughs = "".join(f'<!ENTITY l{n + 1} "{f"&l{n};" * 10}">' for n in range(9))
    document_type = f'<!DOCTYPE structure [<!ENTITY l0 "ha">{laughs}]>\n<structure '
    text = text_of(walls()).replace("<structure ", document_type).replace("octet", "&l9;")
    assert "line 2: has a document type" in refused(text, tmp_path / "s.xml")


def test_a_long_file_that_breaks_at_its_end_gives_its_line_and_nothing_else(tmp_path: Path):
    """The last strut of two chunks and more of them ends at a joint that there is not."""
    text = text_of(plain(structure(8)))
    head, last = text.rsplit('<strut from="', 1)
    line = head.count("\n") + 1
    assert line > 2 * structure_xml.ROWS_PER_CHUNK
    message = refused(f'{head}<strut from="7777{last}', tmp_path / "s.xml")
    assert f"line {line}: strut ends at joint 7777" in message


BYTES = text_of(with_origin(structure(1))).encode(), text_of(walls()).encode()


@settings(max_examples=60)
@given(which=st.sampled_from(BYTES), data=st.data())
def test_a_file_that_breaks_off_is_refused(which: bytes, data: st.DataObject):
    end = data.draw(st.integers(0, len(which) - len("</structure>\n")))
    with pytest.raises(StructureError):
        read_structure(io.BytesIO(which[:end]))


@settings(max_examples=150)
@example(which=BYTES[0], place=30, byte=ord("["))
@given(which=st.sampled_from(BYTES), place=st.integers(0, 10**6), byte=st.integers(0, 255))
def test_a_wrong_byte_is_read_or_refused_and_never_a_crash(which: bytes, place: int, byte: int):
    broken = bytearray(which)
    broken[place % len(which)] = byte
    found = outcome(bytes(broken))
    if isinstance(found, StructureError):
        assert "structure file" in str(found)
    else:
        found.validate()


def outcome(content: bytes) -> Structure | StructureError:
    try:
        return read_structure(io.BytesIO(content))
    except StructureError as failure:
        return failure


def test_a_repeated_strut_breaks_an_invariant():
    s = structure(1)
    twice = replace(s, struts=np.concatenate([s.struts[:-1], s.struts[:1, ::-1]]))
    with pytest.raises(StructureError, match="strut 35 repeats an earlier strut"):
        read_structure(io.BytesIO(text_of(twice).encode()))


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(StructureError, match=r"no\.xml: structure file cannot be read"):
        read_structure(tmp_path / "no.xml")


class Sink(io.StringIO):
    """Throws away what is written."""

    def writelines(self, lines):
        for _ in lines:
            pass


def peak_of_writing(s: Structure) -> int:
    tracemalloc.start()
    write_structure(s, Sink(), provenance={})
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def test_writing_holds_no_tree_in_memory(monkeypatch: pytest.MonkeyPatch):
    """Full chunks of joints and of struts are as much as any number of them takes.

    5 % is room for longer numbers.
    """
    monkeypatch.setattr(structure_xml, "ROWS_PER_CHUNK", 400)
    assert peak_of_writing(structure(7)) < 1.05 * peak_of_writing(structure(5))
