"""Set-up common to all tests: JAX in float64 with strict promotion, a cache of their own."""

import os
import tempfile

import hypothesis
import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

# Equal examples in every run of CI; elsewhere hypothesis may look for new ones.
hypothesis.settings.register_profile("ci", derandomize=True, deadline=None)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))


@pytest.fixture(autouse=True, scope="session")
def own_cache():
    """Nothing that a test keeps reaches the cache of the user who runs it, or comes from there."""
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("TEXMAP_CACHE_DIR", folder)
        yield
