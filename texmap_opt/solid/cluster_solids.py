"""Clusters of struts united as solids, and set into the rings of the struts that lead out of them.

A strut that leaves a cluster is part of its union up to a ring, with that ring's corners. The lid
of the ring is taken off, and the corners are those of the rest.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.combine.boolean import union
from texmap_opt.solid.clearance import Clusters
from texmap_opt.solid.joints import ball_within, balls
from texmap_opt.solid.strut_ends import StrutEnds
from texmap_opt.solid.struts import closed_loft
from texmap_opt.solid.tri_mesh import TriMesh


@dataclass(frozen=True, eq=False)
class ClusterSolid:
    """The open surface of one cluster.

    Attributes:
        surface: without the lids of its rings [mm].
        corner: for each vertex the ring corner that it is, end by end in the order of `StrutEnds`;
            -1 for all others.
        spoiled: ends whose rings the union cuts into; with any, the surface is of no use.
    """

    surface: TriMesh
    corner: Int[np.ndarray, " points"]
    spoiled: Int[np.ndarray, " ends"]


@dataclass(frozen=True, eq=False)
class _Lofts:
    """Pieces of struts.

    Attributes:
        outlines: both ends of each, as `closed_loft` takes them [mm].
        ring: number of the end whose ring each of them is; -1 for a section at a joint.
        turned: whether a ring is run through backwards.
    """

    outlines: Float[np.ndarray, "lofts 2 corners 3"]
    ring: Int[np.ndarray, "lofts 2"]
    turned: np.ndarray


def cluster_solids(ends: StrutEnds, united: Clusters) -> list[ClusterSolid]:
    """The surfaces of all clusters.

    Raises:
        SolidError: a union fails.
    """
    strut_label, joint_label = united.labels(ends.structure.struts)
    count = int(max(strut_label.max(initial=-1), joint_label.max(initial=-1))) + 1
    if not count:
        return []
    struts = _members(strut_label, count)
    joints = _members(joint_label, count)
    return [_solid(ends, united, *both) for both in zip(struts, joints, strict=True)]


def _members(label: np.ndarray, count: int) -> list[np.ndarray]:
    """Numbers of what belongs to each cluster."""
    order = np.argsort(label, kind="stable")
    order = order[label[order] >= 0]
    return np.split(order, np.searchsorted(label[order], np.arange(1, count)))


def _solid(
    ends: StrutEnds,
    united: Clusters,
    struts: Int[np.ndarray, " chosen"],
    joints: Int[np.ndarray, " inside"],
) -> ClusterSolid:
    whole, stubs = _whole_struts(ends, united, struts), _stubs(ends, united, joints)
    lofts = _Lofts(
        np.concatenate([whole.outlines, stubs.outlines]),
        np.concatenate([whole.ring, stubs.ring]),
        np.concatenate([whole.turned, stubs.turned]),
    )
    pieces = [closed_loft(first, second) for first, second in lofts.outlines]
    if len(joints):
        reach = np.zeros(len(ends.structure.joints))
        np.maximum.at(reach, ends.joint, ends.corner_radius * ends.radius)
        pieces += balls(
            ends.structure.joints[joints], reach[joints], ball_within(len(ends.section))
        )
    return _opened(ends, union(pieces), lofts)


def _whole_struts(ends: StrutEnds, united: Clusters, struts: np.ndarray) -> _Lofts:
    """Struts of a cluster, each from a ring or a joint to a ring or a joint."""
    at = ends.place.reshape(-1, 2)[struts]
    inside = united.joints[ends.joint[at]]
    flat = at.reshape(-1)
    outlines = np.where(inside.reshape(-1, 1, 1), ends.sections(flat), ends.ring_corners(flat))
    outlines = outlines.reshape(*at.shape, *outlines.shape[1:])
    return _Lofts(outlines, np.where(inside, -1, at), np.zeros(at.shape, bool))


def _stubs(ends: StrutEnds, united: Clusters, joints: np.ndarray) -> _Lofts:
    """The roots of all other struts of its joints, each from the joint to the ring there."""
    mine = np.isin(ends.joint, joints) & ~united.struts[ends.end // 2]
    at = np.flatnonzero(mine)
    back = -np.arange(len(ends.section)) % len(ends.section)
    outlines = np.stack([ends.sections(at), ends.ring_corners(at)[:, back]], axis=1)
    ring = np.column_stack([np.full(len(at), -1), at])
    return _Lofts(outlines, ring, np.broadcast_to(np.array([False, True]), ring.shape))


def _opened(ends: StrutEnds, whole: TriMesh, lofts: _Lofts) -> ClusterSolid:
    """The union without the lids of its rings."""
    sides = len(ends.section)
    place = {point.tobytes(): k for k, point in enumerate(whole.vertices + 0.0)}
    corner, spoiled = np.full(len(whole.vertices), -1), []
    for loft, side in np.argwhere(lofts.ring >= 0):
        number, outline = lofts.ring[loft, side], lofts.outlines[loft, side]
        found = np.array([place.get(point.tobytes(), -1) for point in outline + 0.0])
        if (found < 0).any():
            spoiled.append(number)
            continue
        local = np.arange(sides)
        corner[found] = number * sides + (-local % sides if lofts.turned[loft, side] else local)
    ring_of = np.where(corner >= 0, corner // sides, -1)[whole.faces]
    lid = (ring_of[:, 0] >= 0) & (ring_of == ring_of[:, :1]).all(axis=1)
    faces = np.bincount(ring_of[lid, 0], minlength=len(ends.end))
    rings = lofts.ring[lofts.ring >= 0]
    cut = rings[faces[rings] != sides - 2]
    return ClusterSolid(
        TriMesh(whole.vertices, whole.faces[~lid]),
        corner,
        np.unique(np.concatenate([np.array(spoiled, np.int64), cut])),
    )
