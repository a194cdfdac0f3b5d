"""The baseline of every comparison: no warp."""

from texmap_opt.warp.grid import Grid
from texmap_opt.warp.warp import AbstractWarp, WarpResult
from texmap_opt.warping_function.warping_function import WarpingFunction


class Uniform(AbstractWarp):
    """Leaves every cell as it is."""

    def fit(self, grid: Grid, f: WarpingFunction) -> WarpResult:
        """The uniform grid over the box of `grid`; the warping function is not asked."""
        return WarpResult(grid.at_rest, "uniform", 0, converged=True)
