"""The zero level of a field on a lattice of tetrahedra, with its creases and corners.

The level crosses a tetrahedron in a triangle or a quadrilateral whose corners lie on edges. Where
the field's normals at two of them differ, the face between gets a point where their tangent planes
meet, and the tetrahedron one where all do (after Kobbelt, Botsch, Schwanecke and Seidel, Feature
sensitive surface extraction, 2001, there for cubes). Every piece is a fan inside one convex
tetrahedron, so the surface is closed, manifold and free of crossings by construction.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.combine.tet_lattice import EDGES, TetLattice
from texmap_opt.solid.tri_mesh import TriMesh

# Most rounds of the Illinois root search on a crossing edge. A distance field is nearly linear and
# one is enough, but not where the edge crosses a crease as well.
ROOT_STEPS = 16
# A crossing is found when the field there is below this share of what counts as good.
ROOT_SHARE = 0.1
# Nearest a crossing may come to the end of its edge, in edge lengths: keeps triangles apart.
END_MARGIN = 1e-4
# Normals that differ by less than this are one smooth surface; the cosine of 8 degrees.
SMOOTH = 0.99
# Smallest barycentric coordinate of an inserted point: inside its face or tetrahedron.
INSIDE = 1e-3
# An inserted point must lie this many times nearer the level than the middle it replaces.
GAIN = 0.5
# Singular values below this share of the largest belong to directions along a crease.
CREASE = 0.1


@dataclass(frozen=True, eq=False)
class Level:
    """The zero level.

    Attributes:
        surface: triangles; the gradient points out of it.
        tet_of_face: the tetrahedron each triangle lies in; -1 never.
        crossings: how many vertices, the first ones, lie on edges of the lattice and so on the level;
            the others were inserted at creases and corners.
    """

    surface: TriMesh
    tet_of_face: Int[np.ndarray, " faces"]
    crossings: int


def zero_level(mesh: TetLattice, good: float) -> Level:
    """Triangles of the zero level in every tetrahedron.

    Args:
        mesh: the lattice.
        good: distance from the level below which no crease is looked for [mm].
    """
    case = ((mesh.values[mesh.tets] < 0) * np.array([1, 2, 4, 8])).sum(axis=1)
    crossed = np.flatnonzero((case > 0) & (case < 15))
    tets, case = mesh.tets[crossed], case[crossed]
    if not len(tets):
        return Level(TriMesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64)), crossed, 0)
    corner_table, face_table = _cases()
    corners, normals, corner_of = _edge_points(mesh, tets, corner_table[case], good)
    middle_points, face_of = _face_points(
        mesh, crossed, face_table[case], corner_of, (corners, normals), good
    )
    face_of = np.where(face_of >= 0, face_of + len(corners), -1)
    points = np.concatenate([corners, middle_points])
    centres, fanned = _centres(mesh, crossed, (points, normals), (corner_of, face_of), good)
    centre_of = np.full(len(tets), -1)
    centre_of[fanned] = len(points) + np.arange(len(centres))
    points = np.concatenate([points, centres])
    triangles, owner = _triangles(corner_of, face_of, centre_of)
    # The table is for positive tetrahedra; bisection makes some negative.
    x = mesh.lattice[tets].astype(np.float64)
    negative = np.linalg.det(x[:, 1:] - x[:, :1]) < 0
    flip = negative[owner]
    triangles[flip] = triangles[flip][:, ::-1]
    return Level(TriMesh(points, triangles), crossed[owner], len(corners))


@cache
def _cases() -> tuple[np.ndarray, np.ndarray]:
    """Edges crossed in order around the piece, and the face from each to the next, by sign case.

    Entry -1 where a triangle has no fourth. A face is named by the corner it lacks. Bit k of the
    case says that corner k is inside.
    """
    reference = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    edge_number = {tuple(edge): k for k, edge in enumerate(EDGES.tolist())}
    corners, faces = np.full((16, 4), -1), np.full((16, 4), -1)
    for case in range(1, 15):
        inside = [k for k in range(4) if case >> k & 1]
        outside = [k for k in range(4) if not case >> k & 1]
        if len(inside) == 2:
            (a, b), (c, d) = inside, outside
            loop = [(a, c), (b, c), (b, d), (a, d)]
        else:
            (lone,), rest = (inside, outside) if len(inside) == 1 else (outside, inside)
            loop = [(lone, other) for other in rest]
        middle = np.array([reference[list(edge)].mean(axis=0) for edge in loop])
        outward = reference[outside].mean(axis=0) - reference[inside].mean(axis=0)
        if np.cross(middle[1] - middle[0], middle[2] - middle[0]) @ outward < 0:
            loop = loop[::-1]
        for k, edge in enumerate(loop):
            following = loop[(k + 1) % len(loop)]
            corners[case, k] = edge_number[tuple(sorted(edge))]
            (faces[case, k],) = set(range(4)) - set(edge) - set(following)
    return corners, faces


def _edge_points(
    mesh: TetLattice, tets: np.ndarray, edges: np.ndarray, good: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Crossings on edges [mm], the normals there, and which one each piece has at each corner."""
    row, place = np.nonzero(edges >= 0)
    ends = np.sort(tets[row[:, None], EDGES[edges[row, place]]], axis=1)
    keys, first, inverse = np.unique(
        ends[:, 0] * len(mesh.lattice) + ends[:, 1], return_index=True, return_inverse=True
    )
    a, b = ends[first].T
    points = mesh.points
    start, along = points[a], points[b] - points[a]
    normal = np.zeros_like(start)
    lower = np.where(mesh.values[a] < mesh.values[b], a, b)
    low, high = np.zeros(len(keys)), np.ones(len(keys))
    f_low, f_high = mesh.values[a].copy(), mesh.values[b].copy()
    k = np.arange(len(keys))
    for _ in range(ROOT_STEPS):
        t = _secant(low[k], high[k], f_low[k], f_high[k])
        f, normal[k] = mesh.beside(start[k] + t[:, None] * along[k], lower[k])
        below = (f < 0) == (f_low[k] < 0)
        # Illinois: the value at the end that stays is halved, so that it does not stay for ever.
        f_low[k], f_high[k] = np.where(below, f, f_low[k] / 2), np.where(below, f_high[k] / 2, f)
        low[k], high[k] = np.where(below, t, low[k]), np.where(below, high[k], t)
        k = k[np.abs(f) > ROOT_SHARE * good]
        if not len(k):
            break
    t = _secant(low, high, f_low, f_high)
    corner_of = np.full(edges.shape, -1)
    corner_of[row, place] = inverse.reshape(-1)
    return start + t[:, None] * along, normal, corner_of


def _secant(low: np.ndarray, high: np.ndarray, f_low: np.ndarray, f_high: np.ndarray) -> np.ndarray:
    span = f_low - f_high
    share = np.divide(f_low, span, out=np.full_like(span, 0.5), where=span != 0)
    return np.clip(low + share * (high - low), END_MARGIN, 1 - END_MARGIN)


def _face_points(
    mesh: TetLattice,
    numbers: np.ndarray,
    lacking: np.ndarray,
    corner_of: np.ndarray,
    planes: tuple[np.ndarray, np.ndarray],
    good: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Points where a crease meets a face [mm], and which one each piece has after each corner."""
    points, normals = planes
    tets = mesh.tets[numbers]
    row, place = np.nonzero(lacking >= 0)
    count = (corner_of >= 0).sum(axis=1)
    pair = np.stack([corner_of[row, place], corner_of[row, (place + 1) % count[row]]], axis=1)
    # Two crossings lie on two edges of one face and name it.
    pair.sort(axis=1)
    _, first, inverse = np.unique(
        pair[:, 0] * len(points) + pair[:, 1], return_index=True, return_inverse=True
    )
    inverse = inverse.reshape(-1)
    p, q = pair[first].T
    bent = np.flatnonzero(np.einsum("ij,ij->i", normals[p], normals[q]) < SMOOTH)
    p, q = p[bent], q[bent]
    corners = np.delete(np.tile(np.arange(4), (4, 1)), np.arange(0, 16, 5)).reshape(4, 3)
    chosen = first[bent]
    triangle = mesh.points[tets[row[chosen, None], corners[lacking[row[chosen], place[chosen]]]]]
    middle = (points[p] + points[q]) / 2
    crease, shares = _meet_in_plane(
        triangle, middle, (points[p], normals[p]), (points[q], normals[q])
    )
    accepted = (shares > INSIDE).all(axis=1) & _nearer(
        mesh, numbers[row[chosen]], crease, middle, good
    )
    number = np.full(len(first), -1)
    number[bent[accepted]] = np.arange(int(accepted.sum()))
    face_of = np.full(lacking.shape, -1)
    face_of[row, place] = number[inverse]
    return crease[accepted], face_of


def _meet_in_plane(
    triangle: np.ndarray,
    middle: np.ndarray,
    first: tuple[np.ndarray, np.ndarray],
    second: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Where two tangent planes meet in the plane of a face, and its barycentric coordinates."""
    along, across = triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0]
    (p, n), (q, m) = first, second
    # n . (x0 + s along + t across - p) = 0, and the same with m and q.
    a11, a12, b1 = _dot(n, along), _dot(n, across), _dot(n, p - triangle[:, 0])
    a21, a22, b2 = _dot(m, along), _dot(m, across), _dot(m, q - triangle[:, 0])
    det = a11 * a22 - a12 * a21
    scale = np.abs(a11 * a22) + np.abs(a12 * a21)
    sound = np.abs(det) > 1e-6 * scale
    det = np.where(sound, det, 1.0)
    s, t = (b1 * a22 - b2 * a12) / det, (a11 * b2 - a21 * b1) / det
    meet = triangle[:, 0] + s[:, None] * along + t[:, None] * across
    shares = np.where(sound[:, None], np.stack([1 - s - t, s, t], axis=1), -1.0)
    return np.where(sound[:, None], meet, middle), shares


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", a, b)


def _centres(
    mesh: TetLattice,
    numbers: np.ndarray,
    planes: tuple[np.ndarray, np.ndarray],
    loop: tuple[np.ndarray, np.ndarray],
    good: float,
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
    """Middle points of the pieces that need one, and the numbers of those pieces."""
    points, normals = planes
    tets = mesh.tets[numbers]
    corner_of, face_of = loop
    present = (corner_of >= 0)[..., None]
    n = np.where(present, normals[corner_of], 0.0)
    like = np.einsum("cka,cla->ckl", n, n)
    pairs = present & present.transpose(0, 2, 1)
    bent = np.where(pairs, like, 1.0).min(axis=(1, 2)) < SMOOTH
    chosen = np.flatnonzero((face_of >= 0).any(axis=1) | bent)
    around = np.concatenate([corner_of[chosen], face_of[chosen]], axis=1)
    there = (around >= 0)[..., None]
    mean = np.where(there, points[around], 0.0).sum(axis=1) / there.sum(axis=1)
    # Least squares of the tangent planes; directions along a crease stay at the mean.
    A, there = n[chosen], present[chosen]
    b = np.where(there, A * (points[corner_of[chosen]] - mean[:, None]), 0.0).sum(axis=2)
    U, S, Vt = np.linalg.svd(A, full_matrices=False)
    inverse = np.where(CREASE * S[:, :1] < S, 1 / np.maximum(S, 1e-300), 0.0)
    along = np.einsum("cks,ck->cs", U, b) * inverse  # piece, tangent plane, singular direction
    corner = mean + np.einsum("csx,cs->cx", Vt, along)
    x = mesh.points[tets[chosen]]
    local = np.linalg.solve((x[:, 1:] - x[:, :1]).transpose(0, 2, 1), (corner - x[:, 0])[..., None])
    local = local[..., 0]
    inside = (local > INSIDE).all(axis=1) & (local.sum(axis=1) < 1 - INSIDE)
    # Where the corner lies outside, the middle of the points in the faces is on the crease they
    # mark: exactly so where a straight one passes through.
    marked = (face_of[chosen] >= 0)[..., None]
    on_crease = np.where(marked, points[face_of[chosen]], 0.0).sum(axis=1)
    on_crease = np.where(marked.any(axis=1), on_crease / np.maximum(marked.sum(axis=1), 1), mean)
    better = inside & _nearer(mesh, numbers[chosen], corner, on_crease, good)
    needed = better | marked.any(axis=(1, 2))
    return np.where(better[:, None], corner, on_crease)[needed], chosen[needed]


def _nearer(
    mesh: TetLattice, tets: np.ndarray, trial: np.ndarray, middle: np.ndarray, good: float
) -> np.ndarray:
    """Whether the trial points are clearly nearer the level than middles that are not good."""
    before = np.abs(mesh.sampled(middle, tets)[0])
    return (before > good) & (np.abs(mesh.sampled(trial, tets)[0]) < GAIN * before)


def _triangles(
    corner_of: np.ndarray, face_of: np.ndarray, centre_of: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of all pieces, and the piece each belongs to."""
    triangles, owners = [], []

    def add(rows: np.ndarray, *columns: np.ndarray) -> None:
        triangles.append(np.column_stack(columns))
        owners.append(rows)

    count = (corner_of >= 0).sum(axis=1)
    plain = np.flatnonzero(centre_of < 0)
    add(plain, *corner_of[plain, :3].T)
    quads = plain[count[plain] == 4]
    add(quads, corner_of[quads, 0], corner_of[quads, 2], corner_of[quads, 3])
    for k in range(4):
        rows = np.flatnonzero((centre_of >= 0) & (k < count))
        start, end = corner_of[rows, k], corner_of[rows, (k + 1) % count[rows]]
        between = face_of[rows, k]
        straight = between < 0
        centre = centre_of[rows]
        add(rows[straight], start[straight], end[straight], centre[straight])
        bent = ~straight
        add(rows[bent], start[bent], between[bent], centre[bent])
        add(rows[bent], between[bent], end[bent], centre[bent])
    return np.concatenate(triangles).astype(np.int64), np.concatenate(owners)
