"""A net of joints and struts made by putting unit cells side by side."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse
from jaxtyping import Float, Int

from texmap_opt.cells.unit_cell import TICKS, UnitCell


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


def tile(cell: UnitCell, shape: tuple[int, ...]) -> Net:
    """Put copies of a cell side by side and weld what neighbours share.

    Joints are compared by whole numbers of 1/`TICKS` cells, never by distance, so welding is exact.

    Args:
        cell: the unit cell.
        shape: number of cells along each of its axes.
    """
    d = cell.dimensions
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, d)
    reflected = (index % 2 == 1) & np.array(cell.mirrored)
    copies = np.where(reflected[:, None], TICKS - cell.ticks, cell.ticks) + index[:, None] * TICKS
    first, joint = weld(copies.reshape(-1, d))
    owner, local = np.divmod(first, len(cell.joints))
    joint_local = np.where(reflected[owner], 1 - cell.joints[local], cell.joints[local])

    ends = np.sort(joint.reshape(len(index), -1)[:, cell.struts].reshape(-1, 2), axis=1)
    key, first_strut, strut = np.unique(
        ends[:, 0] * len(first) + ends[:, 1], return_index=True, return_inverse=True
    )
    cells_of_copies = np.repeat(np.arange(len(index)), len(cell.struts))
    count = np.bincount(strut)
    return Net(
        shape=shape,
        joints=index[owner] + joint_local,
        joint_cell=index[owner],
        joint_local=joint_local,
        struts=np.stack(np.divmod(key, len(first)), axis=1),
        relative_radius=cell.relative_radius[first_strut % len(cell.struts)],
        sharing=scipy.sparse.csr_array(
            (1 / count[strut], (strut, cells_of_copies)), shape=(len(key), len(index))
        ),
        kind=np.zeros(len(key), np.int64),
        kinds=(cell.name,),
        section=cell.section,
    )


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
