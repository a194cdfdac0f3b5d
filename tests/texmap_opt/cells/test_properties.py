"""Numbers that cells are compared by: right for known solids, the mean over what they do not name."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import assume, given, settings

from fea.effective_stiffness import EffectiveStiffness
from fea.plane_stiffness import PlaneStiffness
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.homogenised import HomogenisedCell
from texmap_opt.cells.homogenised_plane import HomogenisedPlaneCell
from texmap_opt.cells.power_law import power_law
from texmap_opt.cells.properties import PROPERTIES, direction_of, property_named
from texmap_opt.errors import InputError

E, NU = 3.0, 0.25
X = np.array([1.0, 0, 0])
vectors = st.tuples(*(st.floats(-1, 1) for _ in range(3)))


def solid(C: np.ndarray) -> HomogenisedCell:
    return HomogenisedCell(unit_cell("cube"), 0.1, 0.3, EffectiveStiffness(C), 0.1, 0.1, None)


def sheet(C: np.ndarray) -> HomogenisedPlaneCell:
    return HomogenisedPlaneCell(unit_cell("square"), 0.1, 0.3, PlaneStiffness(C), 0.1, 0.1, None)


def isotropic() -> np.ndarray:
    S = np.diag([1 / E] * 3 + [2 * (1 + NU) / E] * 3)
    S[:3, :3] -= NU / E * (1 - np.eye(3))
    return np.linalg.inv(S)


def orthotropic() -> np.ndarray:
    C = np.diag([5.0, 3.0, 2.0, 0.7, 0.5, 0.9])
    C[:3, :3] += 0.4 * (1 - np.eye(3))
    return C


def value(name: str, cell, direction=X) -> float:
    found = PROPERTIES[name].of(cell, np.asarray(direction, float))
    assert found is not None
    return found


@settings(max_examples=10, derandomize=True, deadline=None)
@given(vector=vectors)
def test_an_isotropic_solid_has_its_constants_in_every_direction(vector):
    assume(np.linalg.norm(vector) > 1e-3)
    cell = solid(isotropic())
    # Rounding of an inverse of condition 5.
    found = [value(name, cell, vector) for name in ("E", "nu", "G")]
    np.testing.assert_allclose(found, [E, NU, E / (2 * (1 + NU))], rtol=1e-12)


def test_an_isotropic_solid_has_no_preferred_direction():
    cell = solid(isotropic())
    np.testing.assert_allclose(
        [value(name, cell) for name in ("zener", "E_ratio", "E_min", "E_max", "bulk")],
        [1, 1, E, E, E / (3 * (1 - 2 * NU))],
        rtol=1e-12,
    )
    assert value("anisotropy", cell) == 0


@settings(max_examples=6, derandomize=True, deadline=None)
@given(vector=vectors)
def test_shear_and_contraction_are_means_over_the_directions_across(vector):
    """Of compliance for the shear: 360 directions, of which trigonometric forms of two are exact."""
    assume(np.linalg.norm(vector) > 1e-3)
    n = np.array(vector) / np.linalg.norm(vector)
    cell = solid(orthotropic())
    first = np.linalg.svd(n[None])[2][1]
    second = np.cross(n, first)
    angle = np.linspace(0, 2 * np.pi, 360, endpoint=False)[:, None]
    m = np.cos(angle) * first + np.sin(angle) * second
    along = np.broadcast_to(n, m.shape)
    contraction = cell.stiffness.poissons_ratio(along, m).mean()
    compliance = (1 / cell.stiffness.shear_modulus(along, m)).mean()
    np.testing.assert_allclose(value("nu", cell, n), contraction, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(value("G", cell, n), 1 / compliance, rtol=1e-10)


def test_zeners_ratio_is_for_cubic_stiffness_only():
    assert PROPERTIES["zener"].of(solid(orthotropic()), X) is None
    assert PROPERTIES["zener"].of(sheet(np.diag([2.0, 1.0, 1.0])), X) is None
    C = np.array([[4.0, 1, 0], [1, 4, 0], [0, 0, 3]])
    assert value("zener", sheet(C)) == pytest.approx(2, rel=1e-15)


def test_a_sheet_has_the_constants_of_its_plane_and_of_its_axis():
    """Plane stress: C11 = E/(1 - nu^2). Along its axis all walls stretch and contract alike."""
    C = E / (1 - NU**2) * np.array([[1, NU, 0], [NU, 1, 0], [0, 0, (1 - NU) / 2]])
    cell = sheet(C)
    for direction in ([1, 0, 0], [0, -2, 0], [1, 1, 0]):
        found = [value(name, cell, direction) for name in ("E", "nu", "G")]
        np.testing.assert_allclose(found, [E, NU, E / (2 * (1 + NU))], rtol=1e-12)
    np.testing.assert_allclose(value("bulk", cell), E / (2 * (1 - NU)), rtol=1e-12)
    assert value("E", cell, [0, 0, 3]) == cell.density
    assert value("nu", cell, [0, 0, 3]) == cell.nu
    # A frame in the plane does not tell how walls shear along their height.
    for name, direction in (("G", [0, 0, 1]), ("E", [0, 1, 1]), ("nu", [1, 0, 1])):
        assert PROPERTIES[name].of(cell, np.array(direction, float)) is None


def test_the_power_of_a_power_law_is_found():
    density = np.array([0.01, 0.05, 0.2])
    modulus = 0.3 * density**1.7
    law = power_law(density, modulus)
    np.testing.assert_allclose([law.factor, law.exponent], [0.3, 1.7], rtol=1e-12)
    assert law.residual < 1e-12
    # One value 10 % off: the largest error of the fit is a good part of that.
    assert 0.02 < power_law(density, modulus * np.array([1, 1.1, 1])).residual < 0.1


@pytest.mark.parametrize("text", ["1,0", "1,0,0,0", "a,b,c", "0,0,0", "nan,0,0", ""])
def test_a_direction_that_is_none_is_refused(text: str):
    with pytest.raises(InputError, match="give such as 1,0,0"):
        direction_of(text)


def test_a_misspelt_property_is_answered_with_what_there_is():
    with pytest.raises(InputError, match='did you mean "E_ratio"'):
        property_named("E_ratios")
    np.testing.assert_array_equal(direction_of("1, -2,0.5"), [1, -2, 0.5])
