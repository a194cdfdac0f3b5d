"""Runs of elements of one size: arrays stay in the processor's cache, and JAX compiles once."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Int


def batches(elements: int, most: int) -> Iterator[tuple[slice, Int[np.ndarray, " some"]]]:
    """Runs of elements, and as many element numbers each time.

    Args:
        elements: how many there are.
        most: largest run; a power of two.

    Yields:
        The run, and its numbers; those of the last run are filled up from the front.
    """
    # A power of two, so that small models share compiled code as well.
    size = min(most, 1 << max(elements - 1, 0).bit_length())
    for first in range(0, elements, size):
        yield slice(first, min(first + size, elements)), np.arange(first, first + size) % elements
