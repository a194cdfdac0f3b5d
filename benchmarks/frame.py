"""Frames against PARDISO, pyamg and PyNite: seconds, memory, residual, on lattices and skins.

`python3 benchmarks/frame.py` writes benchmarks/results/frame.json and frame.md beside it. Each measurement
has a process of its own, `benchmarks/frame_runs.py`; all are repeated in turn, and each figure is the
least of its repeats. `--large` adds PARDISO on octet 24³, most of three minutes each time.
"""

import argparse
import sys
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from solid import best, installed, judged_table, machine, printed_by, targets, write

# This process stays small and imports no numerics: a child's peak memory starts from its parent's.

HERE = Path(__file__).parent
PACKAGES = ("numpy", "scipy", "jax", "pyamg", "pypardiso", "mkl", "PyNiteFEA")
OURS, MULTIGRID, PARDISO, PYAMG, PYNITE = "fea", "fea multigrid", "fea pardiso", "pyamg", "pynite"


AnyRun = TypeVar("AnyRun")


@dataclass(frozen=True)
class Run:
    """One measurement: what `frame_runs.py` is asked for.

    Attributes:
        name: one of its runs.
        problem: one of its problems.
        needs: package without which it is left out.
        large: whether it is measured on demand only, and once.
    """

    name: str
    problem: str
    needs: str = "numpy"
    large: bool = False

    def __str__(self) -> str:
        return f"{self.name} {self.problem}"


PLAN = [
    *(Run(OURS, problem) for problem in ("octet-12", "octet-16", "octet-24", "octet-34")),
    *(Run(PARDISO, problem, "pypardiso") for problem in ("octet-12", "octet-16")),
    Run(PARDISO, "octet-24", "pypardiso", large=True),
    *(Run(PYAMG, problem) for problem in ("octet-12", "octet-16", "octet-24")),
    Run(OURS, "bcc-24-slender"),
    Run(PYAMG, "bcc-24-slender"),
    *(
        Run(name, problem, needs)
        for problem in ("octet-12-skinned", "plate-40", "plate-100", "shell-40")
        for name, needs in ((MULTIGRID, "numpy"), (PARDISO, "pypardiso"))
    ),
    Run(PYNITE, "bcc-4", "PyNiteFEA"),
]


def main() -> None:
    """Measure the plan, or the part of it that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE / "results" / "frame.json")
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--large", action="store_true", help="PARDISO on octet 24³ as well")
    parser.add_argument("--only", default="", help="runs whose name or problem contains this")
    asked = parser.parse_args()
    versions = installed(PACKAGES)
    wanted = [run for run in PLAN if asked.only in str(run) and (asked.large or not run.large)]
    plan = [run for run in wanted if versions[run.needs] is not None]
    once = [run for run in plan if run.large]
    runs = [least(tries) for tries in repeated(plan, child, asked.repeats, once)]
    result = {
        "machine": machine(),
        "versions": versions,
        "repeats": asked.repeats,
        "left_out": sorted({r.needs for r in wanted if versions[r.needs] is None}),
        "runs": runs,
        "targets": targets(runs, figures),
    }
    write(asked.out, result, markdown(result))


def child(run: Run) -> dict[str, Any]:
    """What `frame_runs.py` prints, run in a process of its own; a failed solve is its message."""
    return printed_by("frame_runs.py", run.name, run.problem)


def repeated(
    plan: list[AnyRun],
    measure: Callable[[AnyRun], dict[str, Any]],
    repeats: int,
    once: Collection[AnyRun] = (),
) -> list[list[dict[str, Any]]]:
    """Tries of each run, all runs in turn; of those in `once` one."""
    tries: list[list[dict[str, Any]]] = [[] for _ in plan]
    for number in range(repeats):
        for run, rows in zip(plan, tries, strict=True):
            if number == 0 or run not in once:
                print(f"{number + 1}/{repeats} {run}", file=sys.stderr)
                rows.append(measure(run))
    return tries


def least(tries: list[dict[str, Any]]) -> dict[str, Any]:
    """The best of some tries; the first that failed, if one did."""
    failed = [row for row in tries if "failure" in row]
    return failed[0] if failed else best(tries)


def figures(runs: list[dict[str, Any]], kind: str) -> list[tuple[str, float, float]]:
    """What is judged, its value and its limit.

    Args:
        runs: rows of the result; what they lack is left out.
        kind: of seconds, "wall_s" or "cpu_s".
    """
    found: list[tuple[str, float, float]] = []
    for row in (row for row in runs if "failure" not in row):
        spent = {stage: seconds[kind] for stage, seconds in row["stages"].items()}

        def judge(what: str, value: float, limit: float, problem: str = row["problem"]) -> None:
            found.append((f"{problem}: {what}", round(value, 4), limit))

        if (row["run"], row["problem"]) == (OURS, "octet-24"):
            assembly = spent["pattern"] + spent["supports"] + spent["stiffness"]
            judge("assembly, pattern included [s]", assembly, 1.5)
            judge("first solve, set-up included [s]", spent["factor"] + spent["solve"], 6)
            judge("further solve, new radii [s]", spent["next factor"] + spent["next solve"], 2.5)
            known = spent["next stiffness"]
            judge("gradient over an assembly", spent["gradient of compliance"] / known, 2)
        if (row["run"], row["problem"]) == (OURS, "octet-34"):
            judge("checks, assembly and solve [s]", spent["total"], 25)
            judge("the same after new radii [s]", spent["next total"], 8)
            judge("memory of the first solve [GB]", row["gb_first"], 4)
            judge("memory of all [GB]", row["peak_memory_gb"], 4)
            known = spent["next stiffness"]
            judge("gradient over an assembly", spent["gradient of compliance"] / known, 2)
        if (row["run"], row["problem"]) == (OURS, "bcc-24-slender"):
            judge("checks, assembly and solve [s]", spent["total"], 8)
        if row["run"] == PYNITE:
            judge("fea over PyNite's analyze_linear", spent["fea"] / spent["analyze_linear"], 0.05)
    return found


def markdown(result: dict[str, Any]) -> str:
    """The tables for readers."""
    note = "; residual 1e-8 wanted, 1e-6 of plates and shells"
    lines = judged_table(result, note, "{:.3g}")
    lines += [
        "",
        "| run | dofs | solver | stages, wall / CPU s | GB, before / peak | residual | iterations | also |",
        "|---|---|---|---|---|---|---|---|",
    ]
    shown = {"run", "problem", "dofs", "solver", "stages", "peak_memory_gb", "memory_before_gb"}
    shown |= {"residual", "iterations"}
    for row in result["runs"]:
        if "failure" in row:
            lines.append(f"| {row['run']}, {row['problem']} | | | {row['failure']} |||||")
            continue
        stages = "; ".join(
            f"{name} {spent['wall_s']:.3g} / {spent['cpu_s']:.3g}"
            for name, spent in row["stages"].items()
        )
        also = "; ".join(f"{name} {_short(row[name])}" for name in row if name not in shown)
        lines.append(
            f"| {row['run']}, {row['problem']} | {row['dofs']:,} | {row.get('solver', '')} | {stages} | "
            f"{row['memory_before_gb']:.2f} / {row['peak_memory_gb']:.2f} | "
            f"{_short(row['residual'])} | {_short(row.get('iterations', ''))} | {also} |"
        )
    return "\n".join(lines) + "\n"


def _short(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(_short(one) for one in value)
    return f"{value:.2g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
