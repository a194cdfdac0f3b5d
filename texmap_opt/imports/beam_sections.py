"""Radii, or thickness and depth, of beams from the sections of a deck."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.errors import StructureError
from texmap_opt.structure.structure import AXIS_TOLERANCE, WALL, Extrusion

# First axis of a section whose deck gives none, in Abaqus and in CalculiX.
NORMAL = (0.0, 0.0, -1.0)
# Relative difference of two sizes of a section that are meant to be equal: twelve digits of text.
EQUAL = 1e-9
# What the line of sizes holds.
SIZES = {"CIRC": "a radius or two diameters", "RECT": "two sides"}


@dataclass(eq=False)
class BeamSection:
    """A *BEAM SECTION as its lines are read.

    Attributes:
        elset: its set of elements.
        shape: SECTION=...
        line: of its keyword.
        sizes: of its first line.
        normal: first axis, of its second.
    """

    elset: str
    shape: str
    line: int
    sizes: list[float] = field(default_factory=list)
    normal: list[float] = field(default_factory=lambda: list(NORMAL))


@dataclass(frozen=True, eq=False)
class Sized:
    """What sections make of beams; lengths in the deck's unit.

    Attributes:
        radius: of each beam; half the side, or half the thickness of a wall.
        section: "round", "square" or "wall".
        extrusion: of walls.
        notes: what was taken for granted, in sentences.
    """

    radius: Float[np.ndarray, " struts"]
    section: str
    extrusion: Extrusion | None = None
    notes: tuple[str, ...] = ()


def sized(
    file: str,
    sections: Sequence[BeamSection],
    of_beam: Int[np.ndarray, " struts"],
    beams: tuple[Float[np.ndarray, "joints 3"], Int[np.ndarray, "struts 2"]],
    *,
    mm_per_unit: float,
) -> Sized:
    """The size of each beam.

    Args:
        file: for messages.
        sections: of the deck.
        of_beam: the section of each beam.
        beams: joints, and the two of each beam.
        mm_per_unit: millimetres in the deck's unit, for notes.

    Raises:
        StructureError: with file and line, for shapes that are not understood, and for sections in use
            that are not all round, all square, or walls of one direction.
    """
    used = [sections[k] for k in np.unique(of_beam).tolist()]
    shapes, widths, heights = zip(*(_size(file, section) for section in used), strict=True)
    section_of = np.searchsorted(np.unique(of_beam), of_beam)
    width, height = np.array(widths)[section_of], np.array(heights)[section_of]
    if len(set(shapes)) > 1:
        raise StructureError(
            f"{file}: has round and rectangular beams; a structure has one kind: divide the deck."
        )
    if shapes[0] == "CIRC":
        return Sized(width / 2, "round")
    if (np.abs(width - height) <= EQUAL * width).all():
        return Sized(width / 2, "square")
    normals = np.array([section.normal for section in used])
    return _walls(file, normals, (width, height), beams, mm_per_unit=mm_per_unit)


def _size(file: str, section: BeamSection) -> tuple[str, float, float]:
    """Shape, and size along the section's first and second axis."""
    sizes, where = section.sizes, f"{file}, line {section.line}"
    if section.shape not in ("CIRC", "RECT"):
        raise StructureError(
            f"{where}: section {section.shape} is not understood; known: CIRC, RECT."
        )
    if not sizes or min(sizes) <= 0:
        raise StructureError(f"{where}: the sizes of the section must be positive, not {sizes}.")
    # Abaqus takes the radius of a circle, CalculiX the diameters of an ellipse.
    if section.shape == "CIRC" and len(sizes) == 1:
        return "CIRC", 2 * sizes[0], 2 * sizes[0]
    if len(sizes) != 2:
        raise StructureError(
            f"{where}: a section {section.shape} takes {SIZES[section.shape]}, not {len(sizes)} numbers."
        )
    if section.shape == "CIRC" and abs(sizes[0] - sizes[1]) > EQUAL * sizes[0]:
        raise StructureError(
            f"{where}: an ellipse of {sizes[0]:g} by {sizes[1]:g} is no round strut; give equal "
            "diameters."
        )
    return section.shape, sizes[0], sizes[1]


def _walls(
    file: str,
    normals: Float[np.ndarray, "sections 3"],
    sizes: tuple[Float[np.ndarray, " struts"], Float[np.ndarray, " struts"]],
    beams: tuple[Float[np.ndarray, "joints 3"], Int[np.ndarray, "struts 2"]],
    *,
    mm_per_unit: float,
) -> Sized:
    """Rectangles whose first axis is one and the same, across all beams: walls along it."""
    depth, thickness = sizes
    joints, struts = beams
    length = np.linalg.norm(normals, axis=1)
    axis = normals[0] / length[0] if length.all() else np.zeros(3)
    height = joints[struts] @ axis
    reach = np.abs(joints[struts]).max() + depth.max()
    if (
        not length.all()
        or np.abs(normals / length[:, None] - axis).max() > AXIS_TOLERANCE
        or np.ptp(height) > AXIS_TOLERANCE * reach
    ):
        raise StructureError(
            f"{file}: has rectangles that are not square and not walls: all beams must lie in one plane "
            "and have its normal as first axis of their section."
        )
    middle, deepest = float(height.mean()), float(depth.max())
    extrusion = Extrusion(axis, middle - deepest / 2, middle + deepest / 2, depth)
    height_mm = deepest * mm_per_unit
    notes = (f"rectangles were taken for walls, as high as the deepest of them, {height_mm:g} mm",)
    return Sized(thickness / 2, WALL, extrusion, notes)
