"""docs/cells.md: the library as a gallery, from results.json and the cells' own files."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fea.stiffness_bounds import hashin_shtrikman_bound, plane_hashin_shtrikman_bound
from texmap_opt.cells.at_density import POISSON
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.face_patterns import face_patterns_text
from texmap_opt.cells.rigidity import maxwell_number, mechanisms
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.structure.tile import tile

PAGE = Path(__file__).parents[2] / "docs" / "cells.md"

# At this density cells are compared.
COMPARED = 0.1
WIDTH, CHART_WIDTH = 560, 760

# Radius over length from which on a strut is shorter than two of its diameters.
STUBBY = 0.25

# Moduli that differ by less than this share over the directions are called equal.
ISOTROPIC = 0.01

# Numbers below are zero, and numbers above whole.
ROUNDING, LARGE = 1e-9, 1e3

INTRODUCTION = """# The unit cells, compared

Written by `python3 studies/cells/gallery.py`; do not edit. Chen (Computer-Aided Design and Applications
4 (2007) 761) left the comparison of the microstructures' material properties as future work: this page
is it. To choose by requirement, let the program order the library:

    texmap cells --rank E --direction 1,0,0 --density 0.15     # stiffest along x first
    texmap cells --rank E_min                                  # stiff whichever way it is loaded
    texmap cells --rank E_ratio --dimensions 3                 # stiff in one direction, flexible in others
    texmap cells --rank nu --ascending --dimensions 2          # widens when pulled

## What the numbers are

The endless lattice is homogenised as a periodic frame of Timoshenko beams with rigid joints, for a solid
with Young's modulus 1 and Poisson's ratio 0.3, so all moduli are over that of the solid (Es); a 2.5-D
cell is a frame of walls in its plane, in plane stress. Density ρ is the relative density with what
struts share at joints counted once; radius is that of a strut of relative radius 1 (for walls half their
thickness), over the cell's first edge. r/L is the largest radius over length of a strut.

How far it goes: a beam model is exact for slender struts and says less the thicker they are. Cells with
a *joint model* ({jointed}) have their joints stiffened as fitted to solids, in all rows marked so;
how near that comes is in [joint-model.md](joint-model.md). For the others no solid was computed: joints
count as points, the lattice comes out too soft, and more so where it bends: for bcc without its joint
model E100 is 25 % low at ρ = 0.05 and 50 % low at 0.2. Tables end at ρ = 0.3. Beyond r/L = 0.25 a strut
is shorter than two of its diameters and a row says little about the solid; such rows are in *italics*.

E, G and nu along a direction: G is that of planes across it, nu the contraction, both the mean over the
directions across. Zener: 2 C44/(C11 - C12), in the plane 2 C66/(C11 - C12), 1 where isotropic; other
cells have the universal anisotropy instead (marked u), 0 where isotropic. Power laws E = C ρⁿ are least
squares of the logarithms over the table's densities; n is near 1 where struts stretch, near 2 where bars
bend and near 3 where walls bend. In brackets is the largest relative error of the fit.

The Maxwell number is b - 3j + 6 (2.5-D: b - 2j + 3) of one cell alone; mechanisms and states of
self-stress are those of the endless pin-jointed lattice within one period, found by rank. A lattice is
stretching-dominated when none of its mechanisms is a uniform strain."""


def page(results: dict[str, dict]) -> str:
    """The whole page."""
    cells = sorted((unit_cell(name) for name in results), key=lambda c: (-c.dimensions, c.name))
    space = [cell for cell in cells if cell.dimensions == 3]
    plane = [cell for cell in cells if cell.dimensions == 2]
    jointed = ", ".join(cell.name for cell in cells if cell.joint_model is not None)
    parts = [
        INTRODUCTION.format(jointed=jointed),
        f"## In space, at ρ = {COMPARED:g}",
        _space_summary(space, results),
        _image("stiffness.png", "stiffness of the 3-D cells against density", CHART_WIDTH),
        "Stretching-dominated cells are blue, bending-dominated ones orange. Voigt's bound, ρ, holds for "
        "every direction; Hashin and Shtrikman's for lattices that are alike in all directions, which others "
        "may pass along their struts.",
        _image("directions.png", "largest against least modulus of the 3-D cells", CHART_WIDTH),
        "On the line a cell is equally stiff in all directions; far above it, it is stiff in few. "
        + _requirement(results),
        f"## In the plane (2.5-D), at ρ = {COMPARED:g}",
        _plane_summary(plane, results),
        _image("stiffness_plane.png", "stiffness of the 2.5-D cells against density", CHART_WIDTH),
        "The bounds are those of a sheet; the square, not being isotropic, passes that of Hashin and "
        "Shtrikman along its walls. Along the axis of extrusion all these cells reach Voigt's, E = ρ Es.",
        _claims(results),
        "## The cells in space",
        "Left one cell, right a block of 2 x 2 x 2, as thick as at ρ = 0.1.",
        *(_section(cell, results[cell.name], space) for cell in space),
        "## The cells in the plane",
        "Left one cell extruded, right its cross-section with neighbours, as thick as at ρ = 0.1.",
        *(_section(cell, results[cell.name], plane) for cell in plane),
    ]
    return "\n\n".join(parts) + "\n"


def _space_summary(cells: Sequence[UnitCell], results: dict[str, dict]) -> str:
    bound = hashin_shtrikman_bound(1.0, POISSON, COMPARED)
    moduli = ("E 100", "E 110", "E 111", "E_min", "E_max", "G", "nu", "bulk")
    rows = [
        [
            *_compared(cell, results, moduli, law="100"),
            "fitted" if _at(results, cell.name)["jointed"] else "beams",
        ]
        for cell in cells
    ]
    head = (
        "cell | class | Maxwell | E [100] | E [110] | E [111] | E least | E largest | G | nu | bulk | "
        "Zener | n of E [100] | joints"
    )
    note = (
        f"Bounds at this density: Voigt E = {COMPARED:g}; Hashin-Shtrikman E = {_number(bound.E)}, G = "
        f"{_number(bound.shear)}, bulk = {_number(bound.bulk)}."
    )
    return f"{_table(head.split(' | '), rows)}\n\n{note}"


def _plane_summary(cells: Sequence[UnitCell], results: dict[str, dict]) -> str:
    bound = plane_hashin_shtrikman_bound(1.0, POISSON, COMPARED)
    moduli = ("E x", "E xy", "E y", "E z", "E_min", "E_max", "G", "nu", "nu y")
    rows = [_compared(cell, results, moduli, law="x") for cell in cells]
    head = (
        "cell | class | Maxwell | E x | E xy | E y | E z (extrusion) | E least | E largest | G | nu x | "
        "nu y | Zener | n of E x"
    )
    note = (
        "Least and largest are in the plane. Bounds at this density: Voigt "
        f"E = {COMPARED:g}; Hashin-Shtrikman in the plane E = {_number(bound.E)}, G = {_number(bound.shear)}."
    )
    return f"{_table(head.split(' | '), rows)}\n\n{note}"


def _compared(
    cell: UnitCell, results: dict[str, dict], moduli: Sequence[str], *, law: str
) -> list[object]:
    """A row of a summary: class, moduli, anisotropy and the exponent of one power law."""
    row = _at(results, cell.name)
    return [
        f"[{cell.name}](#{cell.name})",
        cell.classification,
        maxwell_number(cell),
        *(_number(row[name]) for name in moduli),
        _anisotropy(row),
        f"{results[cell.name]['laws'][law]['exponent']:.2f}",
    ]


def _requirement(results: dict[str, dict]) -> str:
    """The cell the paper asks for: stiff in one direction, flexible in the others."""
    row = _at(results, "column")
    return (
        "The paper asks for structures that are stiff in one direction and flexible in the others: "
        f"`column` has E = {_number(row['E 001'])} Es along z, {row['E 001'] / row['E 100']:.0f} times "
        "that along x and y."
    )


def _claims(results: dict[str, dict]) -> str:
    """Poisson's ratios beside what the cells are named for."""
    rows = []
    for name, claim in (
        ("rubber-band", "near 0.5: behaves like rubber (Sigmund, in Chen (2007), figure 5b)"),
        ("iso-material", "0.5, isotropic in the plane (Kikuchi, in Chen (2007), figure 5b)"),
        ("re-entrant", "-1 for thin walls, both ways (Gibson, Ashby, section 4.3)"),
        ("honeycomb", "1 for thin walls, isotropic (Gibson, Ashby, section 4.3)"),
        ("triangular", "1/3, isotropic (Gibson, Ashby, chapter 4)"),
        ("kagome", "1/3, isotropic (Hyun, Torquato)"),
    ):
        for density in (0.01, 0.1, 0.2):
            row = next(row for row in results[name]["rows"] if row["density"] == density)
            first = density == 0.01
            rows.append(
                [
                    f"[{name}](#{name})" if first else "",
                    claim if first else "",
                    f"{density:g}",
                    _number(row["nu"]),
                    _number(row["nu y"]),
                    _anisotropy(row),
                ]
            )
    head = ["cell", "Poisson's ratio claimed", "ρ", "nu along x", "nu along y", "Zener"]
    return f"### Poisson's ratios beside their claims\n\n{_table(head, rows)}"


def _section(cell: UnitCell, result: dict, others: Sequence[UnitCell]) -> str:
    aliases = f" ({', '.join(cell.aliases)})" if cell.aliases else ""
    facts = [
        ("class", f"{cell.classification}-dominated"),
        ("symmetry", cell.symmetry),
        ("joints, struts", f"{len(cell.joints)}, {len(cell.struts)}"),
        ("edges", " x ".join(f"{edge:.4g}" for edge in cell.proportions)),
        ("tiling", cell.tiling),
        ("struts at a joint", _valence(cell)),
        ("Maxwell number", str(maxwell_number(cell))),
        ("pin-jointed", _pin_jointed(cell)),
    ]
    parts = [
        f"### {cell.name}",
        _image(f"{cell.name}.jpg", f"{cell.name}{aliases}", WIDTH),
        cell.description,
        "; ".join(f"{name}: {value}" for name, value in facts) + ".",
        _faces(cell, others),
        f"Source: {cell.source}.",
        _properties(cell, result),
        _laws(cell, result),
    ]
    if cell.name == "bi-stable":
        parts += [
            "Its two stable shapes, geometry only: as made, and snapped through, each arch mirrored at the "
            "line of its ends, as clamped arches of the first buckling mode do (Qiu, Lang, Slocum, J. MEMS "
            "13 (2004) 137). Stem and tip come down by twice the arches' rise. Whether it stays there "
            "depends on the radius: see the cell's file. The table holds for small loads, as made.",
            _image("snap.jpg", "bi-stable, as made and snapped through", WIDTH),
        ]
    return "\n\n".join(parts)


def _faces(cell: UnitCell, others: Sequence[UnitCell]) -> str:
    """What lies in the faces (edges of a cross-section), and which cells are joined there as they are."""
    what = "Faces" if cell.dimensions == 3 else "Edges"
    return f"{what}: " + "; ".join(face_patterns_text(cell, others).splitlines()) + "."


def _properties(cell: UnitCell, result: dict) -> str:
    along = [key for key in result["rows"][0] if key.startswith("E ")]
    brackets = cell.dimensions == 3
    head = ["ρ", "radius", "r/L", *(f"E [{k[2:]}]" if brackets else k for k in along)]
    head += [
        "E least",
        "E largest",
        "G",
        *(["nu"] if brackets else ["nu x", "nu y"]),
        "Zener",
        "joints",
    ]
    rows = []
    for row in result["rows"]:
        entries = [
            f"{row['density']:g}",
            f"{row['radius']:.4f}",
            f"{row['radius_ratio']:.2g}",
            *(_number(row[key]) for key in along),
            _number(row["E_min"]),
            _number(row["E_max"]),
            _number(row["G"]),
            _number(row["nu"]),
            *([] if brackets else [_number(row["nu y"])]),
            _anisotropy(row),
            "fitted" if row["jointed"] else "beams",
        ]
        stubby = row["radius_ratio"] > STUBBY and not row["jointed"]
        rows.append([f"*{entry}*" if stubby else entry for entry in entries])
    return _table(head, rows)


def _laws(cell: UnitCell, result: dict) -> str:
    texts = []
    for name, law in result["laws"].items():
        along = f"[{name}]" if cell.dimensions == 3 else name
        texts.append(
            f"E {along} = {law['factor']:.3g} ρ^{law['exponent']:.2f} (within {100 * law['residual']:.2g} %)"
        )
    row = next(row for row in result["rows"] if row["density"] == COMPARED)
    return f"Power laws: {'; '.join(texts)}. {_extremes(cell, row)}"


def _extremes(cell: UnitCell, row: dict) -> str:
    if row["E_max"] < (1 + ISOTROPIC) * row["E_min"]:
        plane = " of the plane" if cell.dimensions == 2 else ""
        return f"At ρ = {COMPARED:g} equally stiff in all directions{plane}, within 1 %."
    if cell.dimensions == 2:
        ends = [f"{row[end]:.3g}° from x" for end in ("softest", "stiffest")]
    else:
        ends = [
            "along (" + ", ".join(f"{row[f'{end} {axis}'] + 0.0:.2g}" for axis in "xyz") + ")"
            for end in ("softest", "stiffest")
        ]
    return (
        f"At ρ = {COMPARED:g} softest {ends[0]}, stiffest {ends[1]}, "
        f"{row['E_max'] / row['E_min']:.3g} times as stiff."
    )


def _pin_jointed(cell: UnitCell) -> str:
    found = mechanisms(cell)
    parts = []
    for count, one, many in (
        (found.mechanisms, "mechanism", "mechanisms"),
        (found.self_stresses, "state of self-stress", "states of self-stress"),
    ):
        parts.append(f"{count or 'no'} {one if count == 1 else many}")
    if found.mechanisms:
        parts[0] += f" ({found.strain_producing or 'none'} of them strains)"
    return ", ".join(parts)


def _valence(cell: UnitCell) -> str:
    """How many struts meet at the joints of the endless lattice."""
    net = tile(cell, tuple(n + 2 for n in cell.period))
    inside = ((net.joints > 0.5) & (net.joints < np.array(cell.period) + 1.5)).all(axis=1)
    degree = np.bincount(net.struts.ravel(), minlength=len(net.joints))
    counts = [str(n) for n in np.unique(degree[inside])]
    return " or ".join([", ".join(counts[:-1]), counts[-1]]) if len(counts) > 1 else counts[0]


def _at(results: dict[str, dict], name: str) -> dict:
    return next(row for row in results[name]["rows"] if row["density"] == COMPARED)


def _anisotropy(row: dict) -> str:
    return f"{_number(row['anisotropy'])} u" if row["zener"] is None else _number(row["zener"])


def _number(value: float) -> str:
    """Three digits."""
    if abs(value) < ROUNDING:
        return "0"
    if abs(value) >= LARGE:
        return f"{value:,.0f}"
    return f"{value:.3g}" if abs(value) >= 1e-3 else f"{value:.2e}"


def _image(file: str, text: str, width: int) -> str:
    return f'<img src="images/cells/{file}" alt="{text}" width="{width}">'


def _table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(str(entry) for entry in line)} |" for line in lines)
