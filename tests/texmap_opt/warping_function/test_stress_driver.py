"""From stress at scattered points to a warping function."""

import numpy as np
import pytest

from fea.tet_mesh import TetMesh
from texmap_opt.errors import WarpError
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.normalised_convolution import deposit, normalised_convolution
from texmap_opt.warping_function.stress_driver import StressSamples, stress_driver
from texmap_opt.warping_function.warping_function import SizeLaw

BOX = np.array([[-1.0, -1.0, -1.0], [5.0, 3.0, 3.0]])
PART = np.array([[0.0, 0.0, 0.0], [4.0, 2.0, 2.0]])


def samples(stress_of, count=4000, cases=1):
    points = PART[0] + (PART[1] - PART[0]) * np.random.default_rng(0).random((count, 3))
    stress = np.stack([stress_of(points, case) for case in range(cases)])
    return StressSamples(points, np.full(count, 16 / count), stress)


def tension(points, case=0):
    """Uniaxial tension growing along x from 1 to e MPa."""
    stress = np.zeros((len(points), 6))
    stress[:, 0] = np.exp(points[:, 0] / 4)
    return stress


def driven(given, smoothing_mm=0.25, **law):
    return stress_driver(given, BOX, smoothing_mm=smoothing_mm, law=SizeLaw(**law))


def test_the_size_follows_the_von_mises_stress():
    f = driven(samples(tension), contrast=100.0)
    x = np.linspace(0.75, 3.25, 11)
    points = np.stack([x, np.ones(11), np.ones(11)], axis=1)
    slope = np.polyfit(x / 4, np.log(f.size(points)), 1)[0]
    # The random samples' mean within a Gaussian of 60 samples is off by a few hundredths of sigma.
    np.testing.assert_allclose(slope, -1, atol=0.05)


def test_the_worst_load_case_counts_at_each_point():
    def pulled(points, case):
        stress = np.zeros((len(points), 6))
        stress[:, case] = [3.0, 5.0][case] * (points[:, 0] > 2 if case else points[:, 0] <= 2)
        return stress

    given = samples(pulled, cases=2)
    np.testing.assert_allclose(given.von_mises, np.where(given.points[:, 0] > 2, 5, 3))


def test_outside_the_part_the_field_stays_within_the_range_inside():
    grid = BackgroundGrid.covering(np.array([[-20.0, -20, -20], [25, 25, 25]]), 1.0)
    given = samples(tension)
    field = normalised_convolution(
        grid, given.points, given.volumes, given.stress[0, :, :1], smoothing_mm=1.0
    )[..., 0]
    assert np.all(np.isfinite(field))
    assert field.min() >= 1 and field.max() <= np.e
    # ... and smooth: no step between nodes is larger than the steepest slope inside, e/4 per mm.
    assert max(np.abs(np.diff(field, axis=axis)).max() for axis in range(3)) < np.e / 4


def test_a_constant_is_reproduced_everywhere():
    grid = BackgroundGrid.covering(BOX, 0.5)
    given = samples(tension)
    ones = np.full((len(given.points), 1), 7.0)
    field = normalised_convolution(grid, given.points, given.volumes, ones, smoothing_mm=0.5)
    np.testing.assert_allclose(field, 7, rtol=1e-12)


def test_deposit_keeps_the_total_and_the_centre_of_gravity():
    """Trilinear weights reproduce linear functions."""
    grid = BackgroundGrid.covering(BOX, 0.5)
    given = samples(tension)
    amount = deposit(grid, given.points, given.volumes[:, None])[..., 0]
    np.testing.assert_allclose(amount.sum(), 16, rtol=1e-12)
    centre = np.einsum("xyz,xyzd->d", amount, grid.points) / 16
    np.testing.assert_allclose(centre, given.points.mean(axis=0), rtol=1e-12)


def test_the_deviator_of_pure_shear_has_norm_one_and_of_pressure_zero():
    def shear_or_pressure(points, case):
        return np.tile(
            [0, 0, 0, 0, 0, 2.0] if case == 0 else [5.0, 5, 5, 0, 0, 0], (len(points), 1)
        )

    S = np.asarray(driven(samples(shear_or_pressure, cases=2)).stress(np.array([[2.0, 1, 1]])))
    # The floor of a hundredth of the mean takes 5e-5 off the norm.
    expected = np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0]]) / np.sqrt(2)
    np.testing.assert_allclose(S[0, 0], expected, atol=1e-4)
    np.testing.assert_allclose(S[1, 0], 0, atol=1e-12)


def test_turning_part_and_stress_turns_the_deviator():
    """A quarter turn about z: x -> y, y -> -x."""
    R = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])

    def bent(points, case):
        x, y, z = points.T
        return np.stack([x, y - 1, 0 * x, 0.3 * z, 0.1 + 0 * x, z - 0.5 * x], axis=1)

    given = samples(bent)
    s = given.stress[0]
    tensor = s[:, [0, 5, 4, 5, 1, 3, 4, 3, 2]].reshape(-1, 3, 3)
    turned = np.einsum("ai,nij,bj->nab", R, tensor, R)[:, [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
    box = np.sort(BOX @ R.T, axis=0)
    f = driven(given, smoothing_mm=0.5)
    g = stress_driver(
        StressSamples(given.points @ R.T, given.volumes, turned[None]),
        box,
        smoothing_mm=0.5,
        law=SizeLaw(),
    )
    points = np.array([[1.0, 0.5, 1.5], [3.0, 1.5, 0.2]])
    expected = np.einsum("ai,nij,bj->nab", R, f.stress(points)[0], R)
    np.testing.assert_allclose(g.stress(points @ R.T)[0], expected, atol=1e-9)
    np.testing.assert_allclose(g.size(points @ R.T), f.size(points), rtol=1e-9)


def test_no_stress_anywhere_is_refused_with_a_remedy():
    with pytest.raises(WarpError, match="apply a load"):
        driven(samples(lambda points, case: np.zeros((len(points), 6))))


def test_a_stress_that_is_not_a_number_is_refused():
    with pytest.raises(WarpError, match="not a finite number at 4000 of 4000 points"):
        driven(samples(lambda points, case: np.full((len(points), 6), np.nan)))


def test_a_case_without_stress_beside_one_with_stress_is_fine():
    f = driven(samples(lambda points, case: case * tension(points), cases=2))
    S = np.asarray(f.stress(np.array([[2.0, 1, 1]])))
    assert np.all(S[0] == 0) and np.all(np.isfinite(S))


def test_nodes_of_a_tet_mesh_share_its_volume():
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    mesh = TetMesh(nodes, np.array([[0, 1, 2, 3]]))
    given = StressSamples.from_mesh(mesh, np.ones((1, 4, 6)))
    np.testing.assert_allclose(given.volumes, 1 / 24)
