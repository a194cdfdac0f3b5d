"""Struts and joints as one closed surface, without booleans.

A strut is a loft between the rings at its ends, which have equally many corners; a joint's surface
fills what its rings leave free (`ring_hull`), divided until it is near enough (`joint_patches`).
Both use the rings' corners, so that the whole is closed by construction.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from texmap_opt.solid.joint_patches import JointPatches, refined
from texmap_opt.solid.joint_shape import JointShapes
from texmap_opt.solid.joint_types import JointTypes, joint_types
from texmap_opt.solid.ring_hull import RingHull, Rings, ring_hull
from texmap_opt.solid.strut_ends import StrutEnds
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.volume import SQUARE_TO_ROUND

# Points on the back of a joint, tried in turn: how often an icosahedron's edges are halved (every
# direction is then within 22 or 11 degrees of a point), and the sine of the angle by which a point
# may lean towards a strut. A direction away from all struts has a fine point near for certain.
BACKS = ((1, 0.0), (2, 0.2))
# How far a square strut goes on behind its joint, in half sides: as much material as half the ball
# that the volume formula gives to its joint.
SQUARE_BACK = np.pi / 6 * SQUARE_TO_ROUND**3
# Joint types worked out together: enough to be quick, few enough for memory.
TYPES_AT_ONCE = 250


@dataclass(frozen=True, eq=False)
class Meshed:
    """Surfaces of joints.

    Attributes:
        patches: of the types, pooled; `joint` is the number of a type.
        types: that the joints have.
        valid: types that have a surface.
        error_mm: largest known distance of a triangle from the surface it stands for [mm].
    """

    patches: JointPatches
    types: JointTypes
    valid: Bool[np.ndarray, " types"]
    error_mm: float

    @property
    def failed(self) -> Int[np.ndarray, " joints"]:
        """Joints without a surface."""
        return self.types.joints[~self.valid[self.types.type]]

    def without(self, joints: Bool[np.ndarray, " all"]) -> "Meshed":
        """The same for all but the marked joints."""
        kept = ~joints[self.types.joints]
        types = JointTypes(self.types.joints[kept], self.types.type[kept], self.types.ends)
        return replace(self, types=types)


def joint_surfaces(
    ends: StrutEnds, joints: Int[np.ndarray, " joints"], *, tolerance: float
) -> list[Meshed]:
    """Surfaces of the given joints, by valence.

    Args:
        ends: of all struts.
        joints: which ones; all their rings must be at a finite distance.
        tolerance: largest distance from the union of struts and ball [mm].
    """
    valence = ends.valence[joints]
    batches = []
    for count in np.unique(valence[valence > 0]):
        types = joint_types(ends, joints[valence == count])
        batches += [(types, start) for start in range(0, len(types.ends), TYPES_AT_ONCE)]
    # NumPy lets go of the interpreter in long arrays, so batches share the processor's cores.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(lambda b: _of_types(ends, b[0], b[1], tolerance), batches))


def _of_types(ends: StrutEnds, types: JointTypes, start: int, tolerance: float) -> Meshed:
    """Surfaces of some types, and the joints that have them."""
    chosen = slice(start, min(start + TYPES_AT_ONCE, len(types.ends)))
    mine = (types.type >= start) & (types.type < chosen.stop)
    types = JointTypes(types.joints[mine], types.type[mine] - start, types.ends[chosen])
    shapes = _shapes(ends, types.ends)
    rings = _rings(ends, types.ends)
    # A polygon's sides are as far off as this from the circle through its corners.
    sagitta = 0.0 if ends.square else float(1 - np.cos(np.pi / len(ends.section)))
    allowed = np.maximum(tolerance, sagitta * shapes.radius.max(axis=1))
    thick = ends.radius[types.ends] + ends.slope[types.ends] * ends.ring[types.ends]
    seen = np.hypot(ends.ring[types.ends], ends.corner_radius * thick)
    patches, valid = _undivided(rings, shapes, seen)
    patches, error = refined(patches, shapes, sides=len(ends.section), tolerance=allowed)
    return Meshed(patches, types, valid, error)


def _shapes(ends: StrutEnds, members: Int[np.ndarray, "types slots"]) -> JointShapes:
    k = ends.corner_radius
    radius = k * ends.radius[members]
    # Facets lie within the ball as they lie within the struts, so it stands out as corners do.
    ball = np.zeros(len(members)) if ends.square else radius.max(axis=1)
    back = (SQUARE_BACK if ends.square else 0.0) * ends.radius[members]
    joint = ends.joint[members[:, 0]]
    return JointShapes(
        ends.axis[members],
        ends.u[members],
        radius,
        k * ends.slope[members],
        ends.square,
        ball,
        back,
        ends.fillet[joint],
    )


def _rings(ends: StrutEnds, members: Int[np.ndarray, "types slots"]) -> Rings:
    axis, flat = ends.axis[members], members.reshape(-1)
    radius = ends.radius[flat] + ends.slope[flat] * ends.ring[flat]
    corners = (ends.ring[flat, None] * ends.axis[flat])[:, None]
    corners = corners + radius[:, None, None] * ends.across(flat)
    corners /= np.linalg.norm(corners, axis=-1, keepdims=True)
    corners = corners.reshape(*members.shape, *corners.shape[1:])
    none = np.zeros((len(axis), 0))
    return Rings(axis, corners, none.reshape(len(axis), 0, 3), none.astype(bool))


def _undivided(
    rings: Rings, shapes: JointShapes, corner_distance: Float[np.ndarray, "types slots"]
) -> tuple[JointPatches, Bool[np.ndarray, " types"]]:
    """Patches between rings and points on the backs of joints, and which types have one."""
    cosine = np.zeros((len(rings.axes), 0))
    valid = np.zeros(len(rings.axes), bool)
    pieces: list[JointPatches] = []
    for level, lean in BACKS:
        directions = _sphere_points(level)
        cosine = (rings.axes @ directions.T).max(axis=1)
        behind = (cosine <= lean) & ~valid[:, None]
        for some in (False, True):
            chosen = np.flatnonzero((behind.any(axis=1) == some) & ~valid)
            if not len(chosen):
                continue
            these = rings.select(chosen)
            if some:
                these = these.with_back(directions, behind[chosen])
            hull = ring_hull(these)
            valid[chosen] = hull.valid
            pieces.append(_patches(these, hull, chosen, corner_distance[chosen]))
    return _joined(pieces, shapes), valid


def _patches(
    rings: Rings, hull: RingHull, types: np.ndarray, corner_distance: np.ndarray
) -> JointPatches:
    """Valid hulls as patches; points on the backs have no distance yet."""
    direction = rings.directions()
    count, points = direction.shape[:2]
    corner = np.where(np.arange(points) < rings.on_rings, np.arange(points), -1)
    distance = np.zeros((count, points))
    distance[:, : rings.on_rings] = np.repeat(corner_distance, rings.sides, axis=1)
    good = hull.valid[hull.joint]
    faces = hull.joint[good, None] * points + hull.triangles[good]
    used, faces = np.unique(faces, return_inverse=True)
    return JointPatches(
        types[used // points],
        corner[used % points],
        direction.reshape(-1, 3)[used],
        distance.reshape(-1)[used],
        faces.reshape(-1, 3),
    )


def _joined(pieces: list[JointPatches], shapes: JointShapes) -> JointPatches:
    """All patches in one, with the distances of points that are on no ring."""
    start = np.cumsum([0] + [len(piece.joint) for piece in pieces])
    joint, corner, direction, distance = (
        np.concatenate([getattr(piece, name) for piece in pieces])
        for name in ("joint", "corner", "direction", "distance")
    )
    faces = np.concatenate([p.faces + k for p, k in zip(pieces, start[:-1], strict=True)])
    between = corner < 0
    distance[between] = shapes.reach(direction[between], joint[between])
    return JointPatches(joint, corner, direction, distance, faces)


@cache
def _sphere_points(level: int) -> Float[np.ndarray, "points 3"]:
    """Corners of an icosahedron whose edges are halved so many times, as unit directions."""
    golden = (1 + np.sqrt(5)) / 2
    signs = [(s, t) for s in (1, -1) for t in (1, -1)]
    corners = [
        p for s, t in signs for p in ((0, s, t * golden), (s, t * golden, 0), (t * golden, 0, s))
    ]
    points = np.array(corners, dtype=float)
    points /= np.linalg.norm(points[0])
    for _ in range(level):
        pairs = KDTree(points).query_pairs(1.2 * _spacing(points), output_type="ndarray")
        points = np.concatenate([points, points[pairs].sum(axis=1)])
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    return points


def _spacing(points: np.ndarray) -> float:
    """Largest distance of a point from its nearest neighbour."""
    return float(KDTree(points).query(points, k=2)[0][:, 1].max())


def assembled(
    ends: StrutEnds, struts: Bool[np.ndarray, " struts"], meshed: list[Meshed]
) -> TriMesh:
    """Lofts of the marked struts and surfaces of joints.

    The first vertices are the rings' corners, `sides` for each end in the order of `ends`.
    """
    sides = len(ends.section)
    corners = ends.ring_corners().reshape(-1, 3)
    vertices, faces = [corners], [_lofts(ends, struts)]
    count = len(corners)
    for part in meshed:
        new, made = _instances(ends, part, sides, count)
        vertices.append(new)
        faces.append(made)
        count += len(new)
    return TriMesh(np.concatenate(vertices), np.concatenate(faces))


def _lofts(ends: StrutEnds, struts: Bool[np.ndarray, " struts"]) -> Int[np.ndarray, "faces 3"]:
    """Two triangles for each side of each strut, between the corners of its rings."""
    sides = len(ends.section)
    first, second = ends.place.reshape(-1, 2)[struts].T * sides
    k = np.arange(sides)
    following = (k + 1) % sides
    a, b = first[:, None] + k, first[:, None] + following
    # Seen from its own joint the second ring runs the other way round.
    c, d = second[:, None] + (-k) % sides, second[:, None] + (-following) % sides
    return np.stack([np.stack([a, b, d], -1), np.stack([a, d, c], -1)], 2).reshape(-1, 3)


def _instances(
    ends: StrutEnds, part: Meshed, sides: int, count: int
) -> tuple[Float[np.ndarray, "points 3"], Int[np.ndarray, "faces 3"]]:
    """Vertices between rings and faces of the joints of some types; vertices begin at `count`."""
    patches, types = part.patches, part.types
    between = patches.corner < 0
    n_types = len(types.ends)
    # Vertices between rings, and faces, of each type are consecutive.
    own = patches.joint[between]
    points = np.bincount(own, minlength=n_types)
    face_type = patches.joint[patches.faces[:, 0]]
    per_type = np.bincount(face_type, minlength=n_types)
    point, of_point = _ragged(np.cumsum(points) - points, points, types.type)
    offset = patches.offset[between][point]
    vertices = ends.structure.joints[types.joints][of_point] + offset
    face, of_face = _ragged(np.cumsum(per_type) - per_type, per_type, types.type)
    local = patches.faces[face]
    corner = patches.corner[local]
    first_end = ends.first[types.joints][of_face]
    on_ring = first_end[:, None] * sides + corner
    rank = np.cumsum(between) - 1
    # Number among the vertices of its type, then of the joint.
    within = rank[local] - (np.cumsum(points) - points)[face_type[face]][:, None]
    start = np.cumsum(points[types.type]) - points[types.type]
    inside = count + start[of_face][:, None] + within
    return vertices, np.where(corner >= 0, on_ring, inside)


def _ragged(
    start: np.ndarray, length: np.ndarray, chosen: np.ndarray
) -> tuple[Int[np.ndarray, " items"], Int[np.ndarray, " items"]]:
    """Items of runs chosen one after the other, and which choice each belongs to."""
    lengths = length[chosen]
    owner = np.repeat(np.arange(len(chosen)), lengths)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    return start[chosen][owner] + place, owner
