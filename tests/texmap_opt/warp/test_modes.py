"""The variables of the least-squares warp: what the objective's Hessian is in them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from texmap_opt.box import Box
from texmap_opt.warp.alignment import Unaligned
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.least_squares_problem import LeastSquaresProblem
from texmap_opt.warp.modes import SlidingModes
from texmap_opt.warp.variables import Variables
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.warping_function import WarpingFunction

BOUNDS = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 2.5]])


def grid_of(d, fixed=None):
    """Cells of three different edges."""
    box = Box.aligned(BOUNDS, extrusion="z" if d == 2 else None)
    return Grid.uniform(box, (5, 3, 4)[:d], fixed=fixed)


def modes_of(grid, weight=10.0):
    return SlidingModes.of(grid, size_weight=weight, alignment_weight=0.0)


def moving(grid):
    """Which amplitudes move anything: a sine has no mode of the phase 0 or pi."""
    mode = np.indices([n + 1 for n in grid.cells])
    ends = np.array(grid.cells).reshape(-1, *[1] * grid.dimensions)
    return (mode > 0) & (mode < ends)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("weight", [1.0, 10.0])
def test_at_the_identity_the_hessian_is_the_identity(d, weight):
    """Exactly, cell by cell and point by point, but for the displacement's own weight of 1e-6."""
    grid = grid_of(d)
    f = WarpingFunction.from_formula(
        lambda p: np.ones(len(p)), grid.box, spacing_mm=0.5, law=SizeLaw()
    )
    problem = LeastSquaresProblem.of(grid, f, size_weight=weight, alignment=Unaligned())
    variables = Variables.about(problem.start, grid, modes_of(grid, weight))

    def objective(z):
        return problem.energies(variables.at(z)).total

    z = jnp.asarray(np.random.default_rng(0).standard_normal(problem.start.shape))
    _, product = jax.jvp(jax.grad(objective), (jnp.zeros_like(z),), (z,))
    np.testing.assert_allclose(product, np.where(moving(grid), z, 0.0), atol=2e-5)


def test_outer_nodes_slide_and_those_of_fixed_faces_rest():
    fixed = np.array([[True, False, False], [False, False, True]])
    grid = grid_of(3, fixed)
    z = jnp.asarray(np.random.default_rng(0).standard_normal((3, 6, 4, 5)))
    moved = np.asarray(modes_of(grid).displacement(z))
    assert not moved[:, 0].any()
    assert not moved[:, :, :, -1].any()
    assert not moved[0, -1].any()
    assert not moved[1, :, 0].any()
    assert np.abs(moved[1:, -1, 1:-1, 1:-1]).min() > 0
