"""Parts under load: their tets, their stress, and the warping function that follows from it."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from texmap_opt import DesignCase
from texmap_opt.box import Box
from texmap_opt.cache import StageCache
from texmap_opt.part import Part, read_part
from texmap_opt.stress_field import StressField, solid_solution, stress_field
from texmap_opt.tet_source import part_tets
from texmap_opt.warp.grid import Grid
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.stress_driver import StressSamples, stress_driver
from texmap_opt.warping_function.warping_function import WarpingFunction


def plane(point: list[float], normal: list[float]) -> dict[str, Any]:
    """A region of a case."""
    return {"plane": {"point": point, "normal": normal}}


def bolt(x: float, y: float) -> dict[str, Any]:
    """The wall of one of the bracket's bolt holes, held."""
    hole = {"from": [x, y, 0.0], "to": [x, y, 12.0], "radius": 4.2}
    return {"region": {"cylinder": hole}}


PIN = {"cylinder": {"from": [0.0, -10.0, 42.0], "to": [0.0, 10.0, 42.0], "radius": 8.2}}
ALONG_X, ALONG_Z = [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]

# Supports and loads of the built-in parts, and an edge of tets [mm].
LOADED: dict[str, dict[str, Any]] = {
    "cantilever": {
        "analysis": {"element": "tet10", "edge_mm": 5.0},
        "support": [{"region": plane([0.0, 0.0, 0.0], ALONG_X)}],
        "load": [{"region": plane([100.0, 0.0, 0.0], ALONG_X), "force_N": [0.0, 0.0, -500.0]}],
    },
    "l-bracket": {
        "analysis": {"element": "tet10", "edge_mm": 5.0},
        "support": [{"region": plane([0.0, 0.0, 80.0], ALONG_Z)}],
        "load": [{"region": plane([80.0, 0.0, 0.0], ALONG_X), "force_N": [0.0, 0.0, -500.0]}],
    },
    "torsion-bar": {
        "analysis": {"element": "tet10", "edge_mm": 4.0},
        "support": [{"region": plane([0.0, 0.0, 0.0], ALONG_X)}],
        "load": [{"region": plane([100.0, 0.0, 0.0], ALONG_X), "moment_Nmm": [10_000.0, 0.0, 0.0]}],
    },
    "bracket": {
        "analysis": {"element": "tet10", "edge_mm": 4.0},
        "support": [bolt(30, 20), bolt(-30, 20), bolt(-30, -20), bolt(30, -20)],
        "load": [
            {"case": "lift", "region": PIN, "force_N": [0.0, 0.0, 4000.0]},
            {"case": "push", "region": PIN, "force_N": [2500.0, 0.0, 0.0]},
        ],
    },
}


@dataclass(frozen=True, eq=False)
class PartStress:
    """A part with its stress.

    Attributes:
        case: what it was computed from.
        part: the part.
        stress: at the nodes of its tets.
    """

    case: DesignCase
    part: Part
    stress: StressField

    def grid(self, cell_mm: float) -> Grid:
        """The uniform grid of cells of about this edge, with a margin of one."""
        extent = np.ptp(self.part.bounds, axis=0)
        cells = tuple(int(n) for n in np.maximum(np.rint(extent / cell_mm), 1))
        return Grid.around(Box.aligned(self.part.bounds), cells, margin_cells=1, radius_mm=0.0)

    def function(self, grid: Grid, *, contrast: float) -> WarpingFunction:
        """What von Mises stress asks of a grid, smoothed over one cell."""
        smoothing_mm = float(grid.uniform_edge.mean())
        background = BackgroundGrid.covering(grid.box, smoothing_mm)
        samples = StressSamples.from_mesh(self.stress.mesh, self.stress.stress)
        driven = stress_driver(samples, background, smoothing_mm=smoothing_mm)
        return driven.function(background, SizeLaw(contrast=contrast))


def builtin_stress(name: str) -> PartStress:
    """One of `LOADED`."""
    return _analysed({"part": {"builtin": name}, **LOADED[name]})


def clamped_and_pressed(file: Path, *, unit: str, edge_mm: float) -> PartStress:
    """Any part, clamped in its lowest tenth along z and pressed down on its highest.

    Args:
        file: of the surface.
        unit: of its coordinates.
        edge_mm: of the tets.
    """
    table = {"file": str(file.resolve()), "unit": unit}
    analysis = {"element": "tet10", "edge_mm": edge_mm}
    # A first case without regions that fit, to know where the part is.
    low, high = read_part(_case({"part": table, **LOADED["cantilever"]}).part).bounds
    beyond, band = 0.01 * (high - low), 0.1 * (high[2] - low[2])
    bottom = [(low - beyond).tolist(), [*(high + beyond)[:2].tolist(), float(low[2] + band)]]
    top = [[*(low - beyond)[:2].tolist(), float(high[2] - band)], (high + beyond).tolist()]
    return _analysed(
        {
            "part": table,
            "analysis": analysis,
            "support": [{"region": {"box": bottom}}],
            "load": [{"region": {"box": top}, "force_N": [0.0, 0.0, -1000.0]}],
        }
    )


def _case(tables: dict[str, Any]) -> DesignCase:
    common = {
        "material": {"name": "AlSi10Mg"},
        "lattice": {"cell": "octet", "cell_mm": 5.0, "radius_mm": 0.5},
        "warp": {"method": "least-squares"},
    }
    return DesignCase.from_tables({**common, **tables}, Path("case.toml"))


def _analysed(tables: dict[str, Any]) -> PartStress:
    case, cache = _case(tables), StageCache.default()
    part = read_part(case.part)
    mesh = part_tets(case, part, cache, solve=partial(solid_solution, case))
    return PartStress(case, part, stress_field(case, mesh))
