"""Sections against the formulas and numbers of textbooks."""

import numpy as np
import pytest

from fea.errors import FeaError
from fea.sections import Given, Round, Square, section


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
    ],
)
def test_shear_factor_is_cowpers_by_default(shape, nu, kappa):
    """Cowper, J. Appl. Mech. 33 (1966) 335, table 1."""
    np.testing.assert_allclose(shape.kappa(nu), kappa, rtol=1e-6)


def test_a_given_shear_factor_replaces_cowpers():
    assert Round(shear_factor=0.9).kappa(0.3) == 0.9


def test_unknown_sections_are_refused_with_the_known_ones():
    with pytest.raises(FeaError, match="round, square"):
        section("hexagon")


def test_a_section_of_unknown_shape_has_no_shear_factor_of_its_own():
    with pytest.raises(FeaError, match="must be given"):
        Given(A=1.0, I=1.0, J=1.0, shear_factor=None).kappa(0.3)
