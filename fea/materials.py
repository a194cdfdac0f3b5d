"""Isotropic linear elastic materials: valid by construction, and a table of common ones."""

import difflib
import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fea.errors import FeaError

# Tonnes per mm³ in one g/cm³: the table and people use g/cm³.
TONNE_PER_MM3 = 1e-9


@dataclass(frozen=True, eq=False)
class Material:
    """An isotropic linear elastic material.

    Attributes:
        E: Young's modulus [MPa].
        nu: Poisson's ratio.
        density: [tonne/mm³].
        yield_stress: [MPa], or None where strength is not asked for.
        name: what reports call it.

    Raises:
        FeaError: when a constant is physically impossible.
    """

    E: float
    nu: float
    density: float
    yield_stress: float | None = None
    name: str = "custom"

    def __post_init__(self):
        if not (math.isfinite(self.E) and self.E > 0):
            raise FeaError(f'Material "{self.name}": E = {self.E:g} MPa must be positive.')
        if not -1 < self.nu < 0.5:
            raise FeaError(
                f'Material "{self.name}": nu = {self.nu:g} must lie between -1 and 0.5 (both '
                "excluded); use 0.49 for a nearly incompressible material."
            )
        if not (math.isfinite(self.density) and self.density >= 0):
            raise FeaError(
                f'Material "{self.name}": density = {self.density:g} must not be negative.'
            )
        if self.yield_stress is not None and not (
            math.isfinite(self.yield_stress) and self.yield_stress > 0
        ):
            raise FeaError(
                f'Material "{self.name}": yield = {self.yield_stress:g} MPa must be positive.'
            )

    @property
    def shear_modulus(self) -> float:
        """Shear modulus G = E / 2(1 + nu) [MPa]."""
        return self.E / (2 * (1 + self.nu))

    @property
    def lame(self) -> tuple[float, float]:
        """Lamé's constants lambda and mu [MPa]."""
        return self.E * self.nu / ((1 + self.nu) * (1 - 2 * self.nu)), self.shear_modulus

    @property
    def stiffness(self) -> Float[np.ndarray, "6 6"]:
        """Elasticity matrix C: stress 6-vector = C strain 6-vector [MPa]."""
        lam, mu = self.lame
        C = np.diag([2 * mu, 2 * mu, 2 * mu, mu, mu, mu])
        C[:3, :3] += lam
        return C


# E [MPa], nu, density [g/cm³], yield stress (0.2 % proof, or tensile strength of brittle
# plastics) [MPa], source. Values of as-built parts, weakest build direction where sources
# distinguish; they scatter with process and treatment, so a design is checked with its own.
TABLE: dict[str, tuple[float, float, float, float, str]] = {
    "AlSi10Mg": (70e3, 0.33, 2.67, 230.0, "EOS Aluminium AlSi10Mg data sheet, as built, vertical"),
    "Ti6Al4V": (114e3, 0.34, 4.41, 950.0, "EOS Titanium Ti64 data sheet, heat treated; nu: MMPDS"),
    "316L": (193e3, 0.27, 7.99, 470.0, "EOS StainlessSteel 316L data sheet; E, nu: AK Steel 316L"),
    "17-4PH": (196e3, 0.27, 7.8, 861.0, "E, nu: AK Steel 17-4 PH; yield: EOS 17-4PH as built"),
    "Inconel718": (
        200e3,
        0.29,
        8.19,
        1030.0,
        "Special Metals INCONEL 718 bulletin; AMS 5662 yield",
    ),
    "CoCr": (210e3, 0.3, 8.3, 600.0, "EOS CobaltChrome MP1 data sheet, heat treated"),
    "PA12": (1650.0, 0.4, 0.93, 48.0, "EOS PA 2200 data sheet (strength); nu: typical polyamide"),
    "PLA": (
        3500.0,
        0.36,
        1.24,
        50.0,
        "Ultimaker PLA data sheet, rounded; nu: Ferreira et al. 2017",
    ),
    "ABS": (2200.0, 0.35, 1.05, 31.0, "Stratasys ABS-M30 data sheet; nu: typical styrene polymer"),
    "steel": (210e3, 0.3, 7.85, 235.0, "EN 1993-1-1, 3.2.6, and S235 of EN 10025-2"),
    "aluminium": (70e3, 0.3, 2.7, 240.0, "EN 1999-1-1, 3.2.5, and EN AW-6061-T6 of table 3.2"),
}


def material_names() -> list[str]:
    """Names that `material` knows."""
    return list(TABLE)


def material(name: str) -> Material:
    """A named material; upper and lower case, blanks and hyphens do not matter.

    Raises:
        FeaError: when the name is not in the table.
    """
    plain = {_plain(known): known for known in TABLE}
    known = plain.get(_plain(name))
    if known is None:
        close = difflib.get_close_matches(_plain(name), plain, n=1)
        hint = f'did you mean "{plain[close[0]]}"?' if close else f"known: {', '.join(TABLE)}."
        raise FeaError(f'Material "{name}" is unknown; {hint}')
    E, nu, density, yield_stress, _ = TABLE[known]
    return Material(E, nu, density * TONNE_PER_MM3, yield_stress, known)


def _plain(name: str) -> str:
    return "".join(letter for letter in name.lower() if letter.isalnum())
