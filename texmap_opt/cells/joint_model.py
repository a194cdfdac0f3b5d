"""What the joints of a printed lattice add to its frame model: two numbers for each topology.

A frame of beams that run from joint to joint takes no account of the material that struts share: it is
short of stiffness where a joint is a solid lump, the more so the thicker the struts. The model makes
each end of a strut rigid over a length in proportion to its radius, and multiplies the modulus of
the rest by a factor in proportion to the radius ratio r/L,

    rigid end = a r,      modulus factor = 1 + b r/L,

so that thin struts are beams again, whatever a and b are. Both are fitted to the project's own
solids (docs/theory/joints.md); what is left, by relative density, stands in docs/joint-model.md.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from texmap_opt.errors import LatticeError

ArrayLike = Array | np.ndarray

# Relative: a radius at the limit is not refused for its rounding.
RADIUS_RATIO_RTOL = 1e-6


@dataclass(frozen=True)
class JointModel:
    """Rigid ends and modulus of the struts of one topology.

    Attributes:
        rigid_end: length of a rigid end over the strut's radius there.
        modulus: what a radius ratio r/L of one would add to the relative modulus.
        radius_ratio: largest r/L that it was fitted to; below, it tends to the plain frame.
        error: largest relative error, within that range, of Young's modulus in any direction and of
            the shear modulus C44 of the cubic cell it was fitted to.
    """

    rigid_end: float
    modulus: float
    radius_ratio: float
    error: float

    def rigid_ends(self, radii: Float[ArrayLike, "struts 2"]) -> Float[Array, "struts 2"]:
        """Rigid length at both ends of each strut [mm]; JAX differentiates it."""
        return self.rigid_end * jnp.asarray(radii)

    def relative_modulus(
        self, radii: Float[ArrayLike, "struts 2"], lengths: Float[ArrayLike, " struts"]
    ) -> Float[Array, " struts"]:
        """Factor on the modulus of each strut; JAX differentiates it.

        Args:
            radii: at both ends [mm].
            lengths: between joints [mm].
        """
        return 1 + self.modulus * radius_ratio(radii, lengths)

    def check(
        self, radii: Float[ArrayLike, "struts 2"], lengths: Float[ArrayLike, " struts"]
    ) -> None:
        """Refuse struts thicker than the model was fitted to.

        Raises:
            LatticeError: with the strut, its radius ratio, the limit and the remedy.
        """
        values = np.asarray(radius_ratio(radii, lengths))
        over = values > self.radius_ratio * (1 + RADIUS_RATIO_RTOL)
        if over.any():
            strut = int(np.argmax(values))
            raise LatticeError(
                f"{int(over.sum())} of {len(values)} struts are thicker than the joint model was "
                f"fitted to: strut {strut} has radius/length = {values[strut]:.3g}, limit "
                f"{self.radius_ratio:.3g}; take thinner struts or larger cells."
            )


def radius_ratio(
    radii: Float[ArrayLike, "struts 2"], lengths: Float[ArrayLike, " struts"]
) -> Float[Array, " struts"]:
    """Mean radius over length of each strut."""
    return jnp.mean(jnp.asarray(radii), axis=1) / jnp.asarray(lengths)
