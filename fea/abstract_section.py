"""What a beam element needs to know of the cross-section of its strut.

A section bends equally in all directions (one second moment of area), so a strut needs no
orientation about its own axis; a wall, which does not, has that moment in its plane and is refused
where it could leave it. Sizes are given by one number, the radius: for a square, half the side; for
a tube, the outer radius; for a wall, half the thickness.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.errors import FeaError
from fea.taper import AbstractTaper, Flexibility

# Either kind of array: element code is traced by JAX, set-up and results are NumPy.
Radius = Float[Array, "*shape"] | Float[np.ndarray, "*shape"]


class MeanSection(NamedTuple):
    """The prismatic section that a strut of linear taper amounts to.

    Attributes:
        area: A in extension and shear [mm²].
        second_moment: I in bending, by `flexibility` [mm⁴].
        torsion_constant: J in torsion [mm⁴].
        flexibility: in bending, without dimension.
    """

    area: Float[Array, ""]
    second_moment: Float[Array, ""]
    torsion_constant: Float[Array, ""]
    flexibility: Flexibility


class AbstractSection(eqx.Module):
    """Properties of a strut's section as functions of its radius [mm].

    A section tapers by its `size`, which is linear along a tapered strut: A = A_1 area(size) and I, J
    = I_1, J_1 moment(size) of its `taper`, with A_1, I_1, J_1 the constants of the section of size
    1 mm.

    Attributes:
        taper: how the section changes with its size.
        shear_factor: Timoshenko's kappa; the effective shear area is kappa A. None takes Cowper's
            value for the material's Poisson's ratio; infinity is the Euler-Bernoulli beam.

    Raises:
        FeaError: when the shear factor is not positive.
    """

    taper: eqx.AbstractClassVar[AbstractTaper]
    shear_factor: eqx.AbstractVar[float | None]

    def __check_init__(self):
        if self.shear_factor is not None and not self.shear_factor > 0:
            raise FeaError(
                f"shear_factor = {self.shear_factor:g}: must be positive; infinity neglects shear."
            )

    @abc.abstractmethod
    def size(self, radius: Radius) -> Radius:
        """What scales the section [mm]: the radius, or 1 for a section that does not change."""

    @property
    @abc.abstractmethod
    def unit_area(self) -> float:
        """Area A_1 at size 1 mm [mm²]."""

    @property
    @abc.abstractmethod
    def unit_second_moment(self) -> float:
        """Second moment of area I_1 at size 1 mm, about any axis through the centroid [mm⁴]."""

    @property
    @abc.abstractmethod
    def unit_torsion_constant(self) -> float:
        """St Venant's torsion constant J_1 at size 1 mm [mm⁴]."""

    @abc.abstractmethod
    def cowper(self, nu: float) -> float:
        """Shear factor of Cowper, J. Appl. Mech. 33 (1966) 335, for Poisson's ratio nu."""

    @abc.abstractmethod
    def bending_modulus(self, radius: Radius) -> Radius:
        """Moment over the largest bending stress it makes, worst direction [mm³]."""

    @abc.abstractmethod
    def torsion_modulus(self, radius: Radius) -> Radius:
        """Torque over the largest shear stress it makes [mm³]."""

    @abc.abstractmethod
    def shear_modulus_area(self, radius: Radius) -> Radius:
        """Transverse force over the largest shear stress it makes [mm²]."""

    def area(self, radius: Radius) -> Radius:
        """Area A [mm²]."""
        return self.unit_area * self.taper.area(self.size(radius))

    def second_moment(self, radius: Radius) -> Radius:
        """Second moment of area I [mm⁴]."""
        return self.unit_second_moment * self.taper.moment(self.size(radius))

    def torsion_constant(self, radius: Radius) -> Radius:
        """Torsion constant J [mm⁴]."""
        return self.unit_torsion_constant * self.taper.moment(self.size(radius))

    def mean(self, radii: Float[Array, "2"]) -> MeanSection:
        """What a strut of linear taper amounts to.

        Args:
            radii: at its two ends [mm].
        """
        f = self.taper.flexibility(jnp.asarray(self.size(radii)))
        return MeanSection(
            area=self.unit_area * f.area,
            second_moment=self.unit_second_moment * f.moment,
            torsion_constant=self.unit_torsion_constant * f.moment / f.whole,
            flexibility=f,
        )

    def moment_of_column(self, first: Radius, second: Radius) -> Radius:
        """Second moment of area [mm⁴] that a column of radii `first` to `second` buckles with."""
        return self.unit_second_moment * self.taper.column(self.size(first), self.size(second))

    def kappa(self, nu: float) -> float:
        """Shear factor in use: the given one, else Cowper's."""
        return self.cowper(nu) if self.shear_factor is None else self.shear_factor
