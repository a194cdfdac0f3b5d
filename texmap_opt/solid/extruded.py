"""The walls of an extruded (2.5-D) lattice as one solid: a union in the plane, then extruded."""

import numpy as np
from jaxtyping import Float

from texmap_opt.combine.boolean import closing, outline_union, prism
from texmap_opt.solid.struts import round_ring, segments_within
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.plane_axes import plane_axes
from texmap_opt.structure.structure import Extrusion, Structure


def extruded_solid(
    structure: Structure,
    extrusion: Extrusion,
    *,
    tolerance_mm: float,
    segments: int | None = None,
    fillet_mm: float = 0.0,
) -> TriMesh:
    """Closed surface of the union of all walls, from the lower height to the upper one.

    In the plane a wall is a rectangle from joint to joint, a trapezoid where it tapers; a joint is a
    polygon of the area of the circle of its thickest wall. Walls are not cut to their depth in a
    part: the boolean with the part does that.

    Args:
        structure: joints, walls and half their thicknesses [mm].
        extrusion: of the structure.
        tolerance_mm: largest distance of a polygon from its circle, for the thickest wall.
        segments: sides of a joint; absent: as many as `tolerance_mm` asks for (8 to 24).
        fillet_mm: radius of the fillets in the plane [mm]: what a disc of that radius rolled along
            the outside of the walls does not reach is filled.

    Raises:
        SolidError: when the extrusion fails.
    """
    axes = plane_axes(extrusion.axis)
    joints = structure.joints @ axes[:2].T
    radius = np.zeros(len(joints))
    np.maximum.at(radius, structure.struts, structure.radii)
    used = np.flatnonzero(radius)
    ring = round_ring(segments or segments_within(tolerance_mm, float(radius.max())))
    discs = joints[used, None] + radius[used, None, None] * ring
    outline = outline_union([*_rectangles(joints, structure), *discs])
    if fillet_mm > 0:
        outline = closing(outline, fillet_mm, segments=segments_within(tolerance_mm, fillet_mm))
    return prism(outline, axes, np.array([extrusion.low, extrusion.high]))


def _rectangles(
    joints: Float[np.ndarray, "joints 2"], structure: Structure
) -> Float[np.ndarray, "struts 4 2"]:
    """Corners of the walls in the plane, counter-clockwise."""
    start, end = np.moveaxis(joints[structure.struts], 1, 0)
    along = end - start
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    first, second = (structure.radii[:, [k]] * left for k in (0, 1))
    return np.stack([start - first, end - second, end + second, start + first], axis=1)
