"""The stage between stress and structure: the case's warp fitted, measured, and let pass or refused."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from texmap_opt.box import Box
from texmap_opt.endless_lattice import EndlessLattice
from texmap_opt.warp.alignment import alignment_for
from texmap_opt.warp.driving_function import driving_function
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warp.occupied import occupied_volume
from texmap_opt.warp.quality import (
    WarpQuality,
    energies,
    quality_for,
    require_unfolded,
    stresses,
    wanted_sizes,
)
from texmap_opt.warp.successive_approximation import SuccessiveApproximation
from texmap_opt.warp.uniform import Uniform
from texmap_opt.warp.warp import AbstractWarp
from texmap_opt.warp_inputs import WarpInputs


@dataclass(frozen=True, eq=False)
class WarpedGrid:
    """A grid without folds, and how it came about.

    Attributes:
        grid: the warped grid.
        method, iterations, converged, message, measures: see `WarpResult`.
        quality: its measures; without energies, see `with_energies`.
        f: the warping function at the centre of each cell, within its contrast limit.
        wanted_size: wanted size at the centre of each cell, relative to a uniform cell.
        stress: there, over its root mean square in the part, along the axes of the box; no cases
            where none is known.
        occupied_mm3: volume of the part in each cell [mm³].
    """

    grid: Grid
    method: str
    iterations: int
    converged: bool
    message: str
    measures: dict[str, float]
    quality: WarpQuality
    f: Float[np.ndarray, " cells"]
    wanted_size: Float[np.ndarray, " cells"]
    stress: Float[np.ndarray, "cases cells d d"]
    occupied_mm3: Float[np.ndarray, " cells"]

    def with_energies(self, lattice: EndlessLattice | None) -> "WarpedGrid":
        """With the energies of `quality` for the lattice of these cells; None: it has none."""
        stiffness = None if lattice is None else lattice.stiffness
        found = energies(self.grid, self.stress, stiffness, self.occupied_mm3)
        return replace(self, quality=replace(self.quality, **found))

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Everything as arrays, for the cache; None becomes NaN."""
        arrays = {
            "nodes": self.grid.nodes,
            "axes": self.grid.box.axes,
            "bounds": self.grid.box.bounds,
            "dimensions": np.array(self.grid.dimensions),
            "method": np.array(self.method),
            "message": np.array(self.message),
            "iterations": np.array(self.iterations),
            "converged": np.array(self.converged),
            "measure_names": np.array(list(self.measures), dtype=str),
            "measures": np.array(list(self.measures.values()), dtype=float),
            "quality": np.array(
                [np.nan if v is None else float(v) for v in asdict(self.quality).values()]
            ),
            "f": self.f,
            "wanted_size": self.wanted_size,
            "stress": self.stress,
            "occupied_mm3": self.occupied_mm3,
        }
        if self.grid.fixed is not None:
            arrays["fixed"] = self.grid.fixed
        return arrays

    @staticmethod
    def from_arrays(arrays: dict[str, np.ndarray]) -> "WarpedGrid":
        """The inverse of `to_arrays`."""
        box = Box(arrays["axes"], arrays["bounds"], int(arrays["dimensions"]))
        named = zip(arrays["measure_names"], arrays["measures"], strict=True)
        quality_of: dict[str, Any] = {}
        for field, value in zip(fields(WarpQuality), arrays["quality"], strict=True):
            number = int(value) if field.type is int else float(value)
            quality_of[field.name] = None if np.isnan(value) else number
        return WarpedGrid(
            grid=Grid(arrays["nodes"], box, arrays.get("fixed")),
            method=str(arrays["method"]),
            iterations=int(arrays["iterations"]),
            converged=bool(arrays["converged"]),
            message=str(arrays["message"]),
            measures={str(name): float(value) for name, value in named},
            quality=WarpQuality(**quality_of),
            f=arrays["f"],
            wanted_size=arrays["wanted_size"],
            stress=arrays["stress"],
            occupied_mm3=arrays["occupied_mm3"],
        )


def warped_grid(inputs: WarpInputs) -> WarpedGrid:
    """Warp a grid as `[warp]` asks.

    Raises:
        CaseError: a driver does not fit the part.
        WarpError: the warp folds (with the count), or nothing drives it.
    """
    function = driving_function(inputs)
    result = METHODS[inputs.section.method](inputs).fit(inputs.grid, function)
    occupied = occupied_volume(result.grid, inputs.surface)
    wanted, stress = wanted_sizes(result.grid, function), stresses(result.grid, function)
    measured = quality_for(result.grid, wanted, stress, weights=occupied)
    require_unfolded(result, measured)
    return WarpedGrid(
        grid=result.grid,
        method=result.method,
        iterations=result.iterations,
        converged=result.converged,
        message=result.message,
        measures=result.measures,
        quality=measured,
        f=np.asarray(function.f(result.grid.centres)),
        wanted_size=wanted,
        stress=stress,
        occupied_mm3=occupied,
    )


def _uniform(inputs: WarpInputs) -> AbstractWarp:
    return Uniform()


def _successive_approximation(inputs: WarpInputs) -> AbstractWarp:
    warp = inputs.section
    return SuccessiveApproximation(
        weights=warp.weights, relaxation=warp.relaxation, eps=warp.eps, max_sweeps=warp.max_sweeps
    )


def _least_squares(inputs: WarpInputs) -> AbstractWarp:
    warp = inputs.section
    stiffness = None if inputs.lattice is None else inputs.lattice.stiffness
    follows = {"surface": inputs.surface, "surface_weight": warp.conform} if warp.conform else {}
    return LeastSquares(
        size_weight=warp.size_weight,
        alignment=alignment_for(
            warp.target, stiffness, warp.alignment, dimensions=inputs.grid.dimensions
        ),
        gtol=warp.tolerance,
        max_steps=warp.max_steps,
        **follows,
    )


METHODS: dict[str, Callable[[WarpInputs], AbstractWarp]] = {
    "uniform": _uniform,
    "successive-approximation": _successive_approximation,
    "least-squares": _least_squares,
}
