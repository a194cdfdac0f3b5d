"""The certificate that a cell does not fold."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from texmap_opt.box import Box
from texmap_opt.warp.certificate import (
    bezier_coefficients,
    cofactors,
    determinants,
    edge_matrices,
    folded,
    grid_coefficients,
)
from texmap_opt.warp.grid import Grid

UNIT = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
BOXES = {2: Box.aligned(UNIT, extrusion="z"), 3: Box.aligned(UNIT)}
HIDDEN_FOLD = np.array(
    [
        [[[0.3, -0.2, 0.6], [0.8, 0.5, 0.8]], [[0.4, 1.8, -0.4], [-0.6, 1.3, 0.5]]],
        [[[0.6, 0.0, -0.6], [0.7, -0.7, 0.6]], [[1.6, 0.8, -0.1], [1.3, 0.7, 1.7]]],
    ]
)


def one_cell(corners):
    """A cell from corners indexed [i, j] or [i, j, k]."""
    return Grid(corners, BOXES[corners.shape[-1]])


def unit_cell(d):
    return Grid.uniform(BOXES[d], (1,) * d).nodes.copy()


@pytest.mark.parametrize(("d", "cells"), [(2, (3, 2)), (3, (3, 2, 4))])
def test_all_coefficients_of_the_uniform_grid_are_one(d, cells):
    box = Box.aligned(UNIT * [1, 2, 3], extrusion="z" if d == 2 else None)
    coefficients = grid_coefficients(Grid.uniform(box, cells))
    assert coefficients.shape == (np.prod(cells), 3**d)
    np.testing.assert_allclose(coefficients, 1, rtol=1e-12)


@pytest.mark.parametrize(("d", "cells"), [(2, (90, 70)), (3, (20, 18, 15))])
def test_coefficients_of_many_cells_are_those_of_each_alone(d, cells):
    """The grid is taken in blocks of layers; a slip there would mix up the cells."""
    grid = Grid.uniform(BOXES[d], cells)
    moves = np.random.default_rng(0).uniform(-0.2, 0.2, grid.nodes.shape) * grid.uniform_edge
    grid = grid.with_nodes(grid.nodes + moves)
    together = grid_coefficients(grid)
    for number in np.random.default_rng(1).choice(grid.cell_count, 20, replace=False):
        at = np.unravel_index(number, cells)
        corners = grid.nodes[tuple(slice(i, i + 2) for i in at)] / grid.uniform_edge
        alone = grid_coefficients(one_cell(corners))[0]
        np.testing.assert_allclose(together[number], alone, atol=1e-10)


@pytest.mark.parametrize("d", [2, 3])
def test_jax_computes_the_same_coefficients(d):
    """One text serves NumPy, for certificates, and JAX, for derivatives."""
    grid = Grid.uniform(BOXES[d], (3, 4, 2)[:d])
    nodes = grid.nodes + np.random.default_rng(0).uniform(-0.05, 0.05, grid.nodes.shape)

    @jax.jit
    def traced(nodes, edge):
        return bezier_coefficients(determinants(edge_matrices(nodes, edge)), d)

    B = traced(jnp.asarray(np.moveaxis(nodes, -1, 0)), jnp.asarray(grid.uniform_edge))
    expected = grid_coefficients(grid.with_nodes(nodes))
    np.testing.assert_allclose(B.reshape(3**d, -1).T, expected, rtol=1e-12)


@pytest.mark.parametrize("d", [2, 3])
def test_cofactors_over_the_determinant_are_the_inverse_transpose(d):
    J = np.random.default_rng(0).normal(size=(d, d, 7))  # column, component, sample
    columns = np.moveaxis(J, (0, 1), (-1, -2))
    expected = np.linalg.inv(columns).swapaxes(-1, -2) * np.linalg.det(columns)[:, None, None]
    actual = np.stack(cofactors(tuple(J)))
    np.testing.assert_allclose(np.moveaxis(actual, (0, 1), (-1, -2)), expected, atol=1e-12)


def test_a_cell_can_fold_although_all_corners_are_right_handed():
    """Knupp, "On the invertibility of the isoparametric map", CMAME 78 (1990) 313-329.

    Right-handed corners do not suffice: this cell (found by random search) has det J > 0 at all
    eight and -0.5 inside.
    """
    coefficients = grid_coefficients(one_cell(HIDDEN_FOLD))
    outer = coefficients.reshape(3, 3, 3)[::2, ::2, ::2]
    assert outer.min() > 0
    assert sampled_determinant(HIDDEN_FOLD, 9).min() < -0.5
    assert folded(coefficients)[0]


def test_a_quadrilateral_folds_where_a_corner_is_not_convex():
    """In two dimensions det J is linear: it is smallest at a corner, and the corners decide."""
    dart = unit_cell(2)
    dart[1, 1] = [0.4, 0.4]
    coefficients = grid_coefficients(one_cell(dart))
    assert coefficients.shape == (1, 9)
    np.testing.assert_allclose(coefficients.reshape(3, 3)[2, 2], -0.2, rtol=1e-12)
    assert folded(coefficients)[0]
    dart[1, 1] = [0.6, 0.6]
    assert not folded(grid_coefficients(one_cell(dart)))[0]


@pytest.mark.parametrize("d", [2, 3])
def test_an_inside_out_cell_is_folded(d):
    """Negative control: two opposite faces exchanged."""
    assert folded(grid_coefficients(one_cell(unit_cell(d)[::-1])))[0]


@pytest.mark.parametrize("d", [2, 3])
def test_a_collapsed_cell_is_folded(d):
    flat = unit_cell(d)
    flat[..., -1] = 0
    assert folded(grid_coefficients(one_cell(flat)))[0]


@pytest.mark.parametrize("d", [2, 3])
def test_a_negative_coefficient_with_a_positive_determinant_is_no_fold(d):
    """(2 u - 1)² + 1/5 is positive, and its middle Bezier coefficient is -4/5."""
    middle = np.array([6 / 5, -4 / 5, 6 / 5]).reshape(3, *[1] * (d - 1))
    coefficients = np.broadcast_to(middle, (3,) * d).reshape(1, 3**d)
    assert not folded(coefficients)[0]
    # With 1/5 taken away twice it dips below zero, and nothing but subdivision can tell.
    assert folded(coefficients - 0.4)[0]


@pytest.mark.parametrize("d", [2, 3])
def test_three_halvings_decide_and_what_stays_undecided_counts_as_folded(d):
    """(u - 1/3)² + e: the middle coefficient on the part of width h around 1/3 is e - 2 h²/9.

    It takes three halvings to see that e = 0.005 is no fold, four for 0.002.
    """
    for e, undecided in ((0.005, False), (0.002, True)):
        along = np.array([1 / 9 + e, e - 2 / 9, 4 / 9 + e]).reshape(3, *[1] * (d - 1))
        coefficients = np.broadcast_to(along, (3,) * d).reshape(1, 3**d)
        assert folded(coefficients)[0] == undecided


def test_only_the_folded_of_many_cells_are_named():
    grid = Grid.uniform(BOXES[3], (4, 4, 4))
    nodes = grid.nodes.copy()
    nodes[2, 2, 2] += [0.3, 0, 0]  # beyond its neighbour: the cells on that side turn over
    names = np.flatnonzero(folded(grid_coefficients(grid.with_nodes(nodes))))
    around = [np.ravel_multi_index((2, j, k), (4, 4, 4)) for j in (1, 2) for k in (1, 2)]
    np.testing.assert_array_equal(names, sorted(around))


def test_the_mean_coefficient_is_the_volume_of_the_cell():
    """By the divergence theorem: a frustum with faces 2x2 and 1x1 and height 1 has volume 7/3."""
    frustum = unit_cell(3)
    frustum[:, :, 0, :2] = 2 * frustum[:, :, 0, :2] - 0.5
    np.testing.assert_allclose(grid_coefficients(one_cell(frustum)).mean(), 7 / 3, rtol=1e-12)


def test_the_mean_coefficient_is_the_area_of_the_quadrilateral():
    """A trapezium with parallel sides 2 and 1 and height 1 has the area 3/2."""
    trapezium = unit_cell(2)
    trapezium[1, 0] = [2.0, 0.0]
    np.testing.assert_allclose(grid_coefficients(one_cell(trapezium)).mean(), 3 / 2, rtol=1e-12)


def sampled_determinant(corners, n):
    """Det J on a lattice of points, from the trilinear map and its derivatives."""
    u = np.linspace(0, 1, n)
    shape, slope = np.stack([1 - u, u]), np.stack([-np.ones(n), np.ones(n)])
    columns = []
    for axis in range(3):
        a, b, c = (slope if d == axis else shape for d in range(3))
        columns.append(np.einsum("ix,jy,kz,ijkd->xyzd", a, b, c, corners))
    return np.linalg.det(np.stack(columns, axis=-1))
