"""How well a solid prints: trapped powder, thin walls, narrow gaps, overhangs, the STL round trip.

What a printer can do depends on machine and material, so that numbers are reported and limits are
given by whoever knows them; without any, only what no process prints is told.
"""

from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Float

from texmap_opt.errors import InputError
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.facing_walls import FacingWalls, facing_walls
from texmap_opt.solid.overhang import (
    UP,
    USUAL_LIMIT_DEG,
    Overhang,
    StrutOverhang,
    overhang,
    strut_overhang,
)
from texmap_opt.solid.stl_round_trip import AfterStl, after_stl
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.solid.validity import ValidityReport
from texmap_opt.solid.voids import ClosedVoids, closed_voids
from texmap_opt.structure.structure import Structure

# Relative: a wall that is this much thinner than the limit keeps to it. Above the rounding of
# float32 files, below what any process can tell.
LIMIT_SLACK = 1e-3
# Walls thinner than this are below the spot of a laser and the nozzle of an extruder [mm]. Told of
# where much of the area is: where struts meet a skin, slivers that nobody misses are thinner.
LEAST_WALL_MM = 0.1
# Share of the surface above which a better build direction is told of, and what it must save.
NOTABLE_SHARE = 0.2
NOTABLE_SAVING = 0.25


@dataclass(frozen=True, eq=False)
class PrintLimits:
    """What the process asks for.

    Attributes:
        build_direction: vector away from the build plate, of any length.
        overhang_deg: angle to the plate that prints without supports [degrees].
        wall_mm: thinnest wall or strut [mm]; None: no limit was given.
        gap_mm: narrowest gap [mm]; None: no limit was given.
    """

    build_direction: tuple[float, float, float] = UP
    overhang_deg: float = USUAL_LIMIT_DEG
    wall_mm: float | None = None
    gap_mm: float | None = None

    def __post_init__(self) -> None:
        """Refuse what is no limit.

        Raises:
            InputError: naming the option of `texmap check`.
        """
        if not (np.isfinite(self.build_direction).all() and any(self.build_direction)):
            raise InputError(
                f"--build-direction {self.build_direction}: must be three numbers, not all zero."
            )
        if not 0 <= self.overhang_deg <= 90:
            raise InputError(
                f"--overhang {self.overhang_deg:g}: must be an angle from 0 to 90 degrees."
            )
        for name, value in (("--min-wall", self.wall_mm), ("--min-gap", self.gap_mm)):
            if value is not None and not (value > 0 and np.isfinite(value)):
                raise InputError(f"{name} {value:g}: must be a length above 0 [mm].")

    @property
    def direction(self) -> Float[np.ndarray, " 3"]:
        """The build direction as a unit vector."""
        vector = np.array(self.build_direction, dtype=float)
        vector /= np.abs(vector).max()
        return vector / np.linalg.norm(vector)


@dataclass(frozen=True, eq=False)
class Printability:
    """What was found.

    Attributes:
        closed_voids: where powder is trapped.
        walls: thickness of walls and struts.
        gaps: air between walls, closed voids included.
        overhang: what needs supports.
        struts: struts that lie too flatly; None where the solid's struts are not known.
        after_stl: what is left after a round trip through an STL file.
        violations: limits that were given and are not kept, in sentences.
        warnings: what else is likely to go wrong, in sentences.
    """

    closed_voids: ClosedVoids
    walls: FacingWalls
    gaps: FacingWalls
    overhang: Overhang
    struts: StrutOverhang | None
    after_stl: AfterStl
    violations: list[str]
    warnings: list[str]

    def as_dict(self) -> dict:
        """Everything, as `texmap check` prints it."""
        return asdict(self)


def printability(
    surface: TriMesh,
    validity: ValidityReport,
    *,
    limits: PrintLimits | None = None,
    structure: Structure | None = None,
    given: TriMesh | None = None,
) -> Printability | None:
    """Measure what decides about printing.

    Args:
        surface: what is printed [mm].
        validity: what was found on it.
        limits: of the process; absent: built along +z with 45 degrees, no other limits.
        structure: the struts in it, where they are known.
        given: see `texmap_opt.solid.validity.validity`.

    Returns:
        None where the surface is not watertight: it has no inside to measure.
    """
    if not validity.watertight:
        return None
    limits = limits or PrintLimits()
    returned = after_stl(surface, validity, given=given)
    query = SignedDistance(surface)
    voids = closed_voids(query) if validity.closed_voids else ClosedVoids(0, 0.0, [])
    walls, gaps = facing_walls(query, "solid"), facing_walls(query, "air")
    how = {"direction": limits.direction, "limit_deg": limits.overhang_deg}
    hanging = overhang(query, **how)
    return Printability(
        closed_voids=voids,
        walls=walls,
        gaps=gaps,
        overhang=hanging,
        struts=None if structure is None else strut_overhang(structure, **how),
        after_stl=returned,
        violations=_violations(limits, walls, gaps),
        warnings=_warnings(limits, voids, walls, hanging, returned),
    )


def _violations(limits: PrintLimits, walls: FacingWalls, gaps: FacingWalls) -> list[str]:
    asked = (
        ("wall or strut", walls, limits.wall_mm, "thicken it"),
        ("gap", gaps, limits.gap_mm, "widen or close it"),
    )
    return [
        f"the smallest {what} is {found.smallest_mm:.4g} mm, at {_place(found)}, below the "
        f"{limit:g} mm asked for{_most(found)}: {remedy}"
        for what, found, limit, remedy in asked
        if limit is not None
        and found.smallest_mm is not None
        and found.smallest_mm < (1 - LIMIT_SLACK) * limit
    ]


def _warnings(
    limits: PrintLimits,
    voids: ClosedVoids,
    walls: FacingWalls,
    hanging: Overhang,
    returned: AfterStl,
) -> list[str]:
    told = []
    if voids.count:
        where = ", ".join(f"{c:.4g}" for c in voids.largest[0].inside_mm)
        told.append(
            f"{_rounded(voids.total_mm3)} mm³ of powder or resin are trapped in {voids.count} closed "
            f"void{'s, the largest' if voids.count > 1 else ''} at ({where}) mm: leave regions of the "
            "skin open, or add drain holes"
        )
    thin = walls.percentile_5_mm
    if limits.wall_mm is None and thin is not None and thin < LEAST_WALL_MM:
        told.append(
            f"one twentieth of the walls' area is at most {thin:.3g} mm thick, below "
            f"the {LEAST_WALL_MM:g} mm that print"
        )
    better = hanging.best_share <= (1 - NOTABLE_SAVING) * hanging.share
    if hanging.share > NOTABLE_SHARE and better:
        along = ", ".join(f"{c:.3g}" for c in hanging.best_direction)
        told.append(
            f"{100 * hanging.share:.3g} % of the surface face down at less than {hanging.limit_deg:g} "
            f"degrees to the build plate and need supports; built along ({along}) it is "
            f"{100 * hanging.best_share:.3g} %"
        )
    if not returned.same:
        faults = "; ".join(returned.faults) or "its shells or handles differ"
        told.append(
            f"rounded to the float32 of an STL file it is another solid: {faults}; move it closer to "
            "the origin, or make its finest details coarser"
        )
    return told


def _most(found: FacingWalls) -> str:
    """How much of the area keeps to what."""
    if found.percentile_5_mm is None:
        return ""
    return f" (95 % of the area between walls has {found.percentile_5_mm:.4g} mm or more)"


def _place(found: FacingWalls) -> str:
    return f"({', '.join(f'{c:.4g}' for c in found.smallest_at_mm or [])}) mm"


def _rounded(volume: float) -> str:
    """A volume for readers: whole numbers from a hundred on."""
    return f"{volume:,.0f}" if volume >= 100 else f"{volume:.3g}"
