"""The part with a lattice inside: skin and rods, rods alone, or the lattice as a void.

With M the part, S the lattice solid and O the part's inner offset by the skin's thickness:

    rod, skin:     M - (O - S)  =  (M - O) + (S and M)
    rod:           M and S
    plate, skin:   M - (S and O)
    plate:         M - S

Written this way the outer surface stays the designer's own facets, and no coincident faces meet.
"""

from dataclasses import dataclass

import numpy as np

from texmap_opt.combine import boolean
from texmap_opt.combine.offset import Offset, offset_inward
from texmap_opt.errors import SolidError
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.edges import Edges
from texmap_opt.solid.tri_mesh import TriMesh

# A piece that hangs on nothing and has less than this share of the largest piece's volume is a chip
# that the part's surface cut off a strut; a larger one is a part of the design that came loose.
CHIP_SHARE = 1e-4


@dataclass(frozen=True, eq=False)
class Result:
    """The finished solid and what was done to get it.

    Attributes:
        surface: one connected solid [mm].
        offset: the inner wall of the skin; None without a skin.
        chips: loose chips removed.
        chip_volume_mm3: their volume [mm³].
    """

    surface: TriMesh
    offset: Offset | None
    chips: int
    chip_volume_mm3: float


def rod_result(part: TriMesh, lattice: TriMesh, *, skin_mm: float, tolerance_mm: float) -> Result:
    """The lattice inside the part, under a skin unless `skin_mm` is 0.

    Args:
        part: surface M of the part [mm].
        lattice: surface S of the lattice solid [mm]; may stand out of the part.
        skin_mm: thickness of the skin [mm].
        tolerance_mm: bound on the skin's thickness error [mm].

    Raises:
        SolidError: when the skin leaves no room, a boolean fails, or the result falls apart.
    """
    if skin_mm == 0:
        return _whole(boolean.intersection(part, lattice), None, "rod")
    offset = _inner_wall(part, skin_mm, tolerance_mm)
    cavity = boolean.difference(offset[1], lattice)
    return _whole(boolean.difference(part, cavity), offset[0], "rod")


def plate_result(part: TriMesh, lattice: TriMesh, *, skin_mm: float, tolerance_mm: float) -> Result:
    """The part with the lattice as a void, closed by a skin unless `skin_mm` is 0.

    Args:
        part: surface M of the part [mm].
        lattice: surface S of the void [mm]; may stand out of the part.
        skin_mm: thickness of the skin [mm].
        tolerance_mm: bound on the skin's thickness error [mm].

    Raises:
        SolidError: when the skin leaves no room, a boolean fails, or the result falls apart.
    """
    if skin_mm == 0:
        return _whole(boolean.difference(part, lattice), None, "plate")
    offset = _inner_wall(part, skin_mm, tolerance_mm)
    void = boolean.intersection(lattice, offset[1])
    return _whole(boolean.difference(part, void), offset[0], "plate")


def _inner_wall(part: TriMesh, skin_mm: float, tolerance_mm: float) -> tuple[Offset, TriMesh]:
    offset = offset_inward(part, skin_mm, tolerance_mm)
    if offset.surface is None:
        raise SolidError(
            f"skin_mm = {skin_mm:g} leaves no room: largest inscribed radius is "
            f"{offset.inscribed_radius_mm:.3g} mm. Choose a thinner skin."
        )
    return offset, offset.surface


def _whole(surface: TriMesh, offset: Offset | None, kind: str) -> Result:
    """The result without chips.

    Raises:
        SolidError: when nothing is left, or more than one piece that is not a chip.
    """
    if not len(surface.faces):
        raise SolidError(
            f"Nothing is left of the {kind} result: the lattice "
            + ("does not meet the part." if kind == "rod" else "fills the whole part.")
            + " Use smaller cells or another radius_mm."
        )
    edges = Edges(surface)
    volumes = edges.shell_volumes
    largest = float(volumes.max())
    pieces = int((volumes > CHIP_SHARE * largest).sum())
    if pieces > 1:
        raise SolidError(
            f"The result falls into {pieces} pieces that do not touch: a thicker skin_mm or "
            "radius_mm, or smaller cells, would join them."
        )
    chips = np.flatnonzero((volumes > 0) & (volumes <= CHIP_SHARE * largest))
    if not len(chips):
        return Result(surface, offset, 0, 0.0)
    gone = np.isin(edges.shell_of_face, chips)
    gone |= _voids_of(surface, edges, gone)
    kept = surface.select(~gone)
    return Result(kept, offset, len(chips), surface.volume - kept.volume)


def _voids_of(surface: TriMesh, edges: Edges, chips: np.ndarray) -> np.ndarray:
    """Faces of closed voids that lie inside the given chips."""
    voids = np.flatnonzero(edges.shell_volumes < 0)
    first = np.searchsorted(np.sort(edges.shell_of_face), voids)
    face = np.argsort(edges.shell_of_face, kind="stable")[first]
    points = surface.vertices[surface.faces[face, 0]]
    inside = SignedDistance(surface.select(chips)).contains(points)
    return np.isin(edges.shell_of_face, voids[inside])
