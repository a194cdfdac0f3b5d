"""What an elasticity matrix says of directions, anisotropy and averages; bounds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fea.effective_stiffness import EffectiveStiffness
from fea.errors import FeaError
from fea.materials import Material, Orthotropic
from fea.stiffness_bounds import hashin_shtrikman_bound, voigt_bound

STEEL = EffectiveStiffness(Material(210e3, 0.3, 7.85e-9).stiffness)
WOOD = Orthotropic((12e3, 900.0, 500.0), (0.35, 0.4, 0.45), (40.0, 700.0, 800.0), 5e-10)


def cubic(c11: float, c12: float, c44: float) -> EffectiveStiffness:
    C = np.diag([c11 - c12] * 3 + [c44] * 3)
    C[:3, :3] += c12
    return EffectiveStiffness(C)


# GPa; Simmons, Wang, Single Crystal Elastic Constants (1971).
COPPER = cubic(168.4, 121.4, 75.4)
ALUMINIUM = cubic(107.3, 60.9, 28.3)

angles = st.tuples(*[st.floats(-3, 3)] * 3)


def test_an_isotropic_stiffness_is_the_same_in_all_directions():
    n = np.random.default_rng(0).normal(size=(20, 3))
    m = np.cross(n, [0.3, -0.2, 0.9])
    np.testing.assert_allclose(STEEL.youngs_modulus(n), 210e3, rtol=1e-12)
    np.testing.assert_allclose(STEEL.poissons_ratio(n, m), 0.3, rtol=1e-11)
    np.testing.assert_allclose(STEEL.shear_modulus(n, m), 210e3 / 2.6, rtol=1e-12)
    np.testing.assert_allclose(STEEL.zener_ratio, 1, rtol=1e-12)
    np.testing.assert_allclose(STEEL.universal_anisotropy, 0, atol=1e-12)
    for average in (STEEL.voigt_average, STEEL.reuss_average, STEEL.hill_average):
        np.testing.assert_allclose((average.E, average.nu), (210e3, 0.3), rtol=1e-12)


def test_copper_is_as_anisotropic_as_published():
    """Zener ratio 3.2, E100 = 66.7, E110 = 130, E111 = 191 GPa: Hertzberg, Deformation, table 1.3."""
    E = COPPER.youngs_modulus(np.array([[1.0, 0, 0], [1, 1, 0], [1, 1, 1]]))
    np.testing.assert_allclose(E, [66.7, 130.3, 191.1], rtol=2e-3)
    np.testing.assert_allclose(COPPER.zener_ratio, 3.21, atol=5e-3)


@pytest.mark.parametrize("crystal", [COPPER, ALUMINIUM])
def test_universal_anisotropy_of_a_cubic_crystal_follows_from_zeners_ratio(crystal):
    """6/5 (sqrt(A) - 1/sqrt(A))^2: Ranganathan, Ostoja-Starzewski, PRL 101 (2008) 055504, eq. 14."""
    A = crystal.zener_ratio
    expected = 1.2 * (np.sqrt(A) - 1 / np.sqrt(A)) ** 2
    np.testing.assert_allclose(crystal.universal_anisotropy, expected, rtol=1e-11)


def test_averages_of_a_cubic_crystal():
    """Hill, Proc. Phys. Soc. A 65 (1952) 349: G_V = (C11 - C12 + 3 C44)/5, bulk moduli agree."""
    c11, c12, c44 = COPPER.cubic
    np.testing.assert_allclose(COPPER.voigt_average.shear, (c11 - c12 + 3 * c44) / 5, rtol=1e-12)
    soft = 5 * (c11 - c12) * c44 / (4 * c44 + 3 * (c11 - c12))
    np.testing.assert_allclose(COPPER.reuss_average.shear, soft, rtol=1e-12)
    np.testing.assert_allclose(COPPER.bulk_modulus, (c11 + 2 * c12) / 3, rtol=1e-12)
    np.testing.assert_allclose(COPPER.voigt_average.bulk, COPPER.bulk_modulus, rtol=1e-12)


def test_constants_of_an_orthotropic_material_come_back():
    constants = EffectiveStiffness(WOOD.stiffness).engineering_constants
    np.testing.assert_allclose(constants.E, WOOD.E, rtol=1e-12)
    np.testing.assert_allclose(constants.nu, WOOD.nu, rtol=1e-12)
    np.testing.assert_allclose(constants.G, WOOD.G, rtol=1e-12)
    again = EffectiveStiffness(WOOD.stiffness).as_material(5e-10)
    np.testing.assert_allclose(again.stiffness, WOOD.stiffness, rtol=1e-10, atol=1e-9)


@settings(max_examples=20, derandomize=True, deadline=None)
@given(angles)
def test_directions_turn_with_the_stiffness_and_averages_stay(turn):
    R = Rotation.from_rotvec(turn).as_matrix()
    wood = EffectiveStiffness(WOOD.stiffness)
    turned = wood.turned(R)
    n = np.random.default_rng(1).normal(size=(5, 3))
    m = np.cross(n, [0.1, 0.5, 0.3])
    # Conditioned by the ratio of the moduli, 300.
    np.testing.assert_allclose(turned.youngs_modulus(n @ R.T), wood.youngs_modulus(n), rtol=1e-10)
    np.testing.assert_allclose(
        turned.poissons_ratio(n @ R.T, m @ R.T), wood.poissons_ratio(n, m), rtol=1e-9, atol=1e-10
    )
    np.testing.assert_allclose(
        turned.shear_modulus(n @ R.T, m @ R.T), wood.shear_modulus(n, m), rtol=1e-10
    )
    np.testing.assert_allclose(turned.universal_anisotropy, wood.universal_anisotropy, rtol=1e-9)
    np.testing.assert_allclose(turned.hill_average.E, wood.hill_average.E, rtol=1e-10)


def test_the_surface_holds_the_extremes_of_a_cubic_crystal():
    surface = COPPER.directional_modulus(steps=12)
    assert len(surface.directions) == 4 * 12**2 + 2
    np.testing.assert_allclose(np.linalg.norm(surface.directions, axis=1), 1, rtol=1e-14)
    np.testing.assert_allclose(surface.softest, [1, 0, 0], atol=1e-14)
    np.testing.assert_allclose(surface.stiffest, np.ones(3) / np.sqrt(3), rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(surface.vertices, axis=1), surface.E, rtol=1e-12)


def test_the_surface_is_closed_and_faces_outwards():
    surface = STEEL.directional_modulus(steps=24)
    edges = np.concatenate([surface.faces[:, [i, (i + 1) % 3]] for i in range(3)])
    # Every edge once in each direction.
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert set(map(tuple, edges.tolist())) == set(map(tuple, edges[:, ::-1].tolist()))
    a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2)
    volume = np.einsum("fi,fi->", a, np.cross(b, c)) / 6
    # A polyhedron of 4,608 faces in the sphere.
    np.testing.assert_allclose(volume, 4 / 3 * np.pi * 210e3**3, rtol=4e-3)


def test_symmetry_is_told():
    assert COPPER.departure_from_cubic < 1e-14
    turned = COPPER.turned(Rotation.from_euler("xyz", [0.3, -0.5, 0.2]).as_matrix())
    assert turned.departure_from_cubic > 0.05
    assert turned.departure_from_orthotropy > 0.05
    assert EffectiveStiffness(WOOD.stiffness).departure_from_orthotropy < 1e-14
    with pytest.raises(FeaError, match="Zener's ratio is defined for cubic"):
        turned.zener_ratio  # noqa: B018
    with pytest.raises(FeaError, match="differs from an orthotropic one"):
        turned.as_material(1e-9)


def test_the_norm_of_what_is_not_cubic_does_not_change_as_axes_are_exchanged():
    wood = EffectiveStiffness(WOOD.stiffness)
    exchanged = wood.turned(np.roll(np.eye(3), 1, axis=0))
    np.testing.assert_allclose(
        exchanged.departure_from_cubic, wood.departure_from_cubic, rtol=1e-12
    )


def test_impossible_stiffnesses_are_refused():
    C = STEEL.C.copy()
    with pytest.raises(FeaError, match="finite"):
        EffectiveStiffness(C * np.nan)
    skew = C.copy()
    skew[0, 1] += 1.0
    with pytest.raises(FeaError, match="not symmetric: entries differ by 1 MPa"):
        EffectiveStiffness(skew)
    soft = C.copy()
    soft[5] = soft[:, 5] = 0.0
    with pytest.raises(FeaError, match=r"does not resist the strain 1 xy \(stiffness 0"):
        EffectiveStiffness(soft)
    with pytest.raises(FeaError, match="no length"):
        STEEL.youngs_modulus(np.zeros(3))
    with pytest.raises(FeaError, match="not at right angles"):
        STEEL.poissons_ratio(np.array([1.0, 0, 0]), np.array([1.0, 1, 0]))


def test_bounds_end_at_the_solid_and_at_nothing():
    solid = hashin_shtrikman_bound(210e3, 0.3, 1.0)
    np.testing.assert_allclose((solid.E, solid.nu), (210e3, 0.3), rtol=1e-12)
    empty = hashin_shtrikman_bound(210e3, 0.3, 0.0)
    np.testing.assert_allclose((empty.bulk, empty.shear), 0, atol=1e-9)
    with pytest.raises(FeaError, match=r"relative density is 1.2"):
        hashin_shtrikman_bound(1.0, 0.3, 1.2)
    with pytest.raises(FeaError, match=r"relative density is -0.1"):
        voigt_bound(1.0, -0.1)


@settings(max_examples=20, derandomize=True, deadline=None)
@given(st.floats(0.01, 0.99), st.floats(-0.5, 0.49))
def test_an_isotropic_solid_with_voids_is_softer_than_a_bundle_of_fibres(density, nu):
    """Hashin and Shtrikman's bound lies below Voigt's."""
    assert 0 < hashin_shtrikman_bound(1.0, nu, density).E < voigt_bound(1.0, density)
