"""The part of a surface that keeps its skin, and what openings leave without.

The skin of a part with openings is what lies within its thickness of the rest of the surface. So a
wall beside an opening keeps its full thickness up to the rim, where it ends in a quarter round; the
mouth of an opening in a flat face is its region less the thickness all round; and the surface away
from the opening is untouched.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from texmap_opt.case_openings import Opening
from texmap_opt.combine.offset import SAMPLES, spread_points
from texmap_opt.combine.region_cut import cut_by_region
from texmap_opt.errors import InputError
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh

# Share of the tolerance for the border of an opening: what the offset leaves of it.
BORDER_SHARE = 0.2


@dataclass(frozen=True, eq=False)
class OpenedSurface:
    """A part's surface without the regions of openings.

    Attributes:
        kept: loose triangles of what keeps its skin [mm].
        mouths_mm2: area of the hole that each opening makes in the surface [mm²].
    """

    kept: TriMesh
    mouths_mm2: tuple[float, ...]


def opened_surface(
    part: TriMesh, openings: Sequence[Opening], *, skin_mm: float, tolerance_mm: float
) -> OpenedSurface:
    """What of a part's surface keeps its skin.

    Args:
        part: closed surface of the part [mm].
        openings: one or more.
        skin_mm: thickness of the skin [mm].
        tolerance_mm: bound on the error of the skin [mm].

    Raises:
        InputError: an opening misses the surface or is too narrow to open anything, or nothing is
            left to have a skin.
    """
    kept, patches = part, []
    for opening in openings:
        patch, kept = cut_by_region(kept, opening.region, BORDER_SHARE * tolerance_mm)
        if not len(patch.faces):
            low, high = part.bounds
            raise InputError(
                f"{opening.where}: {opening.region.describe()} holds nothing of the part's surface "
                "that an opening before it leaves; the part spans "
                f"[{_shown(low)}] to [{_shown(high)}] mm."
            )
        patches.append(patch)
    if not len(kept.faces):
        raise InputError(
            f"{openings[-1].where}: leaves nothing of the surface to have a skin; give [lattice] "
            "skin_mm = 0 for a lattice without one."
        )
    distance, mouths = SignedDistance(kept), []
    for opening, patch in zip(openings, patches, strict=True):
        far, _, _ = distance.unsigned(spread_points(patch, SAMPLES))
        mouths.append(float((far > skin_mm).mean() * patch.face_areas.sum()))
        if not mouths[-1]:
            raise InputError(
                f"{opening.where}: opens nothing: {opening.region.describe()} is nowhere farther than "
                f"{far.max():.3g} mm from the rest of the surface, whose skin is {skin_mm:g} mm "
                "thick; make it wider."
            )
    return OpenedSurface(kept, tuple(mouths))


def _shown(point) -> str:
    return ", ".join(f"{x:.4g}" for x in point)
