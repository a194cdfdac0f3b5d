"""The designer's driver: regions painted with a factor on f."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from texmap_opt.box import Box
from texmap_opt.errors import CaseError
from texmap_opt.region import AbstractRegion
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.concrete import is_concrete
from texmap_opt.warping_function.driven_field import DrivenField

# Least width of the fall-off, in smoothing lengths: 15/8 sqrt(2 pi) = 4.7. The smoothstep is then no
# steeper anywhere than a jump that was convolved with the Gaussian.
FALLOFF_IN_SMOOTHINGS = 15 / 8 * math.sqrt(2 * math.pi)


@dataclass(frozen=True, eq=False)
class PaintedRegion:
    """A factor on f within a region of space.

    Attributes:
        region: where; a box, sphere, cylinder, plane, closed surface, or intersection of them.
        value: the factor, positive; above 1 for smaller cells. May be traced by JAX.
        falloff_mm: how far outside the region the factor has faded to 1 [mm]; see `painted`.
        where: file and section for messages, such as "case.toml: [[paint]] 1".
    """

    region: AbstractRegion
    value: float | Float[Array, ""]
    falloff_mm: float
    where: str

    def __post_init__(self) -> None:
        if is_concrete(self.value) and not 0 < float(self.value) < math.inf:
            raise CaseError(
                f"{self.where} value = {float(self.value):g}: is a factor on f, so must be a positive "
                "number; give 2 for cells half as large."
            )
        if not 0 <= self.falloff_mm < math.inf:
            raise CaseError(
                f"{self.where} falloff_mm = {self.falloff_mm:g}: must be a length of at least 0."
            )


def painted(
    regions: Sequence[PaintedRegion], grid: BackgroundGrid, *, smoothing_mm: float
) -> DrivenField:
    """The field of painted regions: 1 where nothing is painted; where regions overlap, the product.

    log f of a region is log(value) S(d / w), d the distance to it, S the smoothstep that falls from
    1 at 0 to 0 at 1 with two continuous derivatives (Perlin, "Improving noise", SIGGRAPH 2002), and
    w the fall-off, but never less than `FALLOFF_IN_SMOOTHINGS` times the smoothing length. So a jump
    becomes no steeper than the same jump averaged over that length, which is what a grid of such
    cells can follow. It is widened outwards instead of being averaged because averaging takes from
    both sides of the boundary: half of log(value) would be left on it, and next to nothing of a
    region smaller than a cell. This way f is `value` all over the region, however small.

    In two dimensions a region paints where any point along the extrusion belongs to it.

    Args:
        regions: in any order.
        grid: the background grid.
        smoothing_mm: as for the other drivers [mm]; half the edge of a cell is usual.

    Raises:
        CaseError: if a region lies outside the warp's box (by more than the background grid can
            tell), or is one of a surface only.
    """
    log_f = jnp.zeros(grid.shape)
    for painting in regions:
        distance = _distance(painting, grid)
        width = max(painting.falloff_mm, FALLOFF_IN_SMOOTHINGS * smoothing_mm)
        value = jnp.asarray(painting.value, dtype=jnp.float64)
        log_f = log_f + jnp.log(value) * _smoothstep(distance / width)
    return DrivenField(log_f, None, jnp.zeros((*grid.shape, 0)))


def _distance(painting: PaintedRegion, grid: BackgroundGrid) -> Float[np.ndarray, "*controls"]:
    """Distance of every node to the region [mm], negative inside."""
    stations = _stations(grid)
    try:
        distance = np.min([painting.region.distance(points) for points in stations], axis=0)
    except CaseError as failure:
        raise CaseError(f"{painting.where} region: {failure}") from failure
    distance = distance.reshape(grid.shape)
    points = grid.points
    # Nodes on the box's faces belong to it, rounding or not.
    slack = 1e-9 * grid.spacing
    in_box = np.all((points >= grid.box.low - slack) & (points <= grid.box.high + slack), axis=-1)
    # Distances change by no more than the way: beyond this no point between the nodes belongs to it.
    resolution = float(np.linalg.norm(grid.spacing)) / 2
    if distance[in_box].min() > resolution:
        raise CaseError(
            f"{painting.where} region: {painting.region.describe()} lies outside the warp's box, "
            f"{_extent(grid.box)}, so it paints nothing: move or enlarge the region, or give the "
            "warp a wider margin."
        )
    return distance


def _stations(grid: BackgroundGrid) -> list[Float[np.ndarray, "samples 3"]]:
    """The nodes in space; in two dimensions at several places along the extrusion."""
    middle = grid.positions.reshape(-1, 3)
    if grid.box.dimensions == 3:
        return [middle]
    length = float(np.ptp(grid.box.bounds[:, 2]))
    # An odd number: half way along is one of them.
    count = 2 * math.ceil(length / (2 * float(grid.spacing.min()))) + 1
    return [middle + t * grid.box.axes[2] for t in np.linspace(-length / 2, length / 2, count)]


def _smoothstep(t: Float[np.ndarray, "*controls"]) -> Float[np.ndarray, "*controls"]:
    """1 up to t = 0, 0 from t = 1, with two continuous derivatives."""
    t = np.clip(t, 0, 1)
    return 1 - t**3 * (10 - 15 * t + 6 * t**2)


def _extent(box: Box) -> str:
    """The size and place of a box in words, however it is turned."""
    centre = box.bounds.mean(axis=0) @ box.axes
    edges = " x ".join(f"{length:g}" for length in np.ptp(box.bounds, axis=0))
    return f"{edges} mm about ({', '.join(f'{x:g}' for x in centre)}) mm"
