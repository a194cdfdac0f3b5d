"""The derivative of the least-squares warp's minimiser: that of the implicit function."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fea.effective_stiffness import EffectiveStiffness
from tests.texmap_opt.warp.test_least_squares_stress import SMALL, driven, stressed_points
from texmap_opt.box import Box
from texmap_opt.errors import WarpError
from texmap_opt.warp import least_squares
from texmap_opt.warp.alignment import LeastEnergy, NoShear, alignment_for
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warping_function.size_law import SizeLaw

# By the stress along one direction, exponent, contrast, weight of the alignment and of the size.
AT = np.array([0.0, 1.0, 2.0, 5.0, 10.0])

# Softer along its axes, so that cells turn away from the principal stresses.
SOFT_ALONG = EffectiveStiffness(np.diag([2.0, 2, 2, 2, 2, 2]))


def square_energy(weight):
    alignment = alignment_for("energy", SOFT_ALONG, weight, dimensions=2)
    assert isinstance(alignment, LeastEnergy)
    return alignment


def weighted_nodes(dimensions, alignment):
    """A number that depends on all nodes of a small grid, as a function of the parameters."""
    box = Box.aligned(SMALL.bounds, extrusion="z" if dimensions == 2 else None)
    grid = Grid.uniform(box, (4, 3, 3)[:dimensions])
    points, stress = stressed_points()
    rng = np.random.default_rng(1)
    towards, weights = rng.standard_normal(stress.shape), rng.standard_normal(grid.nodes.shape)

    def moved(parameters):
        by, exponent, contrast, weight, size = parameters
        there = jnp.asarray(stress)[None] + by * jnp.asarray(towards)[None]
        f = driven(points, there, box, SizeLaw(exponent=exponent, contrast=contrast))
        warp = LeastSquares(size_weight=size, alignment=alignment(weight))
        return jnp.sum(jnp.asarray(weights) * warp.nodes(grid, f))

    return moved


def steps():
    """Each parameter by itself, and all of them together."""
    rng = np.random.default_rng(2)
    scale = 1e-4 * np.maximum(1, AT)
    return [*np.diag(scale), scale * rng.standard_normal(5)]


@pytest.mark.parametrize(("dimensions", "alignment"), [(2, square_energy), (3, NoShear)])
def test_implicit_derivative_agrees_with_central_differences(dimensions, alignment):
    # Values come with their derivative, although only that of the middle is used: without, a second
    # program would be compiled, and compiling is all the time that this takes.
    both = jax.value_and_grad(weighted_nodes(dimensions, alignment))
    gradient = np.asarray(both(jnp.asarray(AT))[1])
    for step in steps():
        aside = [both(jnp.asarray(AT + sign * step))[0] for sign in (1, -1)]
        # Both minima are exact to 1e-10, so the difference is to 1e-6; its own error is step².
        np.testing.assert_allclose(float(aside[0] - aside[1]) / 2, gradient @ step, rtol=1e-4)


def test_numbers_and_arrays_share_what_is_compiled():
    """Compiling takes a thousand times as long as one small fit."""
    box = Box.aligned(SMALL.bounds, extrusion="z")
    points, stress = stressed_points()
    sizes = []
    for number in (float, jnp.asarray, lambda value: jnp.asarray(value, dtype=jnp.float64)):
        f = driven(points, stress[None], box, SizeLaw(number(1.0), number(2.0)))
        warp = LeastSquares(
            size_weight=number(10.0), alignment=alignment_for("axes", None, number(5.0))
        )
        warp.fit(Grid.uniform(box, (4, 3)), f)
        compiled = least_squares._descended._cached  # pyright: ignore[reportFunctionMemberAccess]
        sizes.append(compiled._cache_size())
    assert sizes[0] == sizes[-1]


def test_the_derivative_is_refused_under_jit():
    box = Box.aligned(SMALL.bounds, extrusion="z")
    points, stress = stressed_points()
    f = driven(points, stress[None], box, SizeLaw())
    with pytest.raises(WarpError, match=r"jax\.jit"):
        jax.jit(lambda w: LeastSquares(size_weight=w).nodes(Grid.uniform(box, (3, 3)), f))(10.0)
