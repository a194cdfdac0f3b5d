"""Pairs of triangles whose bounding boxes overlap, by descending a hierarchy of boxes.

All pairs of one level are handled at once, so the cost is a few array operations per level
however unequal the triangles are.
"""

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.errors import PartError

# Pairs held at once, 0.5 GB. A closed surface has about 12 a triangle; so many mean a tangle.
MAX_PAIRS = 20_000_000
# Bits per axis of the Morton code that sorts the boxes: 3 x 21 bits fill a 64-bit integer.
MORTON_BITS = 21


def box_pairs(
    low: Float[np.ndarray, "n 3"], high: Float[np.ndarray, "n 3"]
) -> Int[np.ndarray, "pairs 2"]:
    """Pairs (i < j) of boxes that overlap or touch.

    Args:
        low: lowest corners.
        high: highest corners.

    Raises:
        PartError: there are more than `MAX_PAIRS`.
    """
    order = np.argsort(_morton_code((low + high) / 2), kind="stable")
    depth = int(np.ceil(np.log2(max(len(order), 2))))
    lows = np.full((2**depth, 3), np.inf)
    highs = np.full((2**depth, 3), -np.inf)
    lows[: len(order)], highs[: len(order)] = low[order], high[order]
    levels = [(lows, highs)]
    for _ in range(depth):
        lows = np.minimum(lows[0::2], lows[1::2])
        highs = np.maximum(highs[0::2], highs[1::2])
        levels.append((lows, highs))
    pairs = np.zeros((1, 2), dtype=np.int64)
    for lows, highs in reversed(levels[:-1]):
        a, b = 2 * pairs[:, 0], 2 * pairs[:, 1]
        own = a == b
        children = [np.stack([a + i, b + j], axis=1) for i, j in ((0, 0), (0, 1), (1, 1))]
        children.append(np.stack([a + 1, b], axis=1)[~own])
        pairs = np.concatenate(children)
        i, j = pairs[:, 0], pairs[:, 1]
        meet = ((lows[i] <= highs[j]) & (lows[j] <= highs[i])).all(axis=1)
        pairs = pairs[meet]
        if len(pairs) > MAX_PAIRS:
            raise PartError(
                f"more than {MAX_PAIRS:,} pairs of its {len(low):,} triangles lie in each other's "
                "bounding boxes: this is a tangle or too fine a surface; simplify it."
            )
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    return np.sort(order[pairs], axis=1)


def _morton_code(points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
    """Position on a space-filling curve: near in code means near in space."""
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    scaled = (points - low) / np.where(size > 0, size, 1)
    grid = (scaled * (2**MORTON_BITS - 1)).astype(np.uint64)
    code = np.zeros(len(points), dtype=np.uint64)
    for bit in range(MORTON_BITS):
        for axis in range(3):
            on = (grid[:, axis] >> np.uint64(bit)) & np.uint64(1)
            code |= on << np.uint64(3 * bit + axis)
    return code.astype(np.int64)
