"""Which struts and joints cannot be meshed on their own."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from lattices import octet, structure

from texmap_opt.solid.clearance import Clusters, clusters, near_pairs
from texmap_opt.solid.strut_ends import StrutEnds
from texmap_opt.solid.struts import round_ring
from texmap_opt.structure.segment_distance import segment_distance
from texmap_opt.structure.structure import Structure

TOLERANCE = 0.01


def ends_of(lattice: Structure) -> StrutEnds:
    return StrutEnds.of(lattice, round_ring(12))


def found(lattice: Structure) -> Clusters:
    ends = ends_of(lattice)
    return clusters(ends, *near_pairs(ends, 2 * TOLERANCE), tolerance=TOLERANCE)


@settings(max_examples=15, deadline=None, derandomize=True)
@given(st.integers(0, 2**20), st.floats(0.0, 1.0))
def test_near_pairs_are_those_of_all_pairs(seed, margin):
    """Struts of very different lengths, which are looked at in pieces."""
    random = np.random.default_rng(seed)
    joints = random.uniform(0, 10, (40, 3)) * 10 ** random.uniform(-0.5, 0.3, (40, 1))
    pairs = np.array([random.choice(40, 2, replace=False) for _ in range(30)])
    struts = np.unique(np.sort(pairs, axis=1), axis=0)
    lattice = structure(joints, struts, random.uniform(0.05, 0.4, struts.shape))
    ends = ends_of(lattice)
    near, gaps = near_pairs(ends, margin)
    i, j = np.triu_indices(len(struts), 1)
    apart = (struts[i][:, :, None] != struts[j][:, None, :]).all(axis=(1, 2))
    i, j = i[apart], j[apart]
    thick = ends.corner_radius * lattice.radii.max(axis=1)
    line = joints[struts]
    gap = segment_distance(line[i], line[j]) - thick[i] - thick[j]
    close = gap < margin
    order = np.lexsort((near[:, 1], near[:, 0]))
    np.testing.assert_array_equal(near[order], np.column_stack([i, j])[close])
    np.testing.assert_allclose(gaps[order], gap[close], atol=1e-12)


def test_the_gap_of_parallel_struts_is_that_between_their_corners():
    lattice = structure(
        [[0, 0, 0], [9, 0, 0], [0, 2, 0], [9, 2, 0]], [[0, 1], [2, 3]], [[0.5, 0.5], [0.7, 0.7]]
    )
    ends = ends_of(lattice)
    near, gaps = near_pairs(ends, 1.0)
    np.testing.assert_array_equal(near, [[0, 1]])
    np.testing.assert_allclose(gaps, 2 - 1.2 * ends.corner_radius, rtol=1e-12)


def test_slender_struts_form_no_clusters_and_thick_ones_one():
    assert not found(octet(2, 5.0, 0.4)).struts.any()
    thick = found(octet(2, 5.0, 1.0))
    assert thick.joints.all() and thick.struts.all()
    strut_labels, joint_labels = thick.labels(octet(2, 5.0, 1.0).struts)
    assert set(strut_labels) == set(joint_labels) == {0}


def test_struts_that_cross_far_from_their_joints_leave_these_their_own():
    crossing = structure([[0, 0, 0], [8, 0, 0], [4, -4, 0.1], [4, 4, 0.1]], [[0, 1], [2, 3]], 0.3)
    cluster = found(crossing)
    assert cluster.struts.all() and not cluster.joints.any()


def test_a_strut_that_passes_a_joint_takes_it_into_the_cluster():
    """Past the joint's ring, 0.4 mm from it, and not past the ones at the far ends."""
    passing = structure(
        [[0, 0, 0], [8, 0, 0], [0.4, -4, 0.1], [0.4, 4, 0.1]], [[0, 1], [2, 3]], 0.3
    )
    np.testing.assert_array_equal(found(passing).joints, [True, False, False, False])


def test_places_far_from_each_other_are_clusters_of_their_own():
    cross = np.array([[0.0, 0, 0], [8, 0, 0], [4, -4, 0.1], [4, 4, 0.1]])
    joints = np.concatenate([cross, cross + 50, [[100, 0, 0], [110, 0, 0]]])
    struts = np.array([[0, 1], [2, 3], [4, 5], [6, 7], [8, 9]])
    lattice = structure(joints, struts, 0.3)
    cluster = found(lattice)
    np.testing.assert_array_equal(cluster.struts, [True] * 4 + [False])
    labels, joint_labels = cluster.labels(struts)
    assert labels[0] == labels[1] != labels[2] == labels[3]
    assert labels[4] == -1
    assert (joint_labels == -1).all()


def test_of_a_short_strut_the_joint_with_the_wider_ring_joins_the_cluster():
    """At an angle of 40 degrees the ring reaches past the strut's middle; at its free end not."""
    joints = [[0, 0, 0], [1.3, 0, 0], [9, 7.5, 0]]
    cluster = found(structure(joints, [[0, 1], [0, 2]], 0.4))
    np.testing.assert_array_equal(cluster.joints, [True, False, False])
    np.testing.assert_array_equal(cluster.struts, [True, False])


def test_grown_clusters_have_more_joints_and_struts():
    none = Clusters(np.zeros(3, bool), np.zeros(2, bool), np.zeros((0, 2), np.int64))
    more = none.grown(np.array([2]), np.array([0]))
    np.testing.assert_array_equal(more.joints, [False, False, True])
    np.testing.assert_array_equal(more.struts, [True, False])
    assert not none.joints.any()
