"""The solid as an STL file holds it: vertices in single precision, still closed and manifold.

Rounding to float32 brings vertices together. Where the two ends of an edge meet, the edge is
collapsed; where parts of the surface meet that are not neighbours, they are moved apart by a few
units of resolution. What that cannot mend is simplified first, with a tolerance of a few units.
"""

import numpy as np
from jaxtyping import Float
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from texmap_opt.combine import boolean
from texmap_opt.errors import SolidError
from texmap_opt.solid.edges import Edges
from texmap_opt.solid.tri_mesh import TriMesh

# Tolerances of the simplification tried in turn, in float32 steps at the largest coordinate.
SIMPLIFICATION_STEPS = (0, 1, 2, 4, 8, 16, 32, 64)
# Odd factors that make one number of three coordinates: fractions of pi, e and the golden section.
MIXING = np.array([0x243F6A8885A308D3, 0xB7E151628AED2A6B, 0x9E3779B97F4A7C15], dtype=np.uint64)
# Steps by which vertices are moved apart, tried in turn.
SEPARATION_STEPS = (1, 2, 3, 4, 6, 8, 12, 16)


def printable_mesh(surface: TriMesh) -> tuple[TriMesh, float]:
    """The nearest surface whose vertices are float32 numbers and that is still a closed manifold.

    Equal vertices are welded, no edge joins more than two triangles, no vertex two fans: a program
    that reads the STL and welds equal vertices gets exactly this mesh back.

    Args:
        surface: a closed surface [mm].

    Returns:
        the mesh (vertices in float64 with float32 values), and the largest displacement [mm]: of
        a vertex that was kept, plus the tolerance of the simplification where one was needed.

    Raises:
        SolidError: when no such mesh is found within 64 float32 steps.
    """
    rounded = _rounded(surface.vertices)
    if len(surface.faces) and not len(_clashing(rounded)):
        # Nothing meets that did not meet before: how triangles are joined has not changed.
        shift = rounded - surface.vertices
        moved = float(np.sqrt(np.einsum("ij,ij->i", shift, shift).max()))
        return TriMesh(rounded, surface.faces), moved
    resolution = float32_step(surface.vertices)
    for steps in SIMPLIFICATION_STEPS:
        start = boolean.simplified(surface, steps * resolution) if steps else surface
        snapped = _snapped(start, resolution)
        if snapped is not None:
            mesh, moved = snapped
            return mesh, moved + steps * resolution
    raise SolidError(
        "The result cannot be written in single precision, as STL needs: surfaces come closer than "
        f"{SIMPLIFICATION_STEPS[-1] * resolution:.2g} mm. Change radius_mm or skin_mm slightly."
    )


def float32_step(vertices: Float[np.ndarray, "vertices 3"]) -> float:
    """Distance of neighbouring float32 numbers at the largest coordinate [mm]."""
    return float(np.spacing(np.float32(np.abs(vertices).max(initial=1e-30))))


def _snapped(surface: TriMesh, resolution: float) -> tuple[TriMesh, float] | None:
    """Rounded, collapsed and moved apart; None when an edge then joins more than two triangles."""
    if not len(surface.faces):
        return None
    rounded = _rounded(surface.vertices)
    faces = _cancelled(_collapsed(rounded, surface.faces))
    if not len(faces):
        return None
    edges = Edges(TriMesh(rounded, faces))
    if edges.open.any() or edges.crowded.any():
        return None
    # One vertex per fan: vertices where only points touch become several.
    fans, first = np.unique(edges.fan_of_corner, return_index=True)
    source = faces.reshape(-1)[first]
    faces = edges.fan_of_corner.reshape(-1, 3)
    vertices = _apart(surface.vertices[source], rounded[source], faces, resolution)
    if vertices is None or len(fans) != len(vertices):
        return None
    mesh = TriMesh(vertices, faces)
    if boolean.fault(mesh) or mesh.volume <= 0:
        return None
    moved = np.linalg.norm(vertices - surface.vertices[source], axis=1)
    return mesh, float(moved.max())


def _rounded(vertices: np.ndarray) -> np.ndarray:
    # Adding 0.0 turns -0.0 into 0.0: readers that weld by bytes see one number.
    return vertices.astype(np.float32).astype(np.float64) + 0.0


def _collapsed(rounded: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Faces after joining the ends of every edge that became a point; flat triangles are gone."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    short = ends[(rounded[ends[:, 0]] == rounded[ends[:, 1]]).all(axis=1)]
    count = len(rounded)
    links = coo_array((np.ones(len(short), np.int8), (short[:, 0], short[:, 1])), (count, count))
    cluster = connected_components(links, directed=False)[1]
    member = np.zeros(int(cluster.max()) + 1, dtype=np.int64)
    member[cluster] = np.arange(count)
    faces = member[cluster[faces]]
    return faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]


def _cancelled(faces: np.ndarray) -> np.ndarray:
    """Faces without pairs of the same three vertices and opposite sense: sheets of no thickness."""
    if not len(faces):
        return faces
    order = np.sort(faces, axis=1)
    # An even permutation of the sorted vertices runs one way, an odd one the other.
    shift = np.argmin(faces, axis=1)
    second = faces[np.arange(len(faces)), (shift + 1) % 3]
    sense = np.where(second == order[:, 1], 1, -1)
    # Two numbers after another instead of rows of three: a tenth of the time of sorting rows.
    count = int(order.max()) + 1
    _, pair = np.unique(order[:, 0] * count + order[:, 1], return_inverse=True)
    _, group = np.unique(pair.reshape(-1) * count + order[:, 2], return_inverse=True)
    group = group.reshape(-1)
    balance = np.bincount(group, weights=sense).astype(np.int64)
    keep = np.zeros(len(faces), dtype=bool)
    for sign in (1, -1):
        members = np.flatnonzero(sense == sign)
        members = members[np.argsort(group[members], kind="stable")]
        starts = np.searchsorted(group[members], group[members])
        rank = np.arange(len(members)) - starts
        keep[members] = rank < sign * balance[group[members]]
    return faces[keep]


def _apart(
    exact: np.ndarray, rounded: np.ndarray, faces: np.ndarray, resolution: float
) -> np.ndarray | None:
    """Rounded positions, all different: equal ones are moved towards their own neighbours."""
    vertices = rounded.copy()
    for steps in SEPARATION_STEPS:
        clashing = _clashing(vertices)
        if not len(clashing):
            return vertices
        inward = _towards_neighbours(exact, faces, clashing)
        vertices[clashing] = _rounded(rounded[clashing] + steps * resolution * inward)
    return None if len(_clashing(vertices)) else vertices


def _clashing(vertices: np.ndarray) -> np.ndarray:
    """All but the first of each set of equal vertices, which are float32 numbers."""
    # One number a vertex, sorted: a tenth of the time of sorting rows. Equal vertices have equal
    # numbers, and those few that have them by chance are told apart afterwards.
    bits = vertices.astype(np.float32).view(np.uint32).astype(np.uint64)
    number = (bits * MIXING).sum(axis=1, dtype=np.uint64)
    number ^= number >> np.uint64(29)
    order = np.argsort(number, kind="stable")
    again = number[order[1:]] == number[order[:-1]]
    alike = np.unique(np.concatenate([order[1:][again], order[:-1][again]]))
    _, first = np.unique(vertices[alike], axis=0, return_index=True)
    return np.setdiff1d(alike, alike[first])


def _towards_neighbours(exact: np.ndarray, faces: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Unit vectors from the chosen vertices to the mean of the corners of their triangles."""
    touched = np.isin(faces, chosen).any(axis=1)
    corners = faces[touched]
    mean = exact[corners].mean(axis=1)
    total, count = np.zeros_like(exact), np.zeros(len(exact))
    for k in range(3):
        np.add.at(total, corners[:, k], mean)
        np.add.at(count, corners[:, k], 1.0)
    direction = total[chosen] / count[chosen, None] - exact[chosen]
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    return np.divide(direction, length, out=np.ones_like(direction), where=length > 0)
