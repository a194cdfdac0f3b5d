"""Volume of walls that overlap at their joints, against exact outlines in the plane."""

from dataclasses import replace
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from texmap_opt.combine.boolean import outline_union
from texmap_opt.structure.directions import circle_quadrature
from texmap_opt.structure.plane_axes import plane_axes
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.volume import LatticeVolume, lattice_volume, uniform_radius

DEPTH = 3.0
Z = np.array([0.0, 0.0, 1.0])


def walls(points, struts, radii, *, cut=None, axes=None) -> Structure:
    """Walls of the given depth on points of the plane."""
    struts, axes = np.asarray(struts), np.eye(3) if axes is None else axes
    flat = np.column_stack([points, np.full(len(points), DEPTH / 2)])
    return Structure(
        joints=flat @ axes,
        struts=struts,
        radii=np.broadcast_to(np.asarray(radii, float), struts.shape).copy(),
        cut=np.zeros(len(points), bool) if cut is None else np.asarray(cut),
        cell_size=np.ones(len(struts)),
    ).extruded(axes[2], np.array([0.0, DEPTH]))


def net(unit, edges, period, copies=3):
    """Points and struts of a tiled cell: neighbours as (point, point, shift) in the period's steps."""
    number, points, struts = {}, [], []

    def index(k, at):
        key = (k, *at)
        if key not in number:
            number[key] = len(points)
            points.append(np.array(unit[k]) + np.array(at) @ np.array(period))
        return number[key]

    for at in product(range(copies), repeat=2):
        for a, b, shift in edges:
            struts.append((index(a, at), index(b, tuple(np.add(at, shift)))))
    return np.array(points), struts


HONEYCOMB = net(
    [(0, 0), (0, 1)],
    [(0, 1, (0, 0)), (1, 0, (0, 1)), (1, 0, (-1, 1))],
    [(np.sqrt(3), 0), (np.sqrt(3) / 2, 1.5)],
)
# Truncated square tiling 4.8.8, edge 1.
OCTAGONS = net(
    [(0.5**0.5, 0), (0, 0.5**0.5), (-(0.5**0.5), 0), (0, -(0.5**0.5))],
    [
        (0, 1, (0, 0)),
        (1, 2, (0, 0)),
        (2, 3, (0, 0)),
        (3, 0, (0, 0)),
        (0, 2, (1, 0)),
        (1, 3, (0, 1)),
    ],
    [(1 + 2**0.5, 0), (0, 1 + 2**0.5)],
)


def exact(of: Structure) -> float:
    """Area of the united trapezia and discs, times the depth."""
    plane = plane_axes(of.extrusion.axis)[:2]
    at = of.joints @ plane.T
    shapes = []
    for (i, j), (a, b) in zip(of.struts, of.radii, strict=True):
        along = at[j] - at[i]
        across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
        shapes.append(
            np.array(
                [at[i] - a * across, at[j] - b * across, at[j] + b * across, at[i] + a * across]
            )
        )
    # Polygons of the discs' own area.
    n = 720
    turn = 2 * np.pi * np.arange(n) / n
    fair = np.sqrt(2 * np.pi / n / np.sin(2 * np.pi / n))
    thickest = np.zeros(len(at))
    np.maximum.at(thickest, of.struts, of.radii)
    for centre, r in zip(at[~of.cut], thickest[~of.cut], strict=True):
        shapes.append(centre + fair * r * np.column_stack([np.cos(turn), np.sin(turn)]))
    area = 0.0
    for polygon in outline_union(shapes):
        x, y = polygon.T
        area += float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    return DEPTH * area


@pytest.mark.parametrize(("points", "struts"), [HONEYCOMB, OCTAGONS], ids=["honeycomb", "octagon"])
@pytest.mark.parametrize("radius", [0.02, 0.08, 0.15])
def test_volume_is_that_of_the_united_walls(points, struts, radius):
    of = walls(points, struts, radius)
    # 432 directions: a ten-thousandth of the volume at these thicknesses.
    np.testing.assert_allclose(lattice_volume(of), exact(of), rtol=1e-4)
    # Negative control: the walls' own volumes are off by far more.
    own = float(LatticeVolume.of(of).strut_volumes(of.joints, of.radii).sum())
    assert abs(own / exact(of) - 1) > 3e-3


@settings(max_examples=10, derandomize=True, deadline=None)
@given(st.integers(0, 10_000))
def test_volume_of_a_random_plane_frame_of_unlike_walls_is_exact(seed):
    """Delaunay edges, thin enough that no overlap reaches beyond the half of a wall."""
    rng = np.random.default_rng(seed)
    points = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0)), axis=-1).reshape(-1, 2)
    inner = ((points > 0) & (points < 3)).all(axis=1)
    points[inner] += rng.uniform(-0.2, 0.2, (int(inner.sum()), 2))
    triangles = Delaunay(points).simplices
    edges = np.sort(np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]))
    edges = np.unique(edges, axis=0)
    of = walls(points, edges, rng.uniform(0.01, 0.03, (len(edges), 1)))
    # Discs are blended from struts of like radius, hence a thousandth and no better.
    np.testing.assert_allclose(lattice_volume(of), exact(of), rtol=1e-3)


def test_one_wall_is_a_slab_with_round_ends_and_a_cut_one_has_none():
    points = np.array([[0, 0], [3, 4.0]])
    r = 0.4
    round_ended = walls(points, [(0, 1)], r)
    np.testing.assert_allclose(
        lattice_volume(round_ended), DEPTH * (2 * r * 5 + np.pi * r**2), rtol=1e-12
    )
    cut = walls(points, [(0, 1)], r, cut=[True, True])
    np.testing.assert_allclose(lattice_volume(cut), DEPTH * 2 * r * 5, rtol=1e-12)
    tapered = cut.with_radii(np.array([[0.4, 0.2]]))
    np.testing.assert_allclose(lattice_volume(tapered), DEPTH * 0.6 * 5, rtol=1e-12)


def test_crossing_walls_overlap_in_a_square():
    points = np.array([[0, 0], [5, 0], [0, 5], [-5, 0], [0, -5.0]])
    of = walls(points, [(0, k) for k in range(1, 5)], 0.5, cut=[False, True, True, True, True])
    overlap = float(LatticeVolume.of(of).overlap(of.joints, of.radii))
    # Two walls through the joint share (2 r)²; the kinks in the diagonals lie between directions.
    np.testing.assert_allclose(overlap, DEPTH * 1.0, rtol=1e-4)


def test_an_overlap_is_as_deep_as_the_walls_of_its_joint_on_the_mean():
    points = np.array([[0, 0], [5, 0], [0, 5], [-5, 0], [0, -5.0]])
    of = walls(points, [(0, k) for k in range(1, 5)], 0.5, cut=[False, True, True, True, True])
    depth = np.array([1.0, 2.0, 3.0, 2.0])
    of = replace(of, extrusion=replace(of.extrusion, depth=depth))
    np.testing.assert_allclose(lattice_volume(of), depth.sum() * 5 - 2.0, rtol=1e-4)


@settings(max_examples=8, derandomize=True, deadline=None)
@given(st.tuples(*[st.floats(-3, 3)] * 3))
def test_volume_hardly_sees_how_the_plane_is_turned(turn):
    axes = Rotation.from_rotvec(turn).as_matrix()
    flat, turned = walls(*OCTAGONS, 0.1), walls(*OCTAGONS, 0.1, axes=axes)
    np.testing.assert_allclose(lattice_volume(turned), lattice_volume(flat), rtol=1e-4)


@pytest.mark.parametrize("m", [1, 3])
def test_directions_cover_the_circle_across_the_axis(m):
    axis = np.array([0.6, 0.0, 0.8])
    directions, angles = circle_quadrature(m, axis)
    np.testing.assert_allclose(angles.sum(), 2 * np.pi, rtol=1e-12)
    np.testing.assert_allclose(directions @ axis, 0, atol=1e-12)
    second = np.einsum("q,qi,qj->ij", angles, directions, directions)
    np.testing.assert_allclose(second, np.pi * (np.eye(3) - np.outer(axis, axis)), atol=1e-12)


@pytest.mark.parametrize("varied", ["joints", "radii"])
def test_volume_gradient_of_walls_has_a_second_order_taylor_remainder(varied):
    rng = np.random.default_rng(1)
    of = walls(*OCTAGONS, 0.1)
    # Away from equal radii, where the disc's radius (a maximum) has a kink.
    of = of.with_radii(of.radii * rng.uniform(0.8, 1.2, of.radii.shape))
    measure = LatticeVolume.of(of)
    at = {"joints": jnp.asarray(of.joints), "radii": jnp.asarray(of.radii)}
    v = rng.normal(size=at[varied].shape)
    if varied == "joints":
        v[:, 2] = 0
    slope = float(jnp.sum(jax.grad(lambda x: measure(**(at | {varied: x})))(at[varied]) * v))

    def rest(h: float) -> float:
        value = float(measure(**(at | {varied: at[varied] + h * v})))
        return abs(value - float(measure(**at)) - h * slope)

    # Steps so small that no direction changes its thickest wall.
    np.testing.assert_allclose(np.log2(rest(2e-6) / rest(1e-6)), 2, atol=0.2)


def test_the_uniform_thickness_gives_the_volume_asked_for():
    of = walls(*HONEYCOMB, 0.01)
    volume = lattice_volume(of.with_radii(np.full(of.struts.shape, 0.12)))
    np.testing.assert_allclose(uniform_radius(of, volume), 0.12, rtol=1e-8)
