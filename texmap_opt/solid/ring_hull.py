"""The joint's surface as a triangulation of all directions outside the rings of its struts.

Seen from a joint every strut begins at a ring of directions, a circle around its axis. The convex
hull of the rings' corners on the unit sphere is their Delaunay triangulation; without the polygons
that lie in one ring it is a triangulation of what the struts leave free. Moving its vertices along
their directions cannot make it cross itself, whatever their distances from the joint are.

Hull of the directions and not of the points: a point far from the joint would hide nearer ones.

The hulls of many joints are wrapped at once (gift wrapping; Chand and Kapur, An algorithm for
convex polytopes, 1970): from a known facet the plane turns about an edge until it meets a point.
Every ring's side is such an edge from the start, so that two or three rounds find everything.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

# Corners are moved by this much, so that no four lie on one circle and every edge has one next
# point: far below any angle of a joint, far above rounding.
SHAKE = 1e-8
# Rounds of wrapping: three do where every joint has rings all around; points on the back of a
# joint in a corner add some.
MAX_ROUNDS = 24
# Least volume spanned by the directions of a triangle's corners: above rounding.
SMALLEST_VOLUME = 1e-13
# How far the solid angles of all triangles may be from those of the whole sphere [sr].
SPHERE_SLACK = 1e-6
# Pairs of an edge and a point at once: arrays of 16 MB stay near the processor.
IN_FLIGHT = 2_000_000


@dataclass(frozen=True, eq=False)
class Rings:
    """Directions from joints of equal valence to the corners of the rings around them.

    A joint's corners are numbered ring by ring, `sides` in each, and then the points on its back.

    Attributes:
        axes: unit directions of the struts, outward.
        corners: unit directions of the rings' corners, counter-clockwise seen from outside.
        back: unit directions of further points.
        on_back: which of these a joint has.
    """

    axes: Float[np.ndarray, "joints slots 3"]
    corners: Float[np.ndarray, "joints slots sides 3"]
    back: Float[np.ndarray, "joints back 3"]
    on_back: Bool[np.ndarray, "joints back"]

    @property
    def sides(self) -> int:
        """Corners of a ring."""
        return self.corners.shape[2]

    @property
    def on_rings(self) -> int:
        """Corners on the rings of a joint."""
        return self.corners.shape[1] * self.sides

    def directions(self) -> Float[np.ndarray, "joints points 3"]:
        """All directions of each joint, in the order of their numbers."""
        count = len(self.corners)
        return np.concatenate([self.corners.reshape(count, -1, 3), self.back], axis=1)

    def with_back(
        self, back: Float[np.ndarray, "back 3"], on_back: Bool[np.ndarray, "joints back"]
    ) -> "Rings":
        """The same with points on the backs of the joints."""
        every = np.broadcast_to(back, (len(self.axes), *back.shape))
        return Rings(self.axes, self.corners, every, on_back)

    def select(self, joints: slice | Int[np.ndarray, " chosen"]) -> "Rings":
        """Those of some joints."""
        return Rings(
            self.axes[joints], self.corners[joints], self.back[joints], self.on_back[joints]
        )


@dataclass(frozen=True, eq=False)
class RingHull:
    """Triangles of many joints.

    Attributes:
        joint: of each triangle, in ascending order.
        triangles: numbers of the corners within the joint, counter-clockwise seen from outside.
        valid: joints whose triangles cover all directions outside the rings exactly once.
    """

    joint: Int[np.ndarray, " faces"]
    triangles: Int[np.ndarray, "faces 3"]
    valid: Bool[np.ndarray, " joints"]


def ring_hull(rings: Rings) -> RingHull:
    """Triangulates the directions outside the rings of every joint.

    Args:
        rings: circles around the struts' axes that do not meet.

    Returns:
        the triangles; joints that are not `valid` have no usable ones.
    """
    count, points = len(rings.axes), rings.on_rings + rings.back.shape[1]
    step = max(1, IN_FLIGHT // (points * max(rings.on_rings, 1)))
    parts = [
        _wrapped(rings.select(slice(start, start + step)), start) for start in range(0, count, step)
    ]
    return RingHull(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _wrapped(rings: Rings, first: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joint and corners of the triangles of a few joints, and which joints are valid."""
    shake = np.random.default_rng(0).uniform(-SHAKE, SHAKE, (rings.directions().shape[1], 3))
    shaken = rings.directions() + shake
    usable = np.ones(shaken.shape[:2], bool)
    usable[:, rings.on_rings :] = rings.on_back
    joint, triangles = _beside_rings(rings, shaken, usable)
    known = _Edges(shaken.shape[:2])
    # Where a strut goes on, the sides of its ring are met from the strut.
    known.table[joint, triangles[:, 1], triangles[:, 0]] = 1
    known.add(joint, triangles)
    pieces = [(joint, triangles)]
    for _ in range(MAX_ROUNDS):
        open_joint, edges, third = known.open_edges(*pieces[-1])
        if not len(edges):
            break
        added = _beyond(shaken, usable, open_joint, edges, third)
        added = known.fresh(*added)
        if not len(added[0]):
            break
        known.add(*added)
        pieces.append(added)
    joint = np.concatenate([piece[0] for piece in pieces])
    triangles = np.concatenate([piece[1] for piece in pieces])
    order = np.argsort(joint, kind="stable")
    joint, triangles = joint[order], triangles[order]
    valid = _covering_once(rings, joint, triangles) & known.closed()
    return joint + first, triangles, valid


def _beside_rings(
    rings: Rings, shaken: np.ndarray, usable: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The triangle on the outer side of every side of every ring."""
    count, slots, n = rings.corners.shape[:3]
    p = shaken[:, : rings.on_rings].reshape(count, slots, n, 3)
    along = np.roll(p, -1, axis=2) - p
    outward = np.cross(along, rings.axes[:, :, None])
    upward = np.cross(outward, along)
    towards = np.swapaxes(shaken, 1, 2)
    ahead, height = (
        plane.reshape(count, -1, 3) @ towards
        - np.einsum("jsnd,jsnd->jsn", plane, p).reshape(count, -1, 1)
        for plane in (outward, upward)
    )
    score = np.full(ahead.shape, -np.inf)
    np.divide(ahead, -height, out=score, where=(height < 0) & usable[:, None])
    score = score.reshape(count, slots, n, -1)
    for slot in range(slots):
        score[:, slot, :, slot * n : (slot + 1) * n] = -np.inf
    apex = score.reshape(count, slots * n, -1).argmax(axis=2)
    number = np.arange(slots * n).reshape(slots, n)
    following = np.roll(number, -1, axis=1).reshape(-1)
    triangles = np.stack(
        [
            np.broadcast_to(following, (count, slots * n)),
            np.broadcast_to(number.reshape(-1), (count, slots * n)),
            apex,
        ],
        axis=2,
    )
    return np.repeat(np.arange(count), slots * n), triangles.reshape(-1, 3)


def _beyond(
    shaken: np.ndarray,
    usable: np.ndarray,
    joint: np.ndarray,
    edges: np.ndarray,
    third: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """The triangle on the left of each edge; on its right is the triangle with `third`."""
    # Rows of equal length, one a joint: its points are multiplied by all its edges at once.
    per_joint = np.bincount(joint, minlength=len(shaken))
    place = np.arange(len(joint)) - np.repeat(np.cumsum(per_joint) - per_joint, per_joint)
    width = int(per_joint.max())
    a, b, c = shaken[joint, edges[:, 0]], shaken[joint, edges[:, 1]], shaken[joint, third]
    upward = np.cross(a - b, c - b)
    outward = np.cross(a - b, upward)
    towards = np.swapaxes(shaken, 1, 2)
    scores = []
    for plane in (outward, upward):
        normals, offsets = np.zeros((len(shaken), width, 3)), np.zeros((len(shaken), width, 1))
        normals[joint, place] = plane
        offsets[joint, place, 0] = (plane * a).sum(axis=1)
        scores.append(normals @ towards - offsets)
    ahead, height = scores
    score = np.full(ahead.shape, -np.inf)
    np.divide(ahead, -height, out=score, where=(height < 0) & usable[:, None])
    for known in (edges[:, 0], edges[:, 1], third):
        score[joint, place, known] = -np.inf
    apex = score.argmax(axis=2)[joint, place]
    triangles = np.column_stack([edges, apex])
    # Found from each of its open edges: once is enough.
    least = triangles.argmin(axis=1)
    rows = np.arange(len(triangles))
    turned = np.column_stack([triangles[rows, (least + k) % 3] for k in range(3)])
    points = shaken.shape[1]
    key = ((joint * points + turned[:, 0]) * points + turned[:, 1]) * points + turned[:, 2]
    _, once = np.unique(key, return_index=True)
    return joint[once], turned[once]


class _Edges:
    """Which directed edges the triangles of each joint have, as a table joint by start by end."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        joints, points = shape
        self.table = np.zeros((joints, points, points), dtype=np.int8)

    def add(self, joint: np.ndarray, triangles: np.ndarray) -> None:
        """Enter the edges of some triangles."""
        for k in range(3):
            np.add.at(self.table, (joint, triangles[:, k], triangles[:, (k + 1) % 3]), 1)

    def fresh(self, joint: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Those triangles of which no edge is there yet."""
        taken = np.zeros(len(joint), bool)
        for k in range(3):
            taken |= self.table[joint, triangles[:, k], triangles[:, (k + 1) % 3]] > 0
        return joint[~taken], triangles[~taken]

    def open_edges(
        self, joint: np.ndarray, triangles: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Edges that the triangles missing beside some triangles have, and the latters' third corners."""
        found = []
        for k in range(3):
            a, b, c = (triangles[:, (k + m) % 3] for m in range(3))
            missing = self.table[joint, b, a] == 0
            found.append((joint[missing], np.column_stack([b, a])[missing], c[missing]))
        joints, edges, third = (np.concatenate(column) for column in zip(*found, strict=True))
        order = np.argsort(joints, kind="stable")
        return joints[order], edges[order], third[order]

    def closed(self) -> np.ndarray:
        """Joints of which every edge is there once in each direction."""
        once = (self.table <= 1).all(axis=(1, 2))
        return once & (self.table == np.swapaxes(self.table, 1, 2)).all(axis=(1, 2))


def _covering_once(rings: Rings, joint: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Joints whose triangles and rings, all facing outwards, sum up to one sphere."""
    directions = rings.directions()
    a, b, c = (directions[joint, triangles[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    total = np.bincount(joint, weights=_solid_angle(a, b, c, volume), minlength=len(directions))
    corners = rings.corners
    following = np.roll(corners, -1, axis=2)
    axes = np.broadcast_to(rings.axes[:, :, None], corners.shape)
    cap = np.einsum("jsnd,jsnd->jsn", axes, np.cross(corners, following))
    total += _solid_angle(axes, corners, following, cap).sum(axis=(1, 2))
    inward = np.bincount(joint, weights=volume <= SMALLEST_VOLUME, minlength=len(directions))
    return (inward == 0) & (np.abs(total - 4 * np.pi) < SPHERE_SLACK)


def _solid_angle(a: np.ndarray, b: np.ndarray, c: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """Of triangles of unit directions (Van Oosterom and Strackee 1983), given their volume."""
    ab, bc, ca = ((x * y).sum(axis=-1) for x, y in ((a, b), (b, c), (c, a)))
    return 2 * np.arctan2(volume, 1 + ab + bc + ca)
