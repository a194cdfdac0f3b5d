"""Distance to a part in the coordinates of a grid's box, in three dimensions or in two."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from texmap_opt.box import Box
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh

# Thickness that an extruded part is given, over its longest side: top and bottom are then farther
# off than any wall, and a wall with a draft of 45 degrees is as far off as its cross-section to 1e-4.
STRETCHED = 100.0


@dataclass(frozen=True, eq=False)
class PartDistance:
    """Signed distance to a part's surface, or, in two dimensions, to its outline.

    The outline is that of the cross-section half way along the extrusion. It is found by stretching
    the part about that plane until its walls are normal to it and its ends out of reach.

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
        low, high = self.box.bounds[:, 2]
        along = self.box.axes[2]
        more = max(STRETCHED * float(self.box.extent.max()) / (high - low), 1.0) - 1.0
        height = self.surface.vertices @ along - (low + high) / 2
        stretched = self.surface.vertices + more * height[:, None] * along
        return SignedDistance(TriMesh(stretched, self.surface.faces))
