"""Sections of struts, the frames they are drawn in, and lofts between them."""

import numpy as np
from jaxtyping import Float

from texmap_opt.solid.tri_mesh import TriMesh

# Digits to which coordinates of a direction are compared.
FRAME_DIGITS = 6
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
    """Square of half side 1 that stands on a corner, counter-clockwise from its right one."""
    return np.sqrt(2) * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])


def frames(
    directions: Float[np.ndarray, "struts 3"],
) -> tuple[Float[np.ndarray, "struts 3"], Float[np.ndarray, "struts 3"]]:
    """Two unit vectors across each direction that make a right-handed frame with it.

    Args:
        directions: unit vectors.
    """
    # Crossing with the coordinate axis farthest from the direction is well conditioned everywhere;
    # rounded, so that rounding does not choose between two axes that are equally far.
    farthest = np.eye(3)[np.argmin(np.round(np.abs(directions), FRAME_DIGITS), axis=1)]
    u = np.cross(directions, farthest)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return u, np.cross(directions, u)


def closed_loft(
    first: Float[np.ndarray, "corners 3"], second: Float[np.ndarray, "corners 3"]
) -> TriMesh:
    """The prism, or frustum, between two rings.

    Args:
        first: counter-clockwise seen from the second ring [mm].
        second: counter-clockwise seen from the first [mm]; its corner -k lies before corner k.
    """
    n = len(first)
    i = np.arange(n)
    j = (i + 1) % n
    c, d = n + (-i) % n, n + (-j) % n
    fan = np.arange(1, n - 1)
    zero = np.zeros(n - 2, dtype=np.int64)
    faces = [
        np.column_stack([i, j, d]),
        np.column_stack([i, d, c]),
        np.column_stack([zero, fan + 1, fan]),
        np.column_stack([zero + n, fan + n + 1, fan + n]),
    ]
    return TriMesh(np.concatenate([first, second]), np.concatenate(faces))
