"""Linear elastic materials, valid by construction, and a table of common ones."""

import difflib
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from fea.errors import FeaError
from fea.precision import as_float64
from fea.voigt import turned_stiffness

# Tonnes per mm³ in one g/cm³: the table and people use g/cm³.
TONNE_PER_MM3 = 1e-9

# Axes of nu_yz, nu_xz, nu_xy and of the shear moduli: the Voigt order.
PAIRS = ((1, 2), (0, 2), (0, 1))

# Least eigenvalue of a compliance scaled to a unit diagonal; an isotropic material with
# nu = 0.4999999 has 2e-7.
POSITIVE = 1e-12

# Axes typed with seven digits pass; the stiffness is then as exact.
ORTHONORMAL = 1e-6


class AbstractMaterial(ABC):
    """A linear elastic material, equal in all cells.

    Attributes:
        density: [tonne/mm³].
        yield_stress: [MPa], or None where strength is not asked for.
        name: what reports call it.
    """

    density: float
    yield_stress: float | None
    name: str

    @property
    @abstractmethod
    def stiffness(self) -> Float[np.ndarray, "6 6"]:
        """Elasticity matrix C in global axes: stress 6-vector = C strain 6-vector [MPa]."""


@dataclass(frozen=True, eq=False)
class Material(AbstractMaterial):
    """An isotropic linear elastic material.

    Attributes:
        E: Young's modulus [MPa].
        nu: Poisson's ratio.
        density: [tonne/mm³].
        yield_stress: [MPa], or None where strength is not asked for.
        name: what reports call it.

    Raises:
        FeaError: when a constant is physically impossible, or in single precision.
    """

    E: float
    nu: float
    density: float
    yield_stress: float | None = None
    name: str = "custom"

    def __post_init__(self):
        _keep_float64(self, E=(), nu=(), density=(), yield_stress=())
        _check_positive(self, E=self.E)
        if not -1 < self.nu < 0.5:
            raise FeaError(
                f'Material "{self.name}": nu = {self.nu:g} must lie between -1 and 0.5 (both '
                "excluded); use 0.49 for a nearly incompressible material."
            )
        _check_density_and_yield(self)

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


@dataclass(frozen=True, eq=False)
class Orthotropic(AbstractMaterial):
    """A linear elastic material with three planes of symmetry, normal to its own axes x, y, z.

    nu_xy is the contraction along y under tension along x, -eps_y/eps_x, so that the compliance
    has S_xy = -nu_xy/Ex = -nu_yx/Ey (R. M. Jones, Mechanics of Composite Materials, 2nd ed.,
    section 2.3). Beware of data sheets that name nu the other way round.

    Attributes:
        E: Young's moduli Ex, Ey, Ez [MPa].
        nu: Poisson's ratios nu_yz, nu_xz, nu_xy.
        G: shear moduli G_yz, G_xz, G_xy [MPa].
        density: [tonne/mm³].
        axes: the material's axes x, y, z as rows, in global components; the global axes by default.
        yield_stress: [MPa], or None where strength is not asked for.
        name: what reports call it.

    Raises:
        FeaError: when a modulus is not positive, Poisson's ratios would make the material yield
            energy, axes are not three unit vectors at right angles, or there are not three of
            each, in double precision.
    """

    E: tuple[float, float, float]
    nu: tuple[float, float, float]
    G: tuple[float, float, float]
    density: float
    axes: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    yield_stress: float | None = None
    name: str = "custom"

    def __post_init__(self):
        _keep_float64(self, E=(3,), nu=(3,), G=(3,), axes=(3, 3), density=(), yield_stress=())
        _check_positive(
            self,
            **dict(zip(("Ex", "Ey", "Ez"), self.E, strict=True)),
            **dict(zip(("G_yz", "G_xz", "G_xy"), self.G, strict=True)),
        )
        for (i, j), ratio in zip(PAIRS, self.nu, strict=True):
            # Of each 2x2 minor of the compliance; not enough for all three together.
            limit = math.sqrt(self.E[i] / self.E[j])
            if not abs(ratio) < limit:
                a, b = "xyz"[i], "xyz"[j]
                raise FeaError(
                    f'Material "{self.name}": nu_{a}{b} = {ratio:g} must lie between -{limit:.4g} '
                    f"and {limit:.4g}, the square root of E{a}/E{b}; nu_{a}{b} is the contraction "
                    f"along {b} under tension along {a}: perhaps nu_{b}{a} is meant."
                )
        # In units of sqrt(Ei Ej) the normal part has ones on its diagonal.
        root = np.sqrt(np.array(self.E))
        least = float(np.linalg.eigvalsh(self.compliance[:3, :3] * np.outer(root, root))[0])
        if not least > POSITIVE:
            raise FeaError(
                f'Material "{self.name}": Poisson\'s ratios nu_yz, nu_xz, nu_xy = '
                f"{', '.join(f'{ratio:g}' for ratio in self.nu)} are too large together: the "
                "compliance must be positive definite, or some load would be resisted by nothing; "
                "lower them."
            )
        skew = float(np.abs(self.axes @ self.axes.T - np.eye(3)).max())
        if not skew < ORTHONORMAL:
            raise FeaError(
                f'Material "{self.name}": its axes must be three unit vectors at right angles, one '
                f"a row; their products differ from that by {skew:.2g}. Make them so, as with "
                "scipy.spatial.transform.Rotation."
            )
        _check_density_and_yield(self)

    @property
    def compliance(self) -> Float[np.ndarray, "6 6"]:
        """Compliance S in the material's own axes: strain 6-vector = S stress 6-vector [1/MPa]."""
        S = np.diag(1 / np.array([*self.E, *self.G]))
        for (i, j), ratio in zip(PAIRS, self.nu, strict=True):
            S[i, j] = S[j, i] = -ratio / self.E[i]
        return S

    @property
    def stiffness(self) -> Float[np.ndarray, "6 6"]:
        """Elasticity matrix C in global axes: stress 6-vector = C strain 6-vector [MPa]."""
        # The block of normal stresses alone is coupled: its inverse keeps the zeros exact.
        C = np.diag(np.array([0.0, 0.0, 0.0, *self.G]))
        C[:3, :3] = np.linalg.inv(self.compliance[:3, :3])
        C[:3, :3] = (C[:3, :3] + C[:3, :3].T) / 2
        # From the material's axes to the global ones: what lies along global x is turned to axis x.
        return turned_stiffness(C, self.axes.T)


def _keep_float64(material: AbstractMaterial, **shapes: tuple[int, ...]) -> None:
    """Keep constants as float64, whatever kind of numbers they were given as."""
    for name, shape in shapes.items():
        given = getattr(material, name)
        if given is None:  # no yield stress
            continue
        values = as_float64(given, f'Material "{material.name}": values of {name}')
        if values.shape != shape:
            wanted = {(): "one number", (3,): "three numbers", (3, 3): "three rows of three"}[shape]
            raise FeaError(
                f'Material "{material.name}": {name} has shape {values.shape}; give {wanted}.'
            )
        kept = tuple(values.tolist()) if shape == (3,) else values
        object.__setattr__(material, name, kept if shape else float(values))


def _check_positive(material: AbstractMaterial, **moduli: float) -> None:
    for name, modulus in moduli.items():
        if not (math.isfinite(modulus) and modulus > 0):
            raise FeaError(
                f'Material "{material.name}": {name} = {modulus:g} MPa must be positive.'
            )


def _check_density_and_yield(material: AbstractMaterial) -> None:
    if not (math.isfinite(material.density) and material.density >= 0):
        raise FeaError(
            f'Material "{material.name}": density = {material.density:g} must not be negative.'
        )
    strength = material.yield_stress
    if strength is not None and not (math.isfinite(strength) and strength > 0):
        raise FeaError(f'Material "{material.name}": yield = {strength:g} MPa must be positive.')


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
