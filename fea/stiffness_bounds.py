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


@dataclass(frozen=True)
class PlaneModuli:
    """Moduli of an isotropic sheet in plane stress [MPa].

    Attributes:
        area: mean of the two principal stresses over the share of area that is lost or won.
        shear: shear modulus.
    """

    area: float
    shear: float

    @property
    def E(self) -> float:
        """Young's modulus 4 K G/(K + G) [MPa]."""
        return 4 * self.area * self.shear / (self.area + self.shear)

    @property
    def nu(self) -> float:
        """Poisson's ratio (K - G)/(K + G), between -1 and 1."""
        return (self.area - self.shear) / (self.area + self.shear)


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


def plane_hashin_shtrikman_bound(E: float, nu: float, density: float) -> PlaneModuli:
    """Largest moduli of an isotropic sheet with holes; its Young's modulus is E rho/(3 - 2 rho).

    Hashin, J. Mech. Phys. Solids 13 (1965) 119, for plane strain, with one phase empty; in plane stress
    with the moduli of the sheet, K = E/(2 (1 - nu)).

    Args:
        E: Young's modulus of the solid [MPa].
        nu: its Poisson's ratio.
        density: share of the area that is solid.

    Raises:
        FeaError: for a density outside 0 to 1.
    """
    _check_density(density)
    K, G, void = E / (2 * (1 - nu)), E / (2 * (1 + nu)), 1 - density
    return PlaneModuli(
        area=density * K * G / (void * K + G), shear=density * K * G / (void * (K + 2 * G) + K)
    )


def extruded_modulus(E: float, density: float) -> float:
    """Young's modulus of an extruded lattice along its axis of extrusion [MPa]: E times the density.

    All walls stretch, and contract across by nu of the solid, so that they still fit: Voigt's bound is
    reached exactly, whatever the cell (Gibson, Ashby, Cellular Solids, 2nd ed., section 4.4).

    Args:
        E: Young's modulus of the solid [MPa].
        density: share of the area that is solid.

    Raises:
        FeaError: for a density outside 0 to 1.
    """
    return voigt_bound(E, density)


def _check_density(density: float) -> None:
    if not 0 <= density <= 1:
        raise FeaError(f"A relative density is {density:g}; give a share from 0 to 1.")
