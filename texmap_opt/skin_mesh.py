"""The skin as shells: triangles half a thickness below the part's surface.

The triangles are those of the part's tets, so that supports and loads of the solid analysis have their
nodes. All planes move inwards by half the thickness; along the planes vertices give way evenly, so
that triangles smaller than the skin do not fold over beside an edge. Where the part is thinner than two
skins, both share what there is.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import bsr_array, csc_array, eye_array, kron
from scipy.sparse.linalg import splu

from fea import TetMesh
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh

# Weight of an even displacement against planes that keep their distance: planes that differ by less
# than about six degrees [sine²] move as one, and sharper edges than that stay behind.
EVEN = 1e-2

# Edges of a vertex, on average over a closed surface of triangles (Euler).
VALENCE = 6

# Least area of a triangle, in its old direction, over that before: on the sharpest convex surface that
# has room for half a skin it is a quarter, anything below is on its way to fold over. And the least
# cosine of the angle by which it may turn.
LEAST_AREA = 0.1
LEAST_COSINE = 0.2

# Vertices of a triangle that would fold go half as far; after this many halvings they stay.
HALVINGS = 6

# Rays start this share of the diagonal below the surface: above rounding, below any wall.
START = 1e-7


@dataclass(frozen=True, eq=False)
class SkinMesh:
    """The middle surface of a skin.

    Attributes:
        nodes: node of the tet mesh that each vertex came from.
        outside: where that is, on the part's surface [mm].
        surface: the middle surface [mm], oriented outwards.
        thickness: of each triangle [mm]; less than asked for where two skins would overlap.
        thin_share: share of the area where it is less.
        held_back: vertices that stay closer to the surface so that no triangle folds over.
    """

    nodes: Int[np.ndarray, " vertices"]
    outside: Float[np.ndarray, "vertices 3"]
    surface: TriMesh
    thickness: Float[np.ndarray, " faces"]
    thin_share: float
    held_back: int

    @classmethod
    def of(cls, mesh: TetMesh, skin_mm: float) -> "SkinMesh":
        """The skin of a part.

        Args:
            mesh: the part's tets.
            skin_mm: thickness of the skin [mm].
        """
        nodes, faces = np.unique(mesh.boundary_facets[:, :3], return_inverse=True)
        outer = TriMesh(mesh.nodes[nodes], faces.reshape(-1, 3))
        inward = _inward(outer)
        room = _room(outer, inward(np.ones(len(nodes))))
        depth = np.minimum(skin_mm / 2, room / 4)
        of_face = 2 * depth[outer.faces].mean(axis=1)
        thin = of_face < skin_mm * (1 - 1e-9)
        moved, held_back = _unfolded(outer, inward(depth))
        return cls(
            nodes=nodes,
            outside=outer.vertices,
            surface=TriMesh(outer.vertices + moved, outer.faces),
            thickness=of_face,
            thin_share=float(outer.face_areas[thin].sum() / outer.face_areas.sum()),
            held_back=held_back,
        )


Vectors = Float[np.ndarray, "vertices 3"]
Numbers = Float[np.ndarray, " vertices"]


def _inward(surface: TriMesh) -> Callable[[Numbers], Vectors]:
    """From the depth of each vertex to its displacement.

    Least squares: the planes that meet at a vertex, weighted by their angle there, move by its depth;
    neighbours move alike, as far as the planes leave it open.
    """
    count = len(surface.vertices)
    corner = surface.faces.ravel()
    weight = _corner_angles(surface).ravel()
    weight = weight / np.bincount(corner, weights=weight, minlength=count)[corner]
    normal = np.repeat(surface.face_normals, 3, axis=0)
    planes = _summed(count, corner, weight[:, None] * _squares(normal)).reshape(-1, 3, 3)
    pull = _summed(count, corner, weight[:, None] * normal)
    rows = np.arange(count + 1, dtype=np.int32)
    own = bsr_array((planes, rows[:-1], rows), shape=(3 * count, 3 * count))
    factor = splu(csc_array(own + EVEN * kron(_differences(surface), eye_array(3))))

    def displacement(depth: Numbers) -> Vectors:
        return factor.solve(-(depth[:, None] * pull).ravel()).reshape(-1, 3)

    return displacement


def _differences(surface: TriMesh) -> csc_array:
    """Sum over edges of the squared difference of their ends as a matrix, for six edges a vertex."""
    a, b = surface.faces.ravel(), np.roll(surface.faces, -1, axis=1).ravel()
    count = len(surface.vertices)
    # Each edge of a closed surface comes twice, once from either side.
    share = np.full(2 * len(a), 0.5 / VALENCE)
    ends = np.concatenate([a, b]), np.concatenate([b, a])
    near = csc_array((share, ends), shape=(count, count))
    return csc_array(eye_array(count).multiply(near.sum(axis=0)) - near)


def _room(surface: TriMesh, way: Vectors) -> Numbers:
    """How far each vertex could go to the opposite wall, in units of its way [mm]."""
    start = START * float(np.linalg.norm(np.ptp(surface.bounds, axis=0)))
    path, _ = SignedDistance(surface).first_hit(surface.vertices + start * way, way)
    return path + start


def _unfolded(surface: TriMesh, way: Vectors) -> tuple[Vectors, int]:
    """Displacements, less where a triangle would shrink too much or turn over; and how many are less."""
    share = np.ones(len(way))
    halved = np.zeros(len(way), int)
    while True:
        corners = (surface.vertices + share[:, None] * way)[surface.faces]
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
        along = np.einsum("fi,fi->f", area, surface.face_normals)
        least = np.maximum(
            LEAST_AREA * surface.face_areas, LEAST_COSINE * np.linalg.norm(area, axis=1)
        )
        folds = (along < least) & share[surface.faces].any(axis=1)
        if not folds.any():
            return share[:, None] * way, int((halved > 0).sum())
        back = np.unique(surface.faces[folds])
        halved[back] += 1
        share[back] = np.where(halved[back] > HALVINGS, 0.0, share[back] / 2)


def _corner_angles(surface: TriMesh) -> Float[np.ndarray, "faces 3"]:
    x = surface.vertices[surface.faces]
    edge = np.roll(x, -1, axis=1) - x
    edge /= np.maximum(np.linalg.norm(edge, axis=2, keepdims=True), np.finfo(float).tiny)
    return np.arccos(np.clip(-np.einsum("fci,fci->fc", edge, np.roll(edge, 1, axis=1)), -1, 1))


def _squares(v: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 9"]:
    return (v[:, :, None] * v[:, None, :]).reshape(-1, 9)


def _summed(
    count: int, index: Int[np.ndarray, " n"], rows: Float[np.ndarray, "n columns"]
) -> Float[np.ndarray, "count columns"]:
    columns = [np.bincount(index, weights=column, minlength=count) for column in rows.T]
    return np.stack(columns, axis=1)
