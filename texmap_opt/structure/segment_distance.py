"""How near straight segments come to each other."""

import numpy as np
from jaxtyping import Float

# sin² of the angle below which two segments count as parallel; parallel ones are nearest at an end.
PARALLEL = 1e-12


def segment_distance(
    a: Float[np.ndarray, "samples 2 d"], b: Float[np.ndarray, "samples 2 d"]
) -> Float[np.ndarray, " samples"]:
    """Distance of two segments: from an end of one to the other, or between the lines.

    The second where the feet of the common normal lie within both (Ericson, Real-Time Collision
    Detection (2005), section 5.1.9).
    """
    nearest = np.min(
        [point_distance(a[:, k], b) for k in (0, 1)] + [point_distance(b[:, k], a) for k in (0, 1)],
        axis=0,
    )
    u, v, w = a[:, 1] - a[:, 0], b[:, 1] - b[:, 0], a[:, 0] - b[:, 0]
    uu, uv, vv, uw, vw = (
        np.einsum("sd,sd->s", x, y) for x, y in ((u, u), (u, v), (v, v), (u, w), (v, w))
    )
    det = uu * vv - uv**2
    oblique = det > PARALLEL * uu * vv
    det = np.where(oblique, det, 1.0)
    s, t = (uv * vw - vv * uw) / det, (uu * vw - uv * uw) / det
    within = oblique & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    gap = np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=1)
    return np.where(within, np.minimum(gap, nearest), nearest)


def point_distance(
    point: Float[np.ndarray, "samples d"], segment: Float[np.ndarray, "samples 2 d"]
) -> Float[np.ndarray, " samples"]:
    """Distance of a point from a segment."""
    axis = segment[:, 1] - segment[:, 0]
    along = np.einsum("sd,sd->s", point - segment[:, 0], axis) / np.einsum("sd,sd->s", axis, axis)
    foot = segment[:, 0] + np.clip(along, 0, 1)[:, None] * axis
    return np.linalg.norm(point - foot, axis=1)
