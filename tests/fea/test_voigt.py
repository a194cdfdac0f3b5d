import jax
import jax.numpy as jnp
import numpy as np
import pytest
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


@examples
@given(stress=stresses, R=turns)
def test_rotations_of_six_vectors_are_those_of_tensors(stress, R):
    turned = R @ voigt.tensor(stress) @ R.T
    np.testing.assert_allclose(voigt.stress_rotation(R) @ stress, voigt.vector(turned), atol=1e-11)
    np.testing.assert_allclose(voigt.turned_stress(stress, R), voigt.vector(turned), atol=1e-11)
    strain = R @ voigt.strain_tensor(stress) @ R.T
    np.testing.assert_allclose(
        voigt.strain_rotation(R) @ stress, voigt.strain_vector(strain), atol=1e-11
    )


@examples
@given(stress=stresses, R=turns)
def test_rotation_keeps_energy_and_is_undone_by_the_opposite(stress, R):
    strain = stress[::-1].copy()
    np.testing.assert_allclose(
        voigt.turned_stress(stress, R) @ (voigt.strain_rotation(R) @ strain),
        stress @ strain,
        atol=1e-9,
    )
    np.testing.assert_allclose(
        voigt.stress_rotation(R).T @ voigt.strain_rotation(R), np.eye(6), atol=1e-13
    )
    np.testing.assert_allclose(
        voigt.turned_stress(voigt.turned_stress(stress, R), R.T.copy()), stress, atol=1e-11
    )


def test_a_quarter_turn_about_z_exchanges_x_and_y():
    R = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = voigt.turned_stress(np.arange(1.0, 7.0), R)
    # x -> y, y -> -x: yz comes from xz, xz from -yz, xy from -xy.
    np.testing.assert_allclose(turned, [2, 1, 3, 5, -4, -6], atol=1e-15)


ONE = {
    "tensor": voigt.tensor,
    "strain_tensor": voigt.strain_tensor,
    "hydrostatic": voigt.hydrostatic,
    "deviator": voigt.deviator,
    "von_mises": voigt.von_mises,
    "principal_values": voigt.principal_values,
    "vector": lambda s: voigt.vector(voigt.tensor(s)),
    "strain_vector": lambda s: voigt.strain_vector(voigt.tensor(s)),
    "turned_stress": lambda s: voigt.turned_stress(s, voigt.tensor(s)),
    "turned_stiffness": lambda s: voigt.turned_stiffness(
        s[..., None] + s[..., None, :], voigt.tensor(s)
    ),
    "directions": lambda s: voigt.principal_directions(s) ** 2,
}


@pytest.mark.parametrize("name", ONE)
@pytest.mark.parametrize("shape", [(6,), (4, 6), (2, 4, 6)])
def test_numpy_and_jax_agree_and_keep_their_kind(name, shape):
    stress = np.random.default_rng(0).standard_normal(shape)
    plain, traced = ONE[name](stress), jax.jit(ONE[name])(jnp.asarray(stress))
    assert type(plain) is np.ndarray
    assert isinstance(traced, jax.Array)
    np.testing.assert_allclose(traced, plain, atol=1e-13)


def test_one_rotation_serves_many_stresses_in_jax_too():
    stress = np.random.default_rng(1).standard_normal((2, 5, 6))
    R = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))[0]
    np.testing.assert_allclose(
        voigt.turned_stress(jnp.asarray(stress), jnp.asarray(R)),
        voigt.turned_stress(stress, R),
        atol=1e-14,
    )


def test_gradient_of_von_mises_stress_is_finite_where_there_is_no_stress():
    """3/2 s/sigma elsewhere (the direction of plastic flow), zero at the tip of the cone."""
    slope = jax.grad(lambda s: voigt.von_mises(s).sum())
    np.testing.assert_array_equal(slope(jnp.zeros((2, 6))), 0)
    np.testing.assert_array_equal(slope(jnp.array([[3.0, 3.0, 3.0, 0.0, 0.0, 0.0]])), 0)
    tension = slope(jnp.array([[5.0, 0.0, 0.0, 0.0, 0.0, 0.0]]))
    np.testing.assert_allclose(tension[0], [1, -0.5, -0.5, 0, 0, 0], atol=1e-15)
    shear = slope(jnp.array([[0.0, 0.0, 0.0, 2.0, 0.0, 0.0]]))
    np.testing.assert_allclose(shear[0], [0, 0, 0, np.sqrt(3), 0, 0], atol=1e-15)


def test_gradient_of_principal_values_is_finite_where_they_coincide():
    slope = jax.grad(lambda s: voigt.principal_values(s)[0])
    assert np.isfinite(slope(jnp.zeros(6))).all()
    np.testing.assert_allclose(slope(jnp.array([1.0, 2.0, 5.0, 0.0, 0.0, 0.0])), np.eye(6)[2])


@pytest.mark.parametrize("xp", [np, jnp])
def test_a_stress_that_is_not_a_number_has_no_equivalent(xp):
    """Zero would pass for a sound part."""
    stress = xp.asarray([[np.nan, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0] * 6])
    np.testing.assert_array_equal(np.asarray(voigt.von_mises(stress)), [np.nan, 0.0])
