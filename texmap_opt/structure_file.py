"""A structure from any file that holds one, and to any: the format follows from the ending."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fea import Material
from texmap_opt.errors import InputError, StructureError, nearest_name
from texmap_opt.export.beam_deck import write_beam_deck
from texmap_opt.export.beam_lattice import write_beam_lattice
from texmap_opt.export.vtk import write_struts
from texmap_opt.imports.beam_deck import read_beam_deck
from texmap_opt.imports.beam_lattice import read_beam_lattice
from texmap_opt.imports.imported import Imported
from texmap_opt.imports.ltcx import read_ltcx
from texmap_opt.imports.vtk_lines import READERS as VTK_READERS
from texmap_opt.imports.vtk_lines import read_vtk_lines
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.structure_npz import read_structure_npz, write_structure_npz
from texmap_opt.structure.structure_xml import read_structure_and_provenance, write_structure
from texmap_opt.units import MM_PER_UNIT

READ_ENDINGS = (".xml", ".npz", ".inp", ".3mf", ".ltcx", *VTK_READERS)
WRITE_ENDINGS = (".xml", ".npz", ".inp", ".3mf", ".vtp")
# Endings of the formats that hold all of a structure, and how it came about.
KEEP_ALL = (".xml", ".npz")
# Which files read an option of `texmap convert` is about; the others are about INP files written.
OF_READ = {
    "unit": (".inp", *VTK_READERS),
    "radius": (".ltcx", *VTK_READERS),
    "section": (".ltcx", *VTK_READERS),
}
OF_DECK = ("solver", "segments", "material")


@dataclass(frozen=True)
class Reading:
    """What a file does not tell.

    Attributes:
        unit: of INP and VTK files: "mm", "cm", "m" or "in".
        radius: of struts or nodes that have none, in VTK and LTCX files [mm]; None: they have one.
        section: shape of the struts of VTK and LTCX files, "round" or "square".
    """

    unit: str = "mm"
    radius: float | None = None
    section: str = "round"

    def __post_init__(self) -> None:
        if self.unit not in MM_PER_UNIT:
            raise InputError(f'unit = "{self.unit}"; {nearest_name(self.unit, MM_PER_UNIT)}')


@dataclass(frozen=True, eq=False)
class BeamDeck:
    """How an INP file is written; see `write_beam_deck`.

    Attributes:
        solver: "abaqus" or "calculix".
        segments: elements that each strut is divided into.
        material: of the struts, or None.
    """

    solver: str = "abaqus"
    segments: int = 1
    material: Material | None = None


def read_structure_file(path: Path, reading: Reading | None = None) -> Imported:
    """Read a structure; the format follows from the ending.

    Args:
        path: .xml or .npz of this program; .inp, .3mf, .ltcx, .vtp, .vtu or .vtk.
        reading: what the file does not tell; None: millimetres, and radii are in the file.

    Raises:
        InputError: for another ending.
        StructureError: for what the file holds.
    """
    path, given = Path(path), reading or Reading()
    ending, mm_per_unit = path.suffix.lower(), MM_PER_UNIT[given.unit]
    if ending not in READ_ENDINGS:
        raise InputError(
            f'{path}: the ending "{path.suffix}" is not one of {", ".join(READ_ENDINGS)}; convert it.'
        )
    if given.radius is not None and not given.radius > 0:
        raise StructureError(f"--radius {given.radius:g}: must be above 0 [mm].")
    if ending in KEEP_ALL:
        read = read_structure_and_provenance if ending == ".xml" else read_structure_npz
        structure, provenance = read(path)
        return Imported(structure, provenance=provenance)
    if ending == ".inp":
        found = read_beam_deck(path, mm_per_unit=mm_per_unit)
    elif ending == ".3mf":
        found = read_beam_lattice(path)
    elif ending == ".ltcx":
        found = read_ltcx(path, radius=given.radius, section=given.section)
    else:
        found = read_vtk_lines(
            path, radius=given.radius, section=given.section, mm_per_unit=mm_per_unit
        )
    return Imported(found.structure, found.notes, {"file": path.name})


def check_structure_ending(path: Path) -> None:
    """Refuse a file whose ending names no format that a structure can be written in.

    Raises:
        InputError: with the endings that can.
    """
    if path.suffix.lower() not in WRITE_ENDINGS:
        raise InputError(
            f'{path}: the ending "{path.suffix}" is not one of {", ".join(WRITE_ENDINGS)}; choose one '
            "of them."
        )


def check_conversion(read: Path, written: Path, options: Mapping[str, object]) -> None:
    """Refuse options of `texmap convert` that would change nothing, and endings that are not known.

    Args:
        read: the file that is read.
        written: the file that is written.
        options: what was given, by name; None: not given.

    Raises:
        InputError: for the first of them.
    """
    check_structure_ending(written)
    given = [name for name, value in options.items() if value is not None]
    ending, cell = read.suffix.lower(), "cell" in given
    if cell and written.suffix.lower() != ".xml":
        raise InputError(f"--cell: a unit cell is written as XML, not as {written.name}.")
    for name in given:
        if name in OF_READ and ending in READ_ENDINGS and ending not in OF_READ[name]:
            raise InputError(
                f"--{name}: is for reading {', '.join(OF_READ[name])}, and {read.name} tells its own; "
                "leave it out."
            )
        if name in OF_DECK and written.suffix.lower() != ".inp":
            raise InputError(f"--{name}: is for writing .inp, not {written.name}; leave it out.")
        if name == "tiling" and not cell:
            raise InputError(
                "--tiling: is of a unit cell; give its name with --cell, or leave it out."
            )


def write_structure_file(
    path: Path, source: Imported, deck: BeamDeck | None = None
) -> tuple[str, ...]:
    """Write a structure; the format follows from the ending.

    Args:
        path: .xml or .npz of this program; .inp, .3mf (round struts) or .vtp.
        source: the structure and how it came about, which .xml and .npz keep.
        deck: how an INP file is written; None: for Abaqus, without a material.

    Returns:
        What the format could not keep, in sentences.

    Raises:
        InputError: for another ending, or what `write_beam_deck` refuses.
        OutputError: when the file cannot be written, or cannot hold such struts.
    """
    path = Path(path)
    check_structure_ending(path)
    ending, structure = path.suffix.lower(), source.structure
    changed: tuple[str, ...] = ()
    if ending == ".xml":
        write_structure(structure, path, provenance=source.provenance)
    elif ending == ".npz":
        write_structure_npz(path, structure, provenance=source.provenance)
    elif ending == ".inp":
        how = deck or BeamDeck()
        changed = write_beam_deck(
            path, structure, solver=how.solver, segments=how.segments, material=how.material
        )
    elif ending == ".3mf":
        changed = write_beam_lattice(path, structure)
    else:
        write_struts(path, structure, strut_data={})
    return changed if ending in KEEP_ALL else (*changed, *_lost(ending, source))


def lost_in_cell(structure: Structure) -> tuple[str, ...]:
    """What a unit-cell file cannot keep of the radii, in sentences."""
    taper = np.ptp(structure.radii, axis=1)
    if not taper.any():
        return ()
    return (
        f"{np.count_nonzero(taper)} struts taper, in a cell they have the mean of their radii: these "
        f"changed by up to {taper.max() / 2:.3g} mm",
    )


def _lost(ending: str, source: Imported) -> list[str]:
    """What INP, 3MF or VTP has no place for, of what the structure has."""
    structure, extrusion = source.structure, source.structure.extrusion
    lost = {
        "the cell and kind of each strut (but as numbers)"
        if ending == ".vtp"
        else "the cell and kind of each strut": structure.origin is not None,
        "the size of cells": bool((structure.cell_size != 1).any()),
        "which joints were cut": bool(structure.cut.any()),
        # The name of the file it was read from is all that other formats tell.
        "how the structure came about": bool(source.provenance.keys() - {"file"}),
    }
    if extrusion is not None and ending == ".inp":
        deepest, height = float(extrusion.depth.max()), extrusion.high - extrusion.low
        lost[f"the heights of the extrusion, {extrusion.low:g} to {extrusion.high:g} mm"] = (
            abs(deepest - height) > 1e-9 * height
        )
    notes = [f"not kept, for want of a place: {thing}" for thing, had in lost.items() if had]
    if ending == ".vtp" and extrusion is not None:
        notes.append(
            "the direction and heights of the walls were not kept, and so the file is not read back"
        )
    elif ending == ".vtp" and structure.section == "square":
        notes.append("that struts are square was not kept: read it with --section square")
    return notes
