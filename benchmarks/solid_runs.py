"""One measurement of `benchmarks/solid.py`, alone in its process: prints a line of JSON.

All codes get the same nodes, cells, supports and forces from a file, and are judged by the same
residual, with K assembled by `fea`, computed after the clock has stopped and peak memory has been read.
"""

import argparse
import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from solid_problem import (
    FORCE,
    NU,
    E,
    accuracy,
    ends,
    prepare,
    read_mesh,
    read_problem,
    residual,
    steel,
    stiffness,
    stiffness_difference,
    warm_up,
)
from stopwatch import Stopwatch, peak_memory_gb


def fea_assembly(path: Path, rtol: float) -> dict[str, Any]:
    """Element stiffness and assembly: with the pattern, and again with the pattern known."""
    from fea.assembly import Pattern

    clock = Stopwatch()
    problem = read_problem(path)
    compiling = _compiling(lambda: stiffness(read_problem(warm_up(path))))
    before = peak_memory_gb()
    with clock.stage("first"):
        pattern = Pattern.from_groups(problem.groups, len(problem.points))
        problem.stiffness(pattern)
    with clock.stage("again"):
        problem.stiffness(pattern)
    return _row(clock, before, compiling_s=compiling)


def skfem_assembly(path: Path, rtol: float, *, intorder: int | None = None) -> dict[str, Any]:
    """The same by scikit-fem's vector elements; "first" includes its basis."""
    import skfem
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    clock = Stopwatch()
    data = np.load(path)
    nodes, tets = data["nodes"], data["tets"]
    corners = np.unique(tets[:, :4])
    form = linear_elasticity(*lame_parameters(E, NU))
    scalar = skfem.ElementTetP1() if tets.shape[1] == 4 else skfem.ElementTetP2()
    before = peak_memory_gb()
    with clock.stage("mesh"):
        mesh = skfem.MeshTet(nodes[corners].T.copy(), tets[:, :4].T.copy().astype(np.int64))
    with clock.stage("first"):
        basis = skfem.Basis(mesh, skfem.ElementVector(scalar), intorder=intorder)
        K = form.assemble(basis)
    with clock.stage("again"):
        form.assemble(basis)
    row = _row(clock, before, points=basis.X.shape[-1])
    theirs = basis.doflocs.T[::3]
    return row | {"difference": stiffness_difference(path, K, theirs)}


def fea_solve(path: Path, rtol: float) -> dict[str, Any]:
    """From arrays to displacement, reaction and stress in the cells by `solve_solid`."""
    import fea.equilibrium
    from fea.assembly import Pattern, Reduced
    from fea.linear_solve import Factor
    from fea.solid import SolidProblem, solve_solid

    clock = Stopwatch()
    clock.watch(SolidProblem, "check", "check")
    clock.watch(Pattern, "from_groups", "pattern")
    clock.watch(SolidProblem, "stiffness", "stiffness")
    clock.watch(Reduced, "from_pattern", "supports")
    clock.watch(Reduced, "matrix", "supports")
    clock.watch(fea.equilibrium, "rigid_body_modes", "supports")
    clock.watch(fea.equilibrium, "factorise", "factor")
    clock.watch(Factor, "solve", "solve", rtol=rtol)

    def whole(path: Path, solver: str = "auto") -> Any:
        solution = solve_solid(read_problem(path), solver=solver)
        with clock.stage("stress"):
            solution.quadrature_stress  # noqa: B018 - computed when first asked for
            solution.reaction  # noqa: B018
        return solution

    solution, row = _timed(clock, path, whole)
    return row | accuracy(path, solution.displacement[0])


def torch_solve(path: Path, rtol: float) -> dict[str, Any]:
    """The same by torch-fem's `Solid.solve` with its defaults and `stol` = rtol.

    Its Newton loop stops at |f - K u| < 1e-8 |f|, so that one linear solve is enough where `rtol` is no
    larger; `linear_solves` tells.
    """
    import torch
    import torchfem.sparse
    from torchfem import Solid
    from torchfem.materials import IsotropicElasticity3D

    torch.set_default_dtype(torch.float64)
    clock = Stopwatch()
    clock.watch(Solid, "assemble_matrix", "assembly")
    clock.watch(Solid, "integrate_material", "stiffness, stress")
    clock.watch(torchfem.sparse, "_multigrid", "factor")
    clock.watch(torchfem.sparse, "_krylov", "solve", count=lambda result: result[1])
    clock.watch(torchfem.sparse, "sparse_solve", "linear solves", count=lambda _: 1)

    def whole(path: Path) -> Any:
        with np.load(path) as file:
            data = {name: torch.tensor(file[name]) for name in file.files}
        with clock.stage("pattern"):
            material = IsotropicElasticity3D(E=E, nu=NU)
            model = Solid(data["nodes"], data["tets"], material)
        model.constraints[data["fixed"]] = True
        model.forces = data["forces"]
        # "cg" is its choice above 10,000 dofs; the mesh that warms it up is smaller.
        return model.solve(stol=rtol, method="cg")[0]

    compiling = _compiling(lambda: whole(warm_up(path)))
    clock.clear()
    before = peak_memory_gb()
    with clock.stage("total"):
        u = whole(path)
    clock.take("linear solves")  # "factor" and "solve" together
    row = _row(
        clock,
        before,
        compiling_s=compiling,
        iterations=clock.counts["solve"],
        linear_solves=clock.counts["linear solves"],
    )
    return row | accuracy(path, u.numpy())


def fea_whole(path: Path, rtol: float) -> dict[str, Any]:
    """From a file of nodes and cells to stress at the nodes: all that a user waits for."""
    from fea import Support, force_on_facets, solve_solid
    from fea.solid import SolidProblem

    clock = Stopwatch()
    material = steel()

    def whole(path: Path, solver: str = "auto") -> Any:
        with clock.stage("mesh"):
            mesh = read_mesh(path)
        with clock.stage("loads"):
            clamped, pulled = ends(mesh)
            forces = force_on_facets(mesh, pulled, np.array(FORCE))
            clamp = Support.clamp(np.unique(clamped))
            problem = SolidProblem.from_supports(mesh, material, [clamp], forces)
        with clock.stage("solve_solid"):
            solution = solve_solid(problem, solver=solver)
        with clock.stage("stress in cells"):
            solution.quadrature_stress  # noqa: B018 - computed when first asked for
        with clock.stage("stress at nodes"):
            solution.stress  # noqa: B018
        with clock.stage("reaction"):
            solution.reaction  # noqa: B018
        return solution

    solution, row = _timed(clock, path, whole)
    problem = solution.problem
    return row | {
        "residual": residual(solution.system.K, solution.displacement[0], problem),
        "max_displacement_mm": float(np.abs(solution.displacement).max()),
        "reaction_error": float(
            np.abs(solution.reaction.sum(axis=(0, 1)) + FORCE).max() / np.abs(FORCE).max()
        ),
    }


def fea_gradients(path: Path, rtol: float) -> dict[str, Any]:
    """Gradients by node positions, modulus and forces, beside the assembly and solve they cost.

    Euler's theorem checks them: compliance is homogeneous of degree -1 in the modulus, the norm of
    stress of degree 1 in the forces.
    """
    import jax
    import jax.numpy as jnp

    import fea.equilibrium
    from fea import compliance_gradient, displacement, solve_solid
    from fea.assembly import Pattern
    from fea.linear_solve import Factor
    from fea.objectives import stress_p_norm

    clock = Stopwatch()
    clock.watch(fea.equilibrium, "factorise", "factor")
    clock.watch(Factor, "solve", "solve")
    problem = read_problem(path)
    compliance_gradient(solve_solid(read_problem(warm_up(path)), solver="amg"))  # compiles
    clock.clear()
    before = peak_memory_gb()
    with clock.stage("solve_solid"):
        solution = solve_solid(problem)
    first = clock.take("factor", "solve")
    pattern = Pattern.from_groups(problem.groups, len(problem.points))
    with clock.stage("stiffness, pattern known"):
        problem.stiffness(pattern)
    with clock.stage("gradient of compliance"):
        gradient = compliance_gradient(solution)

    def norm(nodes: Any, modulus: Any, forces: Any) -> Any:
        u = displacement(problem, nodes=nodes, modulus=modulus, forces=forces)
        return stress_p_norm(problem, u, nodes=nodes, modulus=modulus)[0]

    values = (problem.points, problem.modulus, problem.forces)
    with clock.stage("stress norm"):
        value, pull = jax.vjp(norm, *map(jnp.asarray, values))
    pull(jnp.ones_like(value))  # compiles
    clock.take("factor", "solve")
    with clock.stage("gradient of stress norm"):
        slopes = jax.block_until_ready(pull(jnp.ones_like(value)))
    adjoint = clock.take("solve")
    clock.seconds |= {"factor and solve": first, "adjoint solve": adjoint}
    C = float(solution.compliance[0])
    return _row(
        clock,
        before,
        euler_error_compliance=abs(float((gradient["modulus"] * problem.modulus).sum()) / C + 1),
        euler_error_stress=abs(float((slopes[2] * problem.forces).sum() / value) - 1),
        stress_norm_mpa=float(value),
    )


def _timed(clock: Stopwatch, path: Path, whole: Callable[..., Any]) -> tuple[Any, dict[str, Any]]:
    """Solution and row of a whole run, compiled before by the solver that large problems get."""
    compiling = _compiling(lambda: whole(warm_up(path), "amg"))
    clock.clear()
    before = peak_memory_gb()
    with clock.stage("total"):
        solution = whole(path)
    return solution, _row(clock, before, compiling_s=compiling, iterations=solution.iterations)


def _row(clock: Stopwatch, before: float, **more: Any) -> dict[str, Any]:
    return {
        "stages": clock.rows(),
        "peak_memory_gb": peak_memory_gb(),
        "memory_before_gb": before,
        **more,
    }


def _compiling(run: Any) -> float:
    """Seconds that a first run takes longer than a second."""
    spent = []
    for _ in range(2):
        start = time.perf_counter()
        run()
        spent.append(time.perf_counter() - start)
    return round(spent[0] - spent[1], 2)


RUNS = {
    "fea assembly": fea_assembly,
    "scikit-fem assembly": skfem_assembly,
    "scikit-fem assembly, intorder 0": partial(skfem_assembly, intorder=0),
    "scikit-fem assembly, intorder 2": partial(skfem_assembly, intorder=2),
    "fea solve": fea_solve,
    "torch-fem solve": torch_solve,
    "fea whole": fea_whole,
    "fea gradients": fea_gradients,
}


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", choices=[*RUNS, "prepare"])
    parser.add_argument("path", type=Path, help="problem; for prepare: folder to write it to")
    parser.add_argument("--rtol", type=float, default=1e-10)
    parser.add_argument("--fraction", type=float, default=0.01)
    parser.add_argument("--element", choices=["tet4", "tet10"], default="tet4")
    asked = parser.parse_args()
    if asked.run == "prepare":
        row = prepare(asked.path, asked.fraction, asked.element)
    else:
        row = RUNS[asked.run](asked.path, asked.rtol)
    print(json.dumps(row))


if __name__ == "__main__":
    main()
