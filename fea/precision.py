"""Mechanics is computed in float64; this is where that is checked."""

from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from fea.errors import FeaError


def require_x64() -> None:
    """Raise unless JAX computes in float64; this package flips no switch of the process itself.

    Raises:
        FeaError: when `jax_enable_x64` is off.
    """
    if not jax.config.read("jax_enable_x64"):
        raise FeaError(
            "JAX computes in float32 here, which is too coarse for stiffness matrices; call "
            'jax.config.update("jax_enable_x64", True) at the start of the program.'
        )


def as_float64(values: Any, what: str) -> Float[np.ndarray, "..."]:
    """Numbers as people give them, lists and integers too, as a float64 array.

    Args:
        values: a number, a list, or an array.
        what: it in words, plural: the beginning of the message.

    Raises:
        FeaError: for single precision, and for what is not numbers or not rectangular.
    """
    try:
        array = np.asarray(values)
    except ValueError as failure:
        raise FeaError(
            f"{what} are not a rectangular array; give rows of equal length."
        ) from failure
    refuse_single_precision(array, what)
    if array.dtype.kind not in "iuf":
        raise FeaError(f"{what} are {array.dtype}, which is no real number; give float64.")
    return array.astype(np.float64, copy=False)


def refuse_single_precision(values: np.ndarray | jax.Array, what: str) -> None:
    """Raise when an array holds floats of fewer than 64 bits.

    Args:
        values: any array.
        what: it in words, plural: the beginning of the message.

    Raises:
        FeaError: for float32 and float16.
    """
    if values.dtype.kind == "f" and values.dtype.itemsize < 8:
        raise FeaError(
            f"{what} are {values.dtype}, single precision, which is too coarse for stiffness "
            "matrices; give float64, from the start where you can (converted afterwards they keep "
            "7 digits)."
        )
