"""Straight segments between points with named values: what a VTK file with lines holds."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

# Cell types of the VTK file formats that are lines: one segment, several, and a bent one with its
# middle as third point.
VTK_LINE, VTK_POLY_LINE, VTK_QUADRATIC_EDGE = 3, 4, 21


@dataclass(frozen=True, eq=False)
class LineSet:
    """Segments and values.

    Attributes:
        points: positions, in the file's unit.
        segments: the two points of each.
        point_data: values at the points.
        segment_data: values of the cells that segments are pieces of.
        others: number of cells of the file that are no lines.
    """

    points: Float[np.ndarray, "points 3"]
    segments: Int[np.ndarray, "struts 2"]
    point_data: Mapping[str, np.ndarray]
    segment_data: Mapping[str, np.ndarray]
    others: int


def line_set(
    points: np.ndarray,
    lines: tuple[np.ndarray, np.ndarray],
    point_data: Mapping[str, np.ndarray],
    line_data: Mapping[str, np.ndarray],
    *,
    others: int,
) -> LineSet:
    """The segments of lines through several points.

    Args:
        points: positions, three numbers each.
        lines: the points of all lines, one line after the other, and where in them each line ends.
        point_data: values at the points.
        line_data: values of the lines.
        others: number of cells that are no lines.

    Raises:
        ValueError: when ends do not increase, lie elsewhere than the points do, or points are named
            that are not there.
    """
    connectivity, offsets = (part.astype(np.int64) for part in lines)
    points = points.astype(np.float64).reshape(-1, 3)
    first = np.concatenate([np.zeros(1, np.int64), offsets])
    if (np.diff(first) < 0).any() or first[-1] != len(connectivity):
        raise ValueError("where its lines end does not fit their points")
    if len(connectivity) and not 0 <= connectivity.min() <= connectivity.max() < len(points):
        raise ValueError(f"its lines name points beyond 0 to {len(points) - 1}")
    line = np.repeat(np.arange(len(offsets)), np.diff(first))
    within = line[1:] == line[:-1]
    segments = np.stack([connectivity[:-1][within], connectivity[1:][within]], axis=1)
    of_segments = {name: values[line[1:][within]] for name, values in line_data.items()}
    return LineSet(points, segments, point_data, of_segments, others)


def select_lines(
    connectivity: np.ndarray, offsets: np.ndarray, types: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of cells of all types the lines: their points, where each ends, and which cells they are.

    Of bent lines the two ends are taken.

    Raises:
        ValueError: when there are not as many ends as types, or they do not fit.
    """
    connectivity, offsets = connectivity.astype(np.int64), offsets.astype(np.int64)
    length = np.diff(np.concatenate([np.zeros(1, np.int64), offsets]))
    if len(offsets) != len(types) or (length < 0).any() or length.sum() != len(connectivity):
        raise ValueError("where its cells end does not fit their points or types")
    is_line = np.isin(types, (VTK_LINE, VTK_POLY_LINE, VTK_QUADRATIC_EDGE))
    bent = types == VTK_QUADRATIC_EDGE
    if (length[bent] != 3).any():
        raise ValueError("it has bent lines of other than three points")
    kept = np.repeat(is_line, length)
    # The third point of a bent line is its last entry.
    kept[offsets[bent] - 1] = False
    return connectivity[kept], np.cumsum((length - bent)[is_line]), np.flatnonzero(is_line)
