"""A net of unit cells mapped into a warped grid of hexahedra."""

import itertools

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.errors import CaseError, nearest_name
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.tile import tile

RADIUS_MODES = ("constant", "scaled")


def map_structure(
    cell: UnitCell,
    grid_nodes: Float[np.ndarray, "_ _ _ 3"],
    radius: float,
    *,
    radius_mode: str = "constant",
    section: str | None = None,
) -> Structure:
    """Fill every hexahedron of a grid with a unit cell.

    Each joint goes where the trilinear map of its hexahedron takes it; struts stay straight.
    Neighbours agree on shared joints, because on a face the map depends on that face's nodes only.

    Args:
        cell: the unit cell.
        grid_nodes: nodes of the grid [mm], indexed along the three grid directions.
        radius: strut radius [mm]; times the cell file's relative radius of each strut.
        radius_mode: "constant", or "scaled": times the size of the warped cell.
        section: "round" or "square"; None takes the cell's own.

    Raises:
        CaseError: for an unknown radius mode or a radius that is not positive.
    """
    if radius_mode not in RADIUS_MODES:
        raise CaseError(
            f'radius_mode is "{radius_mode}"; {nearest_name(radius_mode, RADIUS_MODES)}'
        )
    if not (np.isfinite(radius) and radius > 0):
        raise CaseError(f"radius_mm is {radius:g} mm; it must be a positive number.")
    nx, ny, nz = (n - 1 for n in grid_nodes.shape[:3])
    net = tile(cell, (nx, ny, nz))
    cell_size = net.sharing @ cell_sizes(grid_nodes).reshape(-1)
    radii = radius * net.relative_radius
    if radius_mode == "scaled":
        radii = radii * cell_size
    return Structure(
        joints=trilinear(grid_nodes, net.joint_cell, net.joint_local),
        struts=net.struts,
        radii=np.repeat(radii[:, None], 2, axis=1),
        cut=np.zeros(len(net.joints), bool),
        cell_size=cell_size,
        section=cell.section if section is None else section,
    )


def trilinear(
    grid_nodes: Float[np.ndarray, "_ _ _ 3"],
    cell: Int[np.ndarray, "samples 3"],
    local: Float[np.ndarray, "samples 3"],
) -> Float[np.ndarray, "samples 3"]:
    """Positions [mm] of points given by their cell and their coordinates in it, 0 to 1."""
    position = np.zeros((len(cell), 3))
    for corner in itertools.product((0, 1), repeat=3):
        weight = np.prod(np.where(corner, local, 1 - local), axis=1)
        i, j, k = (cell + np.array(corner)).T
        position += weight[:, None] * grid_nodes[i, j, k]
    return position


def cell_sizes(grid_nodes: Float[np.ndarray, "_ _ _ 3"]) -> Float[np.ndarray, "_ _ _"]:
    """Size of each warped cell relative to a uniform one; 1 in a uniform grid.

    The mean over its twelve edges of edge length over the uniform edge in the same grid direction.
    (The cube root of the volume ratio would call a flattened cell small although its struts in the
    plane are long; edges are what struts follow.) The uniform edge is the distance between the
    grid's own corners over the number of cells: corners stay put when nodes slide in the box.
    """
    total = np.zeros(tuple(n - 1 for n in grid_nodes.shape[:3]))
    for axis in range(3):
        nodes = np.moveaxis(grid_nodes, axis, 0)
        corners = nodes[:, [0, 0, -1, -1], [0, -1, 0, -1]]
        chord = np.linalg.norm(corners[-1] - corners[0], axis=-1).mean()
        edges = np.linalg.norm(np.diff(nodes, axis=0), axis=-1) * (len(nodes) - 1) / chord
        four = edges[:, :-1, :-1] + edges[:, 1:, :-1] + edges[:, :-1, 1:] + edges[:, 1:, 1:]
        total += np.moveaxis(four, 0, axis)
    return total / 12
