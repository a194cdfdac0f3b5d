"""Where a part is solid because it is too thin to have a hollow between two skins."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from texmap_opt.combine import boolean
from texmap_opt.combine.depth_field import FarField
from texmap_opt.combine.offset import level_surface
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh

# What is this many depths away from the inner wall is solid for want of room; what is nearer may
# just be in a corner of the skin: at most the square root of 3 depths in that of a cube.
SOLID_DEPTHS = 2.0
# Accuracy of the regions' surface, in depths.
TOLERANCE_SHARE = 0.1
# Edge of the smallest cube that is called a region, in depths.
SPECK_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class SolidRegions:
    """Regions of a part without a hollow: thin walls, tips, sharp edges.

    Attributes:
        volumes_mm3: of each, falling [mm³].
        centres: their centroids [mm].
    """

    volumes_mm3: Float[np.ndarray, " regions"]
    centres: Float[np.ndarray, "regions 3"]


def solid_regions(part: TriMesh, inner: TriMesh, depth: float) -> SolidRegions:
    """What of a part is farther than two depths from the inner wall of its skin.

    Args:
        part: closed surface of the part [mm].
        inner: the inner wall, closed [mm].
        depth: thickness of the skin [mm].

    Raises:
        SolidError: a boolean failed.
    """
    field = FarField(SignedDistance(part), SignedDistance(inner), SOLID_DEPTHS * depth)
    level = level_surface(field, part.bounds, TOLERANCE_SHARE * depth, cube=depth)
    shells = boolean.shells(level) if len(level.faces) else []
    shells = [shell for shell in shells if shell.volume > (SPECK_SHARE * depth) ** 3]
    shells.sort(key=lambda shell: -shell.volume)
    return SolidRegions(
        np.array([shell.volume for shell in shells]),
        np.array([_centroid(shell) for shell in shells]).reshape(-1, 3),
    )


def _centroid(solid: TriMesh) -> Float[np.ndarray, " 3"]:
    """Centre of the enclosed volume [mm]."""
    # Tetrahedra from one corner of the box to the triangles.
    start = solid.bounds[0]
    corners = solid.vertices[solid.faces] - start
    share = np.linalg.det(corners)
    return start + np.einsum("n,nx->x", share, corners.sum(axis=1)) / (4 * share.sum())
