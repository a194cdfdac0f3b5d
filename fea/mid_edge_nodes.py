"""Mid-edge nodes of quadratic tetrahedra (VTK order): placed, compared with the middle, checked."""

import numpy as np
from jaxtyping import Bool, Float, Int

from fea.elements import TETRAHEDRON_EDGES
from fea.errors import FeaError, position_text

# Mid-edge nodes closer to the middle than this many roundings of the largest coordinate are there.
STRAIGHT_ULPS = 8


def with_mid_edge_nodes(
    nodes: Float[np.ndarray, "nodes 3"], tets: Int[np.ndarray, "cells 4"]
) -> tuple[Float[np.ndarray, "more 3"], Int[np.ndarray, "cells 10"]]:
    """Nodes and cells of a tet4 mesh with one more node in the middle of each edge."""
    key, number = np.unique(_edge_keys(tets, len(nodes)).T, return_inverse=True)
    middle = nodes[_ends(key, len(nodes))].mean(axis=-2)
    quadratic = np.concatenate([tets, len(nodes) + number.reshape(-1, 6)], axis=1)
    return np.concatenate([nodes, middle]), quadratic


def off_middle(
    nodes: Float[np.ndarray, "nodes 3"], tets: Int[np.ndarray, "cells 10"]
) -> Bool[np.ndarray, " cells"]:
    """Cells with a mid-edge node away from the middle of its edge."""
    rounding = STRAIGHT_ULPS * np.finfo(float).eps * np.abs(nodes).max()
    off = np.zeros(len(tets), dtype=bool)
    for edge, (a, b) in enumerate(TETRAHEDRON_EDGES):
        middle = (nodes[tets[:, a]] + nodes[tets[:, b]]) / 2
        off |= ~(np.abs(nodes[tets[:, 4 + edge]] - middle).max(axis=1) <= rounding)
    return off


def check_mid_edge_nodes(
    nodes: Float[np.ndarray, "nodes 3"], tets: Int[np.ndarray, "cells 10"]
) -> None:
    """Raise unless each edge has one mid-edge node and each mid-edge node one edge.

    Cells that share corners and not the node between come apart along the edge: the mesh looks
    whole, and is far too soft.

    Raises:
        FeaError: naming both cells, the edge, its place and the nodes.
    """
    key = _edge_keys(tets, len(nodes)).ravel()  # by edge, then by cell
    middle = np.ascontiguousarray(tets[:, 4:].T).ravel()
    edge_of = np.full(len(nodes), -1)
    edge_of[middle] = key  # the last edge stays; another finds a node that is not its own
    if (edge_of[middle] != key).any():
        _refuse_second_edge(nodes, key, middle, edge_of)
    is_corner = np.zeros(len(nodes), dtype=bool)
    is_corner[tets[:, :4].ravel()] = True
    if (is_corner & (edge_of >= 0)).any():
        _refuse_corner_in_the_middle(nodes, tets, is_corner & (edge_of >= 0))
    # Each node has one edge by now: an edge that occurs twice here has two nodes.
    edges = np.sort(edge_of[edge_of >= 0])
    twice = edges[1:] == edges[:-1]
    if twice.any():
        _refuse_second_node(nodes, key, middle, np.unique(edges[1:][twice]))


def _refuse_second_edge(
    nodes: Float[np.ndarray, "nodes 3"],
    key: Int[np.ndarray, " edges"],
    middle: Int[np.ndarray, " edges"],
    edge_of: Int[np.ndarray, " nodes"],
) -> None:
    other = edge_of[middle] != key
    first = int(np.argmax(other))
    node = int(middle[first])
    second = int(np.argmax((middle == node) & ~other))
    cells = len(key) // len(TETRAHEDRON_EDGES)
    (a, b), (c, d) = _ends(key[[first, second]], len(nodes))
    raise FeaError(
        f"{len(np.unique(middle[other]))} mid-edge nodes lie on more than one edge: the first, node "
        f"{node} at {position_text(nodes[node])} mm, is between nodes {a} and {b} in cell "
        f"{first % cells} and between nodes {c} and {d} in cell {second % cells}; list the mid-edge "
        "nodes of each cell in the order of edges 01, 12, 20, 03, 13, 23 (Gmsh has the last two "
        "the other way round)."
    )


def _refuse_corner_in_the_middle(
    nodes: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "cells 10"],
    both: Bool[np.ndarray, " nodes"],
) -> None:
    node = int(np.argmax(both))
    corner_of = int(np.argmax((tets[:, :4] == node).any(axis=1)))
    cell, edge = np.argwhere(tets[:, 4:] == node)[0]
    a, b = np.sort(tets[cell, TETRAHEDRON_EDGES[edge]])
    raise FeaError(
        f"{np.count_nonzero(both)} nodes are corners and mid-edge nodes at once: the first, node "
        f"{node} at {position_text(nodes[node])} mm, is a corner of cell {corner_of} and between "
        f"nodes {a} and {b} in cell {cell}, so the cells do not fit together there; divide both "
        "alike, or remesh."
    )


def _refuse_second_node(
    nodes: Float[np.ndarray, "nodes 3"],
    key: Int[np.ndarray, " edges"],
    middle: Int[np.ndarray, " edges"],
    shared: Int[np.ndarray, " shared"],
) -> None:
    (places,) = np.nonzero(key == shared[0])
    first = places[0]
    second = places[np.argmax(middle[places] != middle[first])]
    cells = len(key) // len(TETRAHEDRON_EDGES)
    a, b = _ends(shared[:1], len(nodes))[0]
    one, two = sorted([(first % cells, middle[first]), (second % cells, middle[second])])
    raise FeaError(
        f"{len(shared)} edges have more than one mid-edge node, so the cells around them come "
        f"apart: the first, between nodes {a} and {b} at "
        f"{position_text((nodes[a] + nodes[b]) / 2)} mm, has node {one[1]} in cell {one[0]} and "
        f"node {two[1]} in cell {two[0]}; merge such nodes into one."
    )


def _edge_keys(tets: Int[np.ndarray, "cells corners"], nodes: int) -> Int[np.ndarray, "6 cells"]:
    """A number for each edge of each cell, the same from whichever end it is seen."""
    a, b = np.ascontiguousarray(tets[:, :4].T).astype(np.int64)[TETRAHEDRON_EDGES.T]
    return np.minimum(a, b) * nodes + np.maximum(a, b)


def _ends(key: Int[np.ndarray, " edges"], nodes: int) -> Int[np.ndarray, "edges 2"]:
    """The two nodes that a key is made of, the lower one first."""
    return np.stack(np.divmod(key, nodes), axis=-1)
