"""The joint model of a unit cell in the frame of a trimmed lattice."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from texmap_opt.case import DesignCase
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.joint_model import JointModel
from texmap_opt.joint_zones import JointZones
from texmap_opt.structure.layout import Layout
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.mixed_net import mixed_net

MODEL = JointModel(rigid_end=1.5, modulus=-2.0, radius_ratio=0.1, error=0.05)
LENGTHS = np.array([10.0, 10.0, 4.0])
PRESENT = np.array([[True, True], [True, False], [False, False]])
ZONES = JointZones({"bcc": MODEL}, np.zeros(3, np.int64), PRESENT, LENGTHS)
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
    limit = np.repeat(MODEL.radius_ratio * LENGTHS[:, None], 2, axis=1)
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
    zones = JointZones({name: model}, np.zeros(1, np.int64), np.ones((1, 2), bool), np.ones(1))
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


def test_each_strut_has_the_model_of_its_own_cell():
    """And none where its cell has no model, as diamond, or where struts of two cells meet."""
    kinds = np.zeros((2, 2, 4), np.int64)
    kinds[:, :, 2:] = 1
    cells = (unit_cell("octet"), unit_cell("kelvin"))
    net, _ = mixed_net(Layout(cells, kinds))
    nodes = np.stack(np.meshgrid(*(np.arange(n + 1.0) for n in kinds.shape), indexing="ij"), -1)
    structure = map_structure(net, nodes, 0.02)
    zones = JointZones.of(structure, case_with_zone("kelvin"), None)
    assert zones is not None
    assert list(zones.models) == ["octet", "tetrakaidecahedron"]
    radii = np.full((len(net.struts), 2), 0.02)
    rigid = np.asarray(zones.rigid_ends(radii))
    for kind, cell in enumerate(cells):
        whole = (net.kind == kind) & (net.joints[net.struts][:, :, 2] != 2).all(axis=1)
        np.testing.assert_allclose(rigid[whole], cell.joint_model.rigid_ends(radii[whole]))
    # Where half diagonals of the octet cross sides of the square.
    off_centre = np.abs(np.abs(net.joints[:, :2] % 1 - 0.5) - 0.125).max(axis=1)
    crossing = (off_centre < 1e-9) & (np.abs(net.joints[:, 2] - 2) < 1e-9)
    assert crossing.sum() == 4 * 4
    assert not rigid[crossing[net.struts]].any()


def test_a_cell_without_a_model_keeps_its_beams():
    net, _ = mixed_net(Layout((unit_cell("octet"), unit_cell("diamond")), np.array([[[0, 1]]])))
    nodes = np.stack(np.meshgrid([0.0, 1], [0.0, 1], [0.0, 1, 2], indexing="ij"), -1)
    zones = JointZones.of(map_structure(net, nodes, 0.02), case_with_zone("diamond"), None)
    assert zones is not None
    assert list(zones.models) == ["octet"]
    radii = np.full((len(net.struts), 2), 0.02)
    assert not np.asarray(zones.rigid_ends(radii))[net.kind > 0].any()
    np.testing.assert_array_equal(np.asarray(zones.modulus(radii))[net.kind > 0], 1.0)


def case_with_zone(cell: str) -> DesignCase:
    plane = {"plane": {"point": [0, 0, 0], "normal": [1, 0, 0]}}
    tables = {
        "part": {"builtin": "cantilever"},
        "material": {"name": "PA12"},
        "support": [{"region": plane}],
        "load": [{"region": plane, "force_N": [0, 0, -1]}],
        "lattice": {"cell": "octet", "cell_mm": 1.0, "radius_mm": 0.02},
        "zone": [{"cell": cell, "f_least": 1.0}],
    }
    return DesignCase.from_tables(tables, Path("case.toml"))
