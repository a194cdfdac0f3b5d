"""Reading a unit cell refuses what is no cell, naming file, line, value and remedy."""

from pathlib import Path

import numpy as np
import pytest
import xmlschema

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.unit_cell_xml import read_unit_cell
from texmap_opt.errors import CellError

SCHEMA = Path(__file__).parents[3] / "library/unit_cell.xsd"

# One chain of struts along each axis, meeting at the middle.
GOOD = """<?xml version="1.0" encoding="UTF-8"?>
<unit_cell name="jack" section="round" tiling="translate" classification="bending">
  <description>Three crossing bars.</description>
  <source>This test.</source>
  <joints>
    <joint id="m">1/2 1/2 1/2</joint>
    <joint id="xm">0 0.5 0.5</joint>
    <joint id="xp">1 0.5 0.5</joint>
    <joint id="ym">0.5 0 0.5</joint>
    <joint id="yp">0.5 1 0.5</joint>
    <joint id="zm">0.5 0.5 0</joint>
    <joint id="zp">0.5 0.5 1</joint>
  </joints>
  <struts>
    <strut from="m" to="xm"/>
    <strut from="m" to="xp" radius="0.5"/>
    <strut from="m" to="ym"/>
    <strut from="m" to="yp"/>
    <strut from="m" to="zm"/>
    <strut from="m" to="zp"/>
  </struts>
</unit_cell>
"""

# What is replaced, by what, the line that is blamed, and words of the message. `True`: the schema
# alone sees it too.
MISTAKES = {
    "wrong root": ("unit_cell", "cell", 2, "<cell> where <unit_cell> is expected", True),
    "not XML": ("</joints>", "</joint>", 13, "is not XML", None),
    "unknown joint": ('to="zp"', 'to="zpp"', 20, 'which is no joint; did you mean "zp"?', True),
    "outside the cube": (">1 0.5 0.5<", ">1.5 0.5 0.5<", 8, "outside the unit cube", False),
    "negative coordinate": (">1 0.5 0.5<", ">-0.5 0.5 0.5<", 8, "outside the unit cube", True),
    "not a number": (">1 0.5 0.5<", ">1 nan 0.5<", 8, 'is at "1 nan 0.5"', True),
    "two coordinates": (">1 0.5 0.5<", ">1 0.5<", 8, "three coordinates", True),
    "repeated strut": ('from="m" to="xp"', 'from="xm" to="m"', 16, "repeats line 15", False),
    "strut without length": ('from="m" to="xp"', 'from="m" to="m"', 16, "has no length", False),
    "repeated id": ('id="xp"', 'id="xm"', 8, 'second joint with id "xm"', True),
    "two joints at one place": (">1 0.5 0.5<", ">0 1/2 1/2<", 8, 'at the place of "xm"', False),
    "joint without struts": (
        '    <strut from="m" to="yp"/>\n', "", 10, 'joint "yp" has no strut', False,
    ),
    "faces that differ": (">1 0.5 0.5<", ">1 0.5 0.4<", 7, "no match in the opposite", False),
    "tiling": ('"translate"', '"mirrored"', 2, 'did you mean "mirror"?', True),
    "section": ('"round"', '"hexagonal"', 2, "known: round, square", True),
    "classification": ('"bending"', '"bend"', 2, 'did you mean "bending"?', True),
    "radius": ('"0.5"', '"-0.5"', 16, "must be a positive number", True),
    "radius in words": ('"0.5"', '"thin"', 16, 'radius is "thin"', True),
    "infinite radius": ('"0.5"', '"INF"', 16, "must be a positive number", False),
    "name": ('name="jack"', 'name="my jack"', 2, "no spaces", True),
    "unknown attribute": ("radius=", "radios=", 16, 'did you mean "radius"?', True),
    "missing attribute": (' to="xp"', "", 16, 'lacks its attribute "to"', True),
    "unknown element": ("source>", "sauce>", 4, 'did you mean "source"?', True),
    "empty description": (">Three crossing bars.<", "><", 3, "must hold text", True),
}  # fmt: skip


def written(folder: Path, text: str) -> Path:
    path = folder / "jack.xml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_good_file_is_read_whole(tmp_path: Path):
    cell = read_unit_cell(written(tmp_path, GOOD))
    assert cell.name == "jack"
    assert cell.joint_names == ("m", "xm", "xp", "ym", "yp", "zm", "zp")
    assert (cell.tiling, cell.classification, cell.source) == ("translate", "bending", "This test.")
    np.testing.assert_array_equal(cell.joints[0], 0.5)
    np.testing.assert_array_equal(cell.relative_radius, [1, 0.5, 1, 1, 1, 1])
    xmlschema.validate(tmp_path / "jack.xml", SCHEMA)


@pytest.mark.parametrize("mistake", sorted(MISTAKES))
def test_a_mistake_is_named_with_file_and_line(mistake: str, tmp_path: Path):
    old, new, line, words, _ = MISTAKES[mistake]
    assert old in GOOD
    path = written(tmp_path, GOOD.replace(old, new))
    with pytest.raises(CellError) as caught:
        read_unit_cell(path)
    assert str(caught.value).startswith(f"jack.xml, line {line}: ")
    assert words in str(caught.value)


@pytest.mark.parametrize("mistake", sorted(m for m, case in MISTAKES.items() if case[4]))
def test_the_schema_sees_what_a_schema_can(mistake: str, tmp_path: Path):
    old, new, *_ = MISTAKES[mistake]
    path = written(tmp_path, GOOD.replace(old, new))
    assert not xmlschema.XMLSchema(SCHEMA).is_valid(path)


def test_faces_that_differ_are_allowed_when_odd_cells_are_mirrored(tmp_path: Path):
    text = GOOD.replace(">1 0.5 0.5<", ">1 0.5 0.4<").replace("translate", "mirror")
    assert read_unit_cell(written(tmp_path, text)).tiling == "mirror"


def tetrahedron(tiling: str) -> str:
    """Four corners of the cube and the six face diagonals between them."""
    corners = {"a": "0 0 0", "b": "1 1 0", "c": "1 0 1", "d": "0 1 1"}
    joints = "".join(f'<joint id="{k}">{v}</joint>' for k, v in corners.items())
    pairs = ("ab", "ac", "ad", "bc", "bd", "cd")
    struts = "".join(f'<strut from="{p[0]}" to="{p[1]}"/>' for p in pairs)
    return (
        f'<unit_cell name="t" section="round" tiling="{tiling}" classification="stretching">'
        f"<description>T</description><source>T</source><joints>{joints}</joints>"
        f"<struts>{struts}</struts></unit_cell>"
    )


def test_tetrahedra_must_be_mirrored(tmp_path: Path):
    """Translated, their diagonals only cross: neighbours would share no joint."""
    with pytest.raises(CellError, match=r'no match in the opposite face.*tiling="mirror"'):
        read_unit_cell(written(tmp_path, tetrahedron("translate")))
    assert read_unit_cell(written(tmp_path, tetrahedron("mirror"))).name == "t"


def test_a_net_that_falls_apart_is_refused(tmp_path: Path):
    """Two bars that never meet."""
    text = GOOD.replace('from="m" to="xm"', 'from="xm" to="xp"').replace(
        '    <strut from="m" to="xp" radius="0.5"/>\n', ""
    )
    with pytest.raises(CellError, match=r"line 2: a block of 2 x 2 x 2 cells .* separate nets"):
        read_unit_cell(written(tmp_path, text))


def test_an_unknown_name_suggests_the_nearest():
    with pytest.raises(CellError, match='"octett" is not in the library; did you mean "octet"'):
        unit_cell("octett")


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(CellError, match=r"mine\.xml: unit-cell file cannot be read"):
        unit_cell("mine.xml", base=tmp_path)


def test_a_path_is_relative_to_the_case_file(tmp_path: Path):
    written(tmp_path, GOOD)
    assert unit_cell("jack.xml", base=tmp_path).name == "jack"
