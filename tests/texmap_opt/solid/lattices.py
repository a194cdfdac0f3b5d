"""Lattices that the tests of the mesher share."""

import numpy as np
import scipy.sparse.csgraph
from scipy.spatial import KDTree

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.tile import tile

# Edge of the cells of `block` [mm].
EDGE = 5.0


def structure(joints, struts, radii, section="round") -> Structure:
    """Joints [mm], struts, and radii [mm] of all of them, of each or of each end."""
    joints, struts = np.asarray(joints, dtype=float), np.asarray(struts, dtype=np.int64)
    radii = np.asarray(radii, dtype=float)
    radii = np.broadcast_to(radii if radii.ndim == 2 else radii[..., None], struts.shape).copy()
    return Structure(
        joints, struts, radii, np.zeros(len(joints), bool), np.ones(len(struts)), section
    )


def octet(cells: int, edge: float, radius: float, section: str = "round") -> Structure:
    """Octet truss: face-centred cubic points, joined to their twelve neighbours."""
    corners = np.stack(np.meshgrid(*[np.arange(cells + 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    base = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]])
    points = (corners[:, None] + base).reshape(-1, 3)
    points = points[(points <= cells + 1e-9).all(axis=1)]
    struts = KDTree(points).query_pairs(0.75, output_type="ndarray")
    return structure(points * edge, struts, radius, section)


def block(name: str, cells: int, *, slenderness: float, warp: float = 0.0) -> Structure:
    """A cube, or square, of cells of the library, with nodes moved by smooth waves.

    Args:
        name: of the cell.
        cells: along each axis.
        slenderness: radius over the shortest strut's length.
        warp: amplitude of the waves over the cell's edge; below 0.15 no cell folds.
    """
    cell = unit_cell(name)
    d = cell.dimensions
    ticks = np.meshgrid(*[np.arange(cells + 1.0)] * d, indexing="ij")
    nodes = np.zeros((*ticks[0].shape, 3))
    nodes[..., :d] = np.stack(ticks, axis=-1)
    for k in range(d):  # waves that are no symmetry of the block
        nodes[..., k] += warp * np.sin(2.1 * ticks[k - 1] + 0.7 * ticks[k] + k)
    net = tile(cell, (cells,) * d)
    thin = map_structure(net, EDGE * nodes, 1.0)
    radius = slenderness * float(thin.lengths().min())
    whole = map_structure(net, EDGE * nodes, radius)
    if d == 3:
        return whole
    return whole.extruded(np.array([0.0, 0.0, 1.0]), np.array([0.0, EDGE]))


def jittered(lattice: Structure, amplitude: float, seed: int) -> Structure:
    """Every joint moved by up to `amplitude` [mm] along each axis, radii down to half."""
    random = np.random.default_rng(seed)
    joints = lattice.joints + random.uniform(-amplitude, amplitude, lattice.joints.shape)
    radii = lattice.radii * random.uniform(0.5, 1.0, lattice.radii.shape)
    return structure(joints, lattice.struts, radii, lattice.section)


def loops(lattice: Structure) -> tuple[int, int]:
    """Independent loops of the graph, E - V + C, and its connected components C."""
    n, struts = len(lattice.joints), lattice.struts
    graph = scipy.sparse.coo_array((np.ones(len(struts)), tuple(struts.T)), (n, n))
    count, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    used = np.unique(struts)
    parts = len(np.unique(label[used]))
    assert count >= parts
    return len(struts) - len(used) + parts, parts
