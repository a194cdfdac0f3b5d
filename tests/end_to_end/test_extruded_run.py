"""Whole runs of 2.5-D cells: walls in a box, and walls as voids in it."""

from pathlib import Path

import numpy as np
import pytest
from sound_case import case_of

from texmap_opt import run
from texmap_opt.cache import StageCache
from texmap_opt.combine.boolean import intersection
from texmap_opt.export.run_folder import write_run
from texmap_opt.progress import Progress, Silent
from texmap_opt.run_result import Run

# The part is 40 x 20 x 20 mm, clamped at x = 0, its other end pulled down along z.
WALLS = ('"bcc"', '"square"')
BARE = ("skin_mm = 1.0", "skin_mm = 0")
SIZED = ("[output]", '[sizing]\nmethod = "none"\n[output]')
CELLS = 'cells = [8, 4]\nextrusion = "y"'


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> StageCache:
    """Both runs analyse the same part."""
    return StageCache(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory, cache: StageCache) -> Run:
    """Walls along y that bend in their plane, cells warped by the stress."""
    changes = (("cell_mm = 10.0", CELLS), ('"uniform"', '"least-squares"'))
    case = case_of(tmp_path_factory.mktemp("rod"), WALLS, BARE, SIZED, *changes)
    return run(case, cache=cache)


def test_the_grid_is_warped_in_the_plane_and_reaches_through_the_part(done: Run):
    """Cells count along x, then z; the grid runs along z, then x, with a margin of one."""
    grid = done.warp.grid
    assert (grid.dimensions, grid.cells) == (2, (6, 10))
    np.testing.assert_array_equal(grid.box.axes, [[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    np.testing.assert_allclose(grid.positions[..., 1], 10.0)
    assert done.report["warp"]["folded_cells"] == 0
    assert np.ptp(done.warp.wanted_size) > 0.5
    # Lines through the cells miss or hit a share of those in the part's sides.
    assert done.warp.occupied_mm3.sum() == pytest.approx(40 * 20 * 20, rel=0.03)


def test_walls_fill_the_part_from_end_to_end(done: Run):
    structure = done.filling.structure
    assert structure.extrusion is not None
    np.testing.assert_array_equal(structure.extrusion.axis, [0, 1, 0])
    assert structure.section == "wall"
    np.testing.assert_allclose(done.report["structure"]["mean_depth_mm"], 20, rtol=1e-12)
    assert set(structure.extrusion.depth) == {20.0}
    np.testing.assert_allclose(structure.joints[:, 1], 10)


def test_the_result_is_the_extruded_plane_net_inside_the_part(done: Run):
    """Formula and mesh agree: no wall is slanted to the part's ends, so only its sides differ."""
    report = done.report["result"]
    assert (report["connected_components"], report["closed_voids"]) == (1, 0)
    assert done.validity.printable
    inside = intersection(done.filling.lattice.surface, done.part.surface).volume
    # Single precision of the STL.
    assert report["volume_mm3"] == pytest.approx(inside, rel=1e-5)
    # Walls cut askew at the sides stand out by a corner, discs of cut joints are not counted.
    # The formula counts a wall near the part's side whole though some of its thickness stands out; how
    # many do depends on the warp, and so on the tets, which differ from run to run (0.1 to 1.8 % seen).
    assert done.filling.formula_mm3 == pytest.approx(inside, rel=0.03)


def test_the_frame_of_walls_is_analysed(done: Run):
    """A lattice of a third of the volume is softer than the solid, the more so bending its walls."""
    assert done.report["model"] == "frame"
    compliance = done.report["sizing"]["compliance_after_Nmm"]
    assert compliance > 3 * done.report["stress"]["compliance_Nmm"]


def test_all_files_are_written_but_the_beam_lattice(done: Run, tmp_path: Path):
    write_run(done, tmp_path / "out", Progress(Silent()))
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"part.stl", "structure.xml", "grid.vtu", "struts.vtp", "report.html"} <= names
    assert "lattice.3mf" not in names
    page = (tmp_path / "out" / "report.html").read_text()
    assert "walls extruded along" in page


def test_walls_as_voids_leave_the_rest_of_a_uniform_grid(tmp_path: Path, cache: StageCache):
    """Square tubes of 5 - 2 r between walls, at the sides of the part 5 - r less the skin.

    The load acts along the extrusion, which voids do not mind.
    """
    changes = (
        ("cell_mm = 10.0", 'cells = [8, 4]\nextrusion = "z"'),
        ("skin_mm = 1.0", 'skin_mm = 1.0\nkind = "plate"'),
    )
    done = run(case_of(tmp_path, WALLS, *changes), cache=cache)
    r, skin = 0.8, 1.0
    inner, side = 5 - 2 * r, 5 - r - skin
    tubes = (6 * inner + 2 * side) * (2 * inner + 2 * side)
    void = (20 - 2 * skin) * ((40 - 2 * skin) * (20 - 2 * skin) - tubes)
    # The inner wall of the skin is within the tolerance of 0.1 mm.
    assert 16000 - done.report["result"]["volume_mm3"] == pytest.approx(void, rel=0.03)
    assert done.report["sizing"]["compliance_after_Nmm"] is None


def test_walls_without_mechanics_are_a_warning(tmp_path: Path, cache: StageCache):
    """The load acts along the extrusion, and nothing is to be sized."""
    case = case_of(tmp_path, WALLS, BARE, SIZED, ("cell_mm = 10.0", "cells = [4, 2]"))
    done = run(case, cache=cache)
    assert done.filling.sized is None
    assert any("axis of extrusion" in warning for warning in done.report["warnings"])
