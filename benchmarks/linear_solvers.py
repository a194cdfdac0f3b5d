"""Time, memory and residual of each linear solver on clamped tet10 blocks under an end load.

Run as `python3 benchmarks/linear_solvers.py > result.json`; each measurement has a process of its
own. Its table is the ground of docs/decisions/0001-linear-solver-choice.md.
"""

import argparse
import json
import resource
import subprocess
import sys
import time

import jax
import numpy as np

# Hexahedra along an edge of a cube, and across a bar five times as long as wide.
CUBES = [9, 13, 18, 23]
BARS = [5, 7, 10]
SOLVERS = ["pardiso", "amg", "superlu"]

# SuperLU took 33 s and 3.5 GB at 59k dofs, growing with the square.
SUPERLU_DOFS = 80_000


def measure(shape: str, cells: int, solver: str) -> dict[str, object]:
    """Factorise and solve once in this process."""
    jax.config.update("jax_enable_x64", True)
    from fea import SolidModel, Support, TetMesh, force_on_facets, material

    size, counts = {
        "cube": ((40.0, 40.0, 40.0), (cells, cells, cells)),
        "bar": ((100.0, 20.0, 20.0), (5 * cells, cells, cells)),
    }[shape]
    mesh = TetMesh.box(size, counts).to_tet10()
    dofs = mesh.nodes.size
    if solver == "superlu" and dofs > SUPERLU_DOFS:
        return {}
    clamp = Support.clamp(np.flatnonzero(mesh.nodes[:, 0] < 1e-9))
    end = mesh.boundary_facets[mesh.facet_centroids[:, 0] > size[0] - 1e-9]
    forces = force_on_facets(mesh, end, np.array([0.0, 0.0, -500.0]))
    wall, cpu = time.perf_counter(), time.process_time()
    model = SolidModel.from_supports(mesh, material("steel"), [clamp], solver=solver)
    ready, rhs = (
        time.perf_counter(),
        model.reduced.load(model.K, forces.ravel(), 0 * forces.ravel()),
    )
    solution = model.factor.solve(rhs)
    return {
        "shape": shape,
        "dofs": dofs,
        "solver": solver,
        "prepare_s": round(ready - wall, 2),
        "solve_s": round(time.perf_counter() - ready, 2),
        "cpu_s": round(time.process_time() - cpu, 2),
        "iterations": solution.iterations,
        "residual": solution.residual,
        "peak_memory_gb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6, 2),
    }


def main() -> None:
    """Measure everything, or one thing in the process that was asked to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--one", nargs=3, metavar=("SHAPE", "CELLS", "SOLVER"))
    asked = parser.parse_args().one
    if asked:
        print(json.dumps(measure(asked[0], int(asked[1]), asked[2])))
        return
    rows = []
    for shape, sizes in (("cube", CUBES), ("bar", BARS)):
        for cells in sizes:
            for solver in SOLVERS:
                command = [sys.executable, __file__, "--one", shape, str(cells), solver]
                done = subprocess.run(command, capture_output=True, text=True, check=True)
                if row := json.loads(done.stdout):
                    rows.append(row)
    print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
