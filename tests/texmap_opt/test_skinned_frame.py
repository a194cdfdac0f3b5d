"""A lattice that hangs on its skin: against solids, and what supports, loads and ties keep."""

from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import fea
from fea import TetMesh
from fea.frame import FrameProblem, solve_frame
from fea.sections import section
from fea.skin import Skin
from texmap_opt.case import DesignCase
from texmap_opt.errors import LatticeError
from texmap_opt.frame_model import FrameModel, frame_model
from texmap_opt.part import Part
from texmap_opt.sizing.problem import SizingProblem
from texmap_opt.sizing.sized import SizingLimits, Strength
from texmap_opt.skin_mesh import SkinMesh
from texmap_opt.skinned_frame import ABSENT, barycentric, forces_on_skin
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.stress_field import StressField, stress_field
from texmap_opt.structure.structure import Structure

SIZE = (16.0, 8.0, 8.0)
EDGE = 4.0
SKIN = 0.5
MATERIAL = fea.material("AlSi10Mg")
CLAMP = {"region": {"plane": {"point": [0, 0, 0], "normal": [1, 0, 0]}}}
END = {"plane": {"point": [16, 0, 0], "normal": [1, 0, 0]}}
TOP = {"plane": {"point": [0, 0, 8], "normal": [0, 0, 1]}}
SHEAR = {"region": END, "force_N": [0.0, 0.0, -20.0]}
PRESS = {"region": TOP, "pressure_MPa": 0.1}


def case(*, loads=(SHEAR,), supports=(CLAMP,), **lattice) -> DesignCase:
    tables = {
        "part": {"builtin": "cantilever"},
        "material": {"name": "AlSi10Mg"},
        "support": [dict(s) for s in supports],
        "load": [dict(load) for load in loads],
        "lattice": {"cells": [4, 2, 2], "radius_mm": 0.5, "skin_mm": SKIN} | lattice,
    }
    return DesignCase.from_tables(tables, Path("case.toml"))


def cubes(radius: float = 0.5, section: str = "square") -> Structure:
    """Cubes of edge 4: struts in the faces of the block, and across it between them."""
    counts = np.rint(np.array(SIZE) / EDGE).astype(int)
    corners = list(product(*(range(n + 1) for n in counts)))
    number = {p: i for i, p in enumerate(corners)}
    struts = [
        (number[p], number[q])
        for p in corners
        for axis in range(3)
        if (q := tuple(np.add(p, np.eye(3, dtype=int)[axis]).tolist())) in number
    ]
    joints = EDGE * np.array(corners, float)
    on_face = ((joints == 0) | (joints == np.array(SIZE))).any(axis=1)
    return Structure(
        joints,
        np.array(struts),
        np.full((len(struts), 2), radius),
        on_face,
        np.ones(len(struts)),
        section,
    )


def part_of(mesh: TetMesh) -> Part:
    return Part(TriMesh(mesh.nodes, mesh.boundary_facets[:, :3]), "block")


def modelled(
    given: DesignCase, structure: Structure, divisions: int = 8
) -> tuple[FrameModel, StressField]:
    x, y, z = (int(s / min(SIZE) * divisions) for s in SIZE)
    mesh = TetMesh.box(SIZE, (x, y, z)).to_tet10()
    stress = stress_field(given, mesh)
    return frame_model(structure, part_of(mesh), given, stress), stress


def solid(given: DesignCase, lines: list[np.ndarray], keep) -> TetMesh:
    """Boxes between lines along x, y, z, of which `keep` says by their centres which are solid."""
    x, y, z = (len(line) - 1 for line in lines)
    box = TetMesh.box((float(x), float(y), float(z)), (x, y, z))
    whole = np.rint(box.nodes).astype(int)
    nodes = np.stack([line[whole[:, axis]] for axis, line in enumerate(lines)], axis=1)
    # Six tets a box, one box after the other.
    low, high = nodes[box.tets].min(axis=1), nodes[box.tets].max(axis=1)
    chosen = box.tets[keep((low + high) / 2)]
    used, tets = np.unique(chosen, return_inverse=True)
    return TetMesh(nodes[used], tets.reshape(-1, 4)).to_tet10()


def in_skin(x: np.ndarray) -> np.ndarray:
    return np.any((x < SKIN) | (x > np.array(SIZE) - SKIN), axis=1)


def in_struts(x: np.ndarray) -> np.ndarray:
    """Within half a side of the grid's lines, in two directions."""
    near = np.abs(x - EDGE * np.rint(x / EDGE)) < 0.5
    return np.sum(near, axis=1) >= 2


def lines(fine: int = 2) -> list[np.ndarray]:
    """Lines at skin and struts, and between them."""
    result = []
    for size in SIZE:
        at = np.concatenate([[g - 0.5, g, g + 0.5] for g in EDGE * np.arange(size / EDGE + 1)])
        at = at[(at >= 0) & (at <= size)]
        parts = [np.linspace(a, b, 2 if b - a < 1 else fine + 1)[:-1] for a, b in pairwise(at)]
        result.append(np.append(np.concatenate(parts), size))
    return result


def solid_compliance(given: DesignCase, keep, fine: int = 2) -> float:
    mesh = solid(given, lines(fine), keep)
    return float(stress_field(given, mesh).compliance.sum())


def test_a_hollow_box_bends_as_one_of_solid_tets():
    """Shells without struts.

    Walls of 1/16 of the box's width, at whose edges a twelfth of the section is counted twice or not
    at all, and no transverse shear: 4 %.
    """
    given = case()
    mesh = TetMesh.box(SIZE, (16, 8, 8)).to_tet10()
    stress = stress_field(given, mesh)
    skin = SkinMesh.of(mesh, SKIN)
    points = skin.surface.vertices
    forces = forces_on_skin(mesh, skin, stress.load_forces[0])
    held = np.repeat(skin.outside[:, :1] == 0, 6, axis=1)
    problem = FrameProblem(
        points,
        np.zeros((0, 2), int),
        np.zeros((0, 2)),
        MATERIAL.E,
        MATERIAL.nu,
        section("round"),
        held,
        np.zeros(held.shape),
        forces[None],
        skin=Skin(skin.surface.faces, skin.thickness, MATERIAL.E, MATERIAL.nu),
    )
    got = float(solve_frame(problem).compliance.sum())
    wanted = solid_compliance(given, in_skin)
    assert got == pytest.approx(wanted, rel=0.04)


@pytest.mark.parametrize("load", [SHEAR, PRESS])
def test_a_skinned_lattice_is_as_compliant_as_one_of_solid_tets(load):
    """Cubes of square struts under a skin, bent and pressed on: within a tenth.

    Without the skin in the model it is off by a multiple.
    """
    given = case(loads=[load])
    wanted = solid_compliance(given, lambda x: in_skin(x) | in_struts(x))
    model, _ = modelled(given, cubes())
    got = float(solve_frame(model.problem()).compliance.sum())
    assert got == pytest.approx(wanted, rel=0.1)
    bare, _ = modelled(case(loads=[load], skin_mm=0.0), cubes())
    assert float(solve_frame(bare.problem()).compliance.sum()) > 3 * wanted


@pytest.mark.parametrize(
    "load",
    [
        SHEAR,
        PRESS,
        {"region": END, "moment_Nmm": [300.0, -50.0, 20.0]},
        {"region": {"box": [[4, 0, 0], [9, 8, 0.1]]}, "traction_MPa": [0.1, 0.2, 0.3]},
    ],
)
def test_force_and_moment_of_a_load_are_kept_on_the_skin(load):
    """Half a thickness below where they act, mid-edge nodes shared out."""
    model, stress = modelled(case(loads=[load]), cubes(), 4)
    nodal = stress.load_forces[0]
    wanted = nodal.sum(axis=0), np.cross(stress.mesh.nodes, nodal).sum(axis=0)
    forces = model.surface_forces[0]
    got = forces[:, :3].sum(axis=0), (np.cross(model.joints, forces[:, :3]) + forces[:, 3:]).sum(0)
    size = np.abs(nodal).sum()
    np.testing.assert_allclose(got[0], wanted[0], atol=1e-12 * size)
    np.testing.assert_allclose(got[1], wanted[1], atol=1e-12 * size * SIZE[0])
    # Loads act on the skin alone.
    assert not forces[: len(model.structure.joints)].any()


def test_supports_hold_the_skin_where_they_hold_the_solid():
    model, _ = modelled(case(), cubes(), 4)
    lattice = len(model.structure.joints)
    assert model.skin is not None
    assert not model.fixed[:lattice].any()
    held = model.fixed[lattice:].all(axis=1)
    np.testing.assert_array_equal(held, model.skin.mesh.outside[:, 0] == 0)
    slides, _ = modelled(case(supports=[CLAMP, {"region": TOP, "fix": ["z"]}]), cubes(), 4)
    assert slides.skin is not None
    only = slides.fixed[lattice:][slides.skin.mesh.outside[:, 2] == 8]
    assert only[:, 2].all()
    assert not only[~only[:, 0], 3:].any()


def test_prescribed_displacements_reach_the_skin():
    pulled = {"region": END, "fix": ["x"], "value_mm": [0.02, 0, 0]}
    given = case(supports=[CLAMP, pulled], loads=[{"gravity_m_s2": [0, 0, -9.81]}])
    model, _ = modelled(given, cubes(), 4)
    assert model.skin is not None
    end = np.flatnonzero(model.skin.mesh.outside[:, 0] == 16) + len(model.structure.joints)
    u = solve_frame(model.problem()).displacement
    np.testing.assert_allclose(u[0, end, 0], 0.02, rtol=1e-12)


def test_gravity_is_the_weight_of_skin_and_of_struts_below_it():
    """Face struts lie in the skin and weigh nothing of their own."""
    given = case(loads=[{"gravity_m_s2": [0, 0, -1.0]}])
    structure = cubes(radius=0.4, section="round")
    model, _ = modelled(given, structure, 4)
    assert model.skin is not None
    weight = -model.problem().forces[0, :, 2].sum() / 1e3
    density = given.material.density
    skin = model.skin.mesh.thickness @ model.skin.mesh.surface.face_areas
    lines_inside = 3 * SIZE[2] + 3 * SIZE[2] + SIZE[0]
    struts = model.weight_factor * np.pi * 0.4**2 * lines_inside
    np.testing.assert_allclose(weight, density * (skin + struts), rtol=1e-4)


def test_struts_in_the_skin_add_only_what_stands_out_of_it():
    """A circle of 0.8 mm about a line on the surface, skin 0.5: area of the segment beyond 0.5."""
    model, _ = modelled(case(), cubes(section="round"), 4)
    assert model.skin is not None
    x = model.structure.joints[model.structure.struts].mean(axis=1)
    on_face = ((x == 0) | (x == np.array(SIZE))).any(axis=1)
    shares = np.asarray(model.section_shares(np.full((len(x), 2), 0.8)))
    assert (shares[~on_face] == 1).all()
    r = np.linspace(0, 0.8, 100_001)
    width = 2 * np.sqrt(np.maximum(0.8**2 - r**2, 0))
    beyond = np.trapezoid(np.where(r >= 0.5, width, 0.0), r) / (np.pi * 0.8**2)
    np.testing.assert_allclose(shares[on_face], beyond, rtol=1e-4)
    thin = np.asarray(model.section_shares(np.full((len(x), 2), 0.45)))
    np.testing.assert_array_equal(thin[on_face], ABSENT)
    # What the skin holds of a strut moves with it.
    piercing = ~on_face & (model.structure.cut[model.structure.struts].any(axis=1))
    ends = model.skin.rigid_ends[piercing]
    np.testing.assert_allclose(ends.max(axis=1), SKIN, rtol=1e-9)
    assert not model.skin.rigid_ends[on_face].any()


def test_the_gradient_in_radii_has_a_second_order_taylor_remainder():
    """With weight, and struts of which the skin holds a part that depends on the radius."""
    given = case(loads=[SHEAR, {"case": "load 1", "gravity_m_s2": [0, 500.0, -9000.0]}])
    model, _ = modelled(given, cubes(section="round"), 4)
    problem = SizingProblem.of(model, SizingLimits(min_radius_mm=0.1, max_radius_mm=1.0))
    rng = np.random.default_rng(2)
    radius = rng.uniform(0.55, 0.75, len(model.structure.struts))
    step = rng.normal(size=len(radius)) * 0.01
    start = problem.solve(radius)
    rest = [
        abs(
            problem.solve(radius + h * step).compliance
            - start.compliance
            - h * start.gradient @ step
        )
        for h in (1.0, 0.5)
    ]
    assert np.log2(rest[0] / rest[1]) == pytest.approx(2, abs=0.1)


def test_pieces_that_only_the_skin_holds_are_held():
    """Struts across the block that touch no others: free without a skin."""
    whole = cubes()
    x = whole.joints[whole.struts]
    across = (np.abs(x[:, 0] - x[:, 1])[:, 2] > 0) & (x[:, 0, 1] == 4)
    alone = whole.select(across)
    model, _ = modelled(case(), alone, 4)
    assert solve_frame(model.problem()).residual < 1e-8
    with pytest.raises(LatticeError, match="falls into 5 pieces"):
        modelled(case(skin_mm=0.0), alone, 4)


def test_a_strut_end_that_misses_the_skin_is_named_with_its_place():
    """Tets that leave out a corner of the part, where a strut ends."""
    given = case(loads=[{"region": {"box": [[-1, -1, -1], [2, 9, 9]]}, "force_N": [0, 0, 1.0]}])
    mesh = TetMesh.box((10.0, 8.0, 8.0), (10, 8, 8))
    stress = stress_field(case(loads=[{"region": TOP, "force_N": [0, 0, 1.0]}]), mesh)
    whole = part_of(TetMesh.box(SIZE, (16, 8, 8)))
    with pytest.raises(
        LatticeError, match=r"strut that ends at \(16, .*\) mm misses the skin's .* smaller edge_mm"
    ):
        frame_model(cubes(), whole, given, stress)


def test_a_lattice_that_hangs_in_the_air_is_refused():
    structure = cubes()
    inner = replace(
        structure,
        joints=4 + structure.joints / np.array(SIZE) * 0.5,
        cut=np.zeros(len(structure.joints), bool),
        radii=structure.radii / 20,
    )
    with pytest.raises(LatticeError, match="no strut reaches the skin"):
        modelled(case(), inner, 4)


def test_a_cavity_whose_skin_no_strut_reaches_is_named_with_its_place():
    """A cube of 1 mm in the middle of a cell; its skin would hang in the air."""
    at = [np.arange(0, size + 0.5) for size in SIZE]
    mesh = solid(case(), at, lambda x: (np.abs(x - [6.5, 6.5, 2.5]) > 0.5).any(axis=1))
    stress = stress_field(case(), mesh)
    with pytest.raises(
        LatticeError,
        match=r"reaches the skin of the cavity about \(6.5, 6.5, 2.5\) mm.* fill the cavity",
    ):
        frame_model(cubes(), part_of(mesh), case(), stress)


def test_a_region_between_the_corners_of_triangles_is_refused():
    small = {"region": {"box": [[-0.1, 3.0, 3.0], [0.1, 3.2, 3.2]]}}
    given = case(supports=[CLAMP, small])
    model, stress = modelled(case(), cubes(), 4)
    with pytest.raises(LatticeError, match=r"no corner of the skin's triangles lies in"):
        frame_model(cubes(), part_of(stress.mesh), given, stress)
    assert model.skin is not None


def test_strength_is_that_of_struts_and_skin():
    model, _ = modelled(case(), cubes(), 4)
    solution = solve_frame(model.problem())
    strength = Strength.of(model, solution)
    assert strength.utilisation is not None
    assert strength.skin_von_mises is not None
    # The skin carries most of the bending: M/W of the hollow box, at the clamped end.
    inertia = (8**4 - 7**4) / 12
    bending = 20 * 16 * 4 / inertia
    assert strength.skin_von_mises.max() == pytest.approx(bending, rel=0.3)
    assert model.skin is not None
    along = np.isfinite(model.skin.beyond)
    assert along.any()
    assert not strength.euler_utilisation[along].any()
    assert strength.euler_utilisation[~along].max() > 0
    assert len(strength.utilisation) == len(model.structure.struts)


@settings(max_examples=30, derandomize=True, deadline=None)
@given(st.integers(0, 10_000))
def test_barycentric_coordinates_give_the_point_back(seed):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(5, 3, 3))
    weights = rng.dirichlet(np.ones(3), 5)
    points = np.einsum("nk,nkd->nd", weights, corners)
    np.testing.assert_allclose(barycentric(corners, points), weights, atol=1e-9)
