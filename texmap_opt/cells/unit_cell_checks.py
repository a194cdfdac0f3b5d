"""What makes joints and struts a unit cell: found by geometry, said with the element that is at fault."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse.csgraph
from jaxtyping import Bool, Int
from scipy.spatial import KDTree

from texmap_opt.box_pairs import box_pairs
from texmap_opt.cells.unit_cell import TICKS, UnitCell
from texmap_opt.structure.net import Net
from texmap_opt.structure.segment_distance import point_distance, segment_distance
from texmap_opt.structure.tile import tile

AXES = "xyz"
# The middle one of three cells has all its neighbours; where all cells are copies, two show both sides.
# Of a mirrored tiling two show only one of the faces in which cells meet.
COPIES, WHOLE_BLOCK = 2, 3
# Struts nearer than this touch [cells]: above the rounding of coordinates to ticks.
TOUCHING = 2 / TICKS
# Joints nearer than this are one joint with coordinates of too few digits [cells]: thinner than any
# strut that prints.
CLOSE = 1e-3


@dataclass(frozen=True)
class Fault:
    """What is wrong with a cell.

    Attributes:
        kind: of the element at fault: "joint", "strut" or "cell".
        index: which joint or strut.
        message: what is wrong and what to do.
    """

    kind: str
    index: int
    message: str


def first_fault(cell: UnitCell) -> Fault | None:
    """The first thing that keeps a cell from making a lattice; None: nothing does."""
    return next(_faults(cell), None)


def _faults(cell: UnitCell) -> Iterator[Fault]:
    yield from _bare_joints(cell)
    yield from _close_joints(cell)
    yield from _joints_in_struts(cell)
    for axis, mirrored in enumerate(cell.mirrored):
        if not mirrored:
            yield from _unmatched_faces(cell, axis)
    yield from _separate_nets(cell)
    yield from _loose_ends(cell)
    yield from _crossings(cell)


def _bare_joints(cell: UnitCell) -> Iterator[Fault]:
    for joint in sorted(set(range(len(cell.joints))) - set(cell.struts.ravel().tolist())):
        yield Fault(
            "joint",
            joint,
            f'joint "{cell.joint_names[joint]}" has no strut; remove it or join it.',
        )


def _close_joints(cell: UnitCell) -> Iterator[Fault]:
    """Joints that are meant to be one, by their coordinates' last digits."""
    for first, second in KDTree(cell.joints).query_pairs(CLOSE, output_type="ndarray"):
        a, b = sorted((int(first), int(second)))
        yield Fault(
            "joint",
            b,
            f'joint "{cell.joint_names[b]}" is nearer than {CLOSE:g} cells to '
            f'"{cell.joint_names[a]}"; make them one, or move them apart.',
        )


def _joints_in_struts(cell: UnitCell) -> Iterator[Fault]:
    """A strut that runs through a joint of the cell would be printed joined and computed apart."""
    strut, joint = np.indices((len(cell.struts), len(cell.joints))).reshape(2, -1)
    other = (cell.struts[strut] != joint[:, None]).all(axis=1)
    strut, joint = strut[other], joint[other]
    away = point_distance(cell.joints[joint], cell.joints[cell.struts[strut]])
    for met in np.flatnonzero(away < TOUCHING):
        through = int(strut[met])
        yield Fault(
            "strut",
            through,
            f'strut "{_strut_name(cell, through)}" runs through joint '
            f'"{cell.joint_names[joint[met]]}"; make it two struts.',
        )


def _unmatched_faces(cell: UnitCell, axis: int) -> Iterator[Fault]:
    """Whatever lies in a face must lie in the opposite one, for neighbours to share it."""
    across = np.delete(cell.ticks, axis, axis=1)
    faces = [cell.ticks[:, axis] == 0, cell.ticks[:, axis] == TICKS]
    for this, other in (faces, faces[::-1]):
        for kind, things in (("joint", _points), ("strut", _lines)):
            there = things(cell, across, other)
            for place, index in things(cell, across, this).items():
                if place not in there:
                    name = cell.joint_names[index] if kind == "joint" else _strut_name(cell, index)
                    yield Fault(
                        kind,
                        index,
                        f'{kind} "{name}" lies in a face across {AXES[axis]} and has no match in the '
                        "opposite face, so neighbours would not share it; add the match or use "
                        'tiling="mirror" along that axis.',
                    )


def _separate_nets(cell: UnitCell) -> Iterator[Fault]:
    block = tuple(WHOLE_BLOCK if mirrored else COPIES for mirrored in cell.mirrored)
    net = tile(cell, block)
    n = len(net.joints)
    graph = scipy.sparse.coo_array((np.ones(len(net.struts)), tuple(net.struts.T)), shape=(n, n))
    pieces = scipy.sparse.csgraph.connected_components(graph, directed=False)[0]
    if pieces > 1:
        yield Fault(
            "cell",
            0,
            f'a block of {" x ".join(map(str, block))} cells with tiling="{cell.tiling}" falls into {pieces} '
            "separate nets; neighbours must share joints: change the tiling, or add struts.",
        )


def _loose_ends(cell: UnitCell) -> Iterator[Fault]:
    net = tile(cell, (WHOLE_BLOCK,) * cell.dimensions)
    degree = np.bincount(net.struts.ravel(), minlength=len(net.joints))
    inside = ((net.joints >= 1) & (net.joints <= 2)).all(axis=1)
    for joint in np.flatnonzero(inside & (degree == 1)):
        own = _own_joint(cell, net, int(joint))
        yield Fault(
            "joint",
            own,
            f'joint "{cell.joint_names[own]}" is a loose end: only one strut of the endless lattice '
            "ends there; add a strut or remove it.",
        )


def _crossings(cell: UnitCell) -> Iterator[Fault]:
    """Struts that cross or overlap between their joints are not joined there, but print as one."""
    net = tile(cell, (COPIES,) * cell.dimensions)
    ends = net.joints[net.struts]
    flat = np.zeros((len(ends), 2, 3))
    flat[..., : cell.dimensions] = ends
    i, j = box_pairs(flat.min(axis=1), flat.max(axis=1)).T
    apart = ~(net.struts[i][:, :, None] == net.struts[j][:, None, :]).any(axis=(1, 2))
    i, j = i[apart], j[apart]
    for met in np.flatnonzero(segment_distance(ends[i], ends[j]) < TOUCHING):
        first, second = (_own_strut(cell, net, int(strut[met])) for strut in (i, j))
        yield Fault(
            "strut",
            first,
            f'strut "{_strut_name(cell, first)}" crosses strut "{_strut_name(cell, second)}", its '
            "own or a neighbour's, where there is no joint; give both a joint there.",
        )


def _own_strut(cell: UnitCell, net: Net, strut: int) -> int:
    """The strut of the cell that a strut of a net is a copy of."""
    index = np.array(np.unravel_index(net.cell[strut], net.shape))
    local = net.joints[net.struts[strut]] - index
    local = np.where((index % 2 == 1) & np.array(cell.mirrored), 1 - local, local)
    own = [np.argmin(np.linalg.norm(cell.joints - place, axis=1)) for place in local]
    return int(np.argmax((np.sort(cell.struts, axis=1) == sorted(own)).all(axis=1)))


def _own_joint(cell: UnitCell, net: Net, joint: int) -> int:
    """The joint of the cell that a joint of a net is a copy of."""
    local = net.joint_local[joint]
    odd = (net.joint_cell[joint] % 2 == 1) & np.array(cell.mirrored)
    place = np.where(odd, 1 - local, local)
    return int(np.argmin(np.linalg.norm(cell.joints - place, axis=1)))


def _strut_name(cell: UnitCell, strut: int) -> str:
    a, b = cell.struts[strut]
    return f"{cell.joint_names[a]}–{cell.joint_names[b]}"


def _points(
    cell: UnitCell, across: Int[np.ndarray, "joints _"], in_face: Bool[np.ndarray, " joints"]
) -> dict[tuple, int]:
    """Joints in a face, by their place in it."""
    return {tuple(across[j].tolist()): int(j) for j in np.flatnonzero(in_face)}


def _lines(
    cell: UnitCell, across: Int[np.ndarray, "joints _"], in_face: Bool[np.ndarray, " joints"]
) -> dict[tuple, int]:
    """Struts in a face, by the places of their ends and their radius."""
    lines = {}
    for s in np.flatnonzero(in_face[cell.struts].all(axis=1)):
        ends = sorted(map(tuple, across[cell.struts[s]].tolist()))
        lines[(*ends, float(cell.relative_radius[s]))] = int(s)
    return lines
