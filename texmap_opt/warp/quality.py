"""How good a warped grid is, in the numbers of the report."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from texmap_opt.errors import WarpError
from texmap_opt.warp.certificate import folded, grid_coefficients
from texmap_opt.warp.hex_grid import HexGrid
from texmap_opt.warp.warp import WarpResult
from texmap_opt.warping_function.warping_function import WarpingFunction

# The twelve edges of a hexahedron in VTK's order of corners.
_EDGES = np.array(
    [[0, 1], [1, 2], [3, 2], [0, 3], [4, 5], [5, 6], [7, 6], [4, 7], [0, 4], [1, 5], [2, 6], [3, 7]]
)

# Edges of `_EDGES` along each axis of the cell, from its lower to its upper side.
_EDGES_ALONG = ((0, 2, 4, 6), (1, 3, 5, 7), (8, 9, 10, 11))

# Spread of log size below which a slope of achieved against wanted size is rounding only.
LEAST_SPREAD = 1e-6

# Points per evaluation of a spline: 64 coefficients each, 0.2 GB with the stress of several cases.
_CHUNK = 50_000


@dataclass(frozen=True, kw_only=True)
class WarpQuality:
    """Measures of one warped grid.

    Attributes:
        cells: number of cells.
        min_jacobian: smallest Bezier coefficient of det J (1 on the uniform grid) over s³.
        folded_cells: cells not shown to be free of folds.
        max_aspect: longest over shortest edge, of the worst cell.
        min_edge: shortest edge of all, relative to the edge of the uniform cell along its axis.
        mean_angle_deg: mean over cells, axis pairs and load cases, weighted by the norm of the
            deviator S, of 1/2 |atan2(2 d_i.S d_j, d_i.S d_i - d_j.S d_j)|, 0 to 90: the angle in
            that plane from the cell's first axis of the pair to the direction of larger stress.
            None without a stress.
        mean_misalignment_deg: the same with the absolute value of the difference, 0 to 45: the
            angle to the nearest principal axis in that plane, whichever stress is larger. None
            likewise.
        size_slope: slope of log achieved against log wanted size; 1 when cells follow f exactly;
            None where one size is wanted everywhere.
        size_correlation: their correlation; None likewise.
    """

    cells: int
    min_jacobian: float
    folded_cells: int
    max_aspect: float
    min_edge: float
    mean_angle_deg: float | None
    mean_misalignment_deg: float | None
    size_slope: float | None
    size_correlation: float | None


def quality(grid: HexGrid, f: WarpingFunction) -> WarpQuality:
    """Measures a grid against the warping function it should follow."""
    coefficients = grid_coefficients(grid)
    wanted = _wanted_sizes(grid, f)
    corners = grid.nodes.reshape(-1, 3)[grid.hexes]
    edges = corners[:, _EDGES[:, 1]] - corners[:, _EDGES[:, 0]]
    lengths = np.linalg.norm(edges, axis=-1)
    relative = [
        lengths[:, along] / h for along, h in zip(_EDGES_ALONG, grid.uniform_edge, strict=True)
    ]
    slope, correlation = _size_fit(coefficients, wanted)
    angle, misalignment = _mean_angles(grid, edges, f)
    return WarpQuality(
        cells=grid.cell_count,
        min_jacobian=float((coefficients / wanted[:, None] ** 3).min()),
        folded_cells=int(folded(coefficients).sum()),
        max_aspect=_largest_ratio(lengths),
        min_edge=float(min(part.min() for part in relative)),
        mean_angle_deg=angle,
        mean_misalignment_deg=misalignment,
        size_slope=slope,
        size_correlation=correlation,
    )


def require_unfolded(result: WarpResult, measured: WarpQuality) -> None:
    """Lets only grids without folds pass.

    Raises:
        WarpError: with the method, the count of folded cells, and the remedy.
    """
    if measured.folded_cells == 0:
        return
    raise WarpError(
        f'The warp "{result.method}" folds {measured.folded_cells} of {measured.cells} cells '
        f"(smallest relative Jacobian {measured.min_jacobian:.3g}, must be above 0): lower "
        '[warp] contrast, or use method = "least-squares", which cannot fold.'
    )


def _wanted_sizes(grid: HexGrid, f: WarpingFunction) -> Float[np.ndarray, " cells"]:
    """Wanted size at the centre of each cell."""
    return np.concatenate([np.asarray(f.size(part)) for part in _chunks(grid.centres)])


def _chunks(points: Float[np.ndarray, "samples 3"]) -> list[Float[np.ndarray, "_ 3"]]:
    return [points[k : k + _CHUNK] for k in range(0, len(points), _CHUNK)]


def _largest_ratio(lengths: Float[np.ndarray, "cells 12"]) -> float:
    """Longest over shortest edge of the worst cell; infinite where an edge has no length."""
    longest, shortest = lengths.max(axis=1), lengths.min(axis=1)
    ratio = np.divide(longest, shortest, out=np.full(len(lengths), np.inf), where=shortest > 0)
    return float(ratio.max())


def _size_fit(
    coefficients: Float[np.ndarray, "cells 27"], wanted: Float[np.ndarray, " cells"]
) -> tuple[float | None, float | None]:
    """Slope and correlation of log achieved against log wanted size over the cells."""
    # The mean of the coefficients is the cell's volume: each basis polynomial integrates to 1/27.
    volume = coefficients.mean(axis=1)
    usable = volume > 0  # a cell inside out has no size; it is counted as folded
    x, y = np.log(wanted[usable]), np.log(volume[usable]) / 3
    if len(x) < 2 or np.std(x) < LEAST_SPREAD:
        return None, None
    x, y = x - x.mean(), y - y.mean()
    slope = float(x @ y / (x @ x))
    spread = float(np.sqrt((x @ x) * (y @ y)))
    return slope, float(x @ y) / spread if spread > 0 else 0.0


def _mean_angles(
    grid: HexGrid, edges: Float[np.ndarray, "cells 12 3"], f: WarpingFunction
) -> tuple[float | None, float | None]:
    """`mean_angle_deg` and `mean_misalignment_deg` of `WarpQuality`.

    d_i are the unit mean edge directions of a cell, S the normalised deviator at its centre.
    """
    mean_edges = np.stack([edges[:, along].mean(axis=1) for along in _EDGES_ALONG], axis=1)
    length = np.linalg.norm(mean_edges, axis=-1, keepdims=True)
    d = np.divide(mean_edges, length, out=np.zeros_like(mean_edges), where=length > 0)
    S = np.concatenate([np.asarray(f.stress(part)) for part in _chunks(grid.centres)], axis=1)
    weight = np.sqrt(np.einsum("cnij,cnij->cn", S, S))
    if weight.sum() == 0:
        return None, None
    A = np.einsum("nia,cnab,njb->cnij", d, S, d, optimize=True)  # stress in the cell's frame
    pairs = ((0, 1), (1, 2), (2, 0))
    shear = np.stack([2 * A[..., i, j] for i, j in pairs])
    difference = np.stack([A[..., i, i] - A[..., j, j] for i, j in pairs])
    angle, misalignment = (
        float(
            np.degrees(np.average((np.abs(np.arctan2(shear, x)) / 2).mean(axis=0), weights=weight))
        )
        for x in (difference, np.abs(difference))
    )
    return angle, misalignment
