"""How thick the walls of a part are, by balls that fit inside it.

The local thickness at a point of the surface is the diameter of the largest ball inside the part
that touches the surface there (Hildebrand and Rüegsegger 1997). It is found by shrinking: start
with a ball through the point opposite; while some surface point lies inside it, take the ball
through that point instead (Ma, Bae and Choi 2012).
"""

import numpy as np
from jaxtyping import Bool, Float

from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.surface_points import points_by_area
from texmap_opt.solid.tri_mesh import TriMesh

# Points of the surface that are looked at; a quarter or less lie between walls.
SAMPLES = 8000
# Share of the surface that may be thinner: sharp edges, where every ball is small, and single
# slivers are not walls.
THIN_SHARE = 0.05
# Steps of shrinking; it halts earlier when no ball changes, normally after five.
MAX_SHRINKS = 20
# Relative change of a radius that ends the shrinking: above the chord error of round walls, whose
# facets would otherwise stop each other's balls.
SHRINK_TOLERANCE = 1e-2
# A ball whose two contacts are seen under less than 120 degrees sits in an edge or a dent, not
# between two walls [cosine of the angle at its centre].
WALL_COSINE = -0.5


def local_thickness(
    surface: TriMesh, *, query: SignedDistance | None = None, seed: int = 0
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Thickness at points spread evenly over a closed surface.

    Args:
        surface: closed, outward oriented [mm].
        query: its distance queries, where they exist already.
        seed: of the points.

    Returns:
        points [mm], the thickness there [mm], and whether it is that between two walls rather than
        of the edge or fillet the point is on.
    """
    query = query or SignedDistance(surface)
    points, faces = points_by_area(surface, SAMPLES, np.random.default_rng(seed))
    normals = surface.face_normals[faces]
    diagonal = float(np.linalg.norm(np.diff(surface.bounds, axis=0)))
    lift = 1e-7 * diagonal
    path, _ = query.first_hit(points - lift * normals, -normals)
    radius = np.where(np.isfinite(path), (path + lift) / 2, diagonal)
    contact = points - 2 * radius[:, None] * normals
    moving = np.arange(len(points))
    for _ in range(MAX_SHRINKS):
        p, n, r = points[moving], normals[moving], radius[moving]
        center = p - r[:, None] * n
        distance, _, nearest = query.unsigned(center)
        pierced = distance < r * (1 - SHRINK_TOLERANCE)
        moving, p, n, nearest = moving[pierced], p[pierced], n[pierced], nearest[pierced]
        if moving.size == 0:
            break
        # The ball tangent at p whose sphere passes through the nearest point.
        d = p - nearest
        radius[moving] = np.einsum("ij,ij->i", d, d) / (2 * np.einsum("ij,ij->i", d, n))
        contact[moving] = nearest
    center = points - radius[:, None] * normals
    to_contact = (contact - center) / radius[:, None]
    between_walls = np.einsum("ij,ij->i", to_contact, normals) < WALL_COSINE
    between_walls &= radius < diagonal
    return points, 2 * radius, between_walls


def thinnest_wall(surface: TriMesh, *, query: SignedDistance | None = None, seed: int = 0) -> float:
    """Thickness [mm] that all but `THIN_SHARE` of the walls exceed.

    Args:
        surface: closed, outward oriented [mm].
        query: its distance queries, where they exist already.
        seed: of the points looked at.
    """
    _, thickness, between_walls = local_thickness(surface, query=query, seed=seed)
    if not between_walls.any():
        # No two faces are opposite (a tetrahedron): the largest ball is what there is.
        return float(thickness.max())
    return float(np.quantile(thickness[between_walls], THIN_SHARE))
