"""Numbers by which homogenised cells are compared, each with the name that the command line takes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fea.effective_stiffness import HAS_SYMMETRY
from texmap_opt.cells.at_density import Homogenised
from texmap_opt.cells.homogenised import HomogenisedCell
from texmap_opt.cells.homogenised_plane import HomogenisedPlaneCell
from texmap_opt.errors import InputError, nearest_name

# Share of a direction's length below which a component is none.
ALIGNED = 1e-9

# Poisson's ratios and anisotropies below this are zero and rounding.
ROUNDING = 1e-9

Direction = Float[np.ndarray, " 3"]


@dataclass(frozen=True)
class Property:
    """A number that a homogenised cell has.

    Attributes:
        meaning: one line for a heading.
        directional: whether it depends on a direction.
        in_space: of cells of three dimensions; None where it is not defined.
        in_plane: of cells of two, likewise.
        rounding: what is smaller is zero.
    """

    meaning: str
    directional: bool
    in_space: Callable[[HomogenisedCell, Direction], float | None]
    in_plane: Callable[[HomogenisedPlaneCell, Direction], float | None]
    rounding: float = 0.0

    def of(self, homogenised: Homogenised, direction: Direction) -> float | None:
        """Its value, moduli over that of the solid; None where it is not defined."""
        if isinstance(homogenised, HomogenisedCell):
            value = self.in_space(homogenised, direction)
        else:
            value = self.in_plane(homogenised, direction)
        return 0.0 if value is not None and abs(value) < self.rounding else value


def property_named(name: str) -> Property:
    """A property by its name.

    Raises:
        InputError: for a name that is none.
    """
    if name not in PROPERTIES:
        raise InputError(
            f'property "{name}" is not one that cells are ranked by; '
            f"{nearest_name(name, PROPERTIES)}"
        )
    return PROPERTIES[name]


def direction_of(text: str) -> Direction:
    """A direction typed as three numbers, such as "1,0,0".

    Raises:
        InputError: for another number of them, what is no number, or all zero.
    """
    try:
        vector = np.array([float(word) for word in text.split(",")])
    except ValueError:
        vector = np.zeros(0)
    if len(vector) != 3 or not np.isfinite(vector).all() or not vector.any():
        raise InputError(
            f'direction "{text}" is not three numbers with commas between, not all zero; give such as '
            "1,0,0."
        )
    return vector


# In space -------------------------------------------------------------------------------------


def _axes_across(n: Direction) -> Float[np.ndarray, "2 3"]:
    """Two directions at right angles to one and to each other."""
    first = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    return np.stack([first, np.cross(n, first)])


def _space_E(cell: HomogenisedCell, n: Direction) -> float:
    return float(cell.stiffness.youngs_modulus(n))


def _space_G(cell: HomogenisedCell, n: Direction) -> float:
    # 1/G is a quadratic form of the direction of sliding: the mean of two is that of all.
    across = _axes_across(n)
    return float(2 / np.sum(1 / cell.stiffness.shear_modulus(np.broadcast_to(n, (2, 3)), across)))


def _space_nu(cell: HomogenisedCell, n: Direction) -> float:
    # The contraction across, too, is a quadratic form.
    across = _axes_across(n)
    return float(cell.stiffness.poissons_ratio(np.broadcast_to(n, (2, 3)), across).mean())


def _space_zener(cell: HomogenisedCell, n: Direction) -> float | None:
    return cell.stiffness.zener_ratio if cell.stiffness.is_cubic else None


def _space_range(cell: HomogenisedCell) -> tuple[float, float]:
    E = cell.stiffness.directional_modulus().E
    return float(E.min()), float(E.max())


# In the plane -----------------------------------------------------------------------------------


def _is_axis(n: Direction) -> bool:
    return bool(np.abs(n[:2]).max() <= ALIGNED * np.abs(n[2]))


def _is_in_plane(n: Direction) -> bool:
    return bool(np.abs(n[2]) <= ALIGNED * np.abs(n[:2]).max())


def _plane_E(cell: HomogenisedPlaneCell, n: Direction) -> float | None:
    if _is_axis(n):
        return cell.extruded_modulus
    return float(cell.stiffness.youngs_modulus(n[:2])) if _is_in_plane(n) else None


def _plane_G(cell: HomogenisedPlaneCell, n: Direction) -> float | None:
    return float(cell.stiffness.shear_modulus(n[:2])) if _is_in_plane(n) else None


def _plane_nu(cell: HomogenisedPlaneCell, n: Direction) -> float | None:
    if _is_axis(n):
        return cell.nu  # All walls contract alike.
    return float(cell.stiffness.poissons_ratio(n[:2])) if _is_in_plane(n) else None


def _plane_zener(cell: HomogenisedPlaneCell, n: Direction) -> float | None:
    C = cell.stiffness.C
    limit = HAS_SYMMETRY * float(np.abs(C).max())
    if abs(C[0, 0] - C[1, 1]) > limit or np.abs(C[:2, 2]).max() > limit:
        return None
    return float(2 * C[2, 2] / (C[0, 0] - C[0, 1]))


def _plane_range(cell: HomogenisedPlaneCell) -> tuple[float, float]:
    E = cell.stiffness.polar_modulus().E
    return float(E.min()), float(E.max())


PROPERTIES = {
    "E": Property("Young's modulus", True, _space_E, _plane_E),
    "G": Property(
        "shear modulus of planes across, mean over the directions they slide in",
        True,
        _space_G,
        _plane_G,
    ),
    "nu": Property(
        "Poisson's ratio under tension, mean over the directions across",
        True,
        _space_nu,
        _plane_nu,
        rounding=ROUNDING,
    ),
    "bulk": Property(
        "bulk modulus, of 2.5-D cells the area modulus of the plane",
        False,
        lambda cell, n: cell.stiffness.bulk_modulus,
        lambda cell, n: cell.stiffness.reuss_average.area,
    ),
    "zener": Property(
        "Zener ratio 2 C44/(C11 - C12), of cells of cubic or square stiffness",
        False,
        _space_zener,
        _plane_zener,
    ),
    "anisotropy": Property(
        "universal anisotropy, 0 where isotropic; of 2.5-D cells in the plane",
        False,
        lambda cell, n: cell.stiffness.universal_anisotropy,
        lambda cell, n: cell.stiffness.universal_anisotropy,
        rounding=ROUNDING,
    ),
    "E_min": Property(
        "least Young's modulus over all directions; of 2.5-D cells in the plane",
        False,
        lambda cell, n: _space_range(cell)[0],
        lambda cell, n: _plane_range(cell)[0],
    ),
    "E_max": Property(
        "largest Young's modulus over all directions; of 2.5-D cells in the plane",
        False,
        lambda cell, n: _space_range(cell)[1],
        lambda cell, n: _plane_range(cell)[1],
    ),
    "E_ratio": Property(
        "largest over least Young's modulus; of 2.5-D cells in the plane",
        False,
        lambda cell, n: _ratio(_space_range(cell)),
        lambda cell, n: _ratio(_plane_range(cell)),
    ),
}


def _ratio(ends: tuple[float, float]) -> float:
    low, high = ends
    return high / low
