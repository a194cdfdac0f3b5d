"""Struts as triangles to look at: fast, and not a solid."""

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.solid.tri_mesh import TriMesh

# Directions closer to the reference axis than this get the other one (cosine).
NEARLY_PARALLEL = 0.9


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
