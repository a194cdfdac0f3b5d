"""Arrows for loads and cones for supports, as triangles."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from texmap_opt.report.scenes import Action, Mark
from texmap_opt.report.tubes import tubes
from texmap_opt.solid.tri_mesh import TriMesh

# Sizes as fractions of the part's diagonal.
ARROW_LENGTH = 0.13
CONE_LENGTH = 0.028
POINT_DISTANCE = 0.075
LEAST_RING, LARGEST_RING = 0.05, 0.11

# Shape of an arrow, as fractions of its length.
SHAFT_RADIUS, HEAD_RADIUS, HEAD_LENGTH = 0.035, 0.1, 0.3

# Axes reach this far past the surface they cross; their radius. Fractions of its largest coordinate.
AXIS_BEYOND, AXIS_RADIUS = 0.18, 0.008

# Below this cosine to the normal a force shears.
SHEARS = 0.35

MOST_POINTS = 12
SAMPLES = 1500
SIDES = 24

# Weyl sequence of the plastic number: evenly spread without a random generator
# (Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
WEYL = np.array([0.7548776662466927, 0.5698402909980532])


def spread_points(
    patch: TriMesh, distance: float
) -> tuple[Float[np.ndarray, "samples 3"], Float[np.ndarray, "samples 3"]]:
    """Points on the patch about `distance` [mm] apart (at most 12), and the normals there."""
    cumulative = np.cumsum(patch.face_areas)
    position = (np.arange(SAMPLES) + 0.5) / SAMPLES * cumulative[-1]
    face = np.minimum(np.searchsorted(cumulative, position), len(cumulative) - 1)
    s, t = np.moveaxis((np.arange(SAMPLES)[:, None] * WEYL) % 1, 1, 0)
    fold = s + t > 1
    s, t = np.where(fold, 1 - s, s)[:, None], np.where(fold, 1 - t, t)[:, None]
    a, b, c = np.moveaxis(patch.vertices[patch.faces[face]], 1, 0)
    points = a + s * (b - a) + t * (c - a)
    chosen = [int(np.argmin(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    gap = np.linalg.norm(points - points[chosen[0]], axis=1)
    while gap.max() > distance and len(chosen) < MOST_POINTS:
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return points[chosen], patch.face_normals[face[chosen]]


def arrows(tails: Float[np.ndarray, "samples 3"], tips: Float[np.ndarray, "samples 3"]) -> TriMesh:
    """Arrows from tails to tips [mm]."""
    reach = tips - tails
    length = np.linalg.norm(reach, axis=1, keepdims=True)
    necks = tips - HEAD_LENGTH * reach
    n = len(tails)
    points = np.concatenate([tails, necks, tips])
    i = np.arange(n)
    struts = np.concatenate([np.stack([i, i + n], 1), np.stack([i + n, i + 2 * n], 1)])
    radii = np.concatenate([length * [[SHAFT_RADIUS, SHAFT_RADIUS]], length * [[HEAD_RADIUS, 0.0]]])
    return tubes(points, struts, radii, sides=SIDES)[0]


def axis_arrows(surface: TriMesh) -> tuple[TriMesh, TriMesh, TriMesh]:
    """An arrow along x, y and z through a surface round the origin, out of it on both sides.

    On both, as the side with the head may be hidden.
    """
    size = float(np.abs(surface.vertices).max())
    low = surface.vertices.min(axis=0) - AXIS_BEYOND * size
    high = surface.vertices.max(axis=0) + AXIS_BEYOND * size
    radii = AXIS_RADIUS * size * np.array([[1.0, 1.0], [3.0, 0.0]])

    def arrow(axis: int) -> TriMesh:
        direction = np.eye(3)[axis]
        stations = np.array([low[axis], high[axis] - 8 * AXIS_RADIUS * size, high[axis]])
        ends = np.array([[0, 1], [1, 2]])
        return tubes(stations[:, None] * direction, ends, radii, sides=SIDES)[0]

    return arrow(0), arrow(1), arrow(2)


@dataclass(frozen=True, eq=False)
class Glyph:
    """What stands for a mark.

    Attributes:
        shape: its triangles.
        anchors: places beside which its number may be written [mm].
    """

    shape: TriMesh
    anchors: Float[np.ndarray, "samples 3"]


def glyph(mark: Mark, part: TriMesh) -> Glyph:
    """The mark's cones, arrows or round arrow."""
    if mark.action is Action.SUPPORT:
        return _support_cones(mark, part)
    if mark.action is Action.MOMENT:
        return _moment_ring(mark, part)
    tails, tips = _arrow_ends(mark, part)
    pushes = mark.action is Action.PRESSURE or mark.action is Action.GRAVITY
    return Glyph(arrows(tails, tips), tails if pushes else np.concatenate([tails, tips]))


def _arrow_ends(mark: Mark, part: TriMesh) -> tuple[np.ndarray, np.ndarray]:
    """Tails and tips: tips on the surface, tails where it pulls, beside it where it shears."""
    length = ARROW_LENGTH * diagonal(part)
    step = length * _unit(mark.direction)
    if not len(mark.patch.faces):
        # Gravity: outside the part, its tip at the bounding box.
        low, high = part.bounds
        half = np.abs(step) / length @ (high - low) / 2
        tip = (low + high) / 2 - half * step / length
        return (tip - step)[None], tip[None]
    points, normals = spread_points(mark.patch, POINT_DISTANCE * diagonal(part))
    if mark.action is Action.PRESSURE:
        return points + length * normals, points
    if mark.action is Action.SUCTION:
        return points, points + length * normals
    outward = float(step @ normals.mean(axis=0)) / length
    if abs(outward) < SHEARS:
        centres = points + 2 * HEAD_RADIUS * length * normals
        return centres - step / 2, centres + step / 2
    return (points, points + step) if outward > 0 else (points - step, points)


def _support_cones(mark: Mark, part: TriMesh) -> Glyph:
    # They stand on the surface from outside, tips on it, as in textbooks.
    length = CONE_LENGTH * diagonal(part)
    tips, normals = spread_points(mark.patch, POINT_DISTANCE * diagonal(part))
    n = len(tips)
    i = np.arange(n)
    radii = np.broadcast_to([0.5 * length, 0.0], (n, 2)).copy()
    bases = tips + length * normals
    shape = tubes(np.concatenate([bases, tips]), np.stack([i, i + n], 1), radii, sides=SIDES)[0]
    return Glyph(shape, tips + 1.9 * length * normals)


def _moment_ring(mark: Mark, part: TriMesh) -> Glyph:
    # About the axis through the patch's centroid, by the right-hand rule.
    size = diagonal(part)
    areas = mark.patch.face_areas
    centroid = areas @ mark.patch.vertices[mark.patch.faces].mean(axis=1) / areas.sum()
    out = areas @ mark.patch.face_normals / areas.sum()
    radius = np.clip(np.sqrt(areas.sum() / np.pi), LEAST_RING * size, LARGEST_RING * size)
    axis = _unit(mark.direction)
    u = _unit(np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))]))
    v = np.cross(axis, u)
    # Three quarters of a turn of shaft, then the head along the tangent.
    angle = np.radians(np.linspace(0, 270, 145))[:, None]
    path = centroid + 0.35 * radius * out + radius * (np.cos(angle) * u + np.sin(angle) * v)
    tip = path[-1] + 0.55 * radius * _unit(path[-1] - path[-2])
    i = np.arange(len(path))
    radii = np.full((len(i), 2), 0.07 * radius)
    radii[-1] = [0.2 * radius, 0.0]
    points = np.concatenate([path, tip[None]])
    shape = tubes(points, np.stack([i, i + 1], 1), radii, sides=SIDES)[0]
    return Glyph(shape, path[::18])


def diagonal(surface: TriMesh) -> float:
    """Diagonal of the bounding box [mm]."""
    return float(np.linalg.norm(surface.bounds[1] - surface.bounds[0]))


def _unit(vector: Sequence[float] | np.ndarray) -> np.ndarray:
    return np.asarray(vector, float) / max(float(np.linalg.norm(vector)), np.finfo(float).tiny)
