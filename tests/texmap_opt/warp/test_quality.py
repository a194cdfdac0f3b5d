"""The measures of a warped grid."""

import numpy as np
import pytest

from texmap_opt.errors import WarpError
from texmap_opt.warp.hex_grid import HexGrid
from texmap_opt.warp.quality import quality, require_unfolded
from texmap_opt.warp.uniform import Uniform
from texmap_opt.warp.warp import WarpResult
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.warping_function import SizeLaw, WarpingFunction

BOX = np.array([[0.0, 0.0, 0.0], [4.0, 2.0, 2.0]])


def function_with_stress(*stress):
    """Constant f and the same Voigt stress everywhere, one per load case."""
    grid = BackgroundGrid.covering(BOX, 0.5)
    S = np.broadcast_to(np.concatenate(stress), (*grid.shape, 6 * len(stress)))
    return WarpingFunction.on_grid(grid, np.zeros(grid.shape), S, np.ones(grid.shape), SizeLaw())


def test_the_uniform_grid_is_perfect():
    f = WarpingFunction.painted(lambda p: np.ones(len(p)), BOX, spacing_mm=0.5, law=SizeLaw())
    measured = quality(Uniform().fit(HexGrid.uniform(BOX, (4, 2, 2)), f).grid, f)
    assert (measured.cells, measured.folded_cells) == (16, 0)
    np.testing.assert_allclose([measured.min_jacobian, measured.max_aspect, measured.min_edge], 1)
    assert measured.mean_angle_deg is None and measured.size_slope is None


def test_long_cells_have_their_aspect():
    measured = quality(HexGrid.uniform(BOX, (1, 2, 2)), function_with_stress(np.zeros(6)))
    np.testing.assert_allclose(measured.max_aspect, 4)


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
    measured = quality(HexGrid.uniform(BOX, (4, 2, 2)), f)
    np.testing.assert_allclose(measured.mean_angle_deg, (degrees + 0 + 90) / 3, atol=1e-6)
    np.testing.assert_allclose(measured.mean_misalignment_deg, degrees / 3, atol=1e-6)


def test_a_case_counts_by_the_norm_of_its_deviator():
    shear, along = np.array([0, 0, 0, 0, 0, 1.0]), np.array([2.0, -1.0, -1.0, 0, 0, 0])
    both = function_with_stress(shear, 2 * along)
    measured = quality(HexGrid.uniform(BOX, (4, 2, 2)), both)
    weights = np.sqrt([2, 24])
    np.testing.assert_allclose(
        measured.mean_misalignment_deg, np.average([45 / 3, 0], weights=weights), rtol=1e-9
    )


def test_a_fold_is_counted_and_refused():
    grid = HexGrid.uniform(BOX, (4, 2, 2))
    nodes = grid.nodes.copy()
    nodes[2, 1, 1, 0] = 3.5  # beyond its neighbour: the four cells on that side invert
    f = function_with_stress(np.zeros(6))
    result = WarpResult(grid.with_nodes(nodes), "successive-approximation", 7, converged=True)
    measured = quality(result.grid, f)
    assert measured.folded_cells == 4 and measured.min_jacobian < 0
    with pytest.raises(WarpError, match=r"successive-approximation.*folds 4 of 16 cells") as caught:
        require_unfolded(result, measured)
    assert "least-squares" in str(caught.value)


def test_an_unfolded_grid_passes():
    f = function_with_stress(np.zeros(6))
    result = Uniform().fit(HexGrid.uniform(BOX, (4, 2, 2)), f)
    require_unfolded(result, quality(result.grid, f))
