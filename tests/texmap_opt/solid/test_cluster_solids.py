"""Struts that cannot be meshed alone: the result is one solid all the same, and they are counted."""

import manifold3d as m3
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lattices import octet, structure
from sound_solid import assert_sound, assert_valid

from texmap_opt.solid.clearance import Clusters
from texmap_opt.solid.cluster_solids import cluster_solids
from texmap_opt.solid.edges import Edges
from texmap_opt.solid.lattice_solid import LatticeSolid, lattice_solid
from texmap_opt.solid.strut_ends import StrutEnds
from texmap_opt.solid.struts import round_ring
from texmap_opt.structure.structure import Structure

# Sides of the reference's cylinders and balls, whose volumes are 0.6 and 2 % too small.
FINE = 32


def union_volume(lattice: Structure) -> float:
    """Volume of frusta and balls united by manifold3d [mm³]."""
    pieces = []
    for (a, b), (r, s) in zip(lattice.joints[lattice.struts], lattice.radii, strict=True):
        length = float(np.linalg.norm(b - a))
        z = (b - a) / length
        x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        x /= np.linalg.norm(x)
        frame = np.column_stack([x, np.cross(z, x), z, a])
        cylinder = m3.Manifold.cylinder(length, float(r), float(s), FINE)
        pieces.append(cylinder.transform(frame))
    thickest = np.zeros(len(lattice.joints))
    np.maximum.at(thickest, lattice.struts, lattice.radii)
    for joint in np.unique(lattice.struts):
        ball = m3.Manifold.sphere(float(thickest[joint]), FINE)
        pieces.append(ball.translate(lattice.joints[joint].tolist()))
    return m3.Manifold.batch_boolean(pieces, m3.OpType.Add).volume()


def meshed(lattice: Structure, **options) -> LatticeSolid:
    return lattice_solid(lattice, tolerance_mm=0.03, segments=16, **options)


def fan(degrees: float) -> Structure:
    """Two struts at an angle."""
    theta = np.deg2rad(degrees)
    return structure([[0, 0, 0], [6, 0, 0], 6 * np.array([np.cos(theta), np.sin(theta), 0])],
                     [[0, 1], [0, 2]], 0.3)  # fmt: skip


def hedgehog(count: int, radius: float) -> Structure:
    """Struts from one joint in directions at random."""
    directions = np.random.default_rng(0).normal(size=(count, 3))
    directions *= 10 / np.linalg.norm(directions, axis=1, keepdims=True)
    struts = np.column_stack([np.zeros(count, int), np.arange(1, count + 1)])
    return structure(np.concatenate([np.zeros((1, 3)), directions]), struts, radius)


CASES = {
    "crossing": structure([[0, 0, 0], [4, 0, 0], [2, -2, 0.1], [2, 2, 0.1]], [[0, 1], [2, 3]], 0.3),
    "short": structure(
        [[0, 0, 0], [4, 0, 0], [4.2, 0, 0.1], [4.2, 3, 0.1], [8, 0, 0]],
        [[0, 1], [1, 2], [2, 3], [2, 4]],
        0.3,
    ),
    "half a degree": fan(0.5),
    "60 struts": hedgehog(60, 0.3),
    "thick octet": octet(1, 5.0, 1.0),
    "in one line": structure([[0, 0, 0], [5, 0, 0], [9, 0, 0]], [[0, 1], [0, 2]], 0.4),
    "thick in the middle of a chain": structure(
        [[0, 0, 0], [4, 0, 0], [4.5, 0.5, 0], [6, 4, 0]],
        [[0, 1], [1, 2], [2, 3]],
        [[0.3, 0.6], [0.6, 0.6], [0.6, 0.3]],
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_they_are_united_and_counted(name):
    """One sound solid of the volume of frusta and balls.

    Balls of clusters contain the corners of their struts, so they are some 5 % thicker than these;
    16 sides.
    """
    lattice = CASES[name]
    solid = meshed(lattice)
    report = assert_valid(solid.surface, size=0.1)
    assert report.connected_components == 1
    assert solid.clusters == 1
    assert 0 < solid.cluster_struts <= len(lattice.struts)
    np.testing.assert_allclose(report.volume_mm3, union_volume(lattice), rtol=0.06)
    (note,) = solid.notes(0.0)
    assert f"{solid.cluster_struts:,} struts" in note


@pytest.mark.parametrize("radii", [(0.8, 0.8), (0.3, 0.8)])
def test_a_lone_strut_shorter_than_thick_is_a_solid_whether_united_or_not(radii):
    lattice = structure([[0, 0, 0], [1.5, 0, 0]], [[0, 1]], [radii])
    report = assert_valid(meshed(lattice).surface, size=0.1)
    assert report.connected_components == 1
    np.testing.assert_allclose(report.volume_mm3, union_volume(lattice), rtol=0.06)


def test_the_rest_of_a_lattice_is_meshed_as_without_the_cluster():
    """A crossing far from an octet: united there, meshed here, with its fillets."""
    block = octet(1, 5.0, 0.3)
    cross = CASES["crossing"]
    joints = np.concatenate([block.joints, cross.joints + 20])
    struts = np.concatenate([block.struts, cross.struts + len(block.joints)])
    both = meshed(structure(joints, struts, 0.3), fillet_mm=0.2)
    alone = meshed(block, fillet_mm=0.2)
    assert (both.clusters, both.cluster_struts, both.cluster_joints) == (1, 2, 0)
    crossing = meshed(cross, fillet_mm=0.2)
    np.testing.assert_allclose(
        both.surface.volume, alone.surface.volume + crossing.surface.volume, rtol=1e-6
    )


def test_a_lattice_without_clusters_says_nothing():
    solid = meshed(octet(1, 5.0, 0.3))
    assert (solid.clusters, solid.cluster_struts, solid.cluster_joints) == (0, 0, 0)
    assert solid.notes(0.0) == []
    assert_sound(solid.surface, octet(1, 5.0, 0.3))


def test_a_union_that_cuts_into_a_ring_says_which():
    """A strut that passes over the ring of another; the joint there is not in the cluster."""
    lattice = structure(
        [[0, 0, 0], [6, 0, 0], [0.3, -3, 0.1], [0.3, 3, 0.1]], [[0, 1], [2, 3]], 0.3
    )
    ends = StrutEnds.of(lattice, round_ring(16))
    both, no_joint = np.ones(2, bool), np.zeros(4, bool)
    (solid,) = cluster_solids(ends, Clusters(no_joint, both, np.array([[0, 1]])))
    np.testing.assert_array_equal(ends.joint[solid.spoiled], [0])
    # With the joint in it the three other rings are whole, and open.
    (solid,) = cluster_solids(ends, Clusters(np.arange(4) == 0, both, np.array([[0, 1]])))
    assert not len(solid.spoiled)
    assert (solid.corner >= 0).sum() == 3 * 16
    assert int(Edges(solid.surface).open.sum()) == 3 * 16


@settings(max_examples=3, deadline=None, derandomize=True)
@given(st.integers(0, 2**20), st.floats(0.15, 0.5), st.sampled_from([0.0, 0.2]))
def test_tangles_are_one_solid(seed, radius, fillet):
    """A chain of 16 struts through a box of 8 mm, which pass through each other at random."""
    joints = np.random.default_rng(seed).uniform(0, 8, (17, 3))
    chain = structure(joints, [[k, k + 1] for k in range(16)], radius)
    solid = meshed(chain, fillet_mm=fillet)
    report = assert_valid(solid.surface, size=0.1)
    assert report.connected_components == 1
    assert (solid.clusters > 0) == (solid.cluster_struts > 0)
    if not fillet:
        np.testing.assert_allclose(report.volume_mm3, union_volume(chain), rtol=0.04)


@pytest.mark.slow
@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 2**20), st.floats(0.1, 0.6), st.sampled_from([0.0, 0.3]))
def test_large_tangles_are_one_solid(seed, radius, fillet):
    joints = np.random.default_rng(seed).uniform(0, 12, (61, 3))
    chain = structure(joints, [[k, k + 1] for k in range(60)], radius)
    report = assert_valid(meshed(chain, fillet_mm=fillet).surface, size=0.1)
    assert report.connected_components == 1
