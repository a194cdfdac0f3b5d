"""Buckling and vibration of frames against closed forms, beyond the targets."""

from dataclasses import replace

import numpy as np
import pytest
from frame_cases.stability import (
    AREA,
    DENSITY,
    LENGTH,
    NU,
    RADIUS,
    E,
    I,
    block_factor,
    cantilever,
    lowest_factor,
)
from scipy.linalg import expm
from scipy.optimize import brentq

from fea import Inertia, Round, vibration


def test_shear_lowers_the_load_of_a_column():
    """Engesser: 1/P = 1/P_euler + 1/(kappa G A); Timoshenko, Gere, 2nd ed., chapter 2."""
    thick = Round(shear_factor=0.9)
    column = cantilever(16, section=thick, length=2.0, radius=lambda x: np.full_like(x, 0.3))
    euler = np.pi**2 * E * np.pi / 4 * 0.3**4 / (4 * 2.0**2)
    shear = 0.9 * E / (2 * (1 + NU)) * np.pi * 0.3**2
    # An element bends with the load between its ends but does not shear with it: the error falls with
    # the square of its length only, 5e-4 for 4 elements and 3e-5 for 16.
    np.testing.assert_allclose(lowest_factor(column), 1 / (1 / euler + 1 / shear), rtol=5e-5)
    assert 1 / (1 / euler + 1 / shear) < 0.97 * euler


def test_tapered_column_converges_to_the_cone():
    """Cut cone, I ~ x⁴, clamped at its wide end b from the apex, free at a.

    With m² = P/(E I_a) the deflection solves y'' + m² a⁴/x⁴ y = 0, y = x sin(m a² (1/a - 1/x)), and
    y'(b) = 0 is tan(theta) = -theta a/L, theta = m a L/b (Dinnik; Timoshenko, Gere, 2nd ed., chapter
    2). Shape functions are those of the prismatic strut, so one strut is not enough.
    """
    ratio = 2.0  # of the end radii
    a = LENGTH / (ratio - 1)
    theta = brentq(lambda t: np.sin(t) + t * a / LENGTH * np.cos(t), np.pi / 2, np.pi)
    m = theta * (a + LENGTH) / (a * LENGTH)
    exact = m**2 * E * I
    errors = []
    for elements in (1, 2, 4, 8):
        column = cantilever(elements, radius=lambda x: RADIUS * (ratio - (ratio - 1) * x / LENGTH))
        errors.append(abs(lowest_factor(column) / exact - 1))
    assert errors[0] < 0.05
    assert errors[3] < 1e-4
    assert np.log2(np.array(errors[:-1]) / errors[1:])[-1] > 3.5


def test_rigid_foot_shortens_a_column():
    """What does not deform at the clamp leaves a column of the rest's length."""
    column = cantilever(8)
    rigid = np.zeros((8, 2))
    rigid[0, 0] = 0.9
    euler = np.pi**2 * E * I / (4 * (LENGTH - 0.9) ** 2)
    # The elements are of unequal length: 3e-6 for eight.
    np.testing.assert_allclose(lowest_factor(replace(column, rigid_ends=rigid)), euler, rtol=1e-5)


def test_rigid_head_carries_the_axial_force_too():
    """A rigid bar of length b on a column of length l: tan(k l) = 1/(k b), k² = P/EI.

    From y'' + k² y = k² d with the tip's deflection d = y(l) + b y'(l).
    """
    b = 1.2
    column = cantilever(8)
    rigid = np.zeros((8, 2))
    rigid[-1, 1] = b
    l = LENGTH - b
    k = brentq(lambda k: np.cos(k * l) - k * b * np.sin(k * l), 1e-6, np.pi / 2 / l)
    np.testing.assert_allclose(
        lowest_factor(replace(column, rigid_ends=rigid)), k**2 * E * I, rtol=1e-5
    )


def test_lattice_block_converges_as_its_struts_are_split():
    """Every mesh is in the next one, so factors fall; from two to four elements the error by about 2⁴."""
    one, two, four, eight = (block_factor(n) for n in (1, 2, 4, 8))
    assert one > two > four > eight
    assert 10 < (two - eight) / (four - eight) < 25


def timoshenko_frequencies(length: float, radius: float, kappa: float, count: int) -> list[float]:
    """Angular frequencies of a cantilever by its exact state matrix, without any shape function.

    d/dx of deflection, rotation, moment and shear force (Huang, J. Appl. Mech. 28 (1961) 579-584;
    Han, Benaroya, Wei, J. Sound Vib. 225 (1999) 935-988, section 5): the free end has neither of the
    last two.
    """
    A, second = np.pi * radius**2, np.pi / 4 * radius**4
    G = E / (2 * (1 + NU))

    def determinant(omega: float) -> float:
        state = np.array(
            [
                [0, 1, 0, 1 / (kappa * G * A)],
                [0, 0, 1 / (E * second), 0],
                [0, -DENSITY * second * omega**2, 0, -1],
                [-DENSITY * A * omega**2, 0, 0, 0],
            ]
        )
        scale = np.array([length, 1.0, E * second / length, E * second / length**2])
        return float(np.linalg.det((expm(state * length) / scale[:, None] * scale)[2:, 2:]))

    first = 1.8751**2 * np.sqrt(E * second / (DENSITY * A)) / length**2
    grid = first * np.arange(0.1, 20.0, 0.05)
    values = [determinant(omega) for omega in grid]
    brackets = [i for i in range(len(grid) - 1) if values[i] * values[i + 1] < 0][:count]
    return [float(brentq(determinant, grid[i], grid[i + 1], rtol=1e-13)) for i in brackets]


def test_thick_cantilever_vibrates_as_timoshenko():
    """Shear and rotary inertia lower the third frequency by a sixth.

    Elements far shorter than thick: their shape functions do not shear with the inertia between the ends,
    so that the error falls with the square of their length, to 0.05 % in the third mode.
    """
    length, radius, kappa = 10.0, 0.8, 0.9
    exact = np.array(timoshenko_frequencies(length, radius, kappa, 3)) / (2 * np.pi)
    euler = 7.854757**2 * np.sqrt(E * radius**2 / (4 * DENSITY)) / length**2 / (2 * np.pi)
    assert exact[2] < 0.85 * euler
    section = Round(shear_factor=kappa)
    errors = []
    for elements in (16, 32):
        beam = cantilever(elements, section=section, radius=lambda x: np.full_like(x, radius))
        # Bending comes twice; torsion and extension lie between and above.
        found = vibration(beam, Inertia(DENSITY), modes=10).frequencies
        nearest = found[np.abs(found[:, None] - exact).argmin(axis=0)]
        errors.append(np.abs(nearest / exact - 1))
    assert errors[1].max() < 1e-3
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), 2, atol=0.2)


@pytest.mark.parametrize("kind", ["extension", "torsion"])
def test_bars_sing_as_the_wave_equation_says(kind):
    """A clamped bar: c/(4 L), c² = E/rho along and G/rho about (J = I_p of a round one)."""
    bar = cantilever(16)
    modulus = E if kind == "extension" else E / (2 * (1 + NU))
    free = 2 if kind == "extension" else 5
    fixed = np.ones_like(bar.fixed)
    fixed[1:, free] = False
    bar = replace(bar, joints=np.linspace(0, LENGTH, 17)[:, None] * [[0.0, 0, 1]], fixed=fixed)
    found = vibration(bar, Inertia(DENSITY)).frequencies[0]
    # Linear elements with consistent mass: (pi h/(2 L))²/24 high.
    np.testing.assert_allclose(found, np.sqrt(modulus / DENSITY) / (4 * LENGTH), rtol=5e-4)


def test_free_beam_vibrates_without_supports():
    """Modes beta L = 4.7300, 7.8532, each twice, after the rigid motions; Thomson, appendix D.2."""
    beam = cantilever(16)
    found = vibration(replace(beam, fixed=np.zeros_like(beam.fixed)), Inertia(DENSITY), modes=4)
    roots = np.array([4.730041, 7.853205])
    exact = roots**2 * np.sqrt(E * I / (DENSITY * AREA)) / LENGTH**2 / (2 * np.pi)
    np.testing.assert_allclose(found.frequencies, np.repeat(exact, 2), rtol=2e-3)
