"""Walls trimmed to a part: cut at its silhouette, as deep as it is, the same along every axis."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt.box import Box
from texmap_opt.builtin_part import builtin_part
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.combine.boolean import difference, intersection
from texmap_opt.errors import LatticeError
from texmap_opt.part import Part
from texmap_opt.solid.lattice_solid import lattice_solid
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.structure import Extrusion, Structure
from texmap_opt.structure.tile import tile
from texmap_opt.structure.trim import Trimmed, trim
from texmap_opt.warp.grid import Grid

RADIUS = 0.2
AXES = {"x": 0, "y": 1, "z": 2}


def block(low, high) -> TriMesh:
    size = dict(zip(("length_mm", "width_mm", "height_mm"), np.subtract(high, low), strict=True))
    part = builtin_part("cantilever", {name: float(length) for name, length in size.items()})
    return TriMesh(part.vertices + np.array(low, float), part.faces)


def walls(part: TriMesh, cell: str, cells: tuple[int, int], extrusion: str) -> Structure:
    box = Box.around(part.vertices, np.eye(3), extrusion=extrusion)
    grid = Grid.around(box, cells, margin_cells=1, radius_mm=RADIUS)
    net = map_structure(tile(unit_cell(cell), grid.cells), grid.positions, RADIUS)
    beyond = np.array([-0.1, 0.1])
    return net.extruded(box.axes[2], box.bounds[:, 2] + beyond)


def trimmed(part: TriMesh, cell="square", cells=(5, 4), extrusion="z", skin_mm=0.0) -> Trimmed:
    return trim(walls(part, cell, cells, extrusion), Part(part, "part"), skin_mm=skin_mm)


def extrusion_of(structure: Structure) -> Extrusion:
    assert structure.extrusion is not None
    return structure.extrusion


def test_a_block_keeps_its_own_cells_whole():
    """5 x 4 square cells of a block: 6 x 4 + 5 x 5 walls; those in its sides are half inside."""
    result = trimmed(block([0, 0, 0], [10, 8, 3]))
    structure = result.structure
    assert (len(structure.struts), len(structure.joints)) == (49, 30)
    depth = extrusion_of(structure).depth
    middle = structure.joints[structure.struts].mean(axis=1)
    side = np.isclose(middle % [10, 8, 99], 0).any(axis=1)
    np.testing.assert_allclose(depth, np.where(side, 1.5, 3.0), rtol=1e-9)
    assert structure.cut.sum() == 18


def test_depth_times_plane_area_is_the_volume_inside_the_part():
    """Square walls in a wedge: each as deep as the wedge is in its middle."""
    wedge = block([0, 0, 0], [10, 8, 3])
    top = np.isclose(wedge.vertices[:, 2], 3)
    wedge.vertices[top, 2] += 0.3 * wedge.vertices[top, 0]
    structure = trimmed(wedge, cells=(5, 4)).structure
    inside = intersection(lattice_solid(structure, tolerance_mm=0.01).surface, wedge).volume
    # By hand: the wedge less 20 openings of (2 - 2 r)², depth 3 + 0.3 x at their middles.
    x = 2 * np.arange(5) + 1
    openings = 4 * (2 - 2 * RADIUS) ** 2 * (3 + 0.3 * x).sum()
    assert inside == pytest.approx(wedge.volume - openings, rel=1e-7)
    depth = extrusion_of(structure).depth
    middle = structure.joints[structure.struts].mean(axis=1)
    half = np.isclose(middle[:, 0] % 10, 0) | np.isclose(middle[:, 1] % 8, 0)
    expected = (3 + 0.3 * middle[:, 0]) * np.where(half, 0.5, 1)
    # Half of a wall in the sides at x = 0 and 10 is seen 1e-5 of the diagonal inside.
    np.testing.assert_allclose(depth, expected, rtol=2e-5)


def test_walls_are_cut_at_a_hole_through_the_part_and_cross_a_blind_one():
    plate = block([0, 0, 0], [10, 8, 3])
    through = difference(plate, block([3.3, 3.3, -1], [4.7, 4.7, 4]))
    blind = difference(plate, block([3.3, 3.3, 1], [4.7, 4.7, 4]))
    whole, holed, dented = (
        trimmed(part, skin_mm=0.1).structure for part in (plate, through, blind)
    )
    assert holed.cut.sum() == whole.cut.sum() + 4
    assert len(dented.struts) == len(whole.struts)
    # Of the four walls at the joint in the middle of the dent 0.7 of 2 mm are 1 mm deep.
    at = np.linalg.norm(dented.joints[:, :2] - [4, 4], axis=1) < 1e-9
    depth = extrusion_of(dented).depth[at[dented.struts].any(axis=1)]
    # Six Gauss points see a step to a twelfth of the wall or so.
    np.testing.assert_allclose(depth, 3 - 2 * 0.35, atol=2 * 0.1)


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 1000), st.sampled_from(["octagon", "re-entrant"]))
def test_the_axis_of_extrusion_makes_no_difference(seed: int, cell: str):
    """Part and axis turned together by x to y to z: joints, struts, depths and cuts turn with them."""
    rng = np.random.default_rng(seed)
    part = block([0, 0, 0], rng.uniform(5, 10, 3))
    part = difference(part, block([2, 1, -1], [3.1, 2.3, 20]))
    part.vertices[:, 2] *= 1 + 0.05 * part.vertices[:, 0]
    results = {}
    for axis, shift in {"z": 0, "x": 1, "y": 2}.items():
        turned = TriMesh(np.roll(part.vertices, shift, axis=1), part.faces)
        results[axis] = trimmed(turned, cell, extrusion=axis).structure
    straight = results.pop("z")
    for axis, structure in results.items():
        shift = AXES[axis] + 1
        np.testing.assert_allclose(
            np.roll(structure.joints, -shift, axis=1), straight.joints, atol=1e-9
        )
        np.testing.assert_array_equal(structure.struts, straight.struts)
        np.testing.assert_array_equal(structure.cut, straight.cut)
        np.testing.assert_allclose(
            extrusion_of(structure).depth, extrusion_of(straight).depth, rtol=1e-6
        )


def test_a_skin_along_the_silhouette_holds_ends_that_are_loose_without_it():
    """Octagons cut at the sides of a block end in single walls there."""
    part = block([0, 0, 0], [10, 8, 3])
    net = walls(part, "octagon", (5, 4), "z")
    shifted = TriMesh(part.vertices + np.array([0.9, 0.7, 0.0]), part.faces)
    bare = trim(net, Part(shifted, "part"), skin_mm=0.0)
    skinned = trim(net, Part(shifted, "part"), skin_mm=0.3)
    assert bare.counts.loose_struts > 0
    assert skinned.counts.loose_struts == 0
    assert not bare.in_skin.any()
    np.testing.assert_array_equal(skinned.structure.cut & ~skinned.in_skin, False)


def test_walls_in_a_sharp_edge_are_left_out():
    """A blade that tapers to nothing: the wall along its edge has no depth."""
    blade = block([0, 0, 0], [10, 8, 3])
    top = np.isclose(blade.vertices[:, 2], 3)
    blade.vertices[top, 2] = 0.3 * blade.vertices[top, 0] + 1e-6
    result = trimmed(blade)
    depth = extrusion_of(result.structure).depth
    assert depth.min() > 1e-3 * 3
    assert result.counts.slivers == 4
    assert (
        not np.isclose(result.structure.joints[:, 0], 0)[result.structure.struts].all(axis=1).any()
    )


def test_walls_beside_the_part_are_refused_with_the_size_of_the_part():
    """Not that of the prism over its shadow."""
    part = block([0, 0, 0], [10, 8, 3])
    net = walls(part, "square", (5, 4), "z")
    beside = TriMesh(part.vertices + np.array([50.0, 0, 0]), part.faces)
    with pytest.raises(LatticeError, match=r"inside the part \(10 x 8 x 3 mm\)"):
        trim(net, Part(beside, "part"), skin_mm=0.0)


def test_origin_and_depth_follow_the_pieces_of_a_wall():
    part = block([0, 0, 0], [10, 8, 3])
    structure = trimmed(difference(part, block([3.3, -1, -1], [3.7, 7, 4])), cells=(5, 4)).structure
    assert structure.origin is not None
    assert len(structure.origin.cell) == len(structure.struts) == len(extrusion_of(structure).depth)
    structure.validate()
