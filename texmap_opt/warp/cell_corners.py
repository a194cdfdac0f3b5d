"""The corners of all cells of a grid as views of one array of nodes, of NumPy or of JAX."""

import itertools
from typing import TypeVar

import numpy as np
from jaxtyping import Array

Kind = TypeVar("Kind", np.ndarray, Array)


def side(values: Kind, axis: int, end: int) -> Kind:
    """All but the last along an axis for the end 0, all but the first for the end 1."""
    n = values.shape[axis]
    return values[(*[slice(None)] * axis, slice(end, n - 1 + end))]


def corners(values: Kind, dimensions: int) -> dict[tuple[int, ...], Kind]:
    """Values at each corner of every cell, by the ends of the grid's axes at which it lies.

    Args:
        values: at the nodes; the grid's axes come first.
        dimensions: how many these are.
    """
    found = {}
    for ends in itertools.product((0, 1), repeat=dimensions):
        at = values
        for axis, end in enumerate(ends):
            at = side(at, axis, end)
        found[ends] = at
    return found
