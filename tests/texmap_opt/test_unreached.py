"""What a lattice does not reach, against shapes whose volumes are known."""

from pathlib import Path

import numpy as np
import pytest
from sound_case import FACES, case_of, write_stl

from fea.tet_mesh import TetMesh
from texmap_opt import run
from texmap_opt.cells.catalogue import cell_names, unit_cell
from texmap_opt.cells.drawn_cell import drawn_cell
from texmap_opt.combine.boolean import union
from texmap_opt.part import Part
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.structure import Structure
from texmap_opt.unreached import unreached

CELL_MM = 10.0
# A plate of 4 x 2 x 1 cells and a fin of 2 mm along its middle.
PLATE = ((0.0, 0.0, 0.0), (40.0, 20.0, 10.0))
FIN = ((0.0, 9.0, 10.0), (40.0, 11.0, 40.0))
LOW_FIN = ((0.0, 3.0, 10.0), (40.0, 5.0, 24.0))


def corners(block) -> np.ndarray:
    low, high = np.array(block)
    return np.array(
        [np.where([x, y, z], high, low) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    )


def surface(*blocks) -> TriMesh:
    # Overlapping by a millimetre: bodies that only touch are not one.
    lower = [((low[0], low[1], max(0.0, low[2] - 1)), high) for low, high in blocks]
    return union([TriMesh(corners(block), FACES) for block in lower])


def part(*blocks) -> Part:
    return Part(surface(*blocks), "part")


def tets(*blocks) -> TetMesh:
    """Blocks of tets 5 mm long and 1 mm wide and high, which need not be joined."""
    nodes, cells = [], []
    for low, high in blocks:
        size = np.subtract(high, low)
        n = (int(size[0] / 5), int(size[1]), int(size[2]))
        block = TetMesh.box(tuple(size.tolist()), n, origin=low)
        cells.append(block.tets + sum(map(len, nodes)))
        nodes.append(block.nodes)
    return TetMesh(np.concatenate(nodes), np.concatenate(cells))


def lattice() -> Structure:
    """Cube cells in the plate: struts end at its top, at z = 10."""
    block = drawn_cell(unit_cell("cube"), repeat=4, edge_mm=CELL_MM)
    inside = np.all(block.joints <= np.array(PLATE[1]), axis=1)
    return block.select(np.logical_and.reduce(inside[block.struts], axis=1))


def found(*blocks, structure: Structure | None = None, skin_mm: float = 0.0):
    structure = lattice() if structure is None else structure
    return unreached(structure, tets(*blocks), part(*blocks), cell_mm=CELL_MM, skin_mm=skin_mm)


def test_the_fin_beyond_one_cell_is_not_reached():
    """Its lowest 10 mm are within a cell's edge of the plate's top struts, the other 20 mm are not."""
    bare = found(PLATE, FIN)
    # The limit is a cylinder about the strut in the fin's middle: at 1 mm from it 0.05 mm lower, less
    # than the distance of tets' middles.
    np.testing.assert_allclose(bare.share, 40 * 2 * 20 / (8000 + 2400), rtol=1e-9)
    np.testing.assert_allclose(bare.largest_mm3, 1600, rtol=1e-9)
    assert bare.largest_at is not None
    np.testing.assert_allclose(bare.largest_at, (20, 10, 30), atol=3)
    said = bare.warning("rod") or ""
    assert "15 % of the part's volume" in said
    assert "(10 mm)" in said
    assert "smaller cells" in said
    assert "without holes" in (bare.warning("plate") or "")


def test_what_the_cells_fill_is_reached():
    assert found(PLATE).share == 0
    assert found(PLATE).largest_at is None
    assert found(PLATE).warning("rod") is None


def test_of_two_fins_the_larger_piece_is_named():
    bare = found(PLATE, LOW_FIN, FIN)
    # Of the low fin the highest 4 mm, beside the strut at y = 0: 5 and 6 mm away, it is more.
    assert bare.largest_mm3 == pytest.approx(1600, rel=1e-9)
    assert bare.share * (8000 + 2400 + 40 * 2 * 14) > 1600 + 40 * 2 * 4
    assert bare.largest_at is not None
    assert bare.largest_at[2] == pytest.approx(30, abs=3)


def test_skin_needs_no_struts():
    """A fin of 2 mm under skins of 1 mm is solid; of 0.6 mm, the middles of a third of its tets are not.

    They lie 1/4, 1/2 and 3/4 of their millimetre from its side.
    """
    assert found(PLATE, FIN, skin_mm=1.0).share == 0
    inner, whole = found(PLATE, FIN, skin_mm=0.6), found(PLATE, FIN)
    # The top 0.6 mm is skin too: a layer or less of twenty.
    np.testing.assert_allclose(inner.share, whole.share / 3, rtol=0.06)


def test_warped_cells_reach_as_far_as_they_are_large():
    small = lattice()
    scaled = Structure(
        small.joints, small.struts, small.radii, small.cut, np.full(len(small.struts), 1.5)
    )
    bare = found(PLATE, FIN, structure=scaled)
    np.testing.assert_allclose(bare.largest_mm3, 40 * 2 * 15, rtol=1e-9)


def test_walls_reach_along_their_axis():
    """Walls of the plate's lower millimetre, extruded along z, stand for all of its height."""
    flat = lattice()
    flat = flat.select((flat.joints[flat.struts][:, :, 2] == 0).all(axis=1))
    assert found(PLATE, FIN, structure=flat).share > 0.15
    walls = flat.extruded(np.array([0.0, 0.0, 1.0]), np.array([0.0, 40.0]))
    assert found(PLATE, FIN, structure=walls).share == 0


@pytest.mark.parametrize("name", [name for name in cell_names() if unit_cell(name).dimensions == 3])
def test_a_whole_lattice_of_any_cell_reaches_everything(name: str):
    """The widest hole of the library leaves sqrt(1/2) of an edge; so a share is never a cell's own."""
    lattice = drawn_cell(unit_cell(name), repeat=2, edge_mm=CELL_MM)
    block = ((0.0, 0.0, 0.0), (20.0, 20.0, 20.0))
    for cell_mm, reached in ((0.75 * CELL_MM, True), (0.2 * CELL_MM, False)):
        bare = unreached(lattice, tets(block), part(block), cell_mm=cell_mm, skin_mm=0.0)
        assert (bare.share == 0) == reached


def test_a_run_tells_of_a_fin_without_struts(tmp_path: Path):
    """The fin stands on the sound case's box, thinner than its cells."""
    fin = ((0.0, 9.5, 20.0), (40.0, 11.5, 50.0))
    whole = surface(((0.0, 0.0, 0.0), (40.0, 20.0, 20.0)), fin)
    case = case_of(tmp_path, ("skin_mm = 1.0", 'kind = "plate"\nskin_mm = 0'))
    write_stl(tmp_path / "box.stl", whole.vertices, whole.faces)
    report = run(case).report
    told = report["structure"]["unreached"]
    # 20 of the fin's 30 mm, of 40 x 2 mm; less where struts come near, more beside loose ends cut off.
    assert told["share"] == pytest.approx(1600 / 18400, rel=0.5)
    assert told["largest_at_mm"][2] > 25
    said = [warning for warning in report["warnings"] if "stays without holes" in warning]
    assert len(said) == 1
    assert f"{100 * told['share']:.2g} %" in said[0]
