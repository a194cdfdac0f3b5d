"""Triangle surfaces of solids."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True, eq=False)
class TriMesh:
    """A triangle surface; counter-clockwise seen from outside.

    Attributes:
        vertices: positions [mm].
        faces: vertex indices of each triangle.
    """

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]

    @cached_property
    def face_normals(self) -> Float[np.ndarray, "faces 3"]:
        """Unit outward normals; zero where a triangle has no area."""
        cross = self._cross
        length = np.linalg.norm(cross, axis=1, keepdims=True)
        return np.divide(cross, length, out=np.zeros_like(cross), where=length > 0)

    @cached_property
    def face_areas(self) -> Float[np.ndarray, " faces"]:
        """Area of each triangle [mm²]."""
        return np.linalg.norm(self._cross, axis=1) / 2

    @cached_property
    def volume(self) -> float:
        """Enclosed volume [mm³] by the divergence theorem; negative when inside out."""
        corner = self.vertices[self.faces[:, 0]]
        return float(np.einsum("ij,ij->", corner, self._cross) / 6)

    @cached_property
    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner of the bounding box [mm]."""
        used = self.vertices[np.unique(self.faces)]
        return np.stack([used.min(axis=0), used.max(axis=0)])

    def select(
        self, faces: Bool[np.ndarray, " faces"] | Int[np.ndarray, " chosen"] | slice
    ) -> "TriMesh":
        """The chosen triangles, with only the vertices that they use."""
        used, renumbered = np.unique(self.faces[faces], return_inverse=True)
        return TriMesh(self.vertices[used], renumbered.reshape(-1, 3))

    @cached_property
    def _cross(self) -> Float[np.ndarray, "faces 3"]:
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        return np.cross(b - a, c - a)
