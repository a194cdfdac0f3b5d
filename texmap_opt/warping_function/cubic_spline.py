"""A twice differentiable field on a regular grid: tensor-product cubic B-splines."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from texmap_opt.errors import WarpError
from texmap_opt.warping_function.background_grid import BackgroundGrid


class CubicSpline(eqx.Module):
    """Interpolates values given at the nodes of a background grid; C2 everywhere inside it.

    Source: Unser, "Splines: a perfect fit for signal and image processing", IEEE Signal Processing
    Magazine 16 (1999) 22-38 (the cubic basis, and the prefilter that makes it interpolate).

    Attributes:
        coefficients: of the basis functions, one channel per field.
        origin: coordinates of the first node [mm].
        spacing: distance of neighbouring nodes along each axis [mm].
    """

    coefficients: Float[Array, "*controls _"]
    origin: Float[Array, " d"]
    spacing: Float[Array, " d"]

    @classmethod
    def through(
        cls, values: Float[Array | np.ndarray, "*controls _"], grid: BackgroundGrid
    ) -> "CubicSpline":
        """The spline that takes `values` at the nodes of `grid`; linear in the values.

        Raises:
            WarpError: if JAX runs in single precision.
        """
        if not jax.config.read("jax_enable_x64"):
            raise WarpError(
                "Warps need double precision, but JAX runs in single precision: call "
                'jax.config.update("jax_enable_x64", True) first.'
            )
        at = jnp.zeros((*grid.shape, 0)), jnp.asarray(grid.origin), jnp.asarray(grid.spacing)
        return cls(*at).taking(jnp.asarray(values))

    def taking(self, values: Float[Array, "*controls _"]) -> "CubicSpline":
        """The spline on the same grid that takes other values at its nodes."""
        coefficients = values
        for axis, n in enumerate(values.shape[:-1]):
            interpolating = jnp.asarray(np.linalg.inv(_values_at_nodes(n)))
            turned = jnp.tensordot(interpolating, coefficients, axes=(1, axis))
            coefficients = jnp.moveaxis(turned, 0, axis)
        return CubicSpline(coefficients, self.origin, self.spacing)

    # Compiled in one piece: its steps one by one take longer to compile.
    @eqx.filter_jit
    def __call__(self, points: Float[Array | np.ndarray, "samples d"]) -> Float[Array, "samples _"]:
        """Values at coordinates `points` [mm]; outside the grid the value at its border."""
        *shape, channels = self.coefficients.shape
        first, basis = self._taps(jnp.asarray(points))
        corner = jnp.concat([first, jnp.zeros((len(first), 1), dtype=int)], axis=1)
        window = (*[4] * len(shape), channels)
        # Slices and sums: half the time of an index for every value and of products of matrices.
        value = jax.vmap(lambda c: jax.lax.dynamic_slice(self.coefficients, c, window))(corner)
        for axis in reversed(range(len(shape))):
            taps = basis[:, axis].reshape(len(first), *[1] * axis, 4, 1)
            value = jnp.sum(value * taps, axis=-2)
        return value

    def first_channel(self, points: Float[Array, "samples d"]) -> Float[Array, " samples"]:
        """The first channel as a call gives it, fast at a great many points; not to differentiate.

        The 4^d terms are written out, of which XLA makes one loop over the points that needs no
        memory besides the result: at 274,625 points five times as fast as windows of 64
        coefficients per point. The derivative of so many terms takes long to compile.
        """
        shape = self.coefficients.shape[:-1]
        coefficients = self.coefficients[..., 0].reshape(-1)
        first, basis = self._taps(points)
        first = first.astype(jnp.int32)

        def along(axis: int, flat: Int[Array, " samples"]) -> Float[Array, " samples"]:
            """Sum over the splines of the axes from this one on; `flat` numbers those before it."""
            if axis == len(shape):
                return coefficients.at[flat].get(mode="promise_in_bounds")
            terms = (
                basis[:, axis, tap] * along(axis + 1, flat * shape[axis] + first[:, axis] + tap)
                for tap in range(4)
            )
            return sum(terms, start=jnp.zeros(len(points)))

        return along(0, jnp.zeros(len(points), dtype=jnp.int32))

    def _taps(
        self, points: Float[Array, "samples d"]
    ) -> tuple[Int[Array, "samples d"], Float[Array, "samples d 4"]]:
        """Number of the first of the four basis functions that act along each axis; their values."""
        last = jnp.asarray(self.coefficients.shape[:-1], dtype=jnp.float64)[None] - 2.0
        t = jnp.clip((points - self.origin[None]) / self.spacing[None], 1.0, last)
        knot = jnp.minimum(jnp.floor(jax.lax.stop_gradient(t)), last - 1.0)
        return knot.astype(int) - 1, cubic_basis(t - knot)


def _values_at_nodes(n: int) -> Float[np.ndarray, "controls controls"]:
    """Values of the splines of one axis at its nodes; mirrored beyond the ends."""
    B = (4 * np.eye(n) + np.eye(n, k=1) + np.eye(n, k=-1)) / 6
    B[0, 1] = B[-1, -2] = 2 / 6
    return B


def cubic_basis(u: Float[Array, "samples d"]) -> Float[Array, "samples d 4"]:
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
