"""Runs a mesh, its supports and loads in CalculiX and reads what it finds.

G. Dhondt, CalculiX CrunchiX user's manual, version 2.20. Its C3D10 has the node order of VTK (section
6.2.6), and so has C3D4.
"""

import os
import shutil
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from fea import Material, SolidProblem, TetMesh
from fea.materials import Orthotropic

# Digits that fit into the twenty columns CalculiX reads, with sign and exponent.
DIGITS = 13

ELEMENT = {"tet4": "C3D4", "tet10": "C3D10"}

# Corners of the faces P1 to P4 (section 6.2.6), here numbered from 0.
FACES = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])

# Integration points on the reference tetrahedron, in the order of the output (gauss.f: gauss3d4,
# gauss3d5).
_A, _B = 0.138196601125011, 0.585410196624968
POINTS = {
    "tet4": np.full((1, 3), 0.25),
    "tet10": np.array([[_A, _A, _A], [_B, _A, _A], [_A, _B, _A], [_A, _A, _B]]),
}

# Components of the output xx, yy, zz, xy, xz, yz in the order of `fea`.
VOIGT = [0, 1, 2, 5, 4, 3]

# Seconds after which a run is taken to hang; those here need about one.
MAX_SECONDS = 120


@dataclass(frozen=True)
class Result:
    """What CalculiX finds.

    Attributes:
        displacement: of the nodes [mm].
        force: outer force on each node, loads and reactions together [N].
        stress: at the integration points, in the order of the mesh's own quadrature [MPa].
    """

    displacement: Float[np.ndarray, "nodes 3"]
    force: Float[np.ndarray, "nodes 3"]
    stress: Float[np.ndarray, "cells quad 6"]


def installed() -> bool:
    """Whether the program is there."""
    return shutil.which("ccx") is not None


def run(
    folder: Path, problem: SolidProblem, *, material: Iterable[str], loads: Iterable[str]
) -> Result:
    """Solve one load case.

    Args:
        folder: where files are written.
        problem: gives mesh and supports.
        material: lines that define MATERIAL=M, from `isotropic` or `orthotropic`.
        loads: lines within the step, from `nodal_forces`, `pressure` or `gravity`.
    """
    mesh, material = problem.mesh, list(material)
    lines = ["*NODE, NSET=NALL"]
    lines += [f"{n}, {', '.join(map(number, x))}" for n, x in enumerate(mesh.nodes, 1)]
    lines += [f"*ELEMENT, TYPE={ELEMENT[mesh.element]}, ELSET=EALL"]
    lines += [", ".join(map(str, [e, *row])) for e, row in enumerate((mesh.tets + 1).tolist(), 1)]
    turned = ", ORIENTATION=AXES" if any("NAME=AXES" in line for line in material) else ""
    lines += [*material, f"*SOLID SECTION, ELSET=EALL, MATERIAL=M{turned}"]
    lines += ["*STEP", "*STATIC", "*BOUNDARY"]
    lines += [
        f"{n + 1}, {i + 1}, {i + 1}, {number(problem.value[n, i])}"
        for n, i in np.argwhere(problem.fixed)
    ]
    lines += [*loads, "*NODE PRINT, NSET=NALL", "U, RF"]
    lines += ["*EL PRINT, ELSET=EALL, GLOBAL=YES", "S", "*END STEP"]
    (folder / "case.inp").write_text("\n".join(lines) + "\n")
    done = subprocess.run(
        ["ccx", "case"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=MAX_SECONDS,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        check=False,
    )
    tables = _tables(folder / "case.dat")
    if set(tables) != {"displacements", "forces", "stresses"}:
        raise RuntimeError(f"CalculiX gave no result ({done.returncode}): {done.stdout[-2000:]}")
    rule = mesh.element_type.quadrature.points
    theirs = POINTS[mesh.element]
    distance = np.linalg.norm(rule[:, None] - theirs, axis=-1)
    stress = tables["stresses"][:, 2:].reshape(len(mesh.tets), len(theirs), 6)
    return Result(
        tables["displacements"][:, 1:],
        tables["forces"][:, 1:],
        stress[:, distance.argmin(axis=1)][:, :, VOIGT],
    )


def number(value: float) -> str:
    """A number as CalculiX reads it."""
    return f"{value:.{DIGITS}g}"


def isotropic(material: Material) -> list[str]:
    """Lines of an isotropic material."""
    return [
        "*MATERIAL, NAME=M",
        "*ELASTIC",
        f"{number(material.E)}, {number(material.nu)}",
        "*DENSITY",
        number(material.density),
    ]


def orthotropic(material: Orthotropic) -> list[str]:
    """Lines of an orthotropic material and its axes."""
    nu_yz, nu_xz, nu_xy = material.nu
    G_yz, G_xz, G_xy = material.G
    constants = [number(c) for c in (*material.E, nu_xy, nu_xz, nu_yz, G_xy, G_xz, G_yz)]
    return [
        "*MATERIAL, NAME=M",
        "*ELASTIC, TYPE=ENGINEERING CONSTANTS",
        ", ".join(constants[:8]),
        constants[8],
        "*ORIENTATION, NAME=AXES, SYSTEM=RECTANGULAR",
        # A point on the x axis, a point in the xy plane.
        ", ".join(number(c) for c in material.axes[:2].ravel()),
    ]


def nodal_forces(forces: Float[np.ndarray, "nodes 3"]) -> list[str]:
    """Lines of concentrated forces [N]."""
    return [
        "*CLOAD",
        *(f"{n + 1}, {i + 1}, {number(forces[n, i])}" for n, i in np.argwhere(forces != 0)),
    ]


def pressure(
    mesh: TetMesh, facets: Int[np.ndarray, "facets corners"], magnitude: float
) -> list[str]:
    """Lines of a pressure on facets [MPa], which CalculiX integrates itself."""
    faces = np.sort(mesh.tets[:, FACES].reshape(-1, 3), axis=1)
    place = {tuple(face): number for number, face in enumerate(faces.tolist())}
    # An outer face belongs to one cell only, so that the last entry is the only one.
    found = [divmod(place[tuple(sorted(row))], 4) for row in facets[:, :3].tolist()]
    return ["*DLOAD", *(f"{cell + 1}, P{face + 1}, {number(magnitude)}" for cell, face in found)]


def gravity(g: float) -> list[str]:
    """Lines of the weight in a field of g [mm/s²] along -z, which CalculiX integrates itself."""
    return ["*DLOAD", f"EALL, GRAV, {number(g)}, 0., 0., -1."]


def _tables(path: Path) -> dict[str, Float[np.ndarray, "rows columns"]]:
    """Numbers under each heading of the .dat file, by the heading's first word."""
    rows: dict[str, list[list[float]]] = {}
    name = ""
    for line in path.read_text().splitlines() if path.exists() else []:
        words = line.split()
        if words and words[0].isalpha():
            name = words[0]
            rows[name] = []
        elif words:
            rows[name].append([float(word) for word in words])
    return {name: np.array(table) for name, table in rows.items()}
