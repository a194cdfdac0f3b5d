"""A graph of another program becomes a unit cell that the library reads, or is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from texmap_opt import cli
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.drawn_cell import drawn_cell
from texmap_opt.cells.unit_cell_xml import read_unit_cell
from texmap_opt.errors import CellError, OutputError
from texmap_opt.export.unit_cell import write_unit_cell

# As nTopology's sample of a cube (github.com/nTopology/LTCX), in inches.
CORNERS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
EDGES = [(a, b) for a in range(8) for b in range(a) if bin(a ^ b).count("1") == 1]
CUBE = (
    '<graph id="0" name="cube unit" units="in"><nodegroup>'
    + "".join(
        f'<node id="{i}" x="{x}" y="{y}" z="{z}" r=".1"/>' for i, (x, y, z) in enumerate(CORNERS)
    )
    + "</nodegroup><beamgroup>"
    + "".join(f'<beam id="{i}" n1="{a}" n2="{b}"/>' for i, (a, b) in enumerate(EDGES))
    + "</beamgroup></graph>"
)


@pytest.mark.parametrize("name", ["octet", "bcc", "tetrakaidecahedron"])
def test_a_cell_of_the_library_survives(name: str, tmp_path: Path):
    cell = unit_cell(name)
    moved = drawn_cell(cell)
    moved = replace(moved, joints=moved.joints * [1, 2, 1] + [5, -3, 1 / 3])
    write_unit_cell(tmp_path / "c.xml", moved, name="again", source="a test")
    again = read_unit_cell(tmp_path / "c.xml")
    assert sorted(map(tuple, again.ticks.tolist())) == sorted(map(tuple, cell.ticks.tolist()))
    assert len(again.struts) == len(cell.struts)
    np.testing.assert_allclose(again.proportions, [1, 2, 1])
    np.testing.assert_array_equal(again.relative_radius, 1)
    assert again.classification == cell.classification


def test_the_command_makes_a_cell_of_a_published_graph(tmp_path: Path, capsys):
    (tmp_path / "cube.ltcx").write_text(CUBE)
    path = tmp_path / "mine.xml"
    with pytest.raises(SystemExit) as ended:
        cli.main(["convert", str(tmp_path / "cube.ltcx"), "-o", str(path), "--cell", "mine"])
    assert ended.value.code == 0
    cell = read_unit_cell(path)
    assert (cell.name, cell.source, cell.symmetry) == ("mine", "cube.ltcx", "cubic")
    assert len(cell.struts) == 12
    assert capsys.readouterr().out == f"{path}: 8 joints, 12 round struts\n"


def test_the_command_takes_a_word_of_tiling_for_each_axis(tmp_path: Path, capsys):
    """Struts that taper are said to have their means: half of 0.1 inches is 1.27 mm off."""
    (tmp_path / "cube.ltcx").write_text(CUBE.replace('r=".1"', 'r=".2"', 1))
    path = tmp_path / "mine.xml"
    arguments = ["convert", str(tmp_path / "cube.ltcx"), "-o", str(path), "--cell", "mine"]
    with pytest.raises(SystemExit) as ended:
        cli.main([*arguments, "--tiling", "mirror mirror mirror"])
    assert ended.value.code == 0
    assert read_unit_cell(path).mirrored == (True, True, True)
    note, _ = capsys.readouterr().out.splitlines()
    assert note.startswith("note: mine.xml: 3 struts taper")
    assert note.endswith("by up to 1.27 mm")


def test_what_does_not_tile_is_refused_and_not_written(tmp_path: Path):
    """Without one strut the cube's faces do not match; reflected they do."""
    cube = drawn_cell(unit_cell("cube"))
    less = cube.select(np.arange(12) > 0)
    with pytest.raises(CellError, match=r"c\.xml, line"):
        write_unit_cell(tmp_path / "c.xml", less, name="less", source="a test")
    assert not list(tmp_path.iterdir())


def test_struts_in_a_plane_are_no_cell(tmp_path: Path):
    flat = drawn_cell(unit_cell("cube"))
    flat = flat.select((flat.joints[flat.struts][..., 2] == 0).all(axis=1))
    with pytest.raises(OutputError, match="lie in a plane or are walls"):
        write_unit_cell(tmp_path / "c.xml", flat, name="flat", source="a test")
