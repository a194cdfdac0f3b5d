"""The joint model of a unit cell in the frame of a trimmed lattice."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.joint_model import JointModel
from texmap_opt.joint_zones import JointZones

MODEL = JointModel(rigid_end=1.5, modulus=-2.0, slenderness=0.1, error=0.05)
LENGTHS = np.array([10.0, 10.0, 4.0])
PRESENT = np.array([[True, True], [True, False], [False, False]])
ZONES = JointZones(MODEL, PRESENT, LENGTHS)
RADII = np.array([[0.5, 0.7], [0.5, 0.5], [0.3, 0.3]])


def test_a_strut_between_two_joints_has_the_cells_own_model():
    np.testing.assert_allclose(ZONES.rigid_ends(RADII)[0], MODEL.rigid_ends(RADII)[0], rtol=1e-15)
    np.testing.assert_allclose(
        ZONES.modulus(RADII)[0], MODEL.relative_modulus(RADII, LENGTHS)[0], rtol=1e-15
    )


def test_an_end_without_a_joint_adds_nothing():
    rigid, modulus = np.asarray(ZONES.rigid_ends(RADII)), np.asarray(ZONES.modulus(RADII))
    assert rigid[1, 1] == 0
    assert not rigid[2].any()
    np.testing.assert_allclose(modulus[1], 1 - 0.05, rtol=1e-15)
    assert modulus[2] == 1


def test_thicker_struts_than_fitted_count_as_the_thickest_that_were():
    thick = np.full((3, 2), 30.0)
    limit = np.repeat(MODEL.slenderness * LENGTHS[:, None], 2, axis=1)
    np.testing.assert_allclose(ZONES.rigid_ends(thick), ZONES.rigid_ends(limit), rtol=1e-15)
    np.testing.assert_allclose(ZONES.modulus(thick), ZONES.modulus(limit), rtol=1e-15)
    assert (np.asarray(ZONES.rigid_ends(thick)).sum(axis=1) < LENGTHS).all()
    assert (np.asarray(ZONES.modulus(thick)) > 0).all()
    assert ZONES.thicker(thick) == 1
    assert ZONES.thicker(RADII) == 0


@pytest.mark.parametrize("name", ["octet", "bcc", "cube", "tetrakaidecahedron"])
def test_every_shipped_model_leaves_an_elastic_part_at_its_limit(name):
    model = unit_cell(name).joint_model
    assert model is not None
    zones = JointZones(model, np.ones((1, 2), bool), np.ones(1))
    thick = np.full((1, 2), 5.0)
    assert np.asarray(zones.rigid_ends(thick)).sum() < 0.7
    assert np.asarray(zones.modulus(thick))[0] > 0.3


def test_derivatives_by_the_radii_have_second_order_remainders():
    v = np.array([[0.1, -0.2], [0.3, 0.1], [0.2, 0.2]])
    w = jnp.asarray(np.random.default_rng(0).normal(size=(3, 2)))

    def value(radii):
        return jnp.sum(w * ZONES.rigid_ends(radii)) + jnp.sum(ZONES.modulus(radii) ** 2)

    slope = float(jnp.sum(jax.grad(value)(jnp.asarray(RADII)) * v))
    rest = [abs(float(value(RADII + h * v)) - float(value(RADII)) - h * slope) for h in (0.1, 0.05)]
    np.testing.assert_allclose(np.log2(rest[0] / rest[1]), 2, atol=0.1)
