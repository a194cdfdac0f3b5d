"""Loads along struts: textbook fixed-end forces, equilibrium, work, condensation, weight."""

from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fea.beam import Strut, StrutMaterial
from fea.section_forces import deflection
from fea.sections import Given, Round, Square, Tube, Wall
from fea.strut_loads import joint_loads, strut_joint_loads, strut_load_forces, strut_weight

E, NU, L, W = 70_000.0, 0.33, 12.0, 5.0
ENDS = ((0.1, 0.2, 0.3), (4.0, -3.0, 11.0))
compiled, bent = eqx.filter_jit(joint_loads), eqx.filter_jit(deflection)


def strut(ends=ENDS, radii=(0.9, 0.5), rigid=(1.0, 0.5)) -> Strut:
    return Strut(*(jnp.asarray(x, dtype=float) for x in (ends, radii, rigid, 1.0)))


def along_x(radii=(0.5, 0.5)) -> Strut:
    return strut(((0, 0, 0), (L, 0, 0)), radii, (0, 0))


def material(section=None) -> StrutMaterial:
    return StrutMaterial(E, NU, Round() if section is None else section)


def moments(values, section=None, radii=(0.5, 0.5)) -> np.ndarray:
    """What a load along y does to the joints of a strut along x: Fy, Mz at both ends."""
    load = jnp.zeros((3, 3)).at[:, 1].set(jnp.asarray(values, dtype=float))
    return np.asarray(compiled(along_x(radii), material(section), load))[[1, 5, 7, 11]]


@pytest.mark.parametrize("section", [Round(), Round(shear_factor=float("inf"))])
def test_uniform_load_between_clamps_makes_w_l_squared_over_12(section):
    """With shear deformation as without: the strut is symmetric."""
    expected = [W * L / 2, W * L**2 / 12, W * L / 2, -W * L**2 / 12]
    np.testing.assert_allclose(moments([W, W, W], section), expected, rtol=1e-13)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        # Roark's Formulas for Stress and Strain, 7th ed., table 8.1, case 2d: triangle.
        ([0, W / 2, W], [3 / 20 * W * L, W * L**2 / 30, 7 / 20 * W * L, -W * L**2 / 20]),
        # Parabola W at the middle: W L²/15, by integrating W 4 z (1 - z) four times.
        ([0, W, 0], [W * L / 3, W * L**2 / 15, W * L / 3, -W * L**2 / 15]),
    ],
)
def test_fixed_end_forces_of_slender_beams(values, expected):
    slender = Round(shear_factor=float("inf"))
    np.testing.assert_allclose(moments(values, slender), expected, rtol=1e-12)


def test_axial_load_is_shared_as_the_stiffness_of_a_taper_is():
    """Uniform load p along a cone: the far clamp takes p times the mean of ∫dx/A from it."""
    a, b = 0.5, 1.0
    load = jnp.zeros((3, 3)).at[:, 0].set(W)
    forces = np.asarray(compiled(along_x((a, b)), material(), load))
    # N = N_a - W x, the integral of N/r² is nothing; of x/r² by hand, r = a + (b - a) x/L.
    first = L / (a * b)
    second = L**2 / (b - a) ** 2 * (np.log(b / a) + a / b - 1)
    np.testing.assert_allclose(forces[0], W * second / first, rtol=1e-12)
    np.testing.assert_allclose(forces[0] + forces[6], W * L, rtol=1e-13)


def lengthwise(one: Strut, points: int):
    """Gauss points along a strut and their weights [mm]."""
    z, w = np.polynomial.legendre.leggauss(points)
    span = float(jnp.linalg.norm(one.ends[1] - one.ends[0]))
    cuts = np.array([0, one.rigid_ends[0], span - one.rigid_ends[1], span])
    x = [c + (d - c) * (z + 1) / 2 for c, d in pairwise(cuts)]
    return x, [(d - c) * w / 2 for c, d in pairwise(cuts)], span


def parabola(load: np.ndarray, z: np.ndarray) -> np.ndarray:
    basis = [(1 - z) * (1 - 2 * z), 4 * z * (1 - z), z * (2 * z - 1)]
    return np.stack(basis, axis=1) @ load


@pytest.mark.parametrize(
    "section", [Round(), Square(), Tube(ratio=0.7), Wall(depth=3.0), Given(A=2.0, I=0.7, J=0.4)]
)
@pytest.mark.parametrize("radii", [(0.6, 0.6), (0.4, 1.2)])
def test_joint_forces_do_the_work_of_the_load(section, radii):
    """For every motion of the joints; between them the strut moves as one without load."""
    one, rng = strut(radii=radii), np.random.default_rng(0)
    load, u = rng.normal(size=(3, 3)), rng.normal(size=12)
    x, weights, span = lengthwise(one, 24)
    t = np.asarray(one.ends[1] - one.ends[0]) / span
    xi = jnp.asarray((x[1] - one.rigid_ends[0]) / (span - one.rigid_ends.sum()))
    moved = [
        u[:3] + np.cross(u[3:6], x[0][:, None] * t),
        np.asarray(bent(one, material(section), jnp.asarray(u), None, xi)),
        u[6:9] + np.cross(u[9:], (x[2] - span)[:, None] * t),
    ]
    work = sum(
        np.einsum("q,qi,qi->", w, parabola(load, at / span), v)
        for at, w, v in zip(x, weights, moved, strict=True)
    )
    forces = compiled(one, material(section), jnp.asarray(load))
    np.testing.assert_allclose(forces @ u, work, rtol=1e-10)


loads = st.lists(st.floats(-10, 10), min_size=9, max_size=9)


@settings(max_examples=25, derandomize=True, deadline=None)
@given(
    load=loads, radii=st.tuples(*[st.floats(0.05, 2)] * 2), rigid=st.tuples(*[st.floats(0, 5)] * 2)
)
def test_resultant_and_moment_are_those_of_the_load(load, radii, rigid):
    one = strut(radii=radii, rigid=rigid)
    values = np.array(load).reshape(3, 3)
    forces = np.asarray(compiled(one, material(), jnp.asarray(values)))
    x, weights, span = lengthwise(one, 4)
    x, w = np.concatenate(x), np.concatenate(weights)
    start, end = np.asarray(one.ends)
    q = w[:, None] * parabola(values, x / span)
    at = start + (x / span)[:, None] * (end - start)
    moment = np.cross(start, forces[:3]) + np.cross(end, forces[6:9]) + forces[3:6] + forces[9:]
    np.testing.assert_allclose(forces[:3] + forces[6:9], q.sum(axis=0), atol=1e-11)
    np.testing.assert_allclose(moment, np.cross(at, q).sum(axis=0), atol=1e-10)


def test_a_load_on_rigid_ends_alone_goes_to_their_joints():
    """All but 1e-6 of the strut rigid: each joint gets its half with the lever of a quarter."""
    half = L / 2 - 1e-6
    one = strut(((0, 0, 0), (L, 0, 0)), (0.5, 0.5), (half, half))
    forces = np.asarray(compiled(one, material(), jnp.zeros((3, 3)).at[:, 1].set(W)))
    expected = [W * L / 2, W * L**2 / 8, W * L / 2, -W * L**2 / 8]
    np.testing.assert_allclose(forces[[1, 5, 7, 11]], expected, rtol=1e-6)


def test_forces_of_all_struts_meet_at_the_joints():
    rng = np.random.default_rng(1)
    joints, struts = rng.normal(size=(4, 3)) * 10, np.array([[0, 1], [1, 2], [3, 1]])
    all_struts = Strut(
        jnp.asarray(joints[struts]),
        jnp.asarray(rng.uniform(0.4, 0.9, (3, 2))),
        jnp.full((3, 2), 0.2),
        jnp.ones(3),
    )
    load = jnp.asarray(rng.normal(size=(2, 3, 3, 3)))
    total = np.asarray(strut_load_forces(all_struts, material(), struts, 4, load))
    each = np.asarray(strut_joint_loads(all_struts, material(), load)).reshape(2, 3, 2, 6)
    np.testing.assert_allclose(total[:, 1], each[:, 0, 1] + each[:, 1, 0] + each[:, 2, 1])
    np.testing.assert_allclose(total[:, 3], each[:, 2, 0])


@pytest.mark.parametrize("section", [Round(), Square(), Tube(ratio=0.7)])
def test_weight_is_that_of_the_frustum(section):
    a, b, density, g = 0.5, 1.1, 2.7e-9, 9810.0
    one = jax.tree.map(lambda leaf: leaf[None], strut(((0, 0, 0), (L, 0, 0)), (a, b), (0, 0)))
    load = strut_weight(one, section, density, np.array([[0, 0, -g], [g, 0, 0]]))
    forces = np.asarray(strut_joint_loads(one, material(section), load))[:, 0]
    volume = section.unit_area * L * (a**2 + a * b + b**2) / 3
    np.testing.assert_allclose(forces[0, 2] + forces[0, 8], -density * g * volume, rtol=1e-13)
    np.testing.assert_allclose(forces[1, 0] + forces[1, 6], density * g * volume, rtol=1e-13)
    # Centroid of a frustum.
    centre = L / 4 * (a**2 + 2 * a * b + 3 * b**2) / (a**2 + a * b + b**2)
    about_start = forces[0, 4] + forces[0, 10] - L * forces[0, 8]
    np.testing.assert_allclose(about_start, density * g * volume * centre, rtol=1e-12)


def test_joint_forces_can_be_differentiated_by_everything_at_equal_radii():
    rng = np.random.default_rng(2)
    load, v = jnp.asarray(rng.normal(size=(3, 3))), jnp.asarray(rng.normal(size=12))
    one = strut(radii=(0.6, 0.6))
    work = jax.jit(lambda s: v @ joint_loads(s, material(), load))
    gradient = jax.jit(jax.grad(work))(one)
    for name, reach in {"ends": 1.0, "radii": 0.5, "rigid_ends": 1.0}.items():
        at = getattr(one, name)
        by = jnp.asarray(reach * rng.normal(size=at.shape))
        slope = float(jnp.sum(getattr(gradient, name) * by))

        def rest(h: float, name=name, at=at, by=by, slope=slope) -> float:
            moved = eqx.tree_at(lambda s: getattr(s, name), one, at + h * by)
            return abs(float(work(moved) - work(one)) - h * slope)

        values = np.array([rest(h) for h in (8e-3, 4e-3, 2e-3)])
        np.testing.assert_allclose(np.log2(values[:-1] / values[1:]), 2, atol=0.1)
    # The split between the ends does not depend on the modulus.
    np.testing.assert_array_equal(gradient.modulus, 0)


def test_weight_can_be_differentiated_by_radii():
    one = jax.tree.map(lambda leaf: leaf[None], strut())

    def total(radii):
        thick = eqx.tree_at(lambda s: s.radii, one, radii)
        return strut_weight(thick, Round(), 1.0, np.array([[1.0, 0, 0]])).sum()

    a, b = one.radii[0]
    # π (a² + ((a + b)/2)² + b²)
    expected = np.pi * np.array([2 * a + (a + b) / 2, 2 * b + (a + b) / 2])
    np.testing.assert_allclose(jax.grad(total)(one.radii)[0], expected, rtol=1e-13)
