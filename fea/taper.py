"""What a strut of linear taper adds up along its length: integrals of 1/A, 1/I and 1/J.

The size s of a section runs linearly from a to b. Where the section keeps its shape, A ~ s² and
I, J ~ s⁴; where one edge of it alone changes, as the thickness of a wall does, A ~ s and I, J ~ s³.
The integrals over a strut, 0 <= ξ <= 1, are elementary in both cases, and written so that nothing is
singular where a = b.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

# Either kind of array: element code is traced by JAX, set-up and results are NumPy.
Size = Float[Array, "*shape"] | Float[np.ndarray, "*shape"]


class Flexibility(NamedTuple):
    """Integrals over a strut: of 1/A, and of (1-ξ)²/I and so on, without dimension.

    Attributes:
        area: (∫ dξ/A)⁻¹ over the area at size 1 mm.
        moment: some I between those of the two ends, over that at size 1 mm.
        turn: ∫ (1-ξ)² moment/I dξ and ∫ ξ² moment/I dξ: the rotation of each end by its own moment.
        cross: ∫ ξ(1-ξ) moment/I dξ: less the rotation of an end by the moment at the other.
        determinant: turn_a turn_b - cross², without its cancellation.
    """

    area: Float[Array, ""]
    moment: Float[Array, ""]
    turn: Float[Array, "2"]
    cross: Float[Array, ""]
    determinant: Float[Array, ""]

    @property
    def whole(self) -> Float[Array, ""]:
        """∫ moment/I dξ, as (1-ξ)² + ξ² + 2 ξ(1-ξ) = 1."""
        return self.turn[0] + self.turn[1] + 2 * self.cross


class AbstractTaper(eqx.Module):
    """How a section changes with its size."""

    @abc.abstractmethod
    def area(self, size: Size) -> Size:
        """Area over that at size 1 mm."""

    @abc.abstractmethod
    def moment(self, size: Size) -> Size:
        """Second moment of area, or torsion constant, over that at size 1 mm."""

    @abc.abstractmethod
    def flexibility(self, ends: Float[Array, "2"]) -> Flexibility:
        """Integrals over a strut.

        Args:
            ends: sizes at its two ends [mm].
        """

    @abc.abstractmethod
    def column(self, first: Size, second: Size) -> Size:
        """(∫ dξ/√I)⁻², the second moment that a column of sizes `first` to `second` buckles with.

        The wave in the buckled column has the local length of the prismatic one (WKB).
        """


class Similar(AbstractTaper):
    """The section keeps its shape: A ~ s², I, J ~ s⁴.

    Integrals are ∫ ξ^i (1-ξ)^j / s^(i+j+2) dξ = i! j!/((i+j+1)! a^(j+1) b^(i+1)).
    """

    def area(self, size: Size) -> Size:
        """Its square."""
        return size**2

    def moment(self, size: Size) -> Size:
        """Its fourth power."""
        return size**4

    def flexibility(self, ends: Float[Array, "2"]) -> Flexibility:
        """Rational in both sizes."""
        a, b = ends
        one = jnp.ones_like(a)
        return Flexibility(
            area=a * b,
            moment=(a * b) ** 2,
            turn=jnp.stack([b / a, a / b]) / 3,
            cross=one / 6,
            determinant=one / 12,
        )

    def column(self, first: Size, second: Size) -> Size:
        """Size (a b)², and no approximation: Timoshenko, Gere, Theory of Elastic Stability, chapter 2."""
        return (first * second) ** 2


class OneEdge(AbstractTaper):
    """One edge of the section changes: A ~ s, I, J ~ s³.

    With the mean size m and s = m (1 + c η), -1 <= η <= 1, the integrals of η^k/s and η^k/s³ are those
    of rational functions and of g = artanh(c)/c = 1 + c² h(c²).
    """

    def area(self, size: Size) -> Size:
        """The size."""
        return size

    def moment(self, size: Size) -> Size:
        """Its third power."""
        return size**3

    def flexibility(self, ends: Float[Array, "2"]) -> Flexibility:
        """By h of `_log_series`; a = m (1 - c), b = m (1 + c)."""
        a, b = ends
        m, c2 = (a + b) / 2, ((b - a) / (b + a)) ** 2
        h = _log_series(ends, c2)
        return Flexibility(
            area=m / (1 + c2 * h),
            moment=m**3,
            turn=((m / ends) ** 2 + h) / 4,
            cross=(m**2 / (a * b) - h) / 4,
            determinant=h * m**4 / (2 * a * b) ** 2,
        )

    def column(self, first: Size, second: Size) -> Size:
        """Size a b (√a + √b)²/4.

        Hinged, it is 0.9 % below the eigenvalue (zeros of Bessel functions of order one) at b = 2 a,
        2.2 % at 3 a and 4.5 % at 5 a: safe.
        """
        return first * second * (first**0.5 + second**0.5) ** 2 / 4


# Where c² is below the limit, the series of h with so many terms; 0.1^16 is less than rounding. Above
# it, cancellation costs one digit.
SERIES_LIMIT = 0.1
SERIES_TERMS = 16


def _log_series(ends: Float[Array, "2"], c2: Float[Array, ""]) -> Float[Array, ""]:
    """The function h = (artanh(c)/c - 1)/c² = 1/3 + c²/5 + c⁴/7 + ..., c = (b - a)/(b + a)."""
    near = c2 < SERIES_LIMIT
    series = jnp.zeros_like(c2)
    for k in reversed(range(SERIES_TERMS)):
        series = series * c2 + 1 / (2 * k + 3)
    # Where the series is used, the other branch must not divide by zero, nor must its derivative.
    a, b = jnp.where(near, jnp.array([1.0, 3.0]), ends)
    c = (b - a) / (b + a)
    return jnp.where(near, series, (jnp.log(b / a) / (2 * c) - 1) / c**2)
