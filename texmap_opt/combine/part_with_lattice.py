"""The part with a lattice inside: skin and rods, rods alone, or the lattice as a void.

With M the part, S the lattice solid, O the part's inner offset by the skin's thickness and H the
drain holes:

    rod, skin:     M - (O - S) - H, where M - (O - S) = (M - O) + (S and M)
    rod:           M and S
    plate, skin:   M - (S and O) - H
    plate:         M - S

Written this way the outer surface stays the designer's own facets, and no coincident faces meet.
With openings O is what is farther than the skin's thickness from the rest of the surface, and comes
out of them (`opened_surface`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from texmap_opt.case_openings import Drain, Opening, require_skin
from texmap_opt.combine import boolean
from texmap_opt.combine.drain_holes import DrainHole, drain_holes
from texmap_opt.combine.offset import Offset, offset_inward
from texmap_opt.combine.opened_surface import OpenedSurface, opened_surface
from texmap_opt.combine.solid_regions import SolidRegions, solid_regions
from texmap_opt.errors import SolidError
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.edges import Edges
from texmap_opt.solid.tri_mesh import TriMesh

# A piece that hangs on nothing and has less than this share of the largest piece's volume is a chip
# that the part's surface cut off a strut; a larger one is a part of the design that came loose.
CHIP_SHARE = 1e-4


@dataclass(frozen=True, eq=False)
class Skin:
    """The skin of a part: what is hollow behind it, and where it is open.

    Attributes:
        offset: its inner wall.
        opened: the surface less its openings; None without openings.
        solid: where the part is too thin to be hollow.
        drains: the drain holes.
    """

    offset: Offset
    opened: OpenedSurface | None
    solid: SolidRegions
    drains: tuple[DrainHole, ...]

    def shell(self, part: TriMesh) -> TriMesh:
        """The skin without the lattice, a closed surface [mm].

        Args:
            part: closed surface of the part [mm].
        """
        inner = [] if self.offset.surface is None else [self.offset.surface]
        return boolean.difference(part, *inner, *(hole.solid for hole in self.drains))


@dataclass(frozen=True, eq=False)
class Result:
    """The finished solid and what was done to get it.

    Attributes:
        surface: one connected solid [mm].
        skin: its skin; None without one.
        chips: loose chips removed.
        chip_volume_mm3: their volume [mm³].
    """

    surface: TriMesh
    skin: Skin | None
    chips: int
    chip_volume_mm3: float

    def notes(self) -> list[str]:
        """What a user should know of it, in sentences."""
        if self.skin is None or not len(self.skin.solid.volumes_mm3):
            return []
        volumes, centres = self.skin.solid.volumes_mm3, self.skin.solid.centres
        many = f"{len(volumes)} regions are" if len(volumes) > 1 else "1 region is"
        place = ", ".join(f"{x:.4g}" for x in centres[0])
        return [
            f"result: {many} too thin to be hollow and solid, {volumes.sum():.3g} mm³ in all, the "
            f"largest of {volumes[0]:.3g} mm³ about [{place}] mm"
        ]


def rod_result(
    part: TriMesh,
    lattice: TriMesh,
    *,
    skin_mm: float,
    tolerance_mm: float,
    openings: Sequence[Opening] = (),
    drains: Sequence[Drain] = (),
) -> Result:
    """The lattice inside the part, under a skin unless `skin_mm` is 0.

    Args:
        part: surface M of the part [mm].
        lattice: surface S of the lattice solid [mm]; may stand out of the part.
        skin_mm: thickness of the skin [mm].
        tolerance_mm: bound on the skin's thickness error [mm].
        openings: regions of the surface without skin.
        drains: holes through the skin.

    Raises:
        InputError: an opening or a drain hole cannot be made.
        SolidError: when the skin leaves no room, a boolean fails, or the result falls apart.
    """
    require_skin((*openings, *drains), skin_mm)
    if skin_mm == 0:
        return _whole(boolean.intersection(part, lattice), None, "rod")
    offset, inner, opened = _inner_wall(part, openings, skin_mm, tolerance_mm)

    def void(solid: TriMesh) -> TriMesh:
        return boolean.difference(boolean.intersection(solid, inner), lattice)

    sizes = {"skin_mm": skin_mm, "tolerance_mm": tolerance_mm}
    holes = drain_holes(part, inner, drains, void=void, **sizes) if drains else ()
    surface = boolean.carved(part, inner, lattice, [hole.solid for hole in holes])
    skin = Skin(offset, opened, solid_regions(part, inner, skin_mm), holes)
    return _whole(surface, skin, "rod")


def plate_result(
    part: TriMesh,
    lattice: TriMesh,
    *,
    skin_mm: float,
    tolerance_mm: float,
    openings: Sequence[Opening] = (),
    drains: Sequence[Drain] = (),
) -> Result:
    """The part with the lattice as a void, closed by a skin unless `skin_mm` is 0.

    Args:
        part: surface M of the part [mm].
        lattice: surface S of the void [mm]; may stand out of the part.
        skin_mm: thickness of the skin [mm].
        tolerance_mm: bound on the skin's thickness error [mm].
        openings: regions of the surface without skin.
        drains: holes through the skin.

    Raises:
        InputError: an opening or a drain hole cannot be made.
        SolidError: when the skin leaves no room, a boolean fails, or the result falls apart.
    """
    require_skin((*openings, *drains), skin_mm)
    if skin_mm == 0:
        return _whole(boolean.difference(part, lattice), None, "plate")
    offset, inner, opened = _inner_wall(part, openings, skin_mm, tolerance_mm)
    hollow = boolean.intersection(lattice, inner)

    def void(solid: TriMesh) -> TriMesh:
        return boolean.intersection(solid, hollow)

    sizes = {"skin_mm": skin_mm, "tolerance_mm": tolerance_mm}
    holes = drain_holes(part, inner, drains, void=void, **sizes) if drains else ()
    surface = boolean.difference(part, hollow, *(hole.solid for hole in holes))
    skin = Skin(offset, opened, solid_regions(part, inner, skin_mm), holes)
    return _whole(surface, skin, "plate")


def _inner_wall(
    part: TriMesh, openings: Sequence[Opening], skin_mm: float, tolerance_mm: float
) -> tuple[Offset, TriMesh, OpenedSurface | None]:
    sizes = {"skin_mm": skin_mm, "tolerance_mm": tolerance_mm}
    opened = opened_surface(part, openings, **sizes) if openings else None
    kept = None if opened is None else opened.kept
    offset = offset_inward(part, skin_mm, tolerance_mm, kept=kept)
    if offset.surface is None:
        raise SolidError(
            f"skin_mm = {skin_mm:g} leaves no room: largest inscribed radius is "
            f"{offset.inscribed_radius_mm:.3g} mm. Choose a thinner skin."
        )
    return offset, offset.surface, opened


def _whole(surface: TriMesh, skin: Skin | None, kind: str) -> Result:
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
        return Result(surface, skin, 0, 0.0)
    gone = np.isin(edges.shell_of_face, chips)
    gone |= _voids_of(surface, edges, gone)
    kept = surface.select(~gone)
    return Result(kept, skin, len(chips), surface.volume - kept.volume)


def _voids_of(surface: TriMesh, edges: Edges, chips: np.ndarray) -> np.ndarray:
    """Faces of closed voids that lie inside the given chips."""
    voids = np.flatnonzero(edges.shell_volumes < 0)
    first = np.searchsorted(np.sort(edges.shell_of_face), voids)
    face = np.argsort(edges.shell_of_face, kind="stable")[first]
    points = surface.vertices[surface.faces[face, 0]]
    inside = SignedDistance(surface.select(chips)).contains(points)
    return np.isin(edges.shell_of_face, voids[inside])
