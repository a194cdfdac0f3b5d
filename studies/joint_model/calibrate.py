"""Fit the joint model of library cells to their own solids, and write down what is left.

    python3 studies/joint_model/calibrate.py [CELL ...] [--again]

For each cell: solids of several relative densities are meshed and homogenised (about a minute each;
those in results.json are kept unless --again is given), and the joint model is fitted. Writes
results.json here, the <joint_model> of library/CELL.xml, and docs/joint-model.md.
"""

import argparse
import json
import math
import re
from dataclasses import asdict
from pathlib import Path

import jax
from scipy.optimize import brentq

import fea
from fea.beam import StrutMaterial
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.joint_calibration import (
    POISSON,
    CellModuli,
    SolidCell,
    fitted_joint_model,
    frame_moduli,
    solid_cell,
)
from texmap_opt.cells.joint_model import JointModel
from texmap_opt.cells.periodic_density import periodic_density
from texmap_opt.cells.periodic_frame import periodic_frame
from texmap_opt.cells.periodic_tets import EDGE_PER_RADIUS
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.cells.unit_cell_xml import read_unit_cell

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
RESULTS, PAGE = HERE / "results.json", ROOT / "docs/joint-model.md"

CELLS = ("octet", "bcc", "cube", "tetrakaidecahedron")
# Relative densities of the solids that are fitted.
DENSITIES = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35)
# Edges of tets over the radius, at one density, to show what the mesh leaves.
EDGES, DENSITY_OF_EDGES = (1 / 1.5, 1 / 3), 0.2
# Radii of the solids are sought in this range, and rounded to so many digits [cell edges].
RADII, DIGITS = (0.02, 0.26), 4

INTRODUCTION = """# Joint models: frames beside solids, by relative density

Written by `python3 studies/joint_model/calibrate.py`; the derivation is in docs/theory/joints.md. Moduli
are over Young's modulus of the solid, whose Poisson's ratio is 0.3. *solid*: quadratic tets of an eighth of
the cell between its mirror planes. *frame*: Timoshenko beams from joint to joint. *with joint model*: the
same with rigid ends and relative modulus of the cell's file. Densities: volume of the mesh, the
overlap-corrected volume of the struts, and their volume from joint to joint. Errors are frame over solid
less one; of nu, the difference. E100, E111 and C44 are fitted, bulk modulus and nu are not."""


def main() -> None:
    """Calibrate the named cells."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("cells", nargs="*", metavar="CELL", help=f"default: {', '.join(CELLS)}")
    arguments.add_argument("--again", action="store_true", help="do not keep earlier solids")
    given = arguments.parse_args()
    jax.config.update("jax_enable_x64", True)
    solids = read_solids()
    for name in given.cells or CELLS:
        cell = unit_cell(name)
        kept = [] if given.again else solids.get(cell.name, [])
        solids[cell.name] = kept
        for density, edge in wanted():
            radius = radius_of(cell, density)
            if any((s.radius, s.tet_edge) == (radius, edge) for s in kept):
                continue
            kept.append(solid_cell(cell, radius, tet_edge=edge))
            kept.sort(key=lambda s: (s.radius, -s.tet_edge))
            write_solids(solids)
            print(f"{cell.name}: solid of density {kept[-1].density:.3f} done", flush=True)
        model = fitted_joint_model(cell, fitted(kept))
        write_joint_model(ROOT / f"library/{cell.name}.xml", model)
        print(f"{cell.name}: {model}", flush=True)
    PAGE.write_text(page(solids), encoding="utf-8")


def wanted() -> list[tuple[float, float]]:
    """Density and edge of tets over the radius of each solid."""
    return [(density, EDGE_PER_RADIUS) for density in DENSITIES] + [
        (DENSITY_OF_EDGES, edge) for edge in EDGES
    ]


def fitted(solids: list[SolidCell]) -> list[SolidCell]:
    """The solids of the usual mesh, thinnest first."""
    return [solid for solid in solids if solid.tet_edge == EDGE_PER_RADIUS]


def radius_of(cell: UnitCell, density: float) -> float:
    """The radius that gives a relative density, in cell edges."""
    radius = brentq(lambda r: periodic_density(cell, float(r)) - density, *RADII, xtol=1e-5)
    return round(float(radius), DIGITS)


def read_solids() -> dict[str, list[SolidCell]]:
    """The solids of earlier runs, by cell."""
    if not RESULTS.exists():
        return {}
    rows = json.loads(RESULTS.read_text(encoding="utf-8"))
    return {
        name: [SolidCell(**{**row, "moduli": CellModuli(**row["moduli"])}) for row in each]
        for name, each in rows.items()
    }


def write_solids(solids: dict[str, list[SolidCell]]) -> None:
    """Keep the solids for the next run and for the tests."""
    rows = {name: [asdict(solid) for solid in each] for name, each in sorted(solids.items())}
    RESULTS.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


def rounded(model: JointModel) -> JointModel:
    """Four decimals; what limits is rounded up, so that the thickest solid stays within."""
    up = [math.ceil(10**4 * value) / 10**4 for value in (model.radius_ratio, model.error)]
    return JointModel(round(model.rigid_end, 4), round(model.modulus, 4), *up)


def write_joint_model(path: Path, model: JointModel) -> None:
    """Put the model into a cell's file, in place of the one that is there."""
    values = " ".join(f'{name}="{value:g}"' for name, value in asdict(rounded(model)).items())
    text = re.sub(r"  <joint_model .*/>\n", "", path.read_text(encoding="utf-8"))
    line = f"  <joint_model {values}/>\n"
    path.write_text(text.replace("</unit_cell>", f"{line}</unit_cell>"), encoding="utf-8")
    read_unit_cell(path)


def page(solids: dict[str, list[SolidCell]]) -> str:
    """docs/joint-model.md."""
    parts = [INTRODUCTION]
    for name, each in sorted(solids.items()):
        cell = read_unit_cell(ROOT / f"library/{name}.xml")
        model = cell.joint_model
        if model is None:
            continue
        parts += [section(cell, model, fitted(each)), meshes(cell, each)]
    return "\n\n".join(parts) + "\n"


def section(cell: UnitCell, model: JointModel, solids: list[SolidCell]) -> str:
    """What is fitted of one cell."""
    lines = [
        f"## {cell.name}",
        "",
        f"Rigid ends of {model.rigid_end:.3g} r, modulus 1 {model.modulus:+.3g} r/L, up to r/L = "
        f"{model.radius_ratio:.3g}: Young's modulus in any direction, and C44, within "
        f"{100 * model.error:.2g} %.",
        "",
        "| density: mesh | corrected | centre lines | radius/edge | quantity | solid | frame | error "
        "| with joint model | error |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for solid in solids:
        plain = frame_moduli(cell, solid.radius, None)
        joined = frame_moduli(cell, solid.radius, model)
        density = (
            f"{solid.density:.4f} | {periodic_density(cell, solid.radius):.4f} | "
            f"{centre_lines(cell, solid.radius):.4f} | {solid.radius:g}"
        )
        for what in ("E100", "E111", "C44", "bulk", "nu"):
            true, a, b = (getattr(m, what) for m in (solid.moduli, plain, joined))
            errors = (f"{100 * (a / true - 1):+.1f} %", f"{100 * (b / true - 1):+.1f} %")
            if what == "nu":  # It may vanish: its error is a difference, and rounding is dropped.
                errors = (f"{a - true:+.3f}", f"{b - true:+.3f}")
                a, b = round(a, 6) + 0.0, round(b, 6) + 0.0
            lines.append(
                f"| {density} | {what} | {true:.4g} | {a:.4g} | {errors[0]} | {b:.4g} | {errors[1]} |"
            )
            density = " | | | "
    return "\n".join(lines)


def centre_lines(cell: UnitCell, radius: float) -> float:
    """Density with every strut counted from joint to joint."""
    material = StrutMaterial(1.0, POISSON, fea.section(cell.section))
    return periodic_frame(cell, edge=1.0, radius=radius, material=material).density


def meshes(cell: UnitCell, solids: list[SolidCell]) -> str:
    """How the result depends on the mesh, at one density."""
    radius = radius_of(cell, DENSITY_OF_EDGES)
    lines = [
        f"Mesh, at radius/edge {radius:g}:",
        "",
        "| tet edge/radius | nodes (tet10, an eighth) | density | E100 | E111 | C44 | bulk |",
        "|---|---|---|---|---|---|---|",
    ]
    for solid in solids:
        if solid.radius == radius:
            values = " | ".join(f"{value:.5g}" for value in solid.moduli.array)
            lines.append(
                f"| {solid.tet_edge:.3g} | {solid.nodes:,} | {solid.density:.4f} | {values} |"
            )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
