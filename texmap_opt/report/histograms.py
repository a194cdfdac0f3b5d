"""Histograms of a warp, for its plots and for report.json alike."""

import numpy as np
from jaxtyping import Float, Int

# Achieved over wanted size up to which its histogram reaches, and so down to the inverse; the outer
# bins count what lies beyond. An odd number of bins: one has 1 in its middle.
LARGEST_RATIO = 2.0
RATIO_BINS = 41

# Degrees per bin of angles.
ANGLE_BIN = 3


def ratio_counts(
    ratio: Float[np.ndarray, " cells"],
) -> tuple[Int[np.ndarray, " bins"], Float[np.ndarray, " edges"]]:
    """Cells in equal steps of the logarithm of achieved over wanted size, and the steps' ends."""
    edges = np.geomspace(1 / LARGEST_RATIO, LARGEST_RATIO, RATIO_BINS + 1)
    finite = ratio[np.isfinite(ratio)]
    # A hair inside: rounding must not put the outermost beyond the last bin.
    count, _ = np.histogram(np.clip(finite, edges[0] * (1 + 1e-12), edges[-1]), edges)
    return count, edges


def angle_shares(
    angles_deg: Float[np.ndarray, " samples"],
    weights: Float[np.ndarray, " samples"],
    *,
    largest: int,
) -> tuple[Float[np.ndarray, " bins"], Float[np.ndarray, " edges"]]:
    """Share of the weight in bins of angles from 0 to `largest` degrees, and the bins' ends."""
    edges = np.linspace(0.0, largest, largest // ANGLE_BIN + 1)
    share, _ = np.histogram(np.clip(angles_deg, 0.0, largest), edges, weights=weights)
    return share / weights.sum(), edges
