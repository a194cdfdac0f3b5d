"""One measurement of `benchmarks/frame.py`, alone in its process: prints a line of JSON.

All solvers get the same stiffness, assembled by `fea`, and are judged by the same residual,
|f - K u| / |f| without supports, computed by SciPy after the clock has stopped.
"""

import argparse
import json
from dataclasses import replace
from typing import Any

import jax
import numpy as np
from frame_problem import PROBLEMS, Lattice, varied
from scipy.sparse import bsr_array
from stopwatch import Stopwatch, peak_memory_gb

import fea.equilibrium
from fea import FeaError, compliance_gradient, rigid_body_modes, solve_frame
from fea.assembly import Pattern, Reduced
from fea.frame import FrameProblem, FrameSolution
from fea.linear_solve import Factor
from fea.linear_solve.amg import MultigridCG
from fea.sections import Round
from fea.system import Assembled

# Wanted |f - K u| / |f| of lattices, and of shells alone, in which rounding of u leaves more.
RTOL, RTOL_SHEET = 1e-8, 1e-6

# Cells along an edge of the lattice on which code is compiled before the clock starts: no fewer struts
# than `fea` computes at once, 32,768, and few more, since freed memory is not all given back.
WARM_UP = {"octet": 12, "bcc": 16}

# Repeats in one process of what takes milliseconds.
SHORT_REPEATS = 20

# Iterations after which another code's conjugate gradients give up.
MOST_ITERATIONS = 2000


def fea_frame(name: str) -> dict[str, Any]:
    """First solve, solve after a change of radii, gradient; all that `solve_frame` does."""
    return _solved(name, "auto")


def fea_multigrid(name: str) -> dict[str, Any]:
    """The same by multigrid."""
    return _solved(name, "amg")


def fea_pardiso(name: str) -> dict[str, Any]:
    """The same by PARDISO, as `fea` uses it."""
    return _solved(name, "pardiso")


def pyamg_untuned(name: str) -> dict[str, Any]:
    """Smoothed aggregation of pyamg with its defaults, the six rigid-body modes, 6 x 6 blocks."""
    from pyamg import smoothed_aggregation_solver

    clock = Stopwatch()
    K, modes, load = _system(name)
    before, steps = peak_memory_gb(), []
    with clock.stage("factor"):
        hierarchy = smoothed_aggregation_solver(K, B=modes)
    with clock.stage("solve"):
        solved = hierarchy.solve(
            load, tol=RTOL, accel="cg", maxiter=MOST_ITERATIONS, callback=lambda _: steps.append(0)
        )
    return _row(clock, before, dofs=len(load), iterations=len(steps)) | {
        "residual": _residual(K, np.asarray(solved), load)
    }


def pynite(name: str) -> dict[str, Any]:
    """PyNite on a small frame of Euler-Bernoulli beams, and ours on the same, compiled before."""
    clock = Stopwatch()
    problem = replace(PROBLEMS[name].problem(), section=Round(shear_factor=float("inf")))
    _whole(varied(problem))  # the same compiled code for any radii
    before = peak_memory_gb()
    solution, model = _whole(problem), _pynite_model(problem)
    least: dict[str, list[float]] = {}
    # So short that the least of a few is meant, of both codes.
    for _ in range(SHORT_REPEATS):
        with clock.stage("fea"):
            solution = _whole(problem)
        with clock.stage("model"):
            model = _pynite_model(problem)
        with clock.stage("analyze_linear"):
            model.analyze_linear()
        for stage, spent in clock.seconds.items():
            least[stage] = list(map(min, least.get(stage, spent), spent))
        clock.clear()
    clock.seconds = least
    case = "Combo 1"
    theirs = np.array(
        [
            [getattr(node, axis)[case] for axis in ("DX", "DY", "DZ", "RX", "RY", "RZ")]
            for node in (model.nodes[f"{number}"] for number in range(len(problem.joints)))
        ]
    )
    ours = solution.displacement[0]
    return _row(
        clock,
        before,
        dofs=ours.size,
        struts=len(problem.struts),
        difference=float(np.abs(ours - theirs).max() / np.abs(theirs).max()),
        residual=solution.residual,
    )


def _pynite_model(problem: FrameProblem) -> Any:
    """The same round struts, all of one radius, supports and forces."""
    from Pynite import FEModel3D

    radius = float(problem.radii[0, 0])
    area, second = np.pi * radius**2, np.pi / 4 * radius**4
    model = FEModel3D()
    model.add_material("m", problem.E, problem.strut_material.G, problem.nu, 0.0)
    model.add_section("s", area, second, second, 2 * second)
    for number, point in enumerate(problem.joints):
        model.add_node(f"{number}", *map(float, point))
    for number, (a, b) in enumerate(problem.struts):
        model.add_member(f"{number}", f"{a}", f"{b}", "m", "s")
    for number in np.flatnonzero(problem.fixed.all(axis=1)):
        model.def_support(f"{number}", *[True] * 6)
    for number, axis in np.argwhere(problem.forces[0]):
        direction = ("FX", "FY", "FZ", "MX", "MY", "MZ")[axis]
        model.add_node_load(f"{number}", direction, float(problem.forces[0, number, axis]))
    return model


def _whole(problem: FrameProblem) -> FrameSolution:
    """All that PyNite's analysis gives: displacements and reactions; member forces come on demand."""
    solution = solve_frame(problem)
    solution.reaction  # noqa: B018 - computed when first asked for
    return solution


def _solved(name: str, solver: str) -> dict[str, Any]:
    clock = Stopwatch()
    clock.watch(FrameProblem, "check", "check")
    clock.watch(Pattern, "from_groups", "pattern")
    clock.watch(FrameProblem, "stiffness", "stiffness")
    clock.watch(Reduced, "from_pattern", "supports")
    clock.watch(Reduced, "matrix", "supports")
    clock.watch(fea.equilibrium, "rigid_body_modes", "supports")
    clock.watch(fea.equilibrium, "factorise", "factor")
    clock.watch(Factor, "update", "factor")
    rtol = RTOL if isinstance(PROBLEMS[name], Lattice) else RTOL_SHEET
    clock.watch(Factor, "solve", "solve", rtol=rtol)
    clock.watch(MultigridCG, "_rebuild", "hierarchy", count=lambda _: 1)
    problem = PROBLEMS[name].problem()
    _compile(name, problem, solver)
    clock.clear()
    before = peak_memory_gb()
    with clock.stage("total"):
        first = solve_frame(problem, solver=solver)
    stages, row = dict(clock.seconds), {"gb_first": peak_memory_gb()}
    iterations = first.iterations
    changed = varied(problem)
    clock.clear()
    with clock.stage("total"):
        second = solve_frame(changed, previous=first)
    stages |= {f"next {stage}": spent for stage, spent in clock.seconds.items()}
    row["new_hierarchies"] = clock.counts.get("hierarchy", 0)
    worst = max(first.residual, second.residual)
    del first
    clock.clear()
    with clock.stage("gradient of compliance"):
        gradient = compliance_gradient(second)
    clock.seconds = stages | clock.seconds
    row |= _row(
        clock,
        before,
        dofs=int((~problem.fixed).sum()),
        solver=second.system.factor.name,
        iterations=[iterations, second.iterations],
        residual=worst,
        euler_error=_euler_error(second, gradient),
    )
    return row


def _compile(name: str, problem: FrameProblem, solver: str) -> None:
    """Run once what JAX compiles, for the sizes that will be measured."""
    lattice = PROBLEMS[name]
    if isinstance(lattice, Lattice) and not lattice.skinned:
        small = replace(lattice, cells=WARM_UP[lattice.cell]).problem()
        compliance_gradient(solve_frame(small, solver="amg"))
        problem.stiffness(Pattern.from_groups(problem.groups, len(problem.points)))
    else:
        compliance_gradient(solve_frame(problem, solver=solver))


def _euler_error(solution: FrameSolution, gradient: dict[str, np.ndarray]) -> float:
    """Of Euler's theorem: compliance has degree 2 in the forces."""
    work = float((gradient["forces"] * solution.problem.forces).sum())
    return abs(work / (2 * float(solution.compliance.sum())) - 1)


def _system(name: str) -> tuple[bsr_array, np.ndarray, np.ndarray]:
    """Stiffness without supports, rigid-body modes and load."""
    problem = PROBLEMS[name].problem()
    form = Assembled.of(problem)
    K = form.stiffness(problem)[1]
    modes = rigid_body_modes(problem.points, rotations=True).reshape(*problem.fixed.shape, 6)
    load = form.restrict(form.gathered(problem.loads))[:, 0]
    return K, form.restrict(np.moveaxis(modes, -1, 0)), load


def _residual(K: bsr_array, u: np.ndarray, load: np.ndarray) -> float:
    return float(np.linalg.norm(load - K @ u) / np.linalg.norm(load))


def _row(clock: Stopwatch, before: float, **more: Any) -> dict[str, Any]:
    return {
        "stages": clock.rows(),
        "peak_memory_gb": peak_memory_gb(),
        "memory_before_gb": before,
        **more,
    }


RUNS = {
    "fea": fea_frame,
    "fea multigrid": fea_multigrid,
    "fea pardiso": fea_pardiso,
    "pyamg": pyamg_untuned,
    "pynite": pynite,
}


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", choices=list(RUNS))
    parser.add_argument("problem", choices=list(PROBLEMS))
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    try:
        row = RUNS[asked.run](asked.problem)
    except FeaError as failure:
        row = {"failure": str(failure)}
    print(json.dumps({"run": asked.run, "problem": asked.problem, **row}))


if __name__ == "__main__":
    main()
