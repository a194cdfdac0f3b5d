"""What of a unit cell lies in each of its faces: what a neighbour of another kind has to meet."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from texmap_opt.cells.unit_cell import TICKS, UnitCell

AXES = "xyz"


@dataclass(frozen=True, eq=False)
class FacePattern:
    """Joints and struts in one face of a unit cell.

    Attributes:
        joints: their numbers in the cell.
        places: their coordinates along the axes of the face, in steps of 1/`TICKS`.
        struts: the numbers in the cell of those with both ends in the face.
        ends: of each of these struts, as rows of `joints`.
    """

    joints: Int[np.ndarray, " joints"]
    places: Int[np.ndarray, "joints across"]
    struts: Int[np.ndarray, " struts"]
    ends: Int[np.ndarray, "struts 2"]

    @property
    def points(self) -> frozenset[tuple[int, ...]]:
        """The places without their order: equal where two faces share all joints."""
        return frozenset(map(tuple, self.places.tolist()))

    @property
    def lines(self) -> frozenset[frozenset[tuple[int, ...]]]:
        """The struts by the places of their ends: equal where two faces share all struts."""
        return frozenset(frozenset(map(tuple, pair)) for pair in self.places[self.ends].tolist())


def face_pattern(
    cell: UnitCell, axis: int, side: int, *, reflected: tuple[bool, ...] | None = None
) -> FacePattern:
    """The pattern in one face of a cell; in two dimensions in one edge.

    Args:
        cell: the unit cell.
        axis: the face is normal to it.
        side: 0 for the lower of the two faces, 1 for the upper.
        reflected: for each axis whether this copy of the cell is reflected; None: it is not.
    """
    turned = np.zeros(cell.dimensions, bool) if reflected is None else np.array(reflected)
    ticks = np.where(turned, TICKS - cell.ticks, cell.ticks)
    inside = ticks[:, axis] == side * TICKS
    struts = np.flatnonzero(inside[cell.struts].all(axis=1))
    row = np.cumsum(inside) - 1
    return FacePattern(
        joints=np.flatnonzero(inside),
        places=np.delete(ticks[inside], axis, axis=1),
        struts=struts,
        ends=row[cell.struts[struts]],
    )


def face_patterns_text(cell: UnitCell, library: Iterable[UnitCell]) -> str:
    """The faces of a cell in lines: what lies in them, and which cells have the same joints there.

    Such a neighbour is joined without any other strut; others by struts that are split where they
    cross, or by transition struts (docs/several-cells.md).

    Args:
        cell: the unit cell.
        library: cells to compare with; of other dimensions or itself: left out.
    """
    others = [
        other
        for other in library
        if other.name != cell.name and other.dimensions == cell.dimensions
    ]
    faces: dict[tuple, list[str]] = {}
    for axis in range(cell.dimensions):
        for side in (0, 1):
            pattern = face_pattern(cell, axis, side)
            same = tuple(
                other.name + ("" if met.lines == pattern.lines else " (other struts)")
                for other in others
                if (met := face_pattern(other, axis, side)).points == pattern.points
            )
            described = (pattern.points, pattern.lines, same)
            faces.setdefault(described, []).append("-+"[side] + AXES[axis])
    lines = []
    for (points, struts, same), names in faces.items():
        shares = f"shares joints with: {', '.join(same)}" if same else "shares all joints with none"
        lines.append(f"{' '.join(names)}: {len(points)} joints, {len(struts)} struts; {shares}")
    return "\n".join(lines)
