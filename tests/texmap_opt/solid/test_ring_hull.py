"""Triangulations of the directions that rings leave free."""

from itertools import permutations

import numpy as np
import pytest
from exact_union import random_star, sphere_points
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from texmap_opt.solid.ring_hull import SHAKE, RingHull, Rings, ring_hull
from texmap_opt.solid.strut_ends import StrutEnds
from texmap_opt.solid.struts import frames, round_ring

# Neighbours of a face-centred cubic point: rings of the octet, of which many lie on one circle.
OCTET = np.array(
    sorted({p for v in [(1, 1, 0), (1, -1, 0), (-1, -1, 0)] for p in permutations(v)}), float
) / np.sqrt(2)
NONE = np.zeros((0, 3))
CUBE = np.concatenate([np.eye(3), -np.eye(3)])


def rings(axes: np.ndarray, caps: np.ndarray | float, sides: int, back: np.ndarray = NONE) -> Rings:
    """Circles around one joint's axes, seen at the given angles."""
    u, v = frames(axes)
    angle = 2 * np.pi * np.arange(sides) / sides
    around = np.cos(angle)[:, None] * u[:, None] + np.sin(angle)[:, None] * v[:, None]
    caps = np.broadcast_to(caps, len(axes))[:, None, None]
    corners = np.cos(caps) * axes[:, None] + np.sin(caps) * around
    return Rings(axes[None], corners[None], back[None], np.ones((1, len(back)), bool))


def random_rings(seed: int, sides: int) -> Rings:
    """Rings of a random family, and points on its back."""
    star = random_star(seed)
    ends = StrutEnds.of(star.structure(), round_ring(sides))
    mine = np.flatnonzero(ends.joint == 0)
    points = sphere_points(60)
    behind = points[(points @ ends.axis[mine].T).max(axis=1) < 0]
    return rings(ends.axis[mine], ends.cap[mine], sides, behind)


def covering(of: Rings, hull: RingHull, directions: np.ndarray) -> np.ndarray:
    """How many triangles and rings lie in each direction."""
    points = of.directions()[0]
    corners = points[hull.triangles]
    count = np.zeros(len(directions), int)
    a, b, c = np.moveaxis(corners, 1, 0)
    sides = [directions @ np.cross(x, y).T > 0 for x, y in ((a, b), (b, c), (c, a))]
    count += (sides[0] & sides[1] & sides[2]).sum(axis=1)
    for ring in of.corners[0]:
        walls = np.cross(ring, np.roll(ring, -1, axis=0))
        count += (directions @ walls.T > 0).all(axis=1)
    return count


def cyclic(triangles: np.ndarray) -> set[tuple[int, int, int]]:
    """Triangles from their smallest corner on."""
    first = triangles.argmin(axis=1)
    rows = np.arange(len(triangles))
    turned = np.column_stack([triangles[rows, (first + k) % 3] for k in range(3)])
    return set(map(tuple, turned.tolist()))


def outside_rings(of: Rings) -> set[tuple[int, int, int]]:
    """Facets of the convex hull by Qhull, of the same shaken points, without those in one ring."""
    points = of.directions()[0]
    points = points + np.random.default_rng(0).uniform(-SHAKE, SHAKE, points.shape)
    hull = ConvexHull(points)
    facets = hull.simplices.astype(np.int64)
    a, b, c = np.moveaxis(points[facets], 1, 0)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    facets[inward] = facets[inward, ::-1]
    ring = np.where(facets < of.on_rings, facets // of.sides, -1 - facets)
    return cyclic(facets[(ring != ring[:, :1]).any(axis=1)])


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.integers(0, 2**20), st.sampled_from([8, 12, 24]))
def test_triangles_are_the_facets_of_the_convex_hull(seed, sides):
    given_ = random_rings(seed, sides)
    # Lone struts and pairs may need more points on the back than these.
    assume(len(given_.axes[0]) > 2)
    hull = ring_hull(given_)
    assert hull.valid[0]
    assert cyclic(hull.triangles) == outside_rings(given_)


@pytest.mark.parametrize("axes", [OCTET, CUBE], ids=["octet", "cube"])
@pytest.mark.parametrize("sides", [4, 8, 12, 16, 24])
def test_symmetric_joints_are_triangulated_though_many_corners_lie_on_one_circle(axes, sides):
    """The octet's rings between squares and triangles of struts: a planar graph of the sphere.

    V - E + F = 2 with the rings as faces: F = 2 (V - 2) less the sides - 2 triangles of each ring.
    """
    half = np.arccos(np.sort(axes @ axes.T, axis=1)[0, -2]) / 2
    given_ = rings(axes, 0.98 * half, sides)
    hull = ring_hull(given_)
    assert hull.valid[0]
    assert len(hull.triangles) == 2 * (len(axes) * sides - 2) - len(axes) * (sides - 2)
    assert cyclic(hull.triangles) == outside_rings(given_)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(st.integers(0, 2**20))
def test_every_direction_lies_in_one_triangle_or_one_ring(seed):
    given_ = random_rings(seed, 12)
    assume(len(given_.axes[0]) > 2)
    hull = ring_hull(given_)
    assert (covering(given_, hull, sphere_points(3000)) == 1).all()
    # The control: one triangle less is seen where it lay.
    fewer = RingHull(hull.joint[1:], hull.triangles[1:], hull.valid)
    middle = given_.directions()[0][hull.triangles[0]].sum(axis=0)
    assert covering(given_, fewer, middle[None] / np.linalg.norm(middle))[0] == 0


def test_rings_that_meet_and_rings_that_leave_half_the_sphere_free_are_not_valid():
    assert not ring_hull(rings(CUBE, np.deg2rad(50), 12)).valid[0]
    # Axes are 55 degrees from the diagonal: caps of 20 degrees leave half the sphere free.
    assert not ring_hull(rings(np.eye(3), np.deg2rad(20), 12)).valid[0]
    back = -np.ones((1, 3)) / np.sqrt(3)
    assert ring_hull(rings(np.eye(3), np.deg2rad(20), 12, back)).valid[0]


def test_many_joints_at_once_are_those_joints_one_by_one():
    axes = np.stack([OCTET, OCTET @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])])
    single = [rings(each, 0.5, 12) for each in axes]
    both = Rings(
        axes,
        np.concatenate([each.corners for each in single]),
        np.zeros((2, 0, 3)),
        np.zeros((2, 0), bool),
    )
    hull = ring_hull(both)
    assert hull.valid.all()
    for joint, each in enumerate(single):
        assert cyclic(hull.triangles[hull.joint == joint]) == cyclic(ring_hull(each).triangles)
