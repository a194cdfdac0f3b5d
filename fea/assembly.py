"""Element matrices -> sparse stiffness on a fixed pattern, and the symmetric removal of supports.

A symmetric stiffness is a graph: one block for each node, one for each pair of nodes that share an
element; the block of (b, a) is the transpose of that of (a, b). So elements hand over the pairs of
their nodes once, and the pattern, which depends on connectivity only, sums them. Everything stays in
whole blocks: a node's dofs are never torn apart.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import bsr_array, coo_array, csc_array

from fea.errors import FeaError

# Edges whose two blocks are made mirror images, and pairs that are summed, at a time: their copies
# stay in the cache.
EDGES_AT_ONCE = 4096
PAIRS_AT_ONCE = 32_768


def node_pairs(
    corners: int,
) -> tuple[Int[np.ndarray, " pairs"], Int[np.ndarray, " pairs"]]:
    """Pairs of an element's nodes in the order of assembly: each with itself, then i < j."""
    i, j = np.triu_indices(corners, 1)
    itself = np.arange(corners)
    return np.concatenate([itself, i]), np.concatenate([itself, j])


@dataclass(frozen=True, eq=False)
class Pattern:
    """Where the node pairs of each element go in the global matrix.

    Attributes:
        nodes: number of nodes, and of block rows.
        indptr: row starts of the matrix in compressed block form.
        indices: block columns, sorted in each row.
        upper: positions of the blocks (a, b), a < b, of the edges of the node graph.
        lower: positions of their mirror images (b, a).
        diagonal: positions of the blocks (a, a); they always exist, so that a node without
            elements is an explicit zero pivot.
        scatter: ones; a column for each pair of each element of each group, a row for each edge
            met in the direction a < b, then each edge met in the other, then each node.
    """

    nodes: int
    indptr: Int[np.ndarray, " rows"]
    indices: Int[np.ndarray, " blocks"]
    upper: Int[np.ndarray, " edges"]
    lower: Int[np.ndarray, " edges"]
    diagonal: Int[np.ndarray, " nodes"]
    scatter: csc_array

    @classmethod
    def from_groups(cls, groups: Sequence[Int[np.ndarray, "_ _"]], nodes: int) -> "Pattern":
        """Find the pattern of elements that couple all dofs of all their nodes.

        Args:
            groups: nodes of each element, elements with equally many nodes in one group.
            nodes: number of nodes.

        Raises:
            FeaError: when an element refers to a node that does not exist.
        """
        diagonal, first, second = [], [], []
        for group in groups:
            owners = group.astype(np.int64)
            if owners.size and not 0 <= owners.min() <= owners.max() < nodes:
                raise FeaError(
                    f"Elements refer to nodes {owners.min()} to {owners.max()}, but the model has "
                    f"nodes 0 to {nodes - 1}."
                )
            corners = owners.shape[1]
            i, j = node_pairs(corners)
            diagonal.append(owners)
            first.append(owners[:, i[corners:]])
            second.append(owners[:, j[corners:]])
        a, b = (np.concatenate([each.ravel() for each in ends]) for ends in (first, second))
        key, edge = np.unique(np.minimum(a, b) * nodes + np.maximum(a, b), return_inverse=True)
        low, high = np.divmod(key, max(nodes, 1))
        edges = len(key)

        # Row of `scatter` of each pair of each element.
        across = np.split(
            edge + np.where(a < b, 0, edges), np.cumsum([pair.size for pair in first])[:-1]
        )
        row = np.concatenate(
            [
                np.concatenate([2 * edges + own, pairs.reshape(each.shape)], axis=1).ravel()
                for own, pairs, each in zip(diagonal, across, first, strict=True)
            ]
        )
        pairs = len(row)
        scatter = csc_array(
            (np.ones(pairs), row.astype(np.int32), np.arange(pairs + 1, dtype=np.int32)),
            shape=(2 * edges + nodes, pairs),
        )
        own = np.arange(nodes)
        graph = coo_array(
            (
                np.arange(2 * edges + nodes),
                (np.concatenate([low, high, own]), np.concatenate([high, low, own])),
            ),
            shape=(nodes, nodes),
        ).tocsr()
        graph.sort_indices()
        place = np.zeros(2 * edges + nodes, dtype=np.int64)
        place[np.asarray(graph.data, dtype=np.int64)] = np.arange(len(place))
        upper, lower, diagonal = np.split(place, [edges, 2 * edges])
        indptr, indices = graph.indptr.astype(np.int32), graph.indices.astype(np.int32)
        return cls(nodes, indptr, indices, upper, lower, diagonal, scatter)

    def sums(
        self, *values: Float[np.ndarray, "_ _ block block"]
    ) -> tuple[Float[np.ndarray, "edges block block"], Float[np.ndarray, "nodes block block"]]:
        """Sum the elements' pairs over the edges (a, b), a < b, and the nodes of the graph.

        Args:
            *values: of each group, one matrix for each of `node_pairs`; that of (j, i) is its
                transpose.
        """
        block = values[0].shape[-1]
        rows = [value.reshape(-1, block * block) for value in values]
        total = self.scatter @ (rows[0] if len(rows) == 1 else np.concatenate(rows))
        total = total.reshape(-1, block, block)
        edges = len(self.upper)
        return total[:edges] + total[edges : 2 * edges].transpose(0, 2, 1), total[2 * edges :]

    def matrix(
        self,
        edge_blocks: Float[np.ndarray, "edges block block"],
        node_blocks: Float[np.ndarray, "nodes block block"],
    ) -> bsr_array:
        """The symmetric matrix with these blocks."""
        block = node_blocks.shape[-1]
        data = np.zeros((len(self.indices), block, block))
        data[self.upper] = edge_blocks
        data[self.lower] = edge_blocks.transpose(0, 2, 1)
        data[self.diagonal] = node_blocks
        size = self.nodes * block
        return bsr_array((data, self.indices, self.indptr), shape=(size, size))

    def assemble(self, *values: Float[np.ndarray, "_ _ block block"]) -> bsr_array:
        """The sum of element matrices that are given as `node_pairs`, group by group."""
        return self.assemble_runs(values, block=values[0].shape[-1])

    def assemble_runs(
        self, runs: Iterable[Float[np.ndarray, "_ _ block block"]], *, block: int
    ) -> bsr_array:
        """The same for elements that come a run at a time, so that they are never there together.

        Args:
            runs: pairs of the first elements of the first group, of those that follow and so on.
            block: dofs of a node.
        """
        place = np.concatenate([self.upper, self.lower, self.diagonal])
        data, column = np.zeros((len(place), block**2)), 0
        for run in runs:
            pairs = run.reshape(-1, block**2)
            for first in range(0, len(pairs), PAIRS_AT_ONCE):
                some = pairs[first : first + PAIRS_AT_ONCE]
                target = place[self.scatter.indices[column : column + len(some)]]
                rows, row = np.unique(target, return_inverse=True)
                starts = np.arange(len(some) + 1)
                shape = (len(rows), len(some))
                data[rows] += csc_array((np.ones(len(some)), row, starts), shape=shape) @ some
                column += len(some)
        return self._mirrored(data.reshape(-1, block, block))

    def _mirrored(self, data: Float[np.ndarray, "blocks block block"]) -> bsr_array:
        """The matrix of blocks, of which those of an edge are parts of one sum."""
        for first in range(0, len(self.upper), EDGES_AT_ONCE):
            upper = self.upper[first : first + EDGES_AT_ONCE]
            lower = self.lower[first : first + EDGES_AT_ONCE]
            both = data[upper] + data[lower].transpose(0, 2, 1)
            data[upper] = both
            data[lower] = both.transpose(0, 2, 1)
        size = self.nodes * data.shape[-1]
        return bsr_array((data, self.indices, self.indptr), shape=(size, size))


@dataclass(frozen=True, eq=False)
class Reduced:
    """The system without its supports: symmetric, positive definite, still in whole blocks.

    With u = p on the fixed dofs, K_ff u_f = f_f - K_fp p. Nodes with every dof fixed leave the
    matrix. A fixed dof of a node that also has free dofs stays as an uncoupled diagonal entry
    with load zero, so that blocks stay whole (multigrid needs them); its prescribed value is added
    afterwards.

    Attributes:
        fixed: dofs whose displacement is prescribed.
        kept: nodes of the reduced matrix, ascending.
        entries: positions of its blocks in the full matrix.
        indptr: row starts of the reduced matrix.
        indices: block columns of the reduced matrix.
        masked: positions, among its blocks, of those with a fixed dof.
        mask: which of their entries stay.
        uncoupled: the same without the diagonal entries of fixed dofs.
    """

    fixed: Bool[np.ndarray, "nodes block"]
    kept: Int[np.ndarray, " kept"]
    entries: Int[np.ndarray, " blocks"]
    indptr: Int[np.ndarray, " rows"]
    indices: Int[np.ndarray, " blocks"]
    masked: Int[np.ndarray, " masked"]
    mask: Bool[np.ndarray, "masked block block"]
    uncoupled: Bool[np.ndarray, "masked block block"]

    @classmethod
    def from_pattern(
        cls, pattern: Pattern | bsr_array, fixed: Bool[np.ndarray, "nodes block"]
    ) -> "Reduced":
        """Prepare the reduction of every matrix with this pattern.

        Args:
            pattern: of the full matrix, or a matrix that has it.
            fixed: dofs whose displacement is prescribed.
        """
        stays = np.logical_not(fixed.all(axis=1))
        row = np.repeat(np.arange(len(fixed)), np.diff(pattern.indptr))
        column = pattern.indices
        entries = np.flatnonzero(stays[row] & stays[column])
        row, column = row[entries], column[entries]
        number = np.cumsum(stays) - 1
        kept = np.flatnonzero(stays)
        per_row = np.bincount(number[row], minlength=len(kept))
        indptr = np.concatenate([[0], np.cumsum(per_row)]).astype(np.int32)
        partly = np.array(fixed.any(axis=1))
        masked = np.flatnonzero(partly[row] | partly[column])
        free = ~fixed
        uncoupled = free[row[masked]][:, :, None] & free[column[masked]][:, None, :]
        own = row[masked] == column[masked]
        mask = uncoupled | (own[:, None, None] & np.eye(fixed.shape[1], dtype=bool))
        indices = number[column].astype(np.int32)
        return cls(fixed, kept, entries, indptr, indices, masked, mask, uncoupled)

    def matrix(self, K: bsr_array, *, eigen: bool = False) -> bsr_array:
        """The reduced matrix of a K with the pattern this was prepared for.

        Args:
            K: the full matrix.
            eigen: whether it is the right-hand matrix of an eigenproblem (mass, geometric
                stiffness): fixed dofs that stay are then zero in it, so that they have no
                eigenvalue but 1/0.
        """
        data = K.data[self.entries]
        data[self.masked] *= self.uncoupled if eigen else self.mask
        size = len(self.kept) * K.blocksize[0]
        return bsr_array((data, self.indices, self.indptr), shape=(size, size))

    def restrict(self, field: Float[np.ndarray, "nodes block *more"]) -> np.ndarray:
        """Values on the reduced dofs [kept * block, ...], zero where a kept dof is fixed."""
        kept = field[self.kept].copy()
        kept[self.fixed[self.kept]] = 0.0
        return kept.reshape(len(kept) * field.shape[1], *field.shape[2:])

    def expand(
        self, x: Float[np.ndarray, "dofs cases"], value: Float[np.ndarray, "nodes block"]
    ) -> Float[np.ndarray, "cases nodes block"]:
        """The full fields: solutions on free dofs, the prescribed value on fixed dofs.

        Args:
            x: solutions of the reduced system, one a column.
            value: prescribed displacements, anything on free dofs.
        """
        nodes, block = self.fixed.shape
        u = np.zeros((x.shape[1], nodes, block))
        u[:, self.kept] = x.T.reshape(x.shape[1], len(self.kept), block)
        u[:, self.fixed] = value[self.fixed]
        return u
