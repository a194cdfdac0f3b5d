"""Every quantity that sizing works on, by everything that it may change: Taylor remainders of order two.

One skinned frame without symmetry, tapered struts with rigid ends, loads along them, and a coupled load;
one gradient by joints, radii and thickness together.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from small_frames import space_frame

from fea import (
    Distributing,
    Inertia,
    buckling_factor,
    displacement,
    euler_utilisation,
    frequency,
    p_norm,
    strut_utilisation,
)

FRAME = space_frame(cells=1, skin=True, coupling=Distributing)
PARAMETERS = ("joints", "radii", "thickness")
DIRECTION = {
    name: np.random.default_rng(2).normal(size=FRAME.parameters[name].shape)
    * 0.05
    * FRAME.parameters[name].std()
    for name in PARAMETERS
}
WEIGHTS = jnp.asarray(np.random.default_rng(5).normal(size=FRAME.forces.shape))
DENSITY = 1e-9


def compliance(**values: Array) -> Array:
    """Of the joint forces, in both cases."""
    return jnp.sum(jnp.asarray(FRAME.forces) * displacement(FRAME, **values))


def weighted_displacement(**values: Array) -> Array:
    return jnp.sum(WEIGHTS * displacement(FRAME, **values))


def yielding(**values: Array) -> Array:
    u = displacement(FRAME, **values)
    each = strut_utilisation(FRAME, u, yield_stress=50.0, **values)
    return p_norm(each, jnp.ones_like(each), p=8.0)


def euler(**values: Array) -> Array:
    u = displacement(FRAME, **values)
    each = euler_utilisation(FRAME, u, **values)
    return p_norm(each, jnp.ones_like(each), p=8.0)


def buckling(**values: Array) -> Array:
    return buckling_factor(FRAME, **values)


def vibrating(**values: Array) -> Array:
    return frequency(FRAME, Inertia(DENSITY, skin_density=2 * DENSITY), **values)


@pytest.mark.parametrize(
    "quantity", [compliance, weighted_displacement, yielding, euler, buckling, vibrating]
)
def test_the_gradient_has_a_second_order_taylor_remainder(quantity: Callable[..., Array]):
    at = {name: jnp.asarray(FRAME.parameters[name]) for name in PARAMETERS}
    gradient = jax.grad(lambda values: quantity(**values))(at)
    start = float(quantity(**at))
    for name in PARAMETERS:
        slope = float(np.vdot(gradient[name], DIRECTION[name]))
        assert abs(slope) > 1e-7 * abs(start)

        def remainder(h: float, name: str = name, slope: float = slope) -> float:
            moved = at | {name: at[name] + h * DIRECTION[name]}
            return abs(float(quantity(**moved)) - start - h * slope)

        order = np.log2(remainder(4e-2) / remainder(2e-2))
        np.testing.assert_allclose(order, 2, atol=0.1, err_msg=name)


def test_a_gradient_that_is_half_a_percent_off_fails():
    """Negative control."""
    at = jnp.asarray(FRAME.radii)
    slope = 1.005 * float(np.vdot(jax.grad(lambda r: compliance(radii=r))(at), DIRECTION["radii"]))
    start = float(compliance(radii=at))
    rest = [
        abs(float(compliance(radii=at + h * DIRECTION["radii"])) - start - h * slope)
        for h in (4e-2, 2e-2)
    ]
    assert np.log2(rest[0] / rest[1]) < 1.7
