import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fea import FeaError, Material, material, material_names
from fea.materials import Orthotropic
from fea.voigt import strain_rotation, stress_rotation, turned_stiffness


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


@pytest.fixture
def unchecked(monkeypatch):
    """Users' programs run without the checks of annotations that these tests run with."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)


@pytest.mark.parametrize("name", ["E", "nu", "density", "yield_stress"])
def test_constants_in_single_precision_or_not_numbers_are_refused(name, unchecked):
    constants = {"E": 1e3, "nu": 0.25, "density": 1e-9, "yield_stress": 10.0, "name": "resin"}
    Material(**constants)
    message = f'Material "resin": values of {name} are float32, single precision'
    with pytest.raises(FeaError, match=message):
        Material(**constants | {name: np.float32(constants[name])})
    with pytest.raises(FeaError, match="float32"):
        Material(**constants | {name: jnp.float32(constants[name])})
    with pytest.raises(FeaError, match=f"values of {name} are .*no real number"):
        Material(**constants | {name: "much"})
    with pytest.raises(FeaError, match=rf"{name} has shape \(2,\); give one number"):
        Material(**constants | {name: [constants[name]] * 2})


def test_whole_numbers_are_constants_too(unchecked):
    m = Material(E=1000, nu=0, density=0, yield_stress=np.int64(5))
    assert [type(c) for c in (m.E, m.nu, m.density, m.yield_stress)] == [float] * 4
    ply = Orthotropic(
        E=[3, 2, 1], nu=[0, 0, 0], G=np.ones(3, int), density=1, axes=np.eye(3, dtype=int)
    )
    assert ply.E == (3.0, 2.0, 1.0)
    for stiffness in (m.stiffness, ply.stiffness):
        assert stiffness.dtype == np.float64
    np.testing.assert_allclose(np.diag(ply.stiffness), [3, 2, 1, 1, 1, 1])


def test_an_orthotropic_material_has_no_density_unless_it_is_given():
    with pytest.raises(TypeError, match="density"):
        Orthotropic(E=(1.0, 1.0, 1.0), nu=(0.0, 0.0, 0.0), G=(1.0, 1.0, 1.0))


def test_stiffness_inverts_hookes_law_written_as_compliance():
    """Strains of unit stresses: 1/E, -nu/E, 1/G (Timoshenko and Goodier, section 7)."""
    m = Material(200e3, 0.3, 0.0)
    S = np.diag([1 / m.E] * 3 + [1 / m.shear_modulus] * 3)
    S[:3, :3] -= m.nu / m.E * (1 - np.eye(3))
    np.testing.assert_allclose(m.stiffness @ S, np.eye(6), atol=1e-14)


# Orthotropic --------------------------------------------------------------------------------

# Carbon fibres along x: T300/5208 (Tsai and Hahn 1980), with nu_yz and G_yz of a usual epoxy.
PLY = {
    "E": (181e3, 10.3e3, 10.3e3),
    "nu": (0.4, 0.28, 0.28),
    "G": (3.7e3, 7.17e3, 7.17e3),
    "density": 1.6e-9,
}
turns = st.tuples(*[st.floats(-3, 3, allow_nan=False)] * 3).map(
    lambda v: Rotation.from_rotvec(v).as_matrix()
)
examples = settings(max_examples=20, derandomize=True, deadline=None)


def strain_under(material, stress):
    return np.linalg.solve(material.stiffness, stress)


@examples
@given(R=turns)
def test_equal_constants_give_the_isotropic_stiffness_in_any_axes(R):
    iso = Material(210e3, 0.3, 0.0)
    same = Orthotropic((210e3,) * 3, (0.3,) * 3, (iso.shear_modulus,) * 3, 0.0, axes=R)
    np.testing.assert_allclose(same.stiffness, iso.stiffness, atol=1e-9 * 210e3)


@pytest.mark.parametrize("axis", range(3))
def test_tension_along_an_axis_gives_its_modulus_and_contractions(axis):
    """nu_xy is the contraction along y under tension along x."""
    ply = Orthotropic(**PLY)
    e = strain_under(ply, np.eye(6)[axis])
    np.testing.assert_allclose(e[axis], 1 / ply.E[axis], rtol=1e-12)
    yz, xz, xy = ply.nu
    if axis == 0:
        np.testing.assert_allclose(-e[[1, 2]] / e[0], [xy, xz], rtol=1e-12)
    if axis == 1:
        np.testing.assert_allclose(-e[2] / e[1], yz, rtol=1e-12)
        # Minor ratio nu_yx = nu_xy Ey / Ex.
        np.testing.assert_allclose(-e[0] / e[1], xy * ply.E[1] / ply.E[0], rtol=1e-12)
    np.testing.assert_allclose(e[3:], 0, atol=1e-20)


@pytest.mark.parametrize("shear", range(3))
def test_shear_in_a_plane_gives_its_modulus(shear):
    ply = Orthotropic(E=(3.0, 2.0, 1.0), nu=(0.1, 0.2, 0.3), G=(0.5, 0.7, 0.9), density=0.0)
    gamma = strain_under(ply, np.eye(6)[3 + shear])
    np.testing.assert_allclose(gamma[3 + shear], 1 / (0.5, 0.7, 0.9)[shear], rtol=1e-12)


@pytest.mark.parametrize("degrees", [0, 20, 45, 70, 90])
def test_the_off_axis_modulus_is_that_of_laminate_theory(degrees):
    """1/E = c⁴/E1 + (1/G12 - 2 nu12/E1) s² c² + s⁴/E2.

    R. M. Jones, Mechanics of Composite Materials, 2nd ed., section 2.6. Fibres at the angle to
    global x, in the xy plane.
    """
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    axes = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    ply = Orthotropic(**PLY, axes=axes)
    E1, E2, G12, nu12 = PLY["E"][0], PLY["E"][1], PLY["G"][2], PLY["nu"][2]
    e = strain_under(ply, np.eye(6)[0])
    expected = c**4 / E1 + (1 / G12 - 2 * nu12 / E1) * s**2 * c**2 + s**4 / E2
    np.testing.assert_allclose(e[0], expected, rtol=1e-12)
    # Jones' shear coupling, gamma_xy under sigma_x: negative for fibres between 0 and 90 degrees.
    coupling = (2 / E1 + 2 * nu12 / E1 - 1 / G12) * s * c**3
    coupling -= (2 / E2 + 2 * nu12 / E1 - 1 / G12) * s**3 * c
    np.testing.assert_allclose(e[5], coupling, atol=1e-12 / E2)
    if degrees == 45:
        assert e[5] < 0
        np.testing.assert_allclose(1 / e[0], 4 / (1 / E1 + 1 / E2 + 1 / G12 - 2 * nu12 / E1))


@examples
@given(R=turns)
def test_turning_the_axes_turns_the_stiffness_and_keeps_its_energy(R):
    ply = Orthotropic(**PLY)
    turned = Orthotropic(**PLY, axes=R.T)
    C = turned.stiffness
    np.testing.assert_allclose(C, turned_stiffness(ply.stiffness, R), atol=1e-9 * C.max())
    np.testing.assert_array_equal(np.abs(C - C.T) < 1e-9 * C.max(), True)
    # Eigenvalues with shears scaled to tensor components (Kelvin's) do not turn.
    kelvin = np.diag([1, 1, 1, *[np.sqrt(2)] * 3])
    np.testing.assert_allclose(
        np.linalg.eigvalsh(kelvin @ C @ kelvin),
        np.linalg.eigvalsh(kelvin @ ply.stiffness @ kelvin),
        rtol=1e-9,
    )
    strain = np.array([1.0, -2.0, 0.5, 0.3, -0.7, 1.1])
    np.testing.assert_allclose(
        C @ (strain_rotation(R) @ strain),
        stress_rotation(R) @ (ply.stiffness @ strain),
        atol=1e-9 * C.max(),
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"E": (1e3, 0.0, 1e3)}, "Ey = 0 MPa must be positive"),
        ({"G": (1e3, float("nan"), 1e3)}, "G_xz = nan MPa must be positive"),
        # 4.192 = sqrt(181/10.3): Ex/Ey, and one over that for the ratio named the other way.
        ({"nu": (0.4, 0.28, 4.2)}, r"nu_xy = 4.2 must lie between -4.192 and 4.192"),
        ({"nu": (1.1, 0.28, 0.28)}, r"nu_yz = 1.1 .* between -1 and 1, .* perhaps nu_zy"),
        ({"nu": (0.4, float("nan"), 0.28)}, "nu_xz = nan must lie between"),
        ({"nu": (-0.95, 2.0, 2.0)}, None),
        ({"nu": (0.95, 2.0, 2.0)}, "too large together"),
        ({"axes": np.eye(3) * 1.01}, "unit vectors at right angles"),
        ({"axes": np.eye(3, dtype=np.float32)}, 'Material "custom": values of axes are float32'),
        ({"axes": np.eye(2)}, r"axes has shape \(2, 2\); give three rows of three"),
        ({"axes": [[1.0, 0.0], [0.0]]}, "axes are not a rectangular array"),
        ({"E": (1e3, 1e3)}, r"E has shape \(2,\); give three numbers"),
        ({"nu": 0.3}, r"nu has shape \(\); give three numbers"),
        ({"G": np.ones(3, np.float32)}, "values of G are float32"),
        ({"E": (np.float32(1e3),) * 3}, "values of E are float32"),
        ({"density": -1.0}, "density"),
        ({"yield_stress": 0.0}, "yield"),
    ],
)
def test_impossible_orthotropic_constants_are_refused(change, message, unchecked):
    if message is None:
        assert np.linalg.eigvalsh(Orthotropic(**PLY | change).stiffness)[0] > 0
        return
    with pytest.raises(FeaError, match=message):
        Orthotropic(**PLY | change)


@examples
@given(nu=st.tuples(*[st.floats(-1.2, 1.2)] * 3))
def test_constants_are_accepted_exactly_where_every_load_does_work(nu):
    """Positive definite compliance, found here by its eigenvalues."""
    constants = {"E": (3.0, 1.0, 2.0), "G": (1.0, 1.0, 1.0), "density": 0.0}
    (yz, xz, xy), (a, b, c) = nu, constants["E"]
    S = np.array([[1 / a, -xy / a, -xz / a], [-xy / a, 1 / b, -yz / b], [-xz / a, -yz / b, 1 / c]])
    if np.linalg.eigvalsh(S)[0] > 1e-9:
        Orthotropic(nu=nu, **constants)
    elif np.linalg.eigvalsh(S)[0] < -1e-9:
        with pytest.raises(FeaError, match=r"Poisson|must lie"):
            Orthotropic(nu=nu, **constants)
