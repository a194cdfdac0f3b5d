"""Frames against textbook answers and closed forms."""

import numpy as np
import pytest

from fea.frame import FrameProblem, FrameSolution, solve_frame
from fea.sections import AbstractSection, Given, Round


def solved(
    joints: np.ndarray,
    struts: np.ndarray,
    constants: tuple[float, float, AbstractSection],
    *,
    fixed: np.ndarray,
    forces: np.ndarray,
    radius: float = 1.0,
) -> FrameSolution:
    E, nu, section = constants
    return solve_frame(
        FrameProblem(
            joints=joints,
            struts=struts,
            radii=np.full((len(struts), 2), radius),
            E=E,
            nu=nu,
            section=section,
            fixed=fixed,
            value=np.zeros((len(joints), 6)),
            forces=forces[None],
        )
    )


def test_space_frame_of_logan_example_5_8():
    """Logan, A First Course in the Finite Element Method, 4th ed., example 5.8.

    Euler-Bernoulli; one member is vertical. G = 10000 with E = 30000 is nu = 0.5.
    """
    joints = np.array([[0, 0, 0], [-100, 0, 0], [0, 0, -100], [0, -100, 0]], float)
    fixed = np.ones((4, 6), bool)
    fixed[0] = False
    forces = np.zeros((4, 6))
    forces[0] = [0, -50, 0, -1000, 0, 0]
    solution = solved(
        joints,
        np.array([[1, 0], [2, 0], [3, 0]]),
        (30_000.0, 0.5, Given(A=10.0, I=100.0, J=50.0)),
        fixed=fixed,
        forces=forces,
    )
    expected = [7.098258e-5, -1.399513e-2, -2.351889e-3, -3.996090e-3, 1.780069e-5, -1.033429e-4]
    # The book's seven digits.
    np.testing.assert_allclose(solution.displacement[0, 0], expected, rtol=1e-6)


def test_gable_frame_of_logan_problem_5_30():
    """Logan, 4th ed., problem 5.30: reactions and the deflection of joint 2.

    A plane frame: displacements along z and rotations about x and y are held.
    """
    joints = np.array(
        [[0, 0, 0], [0, 360, 0], [180, 480, 0], [420, 480, 0], [600, 360, 0], [600, 0, 0]], float
    )
    struts = np.stack([np.arange(5), np.arange(1, 6)], axis=1)
    fixed = np.tile(np.array([0, 0, 1, 1, 1, 0], bool), (6, 1))
    fixed[[0, 5]] = True
    forces = np.zeros((6, 6))
    forces[[2, 3], 1] = -30
    solution = solved(
        joints,
        struts,
        (30_000.0, 0.3, Given(A=12.0, I=200.0, J=1.0)),
        fixed=fixed,
        forces=forces,
    )
    reaction = solution.reaction[0, 0, [0, 1, 5]]
    np.testing.assert_allclose(np.abs(reaction), [11.6877, 30, 1810.0745], rtol=1e-5)
    np.testing.assert_allclose(solution.displacement[0, 2, 1], -6.666757, rtol=1e-6)


@pytest.mark.parametrize("axis", [[1.0, 0, 0], [0, 0, 1.0], [0, 0, -1.0], [1.0, 2, -2]])
@pytest.mark.parametrize("elements", [1, 4])
@pytest.mark.parametrize("shear_factor", [None, 0.9])
def test_timoshenko_cantilever_tip_deflection(axis, elements, shear_factor):
    """P L³/(3 E I) + P L/(kappa G A), exact in one element, in any direction."""
    L, r, P, E, nu = 30.0, 2.0, 7.0, 70_000.0, 0.33
    t = np.array(axis) / np.linalg.norm(axis)
    across = np.cross(t, [0.3, 0.5, 0.7])
    across /= np.linalg.norm(across)
    joints = np.linspace(0, L, elements + 1)[:, None] * t
    fixed = np.zeros((elements + 1, 6), bool)
    fixed[0] = True
    forces = np.zeros((elements + 1, 6))
    forces[-1, :3] = P * across
    section = Round(shear_factor=shear_factor)
    struts = np.stack([np.arange(elements), np.arange(1, elements + 1)], axis=1)
    solution = solved(joints, struts, (E, nu, section), fixed=fixed, forces=forces, radius=r)
    I, A, G = np.pi * r**4 / 4, np.pi * r**2, E / (2 * (1 + nu))
    kappa = 0.9 if shear_factor else 6 * (1 + nu) / (7 + 6 * nu)
    expected = P * L**3 / (3 * E * I) + P * L / (kappa * G * A)
    np.testing.assert_allclose(solution.displacement[0, -1, :3] @ across, expected, rtol=1e-10)
    np.testing.assert_allclose(solution.compliance[0], P * expected, rtol=1e-10)


def test_extension_and_twist_of_a_bar():
    """F L/(E A) and T L/(G J)."""
    L, r, E, nu = 30.0, 2.0, 70_000.0, 0.33
    joints = np.array([[0, 0, 0], [0, 0, L]])
    fixed = np.array([[True] * 6, [False] * 6])
    forces = np.zeros((2, 6))
    forces[1] = [0, 0, 11.0, 0, 0, 13.0]
    solution = solved(
        joints, np.array([[0, 1]]), (E, nu, Round()), fixed=fixed, forces=forces, radius=r
    )
    A, J, G = np.pi * r**2, np.pi * r**4 / 2, E / (2 * (1 + nu))
    expected = [11.0 * L / (E * A), 13.0 * L / (G * J)]
    np.testing.assert_allclose(solution.displacement[0, 1, [2, 5]], expected, rtol=1e-12)
