"""Stress at strut ends against elementary beam theory."""

import numpy as np
import pytest

from fea.errors import FeaError
from fea.frame import FrameProblem, FrameSolution, solve_frame
from fea.sections import AbstractSection, Round, Square
from fea.strut_strength import end_stress, utilisation

LENGTH, RADIUS = 40.0, 1.5


def cantilever(load: list[float], section: AbstractSection) -> FrameSolution:
    """A strut along an oblique axis, clamped at its first end; the load in its own axes."""
    t, m, n = np.linalg.qr(np.array([[1.0, 2, 3], [0, 1, -1], [2, 0, 1]]).T)[0].T
    frame = np.stack([t, m, n])
    forces = np.zeros((1, 2, 6))
    forces[0, 1] = np.concatenate([np.array(load[:3]) @ frame, np.array(load[3:]) @ frame])
    fixed = np.zeros((2, 6), bool)
    fixed[0] = True
    return solve_frame(
        FrameProblem(
            joints=np.stack([np.zeros(3), LENGTH * t]),
            struts=np.array([[0, 1]]),
            radii=np.full((1, 2), RADIUS),
            E=2.1e5,
            nu=0.3,
            section=section,
            fixed=fixed,
            value=np.zeros((2, 6)),
            forces=forces,
        )
    )


A, W = np.pi * RADIUS**2, np.pi * RADIUS**3 / 4


@pytest.mark.parametrize(
    ("load", "at_clamp", "at_tip"),
    [
        ([100.0, 0, 0, 0, 0, 0], 100 / A, 100 / A),
        ([-100.0, 0, 0, 0, 0, 0], 100 / A, 100 / A),
        # At the tip the peak shear of the transverse force is left: 4/3 of the mean.
        ([0, 3.0, 4.0, 0, 0, 0], 5 * LENGTH / W, np.sqrt(3) * 4 / 3 * 5 / A),
        ([0, 0, 0, 70.0, 0, 0], np.sqrt(3) * 70 / (2 * W), np.sqrt(3) * 70 / (2 * W)),
        ([9.0, 0, 0, 70.0, 30.0, 40.0],) + 2 * (np.hypot(9 / A + 50 / W, np.sqrt(3) * 35 / W),),
    ],
)
def test_round_strut_stress_is_that_of_elementary_beam_theory(load, at_clamp, at_tip):
    stress = end_stress(cantilever(load, Round()))[0, 0]
    np.testing.assert_allclose(stress, [at_clamp, at_tip], rtol=1e-9)


def test_a_square_strut_is_safe_in_every_bending_direction():
    """Bent about a diagonal the largest stress is sqrt(2) times that about a side."""
    stress = end_stress(cantilever([0, 0, 0, 0, 50.0, 0], Square()))[0, 0]
    side = 2 * RADIUS
    np.testing.assert_allclose(stress, np.sqrt(2) * 50 / (side**3 / 6), rtol=1e-9)


def test_utilisation_is_the_worst_stress_over_yield():
    solution = cantilever([0, 5.0, 0, 0, 0, 0], Round())
    np.testing.assert_allclose(utilisation(solution, 200.0), 5 * LENGTH / W / 200, rtol=1e-9)
    with pytest.raises(FeaError, match="must be positive"):
        utilisation(solution, 0.0)
