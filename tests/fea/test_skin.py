"""Skins: what is refused, and loads as forces on joints."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shell_cases.mapped_skin import mapped_square, sphere_octant

from fea.errors import FeaError
from fea.skin import Skin
from fea.skin_loads import skin_gravity_forces, skin_pressure_forces, skin_traction_forces

POINTS = np.array([[0.0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 1]])
SKIN = Skin(np.array([[0, 1, 2], [0, 2, 3]]), np.array([0.5, 0.6]), 70_000.0, 0.3)
CURVED = sphere_octant(6, 5.0)


def refused(message: str, skin: Skin = SKIN, points: np.ndarray = POINTS) -> None:
    with pytest.raises(FeaError, match=message):
        skin.check(points)


def test_a_sound_skin_passes():
    SKIN.check(POINTS)


def test_joints_that_do_not_exist_are_named():
    triangles = np.array([[0, 1, 2], [0, 2, 4]])
    refused(
        "Triangle 1 .* joint 4, but there are joints 0 to 3", replace(SKIN, triangles=triangles)
    )


def test_a_position_that_is_not_a_number_is_named():
    points = POINTS.copy()
    points[3, 1] = np.nan
    refused("joint 3, a corner of triangle 1 .* not a number", points=points)


def test_a_triangle_twice_on_one_joint_is_named_with_its_place():
    triangles = np.array([[0, 1, 2], [0, 2, 2]])
    refused(
        r"Triangle 1 .*\(2\.66667, 2, 0\) mm has the same joint", replace(SKIN, triangles=triangles)
    )


def test_repeated_triangles_are_named_whatever_their_order():
    triangles = np.array([[0, 1, 2], [2, 1, 0]])
    refused("Triangles 0 and 1 .* remove one", replace(SKIN, triangles=triangles))


@pytest.mark.parametrize("thickness", [0.0, -1.0, np.nan, np.inf])
def test_a_thickness_that_is_not_positive_is_named_with_its_place(thickness):
    skin = replace(SKIN, thickness=np.array([0.5, thickness]))
    refused(r"Triangle 1 .*\(1\.33333, 2, 0\.333333\) mm has thickness .* must be positive", skin)


def test_a_triangle_without_area_is_named_with_its_place():
    points = POINTS.copy()
    points[3] = [2, 1.5, 0]
    refused(r"Triangle 1 .*\(2, 1\.5, 0\) mm has no area", points=points)


@pytest.mark.parametrize(
    "constants", [{"E": 0.0}, {"E": np.nan}, {"E": np.inf}, {"nu": 0.6}, {"nu": -1.0}]
)
def test_constants_that_no_material_has_are_refused(constants):
    refused("need E > 0 and -1 < nu <= 0.5", replace(SKIN, **constants))


def test_a_skin_without_triangles_is_refused():
    refused("no triangles", replace(SKIN, triangles=SKIN.triangles[:0], thickness=np.zeros(0)))


def test_pressure_pushes_against_the_normal_with_the_moment_of_the_load():
    """On a plane: the resultant acts at the centre of area."""
    mesh = mapped_square((3, 2), lambda s, t: [3 * s + t, 2 * t, 0 * s])
    forces = skin_pressure_forces(mesh.skin(0.1, 1.0, 0.3), mesh.points, 0.25)
    assert isinstance(forces, np.ndarray)
    np.testing.assert_allclose(forces.sum(axis=0), [0, 0, -0.25 * 6, 0, 0, 0], atol=1e-14)
    moment = np.cross(mesh.points, forces[:, :3]).sum(axis=0)
    np.testing.assert_allclose(moment, np.cross([2, 1, 0], [0, 0, -1.5]), atol=1e-13)


def test_pressure_on_an_octant_is_that_on_its_projections():
    """The vector area of an open surface depends on its border alone: three flat polygons here."""
    forces = skin_pressure_forces(CURVED.skin(0.1, 1.0, 0.3), CURVED.points, 1.0)
    angles = np.linspace(0, np.pi / 2, 7)
    polygon = 25 / 2 * 6 * np.sin(angles[1])
    np.testing.assert_allclose(np.abs(forces.sum(axis=0)), [polygon] * 3 + [0] * 3, atol=1e-12)


def test_traction_and_weight_have_the_resultant_of_the_load():
    skin = CURVED.skin(0.1, 1.0, 0.3)
    traction = skin_traction_forces(skin, CURVED.points, [1.0, -2.0, 3.0])
    weight = skin_gravity_forces(skin, CURVED.points, 2.7e-9, [0.0, 0.0, -9810.0])
    x = CURVED.points[CURVED.triangles]
    area = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1).sum() / 2
    np.testing.assert_allclose(traction.sum(axis=0)[:3], area * np.array([1, -2, 3]), rtol=1e-12)
    np.testing.assert_allclose(weight.sum(axis=0)[2], -area * 0.1 * 2.7e-9 * 9810, rtol=1e-12)


def test_a_load_on_some_triangles_leaves_the_others_alone():
    each = skin_pressure_forces(SKIN, POINTS, [1.0, 2.0])
    first = skin_pressure_forces(SKIN, POINTS, 1.0, faces=np.array([0]))
    second = skin_pressure_forces(SKIN, POINTS, [2.0], faces=np.array([1]))
    assert not first[3].any()
    np.testing.assert_allclose(first + second, each, rtol=1e-14)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: skin_pressure_forces(SKIN, POINTS, np.nan), "pressure is not a number"),
        (lambda: skin_pressure_forces(SKIN, POINTS, np.ones(3)), "pressure has shape"),
        (lambda: skin_traction_forces(SKIN, POINTS, [1.0, 2.0]), "traction has shape"),
        (lambda: skin_pressure_forces(SKIN, POINTS, 1.0, faces=np.array([2])), "triangles 2 to 2"),
        (lambda: skin_gravity_forces(SKIN, POINTS, 0.0, [0.0, 0.0, 1.0]), "density is 0"),
        (lambda: skin_gravity_forces(SKIN, POINTS, np.nan, [0.0, 0.0, 1.0]), "density is nan"),
    ],
    ids=["NaN", "too many", "two components", "no such triangle", "massless", "density NaN"],
)
def test_impossible_loads_are_refused(call, message):
    with pytest.raises(FeaError, match=message):
        call()


@pytest.mark.parametrize("load", ["pressure", "traction", "weight"])
def test_loads_have_a_second_order_taylor_remainder_in_points_and_thickness(load):
    rng = np.random.default_rng(0)
    probe = rng.normal(size=(4, 6))

    def work(points: jax.Array, thickness: jax.Array) -> jax.Array:
        if load == "pressure":
            forces = skin_pressure_forces(SKIN, points, [1.0, 2.0])
        elif load == "traction":
            forces = skin_traction_forces(SKIN, points, [1.0, 2.0, -1.0])
        else:
            forces = skin_gravity_forces(SKIN, points, 1.0, [1.0, 2.0, 3.0], thickness=thickness)
        return (forces * probe).sum()

    at = jnp.asarray(POINTS), jnp.asarray(SKIN.thickness)
    direction = jnp.asarray(rng.normal(size=(4, 3))), jnp.asarray(rng.normal(size=2))
    exact, slope = jax.jvp(work, at, direction)
    steps = 1e-2 * 0.5 ** np.arange(4)
    remainders = [
        abs(work(*(x + s * d for x, d in zip(at, direction, strict=True))) - exact - s * slope)
        for s in steps
    ]
    orders = np.log2(np.array(remainders[:-1]) / np.array(remainders[1:]))
    np.testing.assert_allclose(orders, 2, atol=0.1)
