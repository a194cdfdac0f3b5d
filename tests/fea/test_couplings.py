"""Couplings: rigid and load-distributing references, and ends tied to triangles."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fea import (
    FeaError,
    FrameProblem,
    Inertia,
    Round,
    SingularStiffness,
    displacement,
    solve_frame,
    vibration,
)
from fea.adjoint import compliance_gradient
from fea.beam import BLOCK
from fea.couplings import Distributing, Rigid, Tie
from fea.skin import Skin
from fea.transfer import Transfer

E, NU = 70e3, 0.3


def grid_frame(seed: int = 0) -> FrameProblem:
    """Four clamped columns with a jittered ring on top, and one more joint, 8, above the ring."""
    rng = np.random.default_rng(seed)
    feet = np.array([[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0.0]])
    joints = np.vstack([feet, feet + np.array([0, 0, 15]), [[5, 5, 20]]]) + rng.uniform(
        -1, 1, (9, 3)
    )
    struts = np.array([[0, 4], [1, 5], [2, 6], [3, 7], [4, 5], [5, 6], [6, 7], [7, 4], [4, 6]])
    fixed = np.zeros((9, 6), bool)
    fixed[:4] = True
    forces = np.zeros((2, 9, 6))
    forces[:, 8] = rng.normal(size=(2, 6)) * [10, 10, 10, 50, 50, 50]
    radii = rng.uniform(0.5, 0.9, (len(struts), 2))
    return FrameProblem(joints, struts, radii, E, NU, Round(), fixed, np.zeros((9, 6)), forces)


def skinned(seed: int = 0) -> FrameProblem:
    """The same with a skin of two triangles on the ring, and a strut tied to one of them."""
    frame = grid_frame(seed)
    joints = np.vstack([frame.joints, [[4, 6, 15.5]]])
    struts = np.vstack([frame.struts, [[9, 8]]])
    skin = Skin(np.array([[4, 5, 6], [4, 6, 7]]), np.array([0.5, 0.7]), E, NU)
    tie = Tie(np.array([9]), np.array([[4, 6, 7]]), np.array([[0.3, 0.3, 0.4]]))
    grown = {
        name: np.concatenate(
            [getattr(frame, name), np.zeros_like(getattr(frame, name)[..., :1, :])], -2
        )
        for name in ("fixed", "value", "forces")
    }
    radii = np.vstack([frame.radii, [[0.6, 0.5]]])
    return replace(
        frame, joints=joints, struts=struts, radii=radii, skin=skin, couplings=(tie,), **grown
    )


RING = np.array([4, 5, 6, 7])
COUPLED = [
    replace(grid_frame(), couplings=(Rigid(8, RING),)),
    replace(grid_frame(), couplings=(Distributing(8, RING),)),
    replace(grid_frame(), couplings=(Distributing(8, RING, np.array([1.0, 2, 3, 4]), lever=3.0),)),
    skinned(),
    # A chain: 8 follows the ring, of which two joints follow a third.
    replace(grid_frame(), couplings=(Distributing(8, RING), Rigid(4, np.array([5, 6])))),
]
NAMES = ["rigid", "distributing", "weighted", "tie", "chain"]


def transfer(frame: FrameProblem) -> Transfer:
    return Transfer.of(frame.couplings, frame.joints)


@pytest.mark.parametrize("frame", COUPLED, ids=NAMES)
def test_rigid_motions_pass_through_couplings_unchanged(frame):
    rng = np.random.default_rng(1)
    shift, turn = rng.normal(size=(2, 3))
    motion = np.concatenate(
        [shift + np.cross(turn, frame.joints), np.tile(turn, (len(frame.joints), 1))], axis=1
    )
    T = transfer(frame)
    independent = np.where(T.dependent[:, None], 0.0, motion)
    np.testing.assert_allclose(T.spread(independent[None])[0], motion, atol=1e-12)


@pytest.mark.parametrize("frame", COUPLED, ids=NAMES)
def test_loads_keep_their_resultant_and_moment(frame):
    """By virtual work that is the same statement as the one on rigid motions."""
    gathered = transfer(frame).gathered(frame.forces)
    for f, g in zip(frame.forces, gathered, strict=True):
        np.testing.assert_allclose(g[:, :3].sum(0), f[:, :3].sum(0), atol=1e-12)
        moment = [np.cross(frame.joints, h[:, :3]) + h[:, 3:] for h in (f, g)]
        np.testing.assert_allclose(moment[1].sum(0), moment[0].sum(0), atol=1e-11)


@pytest.mark.parametrize("frame", COUPLED, ids=NAMES)
def test_reactions_balance_the_loads(frame):
    solution = solve_frame(frame)
    total = frame.forces + solution.reaction
    np.testing.assert_allclose(total[..., :3].sum(1), 0, atol=1e-9)
    moment = np.cross(frame.joints, total[..., :3]) + total[..., 3:]
    np.testing.assert_allclose(moment.sum(1), 0, atol=1e-8)


@pytest.mark.parametrize("frame", COUPLED[:3], ids=NAMES[:3])
def test_the_reduced_system_is_that_of_lagrange_multipliers(frame):
    """K u - f is a combination of the constraints, u_d - B u = 0, and these hold."""
    solution = solve_frame(frame)
    T = transfer(frame)
    u = solution.displacement
    held = frame.fixed[None] | False
    np.testing.assert_allclose(T.spread(np.where(T.dependent[:, None], 0.0, u)), u, atol=1e-14)
    C = (
        np.eye(u[0].size)[np.repeat(T.dependent, BLOCK)]
        - T.step.toarray()[np.repeat(T.dependent, BLOCK)]
    )
    K = solution.system.K.toarray()
    free = ~held[0].ravel()
    n = int(free.sum())
    saddle = np.block(
        [[K[np.ix_(free, free)], C[:, free].T], [C[:, free], np.zeros((len(C),) * 2)]]
    )
    rhs = np.concatenate([frame.forces.reshape(2, -1)[:, free].T, np.zeros((len(C), 2))])
    expected = np.linalg.solve(saddle, rhs)[:n].T
    np.testing.assert_allclose(u.reshape(2, -1)[:, free], expected, rtol=1e-8, atol=1e-12)


def test_a_rigid_coupling_is_the_limit_of_stiff_struts():
    """Spokes a hundred times as thick leave a difference of about their flexibility, below 1e-6."""
    frame = grid_frame()
    spokes = np.stack([np.full(4, 8), RING], axis=1)
    stiff = replace(
        frame,
        struts=np.vstack([frame.struts, spokes]),
        radii=np.vstack([frame.radii, np.full((4, 2), 60.0)]),
    )
    coupled = replace(frame, couplings=(Rigid(8, RING),))
    np.testing.assert_allclose(
        solve_frame(coupled).displacement[:, :9],
        solve_frame(stiff).displacement,
        rtol=1e-4,
        atol=1e-7,
    )


def test_a_distributing_coupling_does_not_stiffen():
    """A pure force at the centre of equal nodes is shared equally, as if it acted on them."""
    frame = grid_frame()
    joints = frame.joints.copy()
    joints[8] = joints[RING].mean(axis=0)
    forces = np.zeros((1, 9, 6))
    forces[0, 8, :3] = [1.0, -2.0, 3.0]
    coupled = replace(frame, joints=joints, forces=forces, couplings=(Distributing(8, RING),))
    shared = np.zeros((1, 8, 6))
    shared[0, RING, :3] = np.array([1.0, -2.0, 3.0]) / 4
    alone = replace(
        frame, joints=joints[:8], forces=shared, fixed=frame.fixed[:8], value=frame.value[:8]
    )
    np.testing.assert_allclose(
        solve_frame(coupled).displacement[:, :8],
        solve_frame(alone).displacement,
        rtol=1e-9,
        atol=1e-12,
    )


def remainder_orders(value, slope, steps=(1e-2, 5e-3, 2.5e-3)) -> np.ndarray:
    rest = [abs(value(h) - value(0.0) - h * slope) for h in steps]
    return np.log2(np.array(rest[:-1]) / np.array(rest[1:]))


@pytest.mark.parametrize("frame", COUPLED, ids=NAMES)
def test_gradients_see_how_couplings_follow_the_joints(frame):
    """Of compliance and of a displacement, with a support that moves."""
    value = np.zeros_like(frame.value)
    value[0] = [1e-3, -2e-3, 1e-3, 1e-4, 2e-4, -1e-4]
    frame = replace(frame, value=value)
    v = np.random.default_rng(4).normal(size=frame.joints.shape) * 0.5
    w = jnp.asarray(np.random.default_rng(5).normal(size=frame.forces.shape))

    def compliance(h: float) -> float:
        return float(solve_frame(replace(frame, joints=frame.joints + h * v)).compliance.sum())

    slope = float(np.sum(compliance_gradient(solve_frame(frame))["joints"] * v))
    np.testing.assert_allclose(remainder_orders(compliance, slope), 2, atol=0.1)

    def shown(joints):
        return jnp.sum(w * displacement(frame, joints=joints))

    gradient = jax.grad(shown)(jnp.asarray(frame.joints))
    along = float(np.sum(np.asarray(gradient) * v))
    orders = remainder_orders(lambda h: float(shown(jnp.asarray(frame.joints + h * v))), along)
    np.testing.assert_allclose(orders, 2, atol=0.1)


def test_gradients_by_thickness_and_by_supports_of_a_tied_skin():
    frame = skinned()
    w = jnp.asarray(np.random.default_rng(5).normal(size=frame.forces.shape))
    rng = np.random.default_rng(6)
    for name, size in (("thickness", 0.2), ("radii", 0.1), ("value", 1.0), ("forces", 1.0)):
        at = jnp.asarray(
            frame.parameters[name] if name in frame.parameters else getattr(frame, name)
        )
        v = size * rng.normal(size=at.shape)

        def shown(x, name=name):
            return jnp.sum(w * displacement(frame, **{name: x}))

        slope = float(np.sum(np.asarray(jax.grad(shown)(at)) * v))
        if name in ("value", "forces"):  # linear
            change = float(shown(at + v) - shown(at))
            np.testing.assert_allclose(slope, change, rtol=1e-7)
        else:
            orders = remainder_orders(lambda h, at=at, v=v, s=shown: float(s(at + h * v)), slope)
            np.testing.assert_allclose(orders, 2, atol=0.1)


@pytest.mark.parametrize("solver", ["superlu", "pardiso", "amg"])
def test_every_assembled_solver_takes_couplings_and_later_positions(solver):
    frame = skinned()
    first = solve_frame(frame, solver=solver)
    moved = replace(frame, joints=frame.joints * 1.01)
    again = solve_frame(moved, previous=first)
    np.testing.assert_allclose(again.compliance, solve_frame(moved).compliance, rtol=1e-8)


def test_the_matrix_free_solver_says_that_it_takes_none():
    with pytest.raises(FeaError, match="takes no couplings"):
        solve_frame(skinned(), solver="jax-cg")


def held(frame: FrameProblem, joint: int) -> FrameProblem:
    fixed = frame.fixed.copy()
    fixed[joint, 0] = True
    return replace(frame, fixed=fixed)


LINE = replace(
    grid_frame(),
    joints=np.vstack([grid_frame().joints[:4], np.outer(np.arange(4), [1, 2, 3]), [[9, 9, 9]]]),
)


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (replace(grid_frame(), couplings=(Rigid(8, np.array([4, 99])),)), "nodes 0 to 8"),
        (replace(grid_frame(), couplings=(Rigid(8, np.array([], int)),)), "has no nodes"),
        (replace(grid_frame(), couplings=(Rigid(8, RING), Rigid(3, RING[:1]))), "follow once"),
        (
            replace(grid_frame(), couplings=(Rigid(8, RING), Rigid(4, np.array([8])))),
            "follows itself",
        ),
        (replace(grid_frame(), couplings=(Rigid(4, RING),)), "follows itself"),
        (held(COUPLED[1], 8), "is fixed, but it follows"),
        (replace(grid_frame(), couplings=(Distributing(8, RING, np.ones(3)),)), "one a node"),
        (replace(grid_frame(), couplings=(Distributing(8, RING, -np.ones(4)),)), "positive"),
        (replace(grid_frame(), couplings=(Distributing(8, RING, lever=-1.0),)), "lever"),
        (replace(grid_frame(), couplings=(Distributing(8, RING, lever=np.inf),)), "finite"),
        (replace(grid_frame(), couplings=(Distributing(8, RING[[0, 1, 2, 2]]),)), "more than once"),
        (replace(LINE, couplings=(Distributing(8, RING),)), "on one line"),
        (
            replace(
                grid_frame(),
                couplings=(Tie(np.array([8]), np.array([[4, 5, 6]]), np.array([[0.5, 0.5, 0.5]])),),
            ),
            "sum to 1.5",
        ),
    ],
)
def test_impossible_couplings_are_refused_by_name(frame, words):
    with pytest.raises(FeaError, match=words):
        solve_frame(frame)


def test_a_load_that_a_coupling_leads_into_supports_is_noticed():
    frame = replace(grid_frame(), couplings=(Rigid(0, np.array([8])),))
    with pytest.raises(FeaError, match="acts only where the structure is held"):
        solve_frame(frame)


def tied_to_three_bodies() -> FrameProblem:
    """A cantilever whose tip is tied to three struts that nothing else joins."""
    tip = [[10, 5, 0], [10, -5, 0], [10, 0, 5]]
    joints = np.array([[0, 0, 0], [10, 0, 0], *tip, [20, 5, 0], [20, -5, 0], [20, 0, 5.0]])
    fixed = np.zeros((8, 6), bool)
    fixed[0] = True
    forces = np.zeros((1, 8, 6))
    forces[0, 5, 1] = 1.0
    return FrameProblem(
        joints=joints,
        struts=np.array([[0, 1], [2, 5], [3, 6], [4, 7]]),
        radii=np.ones((4, 2)),
        E=E,
        nu=NU,
        section=Round(),
        fixed=fixed,
        value=np.zeros((8, 6)),
        forces=forces,
        couplings=(Tie(np.array([1]), np.array([[2, 3, 4]]), np.array([[0.4, 0.3, 0.3]])),),
    )


@pytest.mark.parametrize("solver", ["superlu", "amg"])
def test_a_tie_does_not_hold_three_bodies(solver):
    """It holds their mean motion only: solvers must look for what is free."""
    with pytest.raises(SingularStiffness):
        solve_frame(tied_to_three_bodies(), solver=solver)
    assert skinned().proves_definite


def test_a_free_frame_that_is_loose_in_itself_has_no_frequencies():
    frame = tied_to_three_bodies()
    with pytest.raises(FeaError, match="not as one rigid body"):
        vibration(replace(frame, fixed=np.zeros_like(frame.fixed)), Inertia(1e-9), modes=3)
