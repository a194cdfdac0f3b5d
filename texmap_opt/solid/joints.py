"""Joints as geodesic spheres that contain the ends of their struts."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from texmap_opt.solid.tri_mesh import TriMesh

# Turn [rad] that keeps facets out of the coordinate planes: the golden section.
TURN = (np.sqrt(5) - 1) / 2
# Largest radius in which the ends of struts lie inside the joint by rounding and a little more:
# rings that touch facets of the sphere would leave slivers.
CLEARANCE = 1.001


@dataclass(frozen=True, eq=False)
class UnitBall:
    """A polyhedron with the volume of the unit ball: an octahedron subdivided and blown up.

    Attributes:
        segments: facets along a great circle, a multiple of four.
    """

    segments: int

    @cached_property
    def surface(self) -> TriMesh:
        """Vertices on a sphere of radius slightly above 1, such that the volume is 4 pi/3."""
        vertices, faces = _octahedral_sphere(self.segments // 4)
        volume = TriMesh(vertices, faces).volume
        return TriMesh(vertices * (4 * np.pi / 3 / volume) ** (1 / 3), faces)

    @cached_property
    def inradius(self) -> float:
        """Smallest distance of a facet's plane from the centre."""
        corner = self.surface.vertices[self.surface.faces[:, 0]]
        return float(np.einsum("ij,ij->i", corner, self.surface.face_normals).min())


def ball_within(segments: int) -> UnitBall:
    """The ball as fine as a strut of `segments` sides: the next multiple of four, at least 12.

    With 8 facets around, the sphere that contains a strut's end is 15 % thicker than the strut;
    with 12 it is 9 % (8 sides) or 5 % (12 sides).
    """
    return UnitBall(max(12, 4 * -(-segments // 4)))


def balls(
    centres: Float[np.ndarray, "joints 3"], reach: Float[np.ndarray, " joints"], ball: UnitBall
) -> list[TriMesh]:
    """A turned copy of the ball around each centre that contains the sphere of radius `reach`.

    Args:
        centres: joints [mm].
        reach: largest distance of a strut's end ring from each joint [mm].
        ball: the polyhedron to copy.
    """
    shape, faces = ball.surface.vertices, ball.surface.faces
    scale = CLEARANCE * reach / ball.inradius
    turns = _turns(len(centres))
    vertices = centres[:, None] + scale[:, None, None] * np.einsum("jab,vb->jva", turns, shape)
    return [TriMesh(each, faces) for each in vertices]


def _turns(count: int) -> np.ndarray:
    """Rotations spread evenly over all rotations, the same at every call.

    Unit quaternions after Shoemake (1992) from the additive recurrence of Roberts (2018) in three
    dimensions, whose irrational steps keep any two facets from being parallel.
    """
    # Real root of x^4 = x + 1: the three-dimensional golden section.
    root = 1.2207440846057596
    s = (0.5 + np.arange(1, count + 1)[:, None] / root ** np.arange(1, 4)) % 1.0
    a, b = np.sqrt(1 - s[:, 0]), np.sqrt(s[:, 0])
    x, y = a * np.sin(2 * np.pi * s[:, 1]), a * np.cos(2 * np.pi * s[:, 1])
    z, w = b * np.sin(2 * np.pi * s[:, 2] + TURN), b * np.cos(2 * np.pi * s[:, 2] + TURN)
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], -1),
            np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], -1),
            np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], -1),
        ],
        axis=1,
    )


def _octahedral_sphere(divisions: int) -> tuple[np.ndarray, np.ndarray]:
    """Octahedron with every side divided, vertices moved along their radius to the unit sphere."""
    rows = [(i, j) for i in range(divisions + 1) for j in range(divisions + 1 - i)]
    number = {row: k for k, row in enumerate(rows)}
    local = np.array([[i, j, divisions - i - j] for i, j in rows])
    triangles = []
    for i, j in rows:
        if i + j < divisions:
            triangles.append((number[i, j], number[i + 1, j], number[i, j + 1]))
        if i + j < divisions - 1:
            triangles.append((number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]))
    octants, faces = [], []
    for signs in np.array(np.meshgrid([1, -1], [1, -1], [1, -1], indexing="ij")).reshape(3, 8).T:
        order = [0, 1, 2] if np.prod(signs) > 0 else [0, 2, 1]
        faces.append(np.array(triangles)[:, order] + len(rows) * len(octants))
        octants.append(local * signs)
    lattice, index = np.unique(np.concatenate(octants), axis=0, return_inverse=True)
    # Equal angles along the edges of the octahedron rather than equal lengths: rounder facets.
    directions = np.sin(np.pi / 2 * lattice / divisions)
    vertices = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return vertices, index.reshape(-1)[np.concatenate(faces)]
