"""Layers of a warped grid through the part, laid flat: what the grid slices of the page show."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from texmap_opt.box import Box
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.warp.grid import Grid


@dataclass(frozen=True, eq=False)
class GridLayer:
    """One layer of cells seen along the axis it is normal to.

    Attributes:
        axis: of the box, 0 to 2: the direction of sight.
        quads: middle of each cell, its corners in order [mm], along the two other axes.
        values: what the colour shows, one a cell.
        meets: cells that meet the part.
        outline: ends of the segments in which the plane through the layer cuts the part [mm].
    """

    axis: int
    quads: Float[np.ndarray, "cells 4 2"]
    values: Float[np.ndarray, " cells"]
    meets: Bool[np.ndarray, " cells"]
    outline: Float[np.ndarray, "_ 2 2"]


def grid_layers(
    grid: Grid,
    values: Float[np.ndarray, " cells"],
    meets: Bool[np.ndarray, " cells"],
    part: TriMesh,
) -> tuple[GridLayer, ...]:
    """A layer normal to each axis; in two dimensions there is only one.

    Of all layers normal to an axis that with most cells that meet the part, of equals the middle one.
    """
    shaped, meets = values.reshape(grid.cells), meets.reshape(grid.cells)
    if grid.dimensions == 2:
        middle = float(grid.box.bounds[:, 2].mean())
        return (_layer(grid.nodes, (2, middle), shaped, meets, part, grid.box),)
    layers = []
    for axis in range(3):
        across = tuple(k for k in range(3) if k != axis)
        k = _fullest(meets.sum(axis=across))
        sheet = (grid.nodes.take(k, axis=axis) + grid.nodes.take(k + 1, axis=axis)) / 2
        met = meets.take(k, axis=axis)
        where = sheet if not met.any() else sheet[:-1, :-1][met]
        height = float(where[..., axis].mean())
        flat = sheet[..., across]
        layers.append(_layer(flat, (axis, height), shaped.take(k, axis=axis), met, part, grid.box))
    return tuple(layers)


def hexahedra(grid: Grid) -> Float[np.ndarray, "i j k 3"]:
    """Corners of the cells in space [mm]; extruded cells reach through the box."""
    if grid.dimensions == 3:
        return grid.positions
    ends = (grid.box.bounds[:, 2] - grid.box.bounds[:, 2].mean())[:, None] * grid.box.axes[2]
    return grid.positions[:, :, None] + ends


def plane_section(
    surface: TriMesh, heights: Float[np.ndarray, " vertices"]
) -> Float[np.ndarray, "_ 2 3"]:
    """Segments in which a surface is cut where `heights` over a plane change their sign [mm]."""
    # A vertex in the plane counts as above: every triangle is then cut twice or not at all.
    above = heights >= 0
    sides = surface.faces[:, [[0, 1], [1, 2], [2, 0]]]
    crossed = above[sides[..., 0]] != above[sides[..., 1]]
    ends = sides[crossed.any(axis=1)][crossed[crossed.any(axis=1)]]
    first, second = heights[ends[:, 0]], heights[ends[:, 1]]
    t = (first / (first - second))[:, None]
    points = (1 - t) * surface.vertices[ends[:, 0]] + t * surface.vertices[ends[:, 1]]
    return points.reshape(-1, 2, 3)


def _fullest(count: np.ndarray) -> int:
    """The middle one of the largest."""
    largest = np.flatnonzero(count == count.max())
    return int(largest[len(largest) // 2])


def _layer(
    sheet: Float[np.ndarray, "i j 2"],
    plane: tuple[int, float],
    values: Float[np.ndarray, "x y"],
    meets: Bool[np.ndarray, "x y"],
    part: TriMesh,
    box: Box,
) -> GridLayer:
    axis, height = plane
    corners = (sheet[:-1, :-1], sheet[1:, :-1], sheet[1:, 1:], sheet[:-1, 1:])
    across = [k for k in range(3) if k != axis]
    section = plane_section(part, part.vertices @ box.axes[axis] - height)
    return GridLayer(
        axis=axis,
        quads=np.stack(corners, axis=2).reshape(-1, 4, 2),
        values=values.ravel(),
        meets=meets.ravel(),
        outline=section @ box.axes[across].T,
    )
