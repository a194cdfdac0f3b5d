"""Supports and loads of a part, carried over to the joints of a lattice."""

from itertools import permutations, product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import fea
from fea import TetMesh
from fea.frame import solve_frame
from texmap_opt.bearers import carried_forces
from texmap_opt.case import DesignCase
from texmap_opt.errors import LatticeError
from texmap_opt.frame_model import FrameModel, frame_model, joint_masses
from texmap_opt.part import Part
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.stress_field import MM_PER_M, StressField, selected_nodes
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.volume import lattice_volume

SIZE = (40.0, 10.0, 10.0)
CLAMP = {"region": {"plane": {"point": [0, 0, 0], "normal": [1, 0, 0]}}}
END = {"plane": {"point": [40, 0, 0], "normal": [1, 0, 0]}}
PRESS = {"case": "press", "region": END, "force_N": [0.0, 0.0, -50.0]}


def block_mesh(counts=(8, 3, 3)) -> TetMesh:
    """The bar SIZE as boxes of six tets each (Kuhn's subdivision)."""
    axes = [np.linspace(0, s, n + 1) for s, n in zip(SIZE, counts, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    shape = np.add(counts, 1)
    tets = []
    for cell in product(*(range(n) for n in counts)):
        for order in permutations(range(3)):
            walk = [np.array(cell)]
            for axis in order:
                walk.append(walk[-1] + np.eye(3, dtype=int)[axis])
            tet = [int(np.ravel_multi_index(tuple(p), shape)) for p in walk]
            a, b, c, d = nodes[tet]
            tets.append(
                tet if np.dot(np.cross(b - a, c - a), d - a) > 0 else [*tet[:2], *tet[:1:-1]]
            )
    return TetMesh(nodes, np.array(tets))


MESH = block_mesh()


def case(*, supports=(CLAMP,), loads=(PRESS,), **lattice) -> DesignCase:
    tables = {
        "part": {"builtin": "cantilever"},
        "material": {"name": "AlSi10Mg"},
        "support": [dict(s) for s in supports],
        "load": [dict(load) for load in loads],
        "lattice": {"cells": [8, 2, 2], "radius_mm": 0.5, "skin_mm": 0.0} | lattice,
    }
    return DesignCase.from_tables(tables, Path("case.toml"))


def bcc(inset: float = 0.0, radius: float = 0.5) -> Structure:
    """Body-centred cubic lattice of edge 5 over the bar, corners first; optionally shrunk."""
    counts = np.array([8, 2, 2])
    corners = np.stack(np.meshgrid(*(np.arange(n + 1) for n in counts), indexing="ij"), -1)
    corners = corners.reshape(-1, 3)
    centres = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), -1)
    centres = centres.reshape(-1, 3)
    struts = [
        (int(np.ravel_multi_index(tuple(c + step), counts + 1)), len(corners) + i)
        for i, c in enumerate(centres)
        for step in product((0, 1), repeat=3)
    ]
    joints = np.vstack([corners, centres + 0.5]) * 5.0
    joints = inset + joints * (np.array(SIZE) - 2 * inset) / SIZE
    return Structure(
        joints=joints,
        struts=np.array(struts),
        radii=np.full((len(struts), 2), radius),
        cut=np.zeros(len(joints), bool),
        cell_size=np.ones(len(struts)),
    )


def part() -> Part:
    return Part(TriMesh(MESH.nodes, MESH.boundary_facets[:, :3]), "bar")


def nodal_forces(given: DesignCase) -> np.ndarray:
    """Each load's forces on the nodes of its region, uneven unless the case says `force_N`."""
    forces = np.zeros((len(given.loads), *MESH.nodes.shape))
    rng = np.random.default_rng(4)
    for force, load in zip(forces, given.loads, strict=True):
        if load.gravity_m_s2 is not None:
            g = MM_PER_M * np.array(load.gravity_m_s2)
            force += fea.gravity_forces(MESH, given.material.density, g)
        if load.region is not None:
            nodes = selected_nodes(MESH, load.region)
            even = load.force_N is not None
            force[nodes] += (
                np.array(load.force_N) / len(nodes) if even else rng.normal(size=(len(nodes), 3))
            )
    return forces


def modelled(given: DesignCase, structure: Structure) -> tuple[FrameModel, StressField]:
    nodes, cases = len(MESH.nodes), len(given.load_cases)
    field = StressField(
        mesh=MESH,
        case_names=given.load_cases,
        displacement=np.zeros((cases, nodes, 3)),
        stress=np.zeros((cases, nodes, 6)),
        load_forces=nodal_forces(given),
        reaction=np.zeros((cases, 3)),
        compliance=np.zeros(cases),
        residual=0.0,
        estimated_error=0.0,
    )
    return frame_model(structure, part(), given, field), field


def resultant(points, forces, moments=0.0):
    return forces.sum(axis=0), (np.cross(points, forces) + moments).sum(axis=0)


@pytest.mark.parametrize(
    "load",
    [
        PRESS,
        {"region": END, "moment_Nmm": [300.0, -50.0, 20.0]},
        {"region": {"plane": {"point": [0, 0, 10], "normal": [0, 0, 1]}}, "pressure_MPa": 0.2},
        {"region": {"box": [[12, 0, 0], [28, 10, 0.1]]}, "traction_MPa": [0.1, 0.2, 0.3]},
    ],
)
@pytest.mark.parametrize("inset", [0.0, 0.5])
def test_force_and_moment_of_a_load_are_kept(load, inset):
    model, field = modelled(case(loads=[load]), bcc(inset))
    wanted = resultant(MESH.nodes, field.load_forces[0])
    got = resultant(
        model.structure.joints, model.surface_forces[0, :, :3], model.surface_forces[0, :, 3:]
    )
    size = np.abs(field.load_forces[0]).sum()
    np.testing.assert_allclose(got[0], wanted[0], atol=1e-10 * size)
    np.testing.assert_allclose(got[1], wanted[1], atol=1e-10 * size * SIZE[0])
    # A face full of joints offers levers: no joint needs a moment.
    np.testing.assert_allclose(model.surface_forces[0, :, 3:], 0, atol=1e-9 * size)


@settings(max_examples=20, derandomize=True, deadline=None)
@given(st.integers(1, 6), st.sampled_from(["anywhere", "line", "point"]), st.integers(0, 10_000))
def test_any_joints_take_any_forces_with_their_moment(count, shape, seed):
    """One joint, joints on one line, joints in one place: joint moments take the rest."""
    rng = np.random.default_rng(seed)
    joints = rng.uniform(-10, 10, (count, 3))
    if shape == "line":
        joints = joints[:1] + rng.uniform(-5, 5, (count, 1)) * rng.normal(size=3)
    if shape == "point":
        joints = joints[:1] + 1e-9 * rng.normal(size=(count, 3))
    points, forces = rng.uniform(-10, 10, (30, 3)), rng.normal(size=(30, 3))
    carried = carried_forces(joints, points, forces, lever=0.1)
    got = resultant(joints, carried[:, :3], carried[:, 3:])
    for a, b in zip(got, resultant(points, forces), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-10 * 300)
    # No lever, no huge forces.
    assert np.abs(carried[:, :3]).max() < 300 * 20 / 0.1


def test_the_correction_is_the_smallest_that_does_it():
    """Against the minimum-norm solution of the six balance equations."""
    rng = np.random.default_rng(3)
    joints, points = rng.uniform(-5, 5, (7, 3)), rng.uniform(-5, 5, (20, 3))
    forces = rng.normal(size=(20, 3))
    carried = carried_forces(joints, points, forces, lever=1e-3)[:, :3]
    nearest = np.linalg.norm(points[:, None] - joints, axis=2).argmin(axis=1)
    first = np.zeros_like(joints)
    np.add.at(first, nearest, forces)
    balance = np.vstack(
        [np.tile(np.eye(3), 7), np.hstack([np.cross(np.eye(3), j).T * -1 for j in joints])]
    )
    missing = np.concatenate(resultant(points, forces)) - balance @ first.ravel()
    smallest = np.linalg.lstsq(balance, missing, rcond=None)[0].reshape(-1, 3)
    np.testing.assert_allclose(carried - first, smallest, atol=1e-10)


def test_a_clamped_face_clamps_all_its_joints_rims_included():
    """Joints one radius off two faces are held whichever is nearer."""
    model, _ = modelled(case(), bcc(inset=0.5))
    near = np.flatnonzero(model.structure.joints[:, 0] < 0.6)
    assert len(near) == 9
    assert model.fixed[near].all()
    assert not model.fixed[np.setdiff1d(np.arange(len(model.fixed)), near)].any()


def test_directions_held_one_by_one_clamp_only_together():
    """Fixed along x: may rotate. Fixed along x by one support and y, z by another: clamped."""
    face = CLAMP["region"]
    edge = {"box": [[0, 0, 0], [0.1, 10, 0.1]]}
    model, _ = modelled(
        case(
            supports=[
                {"region": face, "fix": ["x"]},
                {"region": edge, "fix": ["y", "z"]},
            ]
        ),
        bcc(),
    )
    x, _, z = model.structure.joints.T
    on_face, on_edge = x == 0, (x == 0) & (z == 0)
    np.testing.assert_array_equal(model.fixed[on_edge], True)
    only = model.fixed[on_face & ~on_edge]
    np.testing.assert_array_equal(only, [[True, False, False, False, False, False]] * len(only))


def test_prescribed_displacements_reach_the_joints():
    pulled = {"region": END, "fix": ["x"], "value_mm": [0.2, 0, 0]}
    given = case(supports=[CLAMP, pulled], loads=[{"gravity_m_s2": [0, 0, -9.81]}])
    model, _ = modelled(given, bcc())
    end = model.structure.joints[:, 0] == 40
    u = solve_frame(model.problem()).displacement
    np.testing.assert_allclose(u[0, end, 0], 0.2, rtol=1e-12)


def test_gravity_is_the_weight_of_the_true_volume_at_the_centre_of_gravity():
    structure = bcc()
    given = case(loads=[{"gravity_m_s2": [1.0, 2.0, -9.81]}])
    model, _ = modelled(given, structure)
    force, moment = resultant(structure.joints, model.problem().forces[0, :, :3])
    weight = given.material.density * lattice_volume(structure) * 1e3 * np.array([1, 2, -9.81])
    np.testing.assert_allclose(force, weight, rtol=1e-10)
    np.testing.assert_allclose(moment, np.cross(np.array(SIZE) / 2, weight), rtol=1e-8)
    np.testing.assert_array_equal(model.surface_forces, 0)


def test_the_mass_of_a_tapered_strut_keeps_its_centre():
    """Frustum: centroid from the thick end at L (a² + 2ab + 3b²)/(4 (a² + ab + b²))."""
    a, b, L = 0.9, 0.4, 7.0
    one = Structure(
        np.array([[0, 0, 0], [0, 0, L]]),
        np.array([[0, 1]]),
        np.array([[a, b]]),
        np.zeros(2, bool),
        np.ones(1),
    )
    mass = np.asarray(joint_masses(one, one.radii, 2.0))
    np.testing.assert_allclose(mass.sum(), 2 * np.pi * L / 3 * (a * a + a * b + b * b), rtol=1e-12)
    centre = L * mass[1] / mass.sum()
    expected = L * (a * a + 2 * a * b + 3 * b * b) / (4 * (a * a + a * b + b * b))
    np.testing.assert_allclose(centre, expected, rtol=1e-12)


def test_loads_of_a_case_add_up_and_cases_stay_apart():
    side = {"case": "side", "region": END, "force_N": [0.0, 20.0, 0.0]}
    model, _ = modelled(case(loads=[PRESS, side, PRESS]), bcc())
    assert model.case_names == ("press", "side")
    total = model.surface_forces[..., :3].sum(axis=1)
    np.testing.assert_allclose(total, [[0, 0, -100], [0, 20, 0]], atol=1e-9)


def test_a_region_that_no_strut_reaches_is_named_with_the_remedy():
    short = bcc()
    short = short.select((short.joints[short.struts][..., 0] <= 20).all(axis=1))
    with pytest.raises(LatticeError, match=r"case.toml: \[\[load\]\] 1 region: no strut reaches"):
        modelled(case(), short)
    with pytest.raises(LatticeError, match="smaller cells or a larger region"):
        modelled(case(), short)


def test_joints_inside_a_volume_region_are_held_however_deep():
    given = case(supports=[{"region": {"box": [[0, 0, 0], [10, 10, 10]]}}])
    model, _ = modelled(given, bcc())
    np.testing.assert_array_equal(model.fixed[:, 0], model.structure.joints[:, 0] <= 10 + 1e-9)


def test_a_left_over_motion_of_the_lattice_is_named():
    edge = {"region": {"box": [[0, 0, 0], [0.1, 0.1, 10]]}, "fix": ["x", "y"]}
    with pytest.raises(LatticeError, match=r"not held: it .* about an axis along z"):
        modelled(case(supports=[edge]), bcc())


def test_a_piece_of_the_lattice_beside_the_held_one_is_named():
    whole = bcc()
    apart = ~((whole.joints[whole.struts][..., 0] - 22.5) ** 2 < 4).any(axis=1)
    with pytest.raises(LatticeError, match="falls into 2 pieces"):
        modelled(case(), whole.select(apart))


def test_loads_on_held_joints_only_are_refused():
    held = {"region": {"box": [[0, 0, 0], list(SIZE)]}}
    with pytest.raises(LatticeError, match=r'case = "press": reaches only joints that are held'):
        modelled(case(supports=[held]), bcc())


def test_supports_that_contradict_each_other_on_a_joint_are_refused():
    pulled = CLAMP | {"value_mm": [0.1, 0, 0]}
    with pytest.raises(LatticeError, match="Use smaller cells"):
        modelled(case(supports=[CLAMP, pulled]), bcc())
