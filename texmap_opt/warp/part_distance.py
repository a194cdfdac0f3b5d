"""Distance to a part in the coordinates of a grid's box, in three dimensions or in two."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from texmap_opt.box import Box
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.silhouette import silhouette


@dataclass(frozen=True, eq=False)
class PartDistance:
    """Signed distance to a part's surface, or, in two dimensions, to the outline of its shadow.

    That is where walls end: see `silhouette`.

    Attributes:
        surface: closed, counter-clockwise seen from outside [mm].
        box: whose coordinates points are given in.
    """

    surface: TriMesh
    box: Box

    def __call__(self, points: Float[np.ndarray, "samples d"]) -> Float[np.ndarray, " samples"]:
        """Distance [mm], negative inside, of points given by coordinates in the box [mm]."""
        return self._query(self.box.positions(points))[0]

    @cached_property
    def _query(self) -> SignedDistance:
        if self.box.dimensions == 3:
            return SignedDistance(self.surface)
        return SignedDistance(silhouette(self.surface, self.box.axes[2]))
