import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fea import voigt

stresses = st.lists(st.floats(-100, 100, allow_nan=False), min_size=6, max_size=6).map(np.array)
turns = st.tuples(*[st.floats(-3, 3, allow_nan=False)] * 3).map(
    lambda v: Rotation.from_rotvec(v).as_matrix()
)
examples = settings(max_examples=30, derandomize=True, deadline=None)


def test_order_is_xx_yy_zz_yz_xz_xy():
    expected = np.array([[1.0, 6.0, 5.0], [6.0, 2.0, 4.0], [5.0, 4.0, 3.0]])
    np.testing.assert_array_equal(voigt.tensor(np.arange(1.0, 7.0)), expected)


def test_uniaxial_tension_and_pure_shear_have_textbook_von_mises_stress():
    """Tension s: s; shear t: sqrt(3) t (von Mises 1913); hydrostatic: 0."""
    cases = np.array([[5.0, 0, 0, 0, 0, 0], [0, 0, 0, 2.0, 0, 0], [3.0, 3, 3, 0, 0, 0]])
    np.testing.assert_allclose(voigt.von_mises(cases), [5, 2 * np.sqrt(3), 0], atol=1e-14)


@examples
@given(stress=stresses)
def test_tensor_and_vector_are_inverse(stress):
    np.testing.assert_array_equal(voigt.vector(voigt.tensor(stress)), stress)


@examples
@given(stress=stresses, R=turns)
def test_invariants_do_not_turn(stress, R):
    turned = voigt.vector(R @ voigt.tensor(stress) @ R.T)
    np.testing.assert_allclose(voigt.von_mises(turned), voigt.von_mises(stress), atol=1e-11)
    np.testing.assert_allclose(
        voigt.principal_values(turned), voigt.principal_values(stress), atol=1e-11
    )


@examples
@given(stress=stresses)
def test_principal_values_and_directions_rebuild_the_tensor(stress):
    values, directions = voigt.principal_values(stress), voigt.principal_directions(stress)
    assert (np.diff(values) <= 0).all()
    rebuilt = np.einsum("k,ki,kj->ij", values, directions, directions)
    np.testing.assert_allclose(rebuilt, voigt.tensor(stress), atol=1e-11)


@examples
@given(stress=stresses)
def test_deviator_has_no_trace_and_the_same_von_mises_stress(stress):
    s = voigt.deviator(stress)
    np.testing.assert_allclose(s[:3].sum(), 0, atol=1e-12)
    np.testing.assert_allclose(voigt.von_mises(s), voigt.von_mises(stress), atol=1e-11)
    np.testing.assert_allclose(
        s + voigt.hydrostatic(stress) * (np.arange(6) < 3), stress, atol=1e-12
    )


def test_engineering_shear_is_twice_the_tensor_shear():
    np.testing.assert_array_equal(voigt.strain_tensor(np.eye(6)[3])[1, 2], 0.5)
