"""A net of several kinds of unit cells, joined in the faces where two kinds meet."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse
from jaxtyping import Float, Int

from texmap_opt.cells.unit_cell import TICKS, UnitCell
from texmap_opt.structure.face_overlay import FaceOverlay, face_overlay
from texmap_opt.structure.interface import Interface
from texmap_opt.structure.layout import Layout
from texmap_opt.structure.net import Net, weld
from texmap_opt.structure.structure import TRANSITION

# Coordinates of different kinds that differ by less are the same to whoever typed them [ticks]: a
# ten-thousandth of a cell, a tenth of what joints of one cell are apart at least.
AGREE = TICKS // 10_000


@dataclass(frozen=True, eq=False)
class _Points:
    """Places that become joints by welding.

    Attributes:
        ticks: positions in steps of 1/`TICKS` of a cell.
        cell: number of a grid cell that holds each, in C order.
        local: coordinates in that cell, 0 to 1.
    """

    ticks: Int[np.ndarray, "samples d"]
    cell: Int[np.ndarray, " samples"]
    local: Float[np.ndarray, "samples d"]


@dataclass(frozen=True, eq=False)
class _Struts:
    """Struts, each as often as cells share it.

    Attributes:
        ends: the two points or joints of each.
        cell: number of the grid cell that has it.
        kind: index of its kind.
        radius: relative radius.
    """

    ends: Int[np.ndarray, "struts 2"]
    cell: Int[np.ndarray, " struts"]
    kind: Int[np.ndarray, " struts"]
    radius: Float[np.ndarray, " struts"]

    def select(self, chosen: np.ndarray) -> "_Struts":
        """Some of them, by number or mark."""
        return _Struts(self.ends[chosen], self.cell[chosen], self.kind[chosen], self.radius[chosen])


@dataclass(frozen=True, eq=False)
class _Meeting:
    """Faces in which the same two patterns meet.

    Attributes:
        axis: normal to the faces.
        kinds: index of the lower and of the upper cell's kind.
        cells: numbers of the grid cells on the lower and on the upper side.
        overlay: the net in each of the faces.
        start: number of the first of their points; those of a face follow each other.
    """

    axis: int
    kinds: tuple[int, int]
    cells: Int[np.ndarray, "2 faces"]
    overlay: FaceOverlay
    start: int

    @property
    def points(self) -> Int[np.ndarray, "faces points"]:
        """Numbers of the points of the overlay in each face."""
        faces, points = self.cells.shape[1], len(self.overlay.points)
        return self.start + np.arange(faces * points).reshape(faces, points)


def mixed_net(layout: Layout) -> tuple[Net, tuple[Interface, ...]]:
    """Put the cells of a layout side by side and join what meets.

    Neighbours of one kind share what lies in their faces: joints and struts at one place are one. In
    a face between two kinds joints that coincide are shared, struts that cross get a joint, and
    joints that then lead nowhere get transition struts: see `face_overlay`. So struts in such a face
    lead from each of its joints to both nets. Everything is compared in whole numbers of 1/`TICKS`
    cells, never by distance, after coordinates of different kinds that are nearly equal have been
    made so (`in_agreement`).

    A strut that several kinds have counts as of the first of these in the layout, with the largest of
    their radii. A transition strut is shared by the two cells whose face it lies in.
    """
    layout = replace(layout, cells=in_agreement(layout.cells))
    joints_before = _starts(layout, [len(cell.joints) for cell in layout.cells])
    meetings = list(_meetings(layout, int(joints_before[-1])))
    points = _points(layout, meetings)
    first, joint = weld(points.ticks)
    struts, split = _struts(layout, meetings, joints_before[:-1])
    struts = _between_joints(struts, joint)
    if meetings:
        struts = _cut_on_edges(struts, points.ticks[first])
    net = _net(layout, struts, points, first)
    return net, _interfaces(layout, meetings, split, joint)


def in_agreement(cells: tuple[UnitCell, ...]) -> tuple[UnitCell, ...]:
    """The cells, with coordinates that are nearly those of an earlier one made equal to them.

    One file says 0.333, another 1/3: their joints would be two, with a strut of no length between.
    Equal coordinates stay equal and mirror images stay that, so faces that match still do.
    """
    first, *others = cells
    agreed = [first]
    known = np.unique(np.concatenate([first.ticks.ravel(), TICKS - first.ticks.ravel()]))
    for cell in others:
        ticks = cell.ticks
        above = np.clip(np.searchsorted(known, ticks), 1, len(known) - 1)
        low, high = known[above - 1], known[above]
        near = np.where(ticks - low < high - ticks, low, high)
        moved = (near != ticks) & (np.abs(near - ticks) <= AGREE)
        agreed.append(replace(cell, joints=np.where(moved, near / TICKS, cell.joints)))
        ticks = np.where(moved, near, ticks).ravel()
        known = np.unique(np.concatenate([known, ticks, TICKS - ticks]))
    return tuple(agreed)


def _starts(layout: Layout, counts: list[int]) -> Int[np.ndarray, " _"]:
    """Number of what comes before each cell where each has as many as its kind; last: of all."""
    return np.concatenate([[0], np.cumsum(np.array(counts)[layout.kinds.ravel()])])


def _meetings(layout: Layout, start: int) -> Iterator[_Meeting]:
    """Faces between kinds, by what meets in them."""
    number = np.arange(layout.kinds.size).reshape(layout.shape)
    kinds, reflected = layout.kinds.ravel(), layout.reflected
    for axis in range(len(layout.shape)):
        along = np.moveaxis(number, axis, 0)
        both = np.stack([along[:-1].ravel(), along[1:].ravel()])
        both = both[:, kinds[both[0]] != kinds[both[1]]]
        looks = np.concatenate([kinds[both].T, *reflected[both]], axis=1)
        looks, group = np.unique(looks, axis=0, return_inverse=True)
        for look, (lower, upper, *turned) in enumerate(looks.tolist()):
            d = len(turned) // 2
            overlay = face_overlay(
                (layout.cells[lower], layout.cells[upper]),
                (tuple(map(bool, turned[:d])), tuple(map(bool, turned[d:]))),
                axis,
            )
            cells = both[:, group == look]
            yield _Meeting(axis, (lower, upper), cells, overlay, start)
            start += cells.shape[1] * len(overlay.points)


def _points(layout: Layout, meetings: list[_Meeting]) -> _Points:
    """The joints of all cells in C order, then those of the faces between kinds."""
    index, reflected = layout.index, layout.reflected
    start = _starts(layout, [len(cell.joints) for cell in layout.cells])
    d = len(layout.shape)
    ticks, local = np.zeros((start[-1], d), np.int64), np.zeros((start[-1], d))
    for kind, cell in enumerate(layout.cells):
        cells = np.flatnonzero(layout.kinds.ravel() == kind)
        rows = start[cells][:, None] + np.arange(len(cell.joints))
        turned = reflected[cells][:, None]
        ticks[rows] = np.where(turned, TICKS - cell.ticks, cell.ticks)
        local[rows] = np.where(turned, 1 - cell.joints, cell.joints)
    owner = np.repeat(np.arange(layout.kinds.size), np.diff(start))
    for meeting in meetings:
        # Points of a face lie in its lower cell, on the upper end of the axis.
        places = np.insert(meeting.overlay.points, meeting.axis, TICKS, axis=1)
        lower = meeting.cells[0]
        ticks = np.concatenate([ticks, np.tile(places, (len(lower), 1))])
        local = np.concatenate([local, np.tile(places / TICKS, (len(lower), 1))])
        owner = np.concatenate([owner, np.repeat(lower, len(places))])
    return _Points(ticks + index[owner] * TICKS, owner, local)


def _struts(
    layout: Layout, meetings: list[_Meeting], joints_before: Int[np.ndarray, " cells"]
) -> tuple[_Struts, list[Int[np.ndarray, "split 2"]]]:
    """The struts of all cells and faces, and of each meeting the ends of those it splits."""
    start = _starts(layout, [len(cell.struts) for cell in layout.cells])
    cell_of = np.repeat(np.arange(layout.kinds.size), np.diff(start))
    ends, radius = np.zeros((start[-1], 2), np.int64), np.zeros(start[-1])
    for kind, cell in enumerate(layout.cells):
        cells = np.flatnonzero(layout.kinds.ravel() == kind)
        rows = start[cells][:, None] + np.arange(len(cell.struts))
        ends[rows] = joints_before[cells][:, None, None] + cell.struts
        radius[rows] = cell.relative_radius
    whole = np.ones(len(ends), bool)
    parts, split = [], []
    for meeting in meetings:
        overlay = meeting.overlay
        side, strut = overlay.piece_side, overlay.piece_strut
        rows = start[meeting.cells[side]] + strut[:, None]
        split.append(ends[np.unique(rows[overlay.split])])
        # What lies on an edge of the grid lies in other faces too: `_cut_on_edges` sees to it.
        whole[rows[overlay.split & ~overlay.on_grid_edge]] = False
        parts += _in_faces(layout.cells, meeting)
    own = _Struts(ends, cell_of, layout.kinds.ravel()[cell_of], radius).select(whole)
    return _joined([own, *parts]), split


def _in_faces(cells: tuple[UnitCell, ...], meeting: _Meeting) -> Iterator[_Struts]:
    """Pieces of what is split within faces, and transition struts, which both cells have."""
    overlay = meeting.overlay
    within = overlay.split & ~overlay.on_grid_edge
    for side, kind in enumerate(meeting.kinds):
        chosen = within & (overlay.piece_side == side)
        radius = cells[kind].relative_radius[overlay.piece_strut[chosen]]
        yield _in_each_face(meeting, overlay.pieces[chosen], radius, side, kind)
        yield _in_each_face(
            meeting, overlay.transitions, overlay.transition_radius, side, len(cells)
        )


def _in_each_face(
    meeting: _Meeting,
    ends: Int[np.ndarray, "struts 2"],
    radius: Float[np.ndarray, " struts"],
    side: int,
    kind: int,
) -> _Struts:
    faces = meeting.cells.shape[1]
    return _Struts(
        ends=meeting.points[:, ends].reshape(-1, 2),
        cell=np.repeat(meeting.cells[side], len(ends)),
        kind=np.full(faces * len(ends), kind),
        radius=np.tile(radius, faces),
    )


def _joined(parts: list[_Struts]) -> _Struts:
    return _Struts(
        *(np.concatenate([getattr(p, name) for p in parts]) for name in _Struts.__annotations__)
    )


def _between_joints(struts: _Struts, joint: Int[np.ndarray, " samples"]) -> _Struts:
    """With welded ends, the smaller number first."""
    return replace(struts, ends=np.sort(joint[struts.ends], axis=1))


def _cut_on_edges(struts: _Struts, ticks: Int[np.ndarray, "joints d"]) -> _Struts:
    """Struts along edges of the grid cut at every joint there, whichever of the cells around has it.

    Args:
        struts: between joints.
        ticks: positions of the joints.
    """
    d = ticks.shape[1]
    on_grid = ticks % TICKS == 0
    for axis in range(d):
        across = np.delete(np.arange(d), axis)
        # Numbered so that joints on one edge follow each other.
        order = np.lexsort([ticks[:, axis], *ticks[:, across].T])
        place = np.argsort(order)
        a, b = struts.ends.T
        along = on_grid[a][:, across].all(axis=1) & (
            ticks[a][:, across] == ticks[b][:, across]
        ).all(axis=1)
        low = np.minimum(place[a], place[b])
        count = np.where(along, np.abs(place[a] - place[b]), 1)
        if count.max() == 1:
            continue
        step = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        pieces = struts.select(np.repeat(np.arange(len(count)), count))
        at = np.repeat(low, count) + step
        ends = np.where(
            np.repeat(along, count)[:, None],
            order[np.stack([at, (at + 1) % len(order)], axis=1)],
            pieces.ends,
        )
        struts = replace(pieces, ends=np.sort(ends, axis=1))
    return struts


def _net(
    layout: Layout, struts: _Struts, points: _Points, first: Int[np.ndarray, " joints"]
) -> Net:
    """The net, each strut once."""
    n = len(first)
    key, row = np.unique(struts.ends[:, 0] * n + struts.ends[:, 1], return_inverse=True)
    radius = np.zeros(len(key))
    np.maximum.at(radius, row, struts.radius)
    kind = np.full(len(key), len(layout.cells))
    np.minimum.at(kind, row, struts.kind)
    # A cell may have one twice, as its own and as a transition: that counts once.
    sharing = scipy.sparse.csr_array(
        (np.ones(len(row)), (row, struts.cell)), shape=(len(key), layout.kinds.size)
    )
    sharers = np.diff(sharing.indptr)
    sharing.data = 1 / np.repeat(sharers, sharers)
    owner = layout.index[points.cell[first]]
    names = tuple(cell.name for cell in layout.cells)
    return Net(
        shape=layout.shape,
        joints=owner + points.local[first],
        joint_cell=owner,
        joint_local=points.local[first],
        struts=np.stack(np.divmod(key, n), axis=1),
        relative_radius=radius,
        sharing=sharing,
        kind=kind,
        kinds=(*names, TRANSITION) if len(names) > 1 else names,
        section=layout.cells[0].section,
    )


def _interfaces(
    layout: Layout,
    meetings: list[_Meeting],
    split: list[Int[np.ndarray, "_ 2"]],
    joint: Int[np.ndarray, " samples"],
) -> tuple[Interface, ...]:
    """What was done between each two kinds; what several faces have counts once."""
    interfaces = []
    for pair in sorted({tuple(sorted(meeting.kinds)) for meeting in meetings}):
        chosen = [k for k, meeting in enumerate(meetings) if tuple(sorted(meeting.kinds)) == pair]
        here = [meetings[k] for k in chosen]
        shared = [m.points[:, m.overlay.of_kind.all(axis=1)].ravel() for m in here]
        added = [m.points[:, m.overlay.transitions].reshape(-1, 2) for m in here]
        interfaces.append(
            Interface(
                kinds=(layout.cells[pair[0]].name, layout.cells[pair[1]].name),
                faces=sum(m.cells.shape[1] for m in here),
                shared_joints=len(np.unique(joint[np.concatenate(shared)])),
                split_struts=_count(joint[np.concatenate([split[k] for k in chosen])]),
                transition_struts=_count(joint[np.concatenate(added)]),
            )
        )
    return tuple(interfaces)


def _count(pairs: Int[np.ndarray, "samples 2"]) -> int:
    """How many different pairs there are."""
    return len(np.unique(np.sort(pairs, axis=1), axis=0))
