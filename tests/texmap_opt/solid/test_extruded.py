"""Walls as a solid, against closed forms of their area in the plane and the topology of their graph."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from texmap_opt.builtin_part import builtin_part
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.combine.boolean import intersection
from texmap_opt.solid.float32_solid import printable_mesh
from texmap_opt.solid.lattice_solid import lattice_solid
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.solid.validity import validity
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.tile import tile

EDGE, DEPTH = 5.0, 3.0


def wall_net(
    cell: str, cells: int, radius: float, axis: np.ndarray | None = None, warp: float = 0.0
) -> Structure:
    """A block of square cells in the plane normal to an axis, z by default."""
    ticks = EDGE * np.arange(cells + 1)
    nodes = np.stack(
        [*np.meshgrid(ticks, ticks, indexing="ij"), np.full((cells + 1,) * 2, 0.0)], -1
    )
    nodes[..., :2] += warp * np.sin(nodes[..., 1::-1])
    flat = map_structure(tile(unit_cell(cell), (cells, cells)), nodes, radius)
    heights = np.array([-DEPTH / 2, DEPTH / 2])
    if axis is None:
        return flat.extruded(np.array([0.0, 0.0, 1.0]), heights)
    turn = Rotation.align_vectors(axis[None], [[0.0, 0.0, 1.0]])[0].as_matrix()
    turned = Structure(
        flat.joints @ turn.T, flat.struts, flat.radii, flat.cut, flat.cell_size, flat.section
    )
    return turned.extruded(turn[:, 2].copy(), heights)


def slab(low: float, high: float) -> TriMesh:
    """A square of cells, as thick as the walls are deep."""
    length = high - low
    part = builtin_part("cantilever", {"length_mm": length, "width_mm": length, "height_mm": DEPTH})
    return TriMesh(part.vertices + np.array([low, low, -DEPTH / 2]), part.faces)


def test_square_cells_leave_square_openings():
    """Of n² cells of edge L each leaves an opening of (L - 2 r)²; discs lie inside the crossings."""
    n, r = 4, 0.4
    solid = lattice_solid(wall_net("square", n, r), tolerance_mm=0.01).surface
    inside = intersection(solid, slab(0.0, n * EDGE)).volume
    openings = (n * (EDGE - 2 * r)) ** 2
    # Outlines lie on a grid of 1e-8 mm.
    assert inside == pytest.approx(DEPTH * ((n * EDGE) ** 2 - openings), rel=1e-7)


def test_octagons_have_the_area_of_walls_less_what_meets_at_joints():
    """Six walls 2 r thick and four joints a cell; two half walls at an angle phi share r² cot(phi/2).

    From the joint to where their inner sides cross is r cot(phi/2); angles are 135, 135 and 90
    degrees, so every direction from the joint is covered beyond r and the joint's disc adds nothing.
    """
    n, r = 3, 0.2
    solid = lattice_solid(wall_net("octagon", n + 2, r), tolerance_mm=0.01).surface
    inside = intersection(solid, slab(EDGE, (n + 1) * EDGE)).volume
    side = (np.sqrt(2) - 1) * EDGE
    shared = r**2 * (2 / np.tan(np.radians(67.5)) + 1)
    area = n**2 * (6 * 2 * r * side - 4 * shared)
    # Coordinates in the file of the cell have 15 digits, outlines a grid of 1e-8 mm.
    assert inside == pytest.approx(DEPTH * area, rel=1e-7)


@pytest.mark.parametrize("cell", ["octagon", "honeycomb", "kagome"])
def test_the_solid_has_as_many_holes_as_the_net_has_loops(cell: str):
    """Genus = E - V + C of a plane graph whose walls do not touch elsewhere."""
    net = wall_net(cell, 3, 0.15, warp=0.3)
    report = validity(lattice_solid(net, tolerance_mm=0.05).surface)
    loops = len(net.struts) - len(net.joints) + 1
    assert report.printable
    assert (report.genus, report.connected_components) == (loops, 1)


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 1000))
def test_the_axis_of_extrusion_changes_nothing_but_the_place(seed: int):
    """Volume and heights along any axis; and STL's single precision does not tear it."""
    axis = np.random.default_rng(seed).normal(size=3)
    axis /= np.linalg.norm(axis)
    straight = lattice_solid(wall_net("octagon", 2, 0.3, warp=0.3), tolerance_mm=0.05).surface
    solid = lattice_solid(wall_net("octagon", 2, 0.3, axis, warp=0.3), tolerance_mm=0.05).surface
    # Polygons for discs have their corners elsewhere: circumradius over radius - 1 of few joints.
    assert solid.volume == pytest.approx(straight.volume, rel=2e-3)
    height = solid.vertices @ axis
    np.testing.assert_allclose(np.abs(height), DEPTH / 2, atol=1e-9)
    assert validity(printable_mesh(solid)[0]).printable


def test_a_tapered_wall_is_a_trapezoid_between_the_discs_of_its_ends():
    """L (a + b), and the half discs beyond its ends."""
    a, b, length = 0.5, 1.0, 8.0
    joints = np.array([[0.0, 0, 0], [length, 0, 0]])
    wall = Structure(
        joints, np.array([[0, 1]]), np.array([[a, b]]), np.zeros(2, bool), np.ones(1)
    ).extruded(np.array([0.0, 0.0, 1.0]), np.array([0.0, DEPTH]))
    solid = lattice_solid(wall, tolerance_mm=1e-6).surface
    area = length * (a + b) + np.pi * (a**2 + b**2) / 2
    # At t from its end the trapezoid is (b - a) t/L narrower, the larger disc t²/(2 b): on either side
    # that leaves 2 b² (b - a)³/(3 L³) = 1.6e-4 mm² of the disc outside.
    assert solid.volume == pytest.approx(DEPTH * area, rel=5e-5)


def corner(radius: float) -> Structure:
    """Two walls at a right angle."""
    joints = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0]])
    struts = np.array([[0, 1], [0, 2]])
    flat = Structure(joints, struts, np.full((2, 2), radius), np.zeros(3, bool), np.ones(2))
    return flat.extruded(np.array([0.0, 0.0, 1.0]), np.array([0.0, DEPTH]))


@pytest.mark.parametrize("fillet", [0.3, 1.0, 2.5])
def test_a_hollow_right_angle_gets_a_fillet_of_one_minus_a_quarter_of_pi(fillet: float):
    """A square of the fillet's radius less a quarter of its circle; ends and outside stay."""
    plain = lattice_solid(corner(0.5), tolerance_mm=0.001, segments=24).surface
    solid = lattice_solid(corner(0.5), tolerance_mm=0.001, segments=24, fillet_mm=fillet).surface
    added = (solid.volume - plain.volume) / DEPTH
    # The arc is a polygon of up to 24 sides a circle whose corners lie on it, which fills
    # pi/4 - sin(2 pi/24) 24/8 = 0.009 of the radius squared more, of 0.215: 4 %. Grown and
    # shrunk by such polygons, rounds at the walls' ends move by less than a hundredth of that.
    assert added == pytest.approx((1 - np.pi / 4) * fillet**2, rel=0.05)
    assert validity(printable_mesh(solid)[0]).printable


def test_fillets_keep_the_loops_of_a_warped_net():
    net = wall_net("honeycomb", 3, 0.15, warp=0.3)
    report = validity(lattice_solid(net, tolerance_mm=0.05, fillet_mm=0.2).surface)
    assert report.printable, report.faults
    assert report.genus == len(net.struts) - len(net.joints) + 1


def test_fillets_wider_than_the_openings_fill_them():
    """Squares of 5 mm between walls 0.8 mm thick have room for a ball of 2.1 mm, not of 2.2 mm."""
    net = wall_net("square", 2, 0.4)
    open_, full = (
        validity(lattice_solid(net, tolerance_mm=0.01, fillet_mm=fillet).surface).genus
        for fillet in (2.05, 2.2)
    )
    assert (open_, full) == (4, 0)
