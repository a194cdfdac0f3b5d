"""How good a warped grid is, in the numbers of the report."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.effective_stiffness import EffectiveStiffness
from fea.plane_stiffness import PlaneStiffness
from texmap_opt.errors import WarpError
from texmap_opt.warp.alignment import turned_compliance
from texmap_opt.warp.cell_volumes import equivalent_edges
from texmap_opt.warp.certificate import folded, grid_coefficients
from texmap_opt.warp.frames import rotations
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.orientation import energy_share
from texmap_opt.warp.warp import WarpResult
from texmap_opt.warping_function.warping_function import WarpingFunction

# Spread of log size below which a slope of achieved against wanted size is rounding only.
LEAST_SPREAD = 1e-6

# Deviator over stress below which the stress is a pressure and the rest rounding of its spline.
ISOTROPIC = 1e-12

# Points per evaluation of a spline: 64 coefficients each, 0.2 GB with the stress of several cases.
_CHUNK = 50_000


@dataclass(frozen=True, kw_only=True)
class WarpQuality:
    """Measures of one warped grid; angles and energies are None where no stress is known.

    Attributes:
        cells: number of cells.
        min_jacobian: smallest Bezier coefficient of det J (1 on the uniform grid) over s^d.
        folded_cells: cells not shown to be free of folds.
        max_aspect: longest over shortest edge, of the worst cell.
        min_edge: shortest edge of all, relative to the edge of the uniform cell along its axis.
        scaled_jacobian: smallest determinant of the unit edges at a corner, over all corners of
            all cells: 1 in cuboids, not above 0 where a corner inverts.
        mean_angle_deg: mean over cells, axis pairs and load cases, weighted by the norm of the
            deviator S, of 1/2 |atan2(2 d_i.S d_j, d_i.S d_i - d_j.S d_j)|, 0 to 90: the angle in
            that plane from the cell's first axis of the pair to the direction of larger stress.
        mean_misalignment_deg: the same with the absolute value of the difference, 0 to 45: the
            angle to the nearest principal axis in that plane, whichever stress is larger.
        turn_deg: mean of that angle weighted by how much the stress differs over directions in
            the plane of the pair, so that a plane in which all are principal does not count.
        turn_uniform_deg: the same for cells at the same places along the axes of the box.
        size_slope: slope of log achieved against log wanted size; 1 when cells follow f exactly;
            None where one size is wanted everywhere. Sizes are d-th roots of volumes.
        size_correlation: their correlation; None likewise.
        size_error: root mean square of log achieved over wanted size; None where all cells are inside
            out.
        part_size_slope: as `size_slope`, over the cells that count; None also where all do.
        part_size_correlation: as `size_correlation`, likewise.
        energy_warped: strain energy of the stress in the frames of the cells that count, over
            that in the frame of the box, a cell's stiffness in its own frame; see `EnergyShare`.
            None also without a stiffness.
        energy_best: the same in the best frame of each cell.
        energy_worst: the same in the worst.
        energy_share: share of the attainable gain that is reached; None also where turning the
            cell changes nothing.
    """

    cells: int
    min_jacobian: float
    folded_cells: int
    max_aspect: float
    min_edge: float
    scaled_jacobian: float
    mean_angle_deg: float | None
    mean_misalignment_deg: float | None
    turn_deg: float | None
    turn_uniform_deg: float | None
    size_slope: float | None
    size_correlation: float | None
    size_error: float | None
    part_size_slope: float | None
    part_size_correlation: float | None
    energy_warped: float | None
    energy_best: float | None
    energy_worst: float | None
    energy_share: float | None


@dataclass(frozen=True, eq=False)
class Turns:
    """Angles between the axes of cells and the principal axes of stresses, pair by pair of axes.

    Attributes:
        first: from the cell's first axis of the pair to the direction of larger stress [rad],
            0 to pi/2.
        nearest: to the nearest principal axis in the plane of the pair [rad], 0 to pi/4.
        anisotropy: radius of Mohr's circle in that plane: half of what the stress differs by.
    """

    first: Float[np.ndarray, "pairs cases cells"]
    nearest: Float[np.ndarray, "pairs cases cells"]
    anisotropy: Float[np.ndarray, "pairs cases cells"]

    @classmethod
    def of(
        cls,
        directions: Float[np.ndarray, "cells d d"],
        stress: Float[np.ndarray, "cases cells d d"],
    ) -> "Turns":
        """Of cells with these unit directions as rows, and a stress in each."""
        d = directions.shape[-1]
        A = directions @ stress @ np.swapaxes(directions, -1, -2)  # stress in the cell's frame
        pairs = ((0, 1),) if d == 2 else ((0, 1), (1, 2), (2, 0))
        shear = np.stack([2 * A[..., i, j] for i, j in pairs])
        difference = np.stack([A[..., i, i] - A[..., j, j] for i, j in pairs])
        return cls(
            first=np.abs(np.arctan2(shear, difference)) / 2,
            nearest=np.arctan2(np.abs(shear), np.abs(difference)) / 2,
            anisotropy=np.hypot(shear, difference) / 2,
        )


def quality(
    grid: Grid,
    f: WarpingFunction,
    *,
    stiffness: EffectiveStiffness | PlaneStiffness | None = None,
    weights: Float[np.ndarray, " cells"] | None = None,
) -> WarpQuality:
    """Measures a grid against the warping function it should follow.

    Args:
        grid: the warped grid.
        f: what it should follow.
        stiffness: of the unit cell in its own axes, up to a factor; None: no energies.
        weights: how much each cell counts for the energies, such as the part's volume in it; only
            cells above zero count for the sizes in the part. None: all alike.
    """
    asked = wanted_sizes(grid, f), stresses(grid, f)
    return quality_for(grid, *asked, stiffness=stiffness, weights=weights)


def quality_for(
    grid: Grid,
    wanted: Float[np.ndarray, " cells"],
    stress: Float[np.ndarray, "cases cells d d"],
    *,
    stiffness: EffectiveStiffness | PlaneStiffness | None = None,
    weights: Float[np.ndarray, " cells"] | None = None,
) -> WarpQuality:
    """`quality`, given what f asks at the centres of the cells: `wanted_sizes` and `stresses`."""
    coefficients, achieved = grid_coefficients(grid), achieved_sizes(grid)
    lengths, scaled = _shape(grid)
    # A cell inside out has no size; it is counted as folded.
    usable = achieved > 0
    slope, correlation = log_fit(wanted[usable], achieved[usable])
    counted = usable & (weights > 0) if weights is not None else np.zeros_like(usable)
    in_part = log_fit(wanted[counted], achieved[counted])
    error = np.log(achieved[usable] / wanted[usable])
    return WarpQuality(
        cells=grid.cell_count,
        min_jacobian=float((coefficients / wanted[:, None] ** grid.dimensions).min()),
        folded_cells=int(folded(coefficients).sum()),
        max_aspect=_largest_ratio(lengths),
        min_edge=float((lengths / grid.uniform_edge).min()),
        scaled_jacobian=scaled,
        size_slope=slope,
        size_correlation=correlation,
        size_error=float(np.sqrt(np.mean(error**2))) if usable.any() else None,
        part_size_slope=in_part[0],
        part_size_correlation=in_part[1],
        **_angles(grid, stress),
        **energies(grid, stress, stiffness, weights),
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


def wanted_sizes(grid: Grid, f: WarpingFunction) -> Float[np.ndarray, " cells"]:
    """Wanted size at the centre of each cell, relative to a uniform cell."""
    return np.concatenate(_in_chunks(f.size, grid))


def achieved_sizes(grid: Grid) -> Float[np.ndarray, " cells"]:
    """d-th root of each cell's volume over that of a uniform cell; NaN where it is inside out."""
    uniform = np.prod(grid.uniform_edge) ** (1 / grid.dimensions)
    return equivalent_edges(grid.nodes).reshape(-1) / uniform


def log_fit(
    wanted: Float[np.ndarray, " cells"], achieved: Float[np.ndarray, " cells"]
) -> tuple[float | None, float | None]:
    """Slope of log achieved against log wanted size, and their correlation.

    None where one size is wanted everywhere; both must be positive.
    """
    x, y = np.log(wanted), np.log(achieved)
    if len(x) < 2 or np.std(x) < LEAST_SPREAD:
        return None, None
    x, y = x - x.mean(), y - y.mean()
    slope = float(x @ y / (x @ x))
    spread = float(np.sqrt((x @ x) * (y @ y)))
    return slope, float(x @ y) / spread if spread > 0 else 0.0


def stresses(grid: Grid, f: WarpingFunction) -> Float[np.ndarray, "cases cells d d"]:
    """The smoothed stress at the centre of each cell over its root mean square, in the plane in 2-D."""
    d = grid.dimensions
    return np.concatenate(_in_chunks(lambda points: f.stress(points)[..., :d, :d], grid), axis=1)


def frames(grid: Grid) -> Float[np.ndarray, "cells d d"]:
    """Axes of each cell as rows, in those of the box: the rotation nearest to its mean edges."""
    return np.asarray(rotations(jnp.asarray(_mean_edges(grid) / grid.uniform_edge[:, None])))


def turns(grid: Grid, stress: Float[np.ndarray, "cases cells d d"]) -> tuple[Turns, Turns]:
    """Of the cells as they are, by their unit mean edges, and of cells along the axes of the box."""
    box = np.broadcast_to(np.eye(grid.dimensions), (grid.cell_count, *[grid.dimensions] * 2))
    return Turns.of(_unit(_mean_edges(grid)), stress), Turns.of(box, stress)


def _in_chunks(
    function: Callable[[Float[np.ndarray, "samples d"]], Array], grid: Grid
) -> list[np.ndarray]:
    points = grid.centres
    return [np.asarray(function(points[k : k + _CHUNK])) for k in range(0, len(points), _CHUNK)]


def _corner_edges(grid: Grid) -> Iterator[Float[np.ndarray, "cells d d"]]:
    """Edges of all cells at one corner after the other, axis by axis as rows."""
    d = grid.dimensions
    along = [np.diff(grid.nodes, axis=axis) for axis in range(d)]
    for corner in product((0, 1), repeat=d):
        edges = []
        for axis, vectors in enumerate(along):
            sides = [slice(end, end + n) for end, n in zip(corner, grid.cells, strict=True)]
            sides[axis] = slice(None)
            edges.append(vectors[tuple(sides)].reshape(-1, d))
        yield np.stack(edges, axis=1)


def _mean_edges(grid: Grid) -> Float[np.ndarray, "cells d d"]:
    """Mean edges of each cell along its axes, as rows."""
    total = np.zeros((grid.cell_count, grid.dimensions, grid.dimensions))
    for edges in _corner_edges(grid):
        total += edges
    return total / 2**grid.dimensions


def _shape(grid: Grid) -> tuple[Float[np.ndarray, "2 cells d"], float]:
    """Shortest and longest edge of each cell along each of its axes; the scaled Jacobian."""
    shortest = np.full((grid.cell_count, grid.dimensions), np.inf)
    longest, scaled = np.zeros_like(shortest), np.inf
    for edges in _corner_edges(grid):
        lengths = np.linalg.norm(edges, axis=-1)
        shortest, longest = np.minimum(shortest, lengths), np.maximum(longest, lengths)
        scaled = min(scaled, float(np.linalg.det(_unit(edges)).min()))
    return np.stack([shortest, longest]), scaled


def _unit(edges: Float[np.ndarray, "cells d d"]) -> Float[np.ndarray, "cells d d"]:
    """Directions; zero where there is none."""
    length = np.linalg.norm(edges, axis=-1, keepdims=True)
    return np.divide(edges, length, out=np.zeros_like(edges), where=length > 0)


def _largest_ratio(lengths: Float[np.ndarray, "2 cells d"]) -> float:
    """Longest over shortest edge of the worst cell; infinite where an edge has no length."""
    shortest, longest = lengths[0].min(axis=1), lengths[1].max(axis=1)
    ratio = np.divide(longest, shortest, out=np.full(len(shortest), np.inf), where=shortest > 0)
    return float(ratio.max())


def _angles(grid: Grid, stress: Float[np.ndarray, "cases cells d d"]) -> dict[str, float | None]:
    """The fields of `WarpQuality` that are angles.

    `mean_angle_deg` and `mean_misalignment_deg` are weighted by the norm of the deviator.
    """
    d = grid.dimensions
    mean = np.trace(stress, axis1=-2, axis2=-1)[..., None, None] / d
    size = np.linalg.norm(stress - mean * np.eye(d), axis=(-2, -1))
    if size.sum() <= ISOTROPIC * np.abs(stress).sum():
        names = ("mean_angle_deg", "mean_misalignment_deg", "turn_deg", "turn_uniform_deg")
        return dict.fromkeys(names)
    cells, unturned = turns(grid, stress)
    return {
        "mean_angle_deg": _mean_deg(cells.first.mean(axis=0), size),
        "mean_misalignment_deg": _mean_deg(cells.nearest.mean(axis=0), size),
        "turn_deg": _mean_deg(cells.nearest, cells.anisotropy),
        "turn_uniform_deg": _mean_deg(unturned.nearest, unturned.anisotropy),
    }


def _mean_deg(angles: Float[np.ndarray, "..."], weights: Float[np.ndarray, "..."]) -> float:
    return float(np.degrees(np.average(angles, weights=weights)))


def energies(
    grid: Grid,
    stress: Float[np.ndarray, "cases cells d d"],
    stiffness: EffectiveStiffness | PlaneStiffness | None,
    weights: Float[np.ndarray, " cells"] | None,
) -> dict[str, float | None]:
    """The fields of `WarpQuality` that are energies."""
    names = ("energy_warped", "energy_best", "energy_worst", "energy_share")
    # A cell inside out has no frame.
    counts = np.where(np.linalg.det(_mean_edges(grid)) > 0, 1.0, 0.0)
    counts = counts if weights is None else counts * weights
    if stiffness is None or not (counts * np.abs(stress).sum(axis=(0, 2, 3))).any():
        return dict.fromkeys(names)
    compliance = turned_compliance(stiffness, grid.dimensions)
    energy = energy_share(compliance, stress, frames(grid), counts)
    of = (energy.warped, energy.best, energy.worst)
    relative = [value / energy.uniform for value in of]
    return dict(zip(names, [*relative, energy.share], strict=True))
