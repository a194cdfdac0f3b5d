"""Cross-sections of struts: what a beam element needs to know of them.

A section bends equally in all directions (one second moment of area), so a strut needs no
orientation about its own axis. Sizes are given by one number, the radius: for a square, half the
side.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fea.errors import FeaError

# Either kind of array: element code is traced by JAX, set-up and results are NumPy.
Radius = Float[Array, "*shape"] | Float[np.ndarray, "*shape"]

# Torsion of a square of side s: J = 0.1406 s^4 and peak shear stress T/(0.2082 s^3), at the
# middle of a side. Timoshenko, Goodier, Theory of Elasticity, 3rd ed., section 109, table, b/a = 1.
SQUARE_TORSION_CONSTANT = 0.140577
SQUARE_TORSION_MODULUS = 0.208165

# Peak over mean of the shear stress that a transverse force makes, at the neutral axis:
# V Q/(I b) of elementary beam theory.
ROUND_SHEAR_PEAK = 4 / 3
SQUARE_SHEAR_PEAK = 3 / 2


class AbstractSection(eqx.Module):
    """Properties of a strut's section as functions of its radius [mm].

    Attributes:
        shear_factor: Timoshenko's kappa; the effective shear area is kappa A. None takes Cowper's
            value for the material's Poisson's ratio; infinity is the Euler-Bernoulli beam.
    """

    shear_factor: eqx.AbstractVar[float | None]

    @abc.abstractmethod
    def area(self, radius: Radius) -> Radius:
        """Area A [mm²]."""

    @abc.abstractmethod
    def second_moment(self, radius: Radius) -> Radius:
        """Second moment of area I about any axis through the centroid [mm⁴]."""

    @abc.abstractmethod
    def torsion_constant(self, radius: Radius) -> Radius:
        """St Venant's torsion constant J [mm⁴]."""

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

    def kappa(self, nu: float) -> float:
        """Shear factor in use: the given one, else Cowper's."""
        return self.cowper(nu) if self.shear_factor is None else self.shear_factor


class Round(AbstractSection):
    """Solid circle of the given radius.

    Attributes:
        shear_factor: None for Cowper's 6 (1 + nu)/(7 + 6 nu); 0.9 is the other common choice.
    """

    shear_factor: float | None = None

    def area(self, radius: Radius) -> Radius:
        """Area π r² [mm²]."""
        return np.pi * radius**2

    def second_moment(self, radius: Radius) -> Radius:
        """Second moment π r⁴/4 [mm⁴]."""
        return np.pi / 4 * radius**4

    def torsion_constant(self, radius: Radius) -> Radius:
        """Torsion constant π r⁴/2 [mm⁴]."""
        return np.pi / 2 * radius**4

    def cowper(self, nu: float) -> float:
        """6 (1 + nu)/(7 + 6 nu)."""
        return 6 * (1 + nu) / (7 + 6 * nu)

    def bending_modulus(self, radius: Radius) -> Radius:
        """I/r = π r³/4 [mm³]."""
        return np.pi / 4 * radius**3

    def torsion_modulus(self, radius: Radius) -> Radius:
        """J/r = π r³/2 [mm³]."""
        return np.pi / 2 * radius**3

    def shear_modulus_area(self, radius: Radius) -> Radius:
        """3/4 of the area [mm²]."""
        return self.area(radius) / ROUND_SHEAR_PEAK


class Square(AbstractSection):
    """Solid square, the radius being half its side.

    Attributes:
        shear_factor: None for Cowper's 10 (1 + nu)/(12 + 11 nu).
    """

    shear_factor: float | None = None

    def area(self, radius: Radius) -> Radius:
        """Area (2 h)² [mm²]."""
        return 4 * radius**2

    def second_moment(self, radius: Radius) -> Radius:
        """Second moment (2 h)⁴/12 [mm⁴]."""
        return 4 / 3 * radius**4

    def torsion_constant(self, radius: Radius) -> Radius:
        """Torsion constant 0.1406 (2 h)⁴ [mm⁴]."""
        return 16 * SQUARE_TORSION_CONSTANT * radius**4

    def cowper(self, nu: float) -> float:
        """10 (1 + nu)/(12 + 11 nu)."""
        return 10 * (1 + nu) / (12 + 11 * nu)

    def bending_modulus(self, radius: Radius) -> Radius:
        """I over half the diagonal [mm³]: bending about a diagonal, the worst direction."""
        return self.second_moment(radius) / (np.sqrt(2) * radius)

    def torsion_modulus(self, radius: Radius) -> Radius:
        """0.2082 (2 h)³ [mm³]."""
        return 8 * SQUARE_TORSION_MODULUS * radius**3

    def shear_modulus_area(self, radius: Radius) -> Radius:
        """2/3 of the area [mm²]."""
        return self.area(radius) / SQUARE_SHEAR_PEAK


class Given(AbstractSection):
    """A section with given constants, whatever the radius: for textbook frames.

    Attributes:
        A: area [mm²].
        I: second moment of area [mm⁴].
        J: torsion constant [mm⁴].
        shear_factor: infinity (the default) neglects shear deformation.
    """

    A: float
    I: float
    J: float
    shear_factor: float | None = float("inf")

    def area(self, radius: Radius) -> Radius:
        """A."""
        return self.A * jnp.ones_like(radius)

    def second_moment(self, radius: Radius) -> Radius:
        """I."""
        return self.I * jnp.ones_like(radius)

    def torsion_constant(self, radius: Radius) -> Radius:
        """J."""
        return self.J * jnp.ones_like(radius)

    def cowper(self, nu: float) -> float:
        """Not defined for a section whose shape is unknown."""
        raise FeaError(
            f"The shear factor of a section given by its constants (nu = {nu:g}) must be given too."
        )

    def bending_modulus(self, radius: Radius) -> Radius:
        """I over the radius, which is the distance of the outermost fibre."""
        return self.I / radius

    def torsion_modulus(self, radius: Radius) -> Radius:
        """J over the radius."""
        return self.J / radius

    def shear_modulus_area(self, radius: Radius) -> Radius:
        """The area: a mean shear stress, since the shape is unknown."""
        return self.area(radius)


def section(name: str) -> AbstractSection:
    """The section called "round" or "square", with Cowper's shear factor.

    Raises:
        FeaError: for any other name.
    """
    known = {"round": Round, "square": Square}
    if name not in known:
        raise FeaError(f'section = "{name}" is unknown; known: {", ".join(known)}.')
    return known[name]()
