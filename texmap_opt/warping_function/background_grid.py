"""The regular grid on which a warping function is stored."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

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
        box: lowest and highest corner of what is covered [mm].
        origin: position of the first node [mm].
        spacing: distance of neighbouring nodes along x, y, z [mm].
        shape: number of nodes along x, y, z.
    """

    box: Float[np.ndarray, "2 3"]
    origin: Float[np.ndarray, " 3"]
    spacing: Float[np.ndarray, " 3"]
    shape: tuple[int, int, int]

    @classmethod
    def covering(cls, box: Float[np.ndarray, "2 3"], spacing_mm: float) -> "BackgroundGrid":
        """The grid whose spacing is the largest not above `spacing_mm` that divides each edge.

        Raises:
            WarpError: if the box is empty, or the grid would be too large.
        """
        extent = box[1] - box[0]
        if not np.all(extent > 0) or not spacing_mm > 0:
            raise WarpError(
                f"The box of the warp measures {extent[0]:g} x {extent[1]:g} x {extent[2]:g} mm "
                f"and its background spacing {spacing_mm:g} mm; all must be positive: give the "
                "part a volume, or take smaller cells."
            )
        # The small slack keeps rounding from adding an interval to an edge that divides evenly.
        intervals = np.maximum(np.ceil(extent / spacing_mm - 1e-9).astype(int), 1)
        nodes = intervals + 1 + 2 * PADDING
        if np.prod(nodes.astype(float)) > MAX_NODES:
            raise WarpError(
                f"A background grid of {spacing_mm:g} mm over the box needs "
                f"{np.prod(nodes.astype(float)):.0f} nodes; the limit is {MAX_NODES}. "
                "Smooth over a longer distance, or take larger cells."
            )
        spacing = extent / intervals
        shape = (int(nodes[0]), int(nodes[1]), int(nodes[2]))
        return cls(box, box[0] - PADDING * spacing, spacing, shape)

    @property
    def points(self) -> Float[np.ndarray, "*controls 3"]:
        """Positions of all nodes [mm]."""
        axes = [self.origin[d] + self.spacing[d] * np.arange(self.shape[d]) for d in range(3)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
