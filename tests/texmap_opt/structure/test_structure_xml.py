"""structure.xml: bits survive the round trip, mistakes are named with file and line."""

import io
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xmlschema

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.drawn_cell import drawn_cell
from texmap_opt.errors import StructureError
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.structure_xml import (
    read_provenance,
    read_structure,
    write_structure,
)

SCHEMA = Path(__file__).parents[3] / "library/structure.xsd"
# XML metacharacters, a line break, and a character that XML cannot hold.
PROVENANCE = {"cell": "octet", "note": 'a < b & "c"', "bell": "x\x07"}


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


def text_of(s: Structure) -> str:
    file = io.StringIO()
    write_structure(s, file, provenance=PROVENANCE)
    return file.getvalue()


def test_what_is_read_is_bit_for_bit_what_was_written(tmp_path: Path):
    s = structure()
    write_structure(s, tmp_path / "s.xml", provenance=PROVENANCE)
    again = read_structure(tmp_path / "s.xml")
    for name in ("joints", "struts", "radii", "cut", "cell_size"):
        np.testing.assert_array_equal(getattr(again, name), getattr(s, name))
    assert again.section == "square"
    assert read_provenance(tmp_path / "s.xml") == {**PROVENANCE, "bell": "x\\x07"}


def test_what_is_written_follows_the_schema(tmp_path: Path):
    write_structure(structure(), tmp_path / "s.xml", provenance=PROVENANCE)
    xmlschema.validate(tmp_path / "s.xml", SCHEMA)


def test_joints_may_be_numbered_in_any_way():
    text = text_of(structure(1)).replace('id="0"', 'id="900"').replace('="0"', '="900"')
    again = read_structure(io.BytesIO(text.encode()))
    np.testing.assert_array_equal(again.struts, structure(1).struts)


MISTAKES = {
    "wrong root": ("structure", "lattice", 2, "<lattice> where <structure> is expected"),
    "unit": ('unit="mm"', 'unit="inch"', 2, 'unit is "inch"; known: mm'),
    "section": ('"square"', '"sqare"', 2, 'did you mean "square"?'),
    "document type": ("<structure ", "<!DOCTYPE structure>\n<structure ", 2, "document type"),
    "cut off": ("  </struts>\n</structure>\n", "", 61, "is not XML"),
    "text between": ("<joints ", "hello<joints ", 8, 'text "hello"'),
    "unknown joint": ('from="0"', 'from="99"', 25, "ends at joint 99"),
    "not finite": ('id="0">', 'id="0">nan ', 9, "needs 3 finite numbers"),
    "radius": ('radius_from="', 'radius_from="-', 25, "must be positive"),
    "repeated id": ('id="1"', 'id="0"', 10, "second joint with id 0"),
    "unknown attribute": ("radius_to", "radius_too", 25, 'lacks its attribute "radius_to"'),
    "count": ('count="36"', 'count="37"', 61, "announces 37 and holds 36"),
    "second section": ("  <provenance>", "  <provenance></provenance><provenance>", 3, "order is"),
}


@pytest.mark.parametrize("mistake", sorted(MISTAKES))
def test_a_mistake_is_named_with_file_and_line(mistake: str, tmp_path: Path):
    old, new, line, words = MISTAKES[mistake]
    text = text_of(replace(structure(1), cut=np.zeros(14, bool)))
    assert old in text
    path = tmp_path / "s.xml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(StructureError) as caught:
        read_structure(path)
    assert f"s.xml, line {line}: " in str(caught.value)
    assert words in str(caught.value)


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


def test_writing_holds_no_tree_in_memory():
    """Full chunks of joints and of struts are as much as any number of them takes.

    5 % is room for longer numbers.
    """
    assert peak_of_writing(structure(14)) < 1.05 * peak_of_writing(structure(10))
