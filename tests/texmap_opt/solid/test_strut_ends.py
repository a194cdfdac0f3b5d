"""Rings: where struts part, what they leave free, and that fillets shrink where there is no room."""

import numpy as np
import pytest
from exact_union import Star, random_star
from hypothesis import given, settings
from hypothesis import strategies as st
from lattices import block, structure

from texmap_opt.solid.strut_ends import (
    CAP_SHARE,
    WIDEST_CAP,
    WIDEST_LONE_CAP,
    StrutEnds,
    clamped_fillets,
)
from texmap_opt.solid.struts import round_ring, square_ring

SECTION = round_ring(12)
seeds = st.integers(0, 2**20)


def ends_of(star: Star) -> StrutEnds:
    return StrutEnds.of(star.structure(), SECTION)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.floats(20.0, 80.0), st.floats(0.4, 2.0), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))
def test_two_struts_are_equally_far_in_the_direction_of_their_crotch(angle, ratio, m, n):
    """The formula for tan a, tried in the exact union of struts as thick as the corners."""
    theta, length = np.deg2rad(angle), 50.0
    axes = np.array([[1.0, 0, 0], [np.cos(theta), np.sin(theta), 0]])
    near = np.array([1.0, ratio])
    star = Star(axes, np.full(2, length), np.column_stack([near, near + length * np.array([m, n])]))
    ends = ends_of(star)
    at = [int(np.flatnonzero(ends.end == 2 * strut)[0]) for strut in (0, 1)]
    shares = ends._shared(np.array([at]))[0] / CAP_SHARE
    thick = Star(axes, star.lengths, ends.corner_radius * star.radii)
    np.testing.assert_allclose(shares.sum(), theta, rtol=1e-9)
    crotch = np.array([[np.cos(shares[0]), np.sin(shares[0]), 0]])
    first, second = thick.reaches(crotch)[:, 0]
    np.testing.assert_allclose(first, second, rtol=1e-9)


def test_equal_struts_share_the_angle_between_them():
    ends = ends_of(Star.of_equal([[1.0, 0, 0], [0.5, 0.5 * 3**0.5, 0]], length=20.0, radius=0.5))
    np.testing.assert_allclose(ends.cap[ends.joint == 0], CAP_SHARE * np.deg2rad(30), rtol=1e-12)
    # A free end sees nothing: its ring is as near as it may be.
    assert (ends.cap[ends.joint > 0] > WIDEST_CAP).all()
    assert (ends.cap <= WIDEST_LONE_CAP).all()


@settings(max_examples=15, deadline=None, derandomize=True)
@given(seeds)
def test_nothing_reaches_over_a_ring(seed):
    """Towards a ring's corners its own strut is the farthest of all, and so is the whole of a cap."""
    star = random_star(seed)
    ends = ends_of(star)
    mine = np.flatnonzero(ends.joint == 0)
    strut = ends.end[mine] // 2
    corners = ends.ring_corners(mine)
    distance = np.linalg.norm(corners, axis=-1)
    reaches = star.reaches((corners / distance[..., None]).reshape(-1, 3))
    for row, own in enumerate(strut):
        chosen = slice(row * len(SECTION), (row + 1) * len(SECTION))
        others = np.delete(reaches[:, chosen], own, axis=0)
        assert (others < distance[row]).all()
        assert (star.ball < distance[row]).all()


@settings(max_examples=15, deadline=None, derandomize=True)
@given(seeds, st.floats(0.0, 1.0))
def test_rings_of_one_joint_do_not_meet(seed, fillet):
    """The caps of any two take up less than the angle between their axes, with fillets or without."""
    star = random_star(seed)
    ends = ends_of(star)
    ends = ends.filleted(np.where(ends.valence > 1, fillet, 0.0))
    mine = ends.joint == 0
    cap, axis = ends.cap[mine], ends.axis[mine]
    angle = np.arccos(np.clip(axis @ axis.T, -1, 1))
    np.fill_diagonal(angle, np.inf)
    assert (cap[:, None] + cap < angle).all()


@settings(max_examples=10, deadline=None, derandomize=True)
@given(seeds, st.integers(3, 24))
def test_sections_have_the_area_of_their_circles(seed, sides):
    star = random_star(seed)
    ends = StrutEnds.of(star.structure(), round_ring(sides))
    corners = ends.ring_corners()
    fan = np.cross(corners[:, 1:-1] - corners[:, :1], corners[:, 2:] - corners[:, :1])
    area = np.linalg.norm(fan.sum(axis=1), axis=1) / 2
    radius = ends.radius + ends.slope * ends.ring
    np.testing.assert_allclose(area, np.pi * radius**2, rtol=1e-9)


def test_square_sections_lie_flat_in_a_cubic_lattice():
    """Their sides, not their corners, look along the axes."""
    ends = StrutEnds.of(
        structure([[0, 0, 0], [0, 0, 9]], [[0, 1]], 0.5, section="square"), square_ring()
    )
    corners = ends.ring_corners()
    assert ends.square
    np.testing.assert_allclose(np.abs(corners[..., :2]), 0.5, rtol=1e-12)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(seeds)
def test_struts_in_another_order_and_turned_round_have_the_same_ends(seed):
    star = random_star(seed)
    given_ = star.structure()
    random = np.random.default_rng(seed)
    order = random.permutation(len(star.axes))
    turned = random.random(len(order)) < 0.5
    flip = np.where(turned[:, None], [1, 0], [0, 1])
    struts, radii = (
        np.take_along_axis(array[order], flip, axis=1) for array in (given_.struts, given_.radii)
    )
    first = StrutEnds.of(given_, SECTION)
    second = StrutEnds.of(structure(given_.joints, struts, radii), SECTION)
    for name in ("axis", "radius", "slope", "cap", "ring"):
        one, other = (getattr(ends, name)[ends.joint == 0] for ends in (first, second))
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)


def test_corners_at_the_two_ends_of_a_strut_continue_each_other():
    """Corner -l of the second ring lies before corner l of the first, along the axis."""
    star = Star.of_equal([[1.0, 2, 3]], length=9.0, radius=0.5)
    ends = ends_of(star)
    near, far = ends.ring_corners(np.argsort(ends.end))
    along = far[(-np.arange(12)) % 12] - near
    np.testing.assert_allclose(np.cross(along, star.axes[0]), 0, atol=1e-12)


def test_a_strut_shorter_than_its_two_rings_is_short():
    """Rings at r k/tan(cap) from free ends, k the corners' distance; 2 % are left over."""
    lone = StrutEnds.of(structure([[0, 0, 0], [0, 0, 9]], [[0, 1]], 0.5), SECTION)
    ring = 0.5 * lone.corner_radius / np.tan(lone.cap[0])
    for length, short in ((2.05 * ring, False), (2.03 * ring, True)):
        ends = StrutEnds.of(structure([[0, 0, 0], [0, 0, length]], [[0, 1]], 0.5), SECTION)
        np.testing.assert_allclose(ends.used, 2 * ring, rtol=1e-12)
        assert ends.short[0] == short


def test_struts_in_one_line_out_of_a_joint_have_no_ring():
    """Their directions are the same: the ring is nowhere, and the strut counts as short."""
    ends = StrutEnds.of(
        structure([[0, 0, 0], [5, 0, 0], [9, 0, 0]], [[0, 1], [0, 2]], 0.5), SECTION
    )
    assert np.isinf(ends.ring[ends.joint == 0]).all()
    assert ends.short.all()


@pytest.mark.parametrize("name", ["octet", "bcc", "tetrakaidecahedron"])
def test_fillets_are_as_asked_for_where_there_is_room_and_smaller_where_not(name):
    lattice = block(name, 1, slenderness=0.08, warp=0.1)
    ends = StrutEnds.of(lattice, SECTION)
    radius = float(lattice.radii.max())
    inner = ends.valence > 1
    small, large = clamped_fillets(ends, 0.5 * radius), clamped_fillets(ends, 20 * radius)
    np.testing.assert_array_equal(small, np.where(inner, 0.5 * radius, 0.0))
    assert (large[inner] < 20 * radius).any() and (large <= 20 * radius).all()
    for fillets in (small, large):
        assert not ends.filleted(fillets).short.any()
    # The control: unclamped, they leave some struts no length.
    assert ends.filleted(np.where(inner, 20 * radius, 0.0)).short.any()
