"""Holes of a surface: the loops of its open edges, and small ones closed with triangles."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.edge_pairs import EdgePairs
from texmap_opt.solid.tri_mesh import TriMesh

# A hole of more edges is a missing piece rather than a defect of export or scanning.
MAX_HOLE_EDGES = 200
# Share of the surface's area that a single hole's patch, and all patches, may have.
MAX_PATCH_SHARE = 0.02


@dataclass(frozen=True, eq=False)
class Patched:
    """A surface with its holes closed.

    Attributes:
        surface: the vertices as they were, the patches' triangles after the others.
        holes: number of holes closed.
        area: of all patches [mm²].
        reach: largest distance of a point of a patch from the edges of its hole [mm]: how far the
            new surface can be from where the missing one was, were that within the hole's reach.
        largest: edges of the largest hole.
    """

    surface: TriMesh
    holes: int
    area: float
    reach: float
    largest: int


def hole_loops(faces: Int[np.ndarray, "faces 3"]) -> list[Int[np.ndarray, " _"]] | None:
    """Vertices around each hole, in the sense that a patch's triangles run.

    None when open edges do not form simple loops: some triangles are turned the wrong way, or
    several holes meet in a vertex.
    """
    edges = EdgePairs(faces)
    start, end = edges.half_edges[edges.open].T
    if len(np.unique(start)) != len(start) or not np.array_equal(np.sort(start), np.sort(end)):
        return None
    # A patch runs against the triangles at the rim.
    following = dict(zip(end.tolist(), start.tolist(), strict=True))
    loops = []
    while following:
        first, vertex = following.popitem()
        loop = [first]
        while vertex != first:
            loop.append(vertex)
            vertex = following.pop(vertex)
        loops.append(np.array(loop))
    return loops


def patched(surface: TriMesh, loops: list[Int[np.ndarray, " _"]]) -> Patched | None:
    """The surface with each hole closed by the patch of least area without new vertices.

    None when a hole or the patches exceed `MAX_HOLE_EDGES` or `MAX_PATCH_SHARE`.
    """
    if max(len(loop) for loop in loops) > MAX_HOLE_EDGES:
        return None
    patches = [loop[_least_area_triangles(surface.vertices[loop])] for loop in loops]
    closed = TriMesh(surface.vertices, np.concatenate([surface.faces, *patches]))
    area = float(closed.face_areas[len(surface.faces) :].sum())
    if area > MAX_PATCH_SHARE * float(surface.face_areas.sum()):
        return None
    reach = max(
        _distance_from_rim(surface.vertices, loop, patch)
        for loop, patch in zip(loops, patches, strict=True)
    )
    return Patched(closed, len(loops), area, reach, max(len(loop) for loop in loops))


def _least_area_triangles(rim: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "faces 3"]:
    """Triangulation of a closed polygon of least area (Barequet and Sharir 1995).

    Dynamic programming over chords, O(n³).
    """
    n = len(rim)
    cost = np.zeros((n, n))
    apex = np.zeros((n, n), dtype=np.int64)
    for span in range(2, n):
        for i in range(n - span):
            k = i + span
            m = np.arange(i + 1, k)
            area = np.linalg.norm(np.cross(rim[m] - rim[i], rim[k] - rim[i]), axis=1) / 2
            total = cost[i, m] + cost[m, k] + area
            best = int(np.argmin(total))
            cost[i, k], apex[i, k] = total[best], m[best]
    triangles, chords = [], [(0, n - 1)]
    while chords:
        i, k = chords.pop()
        if k - i < 2:
            continue
        m = int(apex[i, k])
        triangles.append((i, m, k))
        chords += [(i, m), (m, k)]
    return np.array(triangles)


def _distance_from_rim(
    vertices: Float[np.ndarray, "vertices 3"],
    loop: Int[np.ndarray, " _"],
    patch: Int[np.ndarray, "faces 3"],
) -> float:
    """Largest distance from a triangle's centroid to the nearest vertex of the rim."""
    centroids = vertices[patch].mean(axis=1)
    distance = np.linalg.norm(centroids[:, None] - vertices[loop][None], axis=2)
    return float(distance.min(axis=1).max())
