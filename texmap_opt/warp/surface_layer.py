"""Which nodes of a grid are to lie on the part's surface.

Of every grid edge that crosses the surface the nearer end. On a flat surface with unit normal n, in
a grid of straight cells with edges e_k, that end is no farther off than half of |n . e_k|, so what
is chosen is the slab of nodes with |distance| <= max_k |n . e_k| / 2: a naive digital plane
(Andres, Acharya, Sibata: Discrete analytical hyperplanes. Graphical Models and Image Processing 59
(1997) 302-309). It holds exactly one node of every grid line along the k of the maximum; hence the
layer is closed, and no corner of a cell is chosen with all its neighbours in the cell, which on the
surface would be flat. Where the surface is curved, or the cells are, the second is checked corner
by corner.

Sharp edges of a part need one thing more: a node just outside of one has no neighbour inside. So
nodes that are nearly on the surface are chosen too; the slab above holds them all.
"""

import numpy as np
import scipy.sparse
from jaxtyping import Bool, Float, Int

from texmap_opt.warp.cell_corners import corners, side
from texmap_opt.warp.grid import Grid

# By how much the outer end of an edge must be nearer than the inner one to be chosen. Surfaces
# half way between two layers of nodes are common, and rounding or the solver's tolerance must not
# choose node by node between the layers.
INNER_PREFERENCE = 0.1

# A node is on the surface already if its distance is less than this share of the largest difference
# of the distance along one of its edges. Below (1 - 0.1) / (2 - 0.1) = 0.47, the half width of the
# slab in that measure, so that on a flat surface it adds nothing.
ALREADY_THERE = 0.4

# Least derivative of the distance in the directions a node may move in: it must not have to go
# more than three times its distance, nor lie half way between two walls, where it is zero.
LEAST_SLOPE = 1 / 3

# Least volume at a corner of a cell, over what it is now, when its node and all neighbours in the
# cell have gone to the surface: zero where that is flat, one at the corner of a part.
LEAST_CORNER = 0.2


def crossing_edges(grid: Grid, distance: Float[np.ndarray, " nodes"]) -> Int[np.ndarray, "_ 2"]:
    """Flat node numbers of the ends of every grid edge that crosses the surface, the inner first.

    Args:
        grid: the grid.
        distance: signed distance of its nodes [mm]; zero counts as outside.
    """
    number = np.arange(distance.size).reshape(grid.nodes.shape[:-1])
    edges = np.concatenate(
        [
            np.stack([side(number, axis, 0).ravel(), side(number, axis, 1).ravel()], axis=1)
            for axis in range(grid.dimensions)
        ]
    )
    inside = distance[edges] < 0
    edges, inside = (part[inside[:, 0] != inside[:, 1]] for part in (edges, inside))
    return np.where(inside[:, :1], edges, edges[:, ::-1])


def surface_layer(
    grid: Grid,
    distance: Float[np.ndarray, " nodes"],
    slope: Float[np.ndarray, "nodes d"],
) -> Int[np.ndarray, " samples"]:
    """Flat numbers of the nodes that are to lie on the surface, in ascending order.

    Args:
        grid: free of folds.
        distance: signed distance of its nodes [mm].
        slope: gradient of the distance at the nodes; only those near the surface matter.
    """
    d = grid.dimensions
    free = np.moveaxis(grid.free, 0, -1).reshape(-1, d)
    way = np.where(free, slope, 0.0)
    steepness = np.linalg.norm(way, axis=1)
    movable = steepness >= LEAST_SLOPE
    edges = crossing_edges(grid, distance)
    off = np.where(movable, np.abs(distance), np.inf)
    outer = off[edges[:, 1]] < (1 - INNER_PREFERENCE) * off[edges[:, 0]]
    chosen = off < ALREADY_THERE * _largest_steps(grid, distance)
    chosen[np.where(outer, edges[:, 1], edges[:, 0])] = True
    chosen &= movable
    # One step of Newton's method towards the surface, in the directions that are free.
    step = np.divide(distance, steepness**2, out=np.zeros_like(distance), where=chosen)
    moved = grid.nodes.reshape(-1, d) - step[:, None] * way
    _drop_flat_corners(chosen, _flat_corners(grid, chosen, moved), edges, np.abs(distance))
    return np.flatnonzero(chosen)


def _largest_steps(
    grid: Grid, distance: Float[np.ndarray, " nodes"]
) -> Float[np.ndarray, " nodes"]:
    """The largest difference of the distance along an edge of each node [mm]."""
    field = distance.reshape(grid.nodes.shape[:-1])
    largest = np.zeros(field.shape)
    for axis in range(grid.dimensions):
        step = np.abs(np.diff(field, axis=axis))
        for end in (0, 1):
            part = side(largest, axis, end)
            np.maximum(part, step, out=part)
    return largest.ravel()


def _flat_corners(
    grid: Grid, chosen: Bool[np.ndarray, " nodes"], moved: Float[np.ndarray, "nodes d"]
) -> Int[np.ndarray, "_ _"]:
    """Corners of cells, each as its node and its neighbours, that chosen nodes alone flatten.

    Where one of the neighbours is not chosen the others leave it room: it may go off the surface.
    The worst corner is the first.
    """
    d = grid.dimensions
    number = np.arange(chosen.size).reshape(grid.nodes.shape[:-1])
    corner = {ends: at.ravel() for ends, at in corners(number, d).items()}
    crowded = sum(chosen[at].astype(int) for at in corner.values()) > d
    flat, ratios = [], []
    for sides, at in corner.items():
        beside = [tuple(s ^ (k == axis) for k, s in enumerate(sides)) for axis in range(d)]
        nodes = np.stack([part[crowded] for part in (at, *(corner[other] for other in beside))], 1)
        nodes = nodes[chosen[nodes].all(axis=1)]
        before, after = (
            np.linalg.det(x[nodes[:, 1:]] - x[nodes[:, :1]])
            for x in (grid.nodes.reshape(-1, d), moved)
        )
        # Both have the sign of the corner, which is that of the product of its edges' directions.
        ratio = after / before
        flat.append(nodes[ratio < LEAST_CORNER])
        ratios.append(ratio[ratio < LEAST_CORNER])
    return np.concatenate(flat)[np.argsort(np.concatenate(ratios), kind="stable")]


def _drop_flat_corners(
    chosen: Bool[np.ndarray, " nodes"],
    corners: Int[np.ndarray, "_ _"],
    edges: Int[np.ndarray, "_ 2"],
    off: Float[np.ndarray, " nodes"],
) -> None:
    """Take back one node of each corner: the farthest of those without which the layer is closed.

    Where the layer needs all of them it is the farthest: a hole in the layer does less harm than a
    flat cell.
    """
    ends = np.concatenate([edges, edges[:, ::-1]])
    across = scipy.sparse.csr_array(
        (np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(chosen.size, chosen.size)
    )
    for corner in corners:
        if not chosen[corner].all():
            continue
        spare = [
            bool(chosen[across.indices[across.indptr[v] : across.indptr[v + 1]]].all())
            for v in corner
        ]
        candidates = corner[spare] if any(spare) else corner
        chosen[candidates[np.argmax(off[candidates])]] = False
