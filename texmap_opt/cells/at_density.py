"""Unit cells as homogeneous solids of a wanted density, computed once and kept."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import brentq

from fea.effective_stiffness import EffectiveStiffness
from fea.plane_stiffness import PlaneStiffness
from texmap_opt.cache import StageCache, stage_key
from texmap_opt.cells.homogenised import (
    HomogenisedCell,
    fitting_joint_model,
    homogenised_cell,
    radius_ratio,
)
from texmap_opt.cells.homogenised_plane import HomogenisedPlaneCell, homogenised_plane_cell
from texmap_opt.cells.periodic_density import periodic_density
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.errors import CellError

Homogenised = HomogenisedCell | HomogenisedPlaneCell

# Poisson's ratio of the solid: what joint models were fitted with, and near that of most metals.
POISSON = 0.3

# Of the wanted density: far below what a joint model leaves, far above rounding.
DENSITY_RTOL = 1e-9

# Struts this thick over their length are joints that touch: no lattice is left.
LARGEST_RADIUS_RATIO = 0.5

# Under this name the cache keeps why a cell has no stiffness at a density.
REFUSAL = "refusal"


def radius_of_density(cell: UnitCell, density: float) -> float:
    """The radius, in cell edges, that gives an endless lattice its relative density.

    Density grows with the radius: the volume of struts as a power of it, of which they share ever
    more at joints. So the radius at which nothing would be shared is a lower bound.

    Raises:
        CellError: for a density that is not between 0 and what the cell reaches before its struts are
            as thick as they are long.
    """
    if not 0 < density < 1:
        raise CellError(f"the relative density is {density:g}; it must be above 0 and below 1.")
    largest = LARGEST_RADIUS_RATIO / radius_ratio(cell, 1.0)
    reach = min(periodic_density(cell, largest), 1.0)
    if not density < reach:
        raise CellError(
            f'unit cell "{cell.name}": a relative density of {density:g} is out of reach; its struts '
            f"are as thick as they are long at {reach:.3g}: take a smaller density or another cell."
        )

    # The logarithms are nearly a line, on which the secant is at home.
    def excess(log_radius: float) -> float:
        return float(np.log(periodic_density(cell, float(np.exp(log_radius))) / density))

    # Rounding must not put the bound itself above the root.
    low = float(np.log(_unshared_radius(cell, density))) - DENSITY_RTOL
    root = brentq(excess, low, float(np.log(largest)), xtol=DENSITY_RTOL)
    return float(np.exp(np.asarray(root)))


def _unshared_radius(cell: UnitCell, density: float) -> float:
    """The radius that would give the density if struts were counted from joint to joint.

    Struts in a face are shared, which the cell does not tell: all counted as its own give a volume
    that is at least the lattice's.
    """
    lengths = np.linalg.norm(cell.edges, axis=1)
    power = cell.dimensions - 1
    area = {"round": np.pi, "square": 4.0, "wall": 2.0}[cell.section]
    unit = area * float(np.sum(lengths * cell.relative_radius**power)) / np.prod(cell.proportions)
    return float((density / unit) ** (1 / power))


def homogenised(cell: UnitCell, radius: float) -> Homogenised:
    """The endless lattice of a radius, its joints stiffened where the cell's model was so fitted.

    Args:
        cell: the unit cell.
        radius: of struts of relative radius 1, in cell edges.

    Raises:
        CellError: see `homogenised_cell`.
    """
    homogenise = homogenised_cell if cell.dimensions == 3 else homogenised_plane_cell
    model = fitting_joint_model(cell, radius)
    return homogenise(cell, radius=radius, nu=POISSON, joint_model=model)


def homogenised_at(cell: UnitCell, density: float, *, cache: StageCache) -> Homogenised:
    """The endless lattice of a density, its joints stiffened where the cell's model was so fitted.

    Args:
        cell: the unit cell.
        density: relative.
        cache: where the result is kept, or why there is none.

    Raises:
        CellError: for a density out of reach, or a lattice that resists some strain with nothing.
    """
    key = stage_key("cell", cell, density, POISSON)
    stored = cache.get(key)
    if stored is not None:
        return _of_stored(cell, stored)
    try:
        result = homogenised(cell, radius_of_density(cell, density))
    except CellError as refusal:
        cache.put(key, {REFUSAL: np.array(str(refusal))})
        raise
    scalars = np.array([result.radius, result.density, result.centre_line_density])
    cache.put(key, {"C": result.stiffness.C, "scalars": scalars})
    return result


def all_homogenised_at(
    cells: Sequence[UnitCell],
    density: float,
    *,
    cache: StageCache,
    computing: Callable[[int], None],
) -> dict[str, Homogenised | CellError]:
    """Endless lattices of a density, by the names of the cells; or why one has none.

    Args:
        cells: the unit cells.
        density: relative.
        cache: where results are kept.
        computing: told how many are not there yet, before they are computed.
    """
    missing = [
        cell for cell in cells if cache.get(stage_key("cell", cell, density, POISSON)) is None
    ]
    if missing:
        computing(len(missing))
    results: dict[str, Homogenised | CellError] = {}
    for cell in cells:
        try:
            results[cell.name] = homogenised_at(cell, density, cache=cache)
        except CellError as failure:
            results[cell.name] = failure
    return results


def _of_stored(cell: UnitCell, stored: dict[str, np.ndarray]) -> Homogenised:
    if REFUSAL in stored:
        raise CellError(str(stored[REFUSAL]))
    radius, density, centre_line_density = stored["scalars"].tolist()
    rest = {
        "cell": cell,
        "radius": radius,
        "nu": POISSON,
        "density": density,
        "centre_line_density": centre_line_density,
        "joint_model": fitting_joint_model(cell, radius),
    }
    if cell.dimensions == 3:
        return HomogenisedCell(stiffness=EffectiveStiffness(stored["C"]), **rest)
    return HomogenisedPlaneCell(stiffness=PlaneStiffness(stored["C"]), **rest)
