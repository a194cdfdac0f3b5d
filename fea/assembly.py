"""Element matrices -> sparse stiffness on a fixed pattern, and the symmetric removal of supports.

The pattern depends on connectivity only. It is found once; afterwards assembly is one product of a
sparse matrix of ones with the stack of element matrices, whatever the elements are.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import bsr_array, csr_array

from fea.errors import FeaError


@dataclass(frozen=True, eq=False)
class Pattern:
    """Where each entry of each element matrix goes in the global matrix.

    Attributes:
        dofs: size of the global matrix.
        block: degrees of freedom of a node; consecutive dofs `block * node + component`.
        corners: nodes of an element.
        indptr: row starts of the node graph in compressed form.
        indices: column nodes of the node graph, sorted in each row.
        scatter: ones; row: a block of the global matrix, column: a block of an element matrix.
    """

    dofs: int
    block: int
    corners: int
    indptr: Int[np.ndarray, " rows"]
    indices: Int[np.ndarray, " blocks"]
    scatter: csr_array

    @classmethod
    def from_elements(
        cls, dofs_of_elements: Int[np.ndarray, "elements k"], dofs: int, *, block: int = 1
    ) -> "Pattern":
        """Find the pattern of elements that couple all of their dofs.

        Args:
            dofs_of_elements: global dof of each row of each element matrix.
            dofs: number of global dofs.
            block: dofs of a node. With `block > 1` every `block` consecutive element dofs must be
                the consecutive dofs of one node; pattern and assembly are then `block²` cheaper.

        Raises:
            FeaError: when a dof lies outside the matrix, or dofs do not come in blocks.
        """
        if (
            dofs_of_elements.size
            and not 0 <= dofs_of_elements.min() <= dofs_of_elements.max() < dofs
        ):
            raise FeaError(
                f"Elements refer to dofs {dofs_of_elements.min()} to {dofs_of_elements.max()}, "
                f"but the model has dofs 0 to {dofs - 1}; give each node its dofs."
            )
        node_of = dofs_of_elements[:, ::block] // block
        blocks = (block * node_of[:, :, None] + np.arange(block)).reshape(len(node_of), -1)
        if dofs % block or not np.array_equal(blocks, dofs_of_elements):
            raise FeaError(f"Element dofs do not come in blocks of {block}; use block=1.")
        return cls._from_nodes(node_of.astype(np.int64), dofs // block, block)

    @classmethod
    def from_nodes(
        cls, nodes_of_elements: Int[np.ndarray, "elements corners"], nodes: int, *, block: int
    ) -> "Pattern":
        """Find the pattern of elements whose nodes carry `block` dofs each."""
        dofs = block * nodes_of_elements[:, :, None].astype(np.int64) + np.arange(block)
        return cls.from_elements(
            dofs.reshape(len(nodes_of_elements), -1), block * nodes, block=block
        )

    @classmethod
    def _from_nodes(
        cls, node_of: Int[np.ndarray, "elements corners"], nodes: int, block: int
    ) -> "Pattern":
        corners = node_of.shape[1]
        key = (node_of[:, :, None] * nodes + node_of[:, None, :]).ravel()
        # The diagonal always exists, so that an unconnected node is an explicit zero pivot.
        diagonal = np.arange(nodes, dtype=np.int64) * (nodes + 1)
        distinct, target = np.unique(np.concatenate([key, diagonal]), return_inverse=True)
        row, column = np.divmod(distinct, max(nodes, 1))
        target = target[: len(key)].astype(np.int32)
        scatter = csr_array(
            (np.ones(len(key)), (target, np.arange(len(key), dtype=np.int32))),
            shape=(len(distinct), len(key)),
        )
        indptr = np.searchsorted(row, np.arange(nodes + 1)).astype(np.int32)
        return cls(nodes * block, block, corners, indptr, column.astype(np.int32), scatter)

    def assemble(self, values: Float[np.ndarray, "elements k k"]) -> csr_array:
        """Sum element matrices into the global matrix, with sorted columns.

        Args:
            values: element matrices, rows and columns ordered as the elements' dofs.
        """
        c, b = self.corners, self.block
        # element, row corner, row component, column corner, column component -> blocks
        blocks = np.asarray(values).reshape(-1, c, b, c, b).transpose(0, 1, 3, 2, 4)
        data = self.scatter @ blocks.reshape(-1, b * b)
        K = bsr_array(
            (data.reshape(-1, b, b), self.indices, self.indptr), shape=(self.dofs, self.dofs)
        ).tocsr()
        K.has_sorted_indices = True
        return K

    def components(self) -> Int[np.ndarray, " nodes"]:
        """Number of the connected part that each node belongs to."""
        from scipy.sparse.csgraph import connected_components

        nodes = len(self.indptr) - 1
        graph = csr_array((np.ones(len(self.indices)), self.indices, self.indptr), (nodes, nodes))
        return connected_components(graph, directed=False)[1].astype(np.int64)


@dataclass(frozen=True, eq=False)
class Reduced:
    """The system without its supports: symmetric, positive definite, still in whole blocks.

    With u = p on the fixed dofs, K_ff u_f = f_f - K_fp p. Nodes with every dof fixed leave the
    matrix. A fixed dof of a node that also has free dofs stays as an uncoupled diagonal entry
    with load zero, so that blocks stay whole (algebraic multigrid needs them); its prescribed
    value is added afterwards.

    Attributes:
        fixed: dofs whose displacement is prescribed.
        kept: dofs of the reduced matrix, ascending.
        block: dofs of a node.
        entries: positions in the data of K that make up the reduced matrix.
        indptr: row starts of the reduced matrix.
        indices: columns of the reduced matrix.
    """

    fixed: Bool[np.ndarray, " dofs"]
    kept: Int[np.ndarray, " kept"]
    block: int
    entries: Int[np.ndarray, " entries"]
    indptr: Int[np.ndarray, " rows"]
    indices: Int[np.ndarray, " entries"]

    @classmethod
    def from_matrix(
        cls, K: csr_array, fixed: Bool[np.ndarray, " dofs"], *, block: int = 1
    ) -> "Reduced":
        """Prepare the reduction of every matrix with the pattern of K.

        Args:
            K: a matrix made by `Pattern.assemble`.
            fixed: dofs whose displacement is prescribed.
            block: dofs of a node.
        """
        kept_dof = np.repeat(~fixed.reshape(-1, block).all(axis=1), block)
        free = ~fixed
        row = np.repeat(np.arange(len(K.indptr) - 1, dtype=np.int32), np.diff(K.indptr))
        stays = (free[row] & free[K.indices]) | (kept_dof[row] & (row == K.indices))
        entries = np.flatnonzero(stays)
        number = np.cumsum(kept_dof) - 1
        kept = np.flatnonzero(kept_dof)
        per_row = np.bincount(number[row[entries]], minlength=len(kept))
        indptr = np.concatenate([[0], np.cumsum(per_row)]).astype(np.int32)
        indices = number[K.indices[entries]].astype(np.int32)
        return cls(fixed, kept, block, entries, indptr, indices)

    def matrix(self, K: csr_array) -> csr_array:
        """The reduced matrix of a K with the pattern this was prepared for."""
        size = len(self.kept)
        reduced = csr_array((K.data[self.entries], self.indices, self.indptr), (size, size))
        reduced.has_sorted_indices = True
        return reduced

    def restrict(self, field: Float[np.ndarray, "dofs ..."]) -> Float[np.ndarray, "kept ..."]:
        """Values on the reduced dofs, zero where a kept dof is fixed."""
        kept = field[self.kept].copy()
        kept[self.fixed[self.kept]] = 0.0
        return kept

    def load(
        self,
        K: csr_array,
        forces: Float[np.ndarray, "dofs ..."],
        prescribed: Float[np.ndarray, "dofs ..."],
    ) -> Float[np.ndarray, "kept ..."]:
        """Right-hand side f_f - K_fp p of the reduced system.

        Args:
            K: the full matrix.
            forces: nodal forces, one column a load case.
            prescribed: prescribed displacements, anything on free dofs; shaped as `forces`.
        """
        p = self._on_fixed(prescribed)
        return self.restrict(forces - K @ p if p.any() else forces)

    def expand(
        self,
        x: Float[np.ndarray, "kept ..."],
        prescribed: Float[np.ndarray, "dofs ..."],
    ) -> Float[np.ndarray, "dofs ..."]:
        """The full field: the solution on free dofs, the prescribed values on fixed dofs."""
        u = self._on_fixed(prescribed)
        free = ~self.fixed[self.kept]
        u[self.kept[free]] = x[free]
        return u

    def _on_fixed(self, field: Float[np.ndarray, "dofs ..."]) -> Float[np.ndarray, "dofs ..."]:
        values = np.zeros_like(field)
        values[self.fixed] = field[self.fixed]
        return values
