"""What a driver of the warp leaves, and how several become one."""

import math
from collections.abc import Callable, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import logsumexp
from jaxtyping import Array, Float

from texmap_opt.errors import WarpError, nearest_name
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.concrete import is_concrete
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.warping_function import WarpingFunction, log_of_formula

# Exponent of the norm that stands for a maximum: smooth, and at most 2^(1/16) = 4 % above the
# larger of two.
MAXIMUM_POWER = 16.0

COMBINATIONS = ("product", "maximum", "sum")


class DrivenField(eqx.Module):
    """One driver's wish at the nodes of a background grid.

    Attributes:
        log_f: logarithm of f; only ratios over space matter.
        importance: volume of the part at each node; None where the driver knows no part.
        stress: normalised stress along the box's axes, six Voigt components per load case; no
            channels where the driver knows none.
    """

    log_f: Float[Array, "*controls"]
    importance: Float[np.ndarray, "*controls"] | None
    stress: Float[Array, "*controls _"]

    def function(self, grid: BackgroundGrid, law: SizeLaw) -> WarpingFunction:
        """The warping function of this field alone.

        Raises:
            WarpError: if a value is not finite.
        """
        return WarpingFunction.on_grid(
            grid, self.log_f, law, stress=self.stress, importance=self.importance
        )


def combined(
    fields: Sequence[DrivenField],
    *,
    how: str = "product",
    weights: Sequence[float | Float[Array, ""]] | None = None,
) -> DrivenField:
    """One field of several.

    With f_i the fields, each divided by its geometric mean over the part's volume, and w_i the
    weights: product of f_i^w_i, sum of w_i f_i, or maximum of w_i f_i (the p-norm with p = 16, which
    has derivatives). The first field that knows the part's volume, or the stress, has the say over it.

    Args:
        fields: at the nodes of one background grid.
        how: one of `COMBINATIONS`.
        weights: one per field, positive; None: 1.

    Raises:
        WarpError: no fields, an unknown combination, another number of weights than of fields, or a
            weight that is not positive.
    """
    weights = [1.0] * len(fields) if weights is None else weights
    _check(fields, how, weights)
    importance = next((f.importance for f in fields if f.importance is not None), None)
    logs = [field.log_f - jnp.average(field.log_f, weights=importance) for field in fields]
    w = [jnp.asarray(weight, dtype=jnp.float64) for weight in weights]
    if how == "product":
        log_f = sum((a * v for a, v in zip(w, logs, strict=True)), jnp.zeros_like(logs[0]))
    else:
        power = 1.0 if how == "sum" else MAXIMUM_POWER
        stacked = jnp.stack([jnp.log(a) + v for a, v in zip(w, logs, strict=True)])
        log_f = logsumexp(power * stacked, axis=0) / power
    stress = next((f.stress for f in fields if f.stress.shape[-1]), fields[0].stress)
    return DrivenField(log_f, importance, stress)


def formula_field(
    f: Callable[[Float[np.ndarray, "samples 3"]], Float[Array | np.ndarray, " samples"]],
    grid: BackgroundGrid,
) -> DrivenField:
    """The field of a Python function, for combining it with other drivers.

    Args:
        f: positive values at points in space [mm]; only ratios matter. One written in JAX lets the
            warp be differentiated by the formula's parameters.
        grid: the background grid; a tenth of the shortest wave of f is fine enough a spacing.

    Raises:
        WarpError: if f is not positive and finite somewhere, or gives not one value a point.
    """
    return DrivenField(log_of_formula(f, grid), None, jnp.zeros((*grid.shape, 0)))


def _check(
    fields: Sequence[DrivenField], how: str, weights: Sequence[float | Float[Array, ""]]
) -> None:
    if not fields:
        raise WarpError("Nothing drives the warp: give at least one driver.")
    if how not in COMBINATIONS:
        raise WarpError(f'Drivers cannot be combined by "{how}"; {nearest_name(how, COMBINATIONS)}')
    if len(weights) != len(fields):
        raise WarpError(
            f"There are {len(fields)} drivers but {len(weights)} weights; give one for each."
        )
    for weight in weights:
        if is_concrete(weight) and not 0 < float(weight) < math.inf:
            raise WarpError(
                f"A driver's weight is {float(weight):g}, but must be a positive number; leave the "
                "driver out instead of giving it none."
            )
