"""Time, memory and residual of every linear solver on solids and frames.

`python3 benchmarks/linear_solve.py --folder tets > result.json` measures, each measurement in a
process of its own; `python3 benchmarks/linear_solve.py --table result.json` prints the table that
docs/decisions/0001-linear-solver-choice.md rests on.

Solids are the tets (`nodes`, `tets`) in the folder's .npz files, clamped at their lowest x, pulled
down at the highest; boxes are added where the folder lacks them, so that every solver and every later
run sees the same meshes. Frames are cubes of unit cells, clamped below, loaded above. "Next" solves
with all moduli or radii changed at random by a factor of 0.8 to 1.25 and the last solution as guess.
"""

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np

from fea import FeaError, Support, TetMesh, force_on_facets, material, rigid_body_modes
from fea.equilibrium import AbstractForm, AbstractProblem, Assembled, MatrixFree
from fea.frame import FrameProblem
from fea.linear_solve import factorise
from fea.sections import Round
from fea.solid import SolidProblem

# Size [mm], hexahedra along x, y, z, and nodes of a tetrahedron of the boxes.
BOXES = {
    "cube-tet10-13": ((40.0, 40.0, 40.0), (13, 13, 13), 10),
    "cube-tet10-18": ((40.0, 40.0, 40.0), (18, 18, 18), 10),
    "cube-tet10-23": ((40.0, 40.0, 40.0), (23, 23, 23), 10),
    "bar-tet10-7": ((100.0, 20.0, 20.0), (35, 7, 7), 10),
    "bar-tet4-20": ((100.0, 20.0, 20.0), (100, 20, 20), 4),
    "bar-tet4-32": ((100.0, 20.0, 20.0), (160, 32, 32), 4),
}

# Unit cell, cells along an edge, radius over cell size.
FRAMES = {
    "octet-8": ("octet", 8, 0.05),
    "octet-12": ("octet", 12, 0.05),
    "octet-16": ("octet", 16, 0.05),
    "octet-24": ("octet", 24, 0.05),
    "bcc-16": ("bcc", 16, 0.05),
    "bcc-16-slender": ("bcc", 16, 0.01),
    "bcc-24-slender": ("bcc", 24, 0.01),
}

# Largest models [dofs] that a solver is tried on: beyond, it takes minutes or tens of GB.
LIMITS = {"pardiso": 400_000, "superlu": 60_000, "amg": 2_000_000, "jax-cg": 250_000}

REPEATS = 3


def solid(path: Path) -> SolidProblem:
    """The tets of a file, clamped at one end, loaded at the other."""
    saved = np.load(path)
    mesh = TetMesh(saved["nodes"], saved["tets"].astype(np.int64))
    x = mesh.nodes[:, 0]
    near = 1e-3 * np.ptp(x)  # a mesher leaves nodes a little beside the plane
    end = mesh.boundary_facets[mesh.facet_centroids[:, 0] > x.max() - near]
    forces = force_on_facets(mesh, end, np.array([0.0, 0.0, -500.0]))
    clamp = Support.clamp(np.flatnonzero(x < x.min() + near))
    return SolidProblem.from_supports(mesh, material("steel"), [clamp], forces)


def frame(cell: str, cells: int, radius: float) -> FrameProblem:
    """A cube of unit cells of 10 mm."""
    from texmap_opt.cells.catalogue import unit_cell
    from texmap_opt.structure.tile import tile

    net = tile(unit_cell(cell), (cells, cells, cells))
    joints = 10.0 * net.joints
    low, high = joints[:, 2] < 1e-9, joints[:, 2] > 10 * cells - 1e-9
    forces = np.zeros((1, len(joints), 6))
    forces[0, high, :3] = [1.0, 0.0, -1.0]
    return FrameProblem(
        joints=joints,
        struts=net.struts,
        radii=np.full((len(net.struts), 2), 10 * radius),
        E=70_000.0,
        nu=0.3,
        section=Round(),
        fixed=np.repeat(low[:, None], 6, axis=1),
        value=np.zeros((len(joints), 6)),
        forces=forces,
    )


def varied(problem: AbstractProblem) -> AbstractProblem:
    """Every modulus or radius times a random factor."""
    name = "modulus" if isinstance(problem, SolidProblem) else "radii"
    old = problem.parameters[name]
    factor = np.random.default_rng(0).uniform(0.8, 1.25, (len(old), 1))
    return problem.with_parameters({name: old * factor})


class Clock:
    """Wall and CPU seconds since the last look."""

    def __init__(self):
        self._last = time.perf_counter(), time.process_time()

    def look(self) -> tuple[float, float]:
        """Seconds since the last look."""
        now = time.perf_counter(), time.process_time()
        spent = now[0] - self._last[0], now[1] - self._last[1]
        self._last = now
        return round(spent[0], 3), round(spent[1], 3)


def measure(problem: AbstractProblem, solver: str) -> dict[str, Any]:
    """Prepare, solve, and solve again with other values, in this process."""
    free = solver == "jax-cg"
    form: AbstractForm = MatrixFree(problem.fixed) if free else Assembled.of(problem)
    first, second = (form.stiffness(p)[1] for p in (problem, varied(problem)))
    modes = rigid_body_modes(problem.points, rotations=problem.fixed.shape[1] == 6)
    modes = form.restrict(np.moveaxis(modes.reshape(*problem.fixed.shape, 6), -1, 0))
    load = form.restrict(problem.forces)
    if free:  # what JAX compiles is the same for every problem of this size
        factorise(first, near_null=modes, solver=solver).solve(load, rtol=0.9)
    row: dict[str, Any] = {"solver": solver, "dofs": len(load), "before_gb": peak_gb()}
    clock = Clock()
    factor = factorise(first, near_null=modes, solver=solver)
    row["prepare_s"], row["prepare_cpu_s"] = clock.look()
    solution = factor.solve(load)
    row["solve_s"], row["solve_cpu_s"] = clock.look()
    row["iterations"], row["residual"] = solution.iterations, solution.residual
    row["gb"] = peak_gb()
    again = factor.update(second).solve(load, x0=solution.x)
    row["next_s"], row["next_cpu_s"] = clock.look()
    row["next_iterations"], row["next_residual"] = again.iterations, again.residual
    return row


def peak_gb() -> float:
    """Largest memory of this process so far."""
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6, 2)


def one(folder: Path, name: str, solver: str) -> dict[str, Any]:
    """One row, or why there is none."""
    jax.config.update("jax_enable_x64", True)
    problem = frame(*FRAMES[name]) if name in FRAMES else solid(folder / f"{name}.npz")
    if problem.fixed.size > LIMITS[solver]:
        return {}
    try:
        return {"problem": name, **measure(problem, solver)}
    except FeaError as failure:
        return {"problem": name, "solver": solver, "failure": str(failure)}


def best(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The smallest of every time; other entries are those of the first run."""
    times = [key for key in rows[0] if key.endswith("_s")]
    return {**rows[0], **{key: min(row[key] for row in rows) for key in times}}


def measured(folder: Path, only: list[str], solvers: list[str]) -> dict[str, Any]:
    """All rows, with the machine they come from."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, (size, cells, corners) in BOXES.items():
        path = folder / f"{name}.npz"
        if not path.exists():
            mesh = TetMesh.box(size, cells)
            mesh = mesh.to_tet10() if corners == 10 else mesh
            np.savez(path, nodes=mesh.nodes, tets=mesh.tets.astype(np.int32))
    names = [path.stem for path in sorted(folder.glob("*.npz"))] + list(FRAMES)
    rows = []
    for name in only or names:
        for solver in solvers:
            command = [sys.executable, __file__, "--folder", str(folder), "--one", name, solver]
            runs = []
            for _ in range(REPEATS):
                done = subprocess.run(command, capture_output=True, text=True, check=True)
                runs.append(json.loads(done.stdout))
                if "prepare_s" not in runs[-1]:
                    break
            if runs[0]:
                rows.append(best(runs))
                print(json.dumps(rows[-1]), file=sys.stderr)
    packages = ("numpy", "scipy", "jax", "pyamg", "pypardiso", "mkl")
    machine = {"processor": platform.machine(), "cores": os.cpu_count()}
    versions = {package: version(package) for package in packages}
    return {"machine": machine, "versions": versions, "best_of": REPEATS, "rows": rows}


def table(rows: list[dict[str, Any]]) -> str:
    """Markdown: seconds as wall / CPU."""
    lines = [
        "| problem | dofs | solver | prepare s | solve s | next s | iterations | residual | GB |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        if "failure" in row:
            lines.append(f"| {row['problem']} | | {row['solver']} | {row['failure']} |||||||")
            continue
        spent = [
            f"{row[k + '_s']:.2f} / {row[k + '_cpu_s']:.2f}" for k in ("prepare", "solve", "next")
        ]
        lines.append(
            f"| {row['problem']} | {row['dofs']:,} | {row['solver']} | {' | '.join(spent)} | "
            f"{row['iterations']}, {row['next_iterations']} | {row['residual']:.0e} | {row['gb']} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Measure everything, one thing in the process that was asked to, or print the table."""
    parser = argparse.ArgumentParser(description="Time, memory and residual of linear solvers.")
    parser.add_argument("--folder", type=Path, default=Path("tets"), help="where tets are kept")
    parser.add_argument("--only", nargs="*", default=[], help="problems, by name")
    parser.add_argument("--solvers", nargs="*", default=list(LIMITS))
    parser.add_argument("--table", type=Path, help="print the table of this result")
    parser.add_argument("--one", nargs=2, metavar=("PROBLEM", "SOLVER"), help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.table:
        print(table(json.loads(asked.table.read_text())["rows"]))
    elif asked.one:
        print(json.dumps(one(asked.folder, *asked.one)))
    else:
        print(json.dumps(measured(asked.folder, asked.only, asked.solvers), indent=1))


if __name__ == "__main__":
    main()
