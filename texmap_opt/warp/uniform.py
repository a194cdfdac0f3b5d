"""The baseline of every comparison: no warp."""

from texmap_opt.warp.hex_grid import HexGrid
from texmap_opt.warp.warp import AbstractWarp, WarpResult
from texmap_opt.warping_function.warping_function import WarpingFunction


class Uniform(AbstractWarp):
    """Leaves every cell as it is."""

    def fit(self, grid: HexGrid, f: WarpingFunction) -> WarpResult:
        """The uniform grid over the box of `grid`; the warping function is not asked."""
        return WarpResult(HexGrid.uniform(grid.box, grid.cells), "uniform", 0, converged=True)
