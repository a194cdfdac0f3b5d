"""The least-squares warp with cells that follow the part's surface."""

from dataclasses import fields

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from tests.texmap_opt.warp.test_conforming import CUBE, SPHERE, cylinder
from texmap_opt.box import Box
from texmap_opt.warp.alignment import Unaligned
from texmap_opt.warp.certificate import grid_coefficients
from texmap_opt.warp.conforming import Conforming, ConformingResidual
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warp.least_squares_problem import LeastSquaresProblem
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.warping_function import WarpingFunction

MEASURES = {field.name for field in fields(ConformingResidual)}


def lopsided(box):
    """An f without symmetries."""
    return WarpingFunction.from_formula(
        lambda p: np.exp(0.1 * np.sin(p @ [0.1, 0.2, 0.05] + 0.5)),
        box,
        spacing_mm=4.0,
        law=SizeLaw(contrast=2.0),
    )


def test_nodes_next_to_a_sphere_move_onto_it():
    box = Box.aligned(CUBE)
    grid, f = Grid.uniform(box, (7, 7, 7)), lopsided(box)
    plain = LeastSquares().fit(grid, f)
    assert not MEASURES & set(plain.measures)
    before = Conforming.of(plain.grid, SPHERE, 1.0).measure(plain.grid, SPHERE)
    result = LeastSquares(surface=SPHERE, surface_weight=1000.0).fit(grid, f)
    assert result.converged
    assert grid_coefficients(result.grid).min() > 0
    assert set(result.measures) >= MEASURES
    assert result.measures["nodes"] == before.nodes
    assert result.measures["rms_relative"] < 0.3 * before.rms_relative
    assert result.measures["objective_surface"] > 0
    # The nodes that count lie on the sphere indeed.
    radius = np.linalg.norm(result.grid.positions, axis=-1)
    near = np.sort(np.abs(radius - 10).ravel())[: before.nodes]
    np.testing.assert_allclose(near.max(), result.measures["max_mm"], atol=0.01)


def test_the_derivative_by_the_weight_of_the_surface_keeps_the_gradient_zero():
    """Along x + h dx/dw the objective's gradient at w + h vanishes to second order in h."""
    box = Box.aligned(CUBE, extrusion="z")
    grid, f, part = Grid.uniform(box, (5, 6)), lopsided(box), cylinder(10, 14)

    def nodes(w):
        return LeastSquares(surface=part, surface_weight=w).nodes(grid, f)

    x, by_weight = jax.jvp(nodes, (10.0,), (1.0,))
    surface = Conforming.of(LeastSquares().fit(grid, f).grid, part, 1.0)

    @jax.jit
    @jax.grad
    def gradient(x, w):
        chosen = eqx.tree_at(lambda s: s.weight, surface, w)
        problem = LeastSquaresProblem.of(
            grid, f, size_weight=10.0, alignment=Unaligned(), surface=chosen
        )
        return problem.energies(jnp.moveaxis(x, -1, 0)).total

    def left(h, move):
        slope = np.moveaxis(np.asarray(gradient(x + h * move, jnp.asarray(10.0 + h))), -1, 0)
        return np.abs(slope[grid.free]).max()

    assert left(0.0, by_weight) < 1e-7
    steps = [0.05, 0.1, 0.2]
    remainder = np.array([left(h, by_weight) for h in steps])
    np.testing.assert_allclose(np.log2(remainder[1:] / remainder[:-1]), 2, atol=0.1)
    # Without the derivative it is of first order.
    still = np.array([left(h, 0 * by_weight) for h in steps])
    np.testing.assert_allclose(np.log2(still[1:] / still[:-1]), 1, atol=0.1)
