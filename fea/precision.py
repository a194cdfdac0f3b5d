"""Mechanics is computed in float64; this is where that is checked."""

import jax

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
