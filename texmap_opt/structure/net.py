"""A net of joints and struts in units of cells, and the welding that makes one of copies."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse
from jaxtyping import Float, Int


@dataclass(frozen=True, eq=False)
class Net:
    """A block of unit cells, neighbours sharing joints and struts; no position in space yet.

    Attributes:
        shape: number of cells along each axis.
        joints: positions in units of cells, 0 to `shape`.
        joint_cell: one cell that holds each joint, by its index along each axis.
        joint_local: the joint's coordinates in that cell, 0 to 1.
        struts: the two joints of each strut, smaller index first; no strut appears twice.
        relative_radius: radius of each strut over the radius asked for.
        sharing: matrix struts x cells (cells in C order) that averages over the cells sharing a
            strut; each row sums to one.
        kind: index into `kinds` of each strut.
        kinds: names of the unit cells.
        section: "round", "square" or "wall".
    """

    shape: tuple[int, ...]
    joints: Float[np.ndarray, "joints d"]
    joint_cell: Int[np.ndarray, "joints d"]
    joint_local: Float[np.ndarray, "joints d"]
    struts: Int[np.ndarray, "struts 2"]
    relative_radius: Float[np.ndarray, " struts"]
    sharing: scipy.sparse.csr_array
    kind: Int[np.ndarray, " struts"]
    kinds: tuple[str, ...]
    section: str

    @property
    def cell(self) -> Int[np.ndarray, " struts"]:
        """Number of the first of the cells that share each strut, in C order."""
        return self.sharing.indices[self.sharing.indptr[:-1]].astype(np.int64)


def weld(
    ticks: Int[np.ndarray, "samples d"],
) -> tuple[Int[np.ndarray, " joints"], Int[np.ndarray, " samples"]]:
    """First occurrence of each distinct point, and the point each sample is."""
    key = np.zeros(len(ticks), np.int64)
    # Ranks along each axis are small, so three of them fit one 64-bit key; ticks would not.
    for axis in range(ticks.shape[1]):
        values, rank = np.unique(ticks[:, axis], return_inverse=True)
        key = key * len(values) + rank
    _, first, joint = np.unique(key, return_index=True, return_inverse=True)
    return first, joint
