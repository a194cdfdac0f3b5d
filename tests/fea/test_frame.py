"""The beam element and frames: invariances, supports, gradients, bad input."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fea.adjoint import compliance_gradient, displacement
from fea.beam import beam_stiffnesses
from fea.errors import FeaError
from fea.frame import FrameProblem, solve_frame
from fea.frame_checks import free_frame_motion
from fea.sections import Round, Square
from fea.skin import Skin

MATERIAL = (70_000.0, 0.3)


def space_frame(seed: int = 0) -> FrameProblem:
    """A cube's edges and diagonals, joints jittered, clamped below, loaded above, two cases."""
    rng = np.random.default_rng(seed)
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T * 10.0
    joints = corners + rng.uniform(-1, 1, (8, 3))
    a, b = np.triu_indices(8, 1)
    short = np.linalg.norm(corners[a] - corners[b], axis=1) < 15
    struts = np.stack([a[short], b[short]], axis=1)
    fixed = np.repeat(corners[:, 2:] == 0, 6, axis=1)
    forces = np.where(fixed, 0, rng.normal(size=(2, 8, 6)) * [1, 1, 1, 5, 5, 5])
    return FrameProblem(
        joints=joints,
        struts=struts,
        radii=rng.uniform(0.4, 0.9, (len(struts), 2)),
        E=MATERIAL[0],
        nu=MATERIAL[1],
        section=Round(),
        fixed=fixed,
        value=np.zeros((8, 6)),
        forces=forces,
    )


def moved(frame: FrameProblem, turn: Rotation, shift: np.ndarray) -> FrameProblem:
    def turned(field: np.ndarray) -> np.ndarray:
        return turn.apply(field.reshape(-1, 3)).reshape(field.shape)

    return replace(frame, joints=turned(frame.joints) + shift, forces=turned(frame.forces))


def test_a_free_frame_has_exactly_six_zero_energy_motions():
    frame = space_frame()
    K = beam_stiffnesses(frame.strut_values(), frame.strut_material)
    whole = np.zeros((48, 48))
    for (a, b), k in zip(frame.struts, np.asarray(K), strict=True):
        dofs = np.r_[6 * a : 6 * a + 6, 6 * b : 6 * b + 6]
        whole[np.ix_(dofs, dofs)] += k
    energy = np.linalg.eigvalsh(whole) / np.abs(whole).max()
    assert np.sum(np.abs(energy) < 1e-12) == 6


@settings(max_examples=10, derandomize=True, deadline=None)
@given(
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.tuples(*[st.floats(-100, 100)] * 3),
)
def test_compliance_does_not_change_when_everything_is_moved_and_turned(angles, shift):
    frame = space_frame()
    turned = moved(frame, Rotation.from_rotvec(angles), np.array(shift))
    np.testing.assert_allclose(
        solve_frame(turned).compliance, solve_frame(frame).compliance, rtol=1e-10
    )


def test_compliance_does_not_depend_on_the_numbering():
    frame = space_frame()
    order = np.random.default_rng(1).permutation(8)
    number = np.argsort(order)
    renumbered = replace(
        frame,
        joints=frame.joints[order],
        struts=number[frame.struts][::-1, ::-1].copy(),
        radii=frame.radii[::-1, ::-1].copy(),
        fixed=frame.fixed[order],
        forces=frame.forces[:, order],
    )
    np.testing.assert_allclose(
        solve_frame(renumbered).compliance, solve_frame(frame).compliance, rtol=1e-10
    )


def test_scaling_all_lengths_scales_compliance_as_dimensions_demand():
    """With forces F and lengths a: compliance ~ F²/(E a); moments scale as F a."""
    frame, a = space_frame(), 3.0
    scale = np.array([1, 1, 1, a, a, a])
    large = replace(
        frame, joints=a * frame.joints, radii=a * frame.radii, forces=scale * frame.forces
    )
    np.testing.assert_allclose(
        a * solve_frame(large).compliance, solve_frame(frame).compliance, rtol=1e-10
    )


def test_reactions_balance_forces_and_moments():
    frame = space_frame()
    total = frame.forces + solve_frame(frame).reaction
    force = total[..., :3].sum(axis=1)
    moment = (np.cross(frame.joints, total[..., :3]) + total[..., 3:]).sum(axis=1)
    np.testing.assert_allclose(force, 0, atol=1e-10)
    np.testing.assert_allclose(moment, 0, atol=1e-9)


def test_end_forces_of_each_strut_are_in_balance():
    frame = space_frame()
    first, second = np.split(solve_frame(frame).end_forces, 2, axis=2)
    arm = np.diff(frame.joints[frame.struts], axis=1)[:, 0]
    np.testing.assert_allclose(first[..., :3] + second[..., :3], 0, atol=1e-10)
    moment = first[..., 3:] + second[..., 3:] + np.cross(arm, second[..., :3])
    np.testing.assert_allclose(moment, 0, atol=1e-9)


def test_a_frame_moved_rigidly_by_its_supports_carries_nothing():
    """Prescribed values of a rigid motion give that motion and no end forces."""
    frame = space_frame()
    shift, turn = np.array([0.1, -0.2, 0.3]), np.array([1e-3, 2e-3, -1e-3])
    rigid = np.hstack([shift + np.cross(turn, frame.joints), np.tile(turn, (8, 1))])
    solution = solve_frame(replace(frame, value=rigid, forces=np.zeros((1, 8, 6))))
    np.testing.assert_allclose(solution.displacement[0], rigid, atol=1e-12)
    # Stiffness times displacement is some 1e4 N before it cancels.
    np.testing.assert_allclose(solution.end_forces, 0, atol=1e-8)


def test_a_dangling_strut_changes_nothing():
    frame = space_frame()
    more = replace(
        frame,
        joints=np.vstack([frame.joints, [20.0, 20.0, 20.0]]),
        struts=np.vstack([frame.struts, [7, 8]]),
        radii=np.vstack([frame.radii, [0.5, 0.5]]),
        fixed=np.vstack([frame.fixed, np.zeros((1, 6), bool)]),
        value=np.zeros((9, 6)),
        forces=np.concatenate([frame.forces, np.zeros((2, 1, 6))], axis=1),
    )
    np.testing.assert_allclose(
        solve_frame(more).compliance, solve_frame(frame).compliance, rtol=1e-10
    )


def remainder_orders(value, slope, steps=(1e-2, 5e-3, 2.5e-3)) -> np.ndarray:
    """Observed orders of |f(h) - f(0) - h slope| as h halves."""
    rest = [abs(value(h) - value(0.0) - h * slope) for h in steps]
    return np.log2(np.array(rest[:-1]) / np.array(rest[1:]))


@pytest.mark.parametrize("varied", ["joints", "radii"])
@pytest.mark.parametrize("prescribed", [False, True])
@pytest.mark.parametrize("section", [Round(), Square(), Round(shear_factor=float("inf"))])
def test_compliance_gradient_has_a_second_order_taylor_remainder(varied, prescribed, section):
    frame = replace(space_frame(), section=section)
    if prescribed:
        value = np.where(frame.fixed, np.random.default_rng(2).normal(size=(8, 6)), 0.0) * 1e-3
        frame = replace(frame, value=value)
    v = np.random.default_rng(3).normal(size=getattr(frame, varied).shape)
    v *= 0.5 if varied == "joints" else 0.1

    def value(h: float) -> float:
        trial = replace(frame, **{varied: getattr(frame, varied) + h * v})
        return float(solve_frame(trial).compliance.sum())

    slope = float(np.sum(compliance_gradient(solve_frame(frame))[varied] * v))
    np.testing.assert_allclose(remainder_orders(value, slope), 2, atol=0.1)


def test_a_wrong_gradient_fails_the_taylor_test():
    """Negative control: half a percent off is first order."""
    frame = space_frame()
    v = np.ones_like(frame.radii) * 0.1

    def value(h: float) -> float:
        return float(solve_frame(replace(frame, radii=frame.radii + h * v)).compliance.sum())

    slope = 1.005 * float(np.sum(compliance_gradient(solve_frame(frame))["radii"] * v))
    orders = remainder_orders(value, slope, steps=(2e-3, 1e-3, 5e-4))
    assert orders[-1] < 1.7


def test_jax_differentiates_compliance_as_the_adjoint_does():
    frame = space_frame()
    w = np.array([2.0, 0.5])

    def weighted(joints, radii, forces):
        u = displacement(frame, joints=joints, radii=radii, forces=forces)
        return jnp.einsum("c,cji,cji->", jnp.asarray(w), forces, u)

    at = [jnp.asarray(a) for a in (frame.joints, frame.radii, frame.forces)]
    by_jax = jax.grad(weighted, argnums=(0, 1, 2))(*at)
    adjoint = compliance_gradient(solve_frame(frame), w)
    for a, b in zip(by_jax, [adjoint[name] for name in ("joints", "radii", "forces")], strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-14)
    # f.u is quadratic in f: its derivative along f is twice itself.
    C = solve_frame(frame).compliance
    np.testing.assert_allclose(np.sum(adjoint["forces"] * frame.forces), 2 * w @ C, rtol=1e-10)


@pytest.mark.parametrize("solver", ["superlu", "amg"])
def test_a_later_size_solved_with_the_earlier_factorisation_is_the_same(solver):
    frame = space_frame()
    thicker = replace(frame, radii=1.1 * frame.radii)
    again = solve_frame(thicker, previous=solve_frame(frame, solver=solver))
    np.testing.assert_allclose(again.compliance, solve_frame(thicker).compliance, rtol=1e-8)
    assert again.residual < 1e-9


@pytest.mark.parametrize(
    ("fixed", "words"),
    [
        (np.zeros(6, bool), "slides and turns in every direction"),
        (np.array([1, 1, 1, 1, 1, 0], bool), "turns about an axis along z"),
        (np.array([1, 1, 0, 1, 1, 1], bool), "slides along z"),
        (np.ones(6, bool), None),
    ],
)
def test_a_left_over_rigid_motion_is_named(fixed, words):
    frame = space_frame()
    held = np.zeros((8, 6), bool)
    held[0] = fixed
    motion = free_frame_motion(frame.joints, held, frame.links)
    assert motion is None if words is None else words in motion


def test_an_unheld_piece_beside_a_held_one_is_found():
    frame = space_frame()
    two = replace(
        frame,
        joints=np.vstack([frame.joints, frame.joints + 50]),
        struts=np.vstack([frame.struts, frame.struts + 8]),
        radii=np.vstack([frame.radii, frame.radii]),
        fixed=np.vstack([frame.fixed, np.zeros((8, 6), bool)]),
        value=np.zeros((16, 6)),
        forces=np.concatenate([frame.forces, frame.forces], axis=1),
    )
    assert "2 pieces" in str(free_frame_motion(two.joints, two.fixed, two.links))
    with pytest.raises(FeaError):
        solve_frame(two)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radii": np.zeros}, "radii must be positive"),
        ({"joints": np.zeros}, "no length"),
        ({"radii": lambda shape: np.full(shape, np.nan)}, "radius of strut 0: nan, nan mm is not"),
        ({"joints": lambda shape: np.full(shape, np.nan)}, "position of joint 0: nan, nan, nan mm"),
        ({"value": lambda shape: np.full(shape, np.nan)}, r"at node 0, \(.*\) mm, dof 0, is nan"),
    ],
)
def test_impossible_frames_are_refused_by_name(change, message):
    frame = space_frame()
    broken = {name: make(getattr(frame, name).shape) for name, make in change.items()}
    with pytest.raises(FeaError, match=message):
        solve_frame(replace(frame, **broken))


def test_a_previous_solution_of_another_frame_is_refused():
    frame = space_frame()
    other = replace(frame, struts=frame.struts[::-1].copy())
    with pytest.raises(FeaError, match="other elements"):
        solve_frame(other, previous=solve_frame(frame))


def test_end_forces_of_a_strut_that_carries_a_load_of_its_own():
    """Clamped at both ends under w: w L/2 and w L²/12 at each (any table of fixed-end moments)."""
    w, L = 3.0, 20.0
    beam = FrameProblem(
        joints=np.array([[0, 0, 0], [L, 0, 0]]),
        struts=np.array([[0, 1]]),
        radii=np.full((1, 2), 0.5),
        E=MATERIAL[0],
        nu=MATERIAL[1],
        section=Round(),
        fixed=np.ones((2, 6), bool),
        value=np.zeros((2, 6)),
        forces=np.zeros((1, 2, 6)),
        strut_loads=np.broadcast_to([0, 0, -w], (1, 1, 3, 3)).copy(),
    )
    solution = solve_frame(beam)
    half, moment = w * L / 2, w * L**2 / 12
    expected = [0, 0, half, 0, -moment, 0, 0, 0, half, 0, moment, 0]
    np.testing.assert_allclose(solution.end_forces[0, 0], expected, atol=1e-10 * moment)
    np.testing.assert_allclose(solution.reaction[0].ravel(), expected, atol=1e-10 * moment)


@pytest.mark.parametrize("solver", ["superlu", "jax-cg"])
def test_a_skin_needs_no_struts(solver):
    """A square membrane pulled by sigma: it grows by sigma/E along, and shrinks by nu sigma/E across.

    Its joints do not turn, so that supports carry the moments of the traction on its edges.
    """
    E, nu, sigma, h = 1000.0, 0.25, 2.0, 0.5
    corners = np.array([[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0.0]])
    fixed = np.zeros((4, 6), dtype=bool)
    fixed[0] = fixed[1, 1] = fixed[3, 0] = fixed[:, 2:] = True
    forces = np.zeros((1, 4, 6))
    forces[0, [1, 2], 0] = sigma * h * 10 / 2
    sheet = FrameProblem(
        joints=corners,
        struts=np.zeros((0, 2), dtype=int),
        radii=np.zeros((0, 2)),
        E=1.0,
        nu=0.0,
        section=Round(),
        fixed=fixed,
        value=np.zeros((4, 6)),
        forces=forces,
        skin=Skin(np.array([[0, 1, 2], [0, 2, 3]]), np.full(2, h), E, nu),
    )
    u = solve_frame(sheet, solver=solver).displacement[0]
    strain = np.array([sigma / E, -nu * sigma / E, 0.0])
    # jax-cg stops at a relative residual of 1e-8 or less.
    np.testing.assert_allclose(u[:, :3], corners * strain, atol=1e-6 * 10 * sigma / E)
    np.testing.assert_allclose(u[:, 3:], 0.0, atol=1e-6 * sigma / E)
