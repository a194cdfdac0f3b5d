"""Sizing of walls, and grading of bars and walls by a rule."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import fea
from tests.texmap_opt.test_wall_frame import case, modelled, squares
from texmap_opt.box import Box
from texmap_opt.errors import SizingError
from texmap_opt.frame_model import FrameModel
from texmap_opt.sizing.graded import Graded
from texmap_opt.sizing.mma import MovingAsymptotes
from texmap_opt.sizing.no_sizing import NoSizing
from texmap_opt.sizing.optimality_criteria import OptimalityCriteria
from texmap_opt.sizing.problem import SizingProblem
from texmap_opt.sizing.sized import SizingLimits
from texmap_opt.sizing.strut_values import strut_values
from texmap_opt.structure.structure import Origin, Structure
from texmap_opt.structure.volume import lattice_volume
from texmap_opt.warp.grid import Grid

METHODS = [OptimalityCriteria(), MovingAsymptotes()]
FREE = SizingLimits(min_radius_mm=0.01, max_radius_mm=9.0)
# Pulls on three members [N], and the depths of the walls [mm].
PULL, DEPTH = np.array([300.0, 100.0, 50.0]), np.array([5.0, 3.0, 4.0])


@pytest.fixture(scope="module")
def cantilever() -> FrameModel:
    return modelled(case(), squares())[0]


def members(*, walls: bool) -> FrameModel:
    """Three long members from one wall, each pulled along its axis: statically determinate."""
    length, n = 50.0, len(PULL)
    joints = np.array([[x, 30.0 * k, 2.5] for k in range(n) for x in (0.0, length)])
    structure = Structure(
        joints,
        np.arange(2 * n).reshape(n, 2),
        np.ones((n, 2)),
        np.ones(2 * n, bool),
        np.ones(n),
    )
    fixed = np.repeat(joints[:, :1] == 0, 6, axis=1)
    if walls:
        structure = structure.extruded(np.array([0, 0, 1.0]), np.array([0.0, 5.0]))
        assert structure.extrusion is not None
        structure.extrusion.depth[:] = DEPTH
        fixed[:, 2:5] = True
    applied = np.zeros((1, 2 * n, 6))
    applied[0, 1::2, 0] = PULL
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
def test_walls_under_tension_become_fully_stressed(method):
    """Section proportional to force, C = (sum F L)²/(E V): Michell, Phil. Mag. 8 (1904) 589."""
    model = members(walls=True)
    sized = method.size(model, FREE)
    expected = (PULL.sum() * 50.0) ** 2 / (model.material.E * sized.volume)
    # The optimum is flat: thicknesses are less exact than compliance.
    np.testing.assert_allclose(sized.compliance_after, expected, rtol=1e-3)
    assert sized.utilisation is not None
    np.testing.assert_allclose(sized.utilisation / sized.utilisation.mean(), 1, atol=0.03)
    stress = PULL / (2 * sized.structure.radii[:, 0] * DEPTH)
    np.testing.assert_allclose(sized.utilisation, stress / model.material.yield_stress, rtol=1e-9)


def test_sizing_lowers_the_compliance_of_walls_and_keeps_volume_and_bounds(cantilever):
    """And two methods find one optimum: within half a percent, the shares at which they stop."""
    limits = SizingLimits(min_radius_mm=0.15, max_radius_mm=0.6)
    found = [method.size(cantilever, limits) for method in METHODS]
    for sized in found:
        assert sized.compliance_after < 0.8 * sized.compliance_before
        np.testing.assert_allclose(sized.volume, lattice_volume(cantilever.structure), rtol=2e-6)
        assert sized.min_radius >= 0.15 * (1 - 1e-9)
        assert sized.max_radius <= 0.6 * (1 + 1e-9)
        assert sized.structure.extrusion is cantilever.structure.extrusion
    np.testing.assert_allclose(*(sized.compliance_after for sized in found), rtol=5e-3)


def test_an_asked_volume_of_walls_is_met(cantilever):
    volume = 0.7 * lattice_volume(cantilever.structure)
    sized = OptimalityCriteria(iterations=3).size(cantilever, SizingLimits(volume=volume))
    np.testing.assert_allclose(sized.volume, volume, rtol=2e-6)


@pytest.mark.parametrize("walls", [False, True])
def test_grading_by_the_force_stresses_all_members_alike(walls):
    """The default exponents: sections follow f, here the force on a member over its depth."""
    model = members(walls=walls)
    force = PULL / DEPTH if walls else PULL
    sized = Graded(force).size(model, FREE)
    assert sized.utilisation is not None
    np.testing.assert_allclose(sized.utilisation / sized.utilisation.mean(), 1, atol=1e-9)
    np.testing.assert_allclose(sized.volume, lattice_volume(model.structure), rtol=2e-6)
    # The optimum of this determinate truss, hence better than equal radii.
    assert sized.compliance_after < 0.9 * sized.compliance_before
    assert sized.iterations == 1
    assert sized.message.startswith("Radii follow f^1; 0 %" if walls else "Radii follow f^0.5; 0 %")


@settings(max_examples=10, derandomize=True, deadline=None)
@given(st.floats(0.0, 3.0), st.integers(0, 1000), st.floats(0.5, 1.5))
def test_graded_radii_are_the_given_ones_times_a_power_of_f(exponent, seed, share):
    """Whatever f is relative to; the struts of a cell keep their own relative radius."""
    rng = np.random.default_rng(seed)
    model, f = members(walls=False), rng.uniform(0.5, 2.0, 3)
    given_radii = np.array([1.0, share, 1.0])
    model = model.with_structure(
        model.structure.with_radii(np.repeat(given_radii[:, None], 2, axis=1))
    )
    radius = Graded(7 * f, exponent).size(model, FREE).structure.radii[:, 0]
    np.testing.assert_allclose(radius / radius[0], given_radii * (f / f[0]) ** exponent, rtol=1e-9)


def test_an_even_f_leaves_equal_radii_and_the_bounds_are_kept(cantilever):
    struts = len(cantilever.structure.struts)
    even = Graded(np.ones(struts)).size(cantilever, SizingLimits())
    np.testing.assert_allclose(even.structure.radii, 0.3, rtol=1e-6)
    np.testing.assert_allclose(even.compliance_after, even.compliance_before, rtol=1e-6)
    f = np.exp(np.linspace(-5, 5, struts))
    f[0] = 0.0
    steep = Graded(f).size(cantilever, SizingLimits(min_radius_mm=0.2, max_radius_mm=0.5))
    np.testing.assert_allclose([steep.min_radius, steep.max_radius], [0.2, 0.5], rtol=1e-12)
    np.testing.assert_allclose(steep.volume, lattice_volume(cantilever.structure), rtol=2e-6)
    with pytest.raises(SizingError, match="out of reach"):
        Graded(f).size(cantilever, SizingLimits(min_radius_mm=0.4, max_radius_mm=0.5))


def test_no_sizing_reports_the_walls_as_they_are(cantilever):
    sized = NoSizing().size(cantilever, SizingLimits(volume=1.0))
    assert sized.structure is cantilever.structure
    problem = SizingProblem.of(cantilever, SizingLimits())
    np.testing.assert_allclose(sized.compliance_after, problem.before().compliance, rtol=1e-6)


@pytest.mark.parametrize("extrusion", [None, "z"])
def test_values_of_cells_at_struts_are_linear_between_their_middles(extrusion):
    """A linear field comes back inside, the mean of both cells in a face between two."""
    bounds = np.array([[0, 0, 0], [8.0, 6.0, 4.0]])
    box = Box.aligned(bounds, extrusion=extrusion)
    grid = Grid.uniform(box, (4, 3, 2)[: box.dimensions])
    step = np.array([2.0, 2.0, 2.0])
    centres = (np.indices(grid.cells).reshape(box.dimensions, -1).T + 0.5) * step[: box.dimensions]
    slope = np.array([0.3, -0.7, 0.5])[: box.dimensions]
    rng = np.random.default_rng(3)
    middle = rng.uniform(1, 3, (20, 3))
    middle[0] = [2.0, 3.0, 2.0]  # in the face between the first two cells
    arm = rng.uniform(-0.5, 0.5, middle.shape)
    joints = np.vstack([middle - arm, middle + arm])
    struts = np.column_stack([np.arange(20), np.arange(20, 40)])
    structure = Structure(joints, struts, np.ones((20, 2)), np.zeros(40, bool), np.ones(20))
    origin = Origin(np.zeros(20, int), np.zeros(20, int), ("cell",))
    got = strut_values(structure, origin, grid, centres @ slope)
    np.testing.assert_allclose(got, middle[:, : box.dimensions] @ slope, atol=1e-9)
