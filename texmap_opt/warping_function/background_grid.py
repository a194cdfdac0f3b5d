"""The regular grid on which a warping function is stored."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from texmap_opt.box import Box
from texmap_opt.errors import WarpError

# Nodes beyond the box on each side. A cubic spline reads one node beyond its interval, and the
# mirror condition at the grid's border fades by 0.27 per node: two leave 7 % of it at the box.
PADDING = 2

# Largest grid: a convolution on it takes about 0.5 GB.
MAX_NODES = 2_000_000


@dataclass(frozen=True, eq=False)
class BackgroundGrid:
    """Regular nodes covering a box, and `PADDING` nodes more on every side.

    Attributes:
        box: what is covered; its coordinates are those of the grid.
        origin: coordinates of the first node [mm].
        spacing: distance of neighbouring nodes along each axis [mm].
        shape: number of nodes along each axis.
    """

    box: Box
    origin: Float[np.ndarray, " d"]
    spacing: Float[np.ndarray, " d"]
    shape: tuple[int, ...]

    @classmethod
    def covering(cls, box: Box, spacing_mm: float) -> "BackgroundGrid":
        """The grid whose spacing is the largest not above `spacing_mm` that divides each edge.

        Raises:
            WarpError: if the box is empty, or the grid would be too large.
        """
        if not np.all(box.extent > 0) or not spacing_mm > 0:
            raise WarpError(
                f"The box of the warp measures {' x '.join(f'{x:g}' for x in box.extent)} mm "
                f"and its background spacing {spacing_mm:g} mm; all must be positive: give the "
                "part a volume, or take smaller cells."
            )
        # The small slack keeps rounding from adding an interval to an edge that divides evenly.
        intervals = np.maximum(np.ceil(box.extent / spacing_mm - 1e-9).astype(int), 1)
        nodes = intervals + 1 + 2 * PADDING
        if np.prod(nodes.astype(float)) > MAX_NODES:
            raise WarpError(
                f"A background grid of {spacing_mm:g} mm over the box needs "
                f"{np.prod(nodes.astype(float)):.0f} nodes; the limit is {MAX_NODES}. "
                "Smooth over a longer distance, or take larger cells."
            )
        spacing = box.extent / intervals
        return cls(box, box.low - PADDING * spacing, spacing, tuple(int(n) for n in nodes))

    @property
    def points(self) -> Float[np.ndarray, "*controls d"]:
        """Coordinates of all nodes [mm]."""
        axes = [
            origin + h * np.arange(n)
            for origin, h, n in zip(self.origin, self.spacing, self.shape, strict=True)
        ]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)

    @property
    def positions(self) -> Float[np.ndarray, "*controls 3"]:
        """The nodes in space [mm]."""
        return self.box.positions(self.points)
