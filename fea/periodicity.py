"""Which points of one period are images of each other, and matrices on the points that are left.

A periodic structure is given by what lies in one period: points, and three period vectors, or two in
the plane. Points that differ by whole periods are one point, so stiffness is summed on one number for
each.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import bsr_array, coo_array, csc_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from fea.errors import FeaError, position_text

# Images may miss each other by this share of a period: surfaces kept in single precision are rounded
# by 1e-7.
SAME = 1e-6

# Up to this share they are too far apart to be one point and too close to be two.
UNCLEAR = 1e-5

# Largest cosine-like measure |det P| / (product of lengths) of periods that span no volume.
FLAT = 1e-9


@dataclass(frozen=True, eq=False)
class Images:
    """Points of a block as images of the points of one period.

    Attributes:
        number: of the point that each point is an image of.
        first: the point that stands for each number.
        offset: whole periods from that point to each point.
    """

    number: Int[np.ndarray, " points"]
    first: Int[np.ndarray, " numbers"]
    offset: Int[np.ndarray, "points d"]


def cell_volume(periods: Float[np.ndarray, "d d"]) -> float:
    """Volume of one period [mm³], or its area in the plane [mm²].

    Args:
        periods: the period vectors, one a row [mm].

    Raises:
        FeaError: when they are not numbers or span no volume.
    """
    # Of NaN, NumPy's determinant would warn.
    volume = abs(float(np.linalg.det(periods))) if np.isfinite(periods).all() else 0.0
    if not volume > FLAT * float(np.prod(np.linalg.norm(periods, axis=1))):
        rows = ", ".join(position_text(row) for row in periods)
        nothing, number = ("volume", "three") if len(periods) == 3 else ("area", "two")
        raise FeaError(
            f"The periods {rows} mm span no {nothing}; give {number} vectors, one a row, that repeat the "
            "cell."
        )
    return volume


def images(points: Float[np.ndarray, "points d"], periods: Float[np.ndarray, "d d"]) -> Images:
    """Find which points differ by whole periods, in coordinates of the periods.

    Args:
        points: positions [mm].
        periods: the period vectors, one a row [mm].

    Raises:
        FeaError: when the periods span no volume, two points are at one place, or two are so close
            that it is unclear whether they are images.
    """
    cell_volume(periods)
    share = np.linalg.solve(periods.T, points.T).T
    # Rounding must not take -1e-17 to 1, which the tree refuses.
    inside = np.where((wrapped := share - np.floor(share)) < 1, wrapped, 0.0)
    pairs = KDTree(inside, boxsize=1.0).query_pairs(UNCLEAR, p=np.inf, output_type="ndarray")
    step = share[pairs[:, 1]] - share[pairs[:, 0]]
    apart = np.abs(step - np.rint(step)).max(axis=1)
    if (apart > SAME).any():
        worst = int(np.argmax(apart))
        a, b = pairs[worst]
        raise FeaError(
            f"Points {a} at {position_text(points[a])} mm and {b} at {position_text(points[b])} mm "
            f"are images of each other but for {apart[worst]:.2g} periods, more than {SAME:g}; move "
            "them so that they match, or check the periods."
        )
    graph = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(len(points), len(points)))
    _, label = connected_components(graph, directed=False)
    # Numbered in the order of the points.
    _, first, number = np.unique(label, return_index=True, return_inverse=True)
    offset = np.rint(share - share[first[number]]).astype(np.int64)
    _check_places(points, number, offset)
    return Images(number.astype(np.int64), first, offset)


def _check_places(
    points: Float[np.ndarray, "points d"],
    number: Int[np.ndarray, " points"],
    offset: Int[np.ndarray, "points d"],
) -> None:
    order = np.lexsort((*offset.T, number))
    key = np.column_stack([number, offset])[order]
    again = np.flatnonzero((key[1:] == key[:-1]).all(axis=1))
    if len(again):
        a, b = sorted(order[again[0] : again[0] + 2].tolist())
        raise FeaError(
            f"Points {a} and {b} are both at {position_text(points[a])} mm; merge them into one."
        )


def check_connected(
    ends: Int[np.ndarray, "links 2"], points: Float[np.ndarray, "points d"], what: str
) -> None:
    """Refuse a periodic structure that consists of several.

    Args:
        ends: numbers of linked points.
        points: position of each number [mm].
        what: the structure in words.

    Raises:
        FeaError: with a place in the smallest part.
    """
    count = len(points)
    graph = coo_array((np.ones(len(ends)), tuple(ends.T)), shape=(count, count))
    parts, part_of = connected_components(graph, directed=False)
    if parts > 1:
        size = np.bincount(part_of)
        lone = int(np.argmax(part_of == np.argmin(size)))
        raise FeaError(
            f"The periodic {what} falls into {parts} parts that nothing joins, one of them at "
            f"{position_text(points[lone])} mm; join them, or homogenise each alone."
        )


def summed_blocks(
    rows: Int[np.ndarray, " entries"],
    columns: Int[np.ndarray, " entries"],
    blocks: Float[np.ndarray, "entries block block"],
    count: int,
) -> bsr_array:
    """The matrix of blocks, those at one place summed.

    Args:
        rows: block row of each.
        columns: block column of each.
        blocks: the blocks.
        count: block rows of the matrix.
    """
    size = blocks.shape[-1]
    key, place = np.unique(rows * np.int64(count) + columns, return_inverse=True)
    entries = len(place)
    scatter = csc_array(
        (np.ones(entries), place.astype(np.int32), np.arange(entries + 1, dtype=np.int32)),
        shape=(len(key), entries),
    )
    data = (scatter @ blocks.reshape(entries, -1)).reshape(-1, size, size)
    row, column = np.divmod(key, count)
    indptr = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=count))])
    return bsr_array(
        (data, column.astype(np.int32), indptr.astype(np.int32)), shape=(count * size, count * size)
    )


def held(K: bsr_array, *, displacements: int = 3) -> bsr_array:
    """K with the displacements of node 0 at rest: uncoupled, with a stiffness of their own.

    Args:
        K: in whole node blocks.
        displacements: how many dofs of a node these are; they come first.
    """
    data = K.data.copy()
    row = np.repeat(np.arange(len(K.indptr) - 1), np.diff(K.indptr))
    in_row, in_column = row == 0, K.indices == 0
    own = int(np.flatnonzero(in_row & in_column)[0])
    # Not their own diagonal: that of a single joint is zero.
    stiff = float(K.diagonal().max())
    first = np.arange(displacements)
    data[in_row, :displacements, :] = 0.0
    data[in_column, :, :displacements] = 0.0
    data[own, first, first] = stiff
    return bsr_array((data, K.indices, K.indptr), shape=K.shape)


# Displacement gradients of the six unit strains, Voigt order; engineering shears, no rotation.
UNIT_STRAINS = np.zeros((6, 3, 3))
UNIT_STRAINS[[0, 1, 2], [0, 1, 2], [0, 1, 2]] = 1.0
UNIT_STRAINS[[3, 3, 4, 4, 5, 5], [1, 2, 0, 2, 0, 1], [2, 1, 2, 0, 1, 0]] = 0.5
