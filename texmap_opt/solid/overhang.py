"""What of a solid hangs over too flatly to be printed without supports, by build direction.

The angle of a surface or strut is that to the build plate: 0 is a ceiling or a strut that lies, 90
a wall or a strut that stands. What is at less than the limit needs supports, unless it lies on the
plate.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.surface_points import points_in
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.structure import Structure

UP = (0.0, 0.0, 1.0)
# Angle that most processes print without supports [degrees].
USUAL_LIMIT_DEG = 45.0
# What is within this of the limit keeps to it: rounding to float32 turns small triangles by as much.
ANGLE_SLACK_DEG = 0.1
# What is this close to the lowest point lies on the build plate: about a layer [mm].
FIRST_LAYER_MM = 0.05
# Rays cast down from what hangs over.
SUPPORT_SAMPLES = 20_000
# Share of the diagonal by which they start below it.
LIFT = 1e-7
# Directions that are tried for the best: faces, edges and corners of a cube, upright first.
DIRECTIONS = np.array(
    sorted(
        (p for p in itertools.product((1.0, 0.0, -1.0), repeat=3) if any(p)),
        key=lambda p: (sum(map(abs, p)), p != UP),
    )
)
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
# Share of the area by which another direction must be better than an earlier one.
BETTER = 1e-6


@dataclass(frozen=True, eq=False)
class Overhang:
    """What hangs over.

    Attributes:
        build_direction: unit vector away from the build plate.
        limit_deg: angle to the plate below which surfaces need supports [degrees].
        area_mm2: area that faces down at less than the limit and is not on the plate [mm²].
        share: of the whole area.
        support_volume_mm3: volume straight below that area, down to the plate or to the solid [mm³]:
            what supports fill, though most are sparse.
        support_samples: rays it was measured by; 0 where nothing hangs over.
        best_direction: the one of 26 with the least such area.
        best_share: its share of the whole area.
    """

    build_direction: list[float]
    limit_deg: float
    area_mm2: float
    share: float
    support_volume_mm3: float
    support_samples: int
    best_direction: list[float]
    best_share: float


@dataclass(frozen=True, eq=False)
class StrutOverhang:
    """Struts, or walls, at less than the limit to the build plate and not on it.

    Attributes:
        count: how many.
        length_mm: their length together [mm].
        share: of the length of all.
    """

    count: int
    length_mm: float
    share: float


def overhang(
    query: SignedDistance,
    *,
    direction: Float[np.ndarray, " 3"],
    limit_deg: float = USUAL_LIMIT_DEG,
    seed: int = 0,
) -> Overhang:
    """What of a closed surface hangs over, built along a direction, and along the best one.

    Args:
        query: distance queries of the surface, closed and oriented outwards [mm].
        direction: unit vector away from the build plate.
        limit_deg: angle to the plate that prints without supports [degrees].
        seed: of the rays that measure the volume of supports.
    """
    surface = _without_unused(query.surface)
    total = float(surface.face_areas.sum())
    hanging = _hanging(surface, direction, limit_deg)
    area = float(surface.face_areas[hanging].sum())
    volume, samples = _below(surface, hanging, query, direction, seed)
    shares = np.array(
        [surface.face_areas[_hanging(surface, one, limit_deg)].sum() / total for one in DIRECTIONS]
    )
    best = int(np.argmax(shares <= shares.min() + BETTER))
    return Overhang(
        direction.tolist(),
        limit_deg,
        area,
        area / total,
        volume,
        samples,
        DIRECTIONS[best].tolist(),
        float(shares[best]),
    )


def strut_overhang(
    structure: Structure,
    *,
    direction: Float[np.ndarray, " 3"],
    limit_deg: float = USUAL_LIMIT_DEG,
) -> StrutOverhang:
    """Which struts lie too flatly, or walls lean too far.

    Args:
        structure: joints and struts [mm].
        direction: unit vector away from the build plate.
        limit_deg: angle to the plate that prints without supports [degrees].
    """
    ends = structure.joints[structure.struts]
    along = ends[:, 1] - ends[:, 0]
    length = structure.lengths()
    walls = structure.extrusion
    lower = structure.radii
    if walls is None:
        rise = np.abs(along @ direction) / length
        heights = ends @ direction - lower
    else:
        across = np.cross(along, walls.axis) / length[:, None]
        rise = np.sqrt(np.clip(1 - (across @ direction) ** 2, 0, 1))
        reach = 0.5 * walls.depth[:, None] * abs(float(walls.axis @ direction))
        heights = ends @ direction - lower * np.abs(across @ direction)[:, None] - reach
    flat = np.degrees(np.arcsin(np.clip(rise, 0, 1))) < limit_deg - ANGLE_SLACK_DEG
    hanging = flat & (heights.max(axis=1) > heights.min() + FIRST_LAYER_MM)
    return StrutOverhang(
        int(hanging.sum()),
        float(length[hanging].sum()),
        float(length[hanging].sum() / length.sum()),
    )


def _hanging(
    surface: TriMesh, direction: Float[np.ndarray, " 3"], limit_deg: float
) -> Int[np.ndarray, " hanging"]:
    """Faces that look down at less than the limit to the plate, and are not on it."""
    least = np.cos(np.radians(max(limit_deg - ANGLE_SLACK_DEG, 0.0)))
    hanging = np.flatnonzero(surface.face_normals @ direction < -least)
    heights = surface.vertices @ direction
    on_plate = heights <= heights.min() + FIRST_LAYER_MM
    # One corner first: few faces are near the plate.
    near = np.flatnonzero(on_plate[surface.faces[hanging, 0]])
    return np.delete(hanging, near[on_plate[surface.faces[hanging[near]]].all(axis=1)])


def _below(
    surface: TriMesh,
    hanging: Int[np.ndarray, " hanging"],
    query: SignedDistance,
    direction: Float[np.ndarray, " 3"],
    seed: int,
) -> tuple[float, int]:
    """Volume straight below faces [mm³], and the number of rays that measured it."""
    random = np.random.default_rng(seed)
    # As seen from below, so that every ray stands for the same area.
    seen = surface.face_areas[hanging] * np.abs(surface.face_normals[hanging] @ direction)
    if not seen.sum() > 0:
        return 0.0, 0
    upto = np.cumsum(seen)
    at = (np.arange(SUPPORT_SAMPLES) + random.random(SUPPORT_SAMPLES)) / SUPPORT_SAMPLES * upto[-1]
    faces = hanging[np.minimum(np.searchsorted(upto, at), len(hanging) - 1)]
    points = points_in(surface, faces, random)
    lift = LIFT * float(np.linalg.norm(np.diff(surface.bounds, axis=0)))
    downwards = np.broadcast_to(-direction, points.shape)
    path, _ = query.first_hit(points + lift * downwards, downwards)
    to_plate = points @ direction - float((surface.vertices @ direction).min())
    return float(upto[-1] * np.minimum(path + lift, to_plate).mean()), SUPPORT_SAMPLES


def _without_unused(surface: TriMesh) -> TriMesh:
    """The surface without vertices that no face uses: they would lie on the plate."""
    used = np.zeros(len(surface.vertices), dtype=bool)
    used[surface.faces.reshape(-1)] = True
    return surface if used.all() else surface.select(slice(None))
