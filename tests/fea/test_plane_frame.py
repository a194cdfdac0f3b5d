"""Frames of walls held in their plane: textbook answers on any plane, depths, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fea.adjoint import compliance_gradient
from fea.couplings import Rigid
from fea.errors import FeaError
from fea.frame import FrameProblem, solve_frame
from fea.plane_frame import PlaneFrame, in_plane
from fea.sections import Round, Wall
from fea.skin import Skin
from fea.stability import buckling
from fea.strut_loads import strut_weight
from fea.strut_strength import buckling_utilisation, euler_load, utilisation

E, NU = 70_000.0, 0.3
Z = np.array([0.0, 0.0, 1.0])
TURNS = [
    Rotation.identity(),
    # The plane's normal along x, y and -z.
    Rotation.from_matrix(np.roll(np.eye(3), 1, axis=0)),
    Rotation.from_matrix(np.roll(np.eye(3), 2, axis=0)),
    Rotation.from_rotvec([np.pi, 0, 0]),
    Rotation.from_rotvec([0.3, -0.7, 0.5]),
]


def grid(depth: float = 4.0, seed: int = 0) -> FrameProblem:
    """Braced squares in the plane z = 5, jittered, tapered, clamped at x = 0; two cases."""
    rng = np.random.default_rng(seed)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(4.0), np.arange(3.0), indexing="ij"))
    joints = np.stack([10 * x, 10 * y, np.full(12, 5.0)], axis=1)
    joints[:, :2] += rng.uniform(-1, 1, (12, 2))
    a, b = np.triu_indices(12, 1)
    step = np.stack([x[b] - x[a], y[b] - y[a]], axis=1)
    near = ((np.abs(step).sum(axis=1) == 1) | (step == 1).all(axis=1)).nonzero()[0]
    struts = np.stack([a[near], b[near]], axis=1)
    fixed = np.repeat((x == 0)[:, None], 6, axis=1)
    forces = np.zeros((2, 12, 6))
    forces[:, 9:, :2] = rng.normal(size=(2, 3, 2))
    forces[:, 9:, 5] = rng.normal(size=(2, 3))
    return FrameProblem(
        joints=joints,
        struts=struts,
        radii=rng.uniform(0.3, 0.6, (len(struts), 2)),
        E=E,
        nu=NU,
        section=Wall(depth=depth),
        fixed=fixed,
        value=np.zeros((12, 6)),
        forces=forces,
    )


def placed(frame: FrameProblem, turn: Rotation) -> FrameProblem:
    """The frame and its loads turned in space; supports are those of whole joints."""

    def turned(field: np.ndarray) -> np.ndarray:
        return turn.apply(field.reshape(-1, 3)).reshape(field.shape)

    return replace(
        frame,
        joints=turned(frame.joints),
        forces=turned(frame.forces),
        value=turned(frame.value),
        strut_loads=None if frame.strut_loads is None else turned(frame.strut_loads),
    )


def displacement(plane: PlaneFrame) -> np.ndarray:
    return plane.to_space(solve_frame(plane.problem).displacement)


@pytest.mark.parametrize("turn", TURNS)
def test_a_frame_deflects_alike_whatever_its_plane(turn):
    frame = grid()
    load = np.zeros((2, len(frame.struts), 3, 3))
    load[:, ::2, :, :2] = np.random.default_rng(1).normal(size=(2, len(load[0, ::2]), 3, 2))
    frame = replace(frame, strut_loads=load)
    expected = displacement(in_plane(frame, Z))
    plane = in_plane(placed(frame, turn), 3 * turn.apply(Z))
    found = displacement(plane)
    here = turn.inv().apply(found.reshape(-1, 3)).reshape(found.shape)
    np.testing.assert_allclose(here, expected, atol=1e-10 * np.abs(expected).max())
    # Nothing leaves the plane.
    np.testing.assert_array_equal(expected[..., 2:5], 0)
    np.testing.assert_allclose(np.linalg.det(plane.axes), 1, rtol=1e-14)
    np.testing.assert_allclose(
        plane.to_plane(found),
        solve_frame(plane.problem).displacement,
        atol=1e-14 * np.abs(found).max(),
    )


def test_axes_of_coordinate_planes_are_coordinate_axes():
    """Then whatever holds one direction does so to the last digit."""
    for turn in TURNS[:4]:
        axes = in_plane(placed(grid(), turn), turn.apply(Z)).axes
        np.testing.assert_array_equal(np.sort(np.abs(axes), axis=1), [[0, 0, 1]] * 3)
    np.testing.assert_array_equal(in_plane(grid(), Z).axes, np.eye(3))


@pytest.mark.parametrize("turn", [TURNS[0], TURNS[4]])
def test_wall_cantilever_has_the_deflection_of_timoshenkos_beam(turn):
    """P L³/(3 E I) + P L/(kappa G A), with I of the wall's thickness, not of its depth."""
    L, t, depth, P = 30.0, 2.0, 9.0, 7.0
    frame = FrameProblem(
        joints=np.array([[0.0, 0, 0], [L, 0, 0]]),
        struts=np.array([[0, 1]]),
        radii=np.full((1, 2), t / 2),
        E=E,
        nu=NU,
        section=Wall(depth=depth),
        fixed=np.array([[True] * 6, [False] * 6]),
        value=np.zeros((2, 6)),
        forces=np.array([[[0.0] * 6, [0, P, 0, 0, 0, 0]]]),
    )
    u = displacement(in_plane(placed(frame, turn), turn.apply(Z)))
    I, A, G = depth * t**3 / 12, depth * t, E / (2 * (1 + NU))
    kappa = 10 * (1 + NU) / (12 + 11 * NU)
    expected = P * L**3 / (3 * E * I) + P * L / (kappa * G * A)
    np.testing.assert_allclose(u[0, 1, :3], expected * turn.apply([0, 1, 0]), atol=1e-10)


def test_depths_by_relative_modulus_are_exact():
    """Unit depth and E times each wall's depth: displacement, forces, Euler's loads; stress over depth."""
    deep = grid(depth=4.0)
    unit = replace(deep, section=Wall(), modulus=np.full(len(deep.struts), 4.0))
    a, b = (solve_frame(in_plane(frame, Z).problem) for frame in (deep, unit))
    np.testing.assert_allclose(b.displacement, a.displacement, atol=1e-16)
    np.testing.assert_allclose(b.end_forces, a.end_forces, atol=1e-9 * np.abs(a.end_forces).max())
    np.testing.assert_allclose(euler_load(b.problem), euler_load(a.problem), rtol=1e-13)
    np.testing.assert_allclose(buckling_utilisation(b), buckling_utilisation(a), rtol=1e-9)
    np.testing.assert_allclose(utilisation(b, 200.0) / 4, utilisation(a, 200.0), rtol=1e-9)


def test_a_wall_weighs_its_trapezium():
    """Depth times length times the mean thickness."""
    frame = grid(depth=4.0)
    load = np.asarray(
        strut_weight(frame.strut_values(), frame.section, 2e-9, np.array([[0.0, -9810.0, 0.0]]))
    )[0]
    force = (load[:, 0] + 4 * load[:, 1] + load[:, 2]) / 6
    thickness = frame.radii.sum(axis=1)
    np.testing.assert_allclose(force[:, 1], -9810 * 2e-9 * 4.0 * thickness, rtol=1e-13)


@settings(max_examples=10, derandomize=True, deadline=None)
@example((1e-7, 0.0, 2.0))
@example((0.0, 1e-10, 1.0))
@given(st.tuples(*[st.floats(-3, 3)] * 3))
def test_a_prescribed_motion_in_the_plane_is_met(angles):
    """Given by its three components in space at two joints, whatever the plane."""
    turn = Rotation.from_rotvec(angles)
    frame = grid()
    value = frame.value.copy()
    fixed = frame.fixed.copy()
    fixed[11] = True
    value[11] = [0.1, -0.2, 0, 0, 0, 0.03]
    frame = replace(frame, fixed=fixed, value=value)
    u = displacement(in_plane(placed(frame, turn), turn.apply(Z)))
    expected = turn.apply(value[11].reshape(2, 3)).reshape(6)
    # Two components that a tilt below `TILT` takes of 0.2 mm.
    np.testing.assert_allclose(u[:, 11], [expected] * 2, atol=1e-7)


def test_a_roller_holds_what_its_direction_leaves_in_the_plane():
    """Only x is held: in a plane oblique to x the joint slides at right angles to x's trace."""
    turn = TURNS[4]
    frame = placed(grid(), turn)
    fixed = frame.fixed.copy()
    fixed[11, 0] = True
    value = frame.value.copy()
    value[11, 0] = 0.05
    plane = in_plane(replace(frame, fixed=fixed, value=value), turn.apply(Z))
    u = displacement(plane)[:, 11, :3]
    np.testing.assert_allclose(u[:, 0], 0.05, rtol=1e-10)
    np.testing.assert_allclose(u @ turn.apply(Z), 0, atol=1e-14)
    # It still slides.
    assert np.ptp(u[:, 1]) > 1e-5


def test_a_slightly_tilted_axis_of_extrusion_is_not_held_along_the_plane():
    """Fixed z, of which the plane leaves 1e-7, holds nothing in it."""
    frame = grid()
    fixed = frame.fixed.copy()
    fixed[:, 2] = True
    plane = in_plane(replace(frame, fixed=fixed), np.array([1e-7, 0.0, 1.0]))
    np.testing.assert_array_equal(plane.problem.fixed[:, :2], frame.fixed[:, :2])


def test_a_rigid_coupling_stays_in_the_plane():
    """The loaded edge follows one joint, which alone is held in the plane for it."""
    turn = TURNS[4]
    frame = grid()
    coupled = replace(
        frame,
        forces=frame.forces[:1] * (np.arange(12) == 11)[:, None],
        couplings=(Rigid(11, np.array([9, 10])),),
    )
    flat = in_plane(coupled, Z)
    assert not flat.problem.fixed[[9, 10]].any()
    expected = displacement(flat)
    np.testing.assert_allclose(expected[:, :, 2:5], 0, atol=1e-16)
    found = displacement(in_plane(placed(coupled, turn), turn.apply(Z)))
    here = turn.inv().apply(found.reshape(-1, 3)).reshape(found.shape)
    np.testing.assert_allclose(here, expected, atol=1e-10 * np.abs(expected).max())


def test_a_clamped_column_of_walls_buckles_in_its_plane():
    """π² E I/(4 L²), I = b t³/12, of a wall thinner across its plane: the plane holds it there."""
    L, t, depth, elements = 40.0, 1.0, 0.2, 6
    joints = np.linspace(0, L, elements + 1)[:, None] * np.array([[1.0, 0, 0]])
    fixed = np.zeros((elements + 1, 6), bool)
    fixed[0] = True
    forces = np.zeros((1, elements + 1, 6))
    forces[0, -1, 0] = -1.0
    column = FrameProblem(
        joints=joints,
        struts=np.stack([np.arange(elements), np.arange(1, elements + 1)], axis=1),
        radii=np.full((elements, 2), t / 2),
        E=E,
        nu=NU,
        section=Wall(depth=depth, shear_factor=float("inf")),
        fixed=fixed,
        value=np.zeros(fixed.shape),
        forces=forces,
    )
    found = buckling(solve_frame(in_plane(column, Z).problem), modes=2).factors
    # The next mode of a cantilever is nine times higher. Six elements to a quarter wave err by 6e-6, and
    # with the fourth power of their share of a wave.
    expected = np.pi**2 * E * depth * t**3 / 12 / (4 * L**2) * np.array([1, 9])
    np.testing.assert_allclose(found, expected, rtol=6e-4)


def test_compliance_can_be_differentiated_by_thickness():
    """Central differences; loads do not change."""
    problem = in_plane(grid(), Z).problem
    gradient = compliance_gradient(solve_frame(problem))["radii"]
    by, h = np.random.default_rng(3).normal(size=problem.radii.shape), 1e-6
    plus, minus = (
        solve_frame(replace(problem, radii=problem.radii + step * by)).compliance
        for step in (h, -h)
    )
    expected = (plus - minus) / (2 * h)
    np.testing.assert_allclose((gradient * by).sum(), expected.sum(), rtol=1e-6)


# Refusals --------------------------------------------------------------------------------------


def loaded(row: list[float]) -> FrameProblem:
    frame = grid()
    forces = frame.forces.copy()
    forces[1, 10] = row
    return replace(frame, forces=forces)


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(
    ("row", "says"),
    [
        ([1.0, 0, 0.01, 0, 0, 0], r"case 1 acts on joint 10 .* with 0.01 N along .* plates"),
        (
            [1.0, 0, 0, 0.5, 0, 0],
            r"case 1 acts on joint 10 .* 0.5 N mm about an axis across .* plates",
        ),
    ],
)
def test_loads_out_of_the_plane_are_refused_with_the_reason(turn, row, says):
    with pytest.raises(FeaError, match=says):
        in_plane(placed(loaded(row), turn), turn.apply(Z))


def test_rounding_of_the_loads_is_let_pass():
    plane = in_plane(loaded([1.0, 0, 1e-9, 1e-9, 0, 0]), Z)
    np.testing.assert_array_equal(plane.problem.forces[..., 2:5], 0)


def test_loads_between_joints_out_of_the_plane_are_refused():
    frame = grid()
    load = np.zeros((2, len(frame.struts), 3, 3))
    load[0, 4, 1] = [0, 0, 0.1]
    with pytest.raises(FeaError, match=r"case 0 acts on strut 4 with 0.1 N/mm along .* plates"):
        in_plane(replace(frame, strut_loads=load), Z)


@pytest.mark.parametrize("turn", [TURNS[0], TURNS[4]])
@pytest.mark.parametrize("dof", [2, 3])
def test_prescribed_motions_out_of_the_plane_are_refused(turn, dof):
    frame = grid()
    value = frame.value.copy()
    value[1, dof] = 0.1
    with pytest.raises(FeaError, match=r"support of joint 1 .* out of the plane .* plates"):
        in_plane(placed(replace(frame, value=value), turn), turn.apply(Z))


def test_supports_along_two_oblique_directions_are_refused():
    """In the plane normal to (1, 1, 1) the traces of x and y are at 120 degrees."""
    turn = Rotation.align_vectors([[1.0, 1, 1]], [Z])[0]
    frame = placed(grid(), turn)
    fixed = frame.fixed.copy()
    fixed[10, 0] = fixed[11, 1] = True
    with pytest.raises(FeaError, match=r"joint 1[01] .* oblique to that of another"):
        in_plane(replace(frame, fixed=fixed), turn.apply(Z))


def test_a_joint_out_of_the_plane_is_refused():
    joints = grid().joints.copy()
    joints[7, 2] += 0.01
    with pytest.raises(FeaError, match=r"Joint 7 .* lies 0.01 mm out of the plane"):
        in_plane(replace(grid(), joints=joints), Z)


def test_a_skin_and_no_axis_are_refused():
    skin = Skin(np.array([[0, 1, 2]]), np.ones(1), E, NU)
    with pytest.raises(FeaError, match="skin, which bends out of it"):
        in_plane(replace(grid(), skin=skin), Z)
    with pytest.raises(FeaError, match=r"axis of extrusion is \(0, 0, 0\)"):
        in_plane(grid(), np.zeros(3))


def test_walls_that_are_not_held_in_a_plane_are_refused():
    with pytest.raises(FeaError, match=r"not held in its plane; .* fea.in_plane"):
        solve_frame(grid())
    # Negative control: the same bars are solved.
    solve_frame(replace(grid(), section=Round()))


def test_walls_that_are_held_by_hand_are_checked_too():
    problem = in_plane(grid(), Z).problem
    forces = problem.forces.copy()
    forces[0, 11, 2] = 1.0
    with pytest.raises(FeaError, match="with 1 N along"):
        solve_frame(replace(problem, forces=forces))
    value = problem.value.copy()
    value[4, 2] = 1e-3
    with pytest.raises(FeaError, match="support of joint 4"):
        solve_frame(replace(problem, value=value))
