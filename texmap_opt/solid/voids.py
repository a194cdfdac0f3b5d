"""Closed voids of a solid: powder or resin that is trapped in them does not come out."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.edges import Edges
from texmap_opt.solid.tri_mesh import TriMesh

# The largest voids are listed, up to so many.
MOST_LISTED = 20


@dataclass(frozen=True, eq=False)
class ClosedVoid:
    """One of them.

    Attributes:
        volume_mm3: what its walls enclose, bodies loose in it included [mm³].
        inside_mm: a point in it [mm].
    """

    volume_mm3: float
    inside_mm: list[float]


@dataclass(frozen=True, eq=False)
class ClosedVoids:
    """All of them.

    Attributes:
        count: how many.
        total_mm3: their volume together [mm³].
        largest: the largest of them, by falling volume.
    """

    count: int
    total_mm3: float
    largest: list[ClosedVoid]


def closed_voids(query: SignedDistance) -> ClosedVoids:
    """The voids of a closed surface: its shells of negative volume.

    Args:
        query: distance queries of the surface, closed and oriented outwards [mm].
    """
    surface = query.surface
    volumes, faces = _largest_faces(surface)
    # Their normals point into the voids, so that the way to the next wall is in them.
    middles = surface.vertices[surface.faces[faces]].mean(axis=1)
    normals = surface.face_normals[faces]
    # From the wall itself the first face met would be that wall.
    lift = 1e-6 * np.sqrt(surface.face_areas[faces])[:, None] * normals
    path, _ = query.first_hit(middles + lift, normals)
    inside = middles + lift + np.where(np.isfinite(path), path / 2, 0.0)[:, None] * normals
    listed = zip(volumes.tolist(), inside.tolist(), strict=False)
    return ClosedVoids(len(volumes), float(volumes.sum()), [ClosedVoid(*void) for void in listed])


def _largest_faces(
    surface: TriMesh,
) -> tuple[Float[np.ndarray, " voids"], Int[np.ndarray, " listed"]]:
    """Volumes of all voids, falling [mm³], and the largest face of each that is listed."""
    edges = Edges(surface)
    shell, volumes = edges.shell_of_face, edges.shell_volumes
    voids = np.flatnonzero(volumes < 0)
    voids = voids[np.argsort(volumes[voids], kind="stable")]
    by_area = np.lexsort((surface.face_areas, shell))
    last = np.searchsorted(shell[by_area], voids[:MOST_LISTED], side="right") - 1
    return -volumes[voids], by_area[last]
