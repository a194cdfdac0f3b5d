"""The warping function: what size of cell, and what direction, the stress asks for."""

from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.voigt import COMPONENT
from texmap_opt.errors import WarpError
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.cubic_spline import CubicSpline

# Sharpness of the contrast limit v (1 + |v/L|^8)^(-1/8): at half the limit v is left alone to
# 0.05 %, at the limit it is cut to 92 %, and all derivatives the solver takes exist.
LIMIT_POWER = 8

# The limit's window is centred between these quantiles of log f over the samples' volume: half the
# range would follow a single stress concentration, the mean would cut a skewed field on one side.
WINDOW_QUANTILES = (0.05, 0.95)

# Points per axis of the midpoint rule that normalises the size, at least and at most. The field is
# smooth over two of them wherever the limits do not bind.
MIN_QUADRATURE, MAX_QUADRATURE = 16, 64


@dataclass(frozen=True, kw_only=True)
class SizeLaw:
    """How the wanted size follows from f.

    Attributes:
        exponent: size ~ f^-exponent; positive.
        contrast: bound on the largest over the smallest wanted size; at least 1.
    """

    exponent: float = 1.0
    contrast: float = 3.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.exponent) and self.exponent > 0):
            raise WarpError(
                f"The warp's exponent is {self.exponent:g}, but must be a positive number: "
                'give one (1 is usual), or use the method "uniform".'
            )
        if not (np.isfinite(self.contrast) and self.contrast >= 1):
            raise WarpError(
                f"The warp's contrast is {self.contrast:g}, but is the ratio of the largest to the "
                "smallest cell and must be at least 1: give a number such as 3."
            )


class WarpingFunction(eqx.Module):
    """A smooth scalar f > 0, the size of cell it asks for, and the stress that turns the cells.

    With v = log f, c the centre of the window, L = log(contrast) / (2 exponent) and the smooth
    limit l(v) = v (1 + |v/L|^8)^(-1/8), the wanted size relative to a uniform cell is
    s(x) = exp(-exponent l(v(x) - c)) / a, with a such that the mean of s^-3 over the box is 1: the
    box then holds as many cells as before. All methods are twice differentiable in the points.

    Attributes:
        log_f: spline of log f.
        deviator: spline of the smoothed normalised stress deviator; channels are cases x Voigt
            (order of `fea`). No cases where f was painted.
        box: lowest and highest corner of what is warped [mm].
        centre: c.
        limit: L.
        exponent: of the size law.
        log_scale: log a.
    """

    log_f: CubicSpline
    deviator: CubicSpline
    box: Float[Array, "2 3"]
    centre: Float[Array, ""]
    limit: Float[Array, ""]
    exponent: Float[Array, ""]
    log_scale: Float[Array, ""]

    @classmethod
    def on_grid(
        cls,
        grid: BackgroundGrid,
        log_f: Float[np.ndarray, "*controls"],
        deviator: Float[np.ndarray, "*controls _"],
        importance: Float[np.ndarray, "*controls"],
        law: SizeLaw,
    ) -> "WarpingFunction":
        """Builds the function from values at the nodes of a background grid.

        Args:
            grid: the background grid.
            log_f: logarithm of f.
            deviator: six Voigt components per load case; no channels when there is no stress.
            importance: volume of the part at each node; places the window of the contrast limit.
            law: exponent and contrast.

        Raises:
            WarpError: if a value is not finite.
        """
        bad = int(np.sum(~np.isfinite(log_f))) + int(np.sum(~np.isfinite(deviator)))
        if bad:
            raise WarpError(
                f"The warping function has {bad} values that are not finite numbers or not "
                "positive: check the stress field, or the file it was read from."
            )
        # 1e-9 instead of zero for contrast 1: constant to nine digits and no division by zero.
        limit = max(np.log(law.contrast) / (2 * law.exponent), 1e-9)
        function = cls(
            log_f=CubicSpline.through(log_f[..., None], grid),
            deviator=CubicSpline.through(deviator, grid),
            box=jnp.asarray(grid.box),
            centre=jnp.asarray(_window_centre(log_f, importance)),
            limit=jnp.asarray(limit),
            exponent=jnp.asarray(float(law.exponent)),
            log_scale=jnp.asarray(0.0),
        )
        sizes = function.size(_midpoints(grid))
        log_scale = -jnp.log(jnp.mean(sizes**-3)) / 3.0
        return eqx.tree_at(lambda function: function.log_scale, function, log_scale)

    @classmethod
    def painted(
        cls,
        f: Callable[[Float[np.ndarray, "samples 3"]], Float[np.ndarray, " samples"]],
        box: Float[np.ndarray, "2 3"],
        *,
        spacing_mm: float,
        law: SizeLaw,
    ) -> "WarpingFunction":
        """A warping function from a formula for f > 0, as in the paper's figures 7 and 8.

        Args:
            f: values at points [mm]; only ratios matter.
            box: lowest and highest corner of what is warped [mm].
            spacing_mm: of the background grid; a tenth of the shortest wave of f is fine enough.
            law: exponent and contrast.

        Raises:
            WarpError: if f is not positive and finite somewhere.
        """
        grid = BackgroundGrid.covering(box, spacing_mm)
        values = f(grid.points.reshape(-1, 3)).reshape(grid.shape)
        log_f = np.log(values, out=np.full(grid.shape, np.nan), where=values > 0)
        return cls.on_grid(grid, log_f, np.zeros((*grid.shape, 0)), np.ones(grid.shape), law)

    def f(self, points: Float[Array | np.ndarray, "samples 3"]) -> Float[Array, " samples"]:
        """The contrast-limited f at `points` [mm], 1 at the centre of the window."""
        return jnp.exp(self._limited(points))

    def size(self, points: Float[Array | np.ndarray, "samples 3"]) -> Float[Array, " samples"]:
        """Wanted edge of a cell at `points` [mm], relative to a uniform cell."""
        return jnp.exp(-self.exponent * self._limited(points) - self.log_scale)

    def stress(
        self, points: Float[Array | np.ndarray, "samples 3"]
    ) -> Float[Array, "cases samples 3 3"]:
        """The smoothed normalised stress deviator S at `points` [mm]; Frobenius norm at most 1."""
        voigt = self.deviator(points)
        voigt = voigt.reshape(voigt.shape[0], voigt.shape[1] // 6, 6)
        return jnp.moveaxis(voigt[..., COMPONENT], 1, 0)

    def _limited(self, points: Float[Array | np.ndarray, "samples 3"]) -> Float[Array, " samples"]:
        v = self.log_f(points)[:, 0] - self.centre
        return v * (1.0 + (v / self.limit) ** LIMIT_POWER) ** (-1.0 / LIMIT_POWER)


def _window_centre(
    log_f: Float[np.ndarray, "*controls"], importance: Float[np.ndarray, "*controls"]
) -> float:
    """Half way between two quantiles of log f over the volume."""
    order = np.argsort(log_f, axis=None)
    volume = np.cumsum(importance.ravel()[order])
    low, high = np.searchsorted(volume, np.array(WINDOW_QUANTILES) * volume[-1])
    ranked = log_f.ravel()[order]
    return float(ranked[low] + ranked[high]) / 2


def _midpoints(grid: BackgroundGrid) -> Float[np.ndarray, "samples 3"]:
    """Points of the midpoint rule over the box [mm]."""
    axes = []
    for low, high, h in zip(grid.box[0], grid.box[1], grid.spacing, strict=True):
        count = int(np.clip(2 * np.rint((high - low) / h), MIN_QUADRATURE, MAX_QUADRATURE))
        axes.append(low + (high - low) * (np.arange(count) + 0.5) / count)
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
