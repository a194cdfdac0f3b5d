"""How stiffness grows with density: the power law fitted to it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class PowerLaw:
    """E = factor density^exponent, moduli over that of the solid.

    Attributes:
        factor: C.
        exponent: n; near 1 where struts stretch, 2 where bars and 3 where walls bend (Gibson, Ashby,
            Cellular Solids, 2nd edition, chapters 4 and 5).
        residual: largest relative error over the points it was fitted to.
    """

    factor: float
    exponent: float
    residual: float


def power_law(
    density: Float[np.ndarray, " samples"], modulus: Float[np.ndarray, " samples"]
) -> PowerLaw:
    """Least squares of the logarithms.

    Args:
        density: relative densities, at least two.
        modulus: moduli over that of the solid.
    """
    exponent, level = np.polyfit(np.log(density), np.log(modulus), 1)
    fitted = np.exp(level) * density**exponent
    return PowerLaw(
        float(np.exp(level)), float(exponent), float(np.abs(fitted / modulus - 1).max())
    )
