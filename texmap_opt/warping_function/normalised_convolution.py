"""From values at scattered points to a smooth field on a regular grid, defined everywhere."""

from itertools import product

import numpy as np
from jaxtyping import Complex, Float
from numpy.fft import irfftn, rfftn

from texmap_opt.warping_function.background_grid import BackgroundGrid

# Weight of the slowly falling part of the kernel. Among samples it shifts the average by less than
# 0.1 %; far from all samples, where the Gaussian has vanished, it alone decides.
TAIL = 1e-3


def normalised_convolution(
    grid: BackgroundGrid,
    points: Float[np.ndarray, "samples 3"],
    weights: Float[np.ndarray, " samples"],
    values: Float[np.ndarray, "samples _"],
    *,
    smoothing_mm: float,
) -> Float[np.ndarray, "*controls _"]:
    """Weighted average of the samples around every node of `grid`.

    u(x) = sum_i k(x - x_i) w_i u_i / sum_i k(x - x_i) w_i, with the kernel
    k(r) = exp(-r²/2σ²) + TAIL / (1 + r²/σ²)²: a Gaussian where there are samples, a power of the
    distance (Shepard's weights) where there are none. So the average smooths inside the part,
    extends smoothly outside it, and never leaves the range of the samples.

    Sources: Knutsson and Westin, "Normalized and differential convolution", CVPR 1993;
    Shepard, "A two-dimensional interpolation function for irregularly-spaced data", ACM 1968.

    Args:
        grid: where the field is wanted.
        points: positions of the samples [mm]; one outside the grid counts at its border.
        weights: volume each sample stands for [mm³].
        values: samples of any number of fields.
        smoothing_mm: σ, the standard deviation of the Gaussian [mm].
    """
    known = np.concatenate([weights[:, None], weights[:, None] * values], axis=1)
    sums = deposit(grid, points, known)
    kernel = rfftn(_kernel(grid, smoothing_mm))
    smooth = [_convolved(sums[..., channel], kernel) for channel in range(sums.shape[-1])]
    average = np.stack(smooth[1:], axis=-1) / smooth[0][..., None]
    # The quotient leaves the range of the samples by rounding only.
    return np.clip(average, values.min(axis=0), values.max(axis=0))


def deposit(
    grid: BackgroundGrid,
    points: Float[np.ndarray, "samples 3"],
    amounts: Float[np.ndarray, "samples _"],
) -> Float[np.ndarray, "*controls _"]:
    """Each sample's amount, shared by the eight nodes around it with trilinear weights."""
    last = np.array(grid.shape) - 1.0
    t = np.clip((points - grid.origin) / grid.spacing, 0, last)
    first = np.minimum(t.astype(int), np.array(grid.shape) - 2)
    share = np.stack([1 - (t - first), t - first])  # lower and upper node, per axis
    sums = np.zeros((int(np.prod(grid.shape)), amounts.shape[1]))
    for corner in product((0, 1), repeat=3):
        node = np.ravel_multi_index(tuple((first + np.array(corner)).T), grid.shape)
        part = share[corner[0], :, 0] * share[corner[1], :, 1] * share[corner[2], :, 2]
        for channel in range(amounts.shape[1]):
            sums[:, channel] += np.bincount(
                node, weights=part * amounts[:, channel], minlength=len(sums)
            )
    return sums.reshape(*grid.shape, -1)


def _convolved(
    field: Float[np.ndarray, "*controls"], kernel: Complex[np.ndarray, "*samples"]
) -> Float[np.ndarray, "*controls"]:
    """Convolution with a kernel given by its transform at twice the size, so it does not wrap."""
    size, axes = [2 * n for n in field.shape], (0, 1, 2)
    twice = irfftn(rfftn(field, size, axes) * kernel, size, axes)
    return twice[: field.shape[0], : field.shape[1], : field.shape[2]]


def _kernel(grid: BackgroundGrid, smoothing_mm: float) -> Float[np.ndarray, "*samples"]:
    """The kernel at all differences of nodes, in the order of the discrete Fourier transform."""
    size = [2 * n for n in grid.shape]
    squared = np.zeros(size)
    for axis, n in enumerate(size):
        steps = np.arange(n)
        distance = np.minimum(steps, n - steps) * grid.spacing[axis] / smoothing_mm
        squared += (distance**2).reshape([-1 if d == axis else 1 for d in range(3)])
    return np.exp(-squared / 2) + TAIL / (1 + squared) ** 2
