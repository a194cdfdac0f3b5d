"""The beam element alone: closed forms, exact condensation, invariances, gradients."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from fea.assembly import node_pairs
from fea.beam import (
    Strut,
    StrutMaterial,
    beam_end_forces,
    beam_forces,
    beam_pairs,
    beam_stiffness,
    beam_stiffnesses,
)
from fea.sections import AbstractSection, Given, Round, Square, Tube, Wall

E, NU = 70_000.0, 0.33
G = E / (2 * (1 + NU))
# Of the Taylor tests.
STEPS = (8e-3, 4e-3, 2e-3)
compiled = eqx.filter_jit(beam_stiffness)
SECTIONS = [Round(), Square(), Tube(ratio=0.8), Wall(depth=3.0), Round(shear_factor=float("inf"))]


def strut(
    ends=((0.1, 0.2, 0.3), (4.0, -3.0, 11.0)), radii=(0.9, 0.5), rigid=(0.0, 0.0), modulus=1.0
) -> Strut:
    return Strut(*(jnp.asarray(x, dtype=float) for x in (ends, radii, rigid, modulus)))


def stiffness(one: Strut, section: AbstractSection) -> np.ndarray:
    return np.asarray(compiled(one, StrutMaterial(E, NU, section)))


def chain(one: Strut, stations: np.ndarray) -> Strut:
    """The same strut without rigid ends as several in a row, cut at parts of its length."""
    at = jnp.asarray(stations)[:, None]
    joints = one.ends[:1] * (1 - at) + one.ends[1:] * at
    radii = one.radii[0] * (1 - at[:, 0]) + one.radii[1] * at[:, 0]
    pieces = len(stations) - 1
    return Strut(
        ends=jnp.stack([joints[:-1], joints[1:]], axis=1),
        radii=jnp.stack([radii[:-1], radii[1:]], axis=1),
        rigid_ends=jnp.zeros((pieces, 2)),
        modulus=jnp.full(pieces, one.modulus),
    )


def condensed(pieces: Strut, material: StrutMaterial) -> np.ndarray:
    """Exact stiffness of a chain with respect to its two ends."""
    K = np.asarray(beam_stiffnesses(pieces, material))
    joints = len(K) + 1
    whole = np.zeros((6 * joints, 6 * joints))
    for i, k in enumerate(K):
        whole[6 * i : 6 * i + 12, 6 * i : 6 * i + 12] += k
    outer = np.r_[0:6, 6 * joints - 6 : 6 * joints]
    inner = np.arange(6, 6 * joints - 6)
    coupling = whole[np.ix_(inner, outer)]
    return whole[np.ix_(outer, outer)] - coupling.T @ np.linalg.solve(
        whole[np.ix_(inner, inner)], coupling
    )


@pytest.mark.parametrize("section", [*SECTIONS, Given(A=2.0, I=0.7, J=0.4)])
def test_without_taper_it_is_the_textbooks_element(section):
    """Przemieniecki, Theory of Matrix Structural Analysis (1968), equation 5.116."""
    one = strut(radii=(0.7, 0.7))
    L = float(jnp.linalg.norm(one.ends[1] - one.ends[0]))
    r = np.array([0.7])
    A, I, J = (
        float(f(r)[0]) for f in (section.area, section.second_moment, section.torsion_constant)
    )
    phi = 12 * E * I / (section.kappa(NU) * G * A * L**2)
    K = np.zeros((12, 12))

    def put(i, j, value):
        K[i, j] = K[j, i] = value

    for i, k in [(0, E * A / L), (3, G * J / L)]:
        put(i, i, k)
        put(i + 6, i + 6, k)
        put(i, i + 6, -k)
    c = E * I / ((1 + phi) * L**3)
    for v, turn, sign in [(1, 5, 1), (2, 4, -1)]:
        w, other = v + 6, turn + 6
        for i, j, value in [(v, v, 12), (w, w, 12), (v, w, -12)]:
            put(i, j, value * c)
        for i, j, value in [(v, turn, 6), (v, other, 6), (w, turn, -6), (w, other, -6)]:
            put(i, j, sign * value * c * L)
        for i, j, value in [(turn, turn, 4 + phi), (other, other, 4 + phi), (turn, other, 2 - phi)]:
            put(i, j, value * c * L**2)
    x = np.asarray(one.ends[1] - one.ends[0]) / L
    y = np.cross([0, 0, 1.0], x)
    y /= np.linalg.norm(y)
    turn = np.kron(np.eye(4), np.stack([x, y, np.cross(x, y)]))
    expected = turn.T @ K @ turn
    # Rounding of the rotation.
    np.testing.assert_allclose(stiffness(one, section), expected, atol=1e-13 * expected.max())


@pytest.mark.parametrize("section", [*SECTIONS, Given(A=2.0, I=0.7, J=0.4)])
@pytest.mark.parametrize("radii", [(0.9, 0.5), (0.3, 1.5)])
def test_tapered_cantilever_deflects_as_the_integrals_of_beam_theory(section, radii):
    """Tip under axial force, torque, transverse force and moment, by numerical quadrature."""
    L = 12.0
    one = strut(ends=((0, 0, 0), (L, 0, 0)), radii=radii)
    flexibility = np.linalg.inv(stiffness(one, section)[6:, 6:])

    def radius(x: float) -> np.ndarray:
        return np.array([radii[0] + (radii[1] - radii[0]) * x / L])

    def integral(moment, shear=0.0) -> float:
        def integrand(x: float) -> float:
            EI = E * section.second_moment(radius(x))[0]
            GA = section.kappa(NU) * G * section.area(radius(x))[0]
            return moment(x) / EI + shear / GA

        return quad(integrand, 0, L, epsabs=0, epsrel=1e-13)[0]

    extension = quad(lambda x: 1 / (E * section.area(radius(x))[0]), 0, L, epsrel=1e-13)[0]
    twist = quad(lambda x: 1 / (G * section.torsion_constant(radius(x))[0]), 0, L, epsrel=1e-13)[0]
    expected = {
        (0, 0): extension,
        (3, 3): twist,
        (1, 1): integral(lambda x: (L - x) ** 2, 1.0),
        (2, 2): integral(lambda x: (L - x) ** 2, 1.0),
        (1, 5): integral(lambda x: L - x),
        (2, 4): -integral(lambda x: L - x),
        (5, 5): integral(lambda x: 1.0),
    }
    for (i, j), value in expected.items():
        np.testing.assert_allclose(flexibility[i, j], value, rtol=1e-10)


@pytest.mark.parametrize("section", SECTIONS)
def test_a_tapered_strut_is_its_own_pieces_condensed(section):
    """The element is exact, so cutting it changes nothing."""
    one = strut(radii=(0.4, 1.1))
    pieces = chain(one, np.array([0, 0.2, 0.5, 1.0]))
    expected = condensed(pieces, StrutMaterial(E, NU, section))
    # Condensation loses some digits to cancellation.
    np.testing.assert_allclose(
        stiffness(one, section), expected, atol=1e-11 * np.abs(expected).max()
    )


def test_a_prismatic_mean_is_not_the_tapered_strut():
    """Negative control: the geometric mean radius is exact in extension, too stiff in bending."""
    tapered, mean = strut(radii=(0.4, 0.8)), strut(radii=(0.32**0.5,) * 2)
    energy = [np.linalg.eigvalsh(stiffness(one, Round()))[6:] for one in (tapered, mean)]
    assert np.abs(energy[1] / energy[0] - 1).max() > 0.1


@pytest.mark.parametrize("section", SECTIONS)
def test_rigid_ends_move_with_their_joints(section):
    """u_end = u_joint + θ x arm, taken as a matrix on the stiffness of the elastic part alone."""
    ends = np.array([[0.1, 0.2, 0.3], [4.0, -3.0, 11.0]])
    rigid, radii = np.array([2.0, 1.3]), np.array([0.9, 0.5])
    L = np.linalg.norm(ends[1] - ends[0])
    t = (ends[1] - ends[0]) / L
    arms = np.stack([rigid[0] * t, -rigid[1] * t])
    at = np.array([rigid[0], L - rigid[1]]) / L
    elastic = strut(ends=ends + arms, radii=radii[0] + (radii[1] - radii[0]) * at)
    T = np.eye(12)
    for i, arm in enumerate(arms):
        # Columns of θ x arm by θ.
        T[6 * i : 6 * i + 3, 6 * i + 3 : 6 * i + 6] = np.cross(np.eye(3), arm).T
    expected = T.T @ stiffness(elastic, section) @ T
    whole = strut(ends=ends, radii=radii, rigid=rigid)
    np.testing.assert_allclose(stiffness(whole, section), expected, atol=1e-13 * expected.max())


def test_rigid_ends_are_the_limit_of_very_stiff_ones():
    one = strut(radii=(0.9, 0.5))
    L = float(jnp.linalg.norm(one.ends[1] - one.ends[0]))
    pieces = chain(one, np.array([0, 0.2, 0.85, 1.0]))
    stiff = Strut(pieces.ends, pieces.radii, pieces.rigid_ends, jnp.array([1e7, 1.0, 1e7]))
    expected = condensed(stiff, StrutMaterial(E, NU, Round()))
    rigid = strut(radii=(0.9, 0.5), rigid=(0.2 * L, 0.15 * L))
    # The stiff pieces still bend a ten-millionth, and condensing them loses as many digits.
    np.testing.assert_allclose(stiffness(rigid, Round()), expected, atol=1e-6 * expected.max())


lengths = st.floats(-20, 20)


@settings(max_examples=25, derandomize=True, deadline=None)
@given(
    ends=st.tuples(*[st.tuples(lengths, lengths, lengths)] * 2).filter(
        lambda ends: np.linalg.norm(np.subtract(*ends)) > 1
    ),
    radii=st.tuples(*[st.floats(0.05, 2)] * 2),
    parts=st.tuples(*[st.floats(0, 0.4)] * 2),
    angles=st.tuples(*[st.floats(-3, 3)] * 3),
)
def test_stiffness_is_symmetric_free_of_rigid_motion_and_turns_with_the_strut(
    ends, radii, parts, angles
):
    L = np.linalg.norm(np.subtract(*ends))
    one = strut(ends, radii, np.multiply(parts, L))
    K = stiffness(one, Round())
    size = np.abs(K).max()
    np.testing.assert_array_equal(K, K.T)
    assert np.linalg.eigvalsh(K)[0] > -1e-13 * size

    x = np.array(ends)
    rigid = np.zeros((12, 6))
    for i in range(2):
        rigid[6 * i : 6 * i + 6, :3] = np.eye(6)[:, :3]
        rigid[6 * i + 3 : 6 * i + 6, 3:] = np.eye(3)
        rigid[6 * i : 6 * i + 3, 3:] = np.cross(np.eye(3), x[i]).T
    np.testing.assert_allclose(K @ rigid, 0, atol=1e-12 * size * (1 + np.abs(x).max()))

    Q = Rotation.from_rotvec(angles).as_matrix()
    turned = stiffness(strut(x @ Q.T, radii, np.multiply(parts, L)), Round())
    turn = np.kron(np.eye(4), Q)
    np.testing.assert_allclose(turned, turn @ K @ turn.T, atol=1e-12 * size)


@pytest.mark.parametrize("section", SECTIONS)
@pytest.mark.parametrize("axis", [(0, 0, 3), (0, 0, -3), (2, 0, 0), (1, -2, 0.5)])
def test_a_free_strut_has_exactly_six_zero_energy_motions(section, axis):
    start = np.array([0.1, 0.2, 0.3])
    one = strut((start, start + axis), (0.3, 0.4), (0.2, 0.1))
    energy = np.linalg.eigvalsh(stiffness(one, section))
    assert np.sum(np.abs(energy) < 1e-12 * energy[-1]) == 6
    assert energy[6] > 1e-6 * energy[-1]


def test_a_strut_given_from_its_other_end_is_the_same():
    one = strut(radii=(0.4, 1.1), rigid=(0.5, 1.0))
    other = Strut(one.ends[::-1], one.radii[::-1], one.rigid_ends[::-1], one.modulus)
    swap = np.r_[6:12, 0:6]
    K = stiffness(one, Round())
    np.testing.assert_allclose(
        stiffness(other, Round())[np.ix_(swap, swap)], K, atol=1e-14 * K.max()
    )


def test_the_relative_modulus_scales_everything():
    K = stiffness(strut(rigid=(0.5, 1.0)), Square())
    soft = stiffness(strut(rigid=(0.5, 1.0), modulus=0.25), Square())
    np.testing.assert_allclose(soft, K / 4, rtol=1e-14, atol=1e-16 * K.max())


def test_pairs_and_forces_are_parts_and_products_of_the_stiffness():
    one = [strut(), strut(((0, 0, 0), (0, 0, 5)), (0.3, 0.4), (1.0, 0.5), 0.5)]
    struts = jax.tree.map(lambda *leaves: jnp.stack(leaves), *one)
    material = StrutMaterial(E, NU, Round())
    K = np.stack([stiffness(s, Round()) for s in one])
    blocks = K.reshape(2, 2, 6, 2, 6)
    expected = np.stack([blocks[:, a, :, b] for a, b in zip(*node_pairs(2), strict=True)], axis=1)
    np.testing.assert_allclose(beam_pairs(struts, material), expected, atol=1e-15 * K.max())
    u = np.random.default_rng(0).normal(size=(3, 2, 12))
    expected = np.einsum("sij,csj->csi", K, u)  # strut, dof, case
    forces = beam_end_forces(struts, material, jnp.asarray(u))
    np.testing.assert_allclose(forces, expected, atol=1e-14 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("section", "radii"),
    [(Round(), (0.6, 0.6)), (Tube(ratio=0.8), (0.4, 1.1)), (SECTIONS[-1], (0.6, 0.6))],
)
def test_energy_gradient_has_a_second_order_taylor_remainder(section, radii):
    """By joints, radii and rigid ends; at equal radii too, where u'Ku stays smooth."""
    one = strut(radii=radii, rigid=(0.5, 1.0))
    rng = np.random.default_rng(1)
    u = jnp.asarray(rng.normal(size=12))
    material = StrutMaterial(E, NU, section)
    energy = jax.jit(lambda s: u @ beam_forces(s, material, u))
    gradient = jax.jit(jax.grad(energy))(one)
    for name, reach in {"ends": 1.0, "radii": 0.5, "rigid_ends": 1.0}.items():
        at = getattr(one, name)
        v = jnp.asarray(reach * rng.normal(size=at.shape))
        slope = float(jnp.sum(getattr(gradient, name) * v))
        moved = [eqx.tree_at(lambda s, k=name: getattr(s, k), one, at + h * v) for h in STEPS]
        rest = np.abs(
            [float(energy(s) - energy(one)) - h * slope for s, h in zip(moved, STEPS, strict=True)]
        )
        np.testing.assert_allclose(np.log2(rest[:-1] / rest[1:]), 2, atol=0.1)
    # Linear in the modulus.
    np.testing.assert_allclose(gradient.modulus, energy(one), rtol=1e-12)


def test_a_given_section_ignores_the_radius_and_its_gradient_says_so():
    u = jnp.asarray(np.random.default_rng(1).normal(size=12))
    material = StrutMaterial(E, NU, Given(A=2.0, I=0.7, J=0.4))
    energy = jax.jit(jax.grad(lambda s: u @ beam_forces(s, material, u)))
    gradient = energy(strut(rigid=(0.5, 1.0)))
    np.testing.assert_array_equal(gradient.radii, 0)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))


def test_gradients_by_product_and_by_matrix_agree():
    one = strut(rigid=(0.5, 1.0))
    rng = np.random.default_rng(2)
    u, v = (jnp.asarray(rng.normal(size=12)) for _ in range(2))
    material = StrutMaterial(E, NU, Tube(ratio=0.5))
    product = jax.jit(jax.grad(lambda s: v @ beam_forces(s, material, u)))(one)
    matrix = jax.jit(jax.grad(lambda s: v @ beam_stiffness(s, material) @ u))(one)
    for a, b in zip(jax.tree.leaves(product), jax.tree.leaves(matrix), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10)
