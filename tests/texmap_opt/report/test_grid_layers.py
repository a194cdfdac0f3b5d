"""Layers of the grid through the part, laid flat."""

import numpy as np
import pytest

from texmap_opt.box import Box
from texmap_opt.report.grid_layers import grid_layers, plane_section
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.warp.grid import Grid

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
CUBE = TriMesh(CORNERS, np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))]))


def length(segments) -> float:
    return float(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=-1).sum())


@pytest.mark.parametrize("height", [0.3, 1.0])
def test_a_plane_cuts_a_cube_in_a_square(height):
    """Also where it goes through corners: at its upper face the outline is that face's rim."""
    section = plane_section(CUBE, CUBE.vertices[:, 2] - height)
    np.testing.assert_allclose(length(section), 4, rtol=1e-12)
    np.testing.assert_allclose(section[..., 2], height, atol=1e-12)


def test_a_plane_beside_the_part_cuts_nothing():
    assert plane_section(CUBE, CUBE.vertices[:, 2] + 0.5).shape == (0, 2, 3)


@pytest.mark.parametrize("degrees", [0.0, 20.0])
def test_a_layer_along_each_axis_of_the_box_with_the_parts_outline(degrees):
    a = np.radians(degrees)
    axes = np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]])
    part = TriMesh(CUBE.vertices * [8, 4, 2] @ axes, CUBE.faces)
    grid = Grid.around(Box.around(part.vertices, axes), (8, 4, 2), margin_cells=1, radius_mm=0.1)
    inside = ((grid.centres > 0) & (grid.centres < [8, 4, 2])).all(axis=1)
    values = grid.centres[:, 0]
    layers = grid_layers(grid, values, inside, part)
    assert [layer.axis for layer in layers] == [0, 1, 2]
    assert [len(layer.quads) for layer in layers] == [6 * 4, 10 * 4, 10 * 6]
    assert [int(layer.meets.sum()) for layer in layers] == [4 * 2, 8 * 2, 8 * 4]
    np.testing.assert_allclose([length(layer.outline) for layer in layers], [12, 20, 24], rtol=1e-9)
    # Values belong to their cells: that of the x coordinate is the first coordinate of each quad.
    for layer in layers[1:]:
        np.testing.assert_allclose(layer.quads[..., 0].mean(axis=1), layer.values, rtol=1e-12)


def test_the_layer_is_the_one_with_most_of_the_part():
    grid = Grid.uniform(Box.aligned(np.array([[0.0, 0, 0], [4, 4, 4]])), (4, 4, 4))
    meets = np.zeros((4, 4, 4), bool)
    meets[3], meets[0, 0, 0] = True, True
    first = grid_layers(grid, np.repeat(np.arange(4.0), 16), meets.ravel(), CUBE)[0]
    np.testing.assert_array_equal(first.values, 3.0)
    assert first.meets.all()


def test_a_flat_grid_has_one_layer():
    box = Box.aligned(np.array([[-1.0, -1, -1], [2, 2, 2]]), extrusion="x")
    grid = Grid.uniform(box, (3, 5))
    (layer,) = grid_layers(grid, np.ones(15), np.ones(15, bool), CUBE)
    assert layer.axis == 2 and layer.quads.shape == (15, 4, 2)
    np.testing.assert_allclose(length(layer.outline), 4, rtol=1e-12)
