"""Every XML file of the library: valid, tileable, joined only at joints, as README.md says."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse.csgraph
import xmlschema

from texmap_opt.cells import catalogue
from texmap_opt.cells.catalogue import alias_names, cell_names
from texmap_opt.cells.rigidity import maxwell_number, mechanisms
from texmap_opt.cells.unit_cell import SECTIONS, TICKS, UnitCell
from texmap_opt.cells.unit_cell_xml import read_unit_cell
from texmap_opt.structure.net import Net
from texmap_opt.structure.segment_distance import point_distance, segment_distance
from texmap_opt.structure.tile import tile

LIBRARY = Path(__file__).parents[2] / "library"
FILES = sorted(LIBRARY.glob("*.xml"))
# Figure 5a of Chen (2007) and what engineers ask for beside it; figure 5b, likewise.
IN_SPACE = (
    "tetrahedron octahedron cube vector icosahedron dodecahedron tetrakaidecahedron "
    "triacontahedron octet bcc fcc diamond rhombic-dodecahedron cuboctahedron column"
)
IN_PLANE = (
    "octagon rubber-band iso-material bi-stable honeycomb re-entrant triangular kagome square"
)
# Share of the cell's edge that struts without a common joint keep from each other: below the 0.08 of
# the next-but-one links of a curved beam, far above rounding.
CLEARANCE = 0.05

# Reading checks a cell in full, which takes up to a third of a second.
unit_cell = cache(catalogue.unit_cell)


@pytest.fixture(scope="module")
def schema() -> xmlschema.XMLSchema:
    return xmlschema.XMLSchema(LIBRARY / "unit_cell.xsd")


@pytest.fixture(scope="module", params=FILES, ids=lambda path: path.stem)
def path(request) -> Path:
    return request.param


@pytest.fixture(scope="module")
def cell(path: Path) -> UnitCell:
    return unit_cell(path.stem)


@pytest.fixture(scope="module")
def block(cell: UnitCell) -> Net:
    """Three cells along each axis: the middle one has all its neighbours."""
    return tile(cell, (3,) * cell.dimensions)


def test_the_library_is_what_the_catalogue_lists_and_the_design_asks_for():
    assert cell_names() == [path.stem for path in FILES]
    by_dimensions = {
        d: {name for name in cell_names() if unit_cell(name).dimensions == d} for d in (2, 3)
    }
    assert by_dimensions[3] == set(IN_SPACE.split())
    assert by_dimensions[2] == set(IN_PLANE.split())


def test_an_alias_is_another_name_of_one_cell_and_no_cells_own_name():
    aliases = [alias for name in cell_names() for alias in unit_cell(name).aliases]
    assert len(set(aliases)) == len(aliases)
    assert not set(aliases) & set(cell_names())
    assert set(alias_names()) == set(aliases)
    assert unit_cell("kelvin").name == "tetrakaidecahedron"


def test_follows_the_schema(path: Path, schema: xmlschema.XMLSchema):
    schema.validate(path)


def test_lies_in_the_unit_cube_or_square_and_reaches_its_sides(path: Path, cell: UnitCell):
    assert cell.name == path.stem
    np.testing.assert_array_equal(cell.joints.min(axis=0), 0)
    np.testing.assert_array_equal(cell.joints.max(axis=0), 1)
    assert cell.section in SECTIONS[cell.dimensions]
    assert len(cell.mirrored) == len(cell.proportions) == cell.dimensions


def test_tiles_into_one_connected_net_without_duplicates(block: Net):
    assert len(np.unique(block.joints, axis=0)) == len(block.joints)
    assert len(np.unique(np.sort(block.struts, axis=1), axis=0)) == len(block.struts)
    n = len(block.joints)
    graph = scipy.sparse.coo_array((np.ones(len(block.struts)), tuple(block.struts.T)), (n, n))
    assert scipy.sparse.csgraph.connected_components(graph, directed=False)[0] == 1


def test_opposite_faces_of_the_block_match(cell: UnitCell):
    """Joints, struts and radii. A mirrored block of even size ends as it begins."""
    net = tile(cell, (2,) * cell.dimensions)
    ticks = np.rint(net.joints * TICKS).astype(np.int64)
    for axis in range(cell.dimensions):
        across = np.delete(ticks, axis, axis=1)
        near, far = (ticks[:, axis] == end * TICKS for end in (0, 2))
        assert near.any()
        low, high = (np.unique(across[face], axis=0) for face in (near, far))
        np.testing.assert_array_equal(low, high)
        lines = [
            {
                (frozenset(map(tuple, across[ends].tolist())), float(radius))
                for ends, radius in zip(net.struts, net.relative_radius, strict=True)
                if face[ends].all()
            }
            for face in (near, far)
        ]
        assert lines[0] == lines[1]


def test_no_strut_is_loose_within_the_block(block: Net):
    inside = ((block.joints >= 1) & (block.joints <= 2)).all(axis=1)
    assert block_degree(block)[inside].min() >= 2


def test_no_two_struts_meet_but_at_a_joint(cell: UnitCell):
    """Struts that cross or overlap between joints are not connected, but would print as one."""
    assert least_clearance(tile(cell, (2,) * cell.dimensions), cell) > CLEARANCE


@pytest.mark.parametrize(
    ("name", "mirrored"),
    # Side by side, face diagonals of tetrahedra cross; so do those of a square cell with two of them.
    [("tetrahedron", (False,) * 3), ("triangular", None)],
)
def test_crossing_struts_are_found(name: str, mirrored: tuple[bool, ...] | None):
    cell = unit_cell(name)
    if mirrored is not None:
        crossing = replace(cell, mirrored=mirrored)
    else:
        corners = [cell.joint_names.index(joint) for joint in ("c00", "c11", "c01", "c10")]
        crossing = replace(cell, struts=np.array(corners).reshape(2, 2), relative_radius=np.ones(2))
    assert least_clearance(tile(crossing, (2,) * cell.dimensions), cell) < 1e-9


def test_a_joint_inside_a_strut_is_found():
    """The middle of the triangular cell's lower edge, hung on the corner above."""
    cell = unit_cell("kagome")
    a, b = (cell.joint_names.index(joint) for joint in ("c00", "c10"))
    longer = np.array([*cell.struts.tolist(), [a, b]])
    wrong = replace(cell, struts=longer, relative_radius=np.ones(len(longer)))
    assert least_clearance(tile(wrong, (2, 2)), cell) < 1e-9


def test_classification_is_that_of_the_mechanisms(cell: UnitCell):
    """Deshpande, Ashby, Fleck, Acta Mater. 49 (2001) 1035: bending when strain costs no stretch."""
    bends = mechanisms(cell).strain_producing > 0
    assert cell.classification == ("bending" if bends else "stretching")


def test_the_readmes_example_is_a_cell(tmp_path: Path, schema: xmlschema.XMLSchema):
    text = (LIBRARY / "README.md").read_text(encoding="utf-8")
    example = next(
        block for block in re.findall(r"```xml\n(.*?)```", text, re.DOTALL) if "..." not in block
    )
    file = tmp_path / "my_cell.xml"
    file.write_text(example, encoding="utf-8")
    schema.validate(file)
    assert read_unit_cell(file).name


def test_the_readmes_table_is_the_library():
    text = (LIBRARY / "README.md").read_text(encoding="utf-8")
    rows = [[word.strip() for word in line.split("|")[1:-1]] for line in text.splitlines()]
    table = {row[0].split(",")[0]: row[1:6] for row in rows if len(row) == 7}
    for name in cell_names():
        cell = unit_cell(name)
        assert table[name] == [
            str(len(cell.joints)),
            str(len(cell.struts)),
            str(maxwell_number(cell)),
            cell.classification,
            cell.symmetry,
        ]


def block_degree(net: Net) -> np.ndarray:
    return np.bincount(net.struts.ravel(), minlength=len(net.joints))


def least_clearance(net: Net, cell: UnitCell) -> float:
    """Least distance of struts that share no joint, and of joints from struts of which they are no end.

    The first sees crossings; the second also struts that overlap, or that pass through a joint.
    """
    ends = (net.joints * np.array(cell.proportions))[net.struts]
    i, j = np.triu_indices(len(ends), 1)
    share = (net.struts[i][:, :, None] == net.struts[j][:, None, :]).any(axis=(1, 2))
    apart = segment_distance(ends[i[~share]], ends[j[~share]])
    points = net.joints * np.array(cell.proportions)
    strut, joint = np.indices((len(ends), len(points))).reshape(2, -1)
    other = (net.struts[strut] != joint[:, None]).all(axis=1)
    through = point_distance(points[joint[other]], ends[strut[other]])
    return float(min(apart.min(initial=np.inf), through.min()))
