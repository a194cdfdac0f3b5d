"""Buckling factors: their derivatives, what they do not depend on, and what is refused."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import root_scalar
from small_frames import remainder_orders, space_frame

from fea import FeaError, Round, Sequence, solve_frame
from fea.couplings import Distributing, Rigid, Tie
from fea.eigenpairs import EigenResult
from fea.frame_eigen import Prestress
from fea.stability import buckling, buckling_factor

NAMES = ("joints", "radii", "rigid_ends", "modulus", "thickness", "strut_loads", "forces")


@pytest.mark.parametrize("name", NAMES)
def test_gradient_has_a_second_order_taylor_remainder(name):
    frame = space_frame(skin=True)
    known = {**frame.parameters, "forces": frame.forces}
    orders = remainder_orders(lambda x: buckling_factor(frame, case=1, **{name: x}), known[name])
    np.testing.assert_allclose(orders, 2, atol=0.1)


@pytest.mark.parametrize("kind", [Rigid, Distributing])
def test_gradient_by_joints_sees_the_couplings(kind):
    frame = space_frame(coupling=kind)
    orders = remainder_orders(lambda x: buckling_factor(frame, joints=x), frame.joints)
    np.testing.assert_allclose(orders, 2, atol=0.1)


CHAIN = (Distributing(27, np.array([8, 17, 20, 26])), Rigid(8, np.array([17])))
TIE = (Tie(np.array([27]), np.array([[8, 17, 26]]), np.array([[0.2, 0.3, 0.5]])),)


@pytest.mark.parametrize("couplings", [CHAIN, TIE], ids=["chain", "tie"])
@pytest.mark.parametrize("name", ["joints", "radii", "forces", "strut_loads"])
def test_gradient_sees_what_the_arms_of_couplings_carry(couplings, name):
    frame = replace(space_frame(coupling=Rigid), couplings=couplings)
    known = {**frame.parameters, "forces": frame.forces}
    orders = remainder_orders(lambda x: buckling_factor(frame, case=1, **{name: x}), known[name])
    np.testing.assert_allclose(orders, 2, atol=0.1)


def test_a_gradient_without_the_change_of_forces_fails_the_taylor_test(monkeypatch):
    """Negative control: derivatives of Kg by the displacements left out."""
    frame, whole = space_frame(), Prestress.gradient
    monkeypatch.setattr(
        Prestress, "gradient", lambda *given: (whole(*given)[0], 0 * whole(*given)[1])
    )
    orders = remainder_orders(lambda x: buckling_factor(frame, radii=x), frame.radii)
    assert orders[-1] < 1.5


def test_a_higher_factor_can_be_differentiated_too():
    frame = space_frame()
    factors = buckling(solve_frame(frame), modes=3).factors
    steps = Sequence()
    orders = remainder_orders(
        lambda x: buckling_factor(frame, mode=2, sequence=steps, radii=x), frame.radii
    )
    np.testing.assert_allclose(orders, 2, atol=0.1)
    np.testing.assert_allclose(buckling_factor(frame, mode=2), factors[2], rtol=1e-10)


def test_factor_times_load_is_one_number():
    """Twice the load, half the factor; and each case has its own."""
    frame = space_frame()
    assert frame.strut_loads is not None
    twice = replace(frame, forces=2 * frame.forces, strut_loads=2 * frame.strut_loads)
    one, two = solve_frame(frame), solve_frame(twice)
    for case in (0, 1):
        found = [buckling(solution, case=case, modes=2).factors for solution in (one, two)]
        np.testing.assert_allclose(found[0], 2 * found[1], rtol=1e-9)


def test_modes_make_the_stiffness_singular():
    """(K + factor Kg) x = 0 on the free dofs, from matrices without supports."""
    frame = space_frame(skin=True)
    solution = solve_frame(frame)
    found = buckling(solution, modes=3)
    pattern = solution.system.form.pattern
    B = Prestress(solution, 0).matrix(frame, pattern)
    for factor, shape in zip(found.factors, found.shapes, strict=True):
        inner = solution.system.K @ shape.ravel()
        rest = np.where(frame.fixed.ravel(), 0.0, inner - factor * (B @ shape.ravel()))
        free = np.where(frame.fixed.ravel(), 0.0, inner)
        assert np.linalg.norm(rest) < 1e-8 * np.linalg.norm(free)
        assert np.linalg.norm(shape[:, :3], axis=1).max() == pytest.approx(1.0)
    assert found.residual < 1e-8


def test_multigrid_finds_what_the_direct_solver_finds():
    frame = space_frame(cells=3)
    direct, rough = (
        buckling(solve_frame(frame, solver=solver), modes=3) for solver in ("superlu", "amg")
    )
    np.testing.assert_allclose(direct.factors, rough.factors, rtol=1e-9)


def test_prescribed_displacements_buckle_too():
    """A foot pushed up by delta: the factor is of the displacement."""
    frame = replace(space_frame(), strut_loads=None)
    value = np.where(frame.fixed & (np.arange(6) == 2), 0.01, 0.0)
    pushed = replace(frame, value=value, forces=np.zeros((1, *frame.fixed.shape)))
    head = frame.joints[:, 2] > frame.joints[:, 2].max() - 3
    fixed = frame.fixed | head[:, None]
    pushed = replace(pushed, fixed=fixed)
    one = buckling(solve_frame(pushed)).factors
    two = buckling(solve_frame(replace(pushed, value=2 * value))).factors
    np.testing.assert_allclose(one, 2 * two, rtol=1e-9)


def column(sign: float):
    """Two struts in a line, loaded along it."""
    frame = space_frame()
    fixed = np.zeros((3, 6), dtype=bool)
    fixed[0] = True
    forces = np.zeros((1, 3, 6))
    forces[0, 2, 2] = sign
    return replace(
        frame,
        joints=np.array([[0.0, 0, 0], [0, 0, 5], [0, 0, 10]]),
        struts=np.array([[0, 1], [1, 2]]),
        radii=np.full((2, 2), 0.2),
        rigid_ends=None,
        modulus=None,
        strut_loads=None,
        fixed=fixed,
        value=np.zeros((3, 6)),
        forces=forces,
    )


@pytest.mark.parametrize(
    "coupling",
    [
        Rigid(8, np.array([9])),
        Distributing(9, np.array([8]), lever=1.0),
        Tie(np.array([9]), np.array([[8, 7, 6]]), np.array([[1.0, 0.0, 0.0]])),
    ],
    ids=["rigid", "distributing", "tie"],
)
@pytest.mark.parametrize("up", [1.0, -1.0])
def test_a_load_on_a_rigid_arm_above_a_column_buckles_it_earlier(coupling, up):
    """The exact factor: a k tan k L = 1 with the arm a and k² = P/(E I).

    It solves v'' + k² v = k² (v(L) + a v'(L)) with v(0) = v'(0) = 0. An arm that hangs down takes the
    load to where the column stiffens it: a < 0. Eight elements are off by less than 1e-4.
    """
    L, a, n = 100.0, 30.0 * up, 8
    z = np.append(np.linspace(0, L, n + 1), L + a)
    fixed = np.zeros((n + 2, 6), dtype=bool)
    fixed[0] = True
    forces = np.zeros((1, n + 2, 6))
    forces[0, n + 1, 2] = -1.0
    mast = replace(
        column(-1.0),
        joints=np.stack([0 * z, 0 * z, z], axis=1),
        struts=np.stack([np.arange(n), np.arange(n) + 1], axis=1),
        radii=np.ones((n, 2)),
        section=Round(shear_factor=np.inf),
        fixed=fixed,
        value=np.zeros((n + 2, 6)),
        forces=forces,
        couplings=(coupling,),
    )
    low, high = (1e-6, np.pi / 2 - 1e-9) if up > 0 else (np.pi / 2 + 1e-9, np.pi - 1e-9)
    k = root_scalar(lambda k: a / L * k * np.tan(k) - 1, bracket=(low, high)).root / L
    factor = buckling(solve_frame(mast)).factors[0]
    np.testing.assert_allclose(factor, k**2 * mast.E * np.pi / 4, rtol=1e-4)


def test_a_load_that_only_pulls_is_refused_with_the_remedy():
    pulled = solve_frame(column(1.0))
    with pytest.raises(FeaError, match=r"nothing is in compression.*Reverse the load"):
        buckling(pulled)
    assert buckling(pulled, throw=False).result is EigenResult.NONE_POSITIVE
    with pytest.raises(FeaError, match="nothing is in compression"):
        buckling_factor(column(1.0), radii=np.full((2, 2), 0.2))
    with pytest.raises(FeaError, match="nothing is in compression"):
        jax.grad(lambda r: buckling_factor(column(1.0), radii=r))(jnp.full((2, 2), 0.2))


def test_a_load_across_a_strut_does_not_compress_it():
    """Rounding of the axial force is not taken for a load."""
    frame = column(1.0)
    forces = np.zeros((1, 3, 6))
    forces[0, 2, 0] = 1.0
    turned = np.array([[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]])
    forces[..., :3] = forces[..., :3] @ turned.T
    frame = replace(frame, joints=frame.joints @ turned.T, forces=forces)
    with pytest.raises(FeaError, match="nothing is in compression"):
        buckling(solve_frame(frame))


def test_a_repeated_factor_has_a_value_but_no_derivative():
    """A round column buckles alike in all directions."""
    frame = column(-1.0)
    factors = buckling(solve_frame(frame), modes=2).factors
    np.testing.assert_allclose(factors[0], factors[1], rtol=1e-9)
    np.testing.assert_allclose(buckling_factor(frame, radii=frame.radii), factors[0], rtol=1e-12)
    with pytest.raises(FeaError, match=r"Buckling factor 0 = .* and 1 = .* are one within 1e-05"):
        jax.grad(lambda r: buckling_factor(frame, radii=r))(jnp.asarray(frame.radii))


def test_bad_loads_are_named():
    frame = column(-1.0)
    with pytest.raises(FeaError, match="is zero, so there is nothing to solve"):
        buckling_factor(frame, forces=np.zeros((1, 3, 6)))
    with pytest.raises(FeaError, match="force that is not a number"):
        buckling_factor(frame, forces=np.full((1, 3, 6), np.nan))
    with pytest.raises(FeaError, match="Load case 3 does not exist; the frame has cases 0 to 0"):
        buckling(solve_frame(frame), case=3)


def test_a_stiffness_that_was_never_assembled_is_refused():
    with pytest.raises(FeaError, match=r'another solver than "jax-cg"'):
        buckling(solve_frame(column(-1.0), solver="jax-cg"))


def test_a_spent_solution_is_refused():
    first = solve_frame(column(-1.0))
    second = solve_frame(column(-2.0), previous=first)
    with pytest.raises(FeaError, match="factor cannot be used again"):
        buckling(first)
    assert buckling(second).result is EigenResult.CONVERGED


def test_more_modes_than_there_are():
    """One strut: two planes, two dofs each."""
    found = buckling(solve_frame(column(-1.0)), modes=20, throw=False)
    assert found.result is EigenResult.TOO_FEW
    assert np.isfinite(found.factors).sum() == 8
    assert not found.shapes[8:].any()
