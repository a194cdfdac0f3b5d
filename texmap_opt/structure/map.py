"""A net of unit cells mapped into a warped grid.

Joints, sizes and volumes take the grid's nodes as NumPy or JAX arrays and return the same kind: JAX
differentiates them in the nodes. Which joint lies in which cell, the net, does not depend on them.
"""

import itertools

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.errors import CaseError, nearest_name
from texmap_opt.structure.net import Net
from texmap_opt.structure.structure import Origin, Structure
from texmap_opt.warp.cell_corners import Kind, side

RADIUS_MODES = ("constant", "scaled")


def map_structure(
    net: Net,
    grid_nodes: Float[np.ndarray, "*nodes 3"],
    radius: float,
    *,
    radius_mode: str = "constant",
    section: str | None = None,
) -> Structure:
    """Fill the cells of a grid with a net of unit cells.

    Each joint goes where the multilinear map of its cell takes it; struts stay straight. Neighbours
    agree on shared joints, because on a face the map depends on that face's nodes only.

    Args:
        net: as many cells along each direction as the grid has.
        grid_nodes: positions of the grid's nodes [mm], indexed along its two or three directions.
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
    cell_size = mapped_sizes(net, grid_nodes)
    radii = radius * net.relative_radius
    if radius_mode == "scaled":
        radii = radii * cell_size
    return Structure(
        joints=mapped_joints(net, grid_nodes),
        struts=net.struts,
        radii=np.repeat(radii[:, None], 2, axis=1),
        cut=np.zeros(len(net.joints), bool),
        cell_size=cell_size,
        section=net.section if section is None else section,
        origin=Origin(net.cell, net.kind, net.kinds),
    )


def mapped_joints(net: Net, nodes: Float[Kind, "*nodes 3"]) -> Float[Kind, "joints 3"]:
    """Where the grid's nodes [mm] take the joints of a net [mm]."""
    return multilinear(nodes, net.joint_cell, net.joint_local)


def mapped_sizes(net: Net, nodes: Float[Kind, "*nodes 3"]) -> Float[Kind, " struts"]:
    """Mean of `cell_sizes` over the cells that share each strut of a net."""
    xp = nodes.__array_namespace__()
    sharing = net.sharing
    shares = sharing.data * cell_sizes(nodes).reshape(-1)[sharing.indices]
    # A product with a sparse matrix that NumPy and JAX both know; no row of it is empty.
    return xp.add.reduceat(shares, sharing.indptr[:-1])


def multilinear(
    nodes: Float[Kind, "*nodes space"],
    cell: Int[np.ndarray, "samples d"],
    local: Float[np.ndarray, "samples d"],
) -> Float[Kind, "samples space"]:
    """Positions of points given by their cell and their coordinates in it, 0 to 1.

    Args:
        nodes: of the grid [mm]; two grid directions or three.
        cell: index of the cell along each grid direction.
        local: coordinates in the cell.
    """
    *shape, space = nodes.shape
    d = len(shape)
    # Distance in the flat array of two nodes that are neighbours along each direction.
    stride = np.cumprod([1, *shape[:0:-1]])[::-1]
    first, flat = cell @ stride, nodes.reshape(-1, space)
    sides = [(1 - local[:, axis], local[:, axis]) for axis in range(d)]

    def share(corner: tuple[int, ...]) -> Float[Kind, "samples space"]:
        weight = np.prod([sides[axis][side] for axis, side in enumerate(corner)], axis=0)
        return weight[:, None] * flat[first + np.array(corner) @ stride]

    lowest, *others = itertools.product((0, 1), repeat=d)
    position = share(lowest)
    for corner in others:
        position = position + share(corner)
    return position


def cell_sizes(nodes: Float[Kind, "*nodes space"]) -> Float[Kind, "*cells"]:
    """Size of each warped cell relative to a uniform one; 1 in a uniform grid.

    The mean over its edges, twelve or four, of edge length over the uniform edge in the same grid
    direction. (The d-th root of the volume ratio would call a flattened cell small although its
    struts in the plane are long; edges are what struts follow.) The uniform edge is the distance
    between the grid's own corners over the number of cells: corners stay put when nodes slide in
    the box.

    Args:
        nodes: of the grid [mm]; two grid directions or three.
    """
    xp = nodes.__array_namespace__()
    d = nodes.ndim - 1
    corners = nodes[np.ix_(*[[0, -1]] * d)]
    total = 0
    for axis in range(d):
        chord = xp.linalg.norm(xp.diff(corners, axis=axis), axis=-1).mean()
        edges = xp.linalg.norm(xp.diff(nodes, axis=axis), axis=-1) * (nodes.shape[axis] - 1) / chord
        for other in (k for k in range(d) if k != axis):
            lower, upper = (side(edges, other, end) for end in (0, 1))
            edges = lower + upper
        total = total + edges
    return total / (d * 2 ** (d - 1))
