"""The lattice solid against closed forms and the topology of its graph."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lattices import block, jittered, octet, structure
from scipy.spatial import KDTree
from sound_solid import assert_sound

from texmap_opt.errors import LatticeError
from texmap_opt.solid.float32_solid import printable_mesh
from texmap_opt.solid.joints import UnitBall, balls
from texmap_opt.solid.lattice_solid import lattice_solid
from texmap_opt.solid.struts import (
    MAX_SEGMENTS,
    circumradius_of_equal_area,
    closed_loft,
    frames,
    round_ring,
    segments_within,
    square_ring,
)
from texmap_opt.solid.tri_mesh import TriMesh


def strut(start, end, radii, section) -> TriMesh:
    """A lone prism or frustum between two points."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    axis = (end - start) / np.linalg.norm(end - start)
    u, v = (each[0] for each in frames(axis[None]))
    across = section[:, :1] * u + section[:, 1:] * v
    back = -np.arange(len(section)) % len(section)
    return closed_loft(start + radii[0] * across, (end + radii[1] * across)[back])


def test_a_single_strut_is_a_capsule():
    """Cylinder pi r² L and two half balls, which are as round as the polygon's corners."""
    r, L = 0.8, 12.0
    solid = lattice_solid(
        structure([[0, 0, 0], [0, L, 0]], [[0, 1]], r), tolerance_mm=0.002, segments=48
    )
    capsule = np.pi * r**2 * L + 4 / 3 * np.pi * r**3
    np.testing.assert_allclose(solid.surface.volume, capsule, rtol=2e-3)
    assert_sound(solid.surface, structure([[0, 0, 0], [0, L, 0]], [[0, 1]], r))


@pytest.mark.parametrize("section", ["round", "square"])
def test_longer_struts_have_as_much_more_volume_as_their_section_says(section):
    """Ends are the same: pi r² or (2 h)² a millimetre, to rounding, whatever the sides."""
    size, lengths = 0.8, (5.0, 12.0)
    short, long = (
        lattice_solid(
            structure([[0, 0, 0], [0, 0, L]], [[0, 1]], size, section), tolerance_mm=0.05
        ).surface.volume
        for L in lengths
    )
    area = np.pi * size**2 if section == "round" else (2 * size) ** 2
    np.testing.assert_allclose(long - short, area * 7, rtol=1e-9)


def test_a_tapered_loft_has_the_volume_of_a_frustum():
    """Pi L (a² + a b + b²)/3; every cross-section has the circle's area, so it is exact."""
    loft = strut([0, 0, 0], [2, 3, 6], (0.5, 0.2), round_ring(9))
    np.testing.assert_allclose(loft.volume, np.pi * 7 * (0.25 + 0.1 + 0.04) / 3, rtol=1e-12)
    square = strut([0, 0, 0], [2, 3, 6], (0.5, 0.2), square_ring())
    np.testing.assert_allclose(square.volume, 4 * 7 * (0.25 + 0.1 + 0.04) / 3, rtol=1e-12)


def test_two_crossing_struts_share_a_steinmetz_solid():
    """Four half cylinders and their joint: two cylinders less 16 r³/3 (Archimedes).

    24 sides within 2 % of what is shared; capsules at the ends are those of lone struts.
    """
    r, L = 1.0, 6.0
    joints = np.concatenate(
        [np.zeros((1, 3)), L * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])]
    )
    cross = structure(joints, [[0, k] for k in range(1, 5)], r)
    through = structure(joints[[2, 1]], [[0, 1]], r)
    crossed, single = (
        lattice_solid(each, tolerance_mm=0.005, segments=24).surface.volume
        for each in (cross, through)
    )
    np.testing.assert_allclose(2 * single - crossed, 16 / 3 * r**3, rtol=0.02)


@pytest.mark.parametrize("section", ["round", "square"])
@pytest.mark.parametrize("fillet", [0.0, 0.2])
def test_an_octet_has_the_genus_of_its_graph_and_survives_float32(section, fillet):
    lattice = octet(2, 5.0, 0.3, section)
    solid = lattice_solid(lattice, tolerance_mm=0.05, fillet_mm=fillet)
    assert_sound(solid.surface, lattice)
    mesh, displaced = printable_mesh(solid.surface)
    assert_sound(mesh, lattice, points=20)
    assert displaced < 1e-5


def test_twice_the_same_lattice_gives_the_same_numbers():
    lattice = jittered(octet(1, 5.0, 0.4), 0.3, seed=2)
    for fillet in (0.0, 0.1):
        first, second = (
            lattice_solid(lattice, tolerance_mm=0.05, fillet_mm=fillet).surface for _ in range(2)
        )
        np.testing.assert_array_equal(first.vertices, second.vertices)
        np.testing.assert_array_equal(first.faces, second.faces)


def test_struts_in_another_order_give_the_same_surface():
    """Vertex for vertex, numbered otherwise."""
    lattice = jittered(octet(1, 5.0, 0.4), 0.3, seed=2)
    order = np.random.default_rng(0).permutation(len(lattice.struts))
    other = structure(lattice.joints, lattice.struts[order], lattice.radii[order])
    one, two = (lattice_solid(each, tolerance_mm=0.05).surface for each in (lattice, other))
    assert len(one.vertices) == len(two.vertices) and len(one.faces) == len(two.faces)
    assert KDTree(one.vertices).query(two.vertices)[0].max() < 1e-9


@settings(max_examples=6, deadline=None, derandomize=True)
@given(
    st.integers(0, 10_000),
    st.floats(0.2, 0.6),
    st.sampled_from(["round", "square"]),
    st.sampled_from([0.0, 0.15]),
)
def test_random_radii_and_joints_give_one_valid_solid(seed, radius, section, fillet):
    lattice = jittered(octet(1, 8.0, radius, section), 0.5, seed)
    solid = lattice_solid(lattice, tolerance_mm=0.05, fillet_mm=fillet)
    assert solid.clusters == 0
    assert_sound(solid.surface, lattice)


def test_what_is_reported_is_what_was_done():
    lattice = block("bcc", 2, slenderness=0.1)
    solid = lattice_solid(lattice, tolerance_mm=0.02)
    # Corners on any of 26 sides of the block, or within it, where they are like the cells' middles.
    assert solid.joint_types == 27
    assert solid.error_mm <= 0.05
    assert (solid.clusters, solid.clamped_fillets, solid.smallest_fillet_mm) == (0, 0, 0.0)
    finer = lattice_solid(lattice, tolerance_mm=0.005, segments=24)
    assert finer.error_mm < solid.error_mm


@given(st.floats(1e-4, 1.0), st.floats(0.05, 5.0))
def test_segments_keep_the_polygon_within_the_tolerance(tolerance, radius):
    n = segments_within(tolerance, radius)
    assert 8 <= n <= MAX_SEGMENTS
    outer = radius * (circumradius_of_equal_area(n) - 1)
    inner = radius * (1 - circumradius_of_equal_area(n) * np.cos(np.pi / n))
    assert n == MAX_SEGMENTS or max(outer, inner) <= tolerance


@pytest.mark.parametrize("segments", [3, 8, 17, 24])
def test_the_polygon_has_the_circles_area(segments):
    x, y = round_ring(segments).T
    area = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
    np.testing.assert_allclose(area, np.pi, rtol=1e-12)


@pytest.mark.parametrize("segments", [12, 16, 24])
def test_the_ball_has_the_volume_of_a_ball_and_copies_contain_their_reach(segments):
    ball = UnitBall(segments)
    np.testing.assert_allclose(ball.surface.volume, 4 / 3 * np.pi)
    (copy,) = balls(np.array([[1.0, 2, 3]]), np.array([0.7]), ball)
    heights = np.einsum("ij,ij->i", copy.vertices[copy.faces[:, 0]] - [1, 2, 3], copy.face_normals)
    assert heights.min() > 0.7
    assert heights.min() < 0.702


def test_impossible_lattices_are_refused_in_a_sentence():
    joints, one = [[0, 0, 0], [1, 0, 0]], [[0, 1]]
    with pytest.raises(LatticeError, match="no struts"):
        lattice_solid(structure(joints, np.zeros((0, 2)), np.zeros((0, 2))), tolerance_mm=0.1)
    with pytest.raises(LatticeError, match="radius 0 mm"):
        lattice_solid(structure(joints, one, 0.0), tolerance_mm=0.1)
    with pytest.raises(LatticeError, match="radius nan mm"):
        lattice_solid(structure(joints, one, np.nan), tolerance_mm=0.1)
    with pytest.raises(LatticeError, match="no length"):
        lattice_solid(structure([[0, 0, 0], [0, 0, 0]], one, 0.1), tolerance_mm=0.1)
