"""A part as the walls of an extruded (2.5-D) lattice see it: an outline, and a depth at every place.

The model: walls stand along the axis of extrusion through the whole part. In the plane normal to it
the lattice ends at the part's silhouette, the outline of its shadow; holes through the part along
the axis are holes of the silhouette. Along the axis a wall is as deep as the part is there, wherever
that depth begins: where the part is hollow or undercut, the pieces of a wall one above the other
count as one wall whose depth is their sum. That is exact for the volume of the walls and for forces
in their plane as long as the pieces of a wall move together; a part of two flanges that only a thin
neck holds together is stiffer in this model than it is.
"""

import numpy as np
from jaxtyping import Float

from texmap_opt.combine.boolean import prism, shadow
from texmap_opt.part import Part
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.chords import chords
from texmap_opt.structure.plane_axes import plane_axes
from texmap_opt.structure.structure import Extrusion, Structure

# Points of the outline this close to a line between others, over the part's diagonal, add nothing:
# coordinates of an STL are known to 1e-7 of their size.
OUTLINE_TOLERANCE = 1e-7
# Half the height of the prism over a silhouette, in diagonals of the part: its ends are farther off
# than any wall of the outline, so that distances to it are distances to the outline.
PRISM_REACH = 1.0
# Lines along the axis, on either side of a wall, by which its depth is found. An even number: none is
# in the middle, where symmetric lattices meet the edges of the part's facets.
LINES = 6
# How far beside the middle of a wall those lines lie, over the part's diagonal: ten times as far as
# a point may be off the surface and still lie on it.
BESIDE = 1e-5


def silhouette(surface: TriMesh, axis: Float[np.ndarray, " 3"]) -> TriMesh:
    """The prism over a solid's shadow along an axis: what a lattice is trimmed to in the plane.

    Args:
        surface: closed, outward oriented [mm].
        axis: unit vector.
    """
    axes = plane_axes(axis)
    diagonal = float(np.linalg.norm(np.ptp(surface.bounds, axis=0)))
    outline = shadow(surface, axes, tolerance=OUTLINE_TOLERANCE * diagonal)
    ends = np.array([-PRISM_REACH, PRISM_REACH]) * diagonal
    return prism(outline, axes, float(surface.bounds.mean(axis=0) @ axis) + ends)


def wall_depths(
    structure: Structure, extrusion: Extrusion, part: Part
) -> Float[np.ndarray, " struts"]:
    """Depth of each wall inside a part, the mean over its length [mm].

    Chords along the axis of extrusion at Gauss points of each wall, just beside its middle on both
    sides: a wall in a side of the part, of which half is inside, has half the part's depth.

    Args:
        structure: joints and walls.
        extrusion: of the structure.
        part: what the walls stand in.
    """
    length, weight = _chords_beside(structure, extrusion, part)
    return _mean(length, weight)


def thickness_inside(
    structure: Structure, extrusion: Extrusion, part: Part
) -> Float[np.ndarray, " struts"]:
    """Share of each wall's thickness that is in a part: a half in its sides, else all of it.

    The wall's depth over the mean of the chords that there are. Depth over this share is how deep the
    wall is where it is inside; the product of depth and thickness is the same.

    Args:
        structure: joints and walls.
        extrusion: of the structure, with the depths of its walls in the part.
        part: what the walls stand in.
    """
    length, weight = _chords_beside(structure, extrusion, part)
    deep = _mean(length, weight * (length > 0))
    share = np.ones(len(deep))
    np.divide(extrusion.depth, deep, out=share, where=deep > 0)
    return np.minimum(share, 1.0)


def _chords_beside(
    structure: Structure, extrusion: Extrusion, part: Part
) -> tuple[Float[np.ndarray, "struts samples"], Float[np.ndarray, "struts samples"]]:
    """Chords of the part on both sides of each wall [mm], and their weights; unknown ones have none."""
    start, end = np.moveaxis(structure.joints[structure.struts], 1, 0)
    along = end - start
    across = np.cross(extrusion.axis, along)
    across *= BESIDE * part.diagonal / np.linalg.norm(across, axis=1, keepdims=True)
    t, weight = np.polynomial.legendre.leggauss(LINES)
    middle = start[:, None] + (1 + t[:, None]) / 2 * along[:, None]
    points = np.stack([middle + across[:, None], middle - across[:, None]], axis=1)
    length = chords(part.surface, points.reshape(-1, 3), extrusion.axis).reshape(-1, 2 * LINES)
    known = np.isfinite(length)
    return np.where(known, length, 0.0), known * np.tile(weight, 2)


def _mean(
    values: Float[np.ndarray, "struts samples"], weights: Float[np.ndarray, "struts samples"]
) -> Float[np.ndarray, " struts"]:
    """Weighted mean of each row, zero where nothing has weight."""
    total = (values * weights).sum(axis=1)
    return total / np.maximum(weights.sum(axis=1), np.finfo(float).tiny)
