"""Which points of a plane lie near the shadow of triangles, which may be seen edge on."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree


def near_shadow(
    points: Float[np.ndarray, "points 2"],
    triangles: Float[np.ndarray, "facets 3 2"],
    reach: float,
) -> Bool[np.ndarray, " points"]:
    """Whether each point lies in a triangle or within a distance of one.

    Args:
        points: coordinates in the plane [mm].
        triangles: coordinates of their corners there; they may be as flat as a line.
        reach: largest distance [mm].
    """
    centre = triangles.mean(axis=1)
    extent = np.linalg.norm(triangles - centre[:, None], axis=2).max(axis=1)
    found = KDTree(points).query_ball_point(centre, extent + reach)
    facet = np.repeat(np.arange(len(triangles)), [len(some) for some in found])
    if not len(facet):
        return np.zeros(len(points), bool)
    point = np.concatenate([np.asarray(some, np.int64) for some in found])
    arm = points[point, None] - triangles[facet]  # pair, corner, component
    edge = np.roll(triangles, -1, axis=1)[facet] - triangles[facet]
    side = edge[..., 0] * arm[..., 1] - edge[..., 1] * arm[..., 0]
    inside = (side > 0).all(axis=1) | (side < 0).all(axis=1)
    square = np.maximum((edge**2).sum(axis=2), np.finfo(float).tiny)
    along = np.clip((arm * edge).sum(axis=2) / square, 0, 1)
    distance = np.linalg.norm(arm - along[..., None] * edge, axis=2).min(axis=1)
    near = np.zeros(len(points), bool)
    near[point[inside | (distance <= reach)]] = True
    return near
