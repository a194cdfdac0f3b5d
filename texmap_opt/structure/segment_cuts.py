"""Where straight segments pass through a triangle surface: all crossings, not the first alone.

Candidate triangles come from a hierarchy of boxes that all segments descend together, one level
at a time, so the work is a few array operations per level whatever the triangles' sizes.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from texmap_opt.solid.tri_mesh import TriMesh

# Segments that descend together: bounds the candidate lists to about 100 MB.
SEGMENTS_PER_CHUNK = 50_000
# Sine of the angle to a facet below which a segment counts as lying in its plane: over its length
# it then leaves the plane by 1e-9 of that length, less than a surface is ever known to.
PARALLEL = 1e-9
# Barycentric coordinates this far outside a facet still count as inside, so that a segment through
# an edge or a corner is seen by at least one facet. Rounding in them is about 1e-16 / PARALLEL.
EDGE_SLACK = 1e-6
# Boxes grow by this share of the surface's size, so that touching is not lost to rounding.
BOX_SLACK = 1e-9


@dataclass(frozen=True, eq=False)
class Crossings:
    """Meetings of segments and facets, sorted along each segment.

    A meeting on an edge or corner of the surface is listed once per facet that sees it.

    Attributes:
        segment: index of the segment.
        position: where along it, 0 at its start and 1 at its end.
        face: the facet met.
    """

    segment: Int[np.ndarray, " samples"]
    position: Float[np.ndarray, " samples"]
    face: Int[np.ndarray, " samples"]


def crossings(
    surface: TriMesh, start: Float[np.ndarray, "samples 3"], end: Float[np.ndarray, "samples 3"]
) -> Crossings:
    """All crossings of segments with a surface.

    Segments that lie in a facet's plane do not cross that facet; where they leave it, they cross
    (or touch an edge of) the facet next to it.

    Args:
        surface: any triangle surface [mm].
        start: where each segment begins [mm].
        end: where it ends [mm].
    """
    levels, order = _hierarchy(surface)
    found = []
    for first in range(0, len(start), SEGMENTS_PER_CHUNK):
        chunk = slice(first, first + SEGMENTS_PER_CHUNK)
        segment, leaf = _candidates(levels, start[chunk], end[chunk])
        found.append(_meetings(surface, start, end, segment + first, order[leaf]))
    if not found:
        nothing = np.zeros(0, np.int64)
        return Crossings(nothing, np.zeros(0), nothing)
    segment, position, face = (np.concatenate(column) for column in zip(*found, strict=True))
    along = np.lexsort((position, segment))
    return Crossings(segment[along], position[along], face[along])


def _hierarchy(
    surface: TriMesh,
) -> tuple[list[tuple[np.ndarray, np.ndarray]], Int[np.ndarray, " faces"]]:
    """Boxes of a binary tree over the facets, root first, and the facet behind each leaf.

    The leaves are in the order of a k-d tree over the facets' centres, which keeps neighbours
    together; missing leaves are boxes that overlap nothing.
    """
    corners = surface.vertices[surface.faces]
    slack = BOX_SLACK * np.linalg.norm(np.ptp(surface.bounds, axis=0))
    order = KDTree(corners.mean(axis=1), leafsize=1).indices.astype(np.int64)
    leaves = 1 << (len(order) - 1).bit_length()
    low, high = np.full((leaves, 3), np.inf), np.full((leaves, 3), -np.inf)
    low[: len(order)] = corners[order].min(axis=1) - slack
    high[: len(order)] = corners[order].max(axis=1) + slack
    levels = [(low, high)]
    while len(low) > 1:
        low = np.minimum(low[0::2], low[1::2])
        high = np.maximum(high[0::2], high[1::2])
        levels.append((low, high))
    return levels[::-1], order


def _candidates(
    levels: list[tuple[np.ndarray, np.ndarray]],
    start: Float[np.ndarray, "samples 3"],
    end: Float[np.ndarray, "samples 3"],
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Pairs of segment and leaf whose bounding boxes overlap."""
    low, high = np.minimum(start, end), np.maximum(start, end)
    segment, box = np.arange(len(start)), np.zeros(len(start), np.int64)
    for level, (box_low, box_high) in enumerate(levels):
        if level > 0:
            segment = np.repeat(segment, 2)
            box = np.stack([2 * box, 2 * box + 1], axis=1).reshape(-1)
        near = (low[segment] <= box_high[box]) & (box_low[box] <= high[segment])
        near = near.all(axis=1)
        segment, box = segment[near], box[near]
    return segment, box


def _meetings(
    surface: TriMesh,
    start: Float[np.ndarray, "samples 3"],
    end: Float[np.ndarray, "samples 3"],
    segment: Int[np.ndarray, " n"],
    face: Int[np.ndarray, " n"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The candidate pairs that do meet, with the position along the segment.

    Möller, Trumbore, Fast, minimum storage ray-triangle intersection, Journal of Graphics Tools 2
    (1997) 21: solves start + t d = a + u e1 + v e2.
    """
    a, b, c = np.moveaxis(surface.vertices[surface.faces[face]], 1, 0)
    e1, e2, d = b - a, c - a, end[segment] - start[segment]
    normal = np.cross(e1, e2)
    determinant = -np.einsum("ij,ij->i", d, normal)
    size = np.linalg.norm(d, axis=1) * np.linalg.norm(normal, axis=1)
    crossing = np.abs(determinant) > PARALLEL * size
    segment, face, d, e1, e2, normal, determinant = (
        x[crossing] for x in (segment, face, d, e1, e2, normal, determinant)
    )
    offset = start[segment] - a[crossing]
    t = np.einsum("ij,ij->i", offset, normal) / determinant
    moment = np.cross(offset, d)
    u = np.einsum("ij,ij->i", e2, moment) / determinant
    v = -np.einsum("ij,ij->i", e1, moment) / determinant
    inside = (u >= -EDGE_SLACK) & (v >= -EDGE_SLACK) & (u + v <= 1 + EDGE_SLACK)
    met = inside & (t >= -EDGE_SLACK) & (t <= 1 + EDGE_SLACK)
    return segment[met], np.clip(t[met], 0, 1), face[met]
