"""The closed forms that solids are measured against are solutions, and the targets are theirs."""

import numpy as np
import pytest
from solid_cases import exact_fields as fields
from solid_cases.lame_and_kirsch import (
    CYLINDER_U,
    INNER_RADIUS,
    OUTER_RADIUS,
    SPHERE,
    E,
    kirsch_stress,
)

from fea import Material
from fea.voigt import tensor

POINTS = np.random.default_rng(0).uniform([2.0, -5.0, -5.0], [20.0, 5.0, 5.0], (20, 3))


def gradient(field, points, step):
    """Central differences [n, ..., j]: exact for quadratic fields, but for rounding."""
    columns = [(field(points + d) - field(points - d)) / (2 * step) for d in step * np.eye(3)]
    return np.stack(columns, axis=-1)


def test_the_graded_bar_is_in_uniaxial_tension_and_rests_on_its_supports():
    """Hooke's law with E at the point gives sigma_xx = 1 alone, which is in equilibrium."""
    H = gradient(fields.graded_exact, POINTS, 0.5)
    strain = (H + H.swapaxes(1, 2)) / 2
    lam, mu = Material(1.0, fields.NU, 0.0).lame
    trace = np.trace(strain, axis1=1, axis2=2)
    relative = lam * trace[:, None, None] * np.eye(3) + 2 * mu * strain
    stress = relative / fields.softness(POINTS)[:, None, None]
    expected = np.zeros((3, 3))
    expected[0, 0] = 1.0
    np.testing.assert_allclose(stress, np.broadcast_to(expected, stress.shape), atol=1e-12)
    held = fields.graded_exact(np.array([[0.0, 0, 0], [0, 5, 0], [0, 0, 5]]))
    np.testing.assert_allclose(held[0], 0, atol=1e-14)
    np.testing.assert_allclose(held[1, [0, 2]], 0, atol=1e-14)
    np.testing.assert_allclose(held[2, 0], 0, atol=1e-14)


def test_the_manufactured_gradient_and_body_force_are_those_of_its_displacement():
    inside = np.random.default_rng(1).uniform(0.1, 0.9, (20, 3))
    H = gradient(fields.manufactured, inside, 1e-5)
    np.testing.assert_allclose(H, fields.manufactured_gradient(inside), atol=1e-9)

    def stress(p):
        lam, mu = fields.UNIT_MATERIAL.lame
        G = fields.manufactured_gradient(p)
        trace = np.trace(G, axis1=1, axis2=2)[:, None, None]
        return lam * trace * np.eye(3) + mu * (G + G.swapaxes(1, 2))

    divergence = np.einsum("nijj->ni", gradient(stress, inside, 1e-5))
    np.testing.assert_allclose(divergence, -fields.manufactured_force(inside), atol=1e-8)


def test_kirschs_stress_is_in_equilibrium_and_free_of_traction_on_the_hole():
    divergence = gradient(lambda p: tensor(kirsch_stress(p)), POINTS / [5.0, 1.0, 1.0], 1e-5)
    np.testing.assert_allclose(np.einsum("nijj->ni", divergence), 0, atol=1e-8)
    angle = np.linspace(0, np.pi, 13)
    normal = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    on_hole = tensor(kirsch_stress(normal, nu=0.0))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", on_hole, normal), 0, atol=1e-14)
    np.testing.assert_allclose(on_hole[6, 0, 0], 3.0, rtol=1e-14)
    far = kirsch_stress(1e6 * normal, nu=0.0)
    np.testing.assert_allclose(far, np.broadcast_to([1.0, 0, 0, 0, 0, 0], far.shape), atol=1e-11)


@pytest.mark.parametrize("nu", CYLINDER_U)
def test_the_cylinders_targets_are_lames(nu):
    a, b = INNER_RADIUS, OUTER_RADIUS
    u = (1 + nu) * a * ((1 - 2 * nu) * a**2 + b**2) / (E * (b**2 - a**2))
    # Given to five digits.
    np.testing.assert_allclose(CYLINDER_U[nu], u, rtol=1e-5)


@pytest.mark.parametrize(("name", "r"), [("a", 1.0), ("b", 2.0)])
def test_the_spheres_targets_are_lames(name, r):
    """The radial displacement is r ((1 - 2 nu) + (1 + nu) b³/2r³) a³/(b³ - a³)/E."""
    nu, a3, b3 = 0.3, 1.0, 8.0
    share = a3 / (b3 - a3)
    u = r * share * ((1 - 2 * nu) + (1 + nu) * b3 / (2 * r**3)) / E
    np.testing.assert_allclose(SPHERE[f"u_{name}"], u, rtol=1e-6)
    np.testing.assert_allclose(SPHERE[f"hoop_{name}"], share * (1 + b3 / (2 * r**3)), rtol=1e-6)
