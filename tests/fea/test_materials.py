import numpy as np
import pytest

from fea import FeaError, Material, material, material_names


@pytest.mark.parametrize("name", material_names())
def test_table_holds_plausible_solids_with_a_source(name):
    from fea.materials import TABLE

    m = material(name)
    assert 1e3 < m.E < 3e5
    assert 0.2 < m.nu < 0.45
    assert 0.9e-9 < m.density < 9e-9
    assert m.yield_stress is not None and 0.001 < m.yield_stress / m.E < 0.04
    assert len(TABLE[name][4]) > 10


def test_names_forgive_case_and_hyphens_and_suggest_the_nearest():
    assert material("alsi10mg").name == "AlSi10Mg"
    assert material("Ti-6Al-4V").name == "Ti6Al4V"
    with pytest.raises(FeaError, match='did you mean "AlSi10Mg"'):
        material("AlSi10")
    with pytest.raises(FeaError, match="known: "):
        material("qqqq")


@pytest.mark.parametrize(
    ("E", "nu", "density", "yield_stress"),
    [
        (0.0, 0.3, 1.0, None),
        (float("nan"), 0.3, 1.0, None),
        (1.0, 0.5, 1.0, None),
        (1.0, -1.0, 1.0, None),
        (1.0, float("nan"), 1.0, None),
        (1.0, 0.3, -1.0, None),
        (1.0, 0.3, 1.0, 0.0),
    ],
)
def test_impossible_constants_are_refused(E, nu, density, yield_stress):
    with pytest.raises(FeaError, match="must"):
        Material(E, nu, density, yield_stress)


def test_stiffness_inverts_hookes_law_written_as_compliance():
    """Strains of unit stresses: 1/E, -nu/E, 1/G (Timoshenko and Goodier, section 7)."""
    m = Material(200e3, 0.3, 0.0)
    S = np.diag([1 / m.E] * 3 + [1 / m.shear_modulus] * 3)
    S[:3, :3] -= m.nu / m.E * (1 - np.eye(3))
    np.testing.assert_allclose(m.stiffness @ S, np.eye(6), atol=1e-14)
