"""Set-up common to all tests: JAX in float64 with strict promotion, a cache of their own."""

import gc
import os
import tempfile
from pathlib import Path

import equinox as eqx
import hypothesis
import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

# Equal examples in every run of CI; elsewhere hypothesis may look for new ones.
hypothesis.settings.register_profile("ci", derandomize=True, deadline=None)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))


# Linux lets a process have 65,530 pieces of memory, and compiled code has some for every function:
# at the limit the compiler ends the process. Thousands of tests compile thousands of functions.
MOST_PIECES = 20_000
PIECES = Path("/proc/self/maps")


@pytest.fixture(autouse=True, scope="module")
def room_for_compiled_code():
    """What was compiled for earlier files is let go when there is much of it."""
    if PIECES.exists() and PIECES.read_bytes().count(b"\n") > MOST_PIECES:
        eqx.clear_caches()
        jax.clear_caches()
        gc.collect()


@pytest.fixture(autouse=True, scope="session")
def own_cache():
    """Nothing that a test keeps reaches the cache of the user who runs it, or comes from there."""
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("TEXMAP_CACHE_DIR", folder)
        yield
