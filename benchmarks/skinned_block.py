"""A skinned lattice as frame and shells against solid tets of the same meshed result.

A block, 20 x 10 x 10 mm, of 4 x 2 x 2 octet cells under a skin of 0.5 mm, clamped at one end and pulled
sideways at the other. The solid is the printable mesh of the result, in tets of fTetWild, which are
kept in --folder: they take minutes. Results: results/skinned_block.json and .md.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np
from solid import installed, machine, write

import fea
from fea import TetMesh
from fea.frame import FrameSolution, solve_frame
from fea.ftetwild import tetrahedralise
from texmap_opt.box import Box
from texmap_opt.builtin_part import builtin_part
from texmap_opt.case import DesignCase
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.combine.part_with_lattice import rod_result
from texmap_opt.frame_model import FrameModel, frame_model
from texmap_opt.part import Part
from texmap_opt.solid.float32_solid import printable_mesh
from texmap_opt.solid.lattice_solid import lattice_solid
from texmap_opt.stress_field import stress_field
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.volume import lattice_volume
from texmap_opt.trimmed_lattice import trimmed_lattice
from texmap_opt.warp.grid import Grid

HERE = Path(__file__).parent
PACKAGES = ("numpy", "scipy", "jax", "pytetwild")
SIZE = (20.0, 10.0, 10.0)
CELLS = (4, 2, 2)
SKIN = 0.5
# Octet of true density 0.12 within the block.
RADIUS = 0.25
FORCE = 10.0
# fTetWild may move the surface this far, over the struts' radius; its own choice eats struts.
EPSILON = 0.1
# Largest edge of a tet, over the struts' radius.
EDGE = 1.2
# Facets of the ends are those whose normal is along the block to within this cosine.
ACROSS = 0.9
# Tolerance of the skin's inner wall and of round struts [mm].
TOLERANCE = 0.02
# Divisions of the block's shortest side for the skin's triangles.
DIVISIONS = (4, 8, 16, 24)


def case(*, skin_mm: float, radius: float, joints: bool = True) -> DesignCase:
    """The block as `texmap run` would be given it."""
    length, width, height = SIZE
    face = {"normal": [1, 0, 0]}
    return DesignCase.from_tables(
        {
            "part": {
                "builtin": "cantilever",
                "length_mm": length,
                "width_mm": width,
                "height_mm": height,
            },
            "material": {"name": "AlSi10Mg"},
            "analysis": {"joint_model": joints},
            "support": [{"region": {"plane": face | {"point": [0, 0, 0]}}}],
            "load": [
                {
                    "region": {"plane": face | {"point": [length, 0, 0]}},
                    "force_N": [0.0, 0.0, -FORCE],
                }
            ],
            "lattice": {
                "cell": "octet",
                "cells": list(CELLS),
                "radius_mm": radius,
                "skin_mm": skin_mm,
            },
            "output": {"tolerance_mm": TOLERANCE},
        },
        Path("skinned_block.toml"),
    )


def block() -> Part:
    """The part."""
    names = ("length_mm", "width_mm", "height_mm")
    return Part(builtin_part("cantilever", dict(zip(names, SIZE, strict=True))), "block")


def lattice(given: DesignCase, part: Part, radius: float, stress: Any) -> Structure:
    """The octet, its outermost joints on the block's faces."""
    grid = Grid.uniform(Box.aligned(part.bounds), CELLS)
    cell = unit_cell("octet")
    return trimmed_lattice(given, part, stress, cell, grid, radius_mm=radius).structure


def part_tets(part: Part, division: int) -> TetMesh:
    """The part in regular tets: its surface is the skin's triangles."""
    x, y, z = (round(size / min(SIZE) * division) for size in SIZE)
    a, b, c = part.bounds[0].tolist()
    return TetMesh.box(SIZE, (x, y, z), origin=(a, b, c))


def model(skin_mm: float, radius: float, division: int, *, joints: bool) -> FrameModel:
    """The frame of the block, with its skin unless `skin_mm` is 0, and with the joint model or not."""
    given, part = case(skin_mm=skin_mm, radius=radius, joints=joints), block()
    stress = stress_field(given, part_tets(part, division))
    return frame_model(lattice(given, part, radius, stress), part, given, stress)


def tip(solution: FrameSolution) -> float:
    """Mean displacement of the end face along the load [mm]: the work of the load over it."""
    return float(solution.compliance.sum()) / FORCE


def solid_tets(folder: Path, radius: float) -> tuple[TetMesh, dict[str, float]]:
    """Tets of the printable result, and what they have lost or gained of its volume."""
    kept = folder / f"skinned-block-{radius:g}.npz"
    given, part = case(skin_mm=SKIN, radius=radius), block()
    stress = stress_field(given, part_tets(part, DIVISIONS[0]))
    structure = lattice(given, part, radius, stress)
    rods = lattice_solid(structure, tolerance_mm=TOLERANCE).surface
    result = rod_result(part.surface, rods, skin_mm=SKIN, tolerance_mm=TOLERANCE)
    surface = printable_mesh(result.surface)[0]
    if not kept.exists():
        with tempfile.TemporaryDirectory() as scratch:
            # The mesher leaves files where it runs.
            here = Path.cwd()
            os.chdir(scratch)
            mesh = tetrahedralise(
                surface.vertices, surface.faces, edge=EDGE * radius, envelope=EPSILON * radius
            )
            os.chdir(here)
        np.savez(kept, nodes=mesh.nodes, tets=mesh.tets)
    stored = np.load(kept)
    mesh = TetMesh(stored["nodes"], stored["tets"])
    return mesh.to_tet10(), {
        "surface_mm3": surface.volume,
        "tets_mm3": mesh.volume,
        "struts_mm3": lattice_volume(structure),
        "density": lattice_volume(structure) / part.volume,
    }


def solid_tip(mesh: TetMesh, radius: float) -> dict[str, float]:
    """Mean displacement of the end face of the solid [mm], with its estimated error."""
    # fTetWild leaves the ends within its envelope of where they were.
    x, low = mesh.facet_centroids[:, 0], block().bounds[0, 0]
    faces = np.abs(mesh.facet_normals[:, 0]) > ACROSS
    slack = 2 * EPSILON * radius
    clamped = np.unique(mesh.boundary_facets[faces & (x < low + slack)])
    pulled = mesh.boundary_facets[faces & (x > low + SIZE[0] - slack)]
    forces = fea.force_on_facets(mesh, pulled, np.array([0.0, 0.0, -FORCE]))
    material = case(skin_mm=SKIN, radius=radius).material
    problem = fea.SolidProblem.from_supports(
        mesh, material, [fea.Support.clamp(clamped)], forces[None]
    )
    solution = fea.solve_solid(problem)
    return {
        "dofs": int(3 * len(mesh.nodes)),
        "end_mm2": float(mesh.facet_areas[faces & (x > low + SIZE[0] - slack)].sum()),
        "tip_mm": float(solution.compliance[0]) / FORCE,
        "residual": solution.residual,
    }


def measured(folder: Path, radius: float) -> dict[str, Any]:
    """All models of the block."""
    start = time.perf_counter()
    mesh, volumes = solid_tets(folder, radius)
    solved = time.perf_counter()
    solid = {"tets": len(mesh.tets), **volumes, **solid_tip(mesh, radius)}
    solid |= {"mesh_s": solved - start, "seconds": time.perf_counter() - solved}
    print(json.dumps(solid), file=sys.stderr, flush=True)
    rows = [
        compared(name, SKIN, radius, division, joints=joints)
        for name, joints in (("frame and skin", True), ("frame and skin, plain joints", False))
        for division in DIVISIONS
    ]
    rows.append(compared("frame alone", 0.0, radius, DIVISIONS[0], joints=True))
    for row in rows:
        row["over_solid"] = row["tip_mm"] / solid["tip_mm"]
    return {"radius_mm": radius, "solid": solid, "models": rows}


def compared(
    name: str, skin_mm: float, radius: float, division: int, *, joints: bool
) -> dict[str, Any]:
    """One model of the frame."""
    start = time.perf_counter()
    problem = model(skin_mm, radius, division, joints=joints).problem()
    tip_mm = tip(solve_frame(problem))
    return {
        "model": name,
        "triangles": 0 if problem.skin is None else len(problem.skin.triangles),
        "dofs": int(problem.fixed.size),
        "tip_mm": tip_mm,
        "seconds": time.perf_counter() - start,
    }


def markdown(result: dict[str, Any]) -> str:
    """The table for readers."""
    solid, machine = result["solid"], result["machine"]
    lost = 100 * (solid["tets_mm3"] / solid["surface_mm3"] - 1)
    lines = [
        f"{machine['cpu']}, {machine['cores']} cores; "
        + ", ".join(f"{name} {version}" for name, version in result["versions"].items())
        + ".",
        "",
        f"Struts of {result['radius_mm']:g} mm, {100 * solid['density']:.1f} % of the block; tets "
        f"{solid['tets_mm3']:.1f} mm³, {lost:+.2f} % of the surface's {solid['surface_mm3']:.1f} mm³; "
        f"relative residual {solid['residual']:.0e}.",
        "",
        "| model | triangles or tets | dofs | tip [mm] | over solid | seconds |",
        "|---|---|---|---|---|---|",
        f"| solid | {solid['tets']:,} | {solid['dofs']:,} | {solid['tip_mm']:.4g} | 1 | "
        f"{solid['seconds']:.3g} |",
    ]
    lines += [
        f"| {row['model']} | {row['triangles']:,} | {row['dofs']:,} | {row['tip_mm']:.4g} | "
        f"{row['over_solid']:.3g} | {row['seconds']:.3g} |"
        for row in result["models"]
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=HERE / "meshes", help="keeps the tets")
    parser.add_argument("--out", type=Path, default=HERE / "results" / "skinned_block.json")
    parser.add_argument("--radius", type=float, default=RADIUS, help="of the struts [mm]")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    with jax.enable_x64(True):
        found = measured(asked.folder.resolve(), asked.radius)
    result = {"machine": machine(), "versions": installed(PACKAGES), **found}
    write(asked.out, result, markdown(result))


if __name__ == "__main__":
    main()
