"""From values at scattered points to a smooth field on a regular grid, defined everywhere."""

import math
from itertools import product

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int
from scipy.ndimage import gaussian_filter

from texmap_opt.warping_function.background_grid import BackgroundGrid

# Weight of the slowly falling part of the kernel. Among samples it shifts the average by less than
# 0.1 %; far from all samples, where the Gaussian has vanished, it alone decides.
TAIL = 1e-3


def normalised_convolution(
    grid: BackgroundGrid,
    points: Float[np.ndarray, "samples d"],
    weights: Float[np.ndarray, " samples"],
    values: Float[Array | np.ndarray, "samples _"],
    *,
    smoothing_mm: float,
) -> Float[Array, "*controls _"]:
    """Weighted average of the samples around every node of `grid`; linear in the values.

    u(x) = sum_i k(x - x_i) w_i u_i / sum_i k(x - x_i) w_i, with the kernel
    k(r) = exp(-r²/2σ²) + TAIL / (1 + r²/σ²)²: a Gaussian where there are samples, a power of the
    distance (Shepard's weights) where there are none. So the average smooths inside the part,
    extends smoothly outside it, and leaves the range of the samples by rounding only.

    Sources: Knutsson and Westin, "Normalized and differential convolution", CVPR 1993;
    Shepard, "A two-dimensional interpolation function for irregularly-spaced data", ACM 1968.

    Args:
        grid: where the field is wanted.
        points: coordinates of the samples in the grid's box [mm]; one outside the grid counts at
            its border.
        weights: volume each sample stands for [mm³].
        values: samples of any number of fields.
        smoothing_mm: σ, the standard deviation of the Gaussian [mm].
    """
    node, part = _nodes_around(grid, points)
    return _average(
        (jnp.asarray(node), jnp.asarray(part)),
        jnp.asarray(weights),
        jnp.asarray(values),
        jnp.asarray(_kernel(grid, smoothing_mm)),
    )


def deposit(
    grid: BackgroundGrid,
    points: Float[np.ndarray, "samples d"],
    amounts: Float[np.ndarray, " samples"],
) -> Float[np.ndarray, "*controls"]:
    """Each sample's amount, shared by the 2^d nodes around it with weights linear along each axis."""
    node, part = _nodes_around(grid, points)
    total = np.bincount(node.ravel(), (part * amounts).ravel(), minlength=math.prod(grid.shape))
    return total.reshape(grid.shape)


def presence(
    grid: BackgroundGrid,
    points: Float[np.ndarray, "samples d"],
    weights: Float[np.ndarray, " samples"],
    *,
    smoothing_mm: float,
) -> Float[np.ndarray, "*controls"]:
    """1 where samples are, falling to 0 within a smoothing length or two of the last of them.

    Twice the samples' smoothed density over its mean among them, at most 1: at the flat surface of a
    part, where half the neighbourhood is empty, it is still 1.
    """
    amount = deposit(grid, points, weights)
    smooth = gaussian_filter(amount, smoothing_mm / grid.spacing, mode="constant")
    typical = np.sum(smooth * amount) / np.sum(amount)
    return np.minimum(1.0, 2.0 * smooth / typical)


@eqx.filter_jit
def _average(
    around: tuple[Int[Array, "corners samples"], Float[Array, "corners samples"]],
    weights: Float[Array, " samples"],
    values: Float[Array, "samples _"],
    kernel: Float[Array, "*_"],
) -> Float[Array, "..."]:
    """The average at the nodes: one compiled piece, where step by step it takes seconds to compile."""
    shape = tuple(n // 2 for n in kernel.shape)
    # Far from all samples the sums are small differences of large ones by the transform's rounding;
    # about their mean the values are small themselves, and a constant stays one to the last digits.
    mean = weights @ values / jnp.sum(weights)
    known = weights[:, None] * jnp.concatenate([jnp.ones((len(values), 1)), values - mean[None]], 1)

    def share(sums, corner):
        node, part = corner
        return sums.at[node].add(part[:, None] * known), None

    start = jnp.zeros((math.prod(shape), known.shape[1]))
    sums = jax.lax.scan(share, start, around)[0].reshape(*shape, -1)
    transform = jnp.fft.rfftn(kernel)
    smooth = jax.lax.map(lambda field: _convolved(field, transform), jnp.moveaxis(sums, -1, 0))
    offset = jnp.moveaxis(smooth[1:] / smooth[0][None], 0, -1)
    return offset + mean.reshape([1] * len(shape) + [-1])


def _nodes_around(
    grid: BackgroundGrid, points: Float[np.ndarray, "samples d"]
) -> tuple[Int[np.ndarray, "corners samples"], Float[np.ndarray, "corners samples"]]:
    """Flat numbers of the 2^d nodes around each point, and the point's share in each."""
    last = np.array(grid.shape) - 1.0
    t = np.clip((points - grid.origin) / grid.spacing, 0, last)
    first = np.minimum(t.astype(int), np.array(grid.shape) - 2)
    share = np.stack([1 - (t - first), t - first])  # lower and upper node, per axis
    corners = list(product((0, 1), repeat=len(grid.shape)))
    node = [np.ravel_multi_index(tuple((first + np.array(c)).T), grid.shape) for c in corners]
    part = [
        np.prod([share[side, :, axis] for axis, side in enumerate(corner)], axis=0)
        for corner in corners
    ]
    return np.stack(node), np.stack(part)


def _convolved(
    field: Float[Array, "*controls"], kernel: Complex[Array, "*samples"]
) -> Float[Array, "*controls"]:
    """Convolution with a kernel given by its transform at twice the size, so it does not wrap."""
    size, axes = [2 * n for n in field.shape], tuple(range(field.ndim))
    twice = jnp.fft.irfftn(jnp.fft.rfftn(field, size, axes) * kernel, size, axes)
    return twice[tuple(slice(n) for n in field.shape)]


def _kernel(grid: BackgroundGrid, smoothing_mm: float) -> Float[np.ndarray, "*samples"]:
    """The kernel at all differences of nodes, in the order of the discrete Fourier transform."""
    d = len(grid.shape)
    squared = np.zeros([2 * n for n in grid.shape])
    for axis, n in enumerate(squared.shape):
        steps = np.arange(n)
        distance = np.minimum(steps, n - steps) * grid.spacing[axis] / smoothing_mm
        squared += (distance**2).reshape([-1 if k == axis else 1 for k in range(d)])
    return np.exp(-squared / 2) + TAIL / (1 + squared) ** 2
