"""Natural frequencies: their derivatives, free structures, masses, and what is refused."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_frames import remainder_orders, space_frame

import fea.eigenpairs
from fea import FeaError
from fea.couplings import Distributing, Rigid
from fea.eigenpairs import EigenResult
from fea.frame import FrameProblem
from fea.frame_eigen import Inertia
from fea.free_vibration import frequency, vibration
from fea.sections import Round

SKINNED = Inertia(2e-9, 1e-9)
BARE = Inertia(2e-9)


def free(frame: FrameProblem) -> FrameProblem:
    return replace(frame, fixed=np.zeros_like(frame.fixed))


def beam(parts: int = 4) -> FrameProblem:
    """A cantilever along x, 10 mm long, radius 0.2 mm."""
    x = np.linspace(0.0, 10.0, parts + 1)
    fixed = np.zeros((parts + 1, 6), dtype=bool)
    fixed[0] = True
    return FrameProblem(
        joints=x[:, None] * [[1.0, 0, 0]],
        struts=np.stack([np.arange(parts), np.arange(1, parts + 1)], axis=1),
        radii=np.full((parts, 2), 0.2),
        E=1000.0,
        nu=0.3,
        section=Round(shear_factor=float("inf")),
        fixed=fixed,
        value=np.zeros(fixed.shape),
        forces=np.zeros((1, *fixed.shape)),
    )


@pytest.mark.parametrize("name", ["joints", "radii", "rigid_ends", "modulus", "thickness"])
def test_gradient_has_a_second_order_taylor_remainder(name):
    frame = space_frame(skin=True)
    orders = remainder_orders(
        lambda x: frequency(frame, SKINNED, mode=1, **{name: x}), frame.parameters[name]
    )
    np.testing.assert_allclose(orders, 2, atol=0.1)


@pytest.mark.parametrize("kind", [Rigid, Distributing])
def test_gradient_by_joints_sees_the_couplings(kind):
    frame = space_frame(coupling=kind)
    masses = np.zeros(len(frame.joints))
    masses[-1] = 1e-6  # at the reference
    inertia = Inertia(2e-9, masses=masses)
    orders = remainder_orders(lambda x: frequency(frame, inertia, joints=x), frame.joints)
    np.testing.assert_allclose(orders, 2, atol=0.1)


def test_frequency_of_a_free_frame_can_be_differentiated():
    frame = free(space_frame())
    orders = remainder_orders(lambda x: frequency(frame, BARE, radii=x), frame.radii)
    np.testing.assert_allclose(orders, 2, atol=0.1)


def test_a_gradient_without_the_mass_fails_the_taylor_test(monkeypatch):
    """Negative control."""
    frame, whole = space_frame(), Inertia.gradient

    def without(*given):
        by, u = whole(*given)
        return {name: 0 * value for name, value in by.items()}, u

    monkeypatch.setattr(Inertia, "gradient", without)
    orders = remainder_orders(lambda x: frequency(frame, BARE, radii=x), frame.radii)
    assert orders[-1] < 1.5


def test_scaling_laws():
    """Frequencies go with sqrt(E/rho)/size."""
    frame = space_frame()
    assert frame.rigid_ends is not None
    base = vibration(frame, BARE, modes=3).frequencies
    stiff = vibration(replace(frame, E=4 * frame.E), BARE, modes=3).frequencies
    heavy = vibration(frame, Inertia(4 * BARE.density), modes=3).frequencies
    large = replace(
        frame, joints=3 * frame.joints, radii=3 * frame.radii, rigid_ends=3 * frame.rigid_ends
    )
    np.testing.assert_allclose(stiff, 2 * base, rtol=1e-9)
    np.testing.assert_allclose(heavy, base / 2, rtol=1e-9)
    np.testing.assert_allclose(vibration(large, BARE, modes=3).frequencies, base / 3, rtol=1e-9)


def test_rigid_motions_of_a_free_frame_are_left_out(monkeypatch):
    """All of them, by the iterative way as by the dense one."""
    frame = free(space_frame(cells=3))
    found = vibration(frame, BARE, modes=3)
    assert found.residual < 1e-8
    # Elastic modes of a free body have no net momentum, so shaking does not move them.
    assert found.effective_mass.max() < 1e-12 * found.mass
    monkeypatch.setattr(fea.eigenpairs, "DENSE", 10_000)
    dense = vibration(frame, BARE, modes=3)
    np.testing.assert_allclose(found.frequencies, dense.frequencies, rtol=1e-9)
    # Not even the softest of them is a rigid motion with rounding.
    held = vibration(space_frame(cells=3), BARE).frequencies[0]
    assert held < found.frequencies[0] < 10 * held


def test_a_frame_that_may_only_slide_has_one_rigid_motion():
    """Extension of a bar free along its axis: n c/(2 L), n = 1, 2."""
    bar = beam(32)
    fixed = np.ones_like(bar.fixed)
    fixed[:, 0] = False
    found = vibration(replace(bar, fixed=fixed), BARE, modes=2).frequencies
    exact = np.sqrt(bar.E / BARE.density) / 20.0 * np.array([1.0, 2.0])
    # Consistent mass: (n pi/32)²/24 high.
    np.testing.assert_allclose(found, exact, rtol=2e-3)


def test_a_mass_on_a_light_cantilever():
    """sqrt(3 EI/(m L³))/(2 pi), and with the beam's own mass 33/140 of it (Rayleigh)."""
    frame = beam()
    masses = np.zeros(5)
    masses[-1] = 1e-6
    EI = frame.E * np.pi / 4 * 0.2**4
    own = 1e-10 * np.pi * 0.2**2 * 10
    found = vibration(frame, Inertia(1e-10, masses=masses), modes=2)
    expected = np.sqrt(3 * EI / ((1e-6 + 33 / 140 * own) * 1e3)) / (2 * np.pi)
    # The beam's mass is a thousandth of the other, and Rayleigh's share of it good to a per cent.
    np.testing.assert_allclose(found.frequencies, expected, rtol=1e-5)
    np.testing.assert_allclose(found.mass, 1e-6 + own, rtol=1e-12)


def test_effective_masses_sum_to_the_mass_off_the_supports():
    """Cantilever: 0.613 of the mass in the first bending mode (Irvine, Effective Modal Mass, 2015)."""
    frame = beam(12)
    found = vibration(frame, BARE, modes=72)
    np.testing.assert_allclose(
        found.effective_mass[:2].sum(axis=0)[1:], 0.613 * found.mass, rtol=2e-3
    )
    # What is left is the share of the clamped joint: half an element at most.
    share = found.effective_mass.sum(axis=0) / found.mass
    assert (share < 1).all()
    assert (share > 1 - 1 / 12).all()


def test_multigrid_finds_what_the_direct_solver_finds():
    frame = space_frame(cells=3)
    direct, rough = (
        vibration(frame, BARE, modes=3, solver=solver) for solver in ("superlu", "amg")
    )
    np.testing.assert_allclose(direct.frequencies, rough.frequencies, rtol=1e-9)


def test_repeated_frequencies_have_values_but_no_derivative():
    frame = beam()
    found = vibration(frame, BARE, modes=2).frequencies
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9)
    with pytest.raises(FeaError, match="are one within 1e-05: a repeated eigenvalue"):
        jax.grad(lambda r: frequency(frame, BARE, radii=r))(jnp.asarray(frame.radii))


@pytest.mark.parametrize(
    ("inertia", "message"),
    [
        (Inertia(-1.0), "density = -1 tonne/mm³: give zero or a positive number"),
        (Inertia(float("nan")), "density = nan"),
        (Inertia(0.0), "Nothing has mass"),
        (Inertia(1e-9, 1e-9), "has no skin, but skin_density is given"),
        (Inertia(1e-9, masses=np.zeros(3)), r"masses has shape \(3,\); give \(5,\)"),
        (Inertia(1e-9, masses=np.array([0, 0, -1.0, 0, 0])), "The mass at joint 2 is -1 tonne"),
    ],
)
def test_masses_that_are_none_are_refused(inertia, message):
    with pytest.raises(FeaError, match=message):
        vibration(beam(), inertia)


def test_a_skin_needs_a_density():
    with pytest.raises(FeaError, match="has a skin, but no skin_density is given"):
        vibration(space_frame(skin=True), BARE)


def test_malformed_frames_are_refused():
    frame = beam()
    loose = replace(frame, struts=np.array([[0, 1], [1, 2], [2, 3], [1, 3]]))
    with pytest.raises(FeaError, match="Joint 4"):
        vibration(loose, BARE)
    with pytest.raises(FeaError, match="Joint 4"):
        vibration(free(loose), BARE)
    torn = replace(frame, struts=np.array([[0, 1], [1, 2], [3, 4]]), radii=frame.radii[:3])
    for case in (torn, free(torn)):
        with pytest.raises(FeaError, match="pieces"):
            vibration(case, BARE)
    lost = replace(frame, joints=np.where(frame.joints > 9, np.nan, frame.joints))
    with pytest.raises(FeaError, match="not a number"):
        vibration(lost, BARE)
    with pytest.raises(FeaError, match='"jax-cg" has none'):
        vibration(frame, BARE, solver="jax-cg")
    with pytest.raises(FeaError, match=r'"forces" of shape .* is no parameter'):
        frequency(frame, BARE, forces=frame.forces)


def test_more_modes_than_there_are():
    found = vibration(beam(1), BARE, modes=8, throw=False)
    assert found.result is EigenResult.TOO_FEW
    assert np.isfinite(found.frequencies).sum() == 6
    assert not found.shapes[6:].any()
