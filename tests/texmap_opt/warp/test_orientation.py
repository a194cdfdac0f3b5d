"""The strain energy of cells as they are turned, against the best and the worst way to turn them."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fea.effective_stiffness import EffectiveStiffness
from fea.materials import Orthotropic
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.homogenised import homogenised_cell
from texmap_opt.warp import orientation
from texmap_opt.warp.orientation import best_energy, energy_share, strain_energy, worst_energy


@cache
def stiffness(name: str) -> EffectiveStiffness:
    return homogenised_cell(unit_cell(name), radius=0.05).stiffness


def isotropic(E=2.0, nu=0.3) -> np.ndarray:
    compliance = np.zeros((6, 6))
    compliance[:3, :3] = -nu / E
    compliance[np.arange(3), np.arange(3)] = 1 / E
    compliance[np.arange(3, 6), np.arange(3, 6)] = 2 * (1 + nu) / E
    return compliance


def stresses(seed: int, cases: int, cells: int, d: int = 3) -> np.ndarray:
    raw = np.random.default_rng(seed).normal(size=(cases, cells, d, d))
    return raw + np.swapaxes(raw, -1, -2)


def compliance_of(seed: int, size: int = 6) -> np.ndarray:
    """Of no symmetry at all."""
    A = np.random.default_rng(seed).normal(size=(size, size))
    return A @ A.T + 0.1 * np.eye(size)


def rotations(seed: int, count: int) -> np.ndarray:
    return Rotation.random(count, random_state=seed).as_matrix()


def by_search(compliance, stress, samples=2000):
    """Least and largest energy over many rotations: never beyond the true ones."""
    one = np.stack(
        [
            strain_energy(compliance, stress, np.broadcast_to(R, (stress.shape[1], 3, 3)))
            for R in rotations(7, samples)
        ]
    )
    return one.min(axis=0), one.max(axis=0)


@pytest.mark.parametrize("name", ["cube", "octet", "vector"])
def test_tension_in_a_turned_lattice_stores_the_energy_of_youngs_modulus_that_way(name):
    """U = sigma^2 / (2 E(n)), n the pull in the cell's axes: Young's modulus by definition."""
    frames = rotations(3, 40)
    pull = np.array([0.0, 0.6, 0.8])
    stress = np.broadcast_to(5.0 * np.outer(pull, pull), (1, 40, 3, 3))
    cell = stiffness(name)
    expected = 25 / (2 * cell.youngs_modulus(frames @ pull))
    np.testing.assert_allclose(strain_energy(cell.compliance, stress, frames), expected, rtol=1e-10)


def test_a_cube_is_stiffest_along_its_struts_and_an_octet_softest():
    """Zener ratios 0.01 and 1.9: the principal axes are the best frame, and the worst."""
    stress = stresses(1, 1, 50)
    axes = np.swapaxes(np.linalg.eigh(stress[0])[1], -1, -2)
    cube, octet = stiffness("cube"), stiffness("octet")
    assert cube.zener_ratio < 1 < octet.zener_ratio
    for cell, extreme in ((cube, best_energy), (octet, worst_energy)):
        along = strain_energy(cell.compliance, stress, axes)
        np.testing.assert_allclose(along, extreme(cell.compliance, stress), rtol=1e-10)


def test_the_best_octet_has_no_diagonal_of_the_deviator_in_its_frame():
    """Shear in the plane xy has none in the box's own axes."""
    shear = np.zeros((1, 1, 3, 3))
    shear[0, 0, 0, 1] = shear[0, 0, 1, 0] = 1.0
    compliance = stiffness("octet").compliance
    box = strain_energy(compliance, shear, np.eye(3)[None])
    np.testing.assert_allclose(box, best_energy(compliance, shear), rtol=1e-12)


@pytest.mark.parametrize("name", ["cube", "octet", "bcc"])
def test_the_search_finds_what_the_closed_form_says(name):
    """The same stress twice, each over sqrt 2, is one load case to the energy, but two to the code."""
    compliance = stiffness(name).compliance
    stress = stresses(2, 1, 300)
    twice = np.concatenate([stress, stress]) / np.sqrt(2)
    for extreme in (best_energy, worst_energy):
        # Rounding of sums of squares; a missed valley is off by 1e-3 of the range.
        np.testing.assert_allclose(
            extreme(compliance, twice), extreme(compliance, stress), rtol=1e-9
        )


@pytest.mark.parametrize(("cases", "seed"), [(1, 5), (2, 6), (4, 7)])
def test_no_rotation_is_better_than_the_best_or_worse_than_the_worst(cases, seed):
    """2000 rotations come within 12 deg = 0.2 rad of the extreme: 4 x 0.2^2 = 16 % of the range."""
    for compliance in (compliance_of(seed), stiffness("octet").compliance):
        stress = stresses(seed, cases, 30)
        best, worst = best_energy(compliance, stress), worst_energy(compliance, stress)
        least, largest = by_search(compliance, stress)
        spread = worst - best
        assert np.all(best <= least + 1e-9 * spread)
        assert np.all(worst >= largest - 1e-9 * spread)
        assert np.all(least - best <= 0.16 * spread)
        assert np.all(worst - largest <= 0.16 * spread)


@pytest.mark.parametrize("cases", [1, 3])
def test_in_the_plane_the_best_of_all_angles_is_found(cases):
    compliance = compliance_of(4, size=3)
    stress = stresses(8, cases, 60, d=2)
    angle = np.linspace(0, np.pi, 1801)
    turns = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    energy = np.stack(
        [
            strain_energy(compliance, stress, np.broadcast_to(R, (60, 2, 2)))
            for R in np.moveaxis(turns, -1, 0)
        ]
    )
    best, worst = best_energy(compliance, stress), worst_energy(compliance, stress)
    # Half a step of 0.1 deg off the extreme: 4 (8.7e-4)^2 = 3e-6 of the range.
    assert np.all((energy.min(axis=0) - best) / (worst - best) < 3e-6)
    assert np.all((worst - energy.max(axis=0)) / (worst - best) < 3e-6)
    assert np.all(best <= energy.min(axis=0) * (1 + 1e-12))


@settings(max_examples=6, derandomize=True, deadline=None)
@given(st.integers(0, 1000), st.integers(1, 3))
def test_the_best_does_not_depend_on_how_the_stress_is_turned(seed, cases):
    compliance = compliance_of(9)
    stress = stresses(seed, cases, 4)
    R = rotations(seed, 1)[0]
    turned = R @ stress @ R.T
    np.testing.assert_allclose(
        best_energy(compliance, turned), best_energy(compliance, stress), rtol=1e-8
    )


def test_the_covering_leaves_out_what_symmetry_repeats():
    """A cube has all of the 24 rotations, an orthotropic solid four, a triclinic one the identity."""
    brick = Orthotropic((1.0, 2.0, 3.0), (0.2, 0.1, 0.3), (0.5, 0.6, 0.7), 1e-9)
    kinds = (stiffness("octet").compliance, np.linalg.inv(brick.stiffness), compliance_of(1))
    assert [len(orientation._cosets(kind)) for kind in kinds] == [1, 6, 24]


def test_every_rotation_is_near_one_of_the_covering():
    """10.3 deg, as `SAMPLES` promises."""
    covering = orientation._covering(compliance_of(1), 3).reshape(-1, 3, 3)
    np.testing.assert_allclose(
        covering @ np.swapaxes(covering, -1, -2),
        np.tile(np.eye(3), (len(covering), 1, 1)),
        atol=1e-14,
    )
    trace = rotations(11, 300).reshape(300, 9) @ covering.reshape(-1, 9).T
    angle = np.degrees(np.arccos(np.clip((trace.max(axis=1) - 1) / 2, -1, 1)))
    assert angle.max() < 10.3


def test_the_share_is_all_in_the_best_frames_and_nothing_in_the_box():
    stress = stresses(3, 1, 30)
    compliance = stiffness("cube").compliance
    axes = np.swapaxes(np.linalg.eigh(stress[0])[1], -1, -2)
    box = np.broadcast_to(np.eye(3), axes.shape)
    every = np.ones(30)
    np.testing.assert_allclose(energy_share(compliance, stress, axes, every).share, 1, rtol=1e-9)
    at_rest = energy_share(compliance, stress, box, every)
    np.testing.assert_allclose(at_rest.share, 0, atol=1e-12)
    assert at_rest.best < at_rest.uniform == at_rest.warped < at_rest.worst
    # Principal axes are the worst for an octet: the gain is negative.
    assert energy_share(stiffness("octet").compliance, stress, axes, every).share < 0


def test_cells_without_weight_do_not_count_and_others_by_their_weight():
    stress, frames = stresses(3, 2, 30), rotations(1, 30)
    frames[20:] = np.nan  # such as of cells inside out
    weights = np.where(np.arange(30) < 10, 2.0, 0.0)
    compliance = stiffness("octet").compliance
    some = energy_share(compliance, stress, frames, weights)
    first = energy_share(compliance, stress[:, :10], frames[:10], np.ones(10))
    np.testing.assert_allclose(
        [some.uniform, some.warped, some.best, some.worst],
        2 * np.array([first.uniform, first.warped, first.best, first.worst]),
        rtol=1e-12,
    )


def test_turning_an_isotropic_cell_gains_nothing():
    energy = energy_share(isotropic(), stresses(1, 2, 20), rotations(2, 20), np.ones(20))
    np.testing.assert_allclose([energy.warped, energy.best], energy.uniform, rtol=1e-12)
    assert energy.share is None


def test_no_stress_stores_nothing():
    none = np.zeros((2, 5, 3, 3))
    np.testing.assert_array_equal(best_energy(compliance_of(1), none), 0)
    energy = energy_share(compliance_of(1), none, rotations(2, 5), np.ones(5))
    assert energy.share is None
