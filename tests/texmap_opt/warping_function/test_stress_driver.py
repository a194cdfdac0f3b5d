"""From stress at scattered points to a field that drives a warp."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fea.tet_mesh import TetMesh
from fea.voigt import turned_stress, von_mises
from texmap_opt.box import Box
from texmap_opt.errors import WarpError
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.stress_driver import (
    StressSamples,
    largest_principal,
    strain_energy_density,
    stress_driver,
)

BOX = Box.aligned(np.array([[-1.0, -1.0, -1.0], [5.0, 3.0, 3.0]]))
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


def bent(points, case=0):
    """A field without symmetry."""
    x, y, z = points.T
    return np.stack([x, y - 1, 0 * x, 0.3 * z, 0.1 + 0 * x, z - 0.5 * x], axis=1) * (1 + case)


def driven(given, *, box=BOX, smoothing_mm=0.4, law=None, **options):
    grid = BackgroundGrid.covering(box, smoothing_mm)
    field = stress_driver(given, grid, smoothing_mm=smoothing_mm, **options)
    return field.function(grid, law or SizeLaw())


def test_the_size_follows_the_von_mises_stress():
    f = driven(samples(tension), law=SizeLaw(contrast=100.0))
    x = np.linspace(0.75, 3.25, 11)
    points = np.stack([x, np.ones(11), np.ones(11)], axis=1)
    slope = np.polyfit(x / 4, np.log(f.size(points)), 1)[0]
    # The random samples' mean within a Gaussian of 250 samples is off by a few hundredths of sigma.
    np.testing.assert_allclose(slope, -1, atol=0.05)


def test_a_uniform_stress_gives_a_uniform_size_to_rounding():
    f = driven(samples(lambda points, case: np.tile([3.0, 1, 0, 0, 2, 0], (len(points), 1))))
    points = BOX.low + BOX.extent * np.random.default_rng(1).random((100, 3))
    np.testing.assert_allclose(f.size(points), 1, rtol=1e-12)


def halves(points, case):
    """Case 0 pulls the lower half along x with 3 MPa, case 1 the upper along y with 5 MPa."""
    stress = np.zeros((len(points), 6))
    stress[:, case] = [3.0, 5.0][case] * ((points[:, 0] > 2) == bool(case))
    return stress


def test_the_worst_load_case_counts_at_each_point():
    f = driven(samples(halves, cases=2), law=SizeLaw(contrast=100.0))
    sizes = f.size(np.array([[0.5, 1, 1], [3.5, 1, 1]]))
    # Nearly four smoothing lengths from the jump the slow tail of the kernel is left: below 1 %.
    np.testing.assert_allclose(sizes[0] / sizes[1], 5 / 3, rtol=0.01)


def test_case_weights_multiply_the_stress():
    given = samples(halves, cases=2)
    weighted = StressSamples(given.points, given.volumes, given.stress, np.array([5.0, 1.0]))
    sizes = driven(weighted, law=SizeLaw(contrast=100.0)).size(np.array([[0.5, 1, 1], [3.5, 1, 1]]))
    np.testing.assert_allclose(sizes[0] / sizes[1], 5 / 15, rtol=0.01)


def test_cases_may_be_added_instead():
    """Two equal cases: twice the measure, so the same field."""
    twice = samples(lambda points, case: tension(points), cases=2)
    points = np.array([[0.5, 1, 1], [3.5, 1, 1]])
    added, worst = (driven(twice, combine_cases=how).size(points) for how in ("sum", "worst"))
    np.testing.assert_allclose(added, worst, rtol=1e-12)
    mixed = samples(lambda points, case: bent(points) if case else tension(points), cases=2)
    added, worst = (driven(mixed, combine_cases=how).size(points) for how in ("sum", "worst"))
    assert np.abs(added - worst).max() > 0.01
    with pytest.raises(WarpError, match='combined by "some"'):
        driven(twice, combine_cases="some")


def test_measures_of_uniaxial_tension():
    """sigma, sigma and sigma² / 2E (Timoshenko, Goodier, section 84); pressure has no von Mises."""
    s = jnp.asarray([[[-6.0, 0, 0, 0, 0, 0], [2.0, 2, 2, 0, 0, 0]]])
    np.testing.assert_allclose(von_mises(s)[0], [6, 0], atol=1e-12)
    np.testing.assert_allclose(largest_principal(s)[0], [6, 2], rtol=1e-12)
    E, nu = 200.0, 0.3
    pressure = 3 * (1 - 2 * nu) * 2.0**2 / (2 * E)
    expected = [36 / (2 * E), pressure]
    np.testing.assert_allclose(strain_energy_density(E, nu)(s)[0], expected, rtol=1e-12)


def test_energy_of_one_direction_gives_twice_the_slope_of_stress():
    points = np.array([[0.75, 1, 1], [3.25, 1, 1]])
    law = SizeLaw(contrast=1000.0)
    by_stress = np.log(driven(samples(tension), law=law).size(points))
    measure = strain_energy_density(1000.0, 0.3)
    by_energy = np.log(driven(samples(tension), law=law, measure=measure).size(points))
    # The limit's window differs: 1 % at most at these contrasts.
    np.testing.assert_allclose(np.ptp(by_energy), 2 * np.ptp(by_stress), rtol=0.01)


def test_the_direction_of_pure_shear_has_norm_one_and_pressure_has_none():
    def shear_or_pressure(points, case):
        uniform = [0, 0, 0, 0, 0, 2.0] if case == 0 else [5.0, 5, 5, 0, 0, 0]
        return np.tile(uniform, (len(points), 1))

    for case in range(2):
        given = samples(lambda points, _, case=case: shear_or_pressure(points, case))
        f = driven(given, measure=largest_principal)
        at = np.array([[2.0, 1, 1]])
        # The fading outside the part takes 1e-4 off the norm here, a floor of a hundredth 5e-5.
        np.testing.assert_allclose(np.linalg.norm(f.stress(at)[0, 0]), 1, atol=1e-3)
        shear = np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0]]) / np.sqrt(2)
        np.testing.assert_allclose(f.direction(at)[0, 0], (1 - case) * shear, atol=1e-4)


def test_the_case_with_more_stress_has_more_say_in_the_directions():
    """One scale for all cases at a point: the squared norms of stresses without pressure add up to 1."""

    def sheared(points, case):
        return np.tile([0, 0, 0, 0, 0, 1.0 + case], (len(points), 1))

    S = np.asarray(driven(samples(sheared, cases=2)).direction(np.array([[2.0, 1, 1]])))
    np.testing.assert_allclose(S[1], 2 * S[0], rtol=1e-10)
    np.testing.assert_allclose((S**2).sum(), 1, atol=2e-4)


def test_places_that_carry_little_do_not_turn_those_that_carry_much():
    """The stress itself is averaged, so beside a strong tension a weak shear hardly shows."""

    def tension_above_shear(points, case):
        strong = np.array([10.0, 0, 0, 0, 0, 0])
        weak = np.array([0, 0, 0, 0, 0, 0.5])
        return np.where(points[:, 2:] > 1, strong, weak)

    f = driven(samples(tension_above_shear))
    S = np.asarray(f.direction(np.array([[2.0, 1, 1.2]])))[0, 0]
    assert abs(S[0, 1]) < 0.05 * S[0, 0]


def test_the_stress_fades_where_the_part_ends():
    """Cells in the margin carry nothing, so nothing turns them; smoothed over 0.4 mm."""
    f = driven(samples(lambda points, case: np.tile([1.0, 0, 0, 0, 0, 0], (len(points), 1))))
    z = np.array([1.0, 2.0, 3.0, 12.0])  # the middle of the part, its face, beyond, far beyond
    stress = f.stress(np.stack([np.full(4, 2.0), np.ones(4), z], axis=1))[0, :, 0, 0]
    np.testing.assert_allclose(stress[:2], 1, atol=0.02)
    assert np.all(np.abs(stress[2:]) < 0.25)


@pytest.mark.parametrize("dimensions", [3, 2])
def test_turning_part_stress_and_box_turns_nothing_in_the_box_s_own_axes(dimensions):
    R = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    R *= np.sign(np.linalg.det(R))
    given = samples(bent, cases=2)
    box = Box(np.eye(3), BOX.bounds, dimensions)
    turned = StressSamples(
        given.points @ R.T, given.volumes, turned_stress(given.stress, R[None, None])
    )
    f = driven(given, box=box)
    g = driven(turned, box=Box(R.T.copy(), BOX.bounds, dimensions))
    points = box.low + box.extent * np.random.default_rng(6).random((50, dimensions))
    np.testing.assert_allclose(g.size(points), f.size(points), rtol=1e-10)
    np.testing.assert_allclose(g.stress(points), f.stress(points), atol=1e-10)
    # Negative control: a stress left behind is another field.
    left = StressSamples(given.points @ R.T, given.volumes, given.stress)
    behind = driven(left, box=Box(R.T.copy(), BOX.bounds, dimensions))
    assert np.abs(behind.stress(points) - f.stress(points)).max() > 0.1


@pytest.mark.parametrize(
    ("measure", "dimensions"), [(von_mises, 3), (largest_principal, 2)], ids=["3-D", "2-D"]
)
def test_size_has_the_derivative_by_the_stress_that_differences_confirm(measure, dimensions):
    given = samples(bent, count=300, cases=2)
    box = Box(np.eye(3), BOX.bounds, dimensions)
    grid = BackgroundGrid.covering(box, 1.0)
    points = box.low + box.extent * np.random.default_rng(6).random((20, dimensions))
    weights, along = np.random.default_rng(7).normal(size=20), bent(given.points[:, ::-1])

    @jax.jit
    @jax.value_and_grad
    def total(t):
        # Along the same curve the weights of the cases, exponent and contrast change too.
        stress = jnp.asarray(given.stress) + t * along[None]
        moved = StressSamples(given.points, given.volumes, stress, jnp.stack([1.0 + t, 0.4 - t]))
        field = stress_driver(moved, grid, smoothing_mm=1.0, measure=measure)
        f = field.function(grid, SizeLaw(exponent=0.8 + t, contrast=2.0 - t))
        return jnp.sum(f.size(points) * weights) + jnp.sum(f.stress(points) ** 2)

    h = 1e-6
    difference = (total(h)[0] - total(-h)[0]) / (2 * h)
    # Kinks of the worst case and of the floor lie at few samples, none within 1e-6; rounding 1e-10.
    np.testing.assert_allclose(total(0.0)[1], difference, rtol=1e-6)


def test_the_derivative_is_finite_where_there_is_no_stress():
    """Von Mises stress has a tip at zero; a case may be zero, and points may be."""
    given = samples(lambda points, case: case * tension(points) * (points[:, :1] > 1), 300, cases=2)
    grid = BackgroundGrid.covering(BOX, 1.0)

    def total(stress):
        moved = StressSamples(given.points, given.volumes, stress)
        f = stress_driver(moved, grid, smoothing_mm=1.0).function(grid, SizeLaw())
        return jnp.sum(f.size(given.points[:10]))

    assert np.all(np.isfinite(jax.jit(jax.grad(total))(jnp.asarray(given.stress))))


def test_no_stress_anywhere_is_refused_with_a_remedy():
    with pytest.raises(WarpError, match=r"0 MPa at all 4000 points .* apply a load"):
        driven(samples(lambda points, case: np.zeros((len(points), 6))))


def test_pure_pressure_has_nothing_to_drive_by_von_mises():
    third = 0.1 * np.array([1.0, 1, 1, 0, 0, 0])  # 0.1 is not a binary number: rounding is left
    given = samples(lambda points, case: (1 + points[:, :1]) * third)
    with pytest.raises(WarpError, match=r"has a measure of zero .* largest principal"):
        driven(given)
    driven(given, measure=largest_principal)


def test_a_stress_that_is_not_a_number_is_refused_with_the_count():
    def broken(points, case):
        stress = tension(points)
        stress[:3] = np.nan
        stress[3, 0] = np.inf
        return stress

    with pytest.raises(WarpError, match="not a finite number at 4 of 4000 points"):
        driven(samples(broken))


def test_a_case_without_stress_beside_one_with_stress_is_fine():
    f = driven(samples(lambda points, case: case * tension(points), cases=2))
    S = np.asarray(f.stress(np.array([[2.0, 1, 1]])))
    assert np.all(S[0] == 0) and np.all(np.isfinite(S))


def test_nodes_of_a_tet_mesh_share_its_volume():
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    mesh = TetMesh(nodes, np.array([[0, 1, 2, 3]]))
    given = StressSamples.from_mesh(mesh, np.ones((1, 4, 6)))
    np.testing.assert_allclose(given.volumes, 1 / 24)
