"""Points on a surface, spread at random but evenly."""

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.solid.tri_mesh import TriMesh


def points_by_area(
    surface: TriMesh, count: int, random: np.random.Generator
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
    """Points uniform over the area, stratified along the list of faces, and their faces.

    Args:
        surface: with some area [mm].
        count: of the points.
        random: generator of the points.
    """
    area = np.cumsum(surface.face_areas)
    at = (np.arange(count) + random.random(count)) / count * area[-1]
    faces = np.minimum(np.searchsorted(area, at), len(area) - 1)
    return points_in(surface, faces, random), faces


def points_by_face(
    surface: TriMesh, count: int, random: np.random.Generator
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
    """Points in faces taken evenly from the list, large or small, and their faces.

    A thin strut has little area but as many triangles as a thick one, one after the other.

    Args:
        surface: with some area [mm].
        count: at most so many points; one a face where there are fewer faces.
        random: generator of the points.
    """
    faces = np.flatnonzero(surface.face_areas > 0)
    if len(faces) > count:
        faces = faces[(np.arange(count) * len(faces)) // count]
    return points_in(surface, faces, random), faces


def points_in(
    surface: TriMesh, faces: Int[np.ndarray, " n"], random: np.random.Generator
) -> Float[np.ndarray, "n 3"]:
    """One point in each of the faces, uniform over it (Turk 1990)."""
    u, v = random.random((2, len(faces)))
    u = np.sqrt(u)
    weights = np.stack([1 - u, u * (1 - v), u * v], axis=1)
    return np.einsum("nk,nkd->nd", weights, surface.vertices[surface.faces[faces]])
