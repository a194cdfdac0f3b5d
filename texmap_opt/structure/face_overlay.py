"""The faces of two unit cells of different kinds laid on each other, and joined where they miss."""

import itertools
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse.csgraph
from jaxtyping import Bool, Float, Int

from texmap_opt.cells.face_patterns import face_pattern
from texmap_opt.cells.unit_cell import TICKS, UnitCell
from texmap_opt.structure.net import weld

# In steps of 1/`TICKS`: coordinates are rounded to one, and so is the place where two struts cross.
TOLERANCE = 4.0
# Relative difference of lengths that are equal but for the rounding of coordinates; also the sine of
# the angle below which struts are parallel.
SAME = 1e-6

# Of the lower and of the upper cell.
Cells = tuple[UnitCell, UnitCell]
Reflections = tuple[tuple[bool, ...], tuple[bool, ...]]


@dataclass(frozen=True, eq=False)
class FaceOverlay:
    """The net in the face between a lower cell and an upper one of another kind.

    Joints of the two that coincide are one point. Struts that cross have a point there, and a strut
    ends at every point it would run through, so that pieces meet at points only.

    Attributes:
        points: coordinates along the axes of the face, in steps of 1/`TICKS`.
        of_kind: whether a point is a joint of the lower and of the upper cell; neither where struts
            cross.
        thickest: relative radius of the thickest strut at each point.
        pieces: the two points of each piece of a strut; where struts of the two cells run along
            each other both have a piece.
        piece_side: 0 where it is of a strut of the lower cell, 1 of the upper.
        piece_strut: number of that strut in its cell.
        transitions: the two points of each transition strut.
    """

    points: Int[np.ndarray, "points across"]
    of_kind: Bool[np.ndarray, "points 2"]
    thickest: Float[np.ndarray, " points"]
    pieces: Int[np.ndarray, "pieces 2"]
    piece_side: Int[np.ndarray, " pieces"]
    piece_strut: Int[np.ndarray, " pieces"]
    transitions: Int[np.ndarray, "transitions 2"]

    @property
    def split(self) -> Bool[np.ndarray, " pieces"]:
        """Whether each piece is one of several of its strut."""
        strut = np.stack([self.piece_side, self.piece_strut], axis=1)
        _, row, count = np.unique(strut, axis=0, return_inverse=True, return_counts=True)
        return np.asarray(count[row] > 1)

    @property
    def on_grid_edge(self) -> Bool[np.ndarray, " pieces"]:
        """Whether each piece lies on the rim of the face, and so in the faces of other cells too."""
        ends = self.points[self.pieces]
        if ends.shape[2] == 1:
            return np.ones(len(ends), bool)
        at_end = (ends[:, 0] == 0) | (ends[:, 0] == TICKS)
        return ((ends[:, 0] == ends[:, 1]) & at_end).any(axis=1)

    @property
    def transition_radius(self) -> Float[np.ndarray, " transitions"]:
        """Relative radius: at either end of a transition strut there is one as thick."""
        return self.thickest[self.transitions].min(axis=1)

    def joined(self) -> Bool[np.ndarray, " points"]:
        """Whether struts in the face lead from each point to the nets of both cells."""
        n, along = len(self.points), np.concatenate([self.pieces, self.transitions])
        graph = scipy.sparse.coo_array((np.ones(len(along)), tuple(along.T)), shape=(n, n))
        net = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
        reached = np.zeros((n, 2), bool)
        np.logical_or.at(reached, net, self.of_kind)
        np.logical_or.at(reached, (net[self.pieces[:, 0]], self.piece_side), True)
        return np.asarray(reached[net].all(axis=1))


def face_overlay(cells: Cells, reflected: Reflections, axis: int) -> FaceOverlay:
    """What lies in the face between two cells, and the transition struts that join it.

    A joint from which no strut in the face leads to the other cell's net gets transition struts to
    the nearest joints of the other cell, to all of them where several are equally near. Lengths are
    those in the unit cube. No transition strut runs through a joint or across a strut.

    Args:
        cells: the lower and the upper one along the axis.
        reflected: for each of them, for each axis, whether it is reflected.
        axis: the face is normal to it.
    """
    overlay = _laid_on_each_other(cells, reflected, axis)
    loose = overlay.of_kind.any(axis=1) & ~overlay.joined()
    while loose.any():
        found = _nearest(overlay, loose)
        overlay = replace(overlay, transitions=np.concatenate([overlay.transitions, found]))
        loose[found.ravel()] = False
    return overlay


def _laid_on_each_other(cells: Cells, reflected: Reflections, axis: int) -> FaceOverlay:
    patterns = [
        face_pattern(cell, axis, 1 - side, reflected=turned)
        for side, (cell, turned) in enumerate(zip(cells, reflected, strict=True))
    ]
    places = np.concatenate([pattern.places for pattern in patterns])
    first, point = weld(places)
    of_pattern = np.split(point, [len(patterns[0].places)])
    points = places[first]
    of_kind = np.zeros((len(points), 2), bool)
    thickest = np.zeros(len(points))
    for side, (cell, pattern, at) in enumerate(zip(cells, patterns, of_pattern, strict=True)):
        of_kind[at, side] = True
        radius = np.zeros(len(cell.joints))
        np.maximum.at(radius, cell.struts, cell.relative_radius[:, None])
        thickest[at] = np.maximum(thickest[at], radius[pattern.joints])
    lines = [at[pattern.ends] for at, pattern in zip(of_pattern, patterns, strict=True)]
    crossings = _crossing_points(points, *lines)
    more = (0, len(crossings))
    points = np.concatenate([points, crossings])
    of_line, pieces = _cut_at_points(np.concatenate(lines), points)
    side = np.repeat([0, 1], [len(along) for along in lines])
    strut = np.concatenate([pattern.struts for pattern in patterns])
    radius = [c.relative_radius[p.struts] for c, p in zip(cells, patterns, strict=True)]
    thickest = np.pad(thickest, more)
    np.maximum.at(thickest, pieces, np.concatenate(radius)[of_line][:, None])
    return FaceOverlay(
        points=points,
        of_kind=np.pad(of_kind, (more, (0, 0))),
        thickest=thickest,
        pieces=pieces,
        piece_side=side[of_line],
        piece_strut=strut[of_line],
        transitions=np.zeros((0, 2), np.int64),
    )


def _crossing_points(
    points: Int[np.ndarray, "points across"],
    lower: Int[np.ndarray, "lower 2"],
    upper: Int[np.ndarray, "upper 2"],
) -> Int[np.ndarray, "crossings across"]:
    """Where struts of the two cells cross and no joint is yet, each place once."""
    along, across = points[lower].astype(float), points[upper].astype(float)
    share, crosses = _crossings(along, across)
    known = [*points.astype(float)]
    for a, b in np.argwhere(crosses):
        place = along[a, 0] + share[a, b] * (along[a, 1] - along[a, 0])
        if np.linalg.norm(np.array(known) - place, axis=1).min() > TOLERANCE:
            known.append(np.rint(place))
    return np.array(known[len(points) :], dtype=np.int64).reshape(-1, points.shape[1])


def _cut_at_points(
    lines: Int[np.ndarray, "lines 2"], points: Int[np.ndarray, "points across"]
) -> tuple[Int[np.ndarray, " pieces"], Int[np.ndarray, "pieces 2"]]:
    """Struts cut at every point they run through: the strut of each piece, and its two points."""
    places = points.astype(float)
    along, within = _places_along(places, places[lines])
    of_line, pieces = [], []
    for line, (start, end) in enumerate(lines.tolist()):
        stops = np.flatnonzero(within[:, line])
        chain = [start, *stops[np.argsort(along[stops, line])].tolist(), end]
        pieces += [sorted(pair) for pair in itertools.pairwise(chain)]
        of_line += [line] * (len(chain) - 1)
    return np.array(of_line, dtype=np.int64), np.array(pieces, dtype=np.int64).reshape(-1, 2)


def _nearest(
    overlay: FaceOverlay, loose: Bool[np.ndarray, " points"]
) -> Int[np.ndarray, "found 2"]:
    """Transition struts from loose joints to the nearest that they see.

    Of two that cross the longer is left out, of two equally long ones both, unless none remains. There
    is one: in a triangulation of the points that keeps the pieces as edges some edge leads from the net
    of a loose joint to that of the other kind, or to one that is joined.
    """
    for targets in (_of_the_other_kind(overlay), _on_a_joined_net(overlay)):
        seen = [_seen(overlay, int(j), targets[j]) for j in np.flatnonzero(loose)]
        found = np.unique(np.concatenate(seen), axis=0)
        if len(found):
            break
    ends = overlay.points[found].astype(float)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    shorter = length[None] <= length[:, None] * (1 + SAME)
    kept = found[~(_crossings(ends, ends)[1] & shorter).any(axis=1)]
    return kept if len(kept) else found[[np.argmin(length)]]


def _of_the_other_kind(overlay: FaceOverlay) -> Bool[np.ndarray, "points points"]:
    """Joints of the cell that a joint is not of."""
    lower, upper = overlay.of_kind.T
    return (lower[:, None] & upper[None]) | (upper[:, None] & lower[None])


def _on_a_joined_net(overlay: FaceOverlay) -> Bool[np.ndarray, "points points"]:
    """Points on struts that lead to both cells."""
    return np.broadcast_to(overlay.joined(), (len(overlay.points),) * 2)


def _seen(
    overlay: FaceOverlay, joint: int, targets: Bool[np.ndarray, " points"]
) -> Int[np.ndarray, "found 2"]:
    """Struts from a joint to the nearest targets with neither a joint nor a strut in between."""
    points = overlay.points.astype(float)
    targets = targets & (np.arange(len(points)) != joint)
    rays = np.array([[joint, int(k)] for k in np.flatnonzero(targets)], dtype=np.int64)
    if not len(rays):
        return np.zeros((0, 2), np.int64)
    net = np.concatenate([overlay.pieces, overlay.transitions])
    blocked = _places_along(points, points[rays])[1].any(axis=0)
    blocked |= _crossings(points[rays], points[net])[1].any(axis=1)
    rays = np.sort(rays[~blocked], axis=1)
    # What is a strut already makes no other.
    rays = rays[~(rays[:, None] == np.sort(net, axis=1)[None]).all(axis=2).any(axis=1)]
    if not len(rays):
        return rays
    length = np.linalg.norm(points[rays[:, 1]] - points[rays[:, 0]], axis=1)
    return rays[length <= length.min() * (1 + SAME)]


def _places_along(
    points: Float[np.ndarray, "points across"], lines: Float[np.ndarray, "lines 2 across"]
) -> tuple[Float[np.ndarray, "points lines"], Bool[np.ndarray, "points lines"]]:
    """How far along each line its foot of each point is, and whether the line runs through it."""
    axis = lines[:, 1] - lines[:, 0]
    length = np.linalg.norm(axis, axis=1)
    unit = axis / length[:, None]
    offset = points[:, None] - lines[None, :, 0]
    along = np.einsum("pla,la->pl", offset, unit)
    away = np.linalg.norm(offset - along[..., None] * unit, axis=2)
    return along, (away <= TOLERANCE) & (along > TOLERANCE) & (along < length - TOLERANCE)


def _crossings(
    lines: Float[np.ndarray, "lines 2 across"], others: Float[np.ndarray, "others 2 across"]
) -> tuple[Float[np.ndarray, "lines others"], Bool[np.ndarray, "lines others"]]:
    """Share along each line where it meets each other one, and whether both cross there.

    Lines that touch at an end do not cross, nor do those along each other, nor any in an edge, the
    face of a cell of two dimensions.
    """
    shape = (len(lines), len(others))
    if lines.shape[2] == 1:
        return np.zeros(shape), np.zeros(shape, bool)
    d, e = lines[:, None, 1] - lines[:, None, 0], others[None, :, 1] - others[None, :, 0]
    w = others[None, :, 0] - lines[:, None, 0]
    d_length, e_length = np.linalg.norm(d, axis=2), np.linalg.norm(e, axis=2)
    det = _cross(d, e)
    parallel = np.abs(det) <= SAME * d_length * e_length
    det = np.where(parallel, 1.0, det)
    s, t = _cross(w, e) / det, _cross(w, d) / det
    crosses = ~parallel
    for share, length in ((s, d_length), (t, e_length)):
        crosses &= (share * length > TOLERANCE) & ((1 - share) * length > TOLERANCE)
    return s, crosses


def _cross(u: Float[np.ndarray, "*_ 2"], v: Float[np.ndarray, "*_ 2"]) -> Float[np.ndarray, "*_"]:
    return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
