"""Triangles of a surface that cross each other.

Candidates come from a box hierarchy; the test is that of edges against triangles with signed
volumes (Guigue and Devillers 2003 use the same predicates). A sign counts only when it is larger
than the rounding error of its determinant, so that triangles which merely touch do not cross.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from texmap_opt.box_pairs import box_pairs
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh

# Shewchuk (1997), static bound for orient3d: (7 + 56 eps) eps times the permanent; the differences
# of coordinates are rounded too, hence the round 16.
ROUNDING = 16 * np.finfo(np.float64).eps / 2
# Pairs tested at once: about 300 MB of temporary arrays.
PAIRS_PER_CHUNK = 200_000

# Steps along each edge of a crossing triangle between the points where the overlap is measured.
OVERLAP_STEPS = 6
# Share of the diagonal that a probe is off the surface: beyond rounding, below any real detail.
PROBE_OFFSET = 1e-7


@dataclass(frozen=True, eq=False)
class Overlap:
    """How far a closed surface passes through itself.

    Attributes:
        pairs: pairs of faces that cross.
        depth: thickness of the thickest place enclosed twice, or less than never [mm].
    """

    pairs: Int[np.ndarray, "pairs 2"]
    depth: float

    @property
    def faces(self) -> int:
        """Number of faces that cross another."""
        return len(np.unique(self.pairs))


def self_overlap(surface: TriMesh) -> Overlap:
    """Faces that cross, and how deep, for a closed, outward oriented surface.

    A point of the surface of a solid has winding number 0 in front and 1 behind. Where it has not,
    the surface lies in an overlap, whose thickness is the way to the next face along the normal.
    """
    pairs = crossing_faces(surface)
    if len(pairs) == 0:
        return Overlap(pairs, 0.0)
    query = SignedDistance(surface)
    # All faces at their centroid, for parts that lie wholly in an overlap; crossing ones densely.
    crossing = np.unique(pairs)
    corners = surface.vertices[surface.faces]
    steps = np.arange(OVERLAP_STEPS)
    i, j = (index.reshape(-1) for index in np.meshgrid(steps, steps, indexing="ij"))
    i, j = i[i + j < OVERLAP_STEPS], j[i + j < OVERLAP_STEPS]
    weights = (np.stack([i, j, OVERLAP_STEPS - 1 - i - j], axis=1) + 1 / 3) / OVERLAP_STEPS
    dense = np.einsum("sk,fkd->fsd", weights, corners[crossing]).reshape(-1, 3)
    points = np.concatenate([corners.mean(axis=1), dense])
    normals = np.concatenate(
        [surface.face_normals, np.repeat(surface.face_normals[crossing], len(weights), axis=0)]
    )
    step = PROBE_OFFSET * float(np.linalg.norm(np.diff(surface.bounds, axis=0))) * normals
    front = np.rint(query.winding_number(points + step))
    back = np.rint(query.winding_number(points - step))
    depths = [0.0]
    for wrong, sense in ((front < 0, 1.0), (back > 1, -1.0)):
        if wrong.any():
            along = sense * normals[wrong]
            path, _ = query.first_hit(points[wrong] + sense * step[wrong], along)
            depths.append(float(path[np.isfinite(path)].max(initial=0.0)))
    return Overlap(pairs, max(depths))


def crossing_faces(surface: TriMesh) -> Int[np.ndarray, "pairs 2"]:
    """Pairs of faces (i < j) of which an edge of one passes through the other.

    Faces with a common edge are never a pair; faces that overlap within one plane are not found.

    Raises:
        PartError: the triangles are so tangled that the pairs cannot be counted.
    """
    corners = surface.vertices[surface.faces]
    pairs = box_pairs(corners.min(axis=1), corners.max(axis=1))
    common = (surface.faces[pairs[:, 0], :, None] == surface.faces[pairs[:, 1], None, :]).sum(
        axis=(1, 2)
    )
    pairs = pairs[common < 2]
    # Most pairs fall at the first question: does the one reach across the plane of the other?
    found = [pairs[:0]]
    for start in range(0, len(pairs), PAIRS_PER_CHUNK):
        chunk = pairs[start : start + PAIRS_PER_CHUNK]
        a, b = corners[chunk[:, 0]], corners[chunk[:, 1]]
        across_b, across_a = _sides(a, b), _sides(b, a)
        may = _straddles(across_b) & _straddles(across_a)
        a, b, chunk = a[may], b[may], chunk[may]
        hit = _edges_pierce(a, across_b[may], b) | _edges_pierce(b, across_a[may], a)
        found.append(chunk[hit])
    return np.concatenate(found)


def _straddles(sides: Int[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    return np.any(sides > 0, axis=1) & np.any(sides < 0, axis=1)


def _sides(a: Float[np.ndarray, "n 3 3"], b: Float[np.ndarray, "n 3 3"]) -> Int[np.ndarray, "n 3"]:
    """On which side of the plane of triangle b each corner of triangle a lies."""
    return np.stack([_sign(b[:, 0], b[:, 1], b[:, 2], a[:, k]) for k in range(3)], axis=1)


def _edges_pierce(
    a: Float[np.ndarray, "n 3 3"], sides: Int[np.ndarray, "n 3"], b: Float[np.ndarray, "n 3 3"]
) -> Bool[np.ndarray, " n"]:
    """Whether an edge of triangle a passes through triangle b, given the sides of a's corners."""
    hit = np.zeros(len(a), dtype=bool)
    for k in range(3):
        end = (k + 1) % 3
        through_plane = sides[:, k] * sides[:, end] < 0
        turns = np.stack(
            [_sign(a[:, k], a[:, end], b[:, m], b[:, (m + 1) % 3]) for m in range(3)], axis=1
        )
        inside = ~((turns > 0).any(axis=1) & (turns < 0).any(axis=1)) & (turns != 0).any(axis=1)
        hit |= through_plane & inside
    return hit


def _sign(
    a: Float[np.ndarray, "n 3"],
    b: Float[np.ndarray, "n 3"],
    c: Float[np.ndarray, "n 3"],
    d: Float[np.ndarray, "n 3"],
) -> Int[np.ndarray, " n"]:
    """Sign of the volume of the tetrahedron abcd; 0 where rounding could change it."""
    u, v, w = (a - d).T, (b - d).T, (c - d).T
    minors = [(v[i] * w[j], v[j] * w[i]) for i, j in ((1, 2), (2, 0), (0, 1))]
    volume = sum(u[k] * (plus - minus) for k, (plus, minus) in enumerate(minors))
    permanent = sum(
        np.abs(u[k]) * (np.abs(plus) + np.abs(minus)) for k, (plus, minus) in enumerate(minors)
    )
    return np.where(np.abs(volume) > ROUNDING * permanent, np.sign(volume), 0).astype(np.int64)
