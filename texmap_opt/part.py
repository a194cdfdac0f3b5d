"""The part: the closed surface that is to be filled."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from texmap_opt.builtin_part import builtin_part
from texmap_opt.case_sections import PartSection
from texmap_opt.combine import boolean
from texmap_opt.errors import PartError
from texmap_opt.part_file import read_part_file
from texmap_opt.repair import repaired
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.units import MM_PER_UNIT

# [mm] Diagonals outside these are hardly a printed part: below the finest printers' detail, beyond
# their largest bed; most likely the unit is wrong.
SMALL_DIAGONAL = 1.0
LARGE_DIAGONAL = 5000.0


@dataclass(frozen=True, eq=False)
class Part:
    """A solid given by its surface.

    Attributes:
        surface: closed, outward oriented [mm]; voids are shells of negative volume.
        name: file name or name of the built-in part, for messages and the report.
        notes: what reading and repair changed or found doubtful, in sentences.
        unit: unit of the file's coordinates.
    """

    surface: TriMesh
    name: str
    notes: tuple[str, ...] = ()
    unit: str = "mm"

    @property
    def volume(self) -> float:
        """Enclosed volume [mm³]."""
        return self.surface.volume

    @cached_property
    def area(self) -> float:
        """Area of the surface [mm²], voids included."""
        return float(self.surface.face_areas.sum())

    @property
    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner of the bounding box [mm]."""
        return self.surface.bounds

    @cached_property
    def diagonal(self) -> float:
        """Diagonal of the bounding box [mm]."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]))

    @cached_property
    def signed_distance(self) -> SignedDistance:
        """Distance queries; the search trees are built once."""
        return SignedDistance(self.surface)

    def closest(
        self, points: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"], Int[np.ndarray, " n"]]:
        """Nearest points of the surface [mm], signed distances [mm] (negative inside), faces."""
        distance, face, closest = self.signed_distance(points)
        return closest, distance, face

    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Whether each point lies inside; on the surface itself either answer."""
        return self.signed_distance.contains(points)


def read_part(section: PartSection, base: Path = Path()) -> Part:
    """The part a case names: a file's, repaired where that is small, or a built-in one.

    Args:
        section: `[part]` of a case.
        base: folder that a relative file starts at.

    Raises:
        PartError: no solid comes out; the message says why and what to do.
    """
    if section.builtin is not None:
        return Part(builtin_part(section.builtin, section.dimensions), section.builtin)
    if section.file is None:
        raise PartError("[part]: give either file or builtin.")
    return read_surface(base / section.file, unit=section.unit, solid=section.solid)


def read_surface(path: str | Path, *, unit: str = "mm", solid: int | None = None) -> Part:
    """The part in a surface file.

    Args:
        path: an STL, OBJ, PLY or 3MF file.
        unit: of its coordinates: mm, cm, m or in.
        solid: which solid to take when it holds several, by falling volume from 1.

    Raises:
        PartError: unknown unit, unreadable file, or no solid.
    """
    path = Path(path)
    if unit not in MM_PER_UNIT:
        raise PartError(f'[part] unit = "{unit}": is not one of {", ".join(MM_PER_UNIT)}.')
    file = read_part_file(path)
    surface = TriMesh(file.surface.vertices * MM_PER_UNIT[unit], file.surface.faces)
    result = repaired(surface, path.name, solid=solid)
    notes = [*file.notes, *result.notes]
    if file.unit not in (None, unit):
        notes.append(
            f'the file says its unit is {file.unit}, [part] unit says "{unit}", which was taken'
        )
    notes += _doubts_about_unit(result.surface, unit)
    return Part(result.surface, path.name, tuple(notes), unit)


def read_solid(path: str | Path, *, unit: str = "mm") -> TriMesh:
    """The surface of a finished solid, such as a lattice, in mm.

    One that is a closed manifold is taken as it is; the search for crossings of `read_surface`,
    minutes for millions of triangles, is left to who looks at the result. Any other is repaired.

    Args:
        path: an STL, OBJ, PLY or 3MF file.
        unit: of its coordinates: mm, cm, m or in.

    Raises:
        PartError: as `read_surface`.
    """
    if unit in MM_PER_UNIT:
        file = read_part_file(Path(path))
        surface = TriMesh(file.surface.vertices * MM_PER_UNIT[unit], file.surface.faces)
        if not boolean.fault(surface) and surface.volume > 0:
            return surface
    return read_surface(path, unit=unit).surface


def _doubts_about_unit(surface: TriMesh, unit: str) -> list[str]:
    diagonal = float(np.linalg.norm(np.diff(surface.bounds, axis=0)))
    if SMALL_DIAGONAL <= diagonal <= LARGE_DIAGONAL:
        return []
    in_unit = diagonal / MM_PER_UNIT[unit]
    fitting = [
        other
        for other, mm in MM_PER_UNIT.items()
        if other != unit and SMALL_DIAGONAL <= in_unit * mm <= LARGE_DIAGONAL
    ]
    size = "small" if diagonal < SMALL_DIAGONAL else "large"
    hint = f"; should [part] unit be {' or '.join(fitting)}?" if fitting else ""
    return [f'with unit = "{unit}" the part is very {size}, {diagonal:.3g} mm across{hint}']
