"""Reading a unit cell refuses what is no cell, naming file, line, value and remedy."""

from pathlib import Path

import numpy as np
import pytest
import xmlschema
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.unit_cell_xml import read_unit_cell
from texmap_opt.errors import CellError

SCHEMA = Path(__file__).parents[3] / "library/unit_cell.xsd"

# One chain of struts along each axis, meeting at the middle.
GOOD = """<?xml version="1.0" encoding="UTF-8"?>
<unit_cell name="jack" dimensions="3" unit="cell" section="round" tiling="translate" classification="bending">
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
    "too many digits": (">1 0.5 0.5<", f">1 0.5 0.{'5' * 5000}<", 8, "it needs 3 coordinates", False),
    "two coordinates": (">1 0.5 0.5<", ">1 0.5<", 8, "3 coordinates", False),
    "repeated strut": ('from="m" to="xp"', 'from="xm" to="m"', 16, "repeats line 15", False),
    "strut without length": ('from="m" to="xp"', 'from="m" to="m"', 16, "has no length", False),
    "repeated id": ('id="xp"', 'id="xm"', 8, 'second joint with id "xm"', True),
    "two joints at one place": (">1 0.5 0.5<", ">0 1/2 1/2<", 8, 'at the place of "xm"', False),
    "joint without struts": (
        '    <strut from="m" to="yp"/>\n', "", 10, 'joint "yp" has no strut', False,
    ),
    "faces that differ": (">1 0.5 0.5<", ">1 0.5 0.4<", 7, "no match in the opposite", False),
    "tiling": ('"translate"', '"mirrored"', 2, 'did you mean "mirror"?', True),
    "tiling of two axes": (
        '"translate"', '"mirror mirror"', 2, "one word, or one for each of 3 axes", False,
    ),
    "no unit": (' unit="cell"', "", 2, 'lacks its attribute "unit"; give unit="cell" for', True),
    "unknown unit": ('unit="cell"', 'unit="inch"', 2, "known: cell, mm", True),
    "millimetres of what": ('unit="cell"', 'unit="mm"', 2, "add edges_mm", False),
    "edges of a unit cube": (
        'unit="cell"', 'unit="cell" edges_mm="1 1 1"', 2, 'is for unit="mm"', False,
    ),
    "two edges": (
        'unit="cell"', 'unit="cell" proportions="1 2"', 2, "needs 3 positive numbers", False,
    ),
    "edge of no length": (
        'unit="cell"', 'unit="cell" proportions="1 0 1"', 2, "needs 3 positive numbers", False,
    ),
    "proportions twice": (
        'unit="cell"', 'unit="mm" edges_mm="1 1 1" proportions="1 1 1"', 2, "remove them", False,
    ),
    "outside the edges": (
        'unit="cell"', 'unit="mm" edges_mm="0.7 0.7 0.7"', 8, "0 and edges_mm = 0.7 0.7", False,
    ),
    "no dimensions": (' dimensions="3"', "", 2, 'dimensions"; give dimensions="3"', True),
    "four dimensions": ('dimensions="3"', 'dimensions="4"', 2, "known: 2, 3", True),
    "plane": ('dimensions="3"', 'dimensions="2"', 6, "it needs 2 coordinates", False),
    "class that it has not": (
        '"bending"', '"stretching"', 2, "but the lattice is bending; give that, or nothing", False,
    ),
    "symmetry that it has not": (
        '"bending"', '"bending" symmetry="cubic"', 2, "but the lattice is tetragonal", False,
    ),
    "strut through a joint": (
        'from="m" to="xm"', 'from="xp" to="xm"', 15, 'runs through joint "m"', False,
    ),
    "loose end": (
        '<joint id="zp">0.5 0.5 1</joint>',
        '<joint id="zp">0.5 0.5 1</joint><joint id="e">0.9 0.9 0.9</joint>', 12, "no strut", False,
    ),
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
    assert (cell.classification, cell.symmetry, cell.source) == (
        "bending",
        "tetragonal",
        "This test.",
    )
    assert (cell.mirrored, cell.period) == ((False,) * 3, (1, 1, 1))
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
    assert read_unit_cell(written(tmp_path, text)).mirrored == (True, True, True)


def tetrahedron(tiling: str) -> str:
    """Four corners of the cube and the six face diagonals between them."""
    corners = {"a": "0 0 0", "b": "1 1 0", "c": "1 0 1", "d": "0 1 1"}
    joints = "".join(f'<joint id="{k}">{v}</joint>' for k, v in corners.items())
    pairs = ("ab", "ac", "ad", "bc", "bd", "cd")
    struts = "".join(f'<strut from="{p[0]}" to="{p[1]}"/>' for p in pairs)
    return (
        f'<unit_cell name="t" dimensions="3" unit="cell" section="round" '
        f'tiling="{tiling}" classification="stretching">'
        f"<description>T</description><source>T</source><joints>{joints}</joints>"
        f"<struts>{struts}</struts></unit_cell>"
    )


def test_tetrahedra_must_be_mirrored(tmp_path: Path):
    """Translated, their diagonals only cross: neighbours would share no joint."""
    with pytest.raises(CellError, match=r'no match in the opposite face.*tiling="mirror"'):
        read_unit_cell(written(tmp_path, tetrahedron("translate")))
    assert read_unit_cell(written(tmp_path, tetrahedron("mirror"))).name == "t"


def test_a_net_that_falls_apart_is_refused(tmp_path: Path):
    """A bar beside the jack that never meets it."""
    text = GOOD.replace(
        "</joints>", '<joint id="a">0 0.2 0.2</joint><joint id="b">1 0.2 0.2</joint></joints>'
    ).replace("</struts>", '<strut from="a" to="b"/></struts>')
    with pytest.raises(CellError, match=r"line 2: a block of 2 x 2 x 2 cells .* separate nets"):
        read_unit_cell(written(tmp_path, text))


def test_mirrored_cells_must_meet_in_both_their_faces(tmp_path: Path):
    """A wall with a branch to the right: cells 0 and 1 are joined, 2 and 3, but not 1 and 2."""
    joints = {"a": "0.5 0", "b": "0.5 0.5", "c": "0.5 1", "d": "1 0.3", "e": "1 0.7"}
    pairs = ("ab", "bc", "bd", "be", "de")
    text = (
        '<unit_cell name="t" dimensions="2" unit="cell" section="wall" tiling="mirror translate">'
        "<description>T</description><source>T</source><joints>"
        + "".join(f'<joint id="{k}">{v}</joint>' for k, v in joints.items())
        + "</joints><struts>"
        + "".join(f'<strut from="{p[0]}" to="{p[1]}"/>' for p in pairs)
        + "</struts></unit_cell>"
    )
    with pytest.raises(CellError, match=r"a block of 3 x 2 cells .* falls into 2 separate nets"):
        read_unit_cell(written(tmp_path, text))


def test_a_loose_end_is_refused(tmp_path: Path):
    """The bars of a jack and one that ends in the open."""
    more = '<joint id="zp">0.5 0.5 1</joint><joint id="e">0.9 0.9 0.9</joint>'
    text = GOOD.replace('<joint id="zp">0.5 0.5 1</joint>', more).replace(
        "</struts>", '<strut from="m" to="e"/></struts>'
    )
    with pytest.raises(CellError, match=r'line 12: joint "e" is a loose end'):
        read_unit_cell(written(tmp_path, text))


def test_joints_that_are_nearly_one_are_refused(tmp_path: Path):
    """The bar along y ends a ten-thousandth beside the middle, joined to it by a speck."""
    text = (
        GOOD.replace(
            '<joint id="zp">0.5 0.5 1</joint>',
            '<joint id="zp">0.5 0.5 1</joint><joint id="n">0.5 0.5001 0.5</joint>',
        )
        .replace('from="m" to="yp"', 'from="n" to="yp"')
        .replace("</struts>", '<strut from="m" to="n"/></struts>')
    )
    with pytest.raises(CellError, match=r'line 12: joint "n" is nearer than 0.001 cells to "m"'):
        read_unit_cell(written(tmp_path, text))


def test_struts_that_cross_are_refused(tmp_path: Path):
    """Both diagonals of a square; and a zigzag whose neighbour's runs through it."""
    corners = {"a": "0 0", "b": "1 0", "c": "0 1", "d": "1 1"}
    joints = "".join(f'<joint id="{k}">{v}</joint>' for k, v in corners.items())
    pairs = ("ab", "ac", "bd", "cd", "ad", "bc")
    struts = "".join(f'<strut from="{p[0]}" to="{p[1]}"/>' for p in pairs)
    text = (
        '<unit_cell name="t" dimensions="2" unit="cell" section="wall" tiling="translate">'
        f"<description>T</description><source>T</source><joints>{joints}</joints>"
        f"<struts>{struts}</struts></unit_cell>"
    )
    with pytest.raises(CellError, match=r'strut "a–d" crosses strut "b–c".* give both a joint'):
        read_unit_cell(written(tmp_path, text))


def test_millimetres_are_shares_of_the_edges(tmp_path: Path):
    """A square frame of 10 x 17.5 mm: the same as in cell edges with its proportions."""
    corners = {"a": "0 0", "b": "{x} 0", "c": "0 {y}", "d": "{x} {y}"}

    def text(attributes: str, x: str, y: str) -> str:
        joints = "".join(
            f'<joint id="{k}">{v.format(x=x, y=y)}</joint>' for k, v in corners.items()
        )
        struts = "".join(f'<strut from="{p[0]}" to="{p[1]}"/>' for p in ("ab", "ac", "bd", "cd"))
        return (
            f'<unit_cell name="t" dimensions="2" {attributes} section="wall" tiling="translate">'
            f"<description>T</description><source>T</source><joints>{joints}</joints>"
            f"<struts>{struts}</struts></unit_cell>"
        )

    in_mm = read_unit_cell(written(tmp_path, text('unit="mm" edges_mm="10 17.5"', "10", "17.5")))
    in_cells = read_unit_cell(written(tmp_path, text('unit="cell" proportions="1 1.75"', "1", "1")))
    np.testing.assert_array_equal(in_mm.joints, in_cells.joints)
    assert in_mm.proportions == in_cells.proportions == (1.0, 1.75)
    assert in_mm.dimensions == 2
    assert (in_mm.classification, in_mm.symmetry) == ("bending", "rectangular")
    xmlschema.validate(tmp_path / "jack.xml", SCHEMA)


def test_an_unknown_name_suggests_the_nearest():
    with pytest.raises(CellError, match='"octett" is not in the library; did you mean "octet"'):
        unit_cell("octett")


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(CellError, match=r"mine\.xml: unit-cell file cannot be read"):
        unit_cell("mine.xml", base=tmp_path)


def test_a_path_is_relative_to_the_case_file(tmp_path: Path):
    written(tmp_path, GOOD)
    assert unit_cell("jack.xml", base=tmp_path).name == "jack"


@settings(max_examples=150, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), name=st.sampled_from(["octet", "bi-stable", "tetrahedron"]))
def test_a_spoilt_file_is_refused_in_words_or_read(seed, name, tmp_path_factory):
    """Cut short, letters exchanged, lines lost or doubled: a cell or a CellError, nothing else."""
    rng = np.random.default_rng(seed)
    good = (SCHEMA.parent / f"{name}.xml").read_bytes()
    kind = rng.integers(4)
    text = bytearray(good)
    if kind == 0:
        text = text[: rng.integers(len(text))]
    elif kind == 1:
        for place in rng.integers(len(text), size=3):
            text[place] = rng.integers(256)
    else:
        lines = good.splitlines(keepends=True)
        line = int(rng.integers(len(lines)))
        lines[line : line + 1] = [] if kind == 2 else [lines[line]] * 2
        text = b"".join(lines)
    path = tmp_path_factory.mktemp("spoilt") / "cell.xml"
    path.write_bytes(bytes(text))
    said = "cell.xml, line "
    try:
        read_unit_cell(path)
    except CellError as refused:
        said = str(refused)
    assert said.startswith("cell.xml, line ")
