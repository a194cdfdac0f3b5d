"""Tetrahedral meshes, linear or quadratic."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations

import numpy as np
from jaxtyping import Bool, Float, Int

from fea.elements import FACES_OF_TETRAHEDRON, TETRAHEDRA, TETRAHEDRON_EDGES, TRIANGLES, Element
from fea.errors import FeaError, position_text
from fea.isoparametric import cell_determinants, cell_points, facet_points
from fea.mid_edge_nodes import check_mid_edge_nodes, off_middle, with_mid_edge_nodes
from fea.precision import refuse_single_precision
from fea.quadrature import TETRAHEDRON_5

# A determinant (six volumes) below this share of the longest edge cubed is rounding: its sign is
# noise, and the stiffness, which grows as one over the height, would swamp all other cells.
FLAT_DETERMINANT = 1e-12

# Nodes of the same cell after its corners 1 and 2 have changed places: an inside-out cell righted.
RIGHTED = {4: [0, 2, 1, 3], 10: [0, 2, 1, 3, 6, 5, 4, 7, 9, 8]}


@dataclass(frozen=True, eq=False)
class TetMesh:
    """A mesh of tetrahedra of positive volume, in VTK node order.

    The constructor looks at the numbering only; `check` looks at the geometry, and every analysis
    calls it.

    Attributes:
        nodes: positions [mm].
        tets: nodes of each tetrahedron: 4 corners, or 4 corners and the 6 mid-edge nodes of
            edges 01, 12, 20, 03, 13, 23.

    Raises:
        FeaError: when cells have neither 4 nor 10 nodes, or refer to nodes that do not exist, or
            positions are in single precision.
    """

    nodes: Float[np.ndarray, "nodes 3"]
    tets: Int[np.ndarray, "cells corners"]

    def __post_init__(self):
        refuse_single_precision(self.nodes, "Positions of the mesh's nodes")
        if self.nodes.ndim != 2 or self.nodes.shape[1] != 3:
            raise FeaError(f"Nodes have shape {self.nodes.shape}; give x, y, z in each row.")
        if self.tets.ndim != 2 or self.tets.shape[1] not in TETRAHEDRA:
            raise FeaError(
                f"Tetrahedra have {self.tets.shape[-1]} nodes here; give 4 (tet4) or 10 (tet10)."
            )
        if self.tets.size == 0:
            raise FeaError("The mesh has no tetrahedra; check the mesher's input.")
        if not 0 <= self.tets.min() <= self.tets.max() < len(self.nodes):
            cell, place = np.argwhere((self.tets < 0) | (self.tets >= len(self.nodes)))[0]
            raise FeaError(
                f"Tetrahedra refer to nodes {self.tets.min()} to {self.tets.max()}, but the mesh "
                f"has nodes 0 to {len(self.nodes) - 1}; the first to do so is cell {cell}, with "
                f"node {self.tets[cell, place]}. Number nodes from 0, in the order of `nodes`."
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
        return TetMesh(*with_mid_edge_nodes(self.nodes, self.tets))

    def with_nodes(self, nodes: Float[np.ndarray, "nodes 3"]) -> "TetMesh":
        """The same cells on moved nodes; what depends on the numbering alone is not found again.

        Raises:
            FeaError: when there are not as many nodes as before.
        """
        if nodes.shape != self.nodes.shape:
            raise FeaError(
                f"Moved nodes have shape {nodes.shape}, but the mesh has {self.nodes.shape}."
            )
        moved = TetMesh(nodes, self.tets)
        for name in ("faces", "boundary_facets", "face_neighbours"):
            if name in self.__dict__:
                moved.__dict__[name] = self.__dict__[name]
        return moved

    # Cells ----------------------------------------------------------------------------------

    @cached_property
    def volumes(self) -> Float[np.ndarray, " cells"]:
        """Volume of each cell [mm³], exact for curved edges too; negative means inverted."""
        volumes = self._corner_determinants / 6
        if self.curved.any():
            # det J is cubic on curved cells; this rule is exact to degree 5.
            _, weight = cell_points(self.nodes[self.tets[self.curved]], TETRAHEDRON_5)
            volumes[self.curved] = weight.sum(axis=1)
        return volumes

    @cached_property
    def volume(self) -> float:
        """Volume of the mesh [mm³]."""
        return float(self.volumes.sum())

    @property
    def quadrature_points(self) -> Float[np.ndarray, "cells quad 3"]:
        """Positions of the quadrature points of each cell [mm]: where a modulus may be given."""
        return cell_points(self.nodes[self.tets], self.element_type.quadrature)[0]

    @cached_property
    def jacobians(self) -> Float[np.ndarray, "cells quad"]:
        """Determinant of the isoparametric map at the quadrature points [mm³]."""
        return self._determinants(self.element_type.quadrature.points)

    @cached_property
    def curved(self) -> Bool[np.ndarray, " cells"]:
        """Cells with a mid-edge node away from the middle of its edge; none of a tet4 mesh."""
        if self.element == "tet4":
            return np.zeros(len(self.tets), dtype=bool)
        return off_middle(self.nodes, self.tets)

    @cached_property
    def _corner_determinants(self) -> Float[np.ndarray, " cells"]:
        """Six times the volume between each cell's corners [mm³]."""
        x = self._corners_by_axis
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (x[:, k] - x[:, 0] for k in (1, 2, 3))
        return ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)

    @property
    def _corners_by_axis(self) -> Float[np.ndarray, "3 4 cells"]:
        # Long rows: on (cells, 3) arrays NumPy is several times slower.
        return np.ascontiguousarray(self.nodes.T)[:, np.ascontiguousarray(self.tets[:, :4].T)]

    def _determinants(self, points: Float[np.ndarray, "quad 3"]) -> Float[np.ndarray, "cells quad"]:
        det = np.repeat(self._corner_determinants[:, None], len(points), axis=1)
        if self.curved.any():
            det[self.curved] = cell_determinants(self.nodes[self.tets[self.curved]], points)
        return det

    # Faces ----------------------------------------------------------------------------------

    @cached_property
    def faces(self) -> tuple[Int[np.ndarray, " faces"], Bool[np.ndarray, " faces"]]:
        """All faces of all cells so sorted that shared ones are neighbours.

        Returns:
            4 * cell + face of the cell in that order, and whether each is the same as the next.
        """
        # One key a face, sorted once; two where the product of three node numbers would overflow.
        # By columns: NumPy takes seven times as long over rows of three.
        a, b, c = (
            self.tets[:, corner].astype(np.int64).ravel() for corner in FACES_OF_TETRAHEDRON.T[:3]
        )
        low, high = np.minimum(a, b), np.maximum(a, b)
        middle = np.maximum(low, np.minimum(high, c))
        low, high = np.minimum(low, c), np.maximum(high, c)
        pair = low * len(self.nodes) + middle
        if len(self.nodes) ** 3 < np.iinfo(np.int64).max:
            keys = (pair * len(self.nodes) + high,)
        else:
            keys = (high, pair)
        order = np.argsort(keys[0]) if len(keys) == 1 else np.lexsort(keys)
        same = np.zeros(len(order), dtype=bool)
        same[:-1] = np.all([np.diff(key[order]) == 0 for key in keys], axis=0)
        return order, same

    @cached_property
    def boundary_facets(self) -> Int[np.ndarray, "facets corners"]:
        """Nodes of each outer facet, counter-clockwise seen from outside.

        Three corners, or three corners and the mid-edge nodes of edges 01, 12, 20.
        """
        order, same = self.faces
        alone = ~same
        alone[1:] &= ~same[:-1]
        cell, face = np.divmod(np.sort(order[alone]), 4)
        columns = FACES_OF_TETRAHEDRON[:, : 3 if self.element == "tet4" else 6]
        return self.tets[cell[:, None], columns[face]]

    @cached_property
    def face_neighbours(self) -> Int[np.ndarray, "pairs 2"]:
        """The two cells on either side of each inner face."""
        order, same = self.faces
        (first,) = np.nonzero(same)
        return np.stack([order[first], order[first + 1]], axis=1) // 4

    @cached_property
    def facet_areas(self) -> Float[np.ndarray, " facets"]:
        """Area of each boundary facet [mm²]."""
        return self._boundary_integrals[0]

    @cached_property
    def facet_normals(self) -> Float[np.ndarray, "facets 3"]:
        """Unit outward normal of each boundary facet (of its mean plane, where curved)."""
        vector_area = self._boundary_integrals[1]
        return vector_area / np.linalg.norm(vector_area, axis=1, keepdims=True)

    @cached_property
    def facet_centroids(self) -> Float[np.ndarray, "facets 3"]:
        """Centroid of each boundary facet [mm]; beside the nodes' surface where it is curved."""
        area, _, moment = self._boundary_integrals
        return moment / area[:, None]

    @cached_property
    def _boundary_integrals(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.facet_integrals(self.boundary_facets)

    def facet_integrals(
        self, facets: Int[np.ndarray, "facets corners"]
    ) -> tuple[
        Float[np.ndarray, " facets"], Float[np.ndarray, "facets 3"], Float[np.ndarray, "facets 3"]
    ]:
        """Integrals of 1, of the normal and of the position over each facet."""
        x, n = facet_points(self.nodes[facets], TRIANGLES[facets.shape[1]].quadrature)
        area = np.linalg.norm(n, axis=-1)
        return area.sum(axis=1), n.sum(axis=1), np.einsum("fq,fqx->fx", area, x)

    # Choosing regions -----------------------------------------------------------------------

    def nodes_where(
        self, test: Callable[[Float[np.ndarray, "nodes 3"]], Bool[np.ndarray, " nodes"]]
    ) -> Int[np.ndarray, " nodes"]:
        """Nodes, inner ones and mid-edge ones too, whose position passes a test.

        `mesh.nodes_where(lambda x: x[:, 0] < 1e-6)` are the nodes of the face x = 0: leave room for
        rounding. Of the surface alone: `np.intersect1d(found, mesh.boundary_facets)`.

        Args:
            test: takes positions [mm], one a row, and tells which of them are chosen.

        Raises:
            FeaError: when no node passes, or the test does not return a truth value for each.
        """
        return np.flatnonzero(self._chosen(test, self.nodes, "nodes"))

    def facets_where(
        self, test: Callable[[Float[np.ndarray, "facets 3"]], Bool[np.ndarray, " facets"]]
    ) -> Int[np.ndarray, "facets corners"]:
        """Rows of `boundary_facets` whose centroid passes a test: where a load acts.

        The centroid of a facet on a hole or fillet lies a little beside it: test with a margin, as
        in `mesh.facets_where(lambda x: np.hypot(x[:, 0], x[:, 1]) < 5.2)` for a bore of radius 5.
        By normal: `mesh.boundary_facets[mesh.facet_normals[:, 2] > 0.99]`.

        Args:
            test: takes centroids [mm], one a row, and tells which of them are chosen.

        Raises:
            FeaError: when no facet passes, or the test does not return a truth value for each.
        """
        return self.boundary_facets[self._chosen(test, self.facet_centroids, "boundary facets")]

    def _chosen(
        self, test: Callable[..., np.ndarray], points: Float[np.ndarray, "n 3"], what: str
    ) -> Bool[np.ndarray, " n"]:
        chosen = np.asarray(test(points))
        if chosen.dtype != bool or chosen.shape != (len(points),):
            raise FeaError(
                f"The test returns {chosen.dtype} of shape {chosen.shape}; return one truth value "
                f"for each of the {len(points)} positions, as x[:, 0] < 1 does."
            )
        if not chosen.any():
            low, high = position_text(self.nodes.min(axis=0)), position_text(self.nodes.max(axis=0))
            raise FeaError(
                f"The test chooses none of the {len(points)} {what}; the mesh spans {low} to "
                f"{high} mm. Widen it: positions are rounded, so compare with a margin."
            )
        return chosen

    # Checking -------------------------------------------------------------------------------

    def check(self) -> None:
        """Raise unless every cell can be integrated and every node belongs to one.

        Cells with curved edges are looked at where stiffness and stress are computed, their
        quadrature points, and at their nodes: a cell may fold at a corner while its quadrature
        points are sound.

        Raises:
            FeaError: for positions that are not numbers, edges of tet10 cells that do not have one
                mid-edge node, inverted, folded or flat cells, nodes outside all cells, or a face
                that more than two cells share.
        """
        finite = np.isfinite(self.nodes).all(axis=1)
        if not finite.all():
            node = int(np.argmin(finite))
            raise FeaError(
                f"{np.count_nonzero(~finite)} of {len(self.nodes)} nodes have positions that are "
                f"not numbers: the first, node {node}, is at {position_text(self.nodes[node])}; check what "
                "made or moved the mesh."
            )
        # First, as cells whose nodes are in another order are folded too.
        if self.element == "tet10":
            check_mid_edge_nodes(self.nodes, self.tets)
        self._check_cells()
        loose = np.bincount(self.tets.ravel(), minlength=len(self.nodes)) == 0
        if loose.any():
            node = int(np.argmax(loose))
            raise FeaError(
                f"{np.count_nonzero(loose)} mesh nodes belong to no tetrahedron: the first, node "
                f"{node}, is at {position_text(self.nodes[node])} mm; remove them, or add their cells."
            )
        order, same = self.faces
        thrice = same[:-1] & same[1:]
        if thrice.any():
            cells = order[np.argmax(thrice) + np.arange(3)] // 4
            raise FeaError(
                f"Cells {', '.join(str(c) for c in np.sort(cells))} all share one face, at "
                f"{self._place(int(cells[0]))}: cells overlap or are listed twice; remove them."
            )

    def _check_cells(self) -> None:
        points = np.concatenate([self.element_type.quadrature.points, self.element_type.nodes])
        if not self.curved.any():
            points = points[:1]
        det = self._determinants(points)
        corners = self._corners_by_axis
        longest = np.zeros(len(self.tets))
        for a, b in TETRAHEDRON_EDGES:
            edge = corners[:, a] - corners[:, b]
            np.maximum(longest, np.einsum("xc,xc->c", edge, edge), out=longest)
        bad = (det <= FLAT_DETERMINANT * longest[:, None] ** 1.5).any(axis=1)
        if not bad.any():
            return
        count, cells = int(np.count_nonzero(bad)), len(self.tets)
        cell = int(np.argmax(bad))
        where = f"the first, cell {cell} with its centre at {self._place(cell)}, has"
        said = f"{count} of {cells} tetrahedra are flat or inverted: {where}"
        if self._corner_determinants[cell] > FLAT_DETERMINANT * longest[cell] ** 1.5:
            worst = points[int(np.argmin(det[cell]))]
            at = self.element_type.shape(worst[None])[0] @ self.nodes[self.tets[cell]]
            raise FeaError(
                f"{said} curved edges and folds over at {position_text(at)} mm (det J = "
                f"{det[cell].min():.3g}, {self._corner_determinants[cell]:.3g} if its edges were "
                "straight); move its mid-edge nodes towards the middle of their edges, or remesh."
            )
        remedy = "remesh, or merge nodes that coincide"
        if self._corner_determinants[cell] < -FLAT_DETERMINANT * longest[cell] ** 1.5:
            rows = "every cell" if count == cells else "these cells"
            remedy = f"reorder the nodes of {rows} as [:, {RIGHTED[self.tets.shape[1]]}], or remesh"
        raise FeaError(f"{said} volume {self.volumes[cell]:.3g} mm³; {remedy}.")

    def _place(self, cell: int) -> str:
        return f"{position_text(self.nodes[self.tets[cell, :4]].mean(axis=0))} mm"


def tet_volumes(
    nodes: Float[np.ndarray, "nodes 3"], tets: Int[np.ndarray, "cells 4"]
) -> Float[np.ndarray, " cells"]:
    """Volumes of tets with straight edges, whether they make a mesh or not; negative means inverted."""
    a, b, c, d = np.moveaxis(nodes[tets], 1, 0)
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6
