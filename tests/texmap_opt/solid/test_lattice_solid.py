"""The lattice solid against closed forms and the topology of its graph."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from texmap_opt.combine.boolean import genus, union
from texmap_opt.errors import LatticeError
from texmap_opt.solid.float32_solid import printable_mesh
from texmap_opt.solid.joints import UnitBall, balls
from texmap_opt.solid.lattice_solid import lattice_solid
from texmap_opt.solid.struts import (
    MAX_SEGMENTS,
    circumradius_of_equal_area,
    lofts,
    round_ring,
    segments_within,
)
from texmap_opt.solid.validity import validity
from texmap_opt.structure.structure import Structure


def structure(joints, struts, radii, section="round") -> Structure:
    joints, struts = np.asarray(joints, dtype=float), np.asarray(struts, dtype=np.int64)
    radii = np.broadcast_to(np.asarray(radii, dtype=float), struts.shape).copy()
    return Structure(
        joints, struts, radii, np.zeros(len(joints), bool), np.ones(len(struts)), section
    )


def octet(cells: int, edge: float, radius: float) -> Structure:
    """Octet truss: face-centred cubic points, joined to their twelve neighbours."""
    corners = np.stack(np.meshgrid(*[np.arange(cells + 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    base = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]])
    points = (corners[:, None] + base).reshape(-1, 3)
    points = points[(points <= cells + 1e-9).all(axis=1)]
    struts = cKDTree(points).query_pairs(0.75, output_type="ndarray")
    return structure(points * edge, struts, radius)


def test_a_single_strut_has_the_volume_of_cylinder_and_end_balls():
    """Cylinder pi r² L plus two balls of the strut's radius that stand out by half.

    24 sides have the circle's area exactly; the balls are 2 % thicker than the strut (they contain
    its corners), which is 6 % of their volume.
    """
    r, L = 0.8, 12.0
    solid = lattice_solid(structure([[0, 0, 0], [3, 4, 0]], [[0, 1]], r), tolerance_mm=1e-6)
    assert solid.volume > np.pi * r**2 * 5
    long = lattice_solid(structure([[0, 0, 0], [0, L, 0]], [[0, 1]], r), tolerance_mm=1e-6)
    np.testing.assert_allclose(long.volume - solid.volume, np.pi * r**2 * (L - 5), rtol=1e-2)
    capsule = np.pi * r**2 * L + 4 / 3 * np.pi * r**3
    np.testing.assert_allclose(long.volume, capsule, rtol=0.01)


def test_a_tapered_strut_has_the_volume_of_a_frustum():
    """Volume pi L (a² + a b + b²)/3; every cross-section has the circle's area, so it is exact."""
    start, end = np.array([[0.0, 0, 0]]), np.array([[2.0, 3, 6]])
    (strut,) = lofts(start, end, np.array([[0.5, 0.2]]), round_ring(9), turned=True)
    np.testing.assert_allclose(strut.volume, np.pi * 7 * (0.25 + 0.1 + 0.04) / 3, rtol=1e-12)


def test_two_crossing_struts_meet_in_a_steinmetz_solid():
    """Two cylinders at right angles share 16 r³/3 (Archimedes); 24-gons within 1 %."""
    r = 1.0
    start, end = np.array([[-5.0, 0, 0], [0, -5, 0]]), np.array([[5.0, 0, 0], [0, 5, 0]])
    pieces = lofts(start, end, np.full((2, 2), r), round_ring(24), turned=True)
    shared = sum(piece.volume for piece in pieces) - union(pieces).volume
    np.testing.assert_allclose(shared, 16 / 3 * r**3, rtol=0.01)


def test_an_octet_has_the_genus_of_its_graph_and_survives_float32():
    lattice = octet(2, 5.0, 0.4)
    solid = lattice_solid(lattice, tolerance_mm=0.05)
    cycles = len(lattice.struts) - len(lattice.joints) + 1
    assert genus(solid) == cycles
    mesh, displaced = printable_mesh(solid)
    report = validity(mesh)
    assert report.printable, report.faults
    assert (report.genus, report.connected_components) == (cycles, 1)
    assert displaced < 1e-5


def test_twice_the_same_lattice_gives_the_same_numbers():
    first, second = (lattice_solid(octet(1, 5.0, 0.4), tolerance_mm=0.05) for _ in range(2))
    np.testing.assert_array_equal(first.vertices, second.vertices)
    np.testing.assert_array_equal(first.faces, second.faces)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.2, 0.9), st.sampled_from(["round", "square"]))
def test_random_radii_and_joints_give_one_valid_solid(seed, radius, section):
    rng = np.random.default_rng(seed)
    lattice = octet(1, 8.0, radius)
    joints = lattice.joints + rng.uniform(-0.5, 0.5, lattice.joints.shape)
    radii = radius * rng.uniform(0.5, 1.0, lattice.radii.shape)
    solid = lattice_solid(structure(joints, lattice.struts, radii, section), tolerance_mm=0.05)
    report = validity(printable_mesh(solid)[0])
    assert report.printable, report.faults
    assert report.connected_components == 1


@given(st.floats(1e-4, 1.0), st.floats(0.05, 5.0))
def test_segments_keep_the_polygon_within_the_tolerance(tolerance, radius):
    n = segments_within(tolerance, radius)
    assert 8 <= n <= MAX_SEGMENTS
    outer = radius * (circumradius_of_equal_area(n) - 1)
    inner = radius * (1 - circumradius_of_equal_area(n) * np.cos(np.pi / n))
    assert n == MAX_SEGMENTS or max(outer, inner) <= tolerance


@pytest.mark.parametrize("segments", [12, 16, 24])
def test_the_ball_has_the_volume_of_a_ball_and_copies_contain_their_reach(segments):
    ball = UnitBall(segments)
    np.testing.assert_allclose(ball.surface.volume, 4 / 3 * np.pi)
    (copy,) = balls(np.array([[1.0, 2, 3]]), np.array([0.7]), ball)
    heights = np.einsum("ij,ij->i", copy.vertices[copy.faces[:, 0]] - [1, 2, 3], copy.face_normals)
    assert heights.min() > 0.7
    assert heights.min() < 0.702


def test_impossible_lattices_are_refused_in_a_sentence():
    joints, strut = [[0, 0, 0], [1, 0, 0]], [[0, 1]]
    with pytest.raises(LatticeError, match="no struts"):
        lattice_solid(structure(joints, np.zeros((0, 2)), 1.0), tolerance_mm=0.1)
    with pytest.raises(LatticeError, match="radius 0 mm"):
        lattice_solid(structure(joints, strut, 0.0), tolerance_mm=0.1)
    with pytest.raises(LatticeError, match="no length"):
        lattice_solid(structure([[0, 0, 0], [0, 0, 0]], strut, 0.1), tolerance_mm=0.1)
