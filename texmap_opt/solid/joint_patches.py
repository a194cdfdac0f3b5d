"""The surfaces of joints between the rings of their struts, divided until they are near enough.

Every vertex has a direction from its joint, and lies where the joint's solid ends in that
direction. Edges are divided along their great circles, so that the triangles' directions stay a
triangulation of the sphere and the surface cannot cross itself.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.solid.joint_shape import JointShapes

# Places along an edge at which its distance from the surface is looked at.
PLACES = (1 / 3, 0.5, 2 / 3)
# Most times an edge is halved. A strut that leaves its neighbour at 5 degrees takes six.
MAX_ROUNDS = 16
# Faces of a joint at which its division stops; usual are a few hundred, with fine fillets thousands.
MOST_FACES = 50_000
# Rounds in which edges are divided without regard to the shape of faces: a fifth fewer triangles than
# with it from the start; without it at the end some would never settle.
FREE_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class JointPatches:
    """Triangles between the rings of some joints.

    Attributes:
        joint: of each vertex, ascending.
        corner: number of the ring's corner that a vertex is, ring by ring; -1: it lies between.
        direction: unit vector from the joint.
        distance: from the joint [mm].
        faces: vertices of each triangle, counter-clockwise seen from outside; joint by joint.
    """

    joint: Int[np.ndarray, " points"]
    corner: Int[np.ndarray, " points"]
    direction: Float[np.ndarray, "points 3"]
    distance: Float[np.ndarray, " points"]
    faces: Int[np.ndarray, "faces 3"]

    @cached_property
    def offset(self) -> Float[np.ndarray, "points 3"]:
        """Position of each vertex from its joint [mm]."""
        return self.distance[:, None] * self.direction

    def sorted(self) -> "JointPatches":
        """The same, vertices and faces joint by joint."""
        order = np.argsort(self.joint, kind="stable")
        number = np.zeros(len(order), np.int64)
        number[order] = np.arange(len(order))
        faces = number[self.faces]
        joint = self.joint[order]
        faces = faces[np.argsort(joint[faces[:, 0]], kind="stable")]
        return JointPatches(
            joint, self.corner[order], self.direction[order], self.distance[order], faces
        )


def refined(
    patches: JointPatches,
    shapes: JointShapes,
    *,
    sides: int,
    tolerance: Float[np.ndarray, " joints"],
) -> tuple[JointPatches, float]:
    """Divides triangles until they are within a tolerance of the joints' surfaces.

    Args:
        patches: triangles between the rings.
        shapes: the joints' solids.
        sides: corners of a ring; its sides stay whole, the struts share them.
        tolerance: of each joint [mm].

    Returns:
        the divided triangles, and the largest distance found on what could not be divided [mm].
    """
    known, settled, left, limits = 0, [], 0.0, _Limits(sides, tolerance)
    for number in range(MAX_ROUNDS):
        edges, place, left = _to_divide(patches, shapes, limits, known, fat=number >= FREE_ROUNDS)
        # A joint that would be divided without end keeps the distance it has.
        faces = np.bincount(patches.joint[patches.faces[:, 0]], minlength=len(tolerance))
        bounded = faces[patches.joint[edges[:, 0]]] < MOST_FACES
        edges, place = edges[bounded], place[bounded]
        if not len(edges):
            break
        # Joints of which no edge is divided are finished.
        going = np.zeros(len(tolerance), bool)
        going[patches.joint[edges[:, 0]]] = True
        going = going[patches.joint[patches.faces[:, 0]]]
        settled.append(patches.faces[~going])
        known = len(patches.joint)
        patches = _divided(replace(patches, faces=patches.faces[going]), shapes, edges, place)
    patches = replace(patches, faces=np.concatenate([*settled, patches.faces]))
    return patches.sorted(), left


@dataclass(frozen=True, eq=False)
class _Limits:
    """What every round keeps to.

    Attributes:
        sides: corners of a ring.
        tolerance: of each joint [mm].
    """

    sides: int
    tolerance: Float[np.ndarray, " joints"]


def _to_divide(
    patches: JointPatches, shapes: JointShapes, limits: _Limits, known: int, *, fat: bool
) -> tuple[np.ndarray, np.ndarray, float]:
    """Edges to divide, where to divide them, and the largest distance from the surface [mm].

    Edges and faces between the first `known` vertices have been looked at before; `fat` keeps faces
    from becoming ever thinner.
    """
    faces, count = patches.faces, len(patches.joint)
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    keys, inverse = np.unique(ends[:, 0] * count + ends[:, 1], return_inverse=True)
    edges, of_face = np.column_stack([keys // count, keys % count]), inverse.reshape(-1, 3)
    ring = patches.corner[edges] // limits.sides
    free = (ring[:, 0] != ring[:, 1]) | (ring[:, 0] < 0)
    limit = limits.tolerance[patches.joint[edges[:, 0]]]
    length = _length(patches.offset[edges[:, 1]] - patches.offset[edges[:, 0]])
    # A valley between two points of a surface is hardly deeper than they are apart.
    looked = np.flatnonzero(free & (length > limit) & (edges[:, 1] >= known))
    distance, place = np.zeros(len(edges)), np.full(len(edges), 0.5)
    distance[looked], place[looked] = _edge_distance(patches, shapes, edges[looked])
    wanted = distance > limit
    # Beside a ring's side the surface goes on in the strut: there edges alone decide.
    fresh = _any(faces >= known)
    whole = np.flatnonzero(fresh & ~_any(~(free & ~wanted)[of_face]))
    middle = patches.offset[faces[whole]].mean(axis=1)
    inner = shapes.distance(middle, patches.joint[faces[whole, 0]])
    longest = _longest(of_face, np.where(free, length, 0.0))
    deep = inner > limit[of_face[whole, 0]]
    wanted[longest[whole[deep]]] = True
    worst = max(float(distance.max(initial=0)), float(inner.max(initial=0)))
    if fat:
        wanted = _with_longest(wanted, of_face, longest)
    return edges[wanted], place[wanted], worst


def _longest(of_face: np.ndarray, length: np.ndarray) -> np.ndarray:
    """The longest edge of each face."""
    return of_face[np.arange(len(of_face)), length[of_face].argmax(axis=1)]


def _with_longest(wanted: np.ndarray, of_face: np.ndarray, longest: np.ndarray) -> np.ndarray:
    """The wanted edges, and the longest of every face that has a wanted one.

    Faces would become ever thinner otherwise (Rivara, Algorithms for refining triangular grids,
    1984).
    """
    while True:
        more = _any(wanted[of_face]) & ~wanted[longest]
        if not more.any():
            return wanted
        wanted = wanted.copy()
        wanted[longest[more]] = True


def _edge_distance(
    patches: JointPatches, shapes: JointShapes, edges: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Largest distance of each edge from the surface [mm], and where along it that is."""
    a, b = patches.offset[edges[:, 0]], patches.offset[edges[:, 1]]
    joint = patches.joint[edges[:, 0]]
    best, where = np.zeros(len(edges)), np.full(len(edges), 0.5)
    for place in PLACES:
        distance = shapes.distance(a + place * (b - a), joint)
        farther = distance > best
        best[farther], where[farther] = distance[farther], place
    return best, where


def _divided(
    patches: JointPatches, shapes: JointShapes, edges: np.ndarray, place: np.ndarray
) -> JointPatches:
    """The patches with a new vertex on each edge."""
    count = len(patches.joint)
    a, b = patches.offset[edges[:, 0]], patches.offset[edges[:, 1]]
    direction = a + place[:, None] * (b - a)
    direction /= _length(direction)[:, None]
    joint = patches.joint[edges[:, 0]]
    keys = edges[:, 0] * count + edges[:, 1]
    return JointPatches(
        np.concatenate([patches.joint, joint]),
        np.concatenate([patches.corner, np.full(len(edges), -1)]),
        np.concatenate([patches.direction, direction]),
        np.concatenate([patches.distance, shapes.reach(direction, joint)]),
        _with_middles(patches, keys, direction),
    )


def _with_middles(
    patches: JointPatches, keys: np.ndarray, direction: np.ndarray
) -> Int[np.ndarray, "faces 3"]:
    """Faces divided at the new vertices of their edges; `keys` are the edges in ascending order."""
    count, faces = len(patches.joint), patches.faces
    a, b = faces, np.roll(faces, -1, axis=1)
    edge = np.minimum(a, b) * count + np.maximum(a, b)
    found = np.minimum(np.searchsorted(keys, edge), len(keys) - 1)
    middle = np.where(keys[found] == edge, count + found, -1)
    number = (middle >= 0).sum(axis=1)
    pieces = [faces[number == 0]]
    # Turned so that the divided edges come first: of one edge the first, of two the first two.
    one, two, three = (np.flatnonzero(number == k) for k in (1, 2, 3))
    f, m = _turned(faces[one], middle[one], np.argmax(middle[one] >= 0, axis=1))
    pieces += [
        np.column_stack([f[:, 0], m[:, 0], f[:, 2]]),
        np.column_stack([m[:, 0], f[:, 1], f[:, 2]]),
    ]
    f, m = _turned(faces[two], middle[two], (np.argmax(middle[two] < 0, axis=1) + 1) % 3)
    directions = np.concatenate([patches.direction, direction])
    flat = _dot(directions[f[:, 0]], directions[m[:, 1]]) > _dot(
        directions[m[:, 0]], directions[f[:, 2]]
    )
    fourth = np.where(flat, m[:, 1], f[:, 2])
    first = np.where(flat, f[:, 0], m[:, 0])
    pieces += [
        np.column_stack([m[:, 0], f[:, 1], m[:, 1]]),
        np.column_stack([f[:, 0], m[:, 0], fourth]),
        np.column_stack([first, m[:, 1], f[:, 2]]),
    ]
    f, m = faces[three], middle[three]
    pieces += [np.column_stack([f[:, k], m[:, k], m[:, k - 1]]) for k in range(3)] + [m]
    return np.concatenate(pieces)


def _turned(
    faces: np.ndarray, middle: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Corners and middles, beginning at a given corner."""
    order = (start[:, None] + np.arange(3)) % 3
    return np.take_along_axis(faces, order, axis=1), np.take_along_axis(middle, order, axis=1)


# NumPy adds up three columns four times as slowly as these do.
def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", a, b)


def _length(a: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("ij,ij->i", a, a))


def _any(marks: np.ndarray) -> np.ndarray:
    return marks[:, 0] | marks[:, 1] | marks[:, 2]
