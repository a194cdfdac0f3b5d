"""The mapping in JAX: the same numbers as in NumPy, and derivatives in the grid's nodes."""

from collections.abc import Callable

import hypothesis
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import strategies as st
from jaxtyping import Array

from tests.verification.small_frames import remainder_orders
from texmap_opt.box import Box
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.structure.map import (
    cell_sizes,
    map_structure,
    mapped_joints,
    mapped_sizes,
    multilinear,
)
from texmap_opt.structure.strut_geometry import strut_angles, strut_directions, strut_lengths
from texmap_opt.structure.tile import tile
from texmap_opt.warp.cell_volumes import cell_volumes
from texmap_opt.warp.certificate import grid_coefficients
from texmap_opt.warp.grid import Grid

NET = tile(unit_cell("octet"), (3, 4, 2))
SIZE = {2: (30.0, 20.0), 3: (30.0, 20.0, 10.0)}
CELLS = {2: (3, 4), 3: (3, 4, 2)}


def warped(d: int, seed: int = 3) -> Grid:
    """Nodes moved by up to a fifth of a cell, those on faces within their face."""
    bounds = np.array([[1.0, 2.0, 3.0], [31.0, 22.0, 13.0]])
    grid = Grid.uniform(Box.aligned(bounds, extrusion="z" if d == 2 else None), CELLS[d])
    move = np.random.default_rng(seed).uniform(-0.2, 0.2, grid.nodes.shape) * grid.uniform_edge
    return grid.with_nodes(grid.nodes + np.where(np.moveaxis(grid.free, 0, -1), move, 0.0))


def of_joints(nodes: Array) -> Array:
    """A smooth number that every joint enters."""
    return jnp.sum(jnp.sin(mapped_joints(NET, nodes)))


def total_length(nodes: Array) -> Array:
    return jnp.sum(strut_lengths(mapped_joints(NET, nodes), NET.struts))


def of_directions(nodes: Array) -> Array:
    return jnp.sum(strut_directions(mapped_joints(NET, nodes), NET.struts)[:, 0] ** 3)


def material(nodes: Array) -> Array:
    """Volume of struts whose radius follows the cell size, but for a constant."""
    lengths = strut_lengths(mapped_joints(NET, nodes), NET.struts)
    return jnp.sum(lengths * mapped_sizes(NET, nodes) ** 2)


def of_sizes(nodes: Array) -> Array:
    return jnp.sum(cell_sizes(nodes) ** 3)


def of_volumes(nodes: Array) -> Array:
    return jnp.sum(cell_volumes(nodes) ** 2)


@pytest.mark.parametrize(
    ("quantity", "d"),
    [
        (of_joints, 3),
        (total_length, 3),
        (of_directions, 3),
        (material, 3),
        (of_sizes, 3),
        (of_sizes, 2),
        (of_volumes, 3),
        (of_volumes, 2),
    ],
)
def test_the_gradient_has_a_second_order_taylor_remainder(
    quantity: Callable[[Array], Array], d: int
):
    np.testing.assert_allclose(remainder_orders(jax.jit(quantity), warped(d).nodes), 2, atol=0.05)


def test_the_total_strut_length_has_the_derivative_of_central_differences():
    """Their error is O(step²): 1e-8 of the length at 1e-3 mm, and rounding below it."""
    nodes, step = warped(3).nodes, 1e-3
    direction = np.random.default_rng(1).normal(size=nodes.shape)
    ahead, behind = (float(total_length(jnp.asarray(nodes + s * direction))) for s in (step, -step))
    slope = float(np.vdot(jax.grad(total_length)(jnp.asarray(nodes)), direction))
    np.testing.assert_allclose((ahead - behind) / (2 * step), slope, rtol=1e-7)


@pytest.mark.parametrize(
    "function",
    [
        lambda nodes: mapped_joints(NET, nodes),
        lambda nodes: mapped_sizes(NET, nodes),
        lambda nodes: strut_lengths(mapped_joints(NET, nodes), NET.struts),
        lambda nodes: strut_directions(mapped_joints(NET, nodes), NET.struts),
        cell_sizes,
        cell_volumes,
    ],
)
def test_numpy_and_jax_agree_and_each_returns_its_own_kind(function: Callable):
    """To rounding: both do the same operations, the compiler in another order."""
    nodes = warped(3).nodes
    host, traced = function(nodes), jax.jit(function)(jnp.asarray(nodes))
    assert isinstance(host, np.ndarray)
    assert isinstance(traced, jax.Array)
    np.testing.assert_allclose(traced, host, rtol=1e-13, atol=1e-13)


def test_the_structure_holds_what_the_functions_of_the_nodes_say():
    nodes = warped(3).nodes
    s = map_structure(NET, nodes, 0.5, radius_mode="scaled")
    np.testing.assert_array_equal(s.joints, mapped_joints(NET, nodes))
    np.testing.assert_allclose(s.cell_size, NET.sharing @ cell_sizes(nodes).ravel(), rtol=1e-14)
    np.testing.assert_array_equal(s.lengths(), strut_lengths(s.joints, s.struts))


@pytest.mark.parametrize("d", [2, 3])
@hypothesis.given(seed=st.integers(0, 2**32 - 1))
@hypothesis.settings(max_examples=10, deadline=None)
def test_cells_of_any_grid_with_sliding_faces_fill_the_box(d: int, seed: int):
    """Bilinear faces are shared, so what one cell gains its neighbour loses, folded or not."""
    grid = warped(d, seed)
    wild = grid.with_nodes(grid.at_rest.nodes + 8 * (grid.nodes - grid.at_rest.nodes))
    for some in (grid, wild):
        # To rounding of the volumes, which nearly cancel in the wild grid.
        np.testing.assert_allclose(cell_volumes(some.nodes).sum(), np.prod(SIZE[d]), rtol=1e-12)


@pytest.mark.parametrize("d", [2, 3])
def test_the_volume_of_a_cell_is_the_integral_of_its_jacobian(d: int):
    """The mean of the Bezier coefficients, because each basis polynomial has the same integral."""
    grid = warped(d)
    expected = grid_coefficients(grid).mean(axis=1) * np.prod(grid.uniform_edge)
    np.testing.assert_allclose(cell_volumes(grid.nodes).ravel(), expected, rtol=1e-13)


def test_a_trapezium_is_mapped_bilinearly():
    nodes = np.array([[[0.0, 0.0], [0.0, 2.0]], [[4.0, 0.0], [2.0, 2.0]]])
    local = np.array([[0.5, 0.5], [0.25, 1.0], [1.0, 0.5]])
    moved = multilinear(nodes, np.zeros((3, 2), np.int64), local)
    np.testing.assert_allclose(moved, [[1.5, 1.0], [0.5, 2.0], [3.0, 1.0]])
    np.testing.assert_allclose(cell_volumes(nodes), [[6.0]])
    # Uniform edges are the means of opposite sides: 3 and (2 + sqrt 8)/2.
    np.testing.assert_allclose(cell_sizes(nodes), [[1.0]])


def test_a_cell_inside_out_has_a_negative_volume():
    assert (cell_volumes(warped(3).nodes[::-1]) < 0).all()
    assert (cell_volumes(warped(2).nodes[::-1]) < 0).all()


def test_a_strut_makes_its_angles_with_a_field_of_axes_whichever_way_either_points():
    directions = np.array([[1.0, 0.0, 0.0], [0.0, -2.0, 2.0]])
    axes = np.array([[[-3.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0], [0.0, 1.0, 1.0]]])
    np.testing.assert_allclose(strut_angles(directions, axes), [[0, 90], [45, 90]], atol=1e-13)
