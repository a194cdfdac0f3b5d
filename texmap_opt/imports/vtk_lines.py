"""Lines of VTK files as struts, with their radii."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from texmap_opt.errors import StructureError
from texmap_opt.export.vtk import DEPTH, MEAN_RADIUS, RADIUS
from texmap_opt.imports.imported import Bars, Imported, imported
from texmap_opt.imports.line_set import LineSet
from texmap_opt.imports.vtk_legacy import read_vtk_legacy
from texmap_opt.imports.vtk_xml import read_vtk_xml

READERS = {".vtp": read_vtk_xml, ".vtu": read_vtk_xml, ".vtk": read_vtk_legacy}
# Arrays that hold radii, the first that is there, without regard to capitals.
NAMES = (RADIUS, "radius", "radii", MEAN_RADIUS)


def read_vtk_lines(
    path: Path, *, radius: float | None, section: str, mm_per_unit: float
) -> Imported:
    """Read the lines of a VTP, VTU or VTK file; those through several points become several struts.

    Radii are in the file's unit, in an array at the points or of the lines called `radius_mm`,
    `radius`, `radii` or `mean_radius_mm`.

    Args:
        path: the file.
        radius: of struts in a file without such an array [mm]; None: there must be one, and only
            then may there be one.
        section: shape of the struts, which the file does not tell.
        mm_per_unit: millimetres in the file's unit.

    Raises:
        StructureError: for what is no such file, or has no lines or radii.
    """
    path = Path(path)
    try:
        lines = READERS[path.suffix.lower()](path)
    except OSError as failure:
        raise StructureError(
            f"{path}: cannot be read ({failure.strerror or failure}); give a VTK file."
        ) from failure
    # Broken bytes reach NumPy and the decompressors, which meet them with whatever they raise.
    except Exception as failure:
        if isinstance(failure, StructureError):
            raise
        reason = " ".join(str(failure).split())[:120] or type(failure).__name__
        raise StructureError(
            f"{path.name}: cannot be read as VTK lines ({reason}); write it again."
        ) from failure
    if DEPTH in lines.segment_data:
        raise StructureError(
            f"{path.name}: its struts are walls, whose direction a VTK file does not tell; give the "
            "structure.xml they come from."
        )
    bars = Bars(
        joints=lines.points,
        struts=lines.segments,
        radii=_radii(path, lines, None if radius is None else radius / mm_per_unit),
        section=section,
        notes=(f"{lines.others} cells that are no lines were left out",) if lines.others else (),
    )
    return imported(path, bars, mm_per_unit=mm_per_unit)


def _radii(path: Path, lines: LineSet, radius: float | None) -> Float[np.ndarray, "struts 2"]:
    for name in NAMES:
        at_points, of_lines = _found(lines.point_data, name), _found(lines.segment_data, name)
        if radius is not None and (at_points is not None or of_lines is not None):
            raise StructureError(f"{path.name}: has radii in {name}; leave --radius out.")
        if at_points is not None:
            return at_points[lines.segments]
        if of_lines is not None:
            return np.repeat(of_lines[:, None], 2, axis=1)
    if radius is None:
        raise StructureError(
            f"{path.name}: has no array of radii (such as {NAMES[1]}); add one, or give the radius of "
            "all struts with --radius."
        )
    return np.full(lines.segments.shape, radius)


def _found(data: Mapping[str, np.ndarray], name: str) -> Float[np.ndarray, " samples"] | None:
    """The array of that name, if there is one and it has one number a row."""
    for key, values in data.items():
        if key.lower() == name and (values.ndim == 1 or values.shape[1] == 1):
            return values.reshape(-1).astype(np.float64)
    return None
