"""The warping function: what size of cell, and what direction, each place asks for."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.voigt import tensor
from texmap_opt.box import Box
from texmap_opt.errors import WarpError
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.concrete import is_concrete
from texmap_opt.warping_function.cubic_spline import CubicSpline
from texmap_opt.warping_function.size_law import SizeLaw, limited, window_centre

# Points per axis of the midpoint rule that normalises the size, at least and at most. The field is
# smooth over two of them wherever the limits do not bind.
MIN_QUADRATURE, MAX_QUADRATURE = 16, 64


# Stress below this part of its root mean square in the part has no direction: it is discretisation
# error there.
DIRECTION_FLOOR = 1e-2


class WarpingFunction(eqx.Module):
    """A smooth scalar f > 0, the size of cell it asks for, and the stress that turns the cells.

    With v = log f, c the centre of the window, L = log(contrast) / (2 exponent) and the smooth
    limit l(v) = v (1 + |v/L|^8)^(-1/8), the wanted size relative to a uniform cell is
    s(x) = exp(-exponent l(v(x) - c)) / a, with a such that the mean of s^-d over the box is 1: the
    box then holds as many cells as before. Points are given by their coordinates in the box (see
    `Box`), inside it or not, and all methods are twice differentiable in them; the whole object is
    a pytree that JAX differentiates from the values it was built of.

    Attributes:
        log_f: spline of log f.
        stress_field: spline of the smoothed stress over its root mean square in the part; channels
            are cases x Voigt (order of `fea`), along the axes of the box. No channels where f was
            painted.
        centre: c.
        limit: L.
        exponent: of the size law.
        log_scale: log a.
    """

    log_f: CubicSpline
    stress_field: CubicSpline
    centre: Float[Array, ""]
    limit: Float[Array, ""]
    exponent: Float[Array, ""]
    log_scale: Float[Array, ""]

    @classmethod
    def on_grid(
        cls,
        grid: BackgroundGrid,
        log_f: Float[Array | np.ndarray, "*controls"],
        law: SizeLaw,
        *,
        stress: Float[Array | np.ndarray, "*controls _"] | None = None,
        importance: Float[np.ndarray, "*controls"] | None = None,
    ) -> "WarpingFunction":
        """Builds the function from values at the nodes of a background grid.

        Args:
            grid: the background grid.
            log_f: logarithm of f.
            law: exponent and contrast.
            stress: along the box's axes, over its root mean square in the part, six Voigt components
                per load case; None: there is none, and nothing to turn the cells by.
            importance: volume of the part at each node, which places the window of the contrast
                limit; None: everywhere the same.

        Raises:
            WarpError: if a value is not finite.
        """
        stress = np.zeros((*grid.shape, 0)) if stress is None else stress
        _require_finite(log_f, stress)
        importance = np.ones(grid.shape) if importance is None else importance
        return _built(
            (jnp.asarray(log_f), jnp.asarray(stress), jnp.asarray(importance)),
            (law.limit, jnp.asarray(law.exponent, dtype=jnp.float64)),
            jnp.asarray(_midpoints(grid)),
            CubicSpline.through(np.zeros((*grid.shape, 0)), grid),
        )

    @classmethod
    def from_formula(
        cls,
        f: Callable[[Float[np.ndarray, "samples 3"]], Float[Array | np.ndarray, " samples"]],
        box: Box,
        *,
        spacing_mm: float,
        law: SizeLaw,
    ) -> "WarpingFunction":
        """A warping function from a formula for f > 0, as in the paper's figures 7 and 8.

        Args:
            f: values at points in space [mm]; only ratios matter. One written in JAX lets the warp
                be differentiated by the formula's parameters.
            box: what is warped.
            spacing_mm: of the background grid; a tenth of the shortest wave of f is fine enough.
            law: exponent and contrast.

        Raises:
            WarpError: if f is not positive and finite somewhere, or gives not one value a point.
        """
        grid = BackgroundGrid.covering(box, spacing_mm)
        return cls.on_grid(grid, log_of_formula(f, grid), law)

    @property
    def cases(self) -> int:
        """Number of load cases whose stress is known."""
        return self.stress_field.coefficients.shape[-1] // 6

    @eqx.filter_jit
    def f(self, points: Float[Array | np.ndarray, "samples d"]) -> Float[Array, " samples"]:
        """The contrast-limited f at `points` [mm], 1 at the centre of the window."""
        return jnp.exp(self._limited(points))

    @eqx.filter_jit
    def size(self, points: Float[Array | np.ndarray, "samples d"]) -> Float[Array, " samples"]:
        """Wanted edge of a cell at `points` [mm], relative to a uniform cell."""
        return jnp.exp(-self.exponent * self._limited(points) - self.log_scale)

    @eqx.filter_jit
    def stress(
        self, points: Float[Array | np.ndarray, "samples d"]
    ) -> Float[Array, "cases samples 3 3"]:
        """The smoothed stress at `points` [mm] over its root mean square in the part.

        Along the axes of the box; the root mean square is that of the norm of all load cases
        together. Fades where the part ends.
        """
        voigt = self.stress_field(points)
        return jnp.moveaxis(tensor(voigt.reshape(voigt.shape[0], self.cases, 6)), 1, 0)

    @eqx.filter_jit
    def direction(
        self, points: Float[Array | np.ndarray, "samples d"]
    ) -> Float[Array, "cases samples d d"]:
        """The direction of the stress, whatever its size: S = dev sigma / sqrt(|sigma|² + floor²).

        In two dimensions what is in the plane. |sigma| is the norm of all load cases together, so a
        case with more stress at a point has more say there. Small where the stress is isotropic and
        where there is next to none.
        """
        d = self.log_f.origin.shape[0]
        stress = self.stress(points)[..., :d, :d]
        scale = jnp.sqrt(jnp.sum(stress**2, axis=(0, 2, 3)) + DIRECTION_FLOOR**2)
        return _deviator(stress) / scale[None, :, None, None]

    def deviator(
        self, points: Float[Array | np.ndarray, "samples d"]
    ) -> Float[Array, "cases samples d d"]:
        """`stress` without its mean normal component, in two dimensions what is in the plane."""
        d = self.log_f.origin.shape[0]
        return _deviator(self.stress(points)[..., :d, :d])

    def softened(self, share: float) -> "WarpingFunction":
        """The function whose wanted size is this one's to the power `share`."""
        return eqx.tree_at(
            lambda function: (function.exponent, function.log_scale),
            self,
            (self.exponent * share, self.log_scale * share),
        )

    def _limited(self, points: Float[Array | np.ndarray, "samples d"]) -> Float[Array, " samples"]:
        return limited(self.log_f(points)[:, 0] - self.centre, self.limit)


def log_of_formula(
    f: Callable[[Float[np.ndarray, "samples 3"]], Float[Array | np.ndarray, "..."]],
    grid: BackgroundGrid,
) -> Float[Array, "*controls"]:
    """The logarithm of a formula for f at the nodes of a background grid.

    Raises:
        WarpError: if f is not positive and finite somewhere, or gives not one value a point.
    """
    points = grid.positions.reshape(-1, 3)
    values = jnp.asarray(f(points))
    if values.shape != (len(points),):
        raise WarpError(
            f"The formula for f gives an array of shape {values.shape} for {len(points)} points; it "
            "must give one value for each."
        )
    if is_concrete(values):
        require_positive(np.asarray(values))
    return jnp.log(values).reshape(grid.shape)


def _deviator(stress: Float[Array, "cases samples d d"]) -> Float[Array, "cases samples d d"]:
    d = stress.shape[-1]
    mean = jnp.trace(stress, axis1=-2, axis2=-1)[..., None, None] / d
    return stress - mean * jnp.eye(d)[None, None]


@eqx.filter_jit
def _built(
    values: tuple[
        Float[Array, "*controls"], Float[Array, "*controls _"], Float[Array, "*controls"]
    ],
    law: tuple[Float[Array, ""], Float[Array, ""]],
    midpoints: Float[Array, "samples d"],
    empty: CubicSpline,
) -> WarpingFunction:
    """`WarpingFunction.on_grid` in one compiled piece: step by step it takes seconds to compile.

    Args:
        values: log f, stress and importance at the nodes.
        law: limit and exponent.
        midpoints: of the rule that normalises the size [mm].
        empty: a spline on the grid.
    """
    (log_f, stress, importance), (limit, exponent) = values, law
    function = WarpingFunction(
        log_f=empty.taking(log_f[..., None]),
        stress_field=empty.taking(stress),
        centre=window_centre(log_f, importance, limit),
        limit=limit,
        exponent=exponent,
        log_scale=jnp.asarray(0.0),
    )
    d = midpoints.shape[1]
    log_scale = -jnp.log(jnp.mean(function.size(midpoints) ** -d)) / d
    return eqx.tree_at(lambda function: function.log_scale, function, log_scale)


def require_positive(f: Float[np.ndarray, "*_"]) -> None:
    """Refuse values of f that are no sizes.

    Raises:
        WarpError: with the count of values that are not positive and finite, and one of them.
    """
    bad = ~(np.isfinite(f) & (f > 0))
    if bad.any():
        raise WarpError(
            f"The warping function has {int(bad.sum())} of {f.size} values that are not finite "
            f"numbers or not positive, such as {float(f[bad].flat[0]):g}: check the field or formula "
            "it comes from."
        )


def _require_finite(
    log_f: Float[Array | np.ndarray, "..."], stress: Float[Array | np.ndarray, "..."]
) -> None:
    bad = sum(int(np.sum(~np.isfinite(np.asarray(v)))) for v in (log_f, stress) if is_concrete(v))
    if bad:
        raise WarpError(
            f"The warping function has {bad} values that are not finite numbers or not positive: "
            "check the stress field, or the file it was read from."
        )


def _midpoints(grid: BackgroundGrid) -> Float[np.ndarray, "samples d"]:
    """Points of the midpoint rule over the box [mm]."""
    axes = []
    for low, high, h in zip(grid.box.low, grid.box.high, grid.spacing, strict=True):
        count = int(np.clip(2 * np.rint((high - low) / h), MIN_QUADRATURE, MAX_QUADRATURE))
        axes.append(low + (high - low) * (np.arange(count) + 0.5) / count)
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
