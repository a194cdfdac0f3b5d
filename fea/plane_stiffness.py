"""What the elasticity matrix of a plane says: constants along directions, anisotropy and averages."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from fea.effective_stiffness import EQUAL, HAS_SYMMETRY, MANDEL, stable_stiffness
from fea.errors import FeaError
from fea.stiffness_bounds import PlaneModuli

# As `MANDEL` in space: of xx, yy, xy.
PLANE_MANDEL = MANDEL[[0, 1, 5]]

PLANE_STRAIN_NAMES = ("xx", "yy", "xy")

# Directions in half a turn: half a degree, as lattices that bend are needles along their struts.
DIRECTIONS = 360


@dataclass(frozen=True)
class PlaneConstants:
    """Constants along the axes; nu_xy is the contraction along y under tension along x.

    Attributes:
        E: Young's moduli along x and y [MPa].
        nu_xy: Poisson's ratio under tension along x.
        nu_yx: Poisson's ratio under tension along y.
        G: shear modulus of xy [MPa].
    """

    E: tuple[float, float]
    nu_xy: float
    nu_yx: float
    G: float


@dataclass(frozen=True, eq=False)
class PolarModulus:
    """Young's modulus over all directions of the plane.

    Attributes:
        angle: of each direction to x, over a whole turn [rad].
        E: Young's modulus along it [MPa].
    """

    angle: Float[np.ndarray, " samples"]
    E: Float[np.ndarray, " samples"]

    @property
    def points(self) -> Float[np.ndarray, "samples 2"]:
        """Points whose distance from the origin is Young's modulus in that direction [MPa]."""
        return _direction(self.angle) * self.E[:, None]

    @property
    def softest(self) -> float:
        """Angle of the least modulus among those sampled, the first of equals [rad]."""
        return float(self.angle[np.flatnonzero((1 + EQUAL) * self.E.min() >= self.E)[0]])

    @property
    def stiffest(self) -> float:
        """Angle of the largest modulus among those sampled, the first of equals [rad]."""
        return float(self.angle[np.flatnonzero((1 - EQUAL) * self.E.max() <= self.E)[0]])


@dataclass(frozen=True, eq=False)
class PlaneStiffness:
    """A stable linear elastic stiffness in plane stress, of any anisotropy.

    Attributes:
        C: elasticity matrix [MPa] of xx, yy, xy, engineering shear.

    Raises:
        FeaError: when C is not 3 x 3, not finite or not symmetric, or some strain costs no energy;
            the message names that strain.
    """

    C: Float[np.ndarray, "3 3"]

    def __post_init__(self):
        C = stable_stiffness(self.C, PLANE_MANDEL, PLANE_STRAIN_NAMES, add="walls")
        object.__setattr__(self, "C", C)

    @cached_property
    def compliance(self) -> Float[np.ndarray, "3 3"]:
        """S = C⁻¹: strain 3-vector = S stress 3-vector [1/MPa]."""
        S = np.linalg.inv(self.C)
        return (S + S.T) / 2

    def turned(self, angle: float) -> "PlaneStiffness":
        """The stiffness of the sheet turned by an angle [rad], counter-clockwise."""
        n, m = _direction(np.array([angle, angle + np.pi / 2]))
        # Columns: the stress in the axes of the plane by each component in the turned ones.
        T = np.column_stack([_stress(n, n), _stress(m, m), _stress(n, m) + _stress(m, n)])
        return PlaneStiffness(T @ self.C @ T.T)

    # Along directions ------------------------------------------------------------------------

    def youngs_modulus(self, directions: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
        """Young's modulus under tension along directions [MPa].

        Args:
            directions: of any length but zero.
        """
        n = _unit(directions)
        return self._modulus(_stress(n, n))

    def poissons_ratio(self, directions: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
        """Contraction across over extension along, under tension along directions.

        Args:
            directions: of tension, of any length but zero.
        """
        n = _unit(directions)
        m = _across(n)
        lateral = np.einsum("...v,vw,...w->...", _stress(m, m), self.compliance, _stress(n, n))
        return np.asarray(-lateral * self.youngs_modulus(n))

    def shear_modulus(self, directions: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
        """Shear modulus of lines along directions, or across them, that slide [MPa].

        Args:
            directions: of any length but zero.
        """
        n = _unit(directions)
        m = _across(n)
        return self._modulus(_stress(n, m) + _stress(m, n))

    def _modulus(self, stress: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        return np.asarray(1 / np.einsum("...v,vw,...w->...", stress, self.compliance, stress))

    def polar_modulus(self, directions: int = DIRECTIONS) -> PolarModulus:
        """Young's modulus over all directions.

        Args:
            directions: how many in half a turn; the other half repeats them.
        """
        angle = np.linspace(0, 2 * np.pi, 2 * directions, endpoint=False)
        return PolarModulus(angle, self.youngs_modulus(_direction(angle)))

    @property
    def engineering_constants(self) -> PlaneConstants:
        """Constants under a single stress along the axes, whatever else that stress causes."""
        S = self.compliance
        x, y, G = (1 / np.diag(S)).tolist()
        return PlaneConstants((x, y), float(-S[0, 1] * x), float(-S[0, 1] * y), G)

    # Symmetry --------------------------------------------------------------------------------

    @property
    def departure_from_isotropy(self) -> float:
        """Norm of what is not isotropic over the norm of the stiffness tensor."""
        K, G = self.voigt_average.area, self.voigt_average.shear
        return self._share(self.C - np.array([[K + G, K - G, 0], [K - G, K + G, 0], [0, 0, G]]))

    @property
    def is_isotropic(self) -> bool:
        """Whether the stiffness is alike in all directions, to `HAS_SYMMETRY` of its size."""
        return self.departure_from_isotropy <= HAS_SYMMETRY

    @property
    def departure_from_orthotropy(self) -> float:
        """Norm of what couples normal stress along the axes and shear, over that of the tensor."""
        rest = self.C.copy()
        rest[:2, :2] = 0.0
        rest[2, 2] = 0.0
        return self._share(rest)

    def _share(self, part: Float[np.ndarray, "3 3"]) -> float:
        weight = np.outer(PLANE_MANDEL, PLANE_MANDEL)
        return float(np.linalg.norm(weight * part) / np.linalg.norm(weight * self.C))

    @property
    def universal_anisotropy(self) -> float:
        """2 G_V/G_R + K_V/K_R - 3, zero where isotropic.

        C_V : S_R less its value where isotropic, the index of Ranganathan, Ostoja-Starzewski, Phys.
        Rev. Lett. 101 (2008) 055504, with the one area modulus and the two shears of a plane.
        """
        stiff, soft = self.voigt_average, self.reuss_average
        # Not below zero by its definition, but by rounding.
        return max(2 * stiff.shear / soft.shear + stiff.area / soft.area - 3, 0.0)

    # Averages over all orientations ------------------------------------------------------------

    @property
    def voigt_average(self) -> PlaneModuli:
        """Moduli of a sheet of grains with uniform strain."""
        C = self.C
        normal, off, shear = C[0, 0] + C[1, 1], C[0, 1], C[2, 2]
        return PlaneModuli(float((normal + 2 * off) / 4), float((normal - 2 * off + 4 * shear) / 8))

    @property
    def reuss_average(self) -> PlaneModuli:
        """Moduli of a sheet of grains with uniform stress."""
        S = self.compliance
        normal, off, shear = S[0, 0] + S[1, 1], S[0, 1], S[2, 2]
        return PlaneModuli(float(1 / (normal + 2 * off)), float(2 / (normal - 2 * off + shear)))


def _direction(angle: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 2"]:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _across(n: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
    return np.stack([-n[..., 1], n[..., 0]], axis=-1)


def _stress(
    n: Float[np.ndarray, "*n 2"], m: Float[np.ndarray, "*n 2"]
) -> Float[np.ndarray, "*n 3"]:
    """Stress 3-vector n_i m_j, its shear the mean of both."""
    shear = (n[..., 0] * m[..., 1] + n[..., 1] * m[..., 0]) / 2
    return np.stack([n[..., 0] * m[..., 0], n[..., 1] * m[..., 1], shear], axis=-1)


def _unit(directions: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
    length = np.linalg.norm(directions, axis=-1, keepdims=True)
    if not (length > 0).all():
        raise FeaError("A direction has no length; give vectors that are not zero.")
    return directions / length
