"""Conforming cells: nodes next to the part's surface are drawn onto it."""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from texmap_opt.errors import WarpError
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.part_distance import PartDistance
from texmap_opt.warp.surface_layer import surface_layer
from texmap_opt.warping_function.background_grid import MAX_NODES, PADDING, BackgroundGrid
from texmap_opt.warping_function.concrete import is_concrete
from texmap_opt.warping_function.cubic_spline import CubicSpline
from texmap_opt.warping_function.size_law import limited

# Distance at which the pull of the surface ends, in longest edges of a uniform cell. Nodes are
# chosen within half a warped edge, which is seldom longer than two uniform ones.
REACH = 2.0

# Spacing of the distance field over the shortest edge of a uniform cell, and the factor by which it
# grows until the field fits what a background grid may hold (coarser only beyond 60^3 cells).
SPACING, COARSER = 0.5, 1.05

# Beyond this many limits the limited distance is constant to half a percent, and an estimate does.
FAR = 1.5

# The distance is taken at every fourth node first; it has slope one, so most are seen to be far.
STRIDE = 4

# Points per evaluation of the spline and its gradient: 64 coefficients each.
CHUNK = 50_000


@dataclass(frozen=True, kw_only=True)
class ConformingResidual:
    """How far the nodes that are to lie on the surface are off it, by the true distance.

    Attributes:
        nodes: their number.
        max_mm: largest distance [mm].
        rms_mm: root mean square of the distances [mm].
        max_relative: largest distance over the mean edge of a uniform cell.
        rms_relative: root mean square likewise.
    """

    nodes: int
    max_mm: float
    rms_mm: float
    max_relative: float
    rms_relative: float


class Conforming(eqx.Module):
    """What draws some nodes onto the part's surface: the energy 1/2 w sum (phi(x_i) / h)².

    phi is the signed distance, limited to `REACH` edges, as a C2 spline: within the spacing of
    its nodes, half an edge, sharp edges of the part are rounded. The nodes do not change while a
    grid is solved for; they slide along the surface, and nothing but the part's sharp edges holds
    them there.

    Attributes:
        weight: w.
        chosen: flat numbers of the nodes, see `surface_layer`.
        field: spline of phi [mm] in coordinates of the grid's box.
        edge: h, mean edge of a uniform cell [mm].
    """

    weight: Float[Array, ""]
    chosen: Int[Array, " samples"]
    field: CubicSpline
    edge: Float[Array, ""]

    @classmethod
    def of(cls, grid: Grid, surface: TriMesh, weight: float | Float[Array, ""]) -> "Conforming":
        """Choose the nodes, where they lie now, that are to lie on the surface.

        Args:
            grid: free of folds.
            surface: of the part, closed [mm].
            weight: w; 1 weighs a node one edge off like a shape residual of 1 in one cell.

        Raises:
            WarpError: for a weight that is not positive, or if there is no such node.
        """
        if is_concrete(weight) and not 0 < float(weight) < np.inf:
            raise WarpError(
                f"The weight of the surface is {float(weight):g}, but must be a positive number: "
                "give one such as 10, or switch conforming cells off."
            )
        distance = PartDistance(surface, grid.box)
        limit = REACH * float(grid.uniform_edge.max())
        field = _limited_distance(distance, grid, limit)
        nodes = grid.nodes.reshape(-1, grid.dimensions)
        phi, slope = _at_nodes(field, distance, nodes, limit)
        chosen = surface_layer(grid, phi, slope)
        if not len(chosen):
            raise WarpError(
                "The grid has no node next to the part's surface that may move onto it: give the "
                "grid a margin of at least one cell, take smaller cells, or switch conforming "
                "cells off."
            )
        return cls(
            jnp.asarray(weight, dtype=jnp.float64),
            jnp.asarray(chosen),
            field,
            jnp.asarray(grid.uniform_edge.mean()),
        )

    def energy(self, nodes: Float[Array, " d *nodes"]) -> Float[Array, ""]:
        """Half the weighted sum of squares for nodes given component first [mm]."""
        points = nodes.reshape(len(nodes), -1)[:, self.chosen].T
        return 0.5 * self.weight * jnp.sum((self.field(points)[:, 0] / self.edge) ** 2)

    def measure(self, grid: Grid, surface: TriMesh) -> ConformingResidual:
        """The residual of a grid with as many nodes in the same box, by the surface itself."""
        nodes = grid.nodes.reshape(-1, grid.dimensions)[np.asarray(self.chosen)]
        off, edge = np.abs(PartDistance(surface, grid.box)(nodes)), float(self.edge)
        largest, rms = float(off.max()), float(np.sqrt(np.mean(off**2)))
        return ConformingResidual(
            nodes=len(off),
            max_mm=largest,
            rms_mm=rms,
            max_relative=largest / edge,
            rms_relative=rms / edge,
        )


def _limited_distance(distance: PartDistance, grid: Grid, limit: float) -> CubicSpline:
    """Spline of the distance, limited to `limit` [mm], over the box of a grid."""
    spacing = SPACING * float(grid.uniform_edge.min())
    while np.prod(np.ceil(grid.box.extent / spacing) + 1 + 2 * PADDING) > MAX_NODES:
        spacing *= COARSER
    background = BackgroundGrid.covering(grid.box, spacing)
    phi = _distance_within(distance, background, FAR * limit)
    return CubicSpline.through(limited(jnp.asarray(phi), jnp.asarray(limit))[..., None], background)


def _distance_within(
    distance: PartDistance, background: BackgroundGrid, reach: float
) -> Float[np.ndarray, "*controls"]:
    """Signed distance at the nodes of a background grid [mm]; beyond `reach` only the right side.

    There it is the distance of a node `STRIDE` / 2 nodes away at most along each axis.
    """
    points = background.points
    blocks = [np.arange(n) // STRIDE for n in background.shape]
    middles = [
        np.minimum(np.arange(block[-1] + 1) * STRIDE + STRIDE // 2, n - 1)
        for block, n in zip(blocks, background.shape, strict=True)
    ]
    coarse = points[np.ix_(*middles)]
    estimate = distance(coarse.reshape(-1, coarse.shape[-1])).reshape(coarse.shape[:-1])
    phi = estimate[np.ix_(*blocks)]
    slack = float(np.linalg.norm(STRIDE // 2 * background.spacing))
    near = np.abs(phi) <= reach + slack
    phi[near] = distance(points[near])
    return phi


def _at_nodes(
    field: CubicSpline, distance: PartDistance, nodes: Float[np.ndarray, "nodes d"], limit: float
) -> tuple[Float[np.ndarray, " nodes"], Float[np.ndarray, "nodes d"]]:
    """Distance of the nodes [mm], true wherever it is below the limit, and its gradient."""
    parts = [_with_slope(field, nodes[k : k + CHUNK]) for k in range(0, len(nodes), CHUNK)]
    phi, slope = (
        np.concatenate([np.asarray(p) for p in part]) for part in zip(*parts, strict=True)
    )
    near = np.abs(phi) < limited(jnp.asarray(limit), jnp.asarray(limit))
    phi[near] = distance(nodes[near])
    return phi, slope


@eqx.filter_jit
def _with_slope(
    field: CubicSpline, points: Float[Array | np.ndarray, "samples d"]
) -> tuple[Float[Array, " samples"], Float[Array, "samples d"]]:
    """Values of the field and gradients."""
    value, pullback = jax.vjp(lambda x: field(x)[:, 0], jnp.asarray(points))
    (slope,) = pullback(jnp.ones_like(value))
    return value, slope
