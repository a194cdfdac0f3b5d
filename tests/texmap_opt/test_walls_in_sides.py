"""Walls in the sides of a part and in the sides of cells: nothing of them counts twice or is missed."""

from dataclasses import replace

import numpy as np
import pytest

import fea
from fea import TetMesh
from fea.frame import solve_frame
from tests.texmap_opt.test_wall_skin import MATERIAL, SHEAR, SIZE, UP, case, compliance, solid
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.frame_model import FrameModel, frame_model
from texmap_opt.part import Part
from texmap_opt.sizing.sized import Strength
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.stress_field import stress_field
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.tile import tile
from texmap_opt.structure.trim import trim

PUSH = {
    "region": {"plane": {"point": [24, 0, 0], "normal": [1, 0, 0]}},
    "force_N": [-20.0, 0.0, 0.0],
}


def block() -> TetMesh:
    return TetMesh.box(SIZE, (12, 4, 3)).to_tet10()


def part_of(mesh: TetMesh) -> Part:
    return Part(TriMesh(mesh.nodes, mesh.boundary_facets[:, :3]), "block")


def tiled(cell: str, counts: tuple[int, int], radius: float, *, size=SIZE[:2]) -> Structure:
    """Cells over a rectangle from the origin, walls a little taller than the block."""
    x, y = (np.linspace(0, s, n + 1) for s, n in zip(size, counts, strict=True))
    nodes = np.stack(
        [*np.meshgrid(x, y, indexing="ij"), np.full((len(x), len(y)), SIZE[2] / 2)], -1
    )
    net = map_structure(tile(unit_cell(cell), counts), nodes, radius)
    return net.extruded(UP, np.array([-0.1, SIZE[2] + 0.1]))


def modelled(structure: Structure, *, skin_mm: float, load=SHEAR) -> FrameModel:
    mesh = block()
    part = part_of(mesh)
    inside = trim(structure, part, skin_mm=skin_mm).structure
    given = case(loads=[load], skin_mm=skin_mm)
    return frame_model(inside, part, given, stress_field(given, mesh))


def in_side(structure: Structure) -> np.ndarray:
    """Which walls lie in a side of the block."""
    ends = structure.joints[structure.struts][..., :2]
    return np.any(((ends == 0).all(axis=1)) | ((ends == np.array(SIZE[:2])).all(axis=1)), axis=1)


@pytest.mark.parametrize(("radius", "skin"), [(0.4, 0.1), (0.8, 0.5), (0.5, 0.6)])
def test_a_wall_in_a_side_under_a_skin_has_what_neither_rim_nor_plates_hold(radius, skin):
    """Half of it is in the part, r thick and b deep: (r - t)(b - 2 t) is left, none where t >= r."""
    model = modelled(tiled("square", (6, 2), radius), skin_mm=skin)
    walls = model.structure.extrusion
    assert walls is not None
    side = in_side(model.structure)
    np.testing.assert_allclose(walls.depth, np.where(side, 3.0, 6.0), rtol=1e-9)
    between = SIZE[2] - 2 * skin
    area = 2 * radius * np.asarray(model.parameters(model.structure.radii)["modulus"])
    expected = np.where(side, max(radius - skin, 0.0) * between, 2 * radius * between)
    # What is held altogether keeps a millionth.
    np.testing.assert_allclose(area, expected, rtol=1e-6, atol=2e-6 * 2 * radius * between)


def test_rim_plates_and_wall_in_a_side_are_together_what_is_inside_the_part():
    """Of a cross-section r b: rim t b, plates 2 t (r - t), and the wall between them."""
    radius, skin = 0.8, 0.5
    model = modelled(tiled("square", (6, 2), radius), skin_mm=skin)
    assert model.skin is not None
    side = np.flatnonzero(in_side(model.structure))
    wall = 2 * radius * np.asarray(model.parameters(model.structure.radii)["modulus"])[side]
    thickness = np.unique(np.round(model.skin.shell.thickness, 9))
    np.testing.assert_allclose(thickness, [2 * skin, SIZE[2]])
    plates, rim = thickness
    np.testing.assert_allclose(skin * rim + (radius - skin) * plates + wall, radius * SIZE[2])


def test_a_block_with_walls_thicker_than_its_skin_is_as_compliant_as_solid_tets():
    """Bent, within 3 %; with its side walls between the plates of half their depth 35 % too much."""
    radius, skin = 0.6, 0.2
    wanted = float(stress_field(case(skin_mm=skin), solid(radius, skin)).compliance.sum())
    model = modelled(tiled("square", (6, 2), radius), skin_mm=skin)
    assert compliance(model) == pytest.approx(wanted, rel=0.03)
    assert compliance(replace(model, inside=None)) > 1.3 * wanted


def test_a_wall_between_two_cells_is_one_of_whole_thickness():
    """Both cells list it; Euler's load is pi² E I/L² with I of the whole, not twice a half's."""
    model = modelled(tiled("square", (6, 2), 0.3), skin_mm=0.0)
    structure = model.structure
    shared = np.flatnonzero(~in_side(structure))
    keys = np.sort(structure.struts, axis=1)
    assert len(np.unique(keys, axis=0)) == len(keys)
    np.testing.assert_allclose(structure.radii[shared], 0.3)
    expected = np.pi**2 * MATERIAL.E * SIZE[2] * 0.6**3 / 12 / 4.0**2
    np.testing.assert_allclose(fea.euler_load(model.problem())[shared], expected, rtol=1e-9)


def test_half_a_wall_in_a_side_of_the_part_has_the_euler_load_of_its_half():
    """pi² E b r³/12/L²: half the thickness and the whole depth, a quarter of half the depth's."""
    radius = 0.3
    model = modelled(tiled("square", (6, 2), radius), skin_mm=0.0, load=PUSH)
    structure, solution = model.structure, solve_frame(model.problem())
    side = in_side(structure)
    strength = Strength.of(model, solution)
    force = np.einsum(
        "ij,ij->i",
        solution.end_forces[0, :, :3],
        np.diff(structure.joints[structure.struts], axis=1)[:, 0] / structure.lengths()[:, None],
    )
    squeezed = force > 1e-6
    assert (squeezed & side).any()
    assert (squeezed & ~side).any()
    thickness = np.where(side, radius, 2 * radius)
    expected = np.pi**2 * MATERIAL.E * SIZE[2] * thickness**3 / 12 / 4.0**2
    np.testing.assert_allclose(
        strength.euler_utilisation[squeezed], (force / expected)[squeezed], rtol=1e-6
    )


@pytest.mark.parametrize(
    ("cell", "length"),
    [("triangular", 1.0), ("re-entrant", 2 / 3 * 3**0.5), ("iso-material", 3**-0.5)],
)
def test_a_wall_that_the_side_of_a_cell_cuts_across_is_one_column(cell, length):
    """Its joint there joins two halves in line: one wall as long as both, a quarter of a half's load.

    Length in first edges of the cell; joints where no other wall begins.
    """
    edge = 4.0
    size = (4 * edge, 4 * edge * 3**0.5)
    structure = tiled(cell, (4, 4), 0.2, size=size)
    alone = (structure.degrees() == 2) & (
        (structure.joints[:, :2] > 0) & (structure.joints[:, :2] < size)
    ).all(axis=1)
    halves = np.flatnonzero(alone[structure.struts].any(axis=1))
    assert len(halves) >= 6
    n = len(structure.joints)
    fixed = np.tile([False, False, True, True, True, False], (n, 1))
    model = FrameModel(
        structure=structure,
        material=MATERIAL,
        case_names=("none",),
        fixed=fixed,
        value=np.zeros((n, 6)),
        surface_forces=np.zeros((1, n, 6)),
        acceleration=np.zeros((1, 3)),
        weight_factor=1.0,
    )
    radius = structure.radii[halves].mean(axis=1)
    depth = SIZE[2] + 0.2
    expected = np.pi**2 * MATERIAL.E * depth * (2 * radius) ** 3 / 12 / (length * edge) ** 2
    np.testing.assert_allclose(fea.euler_load(model.problem())[halves], expected, rtol=1e-6)
