"""Geometric stiffness and mass of one strut: rigid motions, integrals, and what they assume."""

import hypothesis.strategies as st
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from fea.assembly import node_pairs
from fea.beam import Strut, StrutMaterial, beam_forces, beam_stiffness
from fea.beam_eigen import (
    axial_force,
    beam_geometric_stiffness,
    beam_mass,
    geometric_pairs,
    geometric_work,
    inertia_work,
    mass_pairs,
)
from fea.sections import Round, Square, Tube

DENSITY = 2.7e-9
STEEL = StrutMaterial(210_000.0, 0.3, Round())
SLENDER = StrutMaterial(210_000.0, 0.3, Round(shear_factor=float("inf")))


def strut(seed: int, *, taper: bool = True, rigid: bool = True) -> Strut:
    """A strut in general position."""
    rng = np.random.default_rng(seed)
    radii = rng.uniform(0.3, 0.8, 2) if taper else np.full(2, rng.uniform(0.3, 0.8))
    return Strut(
        ends=jnp.asarray(rng.uniform(-5, 5, (2, 3)) + np.array([[0.0] * 3, [9.0, 8.0, -7.0]])),
        radii=jnp.asarray(radii),
        rigid_ends=jnp.asarray(rng.uniform(0.2, 1.5, 2) if rigid else np.zeros(2)),
        modulus=jnp.asarray(rng.uniform(0.5, 2.0)),
    )


def displacements(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=12) * 0.01


def rigid_turn(one: Strut, omega: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Displacement and rotation of both joints by a small rigid turn about a point."""
    arms = np.asarray(one.ends) - centre
    return np.concatenate([np.concatenate([np.cross(omega, arm), omega]) for arm in arms])


def axis(one: Strut) -> tuple[np.ndarray, float]:
    run = np.asarray(one.ends[1] - one.ends[0])
    return run / np.linalg.norm(run), float(np.linalg.norm(run))


@given(seed=st.integers(0, 10_000))
@settings(max_examples=5, deadline=None)
def test_turning_a_stressed_strut_turns_its_force(seed):
    """Rigid ends included: the ends push with N along the turned axis, and no moment is needed."""
    one, u = strut(seed), displacements(seed + 1)
    omega = np.random.default_rng(seed + 2).normal(size=3)
    t, _ = axis(one)
    N = float(axial_force(one, STEEL, jnp.asarray(u)))
    Kg = np.asarray(beam_geometric_stiffness(one, STEEL, jnp.asarray(u)))
    forces = Kg @ rigid_turn(one, omega, np.array([1.0, 2.0, 3.0]))
    turned = N * np.cross(omega, t)
    expected = np.concatenate([-turned, np.zeros(3), turned, np.zeros(3)])
    # Rounding of terms that are of the order N times the moment arm.
    np.testing.assert_allclose(forces, expected, atol=1e-11 * abs(N))


def test_axial_force_is_the_end_force_of_the_stiffness():
    """Or -N at the first joint, which the axial force pulls towards the second."""
    one, u = strut(3), displacements(4)
    t, _ = axis(one)
    ends = np.asarray(beam_forces(one, STEEL, jnp.asarray(u)))
    N = float(axial_force(one, STEEL, jnp.asarray(u)))
    np.testing.assert_allclose([-t @ ends[:3], t @ ends[6:9]], N, rtol=1e-12)


def test_geometric_stiffness_is_linear_in_the_displacement():
    one, u = strut(5), displacements(6)
    once = beam_geometric_stiffness(one, STEEL, jnp.asarray(u))
    np.testing.assert_allclose(
        beam_geometric_stiffness(one, STEEL, jnp.asarray(-3 * u)), -3 * once, rtol=1e-12
    )


def test_hermite_blocks_of_przemieniecki():
    """Theory of Matrix Structural Analysis (1968), chapter 15: a strut along x."""
    L = 4.0
    one = Strut(
        jnp.array([[0.0, 0, 0], [L, 0, 0]]), jnp.full(2, 0.1), jnp.zeros(2), jnp.asarray(1.0)
    )
    u = np.zeros(12)
    u[6] = 0.01
    N = float(axial_force(one, SLENDER, jnp.asarray(u)))
    Kg = np.asarray(beam_geometric_stiffness(one, SLENDER, jnp.asarray(u)))
    plane = np.array([1, 5, 7, 11])  # uy and rz at both ends
    expected = (
        N
        / (30 * L)
        * np.array(
            [
                [36, 3 * L, -36, 3 * L],
                [3 * L, 4 * L**2, -3 * L, -(L**2)],
                [-36, -3 * L, 36, -3 * L],
                [3 * L, -(L**2), -3 * L, 4 * L**2],
            ]
        )
    )
    np.testing.assert_allclose(Kg[np.ix_(plane, plane)], expected, rtol=1e-12)
    along = np.array([0, 3, 6, 9])
    assert not Kg[along].any()


@given(seed=st.integers(0, 10_000))
@settings(max_examples=5, deadline=None)
def test_turning_everything_turns_both_matrices(seed):
    one, u = strut(seed), displacements(seed + 1)
    Q = Rotation.from_rotvec(np.random.default_rng(seed).normal(size=3)).as_matrix()
    turned = Strut(one.ends @ Q.T, one.radii, one.rigid_ends, one.modulus)
    big = np.kron(np.eye(4), Q)
    pairs = [
        (beam_mass(one, STEEL, DENSITY), beam_mass(turned, STEEL, DENSITY)),
        (
            beam_geometric_stiffness(one, STEEL, jnp.asarray(u)),
            beam_geometric_stiffness(turned, STEEL, jnp.asarray(big @ u)),
        ),
    ]
    for plain, rotated in pairs:
        scale = np.abs(np.asarray(plain)).max()
        np.testing.assert_allclose(rotated, big @ plain @ big.T, atol=1e-11 * scale)


@pytest.mark.parametrize("section", [Round(), Square(), Tube(0.7)])
def test_mass_of_rigid_motions_is_that_of_the_body(section):
    """Translation, turning about the axis, and turning across it, from integrals of polynomials.

    The consistent mass holds these exactly, taper and rigid ends included.
    """
    one = strut(7)
    material = StrutMaterial(1000.0, 0.3, section)
    M = np.asarray(beam_mass(one, material, DENSITY))
    t, L = axis(one)
    radius = np.polynomial.Polynomial([float(one.radii[0]), float(jnp.diff(one.radii)[0]) / L])
    A = section.unit_area * radius**2
    I = section.unit_second_moment * radius**4
    x = np.polynomial.Polynomial([0.0, 1.0])

    def over_length(density: np.polynomial.Polynomial) -> float:
        whole = density.integ()
        return float(DENSITY * (whole(L) - whole(0.0)))

    across = np.cross(t, [0.3, -0.5, 0.8])
    across /= np.linalg.norm(across)
    slide = np.tile(np.concatenate([[1.0, -2.0, 2.0], np.zeros(3)]), 2)
    first = np.asarray(one.ends[0])
    motions = {
        "slide": (slide, 9 * over_length(A)),
        "spin": (rigid_turn(one, t, first), over_length(2 * I)),
        "turn": (rigid_turn(one, across, first), over_length(A * x**2 + I)),
    }
    for name, (motion, expected) in motions.items():
        np.testing.assert_allclose(motion @ M @ motion, expected, rtol=1e-12, err_msg=name)


def test_mass_is_positive_definite():
    for seed in range(5):
        assert eigh(np.asarray(beam_mass(strut(seed), STEEL, DENSITY)), eigvals_only=True)[0] > 0


def test_work_without_matrices_is_that_of_the_matrices():
    one, u, x = strut(8), jnp.asarray(displacements(9)), jnp.asarray(displacements(10))
    Kg, M = beam_geometric_stiffness(one, STEEL, u), beam_mass(one, STEEL, DENSITY)
    np.testing.assert_allclose(geometric_work(one, STEEL, u, x), x @ Kg @ x, rtol=1e-10)
    np.testing.assert_allclose(inertia_work(one, STEEL, DENSITY, x), x @ M @ x, rtol=1e-10)


def test_pairs_are_the_blocks_of_the_matrices():
    one, u = strut(11), jnp.asarray(displacements(12))
    all_struts = Strut(one.ends[None], one.radii[None], one.rigid_ends[None], one.modulus[None])
    wholes = [beam_geometric_stiffness(one, STEEL, u), beam_mass(one, STEEL, DENSITY)]
    found = [geometric_pairs(all_struts, STEEL, u[None]), mass_pairs(all_struts, STEEL, DENSITY)]
    for whole, blocks in zip(wholes, found, strict=True):
        ends = np.asarray(whole).reshape(2, 6, 2, 6)
        expected = np.stack([ends[a, :, b] for a, b in zip(*node_pairs(2), strict=True)])
        np.testing.assert_allclose(blocks[0], expected, rtol=1e-12, atol=1e-25)


def test_a_mass_without_its_slopes_is_not_that_of_the_body():
    """Negative control: half the mass at each end has no inertia against turning about its middle."""
    one = strut(7)
    lumped = np.zeros((12, 12))
    M = np.asarray(beam_mass(one, STEEL, DENSITY))
    slide = np.tile([1.0, 0, 0, 0, 0, 0], 2)
    for end in (0, 6):
        lumped[end : end + 3, end : end + 3] = slide @ M @ slide / 2 * np.eye(3)
    t, _ = axis(one)
    spin = rigid_turn(one, t, np.asarray(one.ends[0]))
    assert spin @ lumped @ spin < 1e-3 * (spin @ M @ spin)


def test_stiffness_does_not_see_rigid_turns_but_the_geometric_one_does():
    """What tells them apart: K of a rigid turn is zero, Kg of it is the force that turned."""
    one, u = strut(2), displacements(3)
    motion = rigid_turn(one, np.array([0.1, 0.2, -0.3]), np.zeros(3))
    K = np.asarray(beam_stiffness(one, STEEL))
    Kg = np.asarray(beam_geometric_stiffness(one, STEEL, jnp.asarray(u)))
    assert np.abs(K @ motion).max() < 1e-10 * np.abs(K).max()
    assert np.abs(Kg @ motion).max() > 1e-3 * np.abs(Kg).max()
