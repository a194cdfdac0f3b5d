"""Struts as prisms or tapered lofts between the ends of their axes."""

import numpy as np
from jaxtyping import Float

from texmap_opt.solid.tri_mesh import TriMesh

# Fraction of a turn by which the polygon of each next strut is turned: the golden section, so that
# no two neighbours have parallel facets that would coincide, and no facet lies along an axis plane.
TURN = (np.sqrt(5) - 1) / 2
MIN_SEGMENTS = 8
MAX_SEGMENTS = 24


def segments_within(tolerance: float, radius: float) -> int:
    """Segments of a polygon whose distance to the circle of equal area is at most `tolerance`.

    The corners stand out by r (k - 1) and the sides lie within by r (1 - k cos(pi/n)), k =
    `circumradius_of_equal_area`; the former is the larger. At least 8 (5 % of the radius) and at
    most 24 (0.6 %), beyond which triangles multiply and nothing printed shows it.

    Args:
        tolerance: largest distance [mm].
        radius: of the circle [mm].
    """
    for segments in range(MIN_SEGMENTS, MAX_SEGMENTS):
        if radius * (circumradius_of_equal_area(segments) - 1) <= tolerance:
            return segments
    return MAX_SEGMENTS


def circumradius_of_equal_area(segments: int) -> float:
    """Circumradius of the regular polygon whose area is that of the unit circle."""
    return float(np.sqrt(2 * np.pi / (segments * np.sin(2 * np.pi / segments))))


def round_ring(segments: int) -> Float[np.ndarray, "corners 2"]:
    """Regular polygon with the area of the unit circle, counter-clockwise."""
    angle = 2 * np.pi * np.arange(segments) / segments
    return circumradius_of_equal_area(segments) * np.column_stack([np.cos(angle), np.sin(angle)])


def square_ring() -> Float[np.ndarray, "corners 2"]:
    """Square of half side 1, counter-clockwise."""
    return np.array([[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])


def frames(
    directions: Float[np.ndarray, "struts 3"], *, turned: bool
) -> tuple[Float[np.ndarray, "struts 3"], Float[np.ndarray, "struts 3"]]:
    """Two unit vectors across each direction that make a right-handed frame with it.

    Args:
        directions: unit vectors.
        turned: turn each next frame by `TURN` of a circle about its direction.
    """
    # Crossing with the coordinate axis farthest from the direction is well conditioned everywhere.
    farthest = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    u = np.cross(directions, farthest)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(directions, u)
    if not turned:
        return u, v
    angle = 2 * np.pi * ((TURN * np.arange(1, len(u) + 1)) % 1.0)[:, None]
    return np.cos(angle) * u + np.sin(angle) * v, np.cos(angle) * v - np.sin(angle) * u


def lofts(
    start: Float[np.ndarray, "struts 3"],
    end: Float[np.ndarray, "struts 3"],
    radii: Float[np.ndarray, "struts 2"],
    ring: Float[np.ndarray, "corners 2"],
    *,
    turned: bool,
) -> list[TriMesh]:
    """Closed loft of each strut between the scaled rings at its ends.

    Args:
        start: first end of each axis [mm].
        end: second end [mm]; not the first.
        radii: scale of the ring at both ends [mm].
        ring: section of unit radius, counter-clockwise.
        turned: see `frames`.
    """
    axis = end - start
    direction = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    u, v = frames(direction, turned=turned)
    spokes = ring[:, 0, None] * u[:, None] + ring[:, 1, None] * v[:, None]
    rings = np.concatenate(
        [
            start[:, None] + radii[:, 0, None, None] * spokes,
            end[:, None] + radii[:, 1, None, None] * spokes,
        ],
        axis=1,
    )
    faces = _loft_faces(len(ring))
    return [TriMesh(vertices, faces) for vertices in rings]


def _loft_faces(n: int) -> np.ndarray:
    i = np.arange(n)
    j = (i + 1) % n
    fan = np.arange(1, n - 1)
    zero = np.zeros(n - 2, dtype=np.int64)
    return np.concatenate(
        [
            np.column_stack([i, j, j + n]),
            np.column_stack([i, j + n, i + n]),
            np.column_stack([zero, fan + 1, fan]),
            np.column_stack([zero + n, fan + n, fan + n + 1]),
        ]
    )
