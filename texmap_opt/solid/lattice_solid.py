"""The lattice as one solid: lofted struts and spherical joints, or extruded walls, united."""

import numpy as np

from texmap_opt.combine.boolean import union
from texmap_opt.errors import LatticeError
from texmap_opt.solid.extruded import extruded_solid
from texmap_opt.solid.joints import ball_within, balls
from texmap_opt.solid.struts import lofts, round_ring, segments_within, square_ring
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.structure import Structure


def lattice_solid(
    structure: Structure, *, tolerance_mm: float, segments: int | None = None
) -> TriMesh:
    """Closed surface of the union of all struts and joints.

    Struts are polygons of the circle's area (or squares), so that their volume is right; joints are
    spheres that contain the ends of their struts. Everything is turned deterministically, so that
    no facets coincide. For walls see `extruded_solid`.

    Args:
        structure: joints, struts and radii [mm].
        tolerance_mm: largest distance of a polygon from its circle, for the thickest strut.
        segments: sides of a round strut, or of the joints of walls; absent: as many as
            `tolerance_mm` asks for (8 to 24).

    Raises:
        LatticeError: for no struts, a radius that is not positive, or a strut without length.
        SolidError: when the union fails.
    """
    _check(structure)
    if structure.extrusion is not None:
        return extruded_solid(
            structure, structure.extrusion, tolerance_mm=tolerance_mm, segments=segments
        )
    thickest = float(structure.radii.max())
    round_section = structure.section == "round"
    sides = segments or segments_within(tolerance_mm, thickest)
    ring = round_ring(sides) if round_section else square_ring()
    # A square strut is turned by its frame alone: its flats must not spin from strut to strut.
    start, end = (structure.joints[structure.struts[:, k]] for k in (0, 1))
    pieces = lofts(start, end, structure.radii, ring, turned=round_section)
    reach = np.zeros(len(structure.joints))
    outermost = float(np.linalg.norm(ring, axis=1).max())
    np.maximum.at(reach, structure.struts.ravel(), outermost * structure.radii.ravel())
    used = np.flatnonzero(reach > 0)
    pieces += balls(structure.joints[used], reach[used], ball_within(sides))
    return union(pieces)


def _check(structure: Structure) -> None:
    if not len(structure.struts):
        raise LatticeError("The lattice has no struts: use smaller cells or a larger part.")
    if not (np.isfinite(structure.radii).all() and (structure.radii > 0).all()):
        worst = int(np.argmin(structure.radii.min(axis=1)))
        raise LatticeError(
            f"Strut {worst} has radius {float(structure.radii[worst].min()):g} mm; radii must be "
            "above 0: raise radius_mm or min_radius_mm."
        )
    lengths = structure.lengths()
    if not (lengths > 0).all():
        raise LatticeError(
            f"Strut {int(np.argmin(lengths))} has no length: its joints coincide; weld the "
            "structure first."
        )
