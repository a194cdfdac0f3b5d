"""Which struts and joints can be meshed on their own, and which must be united as solids.

A joint's surface stands by itself when its rings are apart and leave every strut a length, and
when no strut that does not meet there comes near. Where that fails, at struts too short for their
radii or passing through each other, the struts and joints concerned form clusters.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse.csgraph
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from texmap_opt.solid.strut_ends import USABLE_LENGTH, StrutEnds
from texmap_opt.structure.segment_distance import segment_distance

# Struts longer than so many medians are looked at in pieces of the median's length.
LONG = 1.5
# Pairs of struts whose distance is computed at once, about 200 MB.
PAIRS_AT_ONCE = 500_000
# Part of a strut beyond its ring that counts as the joint's, in lengths up to the ring.
BEYOND_RING = 1.1
# Gap between struts, over the thicker one's radius, below which they count as touching.
TOUCHING = 1e-3


@dataclass(frozen=True, eq=False)
class Clusters:
    """Struts and joints that cannot be meshed on their own.

    Attributes:
        joints: whose struts are united up to their rings there.
        struts: that are united over their whole length between the rings, or joints, at their ends.
        pairs: struts that pass too near to each other.
    """

    joints: Bool[np.ndarray, " joints"]
    struts: Bool[np.ndarray, " struts"]
    pairs: Int[np.ndarray, "pairs 2"]

    def labels(
        self, struts: Int[np.ndarray, "struts 2"]
    ) -> tuple[Int[np.ndarray, " struts"], Int[np.ndarray, " joints"]]:
        """Number of the cluster of each strut and of each joint; -1 outside."""
        count = len(struts)
        member, end = np.nonzero(self.joints[struts] & self.struts[:, None])
        first = np.concatenate([member, self.pairs[:, 0]])
        second = np.concatenate([count + struts[member, end], self.pairs[:, 1]])
        size = count + len(self.joints)
        graph = scipy.sparse.coo_array((np.ones(len(first)), (first, second)), shape=(size, size))
        label = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
        inside = np.concatenate([self.struts, self.joints])
        numbers = np.full(size, -1)
        numbers[inside] = np.unique(label[inside], return_inverse=True)[1]
        return numbers[:count], numbers[count:]

    def grown(
        self,
        joints: Int[np.ndarray, " more"],
        struts: Int[np.ndarray, " others"],
    ) -> "Clusters":
        """The same with more joints and struts, given by their numbers."""
        all_joints, all_struts = self.joints.copy(), self.struts.copy()
        all_joints[joints], all_struts[struts] = True, True
        return replace(self, joints=all_joints, struts=all_struts)


def clusters(
    ends: StrutEnds,
    near: Int[np.ndarray, "pairs 2"],
    gaps: Float[np.ndarray, " pairs"],
    *,
    tolerance: float,
) -> Clusters:
    """What must be united.

    Args:
        ends: of all struts.
        near: struts that come near to each other, within 2 `tolerance` and the largest fillet.
        gaps: between them [mm].
        tolerance: by which a joint's surface may stand out of its struts [mm].
    """
    structure = ends.structure
    rings = ends.by_strut(ends.ring)
    wide = ends.short[:, None] & ~(rings <= USABLE_LENGTH * structure.lengths()[:, None] / 2)
    joints = np.zeros(len(structure.joints), bool)
    joints[structure.struts[wide]] = True
    passed, hit = _joints_passed(ends, near, tolerance)
    joints[passed] = True
    meeting = near[hit | (gaps < TOUCHING * structure.radii[near].max(axis=(1, 2)))]
    struts = ends.short.copy()
    struts[meeting.reshape(-1)] = True
    return Clusters(joints, struts, meeting)


def near_pairs(
    ends: StrutEnds, margin: float
) -> tuple[Int[np.ndarray, "pairs 2"], Float[np.ndarray, " pairs"]]:
    """Struts that share no joint and come near to each other, and the gap between them [mm].

    Args:
        ends: of all struts.
        margin: largest gap that counts [mm]; gaps below 0 are overlaps.
    """
    structure = ends.structure
    struts, joints = structure.struts, structure.joints
    thick = ends.corner_radius * structure.radii.max(axis=1)
    owner, middle, longest = _pieces(structure.lengths(), joints[struts])
    reach = longest + 2 * float(thick.max()) + margin
    pairs = KDTree(middle).query_pairs(reach, output_type="ndarray")
    found, gaps = [], []
    for start in range(0, len(pairs), PAIRS_AT_ONCE):
        pair = owner[pairs[start : start + PAIRS_AT_ONCE]]
        a, b = struts[pair[:, 0]], struts[pair[:, 1]]
        shared = (a[:, 0] == b[:, 0]) | (a[:, 0] == b[:, 1]) | (a[:, 1] == b[:, 0])
        apart = ~shared & (a[:, 1] != b[:, 1])
        pair, a, b = pair[apart], a[apart], b[apart]
        gap = segment_distance(joints[a], joints[b]) - thick[pair].sum(axis=1)
        close = gap < margin
        found.append(pair[close])
        gaps.append(gap[close])
    if not found:
        return np.zeros((0, 2), np.int64), np.zeros(0)
    every, first = np.unique(np.sort(np.concatenate(found), axis=1), axis=0, return_index=True)
    return every.astype(np.int64), np.concatenate(gaps)[first]


def _pieces(
    length: Float[np.ndarray, " struts"], ends: Float[np.ndarray, "struts 2 3"]
) -> tuple[Int[np.ndarray, " pieces"], Float[np.ndarray, "pieces 3"], float]:
    """Struts cut to about equal lengths: whose each piece is, its middle, the longest [mm]."""
    usual = LONG * float(np.median(length))
    count = np.maximum(np.ceil(length / usual), 1).astype(np.int64)
    owner = np.repeat(np.arange(len(length)), count)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    share = ((place + 0.5) / count[owner])[:, None]
    middle = ends[owner, 0] * (1 - share) + ends[owner, 1] * share
    return owner, middle, float((length / count).max())


def _joints_passed(
    ends: StrutEnds, near: Int[np.ndarray, "pairs 2"], tolerance: float
) -> tuple[Int[np.ndarray, " hits"], Bool[np.ndarray, " pairs"]]:
    """Joints whose own surface another strut comes near to, and the pairs of struts concerned."""
    structure = ends.structure
    struts, lengths = structure.struts, structure.lengths()
    rings = ends.by_strut(ends.ring)
    thick = ends.corner_radius * structure.radii.max(axis=1)
    # Fillets at both joints, and both their surfaces, may stand out towards each other.
    margin = 2 * tolerance + ends.fillet[struts[near]].max(axis=2).sum(axis=1)
    passed, concerned = [], np.zeros(len(near), bool)
    for mine, other in ((0, 1), (1, 0)):
        strut, against = near[:, mine], near[:, other]
        line = structure.joints[struts[strut]]
        along = (line[:, 1] - line[:, 0]) / lengths[strut][:, None]
        for end, sign in ((0, 1.0), (1, -1.0)):
            reach = np.minimum(BEYOND_RING * rings[strut, end], lengths[strut])
            root = np.stack([line[:, end], line[:, end] + sign * reach[:, None] * along], axis=1)
            gap = segment_distance(root, structure.joints[struts[against]])
            hit = gap < thick[strut] + thick[against] + margin
            passed.append(struts[strut[hit], end])
            concerned |= hit
    return np.concatenate(passed).astype(np.int64), concerned
