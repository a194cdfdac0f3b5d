"""What is measured of every cell, kept in results.json for the page and its tests."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np

from texmap_opt.cache import StageCache
from texmap_opt.cells.at_density import Homogenised, homogenised_at
from texmap_opt.cells.homogenised import DIRECTIONS, HomogenisedCell, radius_ratio
from texmap_opt.cells.homogenised_plane import PLANE_DIRECTIONS
from texmap_opt.cells.power_law import power_law
from texmap_opt.cells.properties import PROPERTIES
from texmap_opt.cells.unit_cell import UnitCell

RESULTS = Path(__file__).parent / "results.json"

DENSITIES = (0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3)

# Further directions in space, where a lattice may not be cubic.
AXIS = {"001": (0.0, 0.0, 1.0)}
DIGITS = 6

Value = float | bool | None
Row = dict[str, Value]


def directions(cell: UnitCell) -> dict[str, tuple[float, ...]]:
    """Directions along which Young's modulus is listed."""
    if cell.dimensions == 2:
        return {**PLANE_DIRECTIONS, "z": (0.0, 0.0, 1.0)}
    return DIRECTIONS if cell.symmetry == "cubic" else {**DIRECTIONS, **AXIS}


def measured(cell: UnitCell, density: float) -> Row:
    """One row: numbers of a cell at a density, moduli over that of the solid."""
    homogenised = homogenised_at(cell, density, cache=StageCache(None))
    row: Row = {
        "density": density,
        "radius": homogenised.radius,
        "radius_ratio": radius_ratio(cell, homogenised.radius),
        "jointed": homogenised.joint_model is not None,
    }
    x, y = np.array([1.0, 0, 0]), np.array([0.0, 1, 0])
    for name, vector in directions(cell).items():
        along = np.pad(np.array(vector), (0, 3 - len(vector)))
        row[f"E {name}"] = PROPERTIES["E"].of(homogenised, along)
    for name in ("G", "nu", "bulk", "zener", "anisotropy", "E_min", "E_max"):
        row[name] = PROPERTIES[name].of(homogenised, x)
    row["nu y"] = PROPERTIES["nu"].of(homogenised, y)
    row |= _extremes(homogenised)
    return {name: _rounded(value) for name, value in row.items()}


def laws(cell: UnitCell, rows: list[Row]) -> dict[str, dict[str, float]]:
    """Power laws of Young's modulus along each direction."""
    density = np.array([row["density"] for row in rows], float)
    return {
        name: {
            key: float(f"{value:.4g}")
            for key, value in asdict(
                power_law(density, np.array([row[f"E {name}"] for row in rows], float))
            ).items()
        }
        for name in directions(cell)
        if name != "z"
    }


def read_results() -> dict[str, dict]:
    """Of the last run, by cell."""
    return json.loads(RESULTS.read_text(encoding="utf-8"))


def write_results(results: dict[str, dict]) -> None:
    """Keep them, a line for each row."""
    parts = []
    for name, result in sorted(results.items()):
        rows = ",\n  ".join(json.dumps(row) for row in result["rows"])
        parts.append(f'"{name}": {{"laws": {json.dumps(result["laws"])},\n "rows": [\n  {rows}]}}')
    RESULTS.write_text("{\n" + ",\n".join(parts) + "\n}\n", encoding="utf-8")


def _extremes(homogenised: Homogenised) -> Row:
    """Directions of the least and the largest modulus: vectors in space, angles in the plane."""
    if isinstance(homogenised, HomogenisedCell):
        surface = homogenised.stiffness.directional_modulus()
        ends = {"softest": surface.softest, "stiffest": surface.stiffest}
        return {
            f"{name} {axis}": float(value)
            for name, vector in ends.items()
            for axis, value in zip("xyz", vector / np.abs(vector).max(), strict=True)
        }
    polar = homogenised.stiffness.polar_modulus()
    return {"softest": np.degrees(polar.softest), "stiffest": np.degrees(polar.stiffest)}


def _rounded(value: Value) -> Value:
    return value if value is None or isinstance(value, bool) else float(f"{value:.{DIGITS}g}")
