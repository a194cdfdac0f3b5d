"""How stiff a solid with voids can be at best."""

from dataclasses import dataclass

from fea.errors import FeaError


@dataclass(frozen=True)
class IsotropicModuli:
    """Bulk and shear modulus of an isotropic solid [MPa]."""

    bulk: float
    shear: float

    @property
    def E(self) -> float:
        """Young's modulus 9 K G/(3 K + G) [MPa]."""
        return 9 * self.bulk * self.shear / (3 * self.bulk + self.shear)

    @property
    def nu(self) -> float:
        """Poisson's ratio (3 K - 2 G)/(6 K + 2 G)."""
        return (3 * self.bulk - 2 * self.shear) / (6 * self.bulk + 2 * self.shear)


def voigt_bound(E: float, density: float) -> float:
    """Largest Young's modulus in any direction of a solid with voids [MPa]: E times the density.

    Voigt (1889), Hill, J. Mech. Phys. Solids 11 (1963) 357.

    Args:
        E: Young's modulus of the solid [MPa].
        density: share of the volume that is solid.

    Raises:
        FeaError: for a density outside 0 to 1.
    """
    _check_density(density)
    return E * density


def hashin_shtrikman_bound(E: float, nu: float, density: float) -> IsotropicModuli:
    """Largest moduli of an isotropic solid with voids.

    Hashin, Shtrikman, J. Mech. Phys. Solids 11 (1963) 127, equations 4.1 to 4.4 with one phase empty.

    Args:
        E: Young's modulus of the solid [MPa].
        nu: its Poisson's ratio.
        density: share of the volume that is solid.

    Raises:
        FeaError: for a density outside 0 to 1.
    """
    _check_density(density)
    K, G = E / (3 * (1 - 2 * nu)), E / (2 * (1 + nu))
    void = 1 - density
    bulk = K - void / (1 / K - 3 * density / (3 * K + 4 * G))
    shear = G - void / (1 / G - 6 * density * (K + 2 * G) / (5 * G * (3 * K + 4 * G)))
    return IsotropicModuli(bulk, shear)


def _check_density(density: float) -> None:
    if not 0 <= density <= 1:
        raise FeaError(f"A relative density is {density:g}; give a share from 0 to 1.")
