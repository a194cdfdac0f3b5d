"""Tetrahedral meshes, linear or quadratic."""

from dataclasses import dataclass
from functools import cached_property
from itertools import permutations

import numpy as np
from jaxtyping import Float, Int

from fea.elements import FACES_OF_TETRAHEDRON, TETRAHEDRA, TETRAHEDRON_EDGES, TRIANGLES, Element
from fea.errors import FeaError


@dataclass(frozen=True, eq=False)
class TetMesh:
    """A mesh of tetrahedra of positive volume, in VTK node order.

    Attributes:
        nodes: positions [mm].
        tets: nodes of each tetrahedron: 4 corners, or 4 corners and the 6 mid-edge nodes of
            edges 01, 12, 20, 03, 13, 23.

    Raises:
        FeaError: when cells have neither 4 nor 10 nodes, or refer to nodes that do not exist.
    """

    nodes: Float[np.ndarray, "nodes 3"]
    tets: Int[np.ndarray, "cells corners"]

    def __post_init__(self):
        if self.tets.shape[1] not in TETRAHEDRA:
            raise FeaError(
                f"Tetrahedra have {self.tets.shape[1]} nodes here; give 4 (tet4) or 10 (tet10)."
            )
        if self.tets.size == 0:
            raise FeaError("The mesh has no tetrahedra; check the mesher's input.")
        if not 0 <= self.tets.min() <= self.tets.max() < len(self.nodes):
            raise FeaError(
                f"Tetrahedra refer to nodes {self.tets.min()} to {self.tets.max()}, but the mesh "
                f"has nodes 0 to {len(self.nodes) - 1}."
            )

    @classmethod
    def box(
        cls,
        size: tuple[float, float, float],
        cells: tuple[int, int, int],
        *,
        origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> "TetMesh":
        """A block of equal hexahedra, each cut into six tetrahedra around its diagonal (tet4).

        Args:
            size: edge lengths [mm].
            cells: hexahedra along each axis.
            origin: lowest corner [mm].
        """
        axes = [o + s * np.arange(n + 1) / n for o, s, n in zip(origin, size, cells, strict=True)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        number = np.arange(len(nodes)).reshape([n + 1 for n in cells])
        tets = []
        # Kuhn 1960: one tetrahedron for each order in which a path from corner 000 to corner 111
        # takes its three steps. Neighbouring hexahedra agree on the diagonals of their faces.
        for order in permutations(range(3)):
            corner = np.zeros(3, dtype=int)
            path = [corner.copy()]
            for axis in order:
                corner[axis] += 1
                path.append(corner.copy())
            if np.linalg.det(np.array(path[1:]) - path[0]) < 0:
                path[2], path[3] = path[3], path[2]
            tets.append(
                np.stack(
                    [
                        number[tuple(slice(c, c + n) for c, n in zip(p, cells, strict=True))]
                        for p in path
                    ],
                    axis=-1,
                )
            )
        return cls(nodes, np.stack(tets, axis=-2).reshape(-1, 4))

    @property
    def element(self) -> str:
        """Name of the element, "tet4" or "tet10"."""
        return self.element_type.name

    @property
    def element_type(self) -> Element:
        """Shape functions and quadrature of the cells."""
        return TETRAHEDRA[self.tets.shape[1]]

    def to_tet10(self) -> "TetMesh":
        """The same mesh with a node in the middle of each edge; a tet10 mesh is returned as is."""
        if self.element == "tet10":
            return self
        edges = np.sort(self.tets[:, TETRAHEDRON_EDGES], axis=-1).reshape(-1, 2).astype(np.int64)
        key, number = np.unique(edges[:, 0] * len(self.nodes) + edges[:, 1], return_inverse=True)
        ends = np.stack(np.divmod(key, len(self.nodes)), axis=1)
        middle = self.nodes[ends].mean(axis=1)
        tets = np.concatenate([self.tets, len(self.nodes) + number.reshape(-1, 6)], axis=1)
        return TetMesh(np.concatenate([self.nodes, middle]), tets)

    @cached_property
    def volumes(self) -> Float[np.ndarray, " cells"]:
        """Volume of each cell [mm³]; negative means inverted. Exact for straight edges."""
        return self.jacobians @ self.element_type.quadrature.weights

    @cached_property
    def volume(self) -> float:
        """Volume of the mesh [mm³]."""
        return float(self.volumes.sum())

    @cached_property
    def jacobians(self) -> Float[np.ndarray, "cells quad"]:
        """Determinant of the isoparametric map at the quadrature points [mm³]."""
        reference = self.element_type.gradient_at_quadrature
        # cell, node, space, quad point, reference
        return np.linalg.det(
            np.einsum("cnx,qnr->cqxr", self.nodes[self.tets], reference, optimize=True)
        )

    @cached_property
    def boundary_facets(self) -> Int[np.ndarray, "facets corners"]:
        """Nodes of each outer facet, counter-clockwise seen from outside.

        Three corners, or three corners and the mid-edge nodes of edges 01, 12, 20.
        """
        columns = FACES_OF_TETRAHEDRON[:, : 3 if self.element == "tet4" else 6]
        faces = self.tets[:, columns].reshape(-1, columns.shape[1])
        corners = np.sort(faces[:, :3], axis=1)
        _, first, count = np.unique(corners, axis=0, return_index=True, return_counts=True)
        return faces[np.sort(first[count == 1])]

    @cached_property
    def facet_areas(self) -> Float[np.ndarray, " facets"]:
        """Area of each boundary facet [mm²]."""
        return self.facet_integrals(self.boundary_facets)[0]

    @cached_property
    def facet_normals(self) -> Float[np.ndarray, "facets 3"]:
        """Unit outward normal of each boundary facet (of its mean plane, where curved)."""
        _, vector_area, _ = self.facet_integrals(self.boundary_facets)
        return vector_area / np.linalg.norm(vector_area, axis=1, keepdims=True)

    @cached_property
    def facet_centroids(self) -> Float[np.ndarray, "facets 3"]:
        """Centroid of each boundary facet [mm]."""
        area, _, moment = self.facet_integrals(self.boundary_facets)
        return moment / area[:, None]

    def facet_integrals(
        self, facets: Int[np.ndarray, "facets corners"]
    ) -> tuple[
        Float[np.ndarray, " facets"], Float[np.ndarray, "facets 3"], Float[np.ndarray, "facets 3"]
    ]:
        """Integrals of 1, of the normal and of the position over each facet."""
        x, n = self.facet_points(facets)
        area = np.linalg.norm(n, axis=-1)
        return area.sum(axis=1), n.sum(axis=1), np.einsum("fq,fqx->fx", area, x)

    def facet_points(
        self, facets: Int[np.ndarray, "facets corners"]
    ) -> tuple[Float[np.ndarray, "facets quad 3"], Float[np.ndarray, "facets quad 3"]]:
        """Positions of the facets' quadrature points, and normals times area weight there."""
        triangle = TRIANGLES[facets.shape[1]]
        corners = self.nodes[facets]
        x = np.einsum("fnx,qn->fqx", corners, triangle.shape_at_quadrature)
        tangents = np.einsum("fnx,qnr->fqrx", corners, triangle.gradient_at_quadrature)
        normal = np.cross(tangents[:, :, 0], tangents[:, :, 1])
        return x, normal * triangle.quadrature.weights[:, None]
