"""A twice differentiable field on a regular grid: tensor-product cubic B-splines."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.ndimage import spline_filter

from texmap_opt.errors import WarpError
from texmap_opt.warping_function.background_grid import BackgroundGrid


class CubicSpline(eqx.Module):
    """Interpolates values given at the nodes of a background grid; C2 everywhere inside it.

    Source: Unser, "Splines: a perfect fit for signal and image processing", IEEE Signal Processing
    Magazine 16 (1999) 22-38 (the cubic basis, and the prefilter that makes it interpolate).

    Attributes:
        coefficients: of the basis functions, one channel per field.
        origin: position of the first node [mm].
        spacing: distance of neighbouring nodes along x, y, z [mm].
    """

    coefficients: Float[Array, "*controls _"]
    origin: Float[Array, " 3"]
    spacing: Float[Array, " 3"]

    @classmethod
    def through(
        cls, values: Float[np.ndarray, "*controls _"], grid: BackgroundGrid
    ) -> "CubicSpline":
        """The spline that takes `values` at the nodes of `grid`.

        Raises:
            WarpError: if JAX runs in single precision.
        """
        coefficients = np.zeros(values.shape)
        for channel in range(values.shape[-1]):
            coefficients[..., channel] = spline_filter(
                values[..., channel], order=3, output=np.float64, mode="mirror"
            )
        if jnp.zeros(()).dtype != jnp.float64:
            raise WarpError(
                "Warps need double precision, but JAX runs in single precision: call "
                'jax.config.update("jax_enable_x64", True) first.'
            )
        return cls(jnp.asarray(coefficients), jnp.asarray(grid.origin), jnp.asarray(grid.spacing))

    def __call__(self, points: Float[Array | np.ndarray, "samples 3"]) -> Float[Array, "samples _"]:
        """Values at `points` [mm]; a point outside the grid takes the value at its border."""
        *shape, channels = self.coefficients.shape
        # Four basis functions act at a point, centred at its knots first - 1 .. first + 2.
        last = jnp.asarray(shape, dtype=jnp.float64)[None] - 2.0
        t = jnp.clip((jnp.asarray(points) - self.origin[None]) / self.spacing[None], 1.0, last)
        first = jnp.minimum(jnp.floor(jax.lax.stop_gradient(t)), last - 1.0)
        basis = _cubic_basis(t - first)
        tap = first.astype(int)[:, :, None] + jnp.arange(-1, 3)[None, None]
        flat = ((tap[:, 0, :, None, None] * shape[1] + tap[:, 1, None, :, None]) * shape[2]) + tap[
            :, 2, None, None, :
        ]
        near = self.coefficients.reshape(math.prod(shape), channels)[flat]
        along_z = jnp.einsum("sxyzc,sz->sxyc", near, basis[:, 2])  # sample, knots, channel
        along_y = jnp.einsum("sxyc,sy->sxc", along_z, basis[:, 1])
        return jnp.einsum("sxc,sx->sc", along_y, basis[:, 0])


def _cubic_basis(u: Float[Array, "samples 3"]) -> Float[Array, "samples 3 4"]:
    """The four uniform cubic B-splines that are not zero at the fraction u of a knot interval."""
    v = 1.0 - u
    return jnp.stack(
        [
            v**3 / 6.0,
            2.0 / 3.0 - u**2 * (2.0 - u) / 2.0,
            2.0 / 3.0 - v**2 * (2.0 - v) / 2.0,
            u**3 / 6.0,
        ],
        axis=-1,
    )
