"""What a warp is: a grid in, a moved grid and how it went out."""

import abc
from dataclasses import dataclass, field

import equinox as eqx
import numpy as np

from texmap_opt.errors import WarpError
from texmap_opt.warp.grid import Grid
from texmap_opt.warping_function.warping_function import WarpingFunction


@dataclass(frozen=True, eq=False)
class WarpResult:
    """A warped grid, folded or not: `quality.require_unfolded` decides whether it may be used.

    Attributes:
        grid: the moved grid; its outer nodes are still on the faces of its box.
        method: name of the method, as in the case file.
        iterations: steps of the method.
        converged: whether the method reached its own criterion.
        message: why it did not converge, and what to try; empty when it did.
        measures: what the method says of its end beside that, such as the gradient's norm.
    """

    grid: Grid
    method: str
    iterations: int
    converged: bool
    message: str = ""
    measures: dict[str, float] = field(default_factory=dict)


class AbstractWarp(eqx.Module):
    """A way to move the nodes of a grid so that its cells follow a warping function."""

    @abc.abstractmethod
    def fit(self, grid: Grid, f: WarpingFunction) -> WarpResult:
        """Warps the box of `grid` with its number of cells, starting from the uniform grid."""


def require_layers(grid: Grid, method: str) -> None:
    """Lets only grids with something to move pass.

    Raises:
        WarpError: if there is only one cell along an axis.
    """
    if min(grid.cells) < 2:
        thin = grid.cells.index(min(grid.cells))
        along = np.abs(grid.box.axes[thin])
        axis = "xyz"[int(np.argmax(along))] if along.max() > 1 - 1e-9 else f"axis {thin + 1}"
        raise WarpError(
            f"The grid has {' x '.join(map(str, grid.cells))} cells, only one along {axis}, so the "
            f'warp "{method}" has nothing to move there: give at least 2, a margin, or the method '
            '"uniform".'
        )
