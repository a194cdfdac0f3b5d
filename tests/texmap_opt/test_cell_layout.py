"""Zones of a case: which unit cell goes where, and what is said when they select nothing."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from texmap_opt.box import Box
from texmap_opt.case import DesignCase
from texmap_opt.case_reference import case_reference
from texmap_opt.cell_layout import (
    case_cells,
    cell_layout,
    planned_layout,
    require_zones_in_grid,
)
from texmap_opt.errors import CaseError
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.quality import quality_for
from texmap_opt.warp.warped_grid import WarpedGrid

CASE = """
[part]
builtin = "cantilever"
length_mm = 40
width_mm = 20
height_mm = 20
[material]
name = "PA12"
[[support]]
region = { plane = { point = [0, 0, 0], normal = [1, 0, 0] } }
[[load]]
region = { plane = { point = [40, 0, 0], normal = [1, 0, 0] } }
force_N = [0, 0, -10]
[lattice]
cell = "CELL"
cells = CELLS
radius_mm = 0.8
"""
LIBRARY = Path(__file__).parents[2] / "library"
BOUNDS = np.array([[-10.0, -10, -10], [50, 30, 30]])


def case_of(
    zones: str, folder: Path, *, cell: str = "octet", cells: str = "[4, 2, 2]"
) -> DesignCase:
    path = folder / "case.toml"
    path.write_text(CASE.replace("CELLS", cells).replace("CELL", cell) + zones)
    return DesignCase.from_toml(path)


def warped(grid: Grid, *, f: np.ndarray | None = None) -> WarpedGrid:
    """As the warp leaves it: f as given; material in all cells but the margin's."""
    centres = grid.centres
    inside = np.all((centres > grid.box.low + 9) & (centres < grid.box.high - 9), axis=1)
    wanted, d = np.ones(grid.cell_count), grid.dimensions
    stress = np.zeros((0, grid.cell_count, d, d))
    return WarpedGrid(
        grid=grid,
        method="uniform",
        iterations=0,
        converged=True,
        message="",
        measures={},
        quality=quality_for(grid, wanted, stress, weights=inside.astype(float)),
        f=np.ones(grid.cell_count) if f is None else f,
        wanted_size=wanted,
        stress=stress,
        occupied_mm3=inside.astype(float),
    )


def uniform() -> Grid:
    """Cells of 10 mm: 4 x 2 x 2 over the part, and a margin of one."""
    return Grid.uniform(Box.aligned(BOUNDS), (6, 4, 4))


def kinds_of(case: DesignCase, warp: WarpedGrid) -> np.ndarray:
    cells = case_cells(case)
    return np.array([cell.name for cell in cells.cells])[cell_layout(case, cells, warp).kinds]


def test_a_region_takes_the_cells_whose_centre_is_in_it(tmp_path):
    zone = '[[zone]]\ncell = "kelvin"\nregion = { box = [[0, 0, 10], [40, 20, 30]] }'
    kinds = kinds_of(case_of(zone, tmp_path), warped(uniform()))
    assert (kinds[1:5, 1:3, 2:4] == "tetrakaidecahedron").all()
    assert (kinds == "tetrakaidecahedron").sum() == 4 * 2 * 2


def test_a_region_is_met_in_space_where_the_warp_took_the_cells(tmp_path):
    zone = '[[zone]]\ncell = "kelvin"\nregion = { box = [[0, -10, -10], [12, 30, 30]] }'
    case, grid = case_of(zone, tmp_path), uniform()
    nodes = grid.nodes.copy()
    nodes[1:-1, ..., 0] -= 6
    # Along x the centres are at -5, 5, 15... mm, and then at -8, -1, 9, 19...
    for warp, layer in ((warped(grid), 1), (warped(grid.with_nodes(nodes)), 2)):
        chosen = kinds_of(case, warp) == "tetrakaidecahedron"
        assert chosen[layer].all()
        assert not np.delete(chosen, layer, axis=0).any()


def test_before_the_warp_zones_by_f_are_left_out(tmp_path):
    by_region = '[[zone]]\ncell = "kelvin"\nregion = { box = [[0, 0, 10], [40, 20, 30]] }\n'
    by_f = '[[zone]]\ncell = "bcc"\nf_least = 0.5\n'
    case = case_of(by_region + by_f, tmp_path)
    layout = planned_layout(case, case_cells(case), uniform())
    assert [cell.name for cell in layout.cells] == ["octet", "tetrakaidecahedron", "bcc"]
    without = case_of(by_region, tmp_path)
    known = cell_layout(without, case_cells(without), warped(uniform())).kinds
    np.testing.assert_array_equal(layout.kinds, known)
    # Negative control: where f is known, the later zone takes them all.
    assert (kinds_of(case, warped(uniform())) == "bcc").all()


def test_f_takes_the_cells_between_its_limits(tmp_path):
    f = np.linspace(0.6, 1.7, uniform().cell_count)
    zone = '[[zone]]\ncell = "bcc"\nf_least = 1.1\nf_most = 1.4'
    kinds = kinds_of(case_of(zone, tmp_path), warped(uniform(), f=f)).ravel()
    np.testing.assert_array_equal(kinds == "bcc", (f >= 1.1) & (f <= 1.4))


def test_a_block_counts_from_the_corner_of_the_parts_box(tmp_path):
    zone = '[[zone]]\ncell = "bcc"\ngrid_cells = [[0, 0, -1], [1, 1, 0]]'
    kinds = kinds_of(case_of(zone, tmp_path), warped(uniform()))
    assert (kinds[1:3, 1:3, 0:2] == "bcc").all()
    assert (kinds == "bcc").sum() == 8


def test_a_block_of_an_extruded_lattice_is_in_the_order_of_its_cells(tmp_path):
    """Extruded along y the grid's axes are z and x; the case names x before z."""
    zone = '[[zone]]\ncell = "square"\ngrid_cells = [[0, 0], [3, 0]]'
    case = case_of(zone, tmp_path, cell="octagon", cells='[4, 2]\nextrusion = "y"')
    grid = Grid.uniform(Box.aligned(BOUNDS, extrusion="y"), (4, 6))
    kinds = kinds_of(case, warped(grid))
    assert (kinds[1, 1:5] == "square").all()
    assert (kinds == "square").sum() == 4


def test_later_zones_win_and_one_may_restore_the_cell_of_the_lattice(tmp_path):
    zones = """
[[zone]]
cell = "kelvin"
region = { box = [[0, 0, 0], [40, 20, 20]] }
[[zone]]
cell = "octet"
grid_cells = [[1, 0, 0], [2, 1, 1]]
[[zone]]
cell = "tetrakaidecahedron"
grid_cells = [[2, 0, 0], [2, 0, 0]]
"""
    case = case_of(zones, tmp_path)
    assert [cell.name for cell in case_cells(case).cells] == ["octet", "tetrakaidecahedron"]
    kinds = kinds_of(case, warped(uniform()))
    assert (kinds == "tetrakaidecahedron").sum() == 16 - 8 + 1


def test_zones_come_back_from_the_file_that_a_run_writes(tmp_path):
    zones = """
[[zone]]
cell = "kelvin"
region = { sphere = { center = [0, 0, 0], radius = 9 } }
[[zone]]
cell = "bcc"
grid_cells = [[1, 0, 0], [2, 1, 1]]
[[zone]]
cell = "cube"
f_least = 1.2
"""
    written = tmp_path / "again.toml"
    written.write_text(case_of(zones, tmp_path).to_toml())
    again = DesignCase.from_toml(written)
    assert [zone.cell for zone in again.zones] == ["kelvin", "bcc", "cube"]
    assert again.zones[1].grid_cells.tolist() == [[1, 0, 0], [2, 1, 1]]
    assert again.zones[2].f == (1.2, np.inf)


@pytest.mark.parametrize(
    ("zone", "words"),
    [
        ("", "cell is missing"),
        ('cell = "bcc"', "no choice of cells"),
        ('cell = "bcc"\nf_least = 1\ngrid_cells = [[0, 0, 0], [1, 1, 1]]', "several choices"),
        ('cell = "bcc"\nf_least = 2\nf_most = 1', "f_least = 2: is above f_most = 1"),
        ('cell = "bcc"\nf_least = 0', "f_least = 0: must be above 0"),
        ('cell = "bcc"\nregion = { normal = [0, 0, 1] }', "zone fills space"),
        ('cell = "bcc"\nregion = { ball = 1 }', "there is no such region"),
        ('cell = "bcc"\ngrid_cells = [[0, 0, 0]]', "indices of two cells"),
        ('cell = "bcc"\ngrid_cells = [[0, 0, 0], [1, 1]]', "indices of two cells"),
        ('cell = "bcc"\ngrid_cells = [[0, 0, 0.5], [1, 1, 1]]', "indices of two cells"),
        ('cell = "bcc"\ngrid_cells = [[0, 0, 2], [1, 1, 1]]', "swap them"),
        ('cell = "bcc"\nkind = "octet"', "there is no such key"),
    ],
)
def test_a_zone_that_cannot_be_read_is_refused(zone, words, tmp_path):
    with pytest.raises(CaseError, match=re.escape(words)) as refused:
        case_of(f"[[zone]]\n{zone}", tmp_path)
    assert "case.toml: [[zone]] 1" in str(refused.value)


@pytest.mark.parametrize(
    ("cell", "words"),
    [("octed", 'did you mean "octet"?'), ("honeycomb", "2 dimensions"), ("my.xml", "my.xml")],
)
def test_a_cell_that_does_not_go_with_the_others_is_refused(cell, words, tmp_path):
    zone = f'[[zone]]\ncell = "{cell}"\nf_least = 1'
    with pytest.raises(CaseError, match=re.escape(words)) as refused:
        case_cells(case_of(zone, tmp_path))
    assert f'case.toml: [[zone]] 1 cell = "{cell}"' in str(refused.value)


def test_a_cell_that_differs_in_its_tiling_alone_is_another_and_needs_another_name(tmp_path):
    own = (LIBRARY / "diamond.xml").read_text().replace('"translate"', '"mirror"')
    (tmp_path / "own.xml").write_text(own.replace('symmetry="cubic"', ""))
    zone = '[[zone]]\ncell = "own.xml"\nf_least = 1'
    with pytest.raises(CaseError, match=r'named "diamond".* give each unit cell a name of'):
        case_cells(case_of(zone, tmp_path, cell="diamond"))


@pytest.mark.parametrize(
    ("choice", "words"),
    [
        (
            "f_least = 1.5",
            "f_least = 1.5: no cell in the part has such an f, which runs from 1 to 1",
        ),
        ("region = { box = [[80, 0, 0], [90, 9, 9]] }", "the box from [80, 0, 0] to [90, 9, 9] mm"),
        ("grid_cells = [[-1, -1, -1], [4, -1, -1]]", "none of these cells has part in it"),
    ],
)
def test_a_zone_that_selects_nothing_says_why(choice, words, tmp_path):
    case = case_of(f'[[zone]]\ncell = "bcc"\n{choice}', tmp_path)
    with pytest.raises(CaseError, match=re.escape(words)) as refused:
        cell_layout(case, case_cells(case), warped(uniform()))
    assert "case.toml: [[zone]] 1" in str(refused.value)


@pytest.mark.parametrize(
    ("block", "words"),
    [
        ("[[0, 0, 0], [5, 1, 1]]", "are [-1, -1, -1] to [4, 2, 2] with margin_cells = 1"),
        ("[[-2, 0, 0], [1, 1, 1]]", "goes beyond the grid"),
        ("[[0, 0], [1, 1]]", "needs 3 indices"),
    ],
)
def test_a_block_beyond_the_grid_is_refused_before_anything_is_computed(block, words, tmp_path):
    case = case_of(f'[[zone]]\ncell = "bcc"\ngrid_cells = {block}', tmp_path)
    with pytest.raises(CaseError, match=re.escape(words)):
        require_zones_in_grid(case, uniform())
    inside = replace(case, zones=())
    require_zones_in_grid(inside, uniform())


def test_the_reference_lists_the_keys_of_a_zone():
    page = case_reference()
    section = page[page.index("## `[[zone]]`") : page.index("## `[warp]`")]
    for key in ("cell", "region", "f_least", "f_most", "grid_cells"):
        assert f"| `{key}` |" in section
