"""Divided surfaces of joints: within their tolerance, and still one layer over all directions."""

import numpy as np
import pytest
from exact_union import Star, named_stars, random_star, sphere_points
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from texmap_opt.solid.joint_patches import JointPatches
from texmap_opt.solid.lattice_mesh import Meshed, joint_surfaces
from texmap_opt.solid.strut_ends import StrutEnds
from texmap_opt.solid.struts import round_ring

SIDES = 24
CUBE = np.concatenate([np.eye(3), -np.eye(3)])
seeds = st.integers(0, 2**20)


def meshed(star: Star, tolerance: float, fillet: float = 0.0) -> Meshed:
    ends = StrutEnds.of(star.structure(), round_ring(SIDES))
    ends = ends.filleted(np.where(ends.valence > 1, fillet, 0.0))
    (surface,) = joint_surfaces(ends, np.array([0]), tolerance=tolerance)
    return surface


def distances(star: Star, patches: JointPatches, faces: np.ndarray) -> np.ndarray:
    """How far points of triangles are from the exact union, along their directions [mm]."""
    weights = np.random.default_rng(0).dirichlet(np.ones(3), len(faces))
    points = np.einsum("fk,fkd->fd", weights, patches.offset[faces])
    size = np.linalg.norm(points, axis=1)
    k = np.linalg.norm(round_ring(SIDES)[0])
    thick = Star(star.axes, star.lengths, k * star.radii)
    return np.abs(size - thick.reach(points / size[:, None]))


@pytest.mark.parametrize("tolerance", [0.05, 0.02])
def test_triangles_lie_within_the_tolerance_of_the_union(tolerance):
    """A joint of a cubic lattice: the exact union is at most the tolerance away.

    Measured along directions from the joint, which meet this surface at 45 degrees or more.
    """
    star = Star.of_equal(CUBE, length=10.0, radius=0.5)
    surface = meshed(star, tolerance)
    faces = surface.patches.faces
    assert surface.error_mm <= tolerance
    assert distances(star, surface.patches, faces).max() < np.sqrt(2) * 1.1 * tolerance
    # The control: undivided triangles cut across the crotches.
    coarse = meshed(star, 10.0)
    assert distances(star, coarse.patches, coarse.patches.faces).max() > 1.5 * tolerance


def test_a_finer_tolerance_has_more_triangles_and_a_coarse_one_those_of_the_hull():
    star = Star.of_equal(CUBE, length=10.0, radius=0.5)
    counts = [len(meshed(star, tolerance).patches.faces) for tolerance in (10.0, 0.05, 0.01)]
    assert counts[0] == 2 * (6 * SIDES - 2) - 6 * (SIDES - 2)
    assert counts[0] < counts[1] < counts[2]


@settings(max_examples=12, deadline=None, derandomize=True)
@given(seeds)
def test_division_keeps_one_layer_over_all_directions(seed):
    """Every direction outside the rings lies in one triangle: the surface cannot cross itself."""
    star = random_star(seed)
    assert_one_layer(star, meshed(star, 0.05).patches)


@pytest.mark.parametrize("name", named_stars())
def test_division_keeps_one_layer_with_fillets(name):
    star = named_stars()[name]
    assert_one_layer(star, meshed(star, 0.02, 0.2).patches)


def assert_one_layer(star: Star, patches: JointPatches) -> None:
    a, b, c = np.moveaxis(patches.direction[patches.faces], 1, 0)
    assert (np.einsum("ij,ij->i", a, np.cross(b, c)) > 0).all()
    directions = sphere_points(150)
    sides = [np.cross(x, y) @ directions.T > 0 for x, y in ((a, b), (b, c), (c, a))]
    count = (sides[0] & sides[1] & sides[2]).sum(axis=0)
    assert count.max() == 1
    # What is not covered is inside rings: no farther from an axis than their corners.
    on_ring = patches.corner >= 0
    ring = patches.corner[on_ring] // SIDES
    ends = StrutEnds.of(star.structure(), round_ring(SIDES))
    axes = ends.axis[ends.joint == 0]  # in the order of the rings
    widest = np.zeros(len(axes))
    np.maximum.at(widest, ring, np.arccos((patches.direction[on_ring] * axes[ring]).sum(axis=1)))
    from_axis = np.arccos(np.clip(directions[count == 0] @ axes.T, -1, 1))
    assert (from_axis <= widest + 1e-6).any(axis=1).all()


@settings(max_examples=12, deadline=None, derandomize=True)
@given(seeds)
def test_sides_of_rings_stay_whole(seed):
    """The strut's quadrilaterals end there: each side once, with no vertex between its corners."""
    star = random_star(seed)
    assume(len(star.axes) > 1)
    patches = meshed(star, 0.02).patches
    ends = np.stack([patches.faces, np.roll(patches.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    reverse = {(int(b), int(a)) for a, b in ends}
    border = np.array([edge for edge in ends.tolist() if tuple(edge) not in reverse])
    corner = patches.corner[border]
    assert len(border) == len(star.axes) * SIDES
    assert (corner >= 0).all()
    step = (corner[:, 0] - corner[:, 1]) % SIDES
    np.testing.assert_array_equal(corner[:, 0] // SIDES, corner[:, 1] // SIDES)
    np.testing.assert_array_equal(step, 1)


def test_new_vertices_lie_on_the_union():
    star = Star.of_equal(CUBE, length=10.0, radius=0.5)
    patches = meshed(star, 0.02).patches
    between = patches.corner < 0
    assert between.sum() > 50
    k = np.linalg.norm(round_ring(SIDES)[0])
    thick = Star(star.axes, star.lengths, k * star.radii)
    expected = thick.reach(patches.direction[between])
    np.testing.assert_allclose(patches.distance[between], expected, rtol=1e-9)
