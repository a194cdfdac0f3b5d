"""The measures of a warped grid."""

from itertools import product

import numpy as np
import pytest

from fea.effective_stiffness import EffectiveStiffness
from texmap_opt.box import Box
from texmap_opt.errors import WarpError
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.quality import (
    achieved_sizes,
    frames,
    quality,
    require_unfolded,
    turns,
)
from texmap_opt.warp.uniform import Uniform
from texmap_opt.warp.warp import WarpResult
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.warping_function import WarpingFunction

BOX = Box.aligned(np.array([[0.0, 0.0, 0.0], [4.0, 2.0, 2.0]]))
FLAT = Box.aligned(np.array([[0.0, 0.0, 0.0], [4.0, 2.0, 2.0]]), extrusion="z")

# Cubic, the stiffer along its axes, and the softer: Zener ratios 0.5 and 2.
STIFF_ALONG = EffectiveStiffness(np.diag([2.0, 2, 2, 0.5, 0.5, 0.5]))
SOFT_ALONG = EffectiveStiffness(np.diag([2.0, 2, 2, 2, 2, 2]))


def function_with_stress(*stress, box=BOX):
    """Constant f and the same Voigt stress everywhere, one per load case."""
    grid = BackgroundGrid.covering(box, 0.5)
    S = np.broadcast_to(np.concatenate(stress), (*grid.shape, 6 * len(stress)))
    return WarpingFunction.on_grid(grid, np.zeros(grid.shape), SizeLaw(), stress=S)


def graded(box=BOX, rate=0.25):
    """The warping function exp(rate x) without a stress: sizes fall along x."""
    law = SizeLaw(exponent=1.0, contrast=1e6)
    return WarpingFunction.from_formula(
        lambda p: np.exp(rate * p[:, 0]), box, spacing_mm=0.25, law=law
    )


def turned_in_plane(cells, degrees):
    """A grid that is turned by an angle in its first plane, out of its box: what frames measure."""
    box = BOX if len(cells) == 3 else FLAT
    grid = Grid.uniform(box, cells)
    a = np.radians(degrees)
    turn = np.eye(len(cells))
    turn[:2, :2] = [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
    return grid.with_nodes(grid.nodes @ turn.T)


@pytest.mark.parametrize(("box", "cells"), [(BOX, (4, 2, 2)), (FLAT, (4, 2))])
def test_the_uniform_grid_is_perfect(box, cells):
    f = WarpingFunction.from_formula(lambda p: np.ones(len(p)), box, spacing_mm=0.5, law=SizeLaw())
    measured = quality(Uniform().fit(Grid.uniform(box, cells), f).grid, f, stiffness=STIFF_ALONG)
    assert (measured.cells, measured.folded_cells) == (np.prod(cells), 0)
    ones = [measured.min_jacobian, measured.max_aspect, measured.min_edge]
    np.testing.assert_allclose([*ones, measured.scaled_jacobian], 1)
    np.testing.assert_allclose(measured.size_error, 0, atol=1e-12)
    assert measured.mean_angle_deg is None and measured.turn_deg is None
    assert measured.size_slope is None and measured.energy_share is None


def test_long_cells_have_their_aspect():
    measured = quality(Grid.uniform(BOX, (1, 2, 2)), function_with_stress(np.zeros(6)))
    np.testing.assert_allclose(measured.max_aspect, 4)


@pytest.mark.parametrize(("box", "cells"), [(BOX, (4, 2, 2)), (FLAT, (4, 2))])
def test_the_scaled_jacobian_of_sheared_cells_is_the_cosine_of_the_shear(box, cells):
    """Unit edges x and y at 60 degrees span sin 60; long cells are no worse than short ones."""
    grid = Grid.uniform(box, cells)
    nodes = grid.nodes.copy()
    nodes[..., 0] += nodes[..., 1] / np.tan(np.radians(60))
    measured = quality(grid.with_nodes(nodes), function_with_stress(np.zeros(6), box=box))
    np.testing.assert_allclose(measured.scaled_jacobian, np.sin(np.radians(60)), rtol=1e-12)


@pytest.mark.parametrize("corner", list(product((0, 1), repeat=3)))
def test_every_corner_counts(corner):
    """One corner of a cube pushed in by 0.3 along x.

    Its edges there are (0.7, 0, 0), (-0.3, 1, 0) and (-0.3, 0, 1): volume 0.7 over 0.7 x 1.09, and the
    first is the shortest of all.
    """
    box = Box.aligned(np.array([[0.0, 0, 0], [1, 1, 1]]))
    grid = Grid.uniform(box, (1, 1, 1))
    nodes = grid.nodes.copy()
    nodes[corner][0] += 0.3 if corner[0] == 0 else -0.3
    measured = quality(grid.with_nodes(nodes), function_with_stress(np.zeros(6), box=box))
    np.testing.assert_allclose(measured.scaled_jacobian, 1 / 1.09, rtol=1e-12)
    np.testing.assert_allclose(measured.min_edge, 0.7, rtol=1e-12)
    np.testing.assert_allclose(measured.max_aspect, np.sqrt(1.09) / 0.7, rtol=1e-12)


@pytest.mark.parametrize("degrees", [0.0, 10.0, 30.0, 45.0])
def test_angle_to_a_stress_turned_in_one_plane(degrees):
    """Tension sigma along (cos a, sin a, 0), seen by the three pairs of axes.

    Pair xy sees a. In pair yz the stress of y is larger (or equal, at a = 0), in pair zx that of z
    smaller: the printed formula calls that 90 degrees.
    """
    a = np.radians(degrees)
    n = np.array([np.cos(a), np.sin(a), 0])
    deviator = np.outer(n, n) - np.eye(3) / 3
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = deviator
    f = function_with_stress(np.array([xx, yy, zz, yz, xz, xy]))
    measured = quality(Grid.uniform(BOX, (4, 2, 2)), f)
    np.testing.assert_allclose(measured.mean_angle_deg, (degrees + 0 + 90) / 3, atol=1e-6)
    np.testing.assert_allclose(measured.mean_misalignment_deg, degrees / 3, atol=1e-6)
    # Mohr's circles in the planes: radius 1/2 in xy, n_y^2 / 2 in yz, n_x^2 / 2 in zx.
    np.testing.assert_allclose(measured.turn_deg, degrees / 2, atol=1e-6)
    np.testing.assert_allclose(measured.turn_uniform_deg, degrees / 2, atol=1e-6)


def test_in_the_plane_there_is_one_pair_and_the_stress_across_it_does_not_count():
    """Shear has its principal axes at 45 degrees; cells turned by 30 are 15 from them."""
    f = function_with_stress(np.array([0, 0, 9.0, 0, 0, 1.0]), box=FLAT)
    measured = quality(turned_in_plane((4, 2), 30.0), f)
    np.testing.assert_allclose([measured.turn_deg, measured.turn_uniform_deg], [15, 45], rtol=1e-9)
    np.testing.assert_allclose(measured.mean_misalignment_deg, 15, rtol=1e-9)


def test_a_case_counts_by_the_norm_of_its_deviator():
    shear, along = np.array([0, 0, 0, 0, 0, 1.0]), np.array([2.0, -1.0, -1.0, 0, 0, 0])
    both = function_with_stress(shear, 2 * along)
    measured = quality(Grid.uniform(BOX, (4, 2, 2)), both)
    weights = np.sqrt([2, 24])
    np.testing.assert_allclose(
        measured.mean_misalignment_deg, np.average([45 / 3, 0], weights=weights), rtol=1e-9
    )


def test_pressure_has_no_directions():
    measured = quality(
        Grid.uniform(BOX, (4, 2, 2)), function_with_stress(np.array([1.0, 1, 1, 0, 0, 0]))
    )
    assert measured.mean_angle_deg is None and measured.turn_deg is None


@pytest.mark.parametrize(("box", "cells"), [(BOX, (16, 2, 2)), (FLAT, (16, 2))])
def test_cells_that_follow_f_in_volume_alone_have_slope_d_over_d(box, cells):
    """Moved along x only: edges h ~ s^d give volumes s^d, sizes s. Slope 1, correlation 1."""
    f, d = graded(box), len(cells)
    grid = Grid.uniform(box, cells)
    # x(xi) with dx/dxi ~ exp(-d x / 4): xi in proportion to exp(d x / 4) - 1.
    xi = np.linspace(0, 1, cells[0] + 1)
    x = np.log(1 + xi * (np.exp(0.25 * d * 4) - 1)) / (0.25 * d)
    nodes = grid.nodes.copy()
    nodes[..., 0] = x.reshape(-1, *[1] * (d - 1))
    measured = quality(grid.with_nodes(nodes), f)
    # The first cell is 1 mm long, and exp(-d x / 4) no straight line in it: some per cent.
    np.testing.assert_allclose(measured.size_slope, 1, atol=0.04)
    assert measured.size_correlation > 0.998
    at_rest = quality(grid, f)
    np.testing.assert_allclose([at_rest.size_slope, at_rest.size_correlation], 0, atol=1e-12)
    assert at_rest.size_error > 5 * measured.size_error


def test_sizes_of_the_part_are_those_of_cells_that_count():
    """Half of the box follows f, the other is left alone."""
    grid, f = Grid.uniform(BOX, (16, 2, 2)), graded()
    nodes = grid.nodes.copy()
    inner = nodes[..., 0] > 2
    nodes[..., 0] = np.where(
        inner, 2 + np.sqrt(2 * np.maximum(nodes[..., 0] - 2, 0)), nodes[..., 0]
    )
    weights = np.where(grid.centres[:, 0] > 2, 0.3, 0.0)
    measured = quality(grid.with_nodes(nodes), f, weights=weights)
    assert measured.part_size_correlation > 0.9
    assert abs(measured.part_size_slope - measured.size_slope) > 0.05
    everywhere = quality(grid.with_nodes(nodes), f, weights=np.ones(64))
    np.testing.assert_allclose(everywhere.part_size_slope, everywhere.size_slope, rtol=1e-12)
    assert quality(grid, f).part_size_slope is None


@pytest.mark.parametrize("cells", [(4, 2, 2), (4, 2)])
def test_sizes_and_frames_of_a_turned_grid(cells):
    """Turning keeps sizes, and the frame turns along."""
    grid = turned_in_plane(cells, 25.0)
    np.testing.assert_allclose(achieved_sizes(grid), 1, rtol=1e-12)
    first = frames(grid)[:, 0]
    np.testing.assert_allclose(
        first[:, :2], [[np.cos(np.pi * 25 / 180), np.sin(np.pi * 25 / 180)]] * len(first)
    )


@pytest.mark.parametrize(("cells", "box"), [((4, 2, 2), BOX), ((4, 2), FLAT)])
def test_turning_by_45_degrees_gains_all_there_is_under_shear(cells, box):
    """Shear is tension and compression along the diagonals.

    C diagonal, G = 1/2 or 2 in the cell's axes; turned by 45 degrees (C11 - C12)/2 = 1 resists. A
    cell stiff along its axes then stores 1/2 of the energy, one soft along them twice as much.
    """
    f = function_with_stress(np.array([0, 0, 0, 0, 0, 0.5]), box=box)
    turned = turned_in_plane(cells, 45.0)
    stiff, soft = (quality(turned, f, stiffness=C) for C in (STIFF_ALONG, SOFT_ALONG))
    np.testing.assert_allclose([stiff.energy_warped, stiff.energy_best], 0.5, rtol=1e-9)
    np.testing.assert_allclose([stiff.energy_share, stiff.energy_worst], 1, rtol=1e-9)
    np.testing.assert_allclose([soft.energy_warped, soft.energy_worst], 2, rtol=1e-9)
    assert soft.energy_share is None  # the box's own axes are the best: there is nothing to gain


def test_energies_need_a_stiffness_a_stress_and_a_cell_that_counts():
    f = function_with_stress(np.array([0, 0, 0, 0, 0, 0.5]))
    grid = Grid.uniform(BOX, (4, 2, 2))
    without = [
        quality(grid, f),
        quality(grid, function_with_stress(np.zeros(6)), stiffness=STIFF_ALONG),
        quality(grid, f, stiffness=STIFF_ALONG, weights=np.zeros(16)),
    ]
    assert [measured.energy_warped for measured in without] == [None] * 3


def test_cells_count_by_weight_in_the_energy():
    """Only cells at rest count: nothing is gained, though others are turned."""
    f = function_with_stress(np.array([0, 0, 0, 0, 0, 0.5]))
    grid = Grid.uniform(BOX, (4, 2, 2))
    moved = turned_in_plane((4, 2, 2), 45.0)
    nodes = np.where(np.arange(5)[:, None, None, None] < 3, grid.nodes, moved.nodes + 9.0)
    weights = np.where(np.arange(16) < 8, 1.0, 0.0)
    measured = quality(grid.with_nodes(nodes), f, stiffness=STIFF_ALONG, weights=weights)
    np.testing.assert_allclose([measured.energy_warped, measured.energy_share], [1, 0], atol=1e-9)


def test_turns_keep_case_and_cell_apart():
    stress = np.zeros((2, 16, 3, 3))
    stress[1, 3] = [[0, 1, 0], [1, 0, 0], [0, 0, 0]]
    cells, unturned = turns(Grid.uniform(BOX, (4, 2, 2)), stress)
    assert cells.nearest.shape == (3, 2, 16)
    np.testing.assert_allclose(np.degrees(cells.nearest[0, 1, 3]), 45)
    assert unturned.anisotropy[0, 1, 3] == 1 and np.count_nonzero(unturned.anisotropy[0]) == 1


def test_a_fold_is_counted_and_refused():
    grid = Grid.uniform(BOX, (4, 2, 2))
    nodes = grid.nodes.copy()
    nodes[2, 1, 1, 0] = 3.5  # beyond its neighbour: the four cells on that side invert
    f = function_with_stress(np.array([0, 0, 0, 0, 0, 0.5]))
    result = WarpResult(grid.with_nodes(nodes), "successive-approximation", 7, converged=True)
    measured = quality(result.grid, f, stiffness=STIFF_ALONG)
    assert measured.folded_cells == 4 and measured.min_jacobian < 0
    assert measured.scaled_jacobian < 0
    assert np.isfinite([measured.size_error, measured.energy_warped, measured.energy_best]).all()
    with pytest.raises(WarpError, match=r"successive-approximation.*folds 4 of 16 cells") as caught:
        require_unfolded(result, measured)
    assert "least-squares" in str(caught.value)


def test_a_grid_inside_out_has_no_size_and_no_energy():
    grid = Grid.uniform(BOX, (4, 2, 2))
    mirrored = grid.with_nodes(grid.nodes * [-1.0, 1, 1])
    assert np.isnan(achieved_sizes(mirrored)).all()
    f = function_with_stress(np.array([0, 0, 0, 0, 0, 0.5]))
    measured = quality(mirrored, f, stiffness=STIFF_ALONG)
    assert measured.folded_cells == 16
    assert measured.size_error is None and measured.energy_warped is None


def test_an_unfolded_grid_passes():
    f = function_with_stress(np.zeros(6))
    result = Uniform().fit(Grid.uniform(BOX, (4, 2, 2)), f)
    require_unfolded(result, quality(result.grid, f))
