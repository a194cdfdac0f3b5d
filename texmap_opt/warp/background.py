"""Where the drivers of a warp leave their fields, and how smooth these are."""

from dataclasses import dataclass

from texmap_opt.case_sections import WarpSection
from texmap_opt.warp.grid import Grid
from texmap_opt.warping_function.background_grid import BackgroundGrid


@dataclass(frozen=True, eq=False)
class Background:
    """A background grid and the smoothing that goes with it.

    Attributes:
        grid: the background grid.
        smoothing_mm: standard deviation of the smoothing [mm].
    """

    grid: BackgroundGrid
    smoothing_mm: float

    @classmethod
    def of(cls, warp: WarpSection, grid: Grid) -> "Background":
        """For a grid of cells: nodes as far apart as the smoothing is wide.

        Raises:
            WarpError: the background grid would be too large.
        """
        smoothing_mm = warp.smoothing_cells * float(grid.uniform_edge.mean())
        return cls(BackgroundGrid.covering(grid.box, smoothing_mm), smoothing_mm)
