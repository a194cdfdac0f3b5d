"""Loads as people give them, made float64 numbers: NumPy, or JAX where anything given is."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Num

from fea.errors import FeaError
from fea.precision import as_float64, refuse_single_precision, require_x64

# Lists and integers are made float64; single precision is refused.
Values = Num[np.ndarray | Array, "..."] | np.number | Sequence[Any] | float | int
# A field over space: from positions, one a row, to a value for each.
Field = Callable[[Any], Any]


def namespace(*given: object) -> Any:
    """`jax.numpy` where anything given, or in a list given, is a JAX array; `numpy` elsewhere.

    Raises:
        FeaError: when it is JAX and JAX computes in float32.
    """
    if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(given)):
        require_x64()
        return jnp
    return np


def numbers(values: Any, what: str) -> Any:
    """Numbers in float64, finite unless JAX traces them.

    Args:
        values: a number, a list, an array of NumPy or of JAX.
        what: the noun of the message.

    Raises:
        FeaError: for single precision, for what is not real numbers, or is not finite.
    """
    if namespace(values) is np:
        result = as_float64(values, f"Numbers of the {what}")
    else:
        result = jnp.asarray(values)
        refuse_single_precision(result, f"Numbers of the {what}")
        if result.dtype.kind not in "iuf":
            raise FeaError(f"Numbers of the {what} are {result.dtype}; give float64.")
        result = result.astype(jnp.float64)
    # Traced arrays have no values yet: the forces made of them are checked before a solve.
    if not isinstance(result, Tracer):
        finite = np.isfinite(result)
        if not finite.all():
            first = tuple(int(i) for i in np.argwhere(~finite)[0])
            where = f" at {list(first)}" if first else ""
            raise FeaError(
                f"The {what} is not a number, {float(result[first])}{where}; give finite numbers."
            )
    return result


def constant(load: Any, shape: tuple[int, ...], what: str) -> Any:
    """A load of a given shape.

    Raises:
        FeaError: for another shape, and for what `numbers` refuses.
    """
    values = numbers(load, what)
    if values.shape != shape:
        raise FeaError(f"The {what} has shape {values.shape}; give one of shape {shape}.")
    return values


def field(
    load: Any, x: Float[np.ndarray | Array, "elements quad 3"], shape: tuple[int, ...], what: str
) -> Any:
    """Values of a load at quadrature points, [elements, quad, *shape]; one for a uniform load.

    Args:
        load: a constant of the given shape, or a function from positions [n, 3] to [n, *shape].
        x: positions of the quadrature points [mm].
        shape: () for numbers, (3,) for vectors.
        what: the noun of the message.

    Raises:
        FeaError: for another shape, and for what `numbers` refuses.
    """
    if not callable(load):
        return constant(load, shape, what)[None, None]
    values = numbers(load(x.reshape(-1, 3)), what)
    expected = (x.shape[0] * x.shape[1], *shape)
    if values.shape != expected:
        raise FeaError(
            f"The {what} as a function of position returns shape {values.shape} for positions "
            f"of shape {(expected[0], 3)}; return shape {expected}."
        )
    return values.reshape(*x.shape[:2], *shape)
