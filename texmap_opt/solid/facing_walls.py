"""How far apart walls are that face each other: through the solid (thickness), or the air (gaps).

At points spread over the surface a ray along the normal meets the opposite wall; the chord between
them counts where that wall faces back. The shortest chords are then moved until the ball around
their middle touches nothing nearer: what remains is the diameter of a largest ball that touches
the surface at two opposite points, as in the thickness of Hildebrand and Rüegsegger (1997).

Where two walls meet in an edge (a concave corner for gaps, a knife edge for thickness), balls
between them shrink to nothing. Such chords are left out: those between walls at more than
`FACING_DEG`, and those between walls whose planes meet on the surface itself.

Not seen: walls that come close only with an edge, whose faces look elsewhere.
"""

import itertools
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.surface_points import points_by_area, points_by_face

# Points spread over the area, of which quantiles are taken.
AREA_SAMPLES = 40_000
# Of these, so many are measured for the quantiles.
QUANTILE_SAMPLES = 4000
# Every so many triangles one is looked at, so that no strut is left out: the sides of a strut with
# eight of them are sixteen triangles, one after the other. But no more than this many: 4 s of rays.
FACE_STRIDE = 16
MOST_FACE_SAMPLES = 400_000
# Chords from there are followed to this many times the smallest distance known by then: what is
# less they find as chords that short, or by moving those.
FOLLOWED = 1.2
# Walls that face each other to within this angle [degrees]; a polygon of seven sides, whose
# opposite sides are turned by 26, still has a thickness.
FACING_DEG = 30.0
# Walls at a larger angle than 5 degrees [its sine] meet somewhere; within this share of their
# distance from the surface, they meet there. Those at less are parallel for a printer.
MEETING_SINE = 0.09
MEETING_REACH = 0.1
# Shortest chords that are moved at a time, and how often each: every move halves the way that is
# left or better, so that the last is far below the chord.
MOVED_CHORDS = 1000
MOVES = 12
# Where this many of the shortest hold no ball, of the next so many every second is looked at, then
# every fourth: among the pores of a lattice most chords are not between two walls.
DENSE_CHORDS = 10_000
# A ball is empty when the surface is at most this share of its radius inside: sides of a polygon
# are that far inside the circle that the opposite ones hold. It is probed along the axes and the
# diagonals, since the nearest face to the centre of a finely meshed sphere takes long to find.
EMPTY = 0.02
PROBES = np.array(
    [p for p in itertools.product((-1.0, 0.0, 1.0), repeat=3) if sum(map(abs, p)) in (1, 3)]
)
PROBES /= np.linalg.norm(PROBES, axis=1, keepdims=True)
# Relative change of a width below which a moved chord is as long as before: moves between parallel
# walls end in their middle.
SAME_WIDTH = 1e-6
# Share of the diagonal by which rays start off the surface: above rounding, below any wall.
LIFT = 1e-7


@dataclass(frozen=True, eq=False)
class FacingWalls:
    """Distances between walls that face each other, at sampled points.

    Attributes:
        samples: points of the surface that were looked at for the smallest distance.
        smallest_mm: smallest distance found [mm]; None where no walls face each other.
        smallest_at_mm: point half way between them [mm].
        quantile_samples: points between walls, spread over the area, that the quantiles are of.
        percentile_5_mm: distance that 95 % of the area between walls exceeds [mm]; None where none
            of the points spread over the area lies between walls.
        median_mm: distance that half of it exceeds [mm].
    """

    samples: int
    smallest_mm: float | None = None
    smallest_at_mm: list[float] | None = None
    quantile_samples: int = 0
    percentile_5_mm: float | None = None
    median_mm: float | None = None


@dataclass(frozen=True, eq=False)
class _Chords:
    """Straight ways from walls to the walls opposite.

    Attributes:
        start: their first points [mm].
        direction: unit vectors along them, perpendicular to the first wall.
        away: unit normals of the second wall, out of what the chord runs through.
        width: length [mm].
    """

    start: Float[np.ndarray, "n 3"]
    direction: Float[np.ndarray, "n 3"]
    away: Float[np.ndarray, "n 3"]
    width: Float[np.ndarray, " n"]

    @property
    def middle(self) -> Float[np.ndarray, "n 3"]:
        """Points half way [mm]."""
        return self.start + 0.5 * self.width[:, None] * self.direction

    def select(self, chosen: Int[np.ndarray, " m"] | Bool[np.ndarray, " n"] | slice) -> "_Chords":
        """Some of them."""
        return _Chords(
            self.start[chosen], self.direction[chosen], self.away[chosen], self.width[chosen]
        )

    def with_replaced(self, which: Int[np.ndarray, " m"], others: "_Chords") -> "_Chords":
        """The same with others in the places `which`."""
        replaced = _Chords(*(column.copy() for column in vars(self).values()))
        for column, new in zip(vars(replaced).values(), vars(others).values(), strict=True):
            column[which] = new
        return replaced

    def apexes(self) -> tuple[Int[np.ndarray, " m"], Float[np.ndarray, "m 3"]]:
        """Which have walls at an angle w, and where their planes meet [mm], width/tan(w) aside."""
        cosine = np.einsum("ij,ij->i", self.away, self.direction)
        across = self.away - cosine[:, None] * self.direction
        sine = np.linalg.norm(across, axis=1)
        oblique = np.flatnonzero(sine > MEETING_SINE)
        along = (self.width * cosine)[oblique] / sine[oblique] ** 2
        return oblique, self.start[oblique] + along[:, None] * across[oblique]


def facing_walls(
    query: SignedDistance, through: Literal["solid", "air"], *, seed: int = 0
) -> FacingWalls:
    """Distances between facing walls of a closed surface.

    Args:
        query: distance queries of the surface, closed and oriented outwards [mm].
        through: the solid between them (thickness) or the air (gaps, closed voids included).
        seed: of the sampled points.
    """
    surface, random = query.surface, np.random.default_rng(seed)
    side = -1.0 if through == "solid" else 1.0
    points, face = points_by_area(surface, AREA_SAMPLES, random)
    by_area, _ = _chords(query, points, side * surface.face_normals[face], side)
    smallest = _smallest(query, by_area, side)
    within = np.inf if smallest is None else FOLLOWED * smallest[0]
    count = min(max(AREA_SAMPLES, len(surface.faces) // FACE_STRIDE), MOST_FACE_SAMPLES)
    more, face = points_by_face(surface, count, random)
    by_face, _ = _chords(query, more, side * surface.face_normals[face], side, within=within)
    found = [ball for ball in (smallest, _smallest(query, by_face, side)) if ball is not None]
    samples = len(points) + len(more)
    if not found:
        return FacingWalls(samples)
    diameter, centre = min(found, key=lambda ball: ball[0])
    some = by_area.select(slice(None, None, -(-AREA_SAMPLES // QUANTILE_SAMPLES)))
    widths, _ = _held(query, some.select(~_meet(query, some)))
    if not len(widths):
        return FacingWalls(samples, diameter, centre.tolist())
    low, median = (float(width) for width in np.quantile(widths, (0.05, 0.5)))
    return FacingWalls(samples, diameter, centre.tolist(), len(widths), low, median)


def _chords(
    query: SignedDistance,
    points: Float[np.ndarray, "n 3"],
    directions: Float[np.ndarray, "n 3"],
    side: float,
    *,
    within: float = np.inf,
) -> tuple[_Chords, Int[np.ndarray, " m"]]:
    """From points along unit vectors to walls that face back, and which of the points have one."""
    lift = LIFT * float(np.linalg.norm(np.diff(query.surface.bounds, axis=0)))
    path, face = query.first_hit(points + lift * directions, directions, within=within)
    away = -side * query.surface.face_normals[face]
    faces = np.einsum("ij,ij->i", away, directions) > np.cos(np.radians(FACING_DEG))
    which = np.flatnonzero(faces & np.isfinite(path))
    chords = _Chords(points[which], directions[which], away[which], path[which] + lift)
    return chords, which


def _meet(query: SignedDistance, chords: _Chords) -> Bool[np.ndarray, " n"]:
    """Whether the walls at both ends of chords meet in an edge of the surface."""
    oblique, apex = chords.apexes()
    meet = np.zeros(len(chords.width), dtype=bool)
    meet[oblique] = query.unsigned(apex)[0] < MEETING_REACH * chords.width[oblique]
    return meet


def _smallest(
    query: SignedDistance, chords: _Chords, side: float
) -> tuple[float, Float[np.ndarray, " 3"]] | None:
    """Diameter and centre of the smallest ball that facing walls hold; None where there is none."""
    order = np.argsort(chords.width, kind="stable")
    smallest = None
    start, stride = 0, 1
    while start < len(order):
        if smallest is not None and smallest[0] <= chords.width[order[start]]:
            break
        end = start + MOVED_CHORDS * stride
        block = chords.select(order[start:end:stride])
        start, stride = end, stride if end < DENSE_CHORDS else 2 * stride
        block = _moved(query, block.select(~_meet(query, block)), side)
        diameter, centre = _held(query, block.select(~_meet(query, block)))
        if len(diameter):
            least = int(np.argmin(diameter))
            if smallest is None or diameter[least] < smallest[0]:
                smallest = float(diameter[least]), centre[least]
    return smallest


def _moved(query: SignedDistance, chords: _Chords, side: float) -> _Chords:
    """Chords through the wall nearest to their middles, unless that makes them longer."""
    moving = np.arange(len(chords.width))
    for _ in range(MOVES):
        middle, width = chords.middle[moving], chords.width[moving]
        pierced = np.flatnonzero(_pierced(query, middle, width / 2))
        middle, moving, width = middle[pierced], moving[pierced], width[pierced]
        reach, _, nearest = query.unsigned(middle)
        directions = (middle - nearest) / np.maximum(reach, np.finfo(float).tiny)[:, None]
        # Longer ones would not be taken.
        within = (1 + SAME_WIDTH) * float(width.max(initial=0.0))
        found, which = _chords(query, nearest, directions, side, within=within)
        shorter = found.width < (1 + SAME_WIDTH) * width[which]
        moving = moving[which[shorter]]
        if not len(moving):
            break
        chords = chords.with_replaced(moving, found.select(shorter))
    return chords


def _held(
    query: SignedDistance, chords: _Chords
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Diameters and centres of the balls that both ends of chords hold, where these are empty."""
    diameter, centre = chords.width.copy(), chords.middle
    oblique, apex = chords.apexes()
    # Between walls at an angle the centre is on the plane that halves it.
    out = chords.direction[oblique] - chords.away[oblique]
    # Of a unit vector along each wall's normal the sum is twice the sine of half the angle.
    twice_sine = np.linalg.norm(out, axis=1)
    from_apex = np.linalg.norm(centre[oblique] - apex, axis=1)
    diameter[oblique] = from_apex * twice_sine
    centre[oblique] = apex + (from_apex / twice_sine)[:, None] * out
    empty = ~_pierced(query, centre, diameter / 2)
    return diameter[empty], centre[empty]


def _pierced(
    query: SignedDistance, centre: Float[np.ndarray, "n 3"], radius: Float[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Whether the surface is found inside balls."""
    probes = radius[:, None, None] * PROBES
    starts = np.broadcast_to(centre[:, None], probes.shape)
    path, _ = query.first_hit(starts.reshape(-1, 3), probes.reshape(-1, 3), within=1 - EMPTY)
    hits = np.isfinite(path).reshape(len(centre), len(PROBES))
    return np.asarray(hits.any(axis=1))
