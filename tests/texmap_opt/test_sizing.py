"""Sizing of strut radii: least compliance at a given volume."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import fea
from fea.frame_checks import free_frame_motion
from texmap_opt.errors import AnalysisError, SizingError
from texmap_opt.frame_model import FrameModel
from texmap_opt.sizing.mma import MovingAsymptotes
from texmap_opt.sizing.no_sizing import NoSizing
from texmap_opt.sizing.optimality_criteria import OptimalityCriteria
from texmap_opt.sizing.problem import SizingProblem
from texmap_opt.sizing.sized import SizingLimits
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.volume import lattice_volume

CELLS = (3, 2, 1)


def lattice(cells=CELLS, radius: float = 0.35, edge: float = 5.0) -> Structure:
    """Octet lattice."""
    points = [p for p in product(*(range(2 * n + 1) for n in cells)) if sum(p) % 2 == 0]
    number = {p: i for i, p in enumerate(points)}
    steps = [(1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1), (0, 1, 1), (0, 1, -1)]
    struts = np.array(
        [
            (number[p], number[q])
            for p in points
            for step in steps
            if (q := tuple(np.add(p, step).tolist())) in number
        ]
    )
    return Structure(
        joints=edge / 2 * np.array(points, float),
        struts=struts,
        radii=np.full((len(struts), 2), radius),
        cut=np.zeros(len(points), bool),
        cell_size=np.ones(len(struts)),
    )


def cantilever(
    structure: Structure | None = None, *, forces=((0.0, 0.0, -10.0),), gravity=(0.0, 0.0, 0.0)
) -> FrameModel:
    """Clamped at the lowest x, each case's force shared by the joints at the highest."""
    structure = lattice() if structure is None else structure
    x = structure.joints[:, 0]
    fixed = np.repeat((x == x.min())[:, None], 6, axis=1)
    end = np.flatnonzero(x == x.max())
    applied = np.zeros((len(forces), len(x), 6))
    for case, force in zip(applied, forces, strict=True):
        case[end, :3] = np.array(force) / len(end)
    return FrameModel(
        structure=structure,
        material=fea.material("AlSi10Mg"),
        case_names=tuple(str(k) for k in range(len(forces))),
        fixed=fixed,
        value=np.zeros((len(x), 6)),
        surface_forces=applied,
        acceleration=np.tile(np.array(gravity), (len(forces), 1)),
        weight_factor=0.9,
    )


METHODS = [OptimalityCriteria(), MovingAsymptotes()]


@pytest.mark.parametrize("method", METHODS)
def test_sizing_lowers_compliance_and_keeps_volume_and_bounds(method):
    model = cantilever()
    frame = model.problem()
    assert free_frame_motion(frame.joints, frame.fixed, frame.links) is None
    sized = method.size(model, SizingLimits())
    assert sized.compliance_after < 0.7 * sized.compliance_before
    np.testing.assert_allclose(sized.compliance_after, sized.solution.compliance.sum(), rtol=1e-12)
    np.testing.assert_allclose(sized.volume, lattice_volume(model.structure), rtol=2e-6)
    np.testing.assert_allclose(lattice_volume(sized.structure), sized.volume, rtol=1e-12)
    assert sized.min_radius >= 0.4 * 0.35 * (1 - 1e-6)
    assert sized.max_radius <= max(2.5 * 0.35, 0.2 * 5 / np.sqrt(2)) * (1 + 1e-6)
    # One radius a strut.
    np.testing.assert_array_equal(sized.structure.radii[:, 0], sized.structure.radii[:, 1])
    assert sized.utilisation is not None
    assert sized.max_utilisation == sized.utilisation.max() > 0
    assert len(sized.history) == sized.iterations


def test_optimality_criteria_and_moving_asymptotes_find_the_same_compliance():
    """Two methods, one optimum: within half a percent, the shares at which they stop."""
    model = cantilever(forces=((0.0, 0.0, -10.0), (0.0, 6.0, 0.0)))
    a, b = (
        method.size(model, SizingLimits())
        for method in (OptimalityCriteria(), MovingAsymptotes(iterations=120))
    )
    np.testing.assert_allclose(a.compliance_after, b.compliance_after, rtol=5e-3)


def test_a_symmetric_problem_has_a_symmetric_answer():
    """Mirror y -> width - y maps lattice, supports and load onto themselves."""
    model = cantilever()
    sized = OptimalityCriteria(iterations=15).size(model, SizingLimits())
    joints, struts = model.structure.joints, model.structure.struts
    mirrored = joints * [1, -1, 1] + [0, 5.0 * CELLS[1], 0]
    image = np.linalg.norm(joints[None] - mirrored[:, None], axis=2).argmin(axis=1)
    place = {frozenset(pair): i for i, pair in enumerate(struts.tolist())}
    twin = [place[frozenset(pair)] for pair in image[struts].tolist()]
    radius = sized.structure.radii[:, 0]
    # The quadrature of the volume has the symmetry too, so only rounding is left.
    np.testing.assert_allclose(radius[twin], radius, rtol=2e-6)


def truss(loads=(300.0, 100.0, 50.0)) -> FrameModel:
    """Three long bars from one wall, each pulled along its axis: statically determinate."""
    length, n = 50.0, len(loads)
    joints = np.array([[x, 30.0 * k, 0.0] for k in range(n) for x in (0.0, length)])
    struts = np.arange(2 * n).reshape(n, 2)
    structure = Structure(joints, struts, np.full((n, 2), 1.0), np.ones(2 * n, bool), np.ones(n))
    fixed = np.repeat(joints[:, :1] == 0, 6, axis=1)
    applied = np.zeros((1, 2 * n, 6))
    applied[0, 1::2, 0] = loads
    return FrameModel(
        structure=structure,
        material=fea.material("AlSi10Mg"),
        case_names=("pull",),
        fixed=fixed,
        value=np.zeros((2 * n, 6)),
        surface_forces=applied,
        acceleration=np.zeros((1, 3)),
        weight_factor=1.0,
    )


@pytest.mark.parametrize("method", METHODS)
def test_a_determinate_truss_becomes_fully_stressed(method):
    """Area proportional to force, C = (sum F L)²/(E V): Michell, Phil. Mag. 8 (1904) 589."""
    model = truss()
    sized = method.size(model, SizingLimits(min_radius_mm=0.05, max_radius_mm=5.0))
    force = model.surface_forces[0, 1::2, 0]
    expected = (force @ np.full(3, 50.0)) ** 2 / (model.material.E * sized.volume)
    # The optimum is flat: radii are less exact than compliance.
    np.testing.assert_allclose(sized.compliance_after, expected, rtol=1e-4)
    stress = force / (np.pi * sized.structure.radii[:, 0] ** 2)
    np.testing.assert_allclose(stress / stress.mean(), 1, atol=0.02)
    assert sized.converged


def test_struts_off_their_bounds_share_one_ratio_of_gain_to_cost():
    """Optimality: dC/dr over dV/dr is the same for all free struts."""
    model = cantilever()
    problem = SizingProblem.of(model, SizingLimits())
    sized = OptimalityCriteria(iterations=200, compliance_tolerance=1e-7).size(
        model, SizingLimits()
    )
    radius = sized.structure.radii[:, 0]
    ratio = -problem.solve(radius).gradient / problem.volume_gradient(radius)[1]
    free = (radius > 1.02 * problem.lower) & (radius < 0.98 * problem.upper)
    assert free.sum() > 10
    middle = np.median(ratio[free])
    assert np.abs(ratio[free] / middle - 1).mean() < 0.1
    assert (ratio[radius <= problem.lower * 1.0001] < 1.1 * middle).all()


@pytest.mark.parametrize("gravity", [(0.0, 0.0, 0.0), (0.0, 1e6, -3e6)])
def test_gradient_in_the_radii_has_a_second_order_taylor_remainder(gravity):
    """Weight that depends on the radii included."""
    problem = SizingProblem.of(cantilever(gravity=gravity), SizingLimits())
    rng = np.random.default_rng(0)
    radius = problem.uniform * rng.uniform(0.8, 1.3, len(problem.lower))
    v = rng.normal(size=len(radius)) * problem.uniform
    at = problem.solve(radius)

    def rest(h: float) -> float:
        return abs(problem.solve(radius + h * v).compliance - at.compliance - h * at.gradient @ v)

    np.testing.assert_allclose(np.log2(rest(4e-3) / rest(2e-3)), 2, atol=0.1)


def test_volume_can_be_chosen_and_equal_radii_of_it_are_the_yardstick():
    model = cantilever()
    volume = 0.6 * lattice_volume(model.structure)
    sized = OptimalityCriteria(iterations=5).size(model, SizingLimits(volume=volume))
    np.testing.assert_allclose(sized.volume, volume, rtol=2e-6)
    problem = SizingProblem.of(model, SizingLimits(volume=volume))
    np.testing.assert_allclose(sized.compliance_before, problem.before().compliance, rtol=1e-10)
    assert problem.uniform < 0.35


def test_no_sizing_leaves_the_radii_and_reports_them():
    model = cantilever()
    sized = NoSizing().size(model, SizingLimits(volume=1.0))
    assert sized.structure is model.structure
    assert sized.compliance_before == sized.compliance_after > 0
    np.testing.assert_allclose(sized.volume, lattice_volume(model.structure), rtol=1e-12)


def test_utilisation_is_none_without_a_yield_stress():
    from dataclasses import replace

    model = cantilever()
    model = replace(model, material=replace(model.material, yield_stress=None))
    sized = NoSizing().size(model, SizingLimits())
    assert sized.utilisation is None
    assert sized.max_utilisation is None


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (SizingLimits(min_radius_mm=0.5), r"out of reach: radii from 0\.5 .* mm³; change"),
        (SizingLimits(max_radius_mm=0.2), "out of reach"),
        (SizingLimits(volume=1e6), "volume_fraction: .* give 0 to"),
        (SizingLimits(min_radius_mm=0.4, max_radius_mm=0.3), "min_radius_mm = 0.4"),
    ],
)
def test_a_volume_out_of_reach_is_refused_with_the_range(method, limits, message):
    with pytest.raises(SizingError, match=message):
        method.size(cantilever(), limits)


@pytest.mark.parametrize("method", METHODS)
def test_loads_that_do_no_work_are_refused(method):
    """Supports that move and nothing else: compliance, the work of loads, is zero."""
    model = cantilever(forces=((0.0, 0.0, 0.0),))
    moved = replace(model, value=np.where(model.fixed, 0.1, 0.0))
    with pytest.raises(SizingError, match="no work"):
        method.size(moved, SizingLimits())
    with pytest.raises(AnalysisError, match=r"Load case 0 .* is zero"):
        method.size(model, SizingLimits())
