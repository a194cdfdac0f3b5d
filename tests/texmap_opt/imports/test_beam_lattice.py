"""3MF beam lattices: radii by the specification's defaults, units, transforms, and bad packages."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt.errors import StructureError
from texmap_opt.export.beam_lattice import BEAMS, write_beam_lattice
from texmap_opt.export.three_mf_package import CORE, write_package
from texmap_opt.imports import beam_lattice
from texmap_opt.imports.beam_lattice import read_beam_lattice
from texmap_opt.imports.imported import Imported
from texmap_opt.structure.structure import Structure

# Of the extension's version 1.2; our own files have none.
BALLS = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/balls/2020/07"
# Vertices and radii are written in nine digits.
SAME = 1e-8

# Radii: both, one, none, in that order of the specification (1.2.0, section 2.1.1.1); a beam shorter
# than minlength; a triangle, a ball, clipping; and an object with no beams.
MODEL = f"""<?xml version="1.0" encoding="UTF-8"?>
<model unit="inch" xmlns="{CORE}" xmlns:b="{BEAMS}" xmlns:b2="{BALLS}" requiredextensions="b b2">
<metadata name="Title">frame</metadata>
<resources>
<object id="7" type="model"><mesh><vertices>
<vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="1" y="1" z="0"/>
<vertex x="0" y="1" z="0"/><vertex x="0" y="1" z="0.01"/>
</vertices><triangles><triangle v1="0" v2="1" v3="2"/></triangles>
<b:beamlattice radius="0.1" minlength="0.02" clippingmode="inside" clippingmesh="9" cap="butt">
<b:beams>
<b:beam v1="0" v2="1" r1="0.2" r2="0.3"/>
<b:beam v1="1" v2="2" r1="0.2"/>
<b:beam v1="2" v2="3"/>
<b:beam v1="3" v2="4"/>
</b:beams>
<b2:balls><b2:ball vindex="0" r="1"/></b2:balls>
</b:beamlattice></mesh></object>
<object id="9" type="model"><mesh><vertices/></mesh></object>
</resources>
<build><item objectid="9"/><item objectid="7" transform="0 2 0 -2 0 0 0 0 2 5 0 0"/></build>
</model>
"""


def read(path: Path, model: str) -> Imported:
    write_package(path, [model])
    return read_beam_lattice(path)


def test_radii_default_and_beams_go_where_the_build_puts_them(tmp_path: Path):
    """Turned by 90 degrees about z, doubled, moved by five inches along x; row vectors (core 3.3)."""
    found = read(tmp_path / "l.3mf", MODEL)
    s = found.structure
    np.testing.assert_allclose(
        s.joints, 25.4 * np.array([[5, 0, 0], [5, 2, 0], [3, 2, 0], [3, 0, 0]])
    )
    np.testing.assert_array_equal(s.struts, [[0, 1], [1, 2], [2, 3]])
    np.testing.assert_allclose(s.radii, 50.8 * np.array([[0.2, 0.3], [0.2, 0.2], [0.1, 0.1]]))
    assert s.section == "round"
    assert found.notes == (
        "object 9 has no beams and was left out",
        "object 7: 1 triangles beside the beams were left out",
        "object 7: 1 balls at the ends of beams were left out",
        "object 7: beams were not clipped inside its clipping mesh",
        "object 7: 1 beams shorter than its minlength were left out",
    )


def test_what_is_read_is_what_was_written(tmp_path: Path):
    rng = np.random.default_rng(4)
    joints = rng.normal(size=(30, 3)) * 20
    struts = np.stack([np.arange(29), np.arange(1, 30)], axis=1)
    radii = rng.uniform(0.2, 0.5, (29, 2))
    s = Structure(joints, struts, radii, np.zeros(30, bool), np.ones(29))
    write_beam_lattice(tmp_path / "l.3mf", s)
    again = read_beam_lattice(tmp_path / "l.3mf").structure
    np.testing.assert_array_equal(again.struts, struts)
    np.testing.assert_allclose(again.joints, joints, rtol=SAME)
    np.testing.assert_allclose(again.radii, radii, rtol=SAME)


def test_components_go_where_the_assembly_in_the_build_puts_them(tmp_path: Path):
    """Core specification, section 4.2: row vectors, the component's transform before the item's."""
    shifted, turned = "1 0 0 0 1 0 0 0 1 3 0 0", "0 1 0 -1 0 0 0 0 1 0 0 0"
    assembly = f'''<components><component objectid="7" transform="{shifted}"/>
<component objectid="7" transform="{turned}"/></components>'''
    model = MODEL.replace("<mesh><vertices/></mesh>", assembly).replace(
        '<item objectid="9"/><item objectid="7"', '<item objectid="9"'
    )
    found = read(tmp_path / "l.3mf", model)
    outline = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    moved = [outline + np.array([3, 0, 0]), outline @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]]
    # The item's: turned by 90 degrees about z, doubled, five along x.
    wanted = [places @ [[0, 2, 0], [-2, 0, 0], [0, 0, 2]] + [5, 0, 0] for places in moved]
    found_ends = np.sort(found.structure.joints[found.structure.struts].reshape(-1, 3), axis=0)
    ends = [places[[k, k + 1]] for places in wanted for k in range(3)]
    np.testing.assert_allclose(found_ends, 25.4 * np.sort(np.concatenate(ends), axis=0), atol=1e-12)
    # What there is to say of an object is said once.
    assert len(found.notes) == len(set(found.notes)) == 4


def test_assemblies_of_assemblies_cannot_ask_for_billions(tmp_path: Path):
    """Thirty lines that would place 2^30 lattices."""
    twice = "".join(
        f'<object id="{k + 1}"><components><component objectid="{k}"/><component objectid="{k}"/>'
        "</components></object>"
        for k in range(10, 40)
    )
    model = MODEL.replace('id="7"', 'id="10"').replace("</resources>", f"{twice}</resources>")
    with pytest.raises(StructureError, match=r"assemblies place more than 10,000 objects"):
        read(tmp_path / "l.3mf", model.replace('<item objectid="10"', '<item objectid="40"'))


MISTAKES = {
    "unit": ('unit="inch"', 'unit="inches"', 'line 2: unit is "inches"; did you mean "inch"'),
    "document type": ("<model ", "<!DOCTYPE model [<!ENTITY a 'b'>]><model ", "document type"),
    "no model": ("<model ", "<kit ", "line 2: is no 3MF model"),
    "no radius": (' radius="0.1"', "", 'line 9: <beamlattice> lacks its attribute "radius"'),
    "radius": ('r1="0.2" r2', 'r1="-0.2" r2', "line 11: r1 is -0.2; it must be positive"),
    "r2 alone": (' r1="0.2" r2', " r2", "line 11: beam has r2 without r1"),
    "vertex": ('v1="2" v2="3"', 'v1="2" v2="5"', "line 13: beam joins vertices 2 and 5"),
    "itself": ('v1="2" v2="3"', 'v1="2" v2="2"', "line 13: beam joins vertices 2 and 2"),
    "coordinate": ('z="0.01"', 'z="nan"', "line 7: vertex has .*needs 3 finite numbers"),
    "no coordinate": (' z="0.01"', "", 'line 7: <vertex> lacks its attribute "z"'),
    "clipping": ('"inside"', '"insight"', 'did you mean "inside"'),
    "object twice": ('id="9"', 'id="7"', "a second object with id 7"),
    "no object": (
        '<item objectid="7"',
        '<item objectid="8"',
        "names object 8, which is not defined",
    ),
    "stretch": ("0 2 0 -2 0 0 0 0 2", "0 2 0 -2 0 0 0 0 3", "stretches or shears"),
    "shear": ("0 2 0 -2 0 0 0 0 2", "2 0 0 1 1.7320508 0 0 0 2", "stretches or shears"),
    "transform": ("0 2 0 -2 0 0 0 0 2", "1", "it needs 12 finite numbers"),
    "component": (
        "<mesh><vertices/></mesh>",
        '<components><component objectid="8"/></components>',
        "line 18: component names object 8, which does not stand before it",
    ),
    "assembly of itself": (
        "<mesh><vertices/></mesh>",
        '<components><component objectid="9"/></components>',
        "component names object 9, which does not stand before it",
    ),
    "component outside": ("<build>", '<component objectid="7"/><build>', "is outside of an object"),
    "beam outside": ("<build>", "<b:beam/><build>", "<beam> is outside of an object"),
    "nothing": ('<item objectid="7"', '<item objectid="9"', "builds no beam lattice"),
}


@pytest.mark.parametrize("mistake", sorted(MISTAKES))
def test_a_mistake_is_named(mistake: str, tmp_path: Path):
    old, new, words = MISTAKES[mistake]
    assert old in MODEL
    with pytest.raises(StructureError, match=rf"l\.3mf.*{words}"):
        read(tmp_path / "l.3mf", MODEL.replace(old, new))


def test_a_package_that_unpacks_to_too_much_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Blanks compress a thousandfold."""
    monkeypatch.setattr(beam_lattice, "MAX_MODEL", 10_000)
    assert read(tmp_path / "a.3mf", MODEL).notes
    with pytest.raises(StructureError, match=r"takes 1,00.,... bytes unpacked; at most 10,000"):
        read(tmp_path / "b.3mf", MODEL + " " * 1_000_000)
    assert (tmp_path / "b.3mf").stat().st_size < 10_000


def test_other_zips_and_missing_files_are_named(tmp_path: Path):
    with zipfile.ZipFile(tmp_path / "z.3mf", "w") as package:
        package.writestr("_rels/.rels", "<Relationships/>")
    with pytest.raises(StructureError, match=r"z\.3mf: names no 3D model"):
        read_beam_lattice(tmp_path / "z.3mf")
    with zipfile.ZipFile(tmp_path / "e.3mf", "w"):
        pass
    with pytest.raises(StructureError, match=r"e\.3mf: has no part _rels/\.rels"):
        read_beam_lattice(tmp_path / "e.3mf")
    with pytest.raises(StructureError, match=r"no\.3mf: cannot be read"):
        read_beam_lattice(tmp_path / "no.3mf")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes]:
    path = tmp_path_factory.mktemp("3mf") / "l.3mf"
    read(path, MODEL)
    return path.with_name("broken.3mf"), path.read_bytes()


@settings(max_examples=150)
@given(place=st.integers(0, 10**6), byte=st.integers(0, 255), end=st.sampled_from([0, 10**6]))
def test_broken_bytes_are_read_or_refused_and_never_a_crash(
    whole: tuple[Path, bytes], place: int, byte: int, end: int
):
    path, content = whole
    place %= len(content)
    # The rest of the package, or nothing.
    path.write_bytes(content[:place] + bytes([byte]) + content[place + 1 : end])
    found = outcome(path)
    if isinstance(found, StructureError):
        assert "broken.3mf" in str(found)
    else:
        found.structure.validate()


@settings(max_examples=150)
@given(place=st.integers(0, 10**6), character=st.characters(codec="ascii"))
def test_a_broken_model_is_read_or_refused_and_never_a_crash(
    whole: tuple[Path, bytes], place: int, character: str
):
    """Within the checksums of the zip."""
    path, _ = whole
    place %= len(MODEL)
    write_package(path, [MODEL[:place] + character + MODEL[place + 1 :]])
    found = outcome(path)
    assert isinstance(found, StructureError) or len(found.structure.struts) <= 4


def outcome(path: Path) -> Imported | StructureError:
    try:
        return read_beam_lattice(path)
    except StructureError as failure:
        return failure
