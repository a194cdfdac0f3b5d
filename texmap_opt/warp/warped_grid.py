"""The stage between stress and structure: the case's warp fitted, measured, and let pass or refused."""

from dataclasses import asdict, dataclass, fields

import numpy as np
from jaxtyping import Float

from fea import TetMesh
from texmap_opt.case_sections import WarpSection
from texmap_opt.warp.hex_grid import HexGrid
from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warp.quality import WarpQuality, quality, require_unfolded
from texmap_opt.warp.successive_approximation import SuccessiveApproximation
from texmap_opt.warp.uniform import Uniform
from texmap_opt.warp.warp import AbstractWarp
from texmap_opt.warping_function.stress_driver import StressSamples, stress_driver
from texmap_opt.warping_function.warping_function import SizeLaw

METHODS: dict[str, AbstractWarp] = {
    "uniform": Uniform(),
    "successive-approximation": SuccessiveApproximation(),
    "least-squares": LeastSquares(),
}

# Standard deviation of the smoothing in edges of a uniform cell. Half an edge is the least that a
# grid of such cells can follow; with a whole one the solver needs half the steps.
SMOOTHING_CELLS = 1.0


@dataclass(frozen=True, eq=False)
class WarpedGrid:
    """A grid without folds, and how it came about.

    Attributes:
        grid: the warped grid.
        method, iterations, converged, message: see `WarpResult`.
        quality: its measures.
        wanted_size: wanted size at the centre of each cell, relative to a uniform cell.
    """

    grid: HexGrid
    method: str
    iterations: int
    converged: bool
    message: str
    quality: WarpQuality
    wanted_size: Float[np.ndarray, " cells"]

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Everything as arrays, for the cache; None becomes NaN."""
        return {
            "nodes": self.grid.nodes,
            "box": self.grid.box,
            "method": np.array(self.method),
            "message": np.array(self.message),
            "iterations": np.array(self.iterations),
            "converged": np.array(self.converged),
            "wanted_size": self.wanted_size,
            "quality": np.array(
                [np.nan if v is None else v for v in asdict(self.quality).values()]
            ),
        }

    @staticmethod
    def from_arrays(arrays: dict[str, np.ndarray]) -> "WarpedGrid":
        """The inverse of `to_arrays`."""
        measures = {}
        for field, value in zip(fields(WarpQuality), arrays["quality"], strict=True):
            whole = field.type is int
            measures[field.name] = (
                int(value) if whole else None if np.isnan(value) else float(value)
            )
        return WarpedGrid(
            grid=HexGrid(arrays["nodes"], arrays["box"]),
            method=str(arrays["method"]),
            iterations=int(arrays["iterations"]),
            converged=bool(arrays["converged"]),
            message=str(arrays["message"]),
            quality=WarpQuality(**measures),
            wanted_size=arrays["wanted_size"],
        )


def warped_grid(
    section: WarpSection,
    mesh: TetMesh,
    stress: Float[np.ndarray, "cases nodes 6"],
    plan: HexGrid,
) -> WarpedGrid:
    """Warp a grid by a stress field, as `[warp]` asks.

    Args:
        section: method, exponent, contrast.
        mesh: the tets that carry the stress.
        stress: recovered at the nodes [MPa].
        plan: the uniform grid.

    Raises:
        WarpError: the warp folds (with the count), or nothing drives it.
    """
    function = stress_driver(
        StressSamples.from_mesh(mesh, stress),
        plan.box,
        smoothing_mm=SMOOTHING_CELLS * float(plan.uniform_edge.mean()),
        law=SizeLaw(exponent=section.exponent, contrast=section.contrast),
    )
    result = METHODS[section.method].fit(plan, function)
    measured = quality(result.grid, function)
    require_unfolded(result, measured)
    return WarpedGrid(
        grid=result.grid,
        method=result.method,
        iterations=result.iterations,
        converged=result.converged,
        message=result.message,
        quality=measured,
        wanted_size=np.asarray(function.size(result.grid.centres)),
    )
