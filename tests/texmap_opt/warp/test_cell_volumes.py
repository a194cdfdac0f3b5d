"""Sizes of cells by their volume, and how much of a part is in them.

That volumes are exact, fill the box and have derivatives: tests/texmap_opt/structure.
"""

import numpy as np
import pytest

from texmap_opt.box import Box
from texmap_opt.builtin_part import builtin_part
from texmap_opt.warp.cell_volumes import equivalent_edges
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.occupied import occupied_volume


def unit_cells(*cells: int) -> np.ndarray:
    axes = [np.arange(n + 1.0) for n in cells]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def test_the_edge_is_the_root_of_the_volume():
    np.testing.assert_allclose(equivalent_edges(unit_cells(3, 2, 4) * [2, 3, 4]), 24 ** (1 / 3))
    np.testing.assert_allclose(equivalent_edges(unit_cells(3, 2) * [2, 3]), 6**0.5)


def test_shear_keeps_the_edge_and_a_mirror_has_none():
    shear = np.array([[1, 0.7, 0], [0, 1, 0.4], [0, 0, 1]])
    nodes = unit_cells(3, 2, 4)
    np.testing.assert_allclose(equivalent_edges(nodes @ shear), 1, rtol=1e-14)
    assert np.isnan(equivalent_edges(nodes * [-1, 1, 1])).all()


@pytest.mark.parametrize(("extrusion", "height"), [(None, 2.0), ("x", 2.0), ("z", 2.0), ("z", 0.1)])
def test_cells_hold_the_part_and_cells_of_the_margin_nothing(extrusion, height):
    """Exact for cubes, or squares through the part, that end at its faces; also where it is thin."""
    part = builtin_part("cantilever", {"length_mm": 4.0, "width_mm": 3.0, "height_mm": height})
    box = Box.aligned(
        np.stack([part.vertices.min(axis=0), part.vertices.max(axis=0)]), extrusion=extrusion
    )
    inside = tuple(int(n) for n in np.rint(2 * box.extent))
    grid = Grid.around(box, inside, margin_cells=1, radius_mm=0.0)
    occupied = occupied_volume(grid, part).reshape(grid.cells)
    depth = 0.5 if extrusion is None else {"x": 4.0, "z": height}[extrusion]
    core = tuple(slice(1, -1) for _ in inside)
    np.testing.assert_allclose(occupied[core], 0.25 * depth, rtol=1e-9)
    np.testing.assert_allclose(occupied.sum(), 12 * height, rtol=1e-9)
    turned = grid.with_nodes(np.flip(grid.nodes, axis=0))
    assert not occupied_volume(turned, part).any()
