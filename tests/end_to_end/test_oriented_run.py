"""A whole run in a turned box, driven by the part's stress and by paint together."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from sound_case import case_of

from texmap_opt import run
from texmap_opt.given_drivers import given_drivers
from texmap_opt.run_result import Run
from texmap_opt.warp.cell_volumes import equivalent_edges
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.warped_grid import WarpedGrid, warped_grid
from texmap_opt.warp_inputs import warp_inputs

CENTRE = np.array([20.0, 10.0, 10.0])
WARP = """method = "successive-approximation"
weights = "midpoint"
driver = ["von-mises", "paint"]
driver_weights = [0.2, 1.0]
axes = [[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]]
fixed_faces = ["-z"]
[[paint]]
region = { sphere = { center = [20, 10, 10], radius = 5 } }
value = 2
"""
# The struts as holes: sizing, which other runs show, knows nothing of the grid.
PLATE = ("skin_mm = 1.0", 'skin_mm = 1.0\nkind = "plate"')


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("oriented")
    return run(case_of(folder, PLATE, ('method = "uniform"\n', WARP)))


def without_paint(done: Run) -> Grid:
    """The warped grid of the same case with a painted value of 1."""
    case, stress, rest = done.case, done.stress, done.warp.grid.at_rest
    given = given_drivers(case, rest)
    (region,) = given.paint
    given = replace(given, paint=(replace(region, value=1.0),))
    return warped_grid(warp_inputs(case, done.part, stress, rest, None, given)).grid


def test_the_box_is_turned_and_its_cells_cover_the_part_along_its_axes(done: Run):
    """Along (0.8, 0.6, 0) the 40 x 20 x 20 part spans 44 mm, along (-0.6, 0.8, 0) 40 mm."""
    grid = done.warp.grid
    np.testing.assert_allclose(grid.box.axes, [[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]])
    # 4 x 4 x 2 cells of 11 x 10 x 10 mm, and a margin of one on every side.
    assert grid.cells == (6, 6, 4)
    np.testing.assert_allclose(grid.uniform_edge, [11, 10, 10])
    # Corners stay where they are: the first is one cell outside the part's lowest coordinates.
    corner = np.array([-11, -34, -10]) @ grid.box.axes
    np.testing.assert_allclose(grid.positions[0, 0, 0], corner, atol=1e-9)


def test_a_fixed_face_stays_and_the_others_slide(done: Run):
    grid = done.warp.grid
    moved = np.abs(grid.nodes - grid.at_rest.nodes)
    assert moved[:, :, 0].max() == 0
    assert moved[:, :, -1, 2].max() == 0
    assert moved[:, :, -1, :2].max() > 0.1


def test_painted_cells_are_smaller_and_nothing_folds(done: Run):
    size = equivalent_edges(done.warp.grid.positions)
    centres = done.warp.grid.positions.reshape(-1, 3)[done.warp.grid.corners].mean(axis=1)
    nearest = np.argmin(np.linalg.norm(centres - CENTRE, axis=1))
    unpainted = equivalent_edges(without_paint(done).positions).ravel()[nearest]
    # By 8 %: the sphere is as large as one of these cells, so its half size is asked for in the middle
    # of one alone, and smoothed.
    assert size.ravel()[nearest] < 0.95 * unpainted
    assert done.report["warp"]["folded_cells"] == 0
    assert done.warp.converged


def test_the_lattice_lies_in_the_part_and_the_result_is_printable(done: Run):
    joints = done.trimmed.structure.joints
    assert np.all(joints > -1e-9)
    assert np.all(joints < np.array([40, 20, 20]) + 1e-9)
    # Struts of a turned bcc grid run along its turned diagonals, not along those of the part.
    ends = joints[done.trimmed.structure.struts]
    along = ends[:, 1] - ends[:, 0]
    along = np.abs(
        (along / np.linalg.norm(along, axis=1, keepdims=True)) @ done.warp.grid.box.axes.T
    )
    np.testing.assert_allclose(np.median(along, axis=0), 1 / np.sqrt(3), atol=0.08)
    assert done.report["result"]["watertight"]
    assert done.report["result"]["connected_components"] == 1


def test_what_the_cache_keeps_of_a_warp_is_all_of_it(done: Run):
    again = WarpedGrid.from_arrays(done.warp.to_arrays())
    assert asdict(again.quality) == asdict(done.warp.quality)
    assert again.measures == done.warp.measures
    np.testing.assert_array_equal(again.grid.positions, done.warp.grid.positions)
    np.testing.assert_array_equal(again.grid.free, done.warp.grid.free)
    np.testing.assert_array_equal(again.stress, done.warp.stress)
    np.testing.assert_array_equal(again.occupied_mm3, done.warp.occupied_mm3)


def test_the_part_in_the_cells_is_the_part(done: Run):
    """Up to what a plane through a cell says of a corner: a few per cent on cells this coarse."""
    np.testing.assert_allclose(done.warp.occupied_mm3.sum(), 16_000, rtol=0.15)
