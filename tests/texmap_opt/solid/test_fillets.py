"""Fillets of the meshed surface against circles and against the closing by a ball."""

import numpy as np
import pytest
from exact_union import Star, closing_reach, named_stars
from lattices import block, octet, structure
from sound_solid import assert_sound

from texmap_opt.solid.lattice_solid import lattice_solid
from texmap_opt.solid.tri_mesh import TriMesh

# Corners of 24 sides stand out by 0.6 % of the radius, and facets lie within by 0.9 %.
SEGMENTS = 24


def section(surface: TriMesh, height: float) -> np.ndarray:
    """Where edges cross the plane z = height; its points there."""
    ends = np.concatenate([surface.faces[:, [k, (k + 1) % 3]] for k in range(3)])
    a, b = surface.vertices[ends[:, 0]], surface.vertices[ends[:, 1]]
    crossing = (a[:, 2] < height) & (b[:, 2] >= height)
    a, b = a[crossing], b[crossing]
    share = (height - a[:, 2]) / (b[:, 2] - a[:, 2])
    return (a + share[:, None] * (b - a))[:, :2]


def fitted_circle(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and radius by least squares in |p|² = 2 c . p + r² - |c|² (Kåsa 1976)."""
    system = np.column_stack([2 * points, np.ones(len(points))])
    x, y, k = np.linalg.lstsq(system, (points**2).sum(axis=1), rcond=None)[0]
    return np.array([x, y]), float(np.sqrt(k + x * x + y * y))


@pytest.mark.parametrize(
    ("degrees", "fillet"), [(60, 0.2), (60, 0.3), (90, 0.3), (90, 0.5), (130, 0.5)]
)
def test_in_the_plane_of_two_struts_the_fillet_is_an_arc_of_its_radius(degrees, fillet):
    """A circle fitted to the section: radius and centre within 5 % of the fillet's radius."""
    theta, r = np.deg2rad(degrees), 0.5
    axes = [[1.0, 0, 0], [np.cos(theta), np.sin(theta), 0]]
    star = Star.of_equal(axes, length=12.0, radius=r)
    solid = lattice_solid(
        star.structure(), tolerance_mm=0.005 * fillet, segments=SEGMENTS, fillet_mm=fillet
    )
    assert solid.clamped_fillets == 0
    points = section(solid.surface, 1e-3)
    middle = np.array([np.cos(theta / 2), np.sin(theta / 2)])
    # The arc ends where the ball touches the struts, (r + rho)/tan(theta/2) along them; its inner
    # two thirds are looked at.
    centre = (r + fillet) / np.sin(theta / 2) * middle
    seen = (points - centre) / np.linalg.norm(points - centre, axis=1)[:, None]
    arc = points[
        (seen @ -middle > np.cos((np.pi - theta) / 3))
        & (np.linalg.norm(points - centre, axis=1) < 1.5 * fillet)
    ]
    assert len(arc) > 4
    found, radius = fitted_circle(arc)
    assert abs(radius / fillet - 1) < 0.05
    assert np.linalg.norm(found - centre) < 0.05 * fillet


def departures(star: Star, solid: TriMesh, fillet: float) -> np.ndarray:
    """How far the surface about the joint is from the closing, in radii of the fillet.

    Middles of triangles and vertices, out to a little beyond where balls rest.
    """
    points = np.concatenate([solid.vertices, solid.vertices[solid.faces].mean(axis=1)])
    size = np.linalg.norm(points, axis=1)
    direction = points / size[:, None]
    # Inside of 12 degrees from an axis the surface is the strut's own.
    away = (direction @ star.axes.T).max(axis=1) < np.cos(np.deg2rad(12))
    chosen = np.flatnonzero(away & (size < 0.4 * star.lengths.min()))
    chosen = np.random.default_rng(0).choice(chosen, 80, replace=False)
    reach, cosine = closing_reach(star, fillet, direction[chosen])
    return (size[chosen] - reach) * cosine / fillet


@pytest.mark.parametrize("name", named_stars())
def test_filleted_joints_are_closings_by_a_ball(name):
    """Largest distance below 5 % of the fillet's radius; without fillets far more."""
    star = named_stars()[name]
    # Two struts of the uneven joint are too near to each other for more.
    fillet = 0.2 if name == "uneven" else 0.3
    plain, filleted = (
        lattice_solid(star.structure(), tolerance_mm=0.005, segments=SEGMENTS, fillet_mm=radius)
        for radius in (0.0, fillet)
    )
    assert filleted.clamped_fillets == 0
    assert np.abs(departures(star, filleted.surface, fillet)).max() < 0.05
    assert np.abs(departures(star, plain.surface, fillet)).max() > 0.15
    # The control: fillets too small by four tenths.
    small = lattice_solid(
        star.structure(), tolerance_mm=0.005, segments=SEGMENTS, fillet_mm=0.6 * fillet
    )
    assert np.abs(departures(star, small.surface, fillet)).max() > 0.05


def test_fillets_add_volume_and_keep_the_topology():
    lattice = octet(1, 5.0, 0.3)
    volumes = []
    for fillet in (0.0, 0.1, 0.25):
        solid = lattice_solid(lattice, tolerance_mm=0.02, fillet_mm=fillet)
        assert_sound(solid.surface, lattice)
        assert solid.smallest_fillet_mm == fillet and solid.clamped_fillets == 0
        volumes.append(solid.surface.volume)
    assert volumes == sorted(volumes) and volumes[2] > 1.02 * volumes[0]


def test_fillets_without_room_are_smaller_and_counted():
    """Kelvin cells with fillets as wide as their struts are long."""
    lattice = block("tetrakaidecahedron", 1, slenderness=0.1)
    length = float(lattice.lengths().min())
    solid = lattice_solid(lattice, tolerance_mm=0.02, fillet_mm=length)
    assert_sound(solid.surface, lattice)
    inner = np.bincount(lattice.struts.ravel()) > 1
    assert solid.clamped_fillets == inner.sum()
    assert 0 < solid.smallest_fillet_mm < length
    (note,) = solid.notes(length)
    assert "no room" in note and f"{solid.smallest_fillet_mm:.3g}" in note


def test_fillets_keep_off_a_strut_that_passes_by():
    """Two struts 0.3 mm apart: fillets at their joints stay below half the gap, or are none."""
    joints = [[0, 0, 0], [9, 0, 0], [9, 5, 0], [1.5, -4, 1.1], [1.5, 4, 1.1], [6, 4, 1.1]]
    lattice = structure(joints, [[0, 1], [1, 2], [3, 4], [4, 5]], 0.4)
    solid = lattice_solid(lattice, tolerance_mm=0.01, segments=SEGMENTS, fillet_mm=1.0)
    assert_sound(solid.surface, lattice)
    assert solid.clusters == 0
    assert solid.smallest_fillet_mm < 0.16
