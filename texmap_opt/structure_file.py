"""A structure from any file that holds one, and to any: the format follows from the ending."""

from dataclasses import dataclass
from pathlib import Path

from fea import Material
from texmap_opt.errors import InputError, StructureError
from texmap_opt.export.beam_deck import write_beam_deck
from texmap_opt.export.beam_lattice import write_beam_lattice
from texmap_opt.export.vtk import write_struts
from texmap_opt.imports.beam_deck import read_beam_deck
from texmap_opt.imports.beam_lattice import read_beam_lattice
from texmap_opt.imports.imported import Imported
from texmap_opt.imports.ltcx import read_ltcx
from texmap_opt.imports.vtk_lines import READERS as VTK_READERS
from texmap_opt.imports.vtk_lines import read_vtk_lines
from texmap_opt.structure.structure_npz import read_structure_npz, write_structure_npz
from texmap_opt.structure.structure_xml import read_structure_and_provenance, write_structure
from texmap_opt.units import MM_PER_UNIT

READ_ENDINGS = (".xml", ".npz", ".inp", ".3mf", ".ltcx", *VTK_READERS)
WRITE_ENDINGS = (".xml", ".npz", ".inp", ".3mf", ".vtp")


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
    if ending in (".xml", ".npz"):
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


def write_structure_file(path: Path, source: Imported, deck: BeamDeck | None = None) -> None:
    """Write a structure; the format follows from the ending.

    Args:
        path: .xml or .npz of this program; .inp, .3mf (round struts) or .vtp.
        source: the structure and how it came about, which .xml and .npz keep.
        deck: how an INP file is written; None: for Abaqus, without a material.

    Raises:
        InputError: for another ending, or what `write_beam_deck` refuses.
        OutputError: when the file cannot be written, or cannot hold such struts.
    """
    path = Path(path)
    check_structure_ending(path)
    ending, structure = path.suffix.lower(), source.structure
    if ending == ".xml":
        write_structure(structure, path, provenance=source.provenance)
    elif ending == ".npz":
        write_structure_npz(path, structure, provenance=source.provenance)
    elif ending == ".inp":
        how = deck or BeamDeck()
        write_beam_deck(
            path, structure, solver=how.solver, segments=how.segments, material=how.material
        )
    elif ending == ".3mf":
        write_beam_lattice(path, structure)
    else:
        write_struts(path, structure, strut_data={})
