"""What is left of a solid once it has been an STL file: float32 vertices, welded where equal."""

from dataclasses import dataclass

import numpy as np

from texmap_opt.part_file import distinct_positions, welded
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.solid.validity import ValidityReport, validity


@dataclass(frozen=True, eq=False)
class AfterStl:
    """Validity of what a program reads from the STL of a solid.

    Attributes:
        printable: whether no fault is found.
        same: whether faults, shells and handles are those of the solid itself.
        faults: in words.
        volume_mm3: enclosed volume [mm³].
        lost_vertices: vertices that rounding made equal to another one.
        snapped_mm: largest displacement of a vertex by rounding [mm].
    """

    printable: bool
    same: bool
    faults: list[str]
    volume_mm3: float
    lost_vertices: int
    snapped_mm: float


def after_stl(
    surface: TriMesh, report: ValidityReport, *, given: TriMesh | None = None
) -> AfterStl:
    """Round a surface to float32, weld equal vertices, and check it again.

    Args:
        surface: with finite coordinates below the largest float32 [mm].
        report: what was found on it.
        given: see `validity`.
    """
    rounded = surface.vertices.astype(np.float32).astype(np.float64)
    snapped_mm = float(np.linalg.norm(rounded - surface.vertices, axis=1).max(initial=0.0))
    again, lost = report, 0
    if snapped_mm or len(distinct_positions(rounded)[0]) < len(rounded):
        read, _ = welded(TriMesh(rounded, surface.faces))
        again = validity(read, given=given)
        lost = report.vertices - again.vertices
    return AfterStl(
        printable=again.printable,
        same=_shape(again) == _shape(report),
        faults=again.faults,
        volume_mm3=again.volume_mm3,
        lost_vertices=lost,
        snapped_mm=snapped_mm,
    )


def _shape(report: ValidityReport) -> tuple:
    shells = report.connected_components, report.closed_voids, report.genus
    return report.watertight, report.faults, shells
