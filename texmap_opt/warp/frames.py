"""The frame of a cell: the rotation nearest to its mean edges."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

# Steps of Newton's iteration for the polar factor: from edges in a ratio of 20 and 60 degrees of
# shear they end below 1e-12.
POLAR_STEPS = 8


def rotations(edges: Float[Array, "samples d d"]) -> Float[Array, "samples d d"]:
    """Polar factor of each cell: of all rotations the nearest to its mean edges.

    X <- (g X + (g X)^-T) / 2, with g = |X^-1|^1/2 / |X|^1/2 on the way to make the first steps
    short: Higham, "Computing the polar decomposition - with applications", SIAM J. Sci. Stat.
    Comput. 7 (1986) 1160, with his Frobenius-norm scaling.

    Args:
        edges: mean edges of each cell as rows, over those of the uniform grid, right-handed.

    Returns:
        unit vectors of each cell's frame as rows.
    """

    def step(X: Float[Array, "samples d d"], _: None) -> tuple[Float[Array, "samples d d"], None]:
        inverse_transpose = jnp.swapaxes(_inverse(X), -1, -2)
        over, under = (jnp.sum(Y**2, axis=(-2, -1), keepdims=True) for Y in (inverse_transpose, X))
        g = (over / under) ** 0.25
        return (g * X + inverse_transpose / g) / 2, None

    # A loop, since the second derivative of the steps written out takes minutes to compile.
    return jax.lax.scan(step, edges, length=POLAR_STEPS)[0]


def _inverse(X: Float[Array, "samples d d"]) -> Float[Array, "samples d d"]:
    """By cofactors: as exact as these small matrices need, and fast in large numbers."""
    if X.shape[-1] == 2:
        a, b, c, d = X[..., 0, 0], X[..., 0, 1], X[..., 1, 0], X[..., 1, 1]
        adjugate = jnp.stack([jnp.stack([d, -b], -1), jnp.stack([-c, a], -1)], -2)
        return adjugate / (a * d - b * c)[..., None, None]
    columns = jnp.stack([jnp.cross(X[..., k - 2, :], X[..., k - 1, :]) for k in range(3)], -1)
    det = jnp.sum(X[..., 0, :] * columns[..., 0], axis=-1)
    return columns / det[..., None, None]
