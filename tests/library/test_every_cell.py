"""Every XML file of the library: valid, tileable, and classified as its mechanisms say."""

from pathlib import Path

import numpy as np
import pytest
import xmlschema

from texmap_opt.cells.catalogue import alias_names, cell_names, unit_cell
from texmap_opt.cells.rigidity import maxwell_number, mechanisms
from texmap_opt.cells.unit_cell import SECTIONS, TICKS, TILINGS
from texmap_opt.cells.unit_cell_xml import read_unit_cell
from texmap_opt.structure.tile import tile

LIBRARY = Path(__file__).parents[2] / "library"
FILES = sorted(LIBRARY.glob("*.xml"))

# Joints and struts of a block of n x n x n cells. Octet: the corners and face centres of the cubes,
# four struts in each face and the twelve of the inner octahedron.
BLOCK_OF = {
    "bcc": lambda n: ((n + 1) ** 3 + n**3, 8 * n**3),
    "cube": lambda n: ((n + 1) ** 3, 3 * n * (n + 1) ** 2),
    # Middles of the cubes' edges, four tetrahedra and the middle of each cube; all struts inside.
    "diamond": lambda n: (3 * n * (n + 1) ** 2 + 5 * n**3, 16 * n**3),
    "octahedron": lambda n: (3 * n**2 * (n + 1), 12 * n**3),
    "octet": lambda n: ((n + 1) ** 3 + 3 * n**2 * (n + 1), 12 * n**2 * (n + 1) + 12 * n**3),
    # A square in each face, and the twelve struts between the squares.
    "tetrakaidecahedron": lambda n: (12 * n**2 * (n + 1), 12 * n**2 * (n + 1) + 12 * n**3),
    "vector": lambda n: ((n + 1) ** 3 + n**3, 3 * n * (n + 1) ** 2 + 8 * n**3),
}
MAXWELL = {
    "bcc": -13,
    "cube": -6,
    "diamond": -29,
    "octahedron": 0,
    "octet": 0,
    "tetrakaidecahedron": -30,
    "vector": -1,
}


@pytest.fixture(scope="module")
def schema() -> xmlschema.XMLSchema:
    return xmlschema.XMLSchema(LIBRARY / "unit_cell.xsd")


@pytest.fixture(params=FILES, ids=lambda path: path.stem)
def path(request) -> Path:
    return request.param


def test_the_library_is_what_the_catalogue_lists():
    assert cell_names() == [path.stem for path in FILES]
    assert set(BLOCK_OF) <= set(cell_names())


def test_an_alias_is_another_name_of_one_cell_and_no_cells_own_name():
    aliases = [alias for path in FILES for alias in read_unit_cell(path).aliases]
    assert len(set(aliases)) == len(aliases)
    assert not set(aliases) & set(cell_names())
    assert set(alias_names()) == set(aliases)
    assert unit_cell("kelvin").name == "tetrakaidecahedron"


def test_follows_the_schema(path: Path, schema: xmlschema.XMLSchema):
    schema.validate(path)


def test_is_named_after_its_file(path: Path):
    assert read_unit_cell(path).name == path.stem


def test_lies_in_the_unit_cube_and_reaches_its_faces(path: Path):
    cell = read_unit_cell(path)
    assert cell.joints.min() == 0
    assert cell.joints.max() == 1
    assert cell.section in SECTIONS
    assert cell.tiling in TILINGS


def test_tiles_into_one_connected_net_without_duplicates(path: Path):
    net = tile(read_unit_cell(path), (2, 3, 2))
    assert len(np.unique(net.joints, axis=0)) == len(net.joints)
    assert len(np.unique(np.sort(net.struts, axis=1), axis=0)) == len(net.struts)
    reached = np.zeros(len(net.joints), bool)
    reached[0] = True
    for _ in range(len(net.joints)):
        touched = reached[net.struts].any(axis=1)
        reached[net.struts[touched]] = True
    assert reached.all()


def test_opposite_faces_of_the_block_match(path: Path):
    """A mirrored block of even size matches too: its last cell ends as its first begins."""
    net = tile(read_unit_cell(path), (2, 2, 2))
    ticks = np.rint(net.joints * TICKS).astype(np.int64)
    for axis in range(3):
        across = np.delete(ticks, axis, axis=1)
        faces = [across[ticks[:, axis] == end] for end in (0, 2 * TICKS)]
        np.testing.assert_array_equal(*(np.unique(face, axis=0) for face in faces))


def test_no_two_struts_cross_without_a_joint(path: Path):
    """Struts that cross between their joints are not connected there, but would print as one."""
    net = tile(read_unit_cell(path), (2, 2, 2))
    a, b = net.joints[net.struts[:, 0]], net.joints[net.struts[:, 1]]
    i, j = np.triu_indices(len(a), 1)
    share = (net.struts[i][:, :, None] == net.struts[j][:, None, :]).any(axis=(1, 2))
    i, j = i[~share], j[~share]
    # Sampled densely enough to see a crossing of struts about half a cell long.
    t = np.linspace(0, 1, 21)[:, None, None]
    here, there = a + t * (b - a), a + t * (b - a)
    nearest = np.full(len(i), np.inf)
    for point in here:
        gaps = np.linalg.norm(point[i] - there[:, j], axis=-1)
        nearest = np.minimum(nearest, gaps.min(axis=0))
    assert nearest.min() > 0.1


def test_classification_is_that_of_the_mechanisms(path: Path):
    """Deshpande, Ashby, Fleck, Acta Mater. 49 (2001) 1035: bending when strain costs no stretch."""
    cell = read_unit_cell(path)
    bends = mechanisms(cell).strain_producing > 0
    assert cell.classification == ("bending" if bends else "stretching")


@pytest.mark.parametrize("name", sorted(BLOCK_OF))
@pytest.mark.parametrize("n", [1, 2, 5])
def test_block_has_the_joints_and_struts_of_its_closed_form(name: str, n: int):
    net = tile(unit_cell(name), (n, n, n))
    assert (len(net.joints), len(net.struts)) == BLOCK_OF[name](n)


@pytest.mark.parametrize("name", sorted(MAXWELL))
def test_maxwell_number(name: str):
    assert maxwell_number(unit_cell(name)) == MAXWELL[name]


def test_cube_shears_three_ways_and_bcc_stretches_two_ways_for_free():
    """A pin-jointed cube has three shears; half diagonals allow any stretch of constant volume."""
    assert mechanisms(unit_cell("cube")).strain_producing == 3
    assert mechanisms(unit_cell("bcc")).strain_producing == 2


@pytest.mark.parametrize(
    ("name", "valence", "length"),
    [
        ("octet", 12, 1 / np.sqrt(2)),
        ("kelvin", 4, 1 / (2 * np.sqrt(2))),
        ("diamond", 4, np.sqrt(3) / 4),
    ],
)
def test_as_many_struts_meet_at_every_joint_all_of_one_length(name, valence, length):
    """Deshpande, Fleck, Ashby, J. Mech. Phys. Solids 49 (2001) 1747: octet, connectivity 12.

    Warren, Kraynik, J. Appl. Mech. 64 (1997) 787: the Kelvin foam; diamond: bonds of sqrt(3)/4.
    """
    net = tile(unit_cell(name), (3, 3, 3))
    degree = np.bincount(net.struts.reshape(-1))
    inside = ((net.joints > 0.1) & (net.joints < 2.9)).all(axis=1)
    np.testing.assert_array_equal(degree[inside], valence)
    ends = net.joints[net.struts]
    np.testing.assert_allclose(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), length, rtol=1e-12)
