"""Sections against the formulas and numbers of textbooks."""

from functools import partial

import numpy as np
import pytest

from fea.errors import FeaError
from fea.sections import Given, Round, Square, Tube, Wall, section


def test_round_section_has_the_textbook_constants():
    r = np.array([0.5, 2.0])
    np.testing.assert_allclose(Round().area(r), np.pi * r**2, rtol=1e-15)
    np.testing.assert_allclose(Round().second_moment(r), np.pi * (2 * r) ** 4 / 64, rtol=1e-15)
    np.testing.assert_allclose(Round().torsion_constant(r), np.pi * (2 * r) ** 4 / 32, rtol=1e-15)


def test_square_torsion_agrees_with_saint_venants_series():
    """J = s^4 (1/3 - 64/pi^5 sum tanh(n pi/2)/n^5): Timoshenko and Goodier, section 109."""
    n = np.arange(1, 40, 2)
    series = 1 / 3 - 64 / np.pi**5 * np.sum(np.tanh(n * np.pi / 2) / n**5)
    peak = 1 - 8 / np.pi**2 * np.sum(1 / (n**2 * np.cosh(n * np.pi / 2)))
    side = 2.0
    # Six digits are what the tabulated constants have.
    np.testing.assert_allclose(Square().torsion_constant(np.ones(1)), series * side**4, rtol=5e-6)
    np.testing.assert_allclose(
        Square().torsion_modulus(np.ones(1)), series / peak * side**3, rtol=5e-6
    )


@pytest.mark.parametrize(
    ("shape", "nu", "kappa"),
    [
        (Round(), 0.3, 0.886364),
        (Square(), 0.3, 0.849673),
        (Round(), 0.0, 6 / 7),
        (Square(), 0.0, 5 / 6),
        (Tube(ratio=0.0), 0.3, 0.886364),
        # Of any rectangle.
        (Wall(), 0.3, 0.849673),
        # The thin-walled limit 2 (1 + nu)/(4 + 3 nu).
        (Tube(ratio=1 - 1e-7), 0.3, 2.6 / 4.9),
    ],
)
def test_shear_factor_is_cowpers_by_default(shape, nu, kappa):
    """Cowper, J. Appl. Mech. 33 (1966) 335, table 1."""
    np.testing.assert_allclose(shape.kappa(nu), kappa, rtol=1e-6)


def test_a_given_shear_factor_replaces_cowpers():
    assert Round(shear_factor=0.9).kappa(0.3) == 0.9


def test_a_tube_without_hole_is_round():
    r = np.array([0.5, 2.0])
    for name in dir(Round()):
        if name.endswith(("area", "moment", "constant", "modulus")) and "unit" not in name:
            values = [getattr(shape, name)(r) for shape in (Tube(ratio=0.0), Round())]
            np.testing.assert_allclose(*values, rtol=1e-15)


def test_a_thin_tube_has_the_constants_of_its_wall():
    """A = 2 π R t, I = π R³ t, J = 2 I; peak shear twice the mean: V Q/(I b) of a thin ring."""
    m = 1 - 1e-6
    tube, outer = Tube(ratio=m), np.array([2.0])
    R, t = (1 + m) / 2 * outer, (1 - m) * outer
    np.testing.assert_allclose(tube.area(outer), 2 * np.pi * R * t, rtol=1e-9)
    np.testing.assert_allclose(tube.second_moment(outer), np.pi * R**3 * t, rtol=1e-9)
    np.testing.assert_allclose(tube.torsion_constant(outer), 2 * np.pi * R**3 * t, rtol=1e-9)
    np.testing.assert_allclose(tube.shear_modulus_area(outer), tube.area(outer) / 2, rtol=1e-9)


@pytest.mark.parametrize("m", [0.2, 0.7])
def test_peak_shear_of_a_tube_is_v_q_over_i_b(m):
    """Q of the half ring by quadrature of y dA, b twice the wall."""
    outer, angle = 2.0, np.linspace(0, np.pi, 20_001)
    Q = (outer**3 - (m * outer) ** 3) / 3 * np.trapezoid(np.sin(angle), angle)
    tube, r = Tube(ratio=m), np.array([outer])
    expected = tube.second_moment(r) * 2 * (1 - m) * outer / Q
    np.testing.assert_allclose(tube.shear_modulus_area(r), expected, rtol=1e-8)


def test_moduli_of_a_tube_are_those_of_the_outer_fibre():
    tube, r = Tube(ratio=0.6), np.array([1.7])
    np.testing.assert_allclose(tube.bending_modulus(r), tube.second_moment(r) / r)
    np.testing.assert_allclose(tube.torsion_modulus(r), tube.torsion_constant(r) / r)


@pytest.mark.parametrize("ratio", [1.0, -0.1, float("nan")])
def test_a_tube_without_wall_is_refused(ratio):
    with pytest.raises(FeaError, match="0 <= ratio < 1"):
        Tube(ratio=ratio)


@pytest.mark.parametrize("shape", [Round(), Square(), Tube(ratio=0.5)])
def test_sections_taper_by_their_size(shape):
    r = np.array([0.5, 2.0])
    np.testing.assert_array_equal(shape.size(r), r)
    np.testing.assert_allclose(np.diff(np.log(shape.area(r))), 2 * np.log(4))
    np.testing.assert_allclose(np.diff(np.log(shape.second_moment(r))), 4 * np.log(4))


def test_a_wall_has_the_constants_of_its_rectangle():
    """A strip of height t = 2 r, width b: A = t b, I = b t³/12, W = b t²/6; peak shear 3/2 V/A."""
    r, depth = np.array([0.5, 2.0]), 3.0
    t, wall = 2 * r, Wall(depth=depth)
    np.testing.assert_allclose(wall.area(r), t * depth, rtol=1e-15)
    np.testing.assert_allclose(wall.second_moment(r), depth * t**3 / 12, rtol=1e-15)
    np.testing.assert_allclose(wall.bending_modulus(r), depth * t**2 / 6, rtol=1e-15)
    np.testing.assert_allclose(wall.shear_modulus_area(r), t * depth / 1.5, rtol=1e-15)
    # The outermost fibre is the radius away.
    np.testing.assert_allclose(wall.bending_modulus(r), wall.second_moment(r) / r, rtol=1e-15)


@pytest.mark.parametrize("depth", [0.0, -1.0, float("nan"), float("inf")])
def test_a_wall_without_depth_is_refused(depth):
    with pytest.raises(FeaError, match=r"depth = .* positive"):
        Wall(depth=depth)


def test_a_given_section_does_not_taper():
    np.testing.assert_array_equal(Given(A=2.0, I=3.0, J=4.0).area(np.array([0.5, 2.0])), 2.0)


def test_unknown_sections_are_refused_with_the_known_ones():
    with pytest.raises(FeaError, match="round, square, wall"):
        section("hexagon")


def test_a_section_of_unknown_shape_has_no_shear_factor_of_its_own():
    with pytest.raises(FeaError, match="must be given"):
        Given(A=1.0, I=1.0, J=1.0, shear_factor=None).kappa(0.3)


@pytest.mark.parametrize("kappa", [0.0, -1.0, float("nan")])
@pytest.mark.parametrize("shape", [Round, Square, Wall, partial(Tube, ratio=0.5)])
def test_a_shear_factor_that_is_none_is_refused(shape, kappa):
    with pytest.raises(FeaError, match=r"shear_factor = .* must be positive"):
        shape(shear_factor=kappa)


@pytest.mark.parametrize("name", ["A", "I", "J"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_constants_that_no_section_has_are_refused(name, value):
    with pytest.raises(FeaError, match=rf"{name} = .* positive"):
        Given(**({"A": 1.0, "I": 1.0, "J": 1.0} | {name: value}))
