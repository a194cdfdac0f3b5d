"""Bringing the boundary of a tet mesh onto the surface it approximates.

fTetWild's boundary lies within an envelope of the part. Here its nodes go onto the part's faces,
sharp edges and corners, as far as the tets around them allow, so that flat faces are flat and a
plane selects all of a face.
"""

import itertools

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from fea import TetMesh
from fea.tet_mesh import tet_volumes
from texmap_opt.edge_pairs import EdgePairs
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh

# Faces that meet at more than this are an edge of the part [degrees]; smoother ones are curved.
SHARP_ANGLE = 35.0
# Nodes this many envelopes from a sharp edge are meant to lie on it: its mesh edge strays by one,
# the part's by one where the mesher simplified it.
REACHES_TO_EDGE = 2.5
# A node moves only as far as every tet around it keeps this share of its volume and quality.
LEAST_SHARE = 0.3
# Halvings of a node's way before it stays where it is.
MAX_HALVINGS = 8
# Nodes held back by a tet may go further once its other nodes have arrived.
ROUNDS = 3


def fitted_to_surface(
    nodes: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "cells 4"],
    surface: TriMesh,
    *,
    query: SignedDistance,
    reach: float,
) -> Float[np.ndarray, "nodes 3"]:
    """Nodes with those of the boundary moved onto a surface.

    Args:
        nodes: positions [mm].
        tets: corners, of positive volume.
        surface: what the boundary approximates.
        query: distance queries of the surface.
        reach: how far the boundary may be from the surface [mm]; no node moves further than
            `REACHES_TO_EDGE` times this in one of `ROUNDS`.
    """
    facets = TetMesh(nodes, tets).boundary_facets
    # What tets must keep is measured by how they came, however many rounds follow.
    least = LEAST_SHARE * np.stack([tet_volumes(nodes, tets), _quality(nodes, tets)])
    for _ in range(ROUNDS):
        way = _way_to_surface(nodes, facets, surface, query, reach)
        nodes = _as_far_as_tets_allow(nodes, tets, way, least)
    return nodes


def _way_to_surface(
    nodes: Float[np.ndarray, "nodes 3"],
    facets: Int[np.ndarray, "facets 3"],
    surface: TriMesh,
    query: SignedDistance,
    reach: float,
) -> Float[np.ndarray, "nodes 3"]:
    """How each boundary node would have to move to be where it belongs [mm]."""
    boundary = np.unique(facets)
    goal = nodes.copy()
    _, _, goal[boundary] = query.unsigned(nodes[boundary])
    edges = _sharp_edges(surface)
    if len(edges):
        _pull_to_edges(goal, nodes, facets, surface.vertices, edges, REACHES_TO_EDGE * reach)
    way = goal - nodes
    far = np.linalg.norm(way, axis=1) > REACHES_TO_EDGE * reach
    way[far] = 0
    return way


def _as_far_as_tets_allow(
    nodes: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "cells 4"],
    way: Float[np.ndarray, "nodes 3"],
    least: Float[np.ndarray, "2 cells"],
) -> Float[np.ndarray, "nodes 3"]:
    """Nodes moved, each so far that no tet falls below its least volume and quality."""
    share = np.where(way.any(axis=1), 1.0, 0.0)
    moved = nodes + way
    for halving in itertools.count(1):
        bad = (tet_volumes(moved, tets) < least[0]) | (_quality(moved, tets) < least[1])
        # A tet whose nodes all stay is as it was, good or bad.
        bad &= (share[tets] > 0).any(axis=1)
        if not bad.any():
            break
        # Ends for certain: each later round stills a node.
        share[tets[bad]] *= 0.5 if halving <= MAX_HALVINGS else 0.0
        moved = nodes + share[:, None] * way
    return moved


def _sharp_edges(surface: TriMesh) -> Int[np.ndarray, "edges 2"]:
    """Vertices of the edges where faces meet at more than `SHARP_ANGLE`."""
    edges = EdgePairs(surface.faces)
    a, b = edges.joined.T // 3
    cosine = np.einsum("ij,ij->i", surface.face_normals[a], surface.face_normals[b])
    return edges.half_edges[edges.joined[cosine < np.cos(np.radians(SHARP_ANGLE)), 0]]


def _pull_to_edges(
    goal: Float[np.ndarray, "nodes 3"],
    nodes: Float[np.ndarray, "nodes 3"],
    facets: Int[np.ndarray, "facets 3"],
    vertices: Float[np.ndarray, "vertices 3"],
    edges: Int[np.ndarray, "edges 2"],
    reach: float,
) -> None:
    """Give nodes on the mesh's own sharp edges goals on the part's, and on its corners."""
    mesh_edges = _sharp_edges(TriMesh(nodes, facets))
    on_edge = np.unique(mesh_edges)
    if on_edge.size == 0:
        return
    # Segments as triangles with a corner twice: the nearest point is the same.
    segments = SignedDistance(TriMesh(vertices, edges[:, [0, 1, 1]]))
    distance, _, nearest = segments.unsigned(nodes[on_edge])
    close = distance <= reach
    goal[on_edge[close]] = nearest[close]
    # A corner of the part: where other than two sharp edges meet, or two at an angle.
    corners = vertices[_corners(vertices, edges)]
    if len(corners):
        away, node = KDTree(nodes[on_edge]).query(corners)
        near = away <= reach
        goal[on_edge[np.asarray(node)[near]]] = corners[near]


def _corners(
    vertices: Float[np.ndarray, "vertices 3"], edges: Int[np.ndarray, "edges 2"]
) -> Int[np.ndarray, " corners"]:
    count = np.bincount(edges.reshape(-1), minlength=len(vertices))
    along = vertices[edges[:, 1]] - vertices[edges[:, 0]]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    # Of two edges that leave a vertex the unit vectors add up to nothing when it is no corner.
    leaving = np.zeros_like(vertices)
    np.add.at(leaving, edges[:, 0], along)
    np.add.at(leaving, edges[:, 1], -along)
    bent = np.linalg.norm(leaving, axis=1) > 2 * np.sin(np.radians(SHARP_ANGLE) / 2)
    return np.flatnonzero((count > 0) & ((count != 2) | bent))


def _quality(
    nodes: Float[np.ndarray, "nodes 3"], tets: Int[np.ndarray, "cells 4"]
) -> Float[np.ndarray, " cells"]:
    """Volume over the cube of the root mean square edge: falls when a tet flattens or stretches."""
    corners = nodes[tets]
    ends = corners[:, [0, 0, 0, 1, 1, 2]] - corners[:, [1, 2, 3, 2, 3, 3]]
    return tet_volumes(nodes, tets) / (ends**2).sum(axis=(1, 2)) ** 1.5
