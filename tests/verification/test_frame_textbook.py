"""Frames against closed forms, beyond the targets."""

import numpy as np
import pytest

from fea.frame import FrameProblem, FrameSolution, solve_frame
from fea.section_forces import member_forces
from fea.sections import AbstractSection, Given, Round


def solved(
    joints: np.ndarray,
    struts: np.ndarray,
    constants: tuple[float, float, AbstractSection],
    *,
    fixed: np.ndarray,
    forces: np.ndarray,
    radius: float = 1.0,
    radii: np.ndarray | None = None,
    strut_loads: np.ndarray | None = None,
) -> FrameSolution:
    E, nu, section = constants
    return solve_frame(
        FrameProblem(
            joints=joints,
            struts=struts,
            radii=np.full((len(struts), 2), radius) if radii is None else radii,
            E=E,
            nu=nu,
            section=section,
            fixed=fixed,
            value=np.zeros((len(joints), 6)),
            forces=forces[None],
            strut_loads=None if strut_loads is None else strut_loads[None],
        )
    )


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


def test_tapered_cantilever_of_a_cone():
    """4 F L³/(3 π E r_a³ r_b), r_a at the clamp, r_b at the loaded tip: the integral of x²/(E I)."""
    L, E, F, clamped, tip = 30.0, 70_000.0, 7.0, 2.0, 1.0
    fixed = np.array([[True] * 6, [False] * 6])
    forces = np.zeros((2, 6))
    forces[1, 1] = F
    solution = solved(
        np.array([[0, 0, 0], [L, 0, 0]]),
        np.array([[0, 1]]),
        (E, 0.3, Round(shear_factor=float("inf"))),
        fixed=fixed,
        forces=forces,
        radii=np.array([[clamped, tip]]),
    )
    expected = F * L**3 / (3 * E * np.pi / 4 * clamped**3 * tip)
    np.testing.assert_allclose(solution.displacement[0, 1, 1], expected, rtol=1e-10)


def test_portal_frame_under_a_uniform_load_on_its_beam():
    """Fixed bases, E I and L equal: corner moment w L²/18, half of it at the base.

    The portal with fixed bases of Kleinlogel, Rigid Frame Formulas, with k = 1: w L²/(6 (k + 2)) and
    w L²/(12 (k + 2)), axial deformation neglected, so the area is large. The moment in the middle of
    the beam is w L²/8 less that of the corners.
    """
    L, w = 100.0, 3.0
    joints = np.array([[0, 0, 0], [0, L, 0], [L, L, 0], [L, 0, 0]])
    struts = np.array([[0, 1], [1, 2], [2, 3]])
    fixed = np.tile(np.array([0, 0, 1, 1, 1, 0], bool), (4, 1))
    fixed[[0, 3]] = True
    load = np.zeros((3, 3, 3))
    load[1, :, 1] = -w
    solution = solved(
        joints,
        struts,
        (30_000.0, 0.3, Given(A=1e6, I=50.0, J=1.0)),
        fixed=fixed,
        forces=np.zeros((4, 6)),
        strut_loads=load,
    )
    beam = member_forces(solution, points=3).moment[0, 1, :, 2]
    # What is left of axial deformation is I/(A L²) = 5e-9 of bending.
    np.testing.assert_allclose(beam / (w * L**2), [-1 / 18, 1 / 8 - 1 / 18, -1 / 18], rtol=1e-6)
    np.testing.assert_allclose(solution.reaction[0, 0, 1], w * L / 2, rtol=1e-6)
    np.testing.assert_allclose(np.abs(solution.reaction[0, [0, 3], 5]), w * L**2 / 36, rtol=1e-6)
