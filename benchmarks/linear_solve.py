"""Time, memory and residual of every linear solver on solids and frames.

`python3 benchmarks/linear_solve.py` writes benchmarks/results/linear_solve.json and, beside it, the table
in linear_solve.md that docs/decisions/0001-linear-solver-choice.md rests on. Each measurement has a
process of its own.

Solids are the tets (`nodes`, `tets`) in the .npz files of --folder, clamped at their lowest x, pulled
down at the highest; boxes are added where the folder lacks them, and any other file there is measured
too. Frames are cubes of unit cells, clamped below, loaded above. "Next" solves
with all moduli or radii changed at random by a factor of 0.8 to 1.25 and the last solution as guess.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np
from solid import installed, machine, write
from stopwatch import peak_memory_gb

from fea import FeaError, Support, TetMesh, force_on_facets, material, rigid_body_modes
from fea.frame import FrameProblem
from fea.linear_solve import factorise
from fea.linear_solve.element_operator import MATRIX_FREE
from fea.problem import AbstractProblem
from fea.sections import Round
from fea.solid import SolidProblem
from fea.system import AbstractForm, Assembled, MatrixFree

HERE = Path(__file__).parent
PACKAGES = ("python", "numpy", "scipy", "jax", "pyamg", "pypardiso", "mkl")

# Size [mm], hexahedra along x, y, z, and nodes of a tetrahedron of the boxes.
BOXES = {
    "cube-tet10-13": ((40.0, 40.0, 40.0), (13, 13, 13), 10),
    "cube-tet10-18": ((40.0, 40.0, 40.0), (18, 18, 18), 10),
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
}

# Largest models [dofs] that a solver is tried on: beyond, it takes most of a minute or many GB.
LIMITS = {"pardiso": 200_000, "superlu": 46_000, "amg": 2_000_000, MATRIX_FREE: 120_000}

# Measured seconds after which a run is not repeated: other programs disturb long ones in proportion
# less.
LONG = 10.0


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
    free = solver == MATRIX_FREE
    form: AbstractForm = MatrixFree(problem.fixed) if free else Assembled.of(problem)
    first, second = (form.stiffness(p)[1] for p in (problem, varied(problem)))
    modes = rigid_body_modes(problem.points, rotations=problem.fixed.shape[1] == 6)
    modes = form.restrict(np.moveaxis(modes.reshape(*problem.fixed.shape, 6), -1, 0))
    load = form.restrict(problem.forces)
    if free:  # what JAX compiles is the same for every problem of this size
        factorise(first, near_null=modes, solver=solver).solve(load, rtol=0.9)
    row: dict[str, Any] = {"solver": solver, "dofs": len(load), "before_gb": peak_memory_gb()}
    clock = Clock()
    factor = factorise(first, near_null=modes, solver=solver)
    row["prepare_s"], row["prepare_cpu_s"] = clock.look()
    solution = factor.solve(load)
    row["solve_s"], row["solve_cpu_s"] = clock.look()
    row["iterations"], row["residual"] = solution.iterations, solution.residual
    row["gb"] = peak_memory_gb()
    again = factor.update(second).solve(load, x0=solution.x)
    row["next_s"], row["next_cpu_s"] = clock.look()
    row["next_iterations"], row["next_residual"] = again.iterations, again.residual
    return row


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


def make_boxes(folder: Path) -> None:
    """The boxes that a folder lacks."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, (size, cells, corners) in BOXES.items():
        path = folder / f"{name}.npz"
        if not path.exists():
            mesh = TetMesh.box(size, cells)
            mesh = mesh.to_tet10() if corners == 10 else mesh
            np.savez(path, nodes=mesh.nodes, tets=mesh.tets.astype(np.int32))


def best(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The smallest of every time; other entries are those of the first run."""
    times = [key for key in rows[0] if key.endswith("_s")]
    return {**rows[0], **{key: min(row[key] for row in rows) for key in times}}


def measured(folder: Path, only: list[str], solvers: list[str], repeats: int) -> dict[str, Any]:
    """All rows, with the machine they come from."""
    # Not in this process: a child's peak memory starts from its parent's.
    child("--folder", str(folder), "--make")
    names = [path.stem for path in sorted(folder.glob("*.npz"))] + list(FRAMES)
    versions = installed()
    left_out = [] if versions["pypardiso"] else ["pardiso"]
    rows = []
    for name in only or names:
        for solver in (one for one in solvers if one not in left_out):
            runs: list[dict[str, Any]] = []
            while len(runs) < repeats and (not runs or short(runs[0])):
                runs.append(json.loads(child("--folder", str(folder), "--one", name, solver)))
            if runs[0]:
                rows.append({**best(runs), "runs": len(runs)})
                print(json.dumps(rows[-1]), file=sys.stderr)
    return {
        "machine": machine(),
        "versions": {package: versions[package] for package in PACKAGES},
        "left_out": left_out,
        "rows": rows,
    }


def short(row: dict[str, Any]) -> bool:
    """Whether there is a measurement, and it is worth repeating."""
    return "prepare_s" in row and sum(row[k] for k in ("prepare_s", "solve_s", "next_s")) < LONG


def child(*options: str) -> str:
    """What this command prints in a process of its own."""
    command = [sys.executable, __file__, *options]
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout


def markdown(result: dict[str, Any]) -> str:
    """The table for readers; seconds are wall / CPU."""
    about, versions = result["machine"], result["versions"]
    lines = [
        f"{about['cpu']}, {about['cores']} cores, {about['memory_gb']:g} GB; "
        + ", ".join(f"{name} {version or 'not installed'}" for name, version in versions.items())
        + ". Seconds are wall / CPU, the least of as many runs as the last column says.",
        "",
        "| problem | dofs | solver | prepare s | solve s | next s | iterations | residual | GB | runs |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        if "failure" in row:
            lines.append(f"| {row['problem']} | | {row['solver']} | {row['failure']} |||||||")
            continue
        spent = [
            f"{row[k + '_s']:.2f} / {row[k + '_cpu_s']:.2f}" for k in ("prepare", "solve", "next")
        ]
        lines.append(
            f"| {row['problem']} | {row['dofs']:,} | {row['solver']} | {' | '.join(spent)} | "
            f"{row['iterations']}, {row['next_iterations']} | {row['residual']:.0e} | "
            f"{row['gb']:.2f} | {row['runs']} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure everything, or in a process of its own one thing."""
    parser = argparse.ArgumentParser(description="Time, memory and residual of linear solvers.")
    folder = HERE / "meshes" / "linear_solve"
    parser.add_argument("--folder", type=Path, default=folder, help="where tets are kept")
    parser.add_argument("--out", type=Path, default=HERE / "results" / "linear_solve.json")
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--only", nargs="*", default=[], help="problems, by name")
    parser.add_argument("--solvers", nargs="*", default=list(LIMITS))
    parser.add_argument("--one", nargs=2, metavar=("PROBLEM", "SOLVER"), help=argparse.SUPPRESS)
    parser.add_argument("--make", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.make:
        make_boxes(asked.folder)
        return
    if asked.one:
        print(json.dumps(one(asked.folder, *asked.one)))
        return
    result = measured(asked.folder, asked.only, asked.solvers, asked.repeats)
    write(asked.out, result, markdown(result))


if __name__ == "__main__":
    main()
