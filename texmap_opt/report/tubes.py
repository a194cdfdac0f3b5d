"""Struts and walls as triangles to look at: fast, and not a solid."""

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.report.scenes import Struts
from texmap_opt.solid.tri_mesh import TriMesh

# Up to so many struts tubes have so many sides: a strut of a large lattice is a few pixels wide.
SIDES = ((3_000, 20), (20_000, 10), (80_000, 6), (200_000, 4))
# Above, they are lines.
LINES_ABOVE = SIDES[-1][0]

# Directions closer to the reference axis than this get the other one (cosine).
NEARLY_PARALLEL = 0.9
# Corners of a wall's six sides, counter-clockwise seen from outside. A corner's number has a bit for the
# second joint, the left side, the upper end.
WALL_SIDES = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)


def coloured_struts(
    scene: Struts,
) -> tuple[TriMesh, Float[np.ndarray, "vertices 3"], Float[np.ndarray, " vertices"]]:
    """Triangles of a scene's tubes or walls, the normals to shade their vertices with, and values."""
    if scene.axis is not None:
        # Flat, so that walls behind each other in perspective do not hide what they are coloured by.
        rise = float(scene.radii.max()) * scene.axis
        shape, normals = walls(scene.joints, scene.struts, scene.radii, rise)
        return shape, normals, wall_values(scene.values)
    sides = next(sides for most, sides in SIDES if len(scene.struts) <= most)
    shape, normals = tubes(scene.joints, scene.struts, scene.radii, sides=sides)
    return shape, normals, tube_values(scene.values, sides=sides)


def tubes(
    joints: Float[np.ndarray, "joints 3"],
    struts: Int[np.ndarray, "struts 2"],
    radii: Float[np.ndarray, "struts 2"],
    *,
    sides: int,
) -> tuple[TriMesh, Float[np.ndarray, "vertices 3"]]:
    """Cones with flat caps around the struts.

    Returns:
        The triangles, and the normals to shade their vertices with. Each strut has 4 sides + 2
        vertices: first ring, second ring, both again with the caps' normals, two centres.
    """
    start, end = joints[struts[:, 0]], joints[struts[:, 1]]
    d = end - start
    length = np.linalg.norm(d, axis=1, keepdims=True)
    d = np.divide(d, length, out=np.zeros_like(d), where=length > 0)
    reference = np.where(np.abs(d[:, 2:]) < NEARLY_PARALLEL, [[0.0, 0, 1]], [[1.0, 0, 0]])
    u = np.cross(d, reference)
    u /= np.maximum(np.linalg.norm(u, axis=1, keepdims=True), np.finfo(float).tiny)
    v = np.cross(d, u)
    angle = np.arange(sides) * 2 * np.pi / sides
    ring = np.cos(angle)[:, None] * u[:, None] + np.sin(angle)[:, None] * v[:, None]
    first = start[:, None] + radii[:, :1, None] * ring
    second = end[:, None] + radii[:, 1:, None] * ring
    axis = np.broadcast_to(d[:, None], ring.shape)
    vertices = np.concatenate([first, second, first, second, start[:, None], end[:, None]], axis=1)
    normals = np.concatenate([ring, ring, -axis, axis, -axis[:, :1], axis[:, :1]], axis=1)
    one = _faces(sides)
    count = vertices.shape[1]
    faces = one[None] + (np.arange(len(struts)) * count)[:, None, None]
    return TriMesh(vertices.reshape(-1, 3), faces.reshape(-1, 3)), normals.reshape(-1, 3)


def tube_values(
    values: Float[np.ndarray, "struts 2"], *, sides: int
) -> Float[np.ndarray, " vertices"]:
    """Values at the ends of the struts, at the vertices of `tubes`."""
    first, second = values[:, :1], values[:, 1:]
    ring = [np.repeat(side, sides, axis=1) for side in (first, second, first, second)]
    return np.concatenate([*ring, first, second], axis=1).ravel()


def walls(
    joints: Float[np.ndarray, "joints 3"],
    struts: Int[np.ndarray, "struts 2"],
    radii: Float[np.ndarray, "struts 2"],
    rise: Float[np.ndarray, "3"],
) -> tuple[TriMesh, Float[np.ndarray, "vertices 3"]]:
    """Boxes around the middles of walls, all of the same height.

    Args:
        joints: half way along the extrusion [mm].
        struts: the two joints of each wall.
        radii: half its thickness at the two [mm].
        rise: from the middle of the walls to their upper ends [mm].

    Returns:
        The triangles, and the normals to shade their vertices with. Each wall has 24 vertices, as
        each of its six sides has its own.
    """
    start, end = np.moveaxis(joints[struts], 1, 0)
    left = np.cross(rise, end - start)
    left /= np.maximum(np.linalg.norm(left, axis=1, keepdims=True), np.finfo(float).tiny)
    corners = [
        joint + side * radius * left + up * rise
        for joint, radius in ((start, radii[:, :1]), (end, radii[:, 1:]))
        for side in (-1, 1)
        for up in (-1, 1)
    ]
    sides = np.stack(corners, axis=1)[:, WALL_SIDES]
    normals = np.cross(sides[:, :, 1] - sides[:, :, 0], sides[:, :, 3] - sides[:, :, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), np.finfo(float).tiny)
    first = 4 * np.arange(6 * len(struts))[:, None, None]
    faces = first + np.array([[0, 1, 2], [0, 2, 3]])
    mesh = TriMesh(sides.reshape(-1, 3), faces.reshape(-1, 3))
    return mesh, np.repeat(normals.reshape(-1, 3), 4, axis=0)


def wall_values(values: Float[np.ndarray, "struts 2"]) -> Float[np.ndarray, " vertices"]:
    """Values at the ends of the walls, at the vertices of `walls`."""
    # The first four corners belong to the first joint.
    return values[:, WALL_SIDES // 4].ravel()


def _faces(sides: int) -> np.ndarray:
    i = np.arange(sides)
    j = (i + 1) % sides
    low, high = i + sides, j + sides
    mantle = np.concatenate([np.stack([i, j, low], 1), np.stack([j, high, low], 1)])
    centre = np.full(sides, 4 * sides)
    caps = [
        np.stack([j + 2 * sides, i + 2 * sides, centre], 1),
        np.stack([i + 3 * sides, j + 3 * sides, centre + 1], 1),
    ]
    return np.concatenate([mantle, *caps])


def joint_radii(
    joints: int, struts: Int[np.ndarray, "struts 2"], values: Float[np.ndarray, "struts 2"]
) -> Float[np.ndarray, " joints"]:
    """Largest value of the struts that meet at each joint; 0 where none does."""
    largest = np.zeros(joints)
    np.maximum.at(largest, struts.ravel(), values.ravel())
    return largest
