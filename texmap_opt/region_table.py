"""Regions from the tables of a case file."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from texmap_opt.case_table import LARGEST
from texmap_opt.errors import CaseError, PartError, nearest_name
from texmap_opt.part_file import read_surface_file
from texmap_opt.region import (
    NORMAL_ANGLE,
    PLANE_TOLERANCE,
    AbstractRegion,
    Box,
    Cylinder,
    Intersection,
    Normal,
    Plane,
    Sphere,
    Stl,
)
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.units import MM_PER_UNIT

REGION_KEYS = {
    "box": "`[[x, y, z], [x, y, z]]`: between two opposite corners",
    "sphere": "`{ center = [x, y, z], radius = r }`: the ball",
    "cylinder": "`{ from = [x, y, z], to = [x, y, z], radius = r }`: solid, between two end points",
    "plane": "`{ point = [x, y, z], normal = [x, y, z], tolerance = t }`: this near it (0.001 mm)",
    "normal": "`[x, y, z]` or `{ direction = [x, y, z], angle_deg = 15 }`: where the surface faces "
    "this way",
    "stl": '`"file.stl"` or `{ file = "file.stl", unit = "mm" }`: inside a closed surface',
}


def region_from_table(table: dict, where: str, base: Path) -> AbstractRegion:
    """The region a case file describes; with several keys all must hold.

    Args:
        table: such as `{ box = [[0, 0, 0], [1, 1, 1]] }`; the keys are those of `REGION_KEYS`.
        where: file and section for messages, such as "case.toml: [[load]] 2 region".
        base: folder that relative paths start at.

    Raises:
        CaseError: empty table, unknown key, wrong or impossible value, unreadable file.
    """
    if not isinstance(table, Mapping) or not table:
        raise CaseError(
            f"{where}: must be a table with at least one of {', '.join(READERS)}, such as "
            "{ box = [[0, 0, 0], [1, 1, 1]] }."
        )
    for key in table:
        if key not in READERS:
            raise CaseError(f"{where} {key}: there is no such region; {nearest_name(key, READERS)}")
    regions = tuple(READERS[key](value, f"{where} {key}", base) for key, value in table.items())
    return regions[0] if len(regions) == 1 else Intersection(regions)


def _read_box(value: Any, where: str, base: Path) -> Box:
    if not isinstance(value, list) or len(value) != 2:
        raise CaseError(f"{where} = {value!r}: must be two corners, [[x, y, z], [x, y, z]] in mm.")
    corners = np.stack([_vector(corner, f"{where} corner") for corner in value])
    return Box(corners.min(axis=0), corners.max(axis=0))


def _read_sphere(value: Any, where: str, base: Path) -> Sphere:
    entries = _entries(value, where, required=("center", "radius"))
    return Sphere(
        _vector(entries["center"], f"{where} center"),
        _number(entries["radius"], f"{where} radius", above=0.0),
    )


def _read_cylinder(value: Any, where: str, base: Path) -> Cylinder:
    entries = _entries(value, where, required=("from", "to", "radius"))
    start, end = _vector(entries["from"], f"{where} from"), _vector(entries["to"], f"{where} to")
    if np.array_equal(start, end):
        raise CaseError(f"{where}: from and to are the same point; give the two ends of its axis.")
    return Cylinder(start, end, _number(entries["radius"], f"{where} radius", above=0.0))


def _read_plane(value: Any, where: str, base: Path) -> Plane:
    entries = _entries(value, where, required=("point", "normal"), optional=("tolerance",))
    tolerance = entries.get("tolerance", PLANE_TOLERANCE)
    return Plane(
        _vector(entries["point"], f"{where} point"),
        _direction(entries["normal"], f"{where} normal"),
        _number(tolerance, f"{where} tolerance", least=0.0),
    )


def _read_normal(value: Any, where: str, base: Path) -> Normal:
    if isinstance(value, list):
        value = {"direction": value}
    entries = _entries(value, where, required=("direction",), optional=("angle_deg",))
    angle = entries.get("angle_deg", NORMAL_ANGLE)
    return Normal(
        _direction(entries["direction"], f"{where} direction"),
        _number(angle, f"{where} angle_deg", least=0.0, most=180.0),
    )


def _read_stl(value: Any, where: str, base: Path) -> Stl:
    if isinstance(value, str):
        value = {"file": value}
    entries = _entries(value, where, required=("file",), optional=("unit",))
    file, unit = entries["file"], entries.get("unit", "mm")
    if not isinstance(file, str):
        raise CaseError(f"{where} file = {file!r}: must be the path of a surface file.")
    if unit not in MM_PER_UNIT:
        raise CaseError(f"{where} unit = {unit!r}: is not one of {', '.join(MM_PER_UNIT)}.")
    try:
        surface = read_surface_file(base / file)
    except PartError as failure:
        raise CaseError(f"{where}: {failure}") from failure
    surface = TriMesh(surface.vertices * MM_PER_UNIT[unit], surface.faces)
    if not surface.volume > 0:
        raise CaseError(
            f"{where}: {file} encloses no volume, so nothing is inside; give a closed surface "
            "whose triangles run counter-clockwise seen from outside."
        )
    return Stl(surface, Path(file).name)


# What reads the value of each key of a region table.
READERS: dict[str, Callable[[Any, str, Path], AbstractRegion]] = {
    "box": _read_box,
    "sphere": _read_sphere,
    "cylinder": _read_cylinder,
    "plane": _read_plane,
    "normal": _read_normal,
    "stl": _read_stl,
}


def _entries(
    value: Any, where: str, *, required: tuple[str, ...], optional: tuple[str, ...] = ()
) -> dict:
    known = required + optional
    if not isinstance(value, Mapping):
        raise CaseError(f"{where} = {value!r}: must be a table with {', '.join(known)}.")
    for key in value:
        if key not in known:
            raise CaseError(f"{where} {key}: there is no such key; {nearest_name(key, known)}")
    for key in required:
        if key not in value:
            raise CaseError(f"{where} {key} is missing: the region needs {', '.join(required)}.")
    return dict(value)


def _number(
    value: Any,
    where: str,
    *,
    above: float = -math.inf,
    least: float = -math.inf,
    most: float = math.inf,
) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < LARGEST:
        raise CaseError(f"{where} = {value!r}: must be a finite number.")
    if not value > above:
        raise CaseError(f"{where} = {value!r}: must be above {above:g}.")
    if not least <= value <= most:
        limit = f"at least {least:g}" if most == math.inf else f"between {least:g} and {most:g}"
        raise CaseError(f"{where} = {value!r}: must be {limit}.")
    return float(value)


def _vector(value: Any, where: str) -> Float[np.ndarray, " 3"]:
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise CaseError(f"{where} = {value!r}: must be three numbers, such as [1, 2, 3].")
    return np.array([_number(entry, where) for entry in value])


def _direction(value: Any, where: str) -> Float[np.ndarray, " 3"]:
    vector = _vector(value, where)
    length = float(np.linalg.norm(vector))
    if length == 0:
        raise CaseError(f"{where} = {value!r}: has no direction; give a vector that is not zero.")
    return vector / length
