"""What a warp is: a grid in, a moved grid and how it went out."""

import abc
from dataclasses import dataclass

import equinox as eqx

from texmap_opt.warp.hex_grid import HexGrid
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
    """

    grid: HexGrid
    method: str
    iterations: int
    converged: bool
    message: str = ""


class AbstractWarp(eqx.Module):
    """A way to move the nodes of a grid so that its cells follow a warping function."""

    @abc.abstractmethod
    def fit(self, grid: HexGrid, f: WarpingFunction) -> WarpResult:
        """Warps the box of `grid` with its number of cells, starting from the uniform grid."""
