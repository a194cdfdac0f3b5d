"""Input decks (INP) of beams for Abaqus and CalculiX.

Both read B31 with SECTION=RECT (Abaqus Keywords Guide, *BEAM SECTION; CalculiX CrunchiX User's Manual
2.20, same keyword). Round sections differ: Abaqus takes the radius; CalculiX takes two diameters, and
refuses a circle on linear elements, so that round struts are B32R there. CalculiX expands beams into
solid elements; these, and the linear B31 of Abaqus, bend too stiffly when a strut has few: divide it
into segments. (A frame of two storeys deflects 38 % too little in CalculiX with one B31 a strut, 2 % with
eight; with B32R 11 % too little and 0.6 % too much. See tests/verification/test_beam_deck_calculix.py.)
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from fea import Material
from texmap_opt.errors import InputError, nearest_name
from texmap_opt.export.rows_text import rows_text
from texmap_opt.export.whole_file import whole_file
from texmap_opt.structure.structure import WALL, Structure
from texmap_opt.structure.strut_geometry import strut_directions

SOLVERS = ("abaqus", "calculix")
# Digits of a number that fit, with sign and exponent, into the twenty columns CalculiX reads.
NUMBER = "%.13g"
# Sections that agree in so many digits become one: radii within 0.05 %, stiffness within 0.2 %.
SECTION_DIGITS = 4
# Relative change of a size that is no news: the text has thirteen digits.
ROUNDING = 1e-12
# Most names in one line of a set.
NAMES_PER_LINE = 16
JOINTS, STRUTS, MATERIAL = "JOINTS", "STRUTS", "SOLID"


def write_beam_deck(
    path: Path,
    structure: Structure,
    *,
    solver: str = "abaqus",
    segments: int = 1,
    material: Material | None = None,
) -> tuple[str, ...]:
    """Write the struts as beams, in mm, N, MPa and tonnes.

    An element has one section, that of the strut at its middle; sections that agree in four digits are
    one, of their mean. The deck ends before any step: supports and loads are for the user to add, at
    nodes 1, 2... of set JOINTS, which are the joints in their order.

    Args:
        path: the file.
        structure: joints and struts [mm]; walls become rectangles of their thickness and depth.
        solver: "abaqus" or "calculix".
        segments: elements that each strut is divided into.
        material: of the struts; None: sections name a material SOLID that the deck does not define.

    Returns:
        What the deck could not keep, in sentences: radii along a strut and past four digits.

    Raises:
        InputError: for an unknown solver or fewer than one segment.
        OutputError: when the file cannot be written.
    """
    if solver not in SOLVERS:
        raise InputError(f'solver is "{solver}"; {nearest_name(solver, SOLVERS)}')
    if segments < 1:
        raise InputError(f"segments = {segments}: a strut takes at least 1 element.")
    quadratic = solver == "calculix" and structure.section == "round"
    sections = _sections(structure, segments)
    with whole_file(path) as file:
        for text in (
            *_head(structure, solver, segments, material),
            *_nodes(structure, 2 * segments if quadratic else segments),
        ):
            file.write(text.encode())
        for text in _elements(structure, sections, segments, quadratic=quadratic):
            file.write(text.encode())
        for text in (*_material(material), *_section_lines(structure, sections, solver)):
            file.write(text.encode())
    return _changes(structure, sections, segments)


@dataclass(frozen=True, eq=False)
class _Sections:
    """The section of each element, and what it is.

    Attributes:
        of_element: its section; elements in the order of struts and along them.
        radius: of each section [mm]; of walls half the thickness.
        depth: of walls [mm]; of others the radius again.
        normal: first axis of each section, never along its elements.
    """

    of_element: Int[np.ndarray, " elements"]
    radius: Float[np.ndarray, " sections"]
    depth: Float[np.ndarray, " sections"]
    normal: Float[np.ndarray, "sections 3"]


def _changes(structure: Structure, sections: _Sections, segments: int) -> tuple[str, ...]:
    """How far the sections are from the struts, where they are not the same."""
    along = np.arange(segments + 1) / segments
    radii = structure.radii @ np.stack([1 - along, along])
    given = sections.radius[sections.of_element].reshape(-1, segments)
    ends = np.abs(np.stack([radii[:, :-1], radii[:, 1:]]) - given)
    tapered = structure.radii[:, 0] != structure.radii[:, 1]
    notes = []
    if tapered.any():
        notes.append(
            f"{tapered.sum()} struts taper, an element has one radius, that of its middle: radii "
            f"changed by up to {ends[:, tapered].max():.3g} mm"
        )
    even = ends[:, ~tapered].max(initial=0)
    if structure.extrusion is not None:
        depth = sections.depth[sections.of_element].reshape(-1, segments)
        even = max(even, np.abs(depth - structure.extrusion.depth[:, None]).max())
    # Sections that agree exactly keep their sizes exactly; rounding is no news.
    if even > ROUNDING * structure.radii.max():
        notes.append(
            f"sections that agree in {SECTION_DIGITS} digits became one: sizes changed by up to "
            f"{even:.3g} mm"
        )
    return tuple(notes)


def _sections(structure: Structure, segments: int) -> _Sections:
    middle = (np.arange(segments) + 0.5) / segments
    radius = (structure.radii @ np.stack([1 - middle, middle])).reshape(-1)
    extrusion = structure.extrusion
    if extrusion is None:
        depth = radius
        # The global axis least along the strut is at 55 degrees to it, or more.
        axis = np.abs(strut_directions(structure.joints, structure.struts)).argmin(axis=1)
        axis, axes = np.repeat(axis, segments), np.eye(3)
    else:
        # Walls are across their axis, all of them.
        depth = np.repeat(extrusion.depth, segments)
        axis, axes = np.zeros(len(radius), np.int64), extrusion.axis[None]
    keys = np.stack([_rounded(radius), _rounded(depth), axis.astype(float)], axis=1)
    _, first, of_element = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    of_element = of_element.reshape(-1)
    return _Sections(
        of_element,
        _group_mean(radius, of_element),
        _group_mean(depth, of_element),
        axes[axis[first]],
    )


def _group_mean(
    values: Float[np.ndarray, " elements"], group: Int[np.ndarray, " elements"]
) -> Float[np.ndarray, " sections"]:
    """The mean in each group; exactly the value where all are equal."""
    low = np.full(group.max(initial=-1) + 1, np.inf)
    np.minimum.at(low, group, values)
    return low + np.bincount(group, weights=values - low[group]) / np.bincount(group)


def _rounded(values: Float[np.ndarray, " elements"]) -> Float[np.ndarray, " elements"]:
    """Positive numbers to `SECTION_DIGITS` digits."""
    unit = 10.0 ** (np.floor(np.log10(values)) - SECTION_DIGITS + 1)
    return np.round(values / unit) * unit


def _head(
    structure: Structure, solver: str, segments: int, material: Material | None
) -> Iterator[str]:
    yield "*HEADING\n"
    yield f"Lattice of {len(structure.struts)} struts as beams for {solver}, written by texmap\n"
    yield "** Units: mm, N, MPa, tonne.\n"
    if (structure.radii[:, 0] != structure.radii[:, 1]).any():
        yield "** Some struts taper: each element has the section at its middle.\n"
    if segments == 1:
        yield "** One element a strut bends too stiffly; for an analysis write eight segments.\n"
    if material is None:
        yield f"** Sections name the material {MATERIAL}: define it, with *MATERIAL and *ELASTIC.\n"


def _nodes(structure: Structure, steps: int) -> Iterator[str]:
    row = f"%d, {NUMBER}, {NUMBER}, {NUMBER}\n"
    yield f"*NODE, NSET={JOINTS}\n"
    count = len(structure.joints)
    yield from rows_text(row, np.arange(1, count + 1), structure.joints)
    if steps > 1:
        first, last = structure.joints[structure.struts].swapaxes(0, 1)
        share = np.arange(1, steps)[None, :, None] / steps
        inner = (first[:, None] * (1 - share) + last[:, None] * share).reshape(-1, 3)
        yield "*NODE\n"
        yield from rows_text(row, count + np.arange(1, len(inner) + 1), inner)


def _elements(
    structure: Structure, sections: _Sections, segments: int, *, quadratic: bool
) -> Iterator[str]:
    nodes = 3 if quadratic else 2
    steps = segments * (nodes - 1)
    struts, count = structure.struts, len(structure.struts)
    inner = len(structure.joints) + np.arange(count * (steps - 1)).reshape(count, steps - 1)
    along = np.concatenate([struts[:, :1], inner, struts[:, 1:]], axis=1) + 1
    chain = np.stack([along[:, k : k + steps : nodes - 1][:, :segments] for k in range(nodes)], 2)
    number = np.arange(1, count * segments + 1)
    kind = "B32R" if quadratic else "B31"
    row = ", ".join(["%d"] * (nodes + 1)) + "\n"
    chain = chain.reshape(-1, nodes)
    order = np.argsort(sections.of_element, kind="stable")
    ends = np.searchsorted(sections.of_element[order], np.arange(len(sections.radius) + 1))
    for section, (low, high) in enumerate(itertools.pairwise(ends)):
        some = order[low:high]
        yield f"*ELEMENT, TYPE={kind}, ELSET={_name(section)}\n"
        yield from rows_text(row, number[some], chain[some])
    names = [_name(section) for section in range(len(sections.radius))]
    yield f"*ELSET, ELSET={STRUTS}\n"
    for start in range(0, len(names), NAMES_PER_LINE):
        yield ", ".join(names[start : start + NAMES_PER_LINE]) + "\n"


def _name(section: int) -> str:
    return f"SECTION_{section + 1}"


def _material(material: Material | None) -> Iterator[str]:
    if material is not None:
        yield f"*MATERIAL, NAME={MATERIAL}\n"
        yield f"*ELASTIC\n{NUMBER}, {NUMBER}\n" % (material.E, material.nu)
        yield f"*DENSITY\n{NUMBER}\n" % material.density


def _section_lines(structure: Structure, sections: _Sections, solver: str) -> Iterator[str]:
    shape = "CIRC" if structure.section == "round" else "RECT"
    diameter = 2 * sections.radius
    if structure.section == WALL:
        # Along the first axis, which is the direction of extrusion, then across.
        sizes = np.stack([sections.depth, diameter], axis=1)
    elif shape == "CIRC" and solver == "abaqus":
        sizes = sections.radius[:, None]
    else:
        sizes = np.stack([diameter, diameter], axis=1)
    for section, (size, normal) in enumerate(zip(sizes, sections.normal, strict=True)):
        yield f"*BEAM SECTION, ELSET={_name(section)}, MATERIAL={MATERIAL}, SECTION={shape}\n"
        yield (
            ", ".join(NUMBER % x for x in size)
            + "\n"
            + ", ".join(NUMBER % x for x in normal)
            + "\n"
        )
