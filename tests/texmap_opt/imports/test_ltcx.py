"""LTCX graphs, by the schema that nTopology published (github.com/nTopology/LTCX)."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt.errors import StructureError
from texmap_opt.imports.imported import Imported
from texmap_opt.imports.ltcx import read_ltcx

# In the form of the published samples: a triangle with a face; the second node's radius has the name
# that the published reader takes.
GRAPH = """<?xml version="1.0" encoding="UTF-8"?>
<!-- sample -->
<graph id="0" name="triangle" units="cm" type="rnd">
  <nodegroup id="1">
    <node id="4" x="0" y="0" z="0" r=".1"/>
    <node id="5" x="1" y="0" z="0" rad="0.2"/>
    <node id="6" x="0" y="1" z="-1e-1" r="0.3"/>
  </nodegroup>
  <beamgroup id="2">
    <beam id="0" n1="4" n2="5"/>
    <beam id="1" n1="6" n2="5"/>
  </beamgroup>
  <facegroup id="3"><face id="0" n1="4" n2="5" n3="6"/></facegroup>
</graph>
"""


def read(path: Path, text: str, *, radius: float | None = None, section="round") -> Imported:
    path.write_text(text)
    return read_ltcx(path, radius=radius, section=section)


def test_nodes_beams_and_radii_of_nodes_in_the_units_of_the_file(tmp_path: Path):
    found = read(tmp_path / "t.ltcx", GRAPH, section="square")
    s = found.structure
    np.testing.assert_allclose(s.joints, [[0, 0, 0], [10, 0, 0], [0, 10, -1]])
    np.testing.assert_array_equal(s.struts, [[0, 1], [2, 1]])
    np.testing.assert_allclose(s.radii, [[1, 2], [3, 2]])
    assert s.section == "square"
    assert found.notes == ("1 faces are plates, not struts, and were left out",)


@pytest.mark.parametrize(("units", "mm"), [("", 1), (' units="m"', 1000), (' units="ft"', 304.8)])
def test_units_are_millimetres_unless_the_file_says_so(units: str, mm: float, tmp_path: Path):
    s = read(tmp_path / "t.ltcx", GRAPH.replace(' units="cm"', units)).structure
    np.testing.assert_allclose(s.joints[1], [mm, 0, 0])


def test_a_radius_stands_in_for_those_that_are_missing(tmp_path: Path):
    text = GRAPH.replace(' r=".1"', "")
    np.testing.assert_allclose(
        read(tmp_path / "t.ltcx", text, radius=0.7).structure.radii, [[0.7, 2], [3, 2]]
    )
    with pytest.raises(StructureError, match=r'line 5: node "4" has no radius; .*--radius'):
        read(tmp_path / "t.ltcx", text)


def test_a_radius_that_no_node_lacks_is_refused(tmp_path: Path):
    with pytest.raises(StructureError, match="every node has a radius; leave --radius out"):
        read(tmp_path / "t.ltcx", GRAPH, radius=0.7)


MISTAKES = {
    "root": ("graph", "lattice", "line 3: <lattice> where <graph> is expected"),
    "unit": ('"cm"', '"km"', 'line 3: units is "km"; did you mean "m"'),
    "radius": ('".1"', '"0"', "line 5: r is 0; it must be positive"),
    "node twice": ('id="5"', 'id="4"', 'line 6: a second node with id "4"'),
    "no node": ('n1="6"', 'n1="7"', 'line 11: beam ends at node "7"'),
    "no end": ('n1="6"', "", 'line 11: <beam> lacks its attribute "n1"'),
    "same node": ('n1="6"', 'n1="5"', "strut 1 has no length"),
    "number": ('x="1"', 'x="one"', "line 6: node has .*it needs 3 finite numbers"),
    "text": ("<beamgroup", "beams<beamgroup", 'line 9: text "beams"'),
    "entity": ("<graph ", "<!DOCTYPE graph [<!ENTITY a 'b'>]><graph ", "document type"),
    "no beams": ("<beam ", "<face ", "line 10: <face> where <beam> is expected"),
    "nothing": (GRAPH[GRAPH.index("  <beamg") : GRAPH.index("</graph>")], "", "holds no struts"),
}


@pytest.mark.parametrize("mistake", sorted(MISTAKES))
def test_a_mistake_is_named(mistake: str, tmp_path: Path):
    old, new, words = MISTAKES[mistake]
    assert old in GRAPH
    with pytest.raises(StructureError, match=rf"t\.ltcx.*{words}"):
        read(tmp_path / "t.ltcx", GRAPH.replace(old, new))


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(StructureError, match=r"no\.ltcx: cannot be read"):
        read_ltcx(tmp_path / "no.ltcx", radius=None, section="round")


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("ltcx") / "broken.ltcx"


@settings(max_examples=150)
@given(place=st.integers(0, 10**6), byte=st.integers(0, 255), end=st.sampled_from([0, 10**6]))
def test_broken_bytes_are_read_or_refused_and_never_a_crash(
    path: Path, place: int, byte: int, end: int
):
    content = GRAPH.encode()
    place %= len(content)
    # The rest of the file, or nothing.
    path.write_bytes(content[:place] + bytes([byte]) + content[place + 1 : end])
    found = outcome(path)
    if isinstance(found, StructureError):
        assert "broken.ltcx" in str(found)
    else:
        found.structure.validate()


def outcome(path: Path) -> Imported | StructureError:
    try:
        return read_ltcx(path, radius=None, section="round")
    except StructureError as failure:
        return failure
