"""Round holes through a skin into the void inside: where they start, how deep they go, what they cut."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from texmap_opt.case_openings import Drain
from texmap_opt.combine import boolean
from texmap_opt.errors import InputError
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh

# Points of the hole's rim from which its length is measured.
RIM_POINTS = 24
# Corners of the hole's section, at least.
LEAST_CORNERS = 16
# A hole that must go deeper than this many skins and diameters does not lead through a skin but
# through a part that is too thin to be hollow.
DEEPEST_SKINS = 3.0
DEEPEST_DIAMETERS = 1.0
# How far behind the inner wall a hole ends, in tolerances: clear of what the wall may be off.
END_TOLERANCES = 2.0
# Share of the hole's section that must lead into the void: less would be blocked by a strut.
OPEN_SHARE = 0.25


@dataclass(frozen=True, eq=False)
class DrainHole:
    """A drain hole that was made.

    Attributes:
        point: its middle on the surface of the part [mm].
        direction: unit vector into the part.
        length_mm: from that point to its end in the void [mm].
        open_share: share of its section that leads into the void; struts may stand in the rest.
        solid: the cylinder that is cut away.
    """

    point: Float[np.ndarray, " 3"]
    direction: Float[np.ndarray, " 3"]
    length_mm: float
    open_share: float
    solid: TriMesh


def drain_holes(
    part: TriMesh,
    inner: TriMesh,
    drains: Sequence[Drain],
    *,
    void: Callable[[TriMesh], TriMesh],
    skin_mm: float,
    tolerance_mm: float,
) -> tuple[DrainHole, ...]:
    """The cylinders from outside the part to just behind the skin's inner wall.

    Args:
        part: closed surface of the part [mm].
        inner: the inner wall of its skin, closed [mm].
        drains: where holes are wanted.
        void: what of a solid is hollow in the end.
        skin_mm: thickness of the skin [mm].
        tolerance_mm: bound on the distance of the section's sides from the circle [mm].

    Raises:
        InputError: a hole points out of the part, reaches no void, or is blocked.
    """
    outside, wall = SignedDistance(part), SignedDistance(inner)
    holes: list[tuple[np.ndarray, np.ndarray, float, TriMesh]] = []
    ends: list[TriMesh] = []
    for drain in drains:
        point, direction = _start(drain, outside)
        axes = _axes(direction)
        height = _height(drain, point - tolerance_mm * direction, axes, outside) + tolerance_mm
        deepest = DEEPEST_SKINS * skin_mm + DEEPEST_DIAMETERS * drain.diameter_mm
        behind = _depth(drain, point, axes, wall, deepest)
        length = behind + END_TOLERANCES * tolerance_mm
        solids = [
            _cylinder(drain.diameter_mm, axes, point, heights, tolerance_mm)
            for heights in ((-height, length), (behind, length))
        ]
        holes.append((point, direction, length, solids[0]))
        ends.append(solids[1])
    hollow = void(boolean.union(ends))
    shares = [_open_share(drain, hollow, end) for drain, end in zip(drains, ends, strict=True)]
    return tuple(
        DrainHole(point, direction, length, share, solid)
        for (point, direction, length, solid), share in zip(holes, shares, strict=True)
    )


def _start(
    drain: Drain, outside: SignedDistance
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    _, face, closest = outside.unsigned(drain.point[None])
    inward = 0.0 - outside.surface.face_normals[face[0]]
    if drain.direction is None:
        return closest[0], inward
    if drain.direction @ inward <= 0:
        raise InputError(
            f"{drain.where} direction: leads out of the part, whose surface faces "
            f"{_shown(-inward)} there; turn it round."
        )
    return closest[0], drain.direction


def _axes(direction: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Unit vectors as rows, right-handed, the last along the hole."""
    across = np.zeros(3)
    across[np.argmin(np.abs(direction))] = 1.0
    first = np.cross(across, direction)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first), direction])


def _section(diameter: float, axes: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "n 3"]:
    """Points of the hole's section from its middle: that, and the rim."""
    angle = np.arange(RIM_POINTS) * 2 * np.pi / RIM_POINTS
    rim = diameter / 2 * (np.cos(angle)[:, None] * axes[0] + np.sin(angle)[:, None] * axes[1])
    return np.concatenate([np.zeros((1, 3)), rim])


def _height(drain: Drain, point: np.ndarray, axes: np.ndarray, outside: SignedDistance) -> float:
    """How far outside of a point above the surface the hole must start to be clear of it [mm]."""
    points = point + _section(drain.diameter_mm, axes)
    buried = points[outside.contains(points)]
    paths, _ = outside.first_hit(buried, np.tile(-axes[2], (len(buried), 1)))
    height = float(np.max(paths, initial=0.0))
    if not height <= drain.diameter_mm:
        raise InputError(
            f"{drain.where}: the surface about {_shown(point)} mm rises {height:.3g} mm within the hole "
            f"of {drain.diameter_mm:g} mm; give a smaller diameter or another point."
        )
    # A start in the surface itself would leave slivers.
    return height + drain.diameter_mm / 4


def _depth(
    drain: Drain, point: np.ndarray, axes: np.ndarray, wall: SignedDistance, deepest: float
) -> float:
    """How deep the hole goes until all of its section is behind the inner wall [mm]."""
    points = point + _section(drain.diameter_mm, axes)
    paths, _ = wall.first_hit(points, np.tile(axes[2], (len(points), 1)))
    if not paths[0] <= deepest:
        raise InputError(
            f"{drain.where}: there is no hollow within {deepest:.3g} mm behind {_shown(point)} mm, where "
            "the part is too thin for one; give another point or direction."
        )
    # Beside an edge of the void some of the rim may miss it.
    return float(paths[paths <= deepest].max())


def _cylinder(
    diameter: float,
    axes: np.ndarray,
    point: np.ndarray,
    heights: tuple[float, float],
    tolerance: float,
) -> TriMesh:
    """A prism about the hole's axis whose section has the area of the circle."""
    radius = diameter / 2
    sagitta = min(tolerance / radius, 0.5)
    corners = max(LEAST_CORNERS, int(np.ceil(np.pi / np.arccos(1 - sagitta))))
    angle = np.arange(corners) * 2 * np.pi / corners
    wide = radius * np.sqrt(2 * np.pi / (corners * np.sin(2 * np.pi / corners)))
    outline = wide * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    upright = boolean.prism([outline], axes, np.array(heights))
    return TriMesh(upright.vertices + point, upright.faces)


def _open_share(drain: Drain, hollow: TriMesh, end: TriMesh) -> float:
    """Share of the hole's section, just behind the inner wall, that leads into the void."""
    share = boolean.intersection(hollow, end).volume / end.volume
    if share < OPEN_SHARE:
        raise InputError(
            f"{drain.where}: only {100 * share:.0f} % of the hole leads into the void, the lattice stands "
            "in the way; give another point or a larger diameter."
        )
    return share


def _shown(vector: np.ndarray) -> str:
    return "[" + ", ".join(f"{x:.4g}" for x in vector) + "]"
