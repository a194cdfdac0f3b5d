"""What the report says and shows of a warp."""

import json

import numpy as np
import pytest

from fea.effective_stiffness import EffectiveStiffness
from texmap_opt.box import Box
from texmap_opt.report.histograms import angle_shares, ratio_counts
from texmap_opt.report.plots import PlotData
from texmap_opt.report.run_plots import run_plots
from texmap_opt.report.run_scenes import hexahedra, mean_edge
from texmap_opt.report.warp_numbers import warp_numbers
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.structure import Structure
from texmap_opt.warp.cell_volumes import equivalent_edges
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.quality import quality, stresses, wanted_sizes
from texmap_opt.warp.warped_grid import WarpedGrid
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.warping_function import WarpingFunction

BOUNDS = np.array([[0.0, 0.0, 0.0], [4.0, 2.0, 2.0]])
SHEAR = np.array([0, 0, 0, 0, 0, 0.5])
CUBIC = EffectiveStiffness(np.diag([2.0, 2, 2, 0.5, 0.5, 0.5]))


def warped(stress=SHEAR, *, box=None, turned_deg=0.0) -> WarpedGrid:
    """A grid under one stress, all of it turned in its first plane."""
    box = box or Box.aligned(BOUNDS)
    background = BackgroundGrid.covering(box, 0.5)
    field = np.broadcast_to(stress, (*background.shape, 6))
    f = WarpingFunction.on_grid(background, np.zeros(background.shape), SizeLaw(), stress=field)
    grid = Grid.uniform(box, (4, 2, 2)[: box.dimensions])
    a, turn = np.radians(turned_deg), np.eye(box.dimensions)
    turn[:2, :2] = [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
    grid = grid.with_nodes(grid.nodes @ turn.T)
    return WarpedGrid(
        grid=grid,
        method="least-squares",
        iterations=3,
        converged=True,
        message="",
        measures={"gradient_norm": 1e-7},
        quality=quality(grid, f, stiffness=CUBIC),
        f=np.ones(grid.cell_count),
        wanted_size=wanted_sizes(grid, f),
        stress=stresses(grid, f),
        occupied_mm3=np.ones(grid.cell_count),
    )


def plots_of(warp: WarpedGrid, joints, struts) -> PlotData:
    radii = np.full((len(struts), 2), 0.1)
    cut, size = np.zeros(len(joints), bool), np.ones(len(struts))
    structure = Structure(np.array(joints, float), np.array(struts), radii, cut, size)
    part = TriMesh(np.array([[0.0, 0, 0], [4, 0, 0], [0, 2, 0], [0, 0, 2]]), TETRAHEDRON)
    return run_plots(warp, structure, part, utilisation=None)


TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


@pytest.mark.parametrize("box", [Box.aligned(BOUNDS), Box.aligned(BOUNDS, extrusion="z")])
def test_the_numbers_are_json_and_the_energy_of_cells_along_the_tension_is_half(box):
    """Shear is tension along the diagonal: stiffness 2 there against 2 x 0.5 in the box's axes."""
    numbers = json.loads(
        json.dumps(warp_numbers(warped(box=box, turned_deg=45.0)), allow_nan=False)
    )
    assert numbers["measures"] == {"gradient_norm": 1e-7}
    assert numbers["dimensions"] == box.dimensions
    energy = numbers["energy"]
    np.testing.assert_allclose(
        [energy["warped"], energy["best"], energy["worst"], energy["share"]], [0.5, 0.5, 1, 1]
    )
    sizes = numbers["histograms"]["size_ratio"]
    middle = sizes["cells"].index(max(sizes["cells"]))
    assert sizes["edges"][middle] < 1 < sizes["edges"][middle + 1]
    assert sum(sizes["cells"]) == np.prod(numbers["cells"])
    angle = numbers["histograms"]["angle"]
    # All weight is in the plane of the shear, at 0 now and at 45 degrees in the box.
    assert angle["share"][0] == pytest.approx(1) or box.dimensions == 3
    assert angle["share_unturned"][-1] > 0.3


def test_without_a_direction_of_the_stress_there_are_no_angles():
    warp = warped(np.array([1.0, 1, 1, 0, 0, 0]))
    numbers = warp_numbers(warp)
    assert numbers["turn_deg"] is None and "angle" not in numbers["histograms"]
    plots = plots_of(warp, [[0, 0, 0], [1, 0, 0]], [[0, 1]])
    assert plots.turns_deg is None and plots.strut_angles_deg is None
    assert plots.wanted_mm is not None and len(plots.layers) == 3


def test_struts_along_the_largest_principal_stress_have_angle_zero_also_in_a_turned_box():
    """Compression along the box's second axis outweighs the tension along its first."""
    a = np.radians(30)
    axes = np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]])
    box = Box(axes, BOUNDS)
    warp = warped(np.array([0.3, -0.8, 0, 0, 0, 0]), box=box)
    along = np.array([[1.0, 1, 1], [1, 1.5, 1], [1.5, 1, 1], [1.5, 1.5, 1]]) @ axes
    plots = plots_of(warp, along, [[0, 1], [0, 2], [0, 3]])
    np.testing.assert_allclose(plots.strut_angles_deg, [0, 90, 45], atol=1e-6)
    # Length times how much 0.8 stands out from 0.3.
    np.testing.assert_allclose(plots.strut_weights, 0.5 * np.array([0.5, 0.5, 0.5**0.5]), rtol=1e-6)


def test_bins_of_sizes_count_what_lies_beyond_in_the_outermost():
    ratio = np.array([0.1, 0.5, 1.0, 1.0, 2.0, 7.0, np.nan])
    count, edges = ratio_counts(ratio)
    assert (count[0], count[len(count) // 2], count[-1], count.sum()) == (2, 2, 2, 6)
    np.testing.assert_allclose(edges * edges[::-1], 1)


def test_shares_of_angles_add_up_to_one_by_weight():
    share, edges = angle_shares(
        np.array([0.0, 1.0, 44.0, 45.0]), np.array([1.0, 1.0, 4.0, 2.0]), largest=45
    )
    np.testing.assert_allclose([share[0], share[-1], share.sum()], [0.25, 0.75, 1])
    assert edges[-1] == 45


def test_cells_of_a_flat_grid_reach_through_the_box():
    box = Box.aligned(BOUNDS, extrusion="y")
    grid = Grid.uniform(box, (2, 4))
    corners = hexahedra(grid)
    assert corners.shape == (3, 5, 2, 3)
    np.testing.assert_allclose((equivalent_edges(corners) ** 3).sum(), 16)
    np.testing.assert_allclose(mean_edge(grid), 1)
    np.testing.assert_array_equal(
        hexahedra(Grid.uniform(Box.aligned(BOUNDS), (2, 1, 1)))[0, 0, 0], 0
    )
