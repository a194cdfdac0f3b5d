"""The frame of an extruded lattice: walls in their plane, under a part's supports and loads."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import fea
from fea import TetMesh
from fea.frame import FrameProblem, solve_frame
from fea.sections import Wall
from texmap_opt.case import DesignCase
from texmap_opt.errors import CaseError, LatticeError
from texmap_opt.frame_model import FrameModel, frame_model, joint_masses
from texmap_opt.part import Part
from texmap_opt.plane_loads import eccentric_loads, out_of_plane_load
from texmap_opt.shadow_distance import near_shadow
from texmap_opt.sizing.problem import SizingProblem
from texmap_opt.sizing.sized import SizingLimits, Strength
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.stress_field import StressField, stress_field
from texmap_opt.structure.plane_axes import plane_axes
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.volume import lattice_volume

# Along the plane's two axes and the axis of extrusion [mm].
SIZE = (40.0, 10.0, 6.0)
EDGE = 5.0
ROOT = {"plane": {"point": [0, 0, 0], "normal": [1, 0, 0]}}
END = {"plane": {"point": [40, 0, 0], "normal": [1, 0, 0]}}
TOP = {"plane": {"point": [0, 0, 6], "normal": [0, 0, 1]}}
CLAMP = {"region": ROOT}
PRESS = {"case": "press", "region": END, "force_N": [0.0, -50.0, 0.0]}
MATERIAL = fea.material("AlSi10Mg")
XYZ = np.eye(3)


def case(*, supports=(CLAMP,), loads=(PRESS,), axes=XYZ) -> DesignCase:
    """A case in coordinates along the block's edges, turned into space."""
    tables = {
        "part": {"builtin": "cantilever"},
        "material": {"name": "AlSi10Mg"},
        "support": [turned_action(s, axes) for s in supports],
        "load": [turned_action(load, axes) for load in loads],
        "lattice": {"cells": [8, 2, 2], "radius_mm": 0.3, "skin_mm": 0.0},
        "sizing": {"method": "none"},
    }
    return DesignCase.from_tables(tables, Path("case.toml"))


def turned_action(action: dict, axes: np.ndarray) -> dict:
    def vector(v):
        return (np.array(v, float) @ axes).tolist()

    turned = dict(action)
    for name in ("force_N", "moment_Nmm", "gravity_m_s2", "traction_MPa", "value_mm"):
        if name in turned:
            turned[name] = vector(turned[name])
    plane = turned.get("region", {}).get("plane")
    if plane:
        turned["region"] = {"plane": {k: vector(v) for k, v in plane.items()}}
    return turned


def squares(depth: float = SIZE[2], radius: float = 0.3, axes=XYZ) -> Structure:
    """Square cells of edge 5 that fill the block; walls in its faces too."""
    nx, ny = int(SIZE[0] / EDGE), int(SIZE[1] / EDGE)
    points = list(product(range(nx + 1), range(ny + 1)))
    number = {p: i for i, p in enumerate(points)}
    struts = [
        (number[p], number[q])
        for p in points
        for step in ((1, 0), (0, 1))
        if (q := (p[0] + step[0], p[1] + step[1])) in number
    ]
    flat = np.column_stack([EDGE * np.array(points, float), np.full(len(points), depth / 2)])
    return bars(flat @ axes, struts, radius).extruded(axes[2], np.array([0.0, depth]))


def bars(joints, struts, radius) -> Structure:
    struts = np.array(struts)
    return Structure(
        joints,
        struts,
        np.full(struts.shape, float(radius)),
        np.zeros(len(joints), bool),
        np.ones(len(struts)),
    )


def mesh(depth: float = SIZE[2], axes=XYZ) -> TetMesh:
    box = TetMesh.box((SIZE[0], SIZE[1], depth), (8, 3, 2))
    return TetMesh(box.nodes @ axes, box.tets)


def modelled(
    given: DesignCase, structure: Structure, tets: TetMesh | None = None
) -> tuple[FrameModel, StressField]:
    tets = mesh() if tets is None else tets
    stress = stress_field(given, tets)
    part = Part(TriMesh(tets.nodes, tets.boundary_facets[:, :3]), "block")
    return frame_model(structure, part, given, stress), stress


def compliance(model: FrameModel) -> float:
    return float(solve_frame(model.problem()).compliance.sum())


def test_one_wall_is_a_cantilever_beam_of_its_depth():
    """Tip deflection P L³/(3 E I) + P L/(kappa G A): Timoshenko, Gere, Mechanics of Materials."""
    b, r, L = 6.0, 0.5, 40.0
    structure = bars(np.array([[0, 5, 3], [L, 5, 3.0]]), [(0, 1)], r)
    structure = structure.extruded(np.array([0, 0, 1.0]), np.array([0.0, b]))
    model, _ = modelled(case(), structure)
    u = solve_frame(model.problem()).displacement[0, 1]
    E, nu, P = MATERIAL.E, MATERIAL.nu, 50.0
    A, I, kappa = b * 2 * r, b * (2 * r) ** 3 / 12, 10 * (1 + nu) / (12 + 11 * nu)
    bend = P * L**3 / (3 * E * I) + P * L * 2 * (1 + nu) / (kappa * E * A)
    # The resultant of the meshed face and its moment are right to rounding.
    np.testing.assert_allclose(
        u, [0, -bend, 0, 0, 0, -P * L**2 / (2 * E * I)], rtol=1e-9, atol=1e-12
    )
    strength = Strength.of(model, solve_frame(model.problem()))
    assert strength.utilisation is not None
    yields = P * L * r / I / MATERIAL.yield_stress
    np.testing.assert_allclose(strength.utilisation, [yields], rtol=1e-9)


def test_euler_load_of_a_wall_is_that_of_its_own_section():
    b, r, L = 6.0, 0.5, 40.0
    structure = bars(np.array([[0, 5, 3], [L, 5, 3.0]]), [(0, 1)], r)
    structure = structure.extruded(np.array([0, 0, 1.0]), np.array([0.0, b]))
    push = PRESS | {"force_N": [-50.0, 0.0, 0.0]}
    model, _ = modelled(case(loads=[push]), structure)
    strength = Strength.of(model, solve_frame(model.problem()))
    expected = 50 * L**2 / (np.pi**2 * MATERIAL.E * b * (2 * r) ** 3 / 12)
    np.testing.assert_allclose(strength.euler_utilisation, [expected], rtol=1e-9)


def test_square_cells_are_the_plane_frame_of_walls_of_that_depth():
    """Against `fea` with the depth in the section, not in the modulus, and joints loaded by hand."""
    model, _ = modelled(case(), squares())
    structure = model.structure
    x = structure.joints[:, 0]
    forces = np.zeros((1, len(x), 6))
    forces[:] = model.surface_forces
    np.testing.assert_allclose(forces.sum(axis=1), [[0, -50, 0, 0, 0, 0]], atol=1e-9)
    frame = FrameProblem(
        structure.joints,
        structure.struts,
        structure.radii,
        MATERIAL.E,
        MATERIAL.nu,
        Wall(depth=SIZE[2]),
        np.repeat((x == 0)[:, None], 6, axis=1),
        np.zeros((len(x), 6)),
        forces,
    )
    plane = fea.in_plane(frame, np.array([0, 0, 1.0])).problem
    np.testing.assert_allclose(
        compliance(model), float(solve_frame(plane).compliance.sum()), rtol=1e-9
    )


def test_twice_the_depth_is_half_the_compliance():
    """Walls and load keep their place in the plane; a frame without skin has no other size."""
    once, _ = modelled(case(), squares())
    deep = 2 * SIZE[2]
    twice, _ = modelled(case(), squares(deep), mesh(deep))
    np.testing.assert_allclose(compliance(twice), compliance(once) / 2, rtol=1e-10)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_axis_of_extrusion_may_be_any_of_x_y_z(axis):
    axes = plane_axes(np.eye(3)[axis])
    model, _ = modelled(case(axes=axes), squares(axes=axes), mesh(axes=axes))
    np.testing.assert_array_equal(model.axes, np.eye(3))
    along_z, _ = modelled(case(), squares())
    np.testing.assert_allclose(compliance(model), compliance(along_z), rtol=1e-10)


@settings(max_examples=5, derandomize=True, deadline=None)
@given(st.tuples(*[st.floats(-2, 2)] * 3))
def test_a_block_turned_in_space_has_the_same_compliance(turn):
    axes = Rotation.from_rotvec(turn).as_matrix()
    model, _ = modelled(case(axes=axes), squares(axes=axes), mesh(axes=axes))
    along_z, _ = modelled(case(), squares())
    # The tolerance of a plane region and the nearest joint are the same to rounding of the turn.
    np.testing.assert_allclose(compliance(model), compliance(along_z), rtol=1e-8)


def test_a_symmetry_plane_lets_walls_turn_and_a_full_support_clamps_them():
    sym = {"region": ROOT, "fix": ["x", "z"]}
    corner = {"region": {"box": [[0, 0, 0], [0.1, 0.1, 6]]}, "fix": ["x", "y"]}
    model, _ = modelled(case(supports=[sym, corner]), squares())
    x, y, _ = model.structure.joints.T
    np.testing.assert_array_equal(model.fixed[(x == 0) & (y == 0)], True)
    out = [False, False, True, True, True, False]
    np.testing.assert_array_equal(model.fixed[(x == 0) & (y > 0)], [[True, *out[1:]]] * 2)
    np.testing.assert_array_equal(model.fixed[x > 0], [out] * int((x > 0).sum()))


def test_prescribed_displacements_reach_the_walls_in_their_plane_only():
    pulled = {"region": END, "fix": ["x"], "value_mm": [0.2, 0, 0]}
    weight = {"gravity_m_s2": [0, -9.81, 0]}
    model, _ = modelled(case(supports=[CLAMP, pulled], loads=[weight]), squares())
    u = solve_frame(model.problem()).displacement[0]
    np.testing.assert_allclose(u[model.structure.joints[:, 0] == 40, 0], 0.2, rtol=1e-12)
    np.testing.assert_array_equal(u[:, 2], 0)
    lifted = {"region": END, "fix": ["z"], "value_mm": [0, 0, 0.2]}
    with pytest.raises(LatticeError, match=r"case.toml: \[\[support\]\]: .* out of the plane"):
        modelled(case(supports=[CLAMP, lifted], loads=[weight]), squares())


def test_a_support_over_any_part_of_the_depth_holds_the_walls_under_it():
    """A patch of the upper face, a strip of a side and a ball below it: joints seen along the axis."""
    for region, expected in (
        ({"box": [[-1, -1, 5.9], [10.5, 11, 7]]}, lambda x, y: x <= 10),
        ({"box": [[-1, -1, 5.0], [0.1, 11, 7]]}, lambda x, y: x == 0),
        ({"sphere": {"center": [20, 5, 0], "radius": 2.0}}, lambda x, y: (x == 20) & (y == 5)),
    ):
        model, _ = modelled(case(supports=[CLAMP, {"region": region}]), squares())
        x, y, _ = model.structure.joints.T
        np.testing.assert_array_equal(model.fixed[:, 0], expected(x, y) | (x == 0))


def test_gravity_is_the_weight_of_the_walls_at_their_centre_of_gravity():
    structure = squares()
    model, _ = modelled(case(loads=[{"gravity_m_s2": [1.0, -9.81, 0.0]}]), structure)
    forces = model.problem().forces[0, :, :3]
    weight = MATERIAL.density * lattice_volume(structure) * 1e3 * np.array([1, -9.81, 0])
    np.testing.assert_allclose(forces.sum(axis=0), weight, rtol=1e-10, atol=1e-15)
    moment = np.cross(structure.joints, forces).sum(axis=0)
    np.testing.assert_allclose(moment, np.cross(np.array(SIZE) / 2, weight), rtol=1e-8)


def test_the_mass_of_a_tapered_wall_keeps_its_centre():
    """Trapezium: centroid from the side 2a at L (a + 2b)/(3 (a + b))."""
    a, b, L, depth = 0.9, 0.4, 7.0, 5.0
    one = bars(np.array([[0, 0, 2.5], [L, 0, 2.5]]), [(0, 1)], 1.0)
    one = one.extruded(np.array([0, 0, 1.0]), np.array([0.0, depth]))
    one = one.with_radii(np.array([[a, b]]))
    mass = np.asarray(joint_masses(one, one.radii, 2.0, np.array([depth])))
    np.testing.assert_allclose(mass.sum(), 2 * depth * L * (a + b), rtol=1e-12)
    np.testing.assert_allclose(
        L * mass[1] / mass.sum(), L * (a + 2 * b) / (3 * (a + b)), rtol=1e-12
    )


def test_loads_off_the_middle_of_the_walls_keep_force_and_moment_in_the_plane():
    strip = {"box": [[39.9, -1, 4.0], [41, 11, 7]]}
    # Along the axis of extrusion less than the hundredth that is refused: left out.
    load = {"region": strip, "traction_MPa": [0.3, -0.5, 0.004]}
    model, stress = modelled(case(loads=[load]), squares(), mesh())
    nodal = stress.load_forces[0]
    applied = model.surface_forces[0]
    assert nodal[:, 2].sum() > 0.05
    np.testing.assert_allclose(applied[:, :2].sum(axis=0), nodal[:, :2].sum(axis=0), atol=1e-9)
    np.testing.assert_allclose(applied[:, 2], 0, atol=1e-12)
    turns = np.cross(stress.mesh.nodes, nodal).sum(axis=0)[2]
    joints = model.structure.joints
    got = np.cross(joints, applied[:, :3]).sum(axis=0)[2] + applied[:, 5].sum()
    np.testing.assert_allclose(got, turns, rtol=1e-9)
    np.testing.assert_array_equal(applied[:, 3:5], 0)


@pytest.mark.parametrize(
    ("load", "message"),
    [
        ({"force_N": [0, -50, 5]}, "force_N = .* acts along the axis of extrusion"),
        ({"traction_MPa": [0, 0, 0.1]}, "traction_MPa = .* acts along the axis of extrusion"),
        ({"region": TOP, "pressure_MPa": 0.1}, "acts with -40 N along the axis"),
        ({"moment_Nmm": [100.0, 0, 0]}, "moment_Nmm = .* turns across the axis"),
        ({"region": None, "gravity_m_s2": [0, 0, -9.81]}, "gravity_m_s2 = .* acts along the axis"),
    ],
)
def test_loads_out_of_the_plane_are_refused_with_the_reason(load, message):
    given = {"region": END} | load
    given = {k: v for k, v in given.items() if v is not None}
    with pytest.raises(CaseError, match=rf"case.toml: \[\[load\]\] 2 {message}") as failure:
        modelled(case(loads=[PRESS, given]), squares())
    assert "bend about that axis only" in str(failure.value)
    assert '3-D cell, or give [sizing] method = "none"' in str(failure.value)


def test_pressure_on_both_ends_of_the_walls_is_refused_though_it_balances():
    """Top and bottom squeezed: no resultant, but all of it acts along the walls."""
    both = {"box": [[-1, -1, -1], [41, 41, 41]]}
    given = case(loads=[PRESS, {"region": both, "pressure_MPa": 0.1}])
    with pytest.raises(CaseError, match=r"\[\[load\]\] 2 acts with .* to and fro along the axis"):
        modelled(given, squares())


def test_a_couple_about_an_axis_in_the_plane_is_refused_though_its_force_is_nothing():
    """Pressure on the upper half of one end and pull on its lower half, as one load."""
    given = case(loads=[{"region": END, "force_N": [0.0, -1.0, 0.0]}])
    tets = mesh()
    stress = stress_field(given, tets)
    ends = np.flatnonzero(tets.nodes[:, 0] == 40)
    forces = np.zeros_like(stress.load_forces)
    forces[0, ends, 0] = tets.nodes[ends, 2] - 3
    bent = replace(stress, load_forces=forces)
    walls = squares().extrusion
    assert walls is not None
    assert "N mm across the axis of extrusion" in str(out_of_plane_load(given, bent, walls))
    assert out_of_plane_load(given, stress, walls) is None


def test_a_load_well_off_the_middle_is_told():
    strip = {"box": [[39.9, -1, 2.9], [41, 11, 7]]}
    given = case(loads=[{"region": strip, "force_N": [0, -5, 0]}, PRESS])
    _, stress = modelled(given, squares())
    walls = squares().extrusion
    assert walls is not None
    (note,) = eccentric_loads(given, stress, walls)
    # The upper half of the end: its middle is 1.5 mm off, meshed in two layers of linear tets.
    assert note.startswith(
        "case.toml: [[load]] 1: acts 1.5 mm off the middle of the 6 mm deep walls"
    )


def test_a_left_over_motion_of_the_walls_is_named():
    sym = {"region": ROOT, "fix": ["x", "z"]}
    held = case(supports=[CLAMP])
    _, stress = modelled(held, squares())
    loose = case(supports=[sym])
    part = Part(TriMesh(stress.mesh.nodes, stress.mesh.boundary_facets[:, :3]), "block")
    with pytest.raises(LatticeError, match=r"not held: it slides along y"):
        frame_model(squares(), part, loose, stress)


def test_compliance_gradient_in_the_radii_has_a_second_order_taylor_remainder():
    weight = {"gravity_m_s2": [0, -9.81, 0], "case": "press"}
    model, _ = modelled(case(loads=[PRESS, weight]), squares())
    rng = np.random.default_rng(2)
    depth = rng.uniform(3, 6, len(model.structure.struts))
    walls = replace(model.structure.extrusion, depth=depth)
    model = model.with_structure(replace(model.structure, extrusion=walls))
    problem = SizingProblem.of(model, SizingLimits())
    radius = rng.uniform(0.2, 0.4, len(depth))
    direction = rng.normal(size=len(depth))
    start = problem.solve(radius)

    def rest(h: float) -> float:
        compliance = problem.solve(radius + h * direction).compliance
        return abs(compliance - start.compliance - h * float(start.gradient @ direction))

    np.testing.assert_allclose(np.log2(rest(2e-4) / rest(1e-4)), 2, atol=0.05)


@settings(max_examples=20, derandomize=True, deadline=None)
@given(st.integers(0, 10_000), st.booleans())
def test_points_near_shadows_are_those_near_samples_of_the_triangles(seed, edge_on):
    """Against triangles sampled finely; points nearer to the limit than the samples are left out."""
    rng = np.random.default_rng(seed)
    triangles = rng.uniform(0, 10, (3, 3, 2))
    if edge_on:
        triangles[:, 2] = 0.3 * triangles[:, 0] + 0.7 * triangles[:, 1]
    points, reach = rng.uniform(-2, 12, (200, 2)), 0.5
    n = 60
    shares = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
    samples = (shares @ triangles).reshape(-1, 2)
    distance = np.linalg.norm(points[:, None] - samples, axis=2).min(axis=1)
    sure = np.abs(distance - reach) > 20 / n
    got = near_shadow(points, triangles, reach)
    np.testing.assert_array_equal(got[sure], (distance < reach)[sure])
    assert not near_shadow(points + 100, triangles, reach).any()


def test_own_slope_of_walls_is_twice_depth_times_length():
    model, _ = modelled(case(), squares())
    problem = SizingProblem.of(model, SizingLimits())
    radius = np.full(len(model.structure.struts), 0.25)
    expected = 2 * SIZE[2] * model.structure.lengths()
    np.testing.assert_allclose(problem.own_slope(radius), expected, rtol=1e-12)
