"""Whether a value is there to look at, or stands for one in a transformation of JAX."""

from jax.core import Tracer


def is_concrete(value: object) -> bool:
    """Whether a number or array has its value now, and is not traced by a transformation of JAX."""
    return not isinstance(value, Tracer)
