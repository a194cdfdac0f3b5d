"""How the wanted size follows from f: exponent, contrast, and the window of the contrast limit."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from texmap_opt.errors import WarpError
from texmap_opt.warping_function.concrete import is_concrete

# Sharpness of the contrast limit v (1 + |v/L|^8)^(-1/8): at half the limit v is left alone to
# 0.05 %, at the limit it is cut to 92 %, and all derivatives the solver takes exist.
LIMIT_POWER = 8

# The limit's window is centred between these quantiles of log f over the part's volume: half the
# range would follow a single stress concentration, the mean would cut a skewed field on one side.
WINDOW_QUANTILES = (0.05, 0.95)

# Width over which a value counts as below a quantile, in log f: 5 % of f. Without it the quantile
# has kinks wherever two nodes change their order, and no derivative that a difference confirms.
QUANTILE_BLUR = 0.05

# Width of the clip that moves the window, and the most by which a blurred extreme of log f lies
# beyond the extreme, both as shares of L: without them the centre has kinks where the range of log f
# is the window's width and where two nodes exchange the extreme. Small beside the 8 % by which the
# limit itself cuts at L.
CLIP_WIDTH, EXTREME_BLUR = 0.05, 0.02

# Halvings of the interval that holds a quantile: 2^-60 of the range of log f.
HALVINGS = 60


class SizeLaw(eqx.Module):
    """How the wanted size follows from f; both numbers may be traced by JAX.

    Attributes:
        exponent: size ~ f^-exponent; positive.
        contrast: bound on the largest over the smallest wanted size; at least 1.
    """

    exponent: float | Float[Array, ""] = 1.0
    contrast: float | Float[Array, ""] = 3.0

    def __check_init__(self) -> None:
        if is_concrete(self.exponent) and not 0 < float(self.exponent) < np.inf:
            raise WarpError(
                f"The warp's exponent is {float(self.exponent):g}, but must be a positive number: "
                'give one (1 is usual), or use the method "uniform".'
            )
        if is_concrete(self.contrast) and not 1 <= float(self.contrast) < np.inf:
            raise WarpError(
                f"The warp's contrast is {float(self.contrast):g}, but is the ratio of the largest "
                "to the smallest cell and must be at least 1: give a number such as 3."
            )

    @property
    def limit(self) -> Float[Array, ""]:
        """L: half the width of the window of log f."""
        # 1e-9 instead of zero for contrast 1: constant to nine digits and no division by zero.
        return jnp.maximum(jnp.log(self.contrast) / (2.0 * jnp.asarray(self.exponent)), 1e-9)


def limited(v: Float[Array, " *_"], limit: Float[Array, ""]) -> Float[Array, " *_"]:
    """The smooth limit l(v) = v (1 + |v/L|^8)^(-1/8), below L in size."""
    return v * (1.0 + (v / limit) ** LIMIT_POWER) ** (-1.0 / LIMIT_POWER)


def window_centre(
    log_f: Float[Array, "*controls"],
    importance: Float[Array, "*controls"],
    limit: Float[Array, ""],
) -> Float[Array, ""]:
    """The centre c of the window [c - L, c + L] of log f that the contrast limit leaves alone.

    Half way between two quantiles over the part's volume; moved by as much as it takes not to cut
    anything where the whole range of log f fits, and not to reach beyond the range where it does
    not: the median of the middle m, max - L and min + L. All of it smooth: the extremes are blurred
    outwards by up to `EXTREME_BLUR` L, and the centre is clipped between the other two by

        c = (lo + hi + |m - lo| - |m - hi|) / 2,    lo, hi = (a + b -+ |a - b|) / 2

    with |x| smooth and never above the modulus, which keeps c strictly between them.
    """
    values, volume = log_f.reshape(-1), importance.reshape(-1)
    low, high = (_quantile(values, volume, share) for share in WINDOW_QUANTILES)
    # Equal values of all nodes lie beyond the extreme by blur x log(nodes).
    blur = EXTREME_BLUR * limit / np.log(1 + values.size)
    a = blur * jax.nn.logsumexp(values / blur) - limit
    b = limit - blur * jax.nn.logsumexp(-values / blur)
    width = CLIP_WIDTH * limit
    middle, half_gap = (a + b) / 2.0, _smooth_modulus(a - b, width) / 2.0
    m = (low + high) / 2.0 - middle
    return (
        middle + (_smooth_modulus(m + half_gap, width) - _smooth_modulus(m - half_gap, width)) / 2
    )


def _smooth_modulus(x: Float[Array, ""], width: Float[Array, ""]) -> Float[Array, ""]:
    """The smooth width log cosh(x / width): |x| less width log 2 away from zero, never above it."""
    return width * (jnp.logaddexp(x / width, -x / width) - np.log(2.0))


@eqx.filter_jit
def _quantile(
    values: Float[Array, " controls"], volume: Float[Array, " controls"], share: float
) -> Float[Array, ""]:
    """The value that `share` of the volume is below, blurred; differentiable in the values."""

    def below(q, values):
        return jnp.sum(volume * jax.nn.sigmoid((q - values) / QUANTILE_BLUR)) / jnp.sum(volume)

    fixed = jax.lax.stop_gradient(values)
    # Beyond both ends by enough that the blur is gone.
    interval = jnp.min(fixed) - 40 * QUANTILE_BLUR, jnp.max(fixed) + 40 * QUANTILE_BLUR

    def halve(_, interval):
        low, high = interval
        middle = (low + high) / 2
        under = below(middle, fixed) < share
        return jnp.where(under, middle, low), jnp.where(under, high, middle)

    q, _ = jax.lax.fori_loop(0, HALVINGS, halve, interval)
    # One step of Newton's method from the solution moves it by rounding only, and carries its
    # derivative: that of the implicit function.
    density = jax.grad(below)(q, fixed)
    return q - (below(q, values) - share) / density
