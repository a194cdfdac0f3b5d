"""Stress of struts against elementary beam theory, and their buckling against eigenvalues."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import eigh

from fea import strut_strength
from fea.adjoint import displacement
from fea.errors import FeaError
from fea.frame import FrameProblem, FrameSolution, solve_frame
from fea.objectives import p_norm
from fea.sections import AbstractSection, Given, Round, Square, Tube
from fea.strut_strength import (
    buckling_utilisation,
    end_stress,
    euler_load,
    euler_utilisation,
    strut_stress,
    strut_utilisation,
    utilisation,
)

LENGTH, RADIUS, E = 40.0, 1.5, 2.1e5


def cantilever(
    load: list[float],
    section: AbstractSection,
    *,
    radii: tuple[float, float] = (RADIUS, RADIUS),
    strut_load: np.ndarray | None = None,
    rigid_ends: np.ndarray | None = None,
) -> FrameSolution:
    """A strut along an oblique axis, clamped at its first end; the load in its own axes."""
    t, m, n = np.linalg.qr(np.array([[1.0, 2, 3], [0, 1, -1], [2, 0, 1]]).T)[0].T
    frame = np.stack([t, m, n])
    forces = np.zeros((1, 2, 6))
    forces[0, 1] = np.concatenate([np.array(load[:3]) @ frame, np.array(load[3:]) @ frame])
    fixed = np.zeros((2, 6), bool)
    fixed[0] = True
    return solve_frame(
        FrameProblem(
            joints=np.stack([np.zeros(3), LENGTH * t]),
            struts=np.array([[0, 1]]),
            radii=np.array([radii]),
            E=E,
            nu=0.3,
            section=section,
            fixed=fixed,
            value=np.zeros((2, 6)),
            forces=forces,
            rigid_ends=rigid_ends,
            strut_loads=None if strut_load is None else (strut_load @ frame)[None, None],
        )
    )


A, W = np.pi * RADIUS**2, np.pi * RADIUS**3 / 4


@pytest.mark.parametrize(
    ("load", "at_clamp", "at_tip"),
    [
        ([100.0, 0, 0, 0, 0, 0], 100 / A, 100 / A),
        ([-100.0, 0, 0, 0, 0, 0], 100 / A, 100 / A),
        # At the tip the peak shear of the transverse force is left: 4/3 of the mean.
        ([0, 3.0, 4.0, 0, 0, 0], 5 * LENGTH / W, np.sqrt(3) * 4 / 3 * 5 / A),
        ([0, 0, 0, 70.0, 0, 0], np.sqrt(3) * 70 / (2 * W), np.sqrt(3) * 70 / (2 * W)),
        ([9.0, 0, 0, 70.0, 30.0, 40.0],) + 2 * (np.hypot(9 / A + 50 / W, np.sqrt(3) * 35 / W),),
    ],
)
def test_round_strut_stress_is_that_of_elementary_beam_theory(load, at_clamp, at_tip):
    stress = end_stress(cantilever(load, Round()))[0, 0]
    np.testing.assert_allclose(stress, [at_clamp, at_tip], rtol=1e-9)


def test_a_square_strut_is_safe_in_every_bending_direction():
    """Bent about a diagonal the largest stress is sqrt(2) times that about a side."""
    stress = end_stress(cantilever([0, 0, 0, 0, 50.0, 0], Square()))[0, 0]
    side = 2 * RADIUS
    np.testing.assert_allclose(stress, np.sqrt(2) * 50 / (side**3 / 6), rtol=1e-9)


def test_a_tube_is_weaker_by_what_is_missing():
    stress = end_stress(cantilever([0, 0, 0, 0, 50.0, 0], Tube(ratio=0.8)))[0, 0]
    np.testing.assert_allclose(stress, 50 / (W * (1 - 0.8**4)), rtol=1e-9)


def test_stress_is_taken_at_the_ends_of_the_elastic_part():
    """The moment where the rigid end stops, 5 mm from the clamp, and the taper's radius there."""
    solution = cantilever(
        [0, 5.0, 0, 0, 0, 0], Round(), radii=(1.5, 1.1), rigid_ends=np.array([[5.0, 0.0]])
    )
    radius = 1.5 - 0.4 * 5 / LENGTH
    expected = 5 * (LENGTH - 5) / (np.pi * radius**3 / 4)
    np.testing.assert_allclose(end_stress(solution)[0, 0, 0], expected, rtol=1e-9)


def test_utilisation_is_the_worst_stress_over_yield():
    solution = cantilever([0, 5.0, 0, 0, 0, 0], Round())
    np.testing.assert_allclose(utilisation(solution, 200.0), 5 * LENGTH / W / 200, rtol=1e-9)
    for yield_stress in (0.0, float("nan")):
        with pytest.raises(FeaError, match="must be positive"):
            utilisation(solution, yield_stress)


def test_a_strong_taper_is_most_stressed_between_its_ends():
    """Moment F x over W ~ (c + x)³, x from the tip: largest where x = c/2."""
    c = LENGTH  # the tip has half the radius of the clamp
    solution = cantilever([0, 5.0, 0, 0, 0, 0], Round(), radii=(2 * RADIUS, RADIUS))
    radius = RADIUS * (1 + 0.5)
    expected = 5 * (c / 2) / (np.pi * radius**3 / 4)
    np.testing.assert_allclose(utilisation(solution, 1.0), expected, rtol=1e-9)
    assert end_stress(solution).max() < 0.9 * expected


def test_a_load_along_the_strut_is_seen_between_its_ends():
    """Moments at the tip that undo half of the clamp's: the largest is between them."""
    w = 0.5
    load = np.tile([0.0, w, 0.0], (3, 1))
    # Simply supported, so to say: the tip carries half of the load, the clamp no moment.
    solution = cantilever([0, -w * LENGTH / 2, 0, 0, 0, 0], Round(), strut_load=load)
    middle = w * LENGTH**2 / 8 / W
    np.testing.assert_allclose(utilisation(solution, 1.0), middle, rtol=1e-9)
    assert end_stress(solution).max() < 0.2 * middle


def space_frame(*, loaded: bool = False) -> FrameProblem:
    """A cube's edges and diagonals, joints jittered, clamped below, two cases."""
    rng = np.random.default_rng(0)
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T * 10.0
    joints = corners + rng.uniform(-1, 1, (8, 3))
    a, b = np.triu_indices(8, 1)
    short = np.linalg.norm(corners[a] - corners[b], axis=1) < 15
    struts = np.stack([a[short], b[short]], axis=1)
    fixed = np.repeat(corners[:, 2:] == 0, 6, axis=1)
    forces = np.where(fixed, 0, rng.normal(size=(2, 8, 6)) * [9, 9, 9, 5, 5, 5])
    return FrameProblem(
        joints=joints,
        struts=struts,
        radii=rng.uniform(0.4, 0.9, (len(struts), 2)),
        E=E,
        nu=0.3,
        section=Round(),
        fixed=fixed,
        value=np.zeros((8, 6)),
        forces=forces,
        rigid_ends=rng.uniform(0.1, 0.5, (len(struts), 2)),
        strut_loads=rng.normal(size=(2, len(struts), 3, 3)) if loaded else None,
    )


@jax.jit
def judged(u, parameters):
    """Norms of the stress at all sections, and of Euler utilisation."""
    frame = space_frame(loaded="strut_loads" in parameters)
    stress = strut_stress(frame, u, **parameters) / 200.0
    euler = euler_utilisation(frame, u, length_factor=0.5, **parameters)
    return jnp.stack([p_norm(v, jnp.ones_like(v), p=8.0) for v in (stress, euler)])


def test_gradients_through_the_solution_have_second_order_taylor_remainders():
    """By joints, radii, rigid ends and loads at once, in a direction of each."""
    frame = space_frame(loaded=True)
    rng = np.random.default_rng(1)
    reach = {"joints": 0.5, "radii": 0.1, "rigid_ends": 0.1, "strut_loads": 0.5}
    at = {name: jnp.asarray(getattr(frame, name)) for name in reach}
    by = {name: jnp.asarray(rng.normal(size=at[name].shape) * reach[name]) for name in reach}

    def value(parameters):
        return judged(displacement(frame, **parameters), parameters)

    start, pull = jax.vjp(value, at)
    steps = (2e-2, 1e-2, 5e-3)
    moved = np.stack([value({name: at[name] + h * by[name] for name in reach}) for h in steps])
    for i, one in enumerate(jnp.eye(2)):
        (gradient,) = pull(one)
        slope = sum(float(jnp.sum(gradient[name] * by[name])) for name in reach)
        rest = np.abs(moved[:, i] - start[i] - np.array(steps) * slope)
        np.testing.assert_allclose(np.log2(rest[:-1] / rest[1:]), 2, atol=0.2)
        # Negative control: half a percent off is first order.
        wrong = np.abs(moved[:, i] - start[i] - np.array(steps) * 1.005 * slope)
        assert np.log2(wrong[-2] / wrong[-1]) < 1.8


def test_many_struts_in_batches_have_the_stress_and_the_gradient_of_few(monkeypatch):
    frame = space_frame(loaded=True)
    u = jnp.asarray(np.random.default_rng(2).normal(size=(2, 8, 6)))

    def value(u):
        return strut_stress(frame, u, points=2).sum()

    expected = jax.value_and_grad(value)(u)
    monkeypatch.setattr(strut_strength, "AT_ONCE", 7)  # neither all struts nor a divisor of them
    jax.clear_caches()
    batched = jax.value_and_grad(value)(u)
    for a, b in zip(batched, expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10)


def test_gradients_are_numbers_where_nothing_is_loaded():
    """Also for prismatic struts, and where only some struts carry nothing."""
    frame = space_frame()
    gradient = jax.jit(jax.grad(lambda u, p: judged(u, p).sum(), argnums=(0, 1)))
    one_joint = np.zeros((2, 8, 6))
    one_joint[:, -1, 0] = 1e-3
    for u in (np.zeros((2, 8, 6)), one_joint):
        for radii in (frame.radii, np.full_like(frame.radii, 0.7)):
            parameters = {"joints": jnp.asarray(frame.joints), "radii": jnp.asarray(radii)}
            for leaf in jax.tree.leaves(gradient(jnp.asarray(u), parameters)):
                assert np.isfinite(leaf).all()


def test_values_for_reports_are_those_that_are_differentiated():
    frame = space_frame(loaded=True)
    solution = solve_frame(frame)
    u = solution.displacement
    use = strut_utilisation(frame, u, yield_stress=200.0)
    np.testing.assert_allclose(use, strut_stress(frame, u).max(axis=2) / 200.0)
    np.testing.assert_allclose(utilisation(solution, 200.0), use.max(axis=0))
    euler = euler_utilisation(frame, u, length_factor=0.5)
    np.testing.assert_allclose(buckling_utilisation(solution, length_factor=0.5), euler.max(axis=0))


def critical_load(radii: tuple[float, float], held: str) -> float:
    """Lowest eigenvalue of 200 cubic (Hermite) elements with consistent geometric stiffness.

    Elements of the mean of I over their length: exact to 1e-5 here.
    """
    elements = 200
    h, z = LENGTH / elements, np.linspace(0, 1, elements + 1)
    inertia = np.pi / 4 * (radii[0] + (radii[1] - radii[0]) * z) ** 4
    middle = np.pi / 4 * (radii[0] + (radii[1] - radii[0]) * (z[1:] + z[:-1]) / 2) ** 4
    I = (inertia[1:] + 4 * middle + inertia[:-1]) / 6
    bend = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
    string = np.array([[36, 3, -36, 3], [3, 4, -3, -1], [-36, -3, 36, -3], [3, -1, -3, 4]]) / 30
    scale = np.outer([1, h, 1, h], [1, h, 1, h])
    K, S = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
    for e in range(elements):
        at = slice(2 * e, 2 * e + 4)
        K[at, at] += E * I[e] / h**3 * bend * scale
        S[at, at] += string * scale / h
    fixed = {"hinged": [0, -2], "clamped": [0, 1, -2, -1], "propped": [0, 1, -2]}[held]
    free = np.setdiff1d(np.arange(len(K)), np.mod(fixed, len(K)))
    # The largest of the inverse: S is definite, and the eigenvalue wanted well separated.
    return 1 / eigh(S[np.ix_(free, free)], K[np.ix_(free, free)], eigvals_only=True)[-1]


@pytest.mark.parametrize("radii", [(1.0, 1.0), (1.0, 0.6), (0.4, 1.2)])
@pytest.mark.parametrize(
    ("held", "factor"),
    # 0.699156 = π/4.493409, 4.493409 the first root of tan x = x.
    [("hinged", 1.0), ("clamped", 0.5), ("propped", np.pi / 4.493409457909064)],
)
def test_euler_load_of_a_taper_is_the_eigenvalue(radii, held, factor):
    """Exact for every column whose ends do not sway; 1e-4 is that of the elements."""
    frame = cantilever([1.0, 0, 0, 0, 0, 0], Round(), radii=radii).problem
    expected = critical_load(radii, held)
    np.testing.assert_allclose(euler_load(frame, length_factor=factor), expected, rtol=1e-4)


def test_the_mean_radius_would_not_do():
    """Negative control: the arithmetic mean of the radii promises 78 % too much here."""
    mean = np.pi**2 * E * np.pi / 4 * 0.8**4 / LENGTH**2
    np.testing.assert_allclose(mean / critical_load((0.4, 1.2), "hinged"), 1.78, atol=0.01)


def test_only_compression_buckles():
    for section in (Round(), Tube(ratio=0.7), Given(A=2.0, I=0.7, J=0.4)):
        use = [
            buckling_utilisation(cantilever([force, 2.0, 0, 0, 0, 0], section))[0]
            for force in (-100.0, 100.0)
        ]
        inertia = section.second_moment(np.array([RADIUS]))[0]
        expected = 100 / (np.pi**2 * E * inertia / LENGTH**2)
        np.testing.assert_allclose(use, [expected, 0], rtol=1e-9)


def test_the_largest_compression_along_a_loaded_strut_counts():
    """Its own load pushes towards the clamp: w L there."""
    load = np.tile([-0.5, 0.0, 0.0], (3, 1))
    solution = cantilever([0, 1.0, 0, 0, 0, 0], Round(), strut_load=load)
    expected = 0.5 * LENGTH / euler_load(solution.problem)
    np.testing.assert_allclose(buckling_utilisation(solution), expected, rtol=1e-9)


def test_relative_moduli_enter_the_euler_load():
    frame = space_frame()
    half = replace(frame, modulus=np.full(len(frame.struts), 0.5))
    np.testing.assert_allclose(euler_load(half), euler_load(frame) / 2)


def test_a_length_factor_that_is_none_is_refused():
    frame = space_frame()
    with pytest.raises(FeaError, match="hinged"):
        euler_load(frame, length_factor=0.0)
