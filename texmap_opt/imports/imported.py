"""A structure from a file of another program, and what reading it left out."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.errors import StructureError
from texmap_opt.structure.structure import Extrusion, Structure


@dataclass(frozen=True, eq=False)
class Imported:
    """What a file holds.

    Attributes:
        structure: in millimetres.
        notes: what reading left out or took for granted, in sentences.
        provenance: how the structure came about, as far as the file says.
    """

    structure: Structure
    notes: tuple[str, ...] = ()
    provenance: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Bars:
    """Joints and struts as another program's file has them, in its unit.

    Attributes:
        joints: positions; several may be at one place, and some may have no strut.
        struts: the two joints of each strut.
        radii: at its first and its second joint.
        section: "round", "square" or "wall".
        extrusion: of walls.
        notes: see `Imported`.
    """

    joints: Float[np.ndarray, "joints 3"]
    struts: Int[np.ndarray, "struts 2"]
    radii: Float[np.ndarray, "struts 2"]
    section: str = "round"
    extrusion: Extrusion | None = None
    notes: tuple[str, ...] = ()


def imported(path: Path, bars: Bars, *, mm_per_unit: float) -> Imported:
    """The structure of some bars: joints at one place become one, those without a strut go.

    Args:
        path: the file, for messages.
        bars: what it holds.
        mm_per_unit: millimetres in the file's unit of length.

    Raises:
        StructureError: when there are no struts, or they break an invariant of `Structure`.
    """
    if len(bars.struts) == 0:
        raise StructureError(f"{path.name}: holds no struts; give a file of beams or lines.")
    if bars.struts.min() < 0 or bars.struts.max() >= len(bars.joints):
        raise StructureError(
            f"{path.name}: struts end at points {bars.struts.min()} to {bars.struts.max()}, but the "
            f"file has points 0 to {len(bars.joints) - 1}; write it again."
        )
    used, ends = np.unique(bars.struts, return_inverse=True)
    # Numbers too large for the unit become infinite, which a structure refuses.
    with np.errstate(over="ignore", invalid="ignore"):
        # Adding 0 turns -0.0 into 0.0, which `unique` holds for different.
        positions, radii = bars.joints[used] * mm_per_unit + 0.0, bars.radii * mm_per_unit
    _, first, number = np.unique(positions, axis=0, return_index=True, return_inverse=True)
    # In the order of the file, not sorted by place.
    order = np.argsort(first)
    rank = np.zeros(len(order), np.int64)
    rank[order] = np.arange(len(order))
    extrusion = bars.extrusion
    if extrusion is not None:
        low, high = extrusion.low * mm_per_unit, extrusion.high * mm_per_unit
        extrusion = Extrusion(extrusion.axis, low, high, extrusion.depth * mm_per_unit)
    structure = Structure(
        joints=positions[np.sort(first)],
        struts=rank[number.reshape(-1)][ends.reshape(-1, 2)],
        radii=radii,
        cut=np.zeros(len(first), bool),
        cell_size=np.ones(len(bars.struts)),
        section=bars.section,
        extrusion=extrusion,
    )
    try:
        structure.validate()
    except StructureError as failure:
        raise StructureError(f"{path.name}: {failure}") from failure
    return Imported(structure, bars.notes)
