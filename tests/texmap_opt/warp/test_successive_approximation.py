"""The paper's iteration, equation 4.2 as printed (design section 4, item 1)."""

import numpy as np

from texmap_opt.warp.hex_grid import HexGrid
from texmap_opt.warp.quality import quality
from texmap_opt.warp.successive_approximation import SuccessiveApproximation
from texmap_opt.warping_function.warping_function import SizeLaw, WarpingFunction

CUBE = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])


def wave(p):
    return np.exp(0.5 * np.sin(2 * p[:, 0] + 1) + 0.3 * np.cos(3 * p[:, 1] * p[:, 2]))


def painted(f, spacing=0.05, law=None, box=CUBE):
    return WarpingFunction.painted(f, box, spacing_mm=spacing, law=law or SizeLaw(contrast=1e3))


def test_constant_f_leaves_the_uniform_grid():
    grid = HexGrid.uniform(CUBE, (4, 3, 5))
    result = SuccessiveApproximation().fit(grid, painted(lambda p: np.full(len(p), 2.0)))
    assert result.converged
    np.testing.assert_allclose(result.grid.nodes, grid.nodes, atol=1e-12)


def test_in_one_dimension_the_size_follows_f_to_the_power_minus_two():
    """Docs/theory/warp.md; measured as a slope on a column of 80 cells, O(h²) from the limit."""
    f = painted(lambda p: np.exp(0.4 * np.sin(2 * np.pi * p[:, 0])), spacing=0.02)
    grid = HexGrid.uniform(CUBE, (80, 1, 1))
    result = SuccessiveApproximation(max_sweeps=100_000).fit(grid, f)
    x = result.grid.nodes[:, 0, 0, 0]
    middle = np.stack([(x[1:] + x[:-1]) / 2, np.full(80, 0.5), np.full(80, 0.5)], axis=1)
    slope = np.polyfit(np.log(f.f(middle)), np.log(np.diff(x)), 1)[0]
    assert result.converged
    np.testing.assert_allclose(slope, -2, atol=0.02)


def test_at_rest_every_inner_node_is_the_weighted_mean_of_its_six_neighbours():
    """Equation 4.2 itself, one node at a time."""
    f = painted(wave)
    nodes = SuccessiveApproximation(eps=1e-10).fit(HexGrid.uniform(CUBE, (4, 4, 4)), f).grid.nodes
    weight = np.asarray(f.f(nodes.reshape(-1, 3))).reshape(5, 5, 5)
    steps = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])
    for i in np.ndindex(3, 3, 3):
        near = [tuple(np.array(i) + 1 + step) for step in steps]
        mean = sum(weight[j] * nodes[j] for j in near) / sum(weight[j] for j in near)
        np.testing.assert_allclose(nodes[i[0] + 1, i[1] + 1, i[2] + 1], mean, atol=1e-8)


def test_outer_nodes_slide_on_their_faces_and_corners_stay():
    grid = HexGrid.uniform(CUBE, (4, 4, 4))
    nodes = SuccessiveApproximation().fit(grid, painted(wave)).grid.nodes
    for axis in range(3):
        faces = np.moveaxis(nodes[..., axis], axis, 0)
        assert np.all(faces[0] == 0) and np.all(faces[-1] == 1)
    np.testing.assert_array_equal(nodes[::4, ::4, ::4], grid.nodes[::4, ::4, ::4])
    assert np.abs(nodes[0, :, :, 1:] - grid.nodes[0, :, :, 1:]).max() > 1e-3


def test_the_exponent_of_the_size_law_has_no_say():
    """The printed weights are f itself; only a contrast limit that binds would differ."""
    grid = HexGrid.uniform(CUBE, (4, 4, 4))
    once = SuccessiveApproximation().fit(grid, painted(wave, law=SizeLaw(contrast=1e6)))
    law = SizeLaw(exponent=2.0, contrast=1e12)
    twice = SuccessiveApproximation().fit(grid, painted(wave, law=law))
    np.testing.assert_allclose(twice.grid.nodes, once.grid.nodes, atol=1e-9)


def test_permuting_the_axes_permutes_the_grid():
    there = SuccessiveApproximation().fit(HexGrid.uniform(CUBE, (3, 4, 5)), painted(wave))
    f = painted(lambda p: wave(p[:, [1, 2, 0]]))
    back = SuccessiveApproximation().fit(HexGrid.uniform(CUBE, (5, 3, 4)), f)
    expected = there.grid.nodes.transpose(2, 0, 1, 3)[..., [2, 0, 1]]
    np.testing.assert_allclose(back.grid.nodes, expected, atol=1e-9)


def test_running_out_of_sweeps_is_reported():
    f = painted(wave)
    result = SuccessiveApproximation(max_sweeps=3).fit(HexGrid.uniform(CUBE, (6, 6, 6)), f)
    assert not result.converged and result.iterations == 3
    assert "stopped after 3 sweeps" in result.message
    assert quality(result.grid, f).cells == 216
