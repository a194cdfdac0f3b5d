"""Constants of a sheet from its elasticity matrix: isotropy, rotation, averages, bounds, bad input."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fea.effective_stiffness import EffectiveStiffness
from fea.errors import FeaError
from fea.plane_stiffness import PlaneStiffness
from fea.stiffness_bounds import (
    PlaneModuli,
    extruded_modulus,
    hashin_shtrikman_bound,
    plane_hashin_shtrikman_bound,
)


def isotropic(E: float = 200.0, nu: float = 0.3) -> PlaneStiffness:
    C = E / (1 - nu**2) * np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])
    return PlaneStiffness(C)


def anything(seed: int = 0) -> PlaneStiffness:
    root = np.random.default_rng(seed).normal(size=(3, 3))
    return PlaneStiffness(root @ root.T + 0.3 * np.eye(3))


ANGLES = np.linspace(0, np.pi, 7)
DIRECTIONS = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)


def test_an_isotropic_sheet_has_its_constants_in_every_direction():
    sheet = isotropic()
    np.testing.assert_allclose(sheet.youngs_modulus(3 * DIRECTIONS), 200.0, rtol=1e-12)
    np.testing.assert_allclose(sheet.poissons_ratio(DIRECTIONS), 0.3, rtol=1e-12)
    np.testing.assert_allclose(sheet.shear_modulus(DIRECTIONS), 200 / 2.6, rtol=1e-12)
    constants = sheet.engineering_constants
    np.testing.assert_allclose([constants.nu_xy, constants.nu_yx], 0.3, rtol=1e-12)
    assert sheet.is_isotropic
    assert abs(sheet.universal_anisotropy) < 1e-12
    for average in (sheet.voigt_average, sheet.reuss_average):
        np.testing.assert_allclose([average.E, average.nu], [200, 0.3], rtol=1e-12)


@settings(max_examples=20, derandomize=True, deadline=None)
@given(st.integers(0, 1000), st.floats(-7, 7))
def test_turning_the_sheet_turns_its_constants(seed, angle):
    sheet = anything(seed)
    turned = sheet.turned(angle)
    c, s = np.cos(angle), np.sin(angle)
    directions = DIRECTIONS @ np.array([[c, s], [-s, c]])
    for name in ("youngs_modulus", "poissons_ratio", "shear_modulus"):
        np.testing.assert_allclose(
            getattr(turned, name)(directions), getattr(sheet, name)(DIRECTIONS), rtol=1e-7
        )
    for name in ("voigt_average", "reuss_average"):
        a, b = getattr(turned, name), getattr(sheet, name)
        np.testing.assert_allclose([a.area, a.shear], [b.area, b.shear], rtol=1e-7)
    np.testing.assert_allclose(turned.universal_anisotropy, sheet.universal_anisotropy, rtol=1e-6)
    assert sheet.universal_anisotropy > 0
    np.testing.assert_allclose(
        turned.departure_from_isotropy, sheet.departure_from_isotropy, rtol=1e-7
    )


@settings(max_examples=20, derandomize=True, deadline=None)
@given(st.integers(0, 1000))
def test_constants_are_those_of_a_solid_that_is_loose_from_the_plane(seed):
    """A 3-D stiffness without coupling to z has the same constants in the plane."""
    sheet = anything(seed)
    C = np.eye(6)
    C[np.ix_([0, 1, 5], [0, 1, 5])] = sheet.C
    solid = EffectiveStiffness(C)
    flat = np.pad(DIRECTIONS, ((0, 0), (0, 1)))
    across = np.cross([0.0, 0, 1], flat)
    np.testing.assert_allclose(
        sheet.youngs_modulus(DIRECTIONS), solid.youngs_modulus(flat), rtol=1e-9
    )
    np.testing.assert_allclose(
        sheet.poissons_ratio(DIRECTIONS), solid.poissons_ratio(flat, across), rtol=1e-7, atol=1e-9
    )
    np.testing.assert_allclose(
        sheet.shear_modulus(DIRECTIONS), solid.shear_modulus(flat, across), rtol=1e-9
    )
    found, expected = sheet.engineering_constants, solid.engineering_constants
    np.testing.assert_allclose(found.E, expected.E[:2], rtol=1e-9)
    np.testing.assert_allclose([found.nu_xy, found.G], [expected.nu[2], expected.G[2]], rtol=1e-7)
    # Maxwell's reciprocity.
    np.testing.assert_allclose(found.nu_xy / found.E[0], found.nu_yx / found.E[1], rtol=1e-9)


def test_averages_are_means_over_all_directions():
    """Voigt's of the stiffness, Reuss's of the compliance; the mean of 1/E is the isotropic one's."""
    sheet = anything(3)
    angles = np.linspace(0, np.pi, 8, endpoint=False)
    stiff = np.mean([sheet.turned(a).C for a in angles], axis=0)
    voigt = PlaneStiffness(stiff)
    assert voigt.is_isotropic
    np.testing.assert_allclose(voigt.engineering_constants.E[0], sheet.voigt_average.E, rtol=1e-10)
    compliance = np.mean([sheet.turned(a).compliance for a in angles], axis=0)
    np.testing.assert_allclose(1 / compliance[0, 0], sheet.reuss_average.E, rtol=1e-10)


def test_polar_modulus_names_stiff_and_soft_directions():
    """Square walls, stiff along x and y; turned by a tenth of a turn."""
    square = PlaneStiffness(np.diag([1.0, 1.0, 0.01]))
    polar = square.polar_modulus()
    assert polar.stiffest == 0
    np.testing.assert_allclose(polar.softest, np.pi / 4, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(polar.points, axis=1), polar.E, rtol=1e-12)
    turned = square.turned(np.pi / 5).polar_modulus()
    np.testing.assert_allclose(turned.softest, np.pi / 5 - np.pi / 4 + np.pi / 2, rtol=1e-12)
    assert not square.is_isotropic
    assert square.departure_from_orthotropy == 0
    assert square.turned(np.pi / 5).departure_from_orthotropy > 0.1


@pytest.mark.parametrize(
    ("C", "says"),
    [
        (np.full((3, 3), np.nan), "give 3 x 3 finite"),
        (np.array([[1.0, 0.1, 0], [0.2, 1, 0], [0, 0, 1]]), "not symmetric"),
        (np.diag([1.0, 1.0, 0.0]), "does not resist the strain 1 xy"),
        (np.array([[1.0, 1, 0], [1, 1, 0], [0, 0, 1]]), r"strain 1 xx \+ -1 yy|-1 xx \+ 1 yy"),
    ],
)
def test_what_is_no_stiffness_is_refused(C, says):
    with pytest.raises(FeaError, match=says):
        PlaneStiffness(C)


def test_a_direction_without_length_is_refused():
    with pytest.raises(FeaError, match="no length"):
        isotropic().youngs_modulus(np.zeros(2))


# Bounds ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("nu", [-0.5, 0.0, 0.3, 0.5])
@pytest.mark.parametrize("density", [0.05, 0.4, 1.0])
def test_youngs_modulus_of_the_plane_bound_does_not_depend_on_nu(nu, density):
    """E rho/(3 - 2 rho); a full sheet is the solid."""
    bound = plane_hashin_shtrikman_bound(70.0, nu, density)
    np.testing.assert_allclose(bound.E, 70 * density / (3 - 2 * density), rtol=1e-13)
    if density == 1:
        np.testing.assert_allclose(bound.nu, nu, atol=1e-14)
    else:
        assert extruded_modulus(70.0, density) > bound.E


def test_the_plane_bound_is_the_general_one_with_an_empty_phase():
    """K + f2/(1/(K2 - K) + f1/(K + G)) and the like (Hashin 1965), K2 = G2 = 0."""
    E, nu, rho = 3.0, 0.25, 0.35
    K, G = E / (2 * (1 - nu)), E / (2 * (1 + nu))
    area = K + (1 - rho) / (-1 / K + rho / (K + G))
    shear = G + (1 - rho) / (-1 / G + rho * (K + 2 * G) / (2 * G * (K + G)))
    found = plane_hashin_shtrikman_bound(E, nu, rho)
    np.testing.assert_allclose([found.area, found.shear], [area, shear], rtol=1e-13)
    # In space walls may be plates, so more can be reached.
    assert hashin_shtrikman_bound(E, nu, rho).E > found.E


def test_moduli_of_the_plane_are_those_of_an_isotropic_sheet():
    K, G = 200 / (2 * 0.7), 200 / 2.6
    moduli = PlaneModuli(K, G)
    np.testing.assert_allclose([moduli.E, moduli.nu], [200, 0.3], rtol=1e-13)


@pytest.mark.parametrize("density", [-0.1, 1.1, float("nan")])
def test_densities_that_are_none_are_refused(density):
    for bound in (
        lambda: plane_hashin_shtrikman_bound(1.0, 0.3, density),
        lambda: extruded_modulus(1.0, density),
    ):
        with pytest.raises(FeaError, match="share from 0 to 1"):
            bound()
