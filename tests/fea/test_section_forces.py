"""Forces and deflection along struts against beam theory."""

from dataclasses import replace

import numpy as np
import pytest

from fea.errors import FeaError
from fea.frame import FrameProblem, FrameSolution, solve_frame
from fea.section_forces import member_forces, strut_deflection
from fea.sections import AbstractSection, Round

L, R, E, NU, W = 40.0, 1.5, 70_000.0, 0.3, 2.0
A, I = np.pi * R**2, np.pi * R**4 / 4
SLENDER = Round(shear_factor=float("inf"))


def beam(
    load: np.ndarray,
    *,
    held: str = "clamped clamped",
    section: AbstractSection = SLENDER,
    radii: tuple[float, float] = (R, R),
    rigid: tuple[float, float] = (0.0, 0.0),
    force: tuple[float, ...] = (0.0,) * 6,
    elements: int = 1,
) -> FrameSolution:
    """A beam along x; the load at three points, the force at its second end."""
    dofs = {"clamped": [1] * 6, "free": [0] * 6, "pinned": [1, 1, 1, 1, 0, 0]}
    fixed = np.zeros((elements + 1, 6), bool)
    fixed[0], fixed[-1] = (np.array(dofs[end], bool) for end in held.split())
    forces = np.zeros((1, elements + 1, 6))
    forces[0, -1] = force
    z = np.linspace(0, 1, 2 * elements + 1)
    basis = np.stack([(1 - z) * (1 - 2 * z), 4 * z * (1 - z), z * (2 * z - 1)], 1)
    values = basis @ load
    at = np.linspace(0, 1, elements + 1)
    radius = radii[0] + (radii[1] - radii[0]) * at
    ends = np.zeros((elements, 2))
    ends[0, 0], ends[-1, 1] = rigid
    return solve_frame(
        FrameProblem(
            joints=np.outer(at * L, [1.0, 0, 0]),
            struts=np.stack([np.arange(elements), np.arange(1, elements + 1)], 1),
            radii=np.stack([radius[:-1], radius[1:]], 1),
            E=E,
            nu=NU,
            section=section,
            fixed=fixed,
            value=np.zeros((elements + 1, 6)),
            forces=forces,
            rigid_ends=ends,
            strut_loads=np.stack([values[0:-1:2], values[1::2], values[2::2]], axis=1)[None],
        )
    )


def uniform(*direction: float) -> np.ndarray:
    return np.tile(W * np.array(direction), (3, 1))


def test_clamped_beam_under_uniform_load():
    """Moments w L²/12 and w L²/24, deflection w L⁴/(384 E I): Roark, table 8.1, case 2d."""
    solution = beam(uniform(0, -1, 0), elements=2)
    forces = member_forces(solution, points=2)
    # Sagging is positive about z: the rotation grows along x.
    moment = W * L**2 * np.array([[-1 / 12, 1 / 24], [1 / 24, -1 / 12]])
    np.testing.assert_allclose(forces.moment[0, :, :, 2], moment, rtol=1e-10)
    # The part beyond the first section carries all it must: upwards on the part before it.
    shear = W * L * np.array([[-1 / 2, 0], [0, 1 / 2]])
    np.testing.assert_allclose(forces.shear[0, :, :, 1], shear, atol=1e-10 * W * L)
    sag = strut_deflection(solution, points=2)[0, :, :, 1]
    lowest = -W * L**4 / (384 * E * I)
    np.testing.assert_allclose(sag, [[0, lowest], [lowest, 0]], rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(forces.position, [[0, L / 2]] * 2)


def test_propped_beam_under_uniform_load():
    """3 w L/8 at the prop, 9 w L²/128 at 5 L/8 from the clamp: Roark, table 8.1, case 2c."""
    solution = beam(uniform(0, -1, 0), held="clamped pinned")
    np.testing.assert_allclose(solution.reaction[0, 1, 1], 3 / 8 * W * L, rtol=1e-10)
    forces = member_forces(solution, points=9)
    np.testing.assert_allclose(forces.moment[0, 0, 0, 2], -W * L**2 / 8, rtol=1e-10)
    np.testing.assert_allclose(forces.moment[0, 0, 5, 2], 9 / 128 * W * L**2, rtol=1e-10)
    np.testing.assert_allclose(forces.moment[0, 0, -1, 2], 0, atol=1e-9)


def test_shear_adds_to_the_deflection_of_a_simple_beam():
    """5 w L⁴/(384 E I) + w L²/(8 kappa G A)."""
    section = Round()
    solution = beam(uniform(0, 0, 1), held="pinned pinned", section=section)
    G = E / (2 * (1 + NU))
    bend, shear = 5 * W * L**4 / (384 * E * I), W * L**2 / (8 * section.kappa(NU) * G * A)
    middle = strut_deflection(solution, points=3)[0, 0, 1, 2]
    np.testing.assert_allclose(middle, bend + shear, rtol=1e-10)
    np.testing.assert_allclose(
        member_forces(solution, points=3).moment[0, 0, 1, 1], W * L**2 / 8, rtol=1e-10
    )


def test_a_hanging_bar_carries_what_is_below():
    """N = w (L - x), extension w L²/(2 E A)."""
    solution = beam(uniform(1, 0, 0), held="clamped free")
    forces = member_forces(solution)
    np.testing.assert_allclose(
        forces.axial[0, 0], W * (L - forces.position[0]), rtol=1e-10, atol=1e-10
    )
    np.testing.assert_allclose(solution.displacement[0, 1, 0], W * L**2 / (2 * E * A), rtol=1e-12)
    middle = strut_deflection(solution, points=3)[0, 0, 1, 0]
    np.testing.assert_allclose(middle, 3 / 8 * W * L**2 / (E * A), rtol=1e-12)


def test_signs_of_forces_at_the_end_of_a_cantilever():
    """What the part beyond exerts: at the tip the load itself, at the clamp moment F L more."""
    load = (11.0, 3.0, -5.0, 7.0, 2.0, -4.0)
    forces = member_forces(beam(uniform(0, 0, 0), held="clamped free", force=load), points=2)
    np.testing.assert_allclose(forces.axial[0, 0], 11.0)
    np.testing.assert_allclose(forces.torque[0, 0], 7.0)
    np.testing.assert_allclose(forces.shear[0, 0], [[0, 3.0, -5.0]] * 2, atol=1e-9)
    moment = [[0, 2 + 5 * L, -4 + 3 * L], [0, 2, -4]]
    np.testing.assert_allclose(forces.moment[0, 0], moment, atol=1e-9)


@pytest.mark.parametrize("held", ["clamped pinned", "clamped free"])
def test_cutting_a_tapered_strut_changes_neither_forces_nor_deflection(held):
    """With rigid ends, shear and a quadratic load: the element and its loads are exact."""
    load = np.random.default_rng(0).normal(size=(3, 3))
    one, four = (
        beam(load, held=held, section=Round(), radii=(R, 0.6), rigid=(3.0, 2.0), elements=n)
        for n in (1, 4)
    )
    cut = member_forces(four, points=3)
    at = cut.position + 10.0 * np.arange(4)[:, None]
    points = 71  # every half millimetre of the 35 mm between the rigid ends
    whole, index = member_forces(one, points=points), np.rint(2 * (at - 3.0)).astype(int)
    np.testing.assert_allclose(whole.position[0, index], at, rtol=1e-13)
    for name in ("axial", "shear", "torque", "moment"):
        expected = getattr(whole, name)[0, 0, index]
        atol = 1e-9 * max(np.abs(expected).max(), 1.0)
        np.testing.assert_allclose(getattr(cut, name)[0], expected, atol=atol)
    expected = strut_deflection(one, points=points)[0, 0, index]
    moved = strut_deflection(four, points=3)[0]
    np.testing.assert_allclose(moved, expected, atol=1e-10 * np.abs(expected).max())


def test_deflection_closes_at_the_second_joint():
    """Integrated from the first, it arrives where the solution says the second end is."""
    load = np.random.default_rng(1).normal(size=(3, 3))
    solution = beam(load, held="clamped free", section=Round(), radii=(R, 0.6), rigid=(3.0, 2.0))
    u, turn = np.split(solution.displacement[0, 1], 2)
    end = u + np.cross(turn, [-2.0, 0, 0])
    np.testing.assert_allclose(strut_deflection(solution)[0, 0, -1], end, rtol=1e-10)


def test_the_last_section_is_what_the_second_joint_exerts():
    frame = beam(uniform(0, -1, 0.5), elements=3).problem
    rng = np.random.default_rng(2)
    joints = frame.joints + rng.normal(size=frame.joints.shape)
    solution = solve_frame(replace(frame, joints=joints, section=Round()))
    forces = member_forces(solution, points=2)
    tip = forces.axial[0, -1, -1] * np.diff(joints[-2:], axis=0)[0]
    tip = tip / np.linalg.norm(np.diff(joints[-2:], axis=0)[0]) + forces.shear[0, -1, -1]
    np.testing.assert_allclose(tip, solution.reaction[0, -1, :3], rtol=1e-9)


def test_some_struts_are_rows_of_all():
    solution = beam(uniform(0, -1, 0), elements=4, radii=(R, 0.6), rigid=(1.0, 0.5))
    all_of_them, some = member_forces(solution), member_forces(solution, struts=np.array([3, 1]))
    for name in ("position", "radius"):
        np.testing.assert_array_equal(getattr(some, name), getattr(all_of_them, name)[[3, 1]])
    np.testing.assert_allclose(some.moment, all_of_them.moment[:, [3, 1]], rtol=1e-12)
    np.testing.assert_allclose(
        strut_deflection(solution, struts=np.array([2])), strut_deflection(solution)[:, [2]]
    )


def test_what_cannot_be_asked_for_is_refused():
    solution = beam(uniform(0, -1, 0), held="clamped free")
    with pytest.raises(FeaError, match="at least 2"):
        member_forces(solution, points=1)
    with pytest.raises(FeaError, match="struts 0 to 0"):
        strut_deflection(solution, struts=np.array([1]))
