"""Solids against scikit-fem and torch-fem on the same mesh: seconds, memory, residual.

`python3 benchmarks/solid.py` writes benchmarks/results/solid.json and solid.md beside it. Meshes of a box,
100 x 20 x 20 mm, are made by pytetwild and kept in --folder, since two runs of it differ. Each
measurement has a process of its own, `benchmarks/solid_runs.py`; all of them are repeated in turn, and each
figure is the least of its repeats, so that other programs on the machine disturb little.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

# This process stays small and imports no numerics: a child's peak memory starts from its parent's.

HERE = Path(__file__).parent
PACKAGES = (
    "numpy", "scipy", "jax", "pyamg", "pypardiso", "mkl", "pytetwild", "scikit-fem", "torch",
    "torch-fem",
)  # fmt: skip

# Meshes by target edge as a share of the box's diagonal: 212k dofs, 1.4 million dofs, and tet10 of about as
# many dofs as the first.
TET4, LARGE, TET10 = (0.01, "tet4"), (0.0052, "tet4"), (0.02, "tet10")


@dataclass(frozen=True)
class Run:
    """One measurement: what `solid_runs.py` is asked for.

    Attributes:
        name: one of its runs.
        problem: edge as a share of the diagonal, element.
        rtol: wanted |f - K u| / |f|, where it solves.
        needs: package without which it is left out.
    """

    name: str
    problem: tuple[float, str]
    rtol: float | None = None
    needs: str = "numpy"


PLAN = [
    Run("fea assembly", TET4),
    Run("scikit-fem assembly, intorder 0", TET4, needs="scikit-fem"),
    Run("scikit-fem assembly", TET4, needs="scikit-fem"),
    Run("fea assembly", TET10),
    Run("scikit-fem assembly, intorder 2", TET10, needs="scikit-fem"),
    Run("fea solve", TET4, 1e-8),
    Run("torch-fem solve", TET4, 1e-8, needs="torch-fem"),
    Run("fea solve", TET4, 1e-10),
    Run("torch-fem solve", TET4, 1e-10, needs="torch-fem"),
    Run("fea gradients", TET4, 1e-10),
    Run("fea gradients", TET10, 1e-10),
    Run("fea whole", LARGE, 1e-10),
]


def main() -> None:
    """Measure the plan, or the part of it that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=HERE / "meshes", help="keeps the meshes")
    parser.add_argument("--out", type=Path, default=HERE / "results" / "solid.json")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--only", default="", help="runs whose name contains this")
    asked = parser.parse_args()
    versions = installed()
    plan = [run for run in PLAN if asked.only in run.name and versions[run.needs] is not None]
    asked.folder.mkdir(parents=True, exist_ok=True)
    problems = {problem: prepared(asked.folder, problem) for problem in {r.problem for r in plan}}
    tries: dict[Run, list[dict[str, Any]]] = {run: [] for run in plan}
    for number in range(asked.repeats):
        for run in plan:
            print(f"{number + 1}/{asked.repeats} {run.name} {run.problem[1]}", file=sys.stderr)
            path = asked.folder / problems[run.problem]["problem"]
            rtol = [] if run.rtol is None else ["--rtol", str(run.rtol)]
            tries[run].append(child(run.name, path, *rtol))
    runs = [
        {
            "run": run.name,
            "element": run.problem[1],
            "dofs": problems[run.problem]["dofs"],
            "rtol": run.rtol,
            **best(tries[run]),
        }
        for run in plan
    ]
    result = {
        "machine": machine(),
        "versions": versions,
        "repeats": asked.repeats,
        "left_out": sorted({r.needs for r in PLAN if versions[r.needs] is None}),
        "problems": sorted(problems.values(), key=lambda row: row["dofs"]),
        "runs": runs,
        "targets": targets(runs, figures),
    }
    write(asked.out, result, markdown(result))


def write(out: Path, result: dict[str, Any], text: str) -> None:
    """A result as JSON, and its tables beside it and on the screen."""
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(result, indent=1) + "\n")
    out.with_suffix(".md").write_text(text)
    print(text)


def installed(packages: tuple[str, ...] = PACKAGES) -> dict[str, str | None]:
    """Versions of what takes part; None for what is not installed."""
    found: dict[str, str | None] = {"python": platform.python_version()}
    for package in packages:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = None
    return found


def machine() -> dict[str, Any]:
    """Processor, cores that this process may use, and memory."""
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        names = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        cpu = names[0].split(":")[1].strip() if names else cpu
    usable = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count()
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {"cpu": cpu, "cores": usable, "memory_gb": round(memory / 1e9, 1)}


def prepared(folder: Path, problem: tuple[float, str]) -> dict[str, Any]:
    """Mesh and problem files in a folder, and their sizes."""
    fraction, element = problem
    print(f"mesh {element} {fraction:g}", file=sys.stderr)
    return child("prepare", folder, "--fraction", str(fraction), "--element", element)


def child(name: str, path: Path, *options: str) -> dict[str, Any]:
    """What `solid_runs.py` prints, run in a process of its own."""
    return printed_by("solid_runs.py", name, str(path), *options)


def printed_by(script: str, *options: str) -> dict[str, Any]:
    """The last line that a script of this folder prints in a process of its own, which is JSON."""
    command = [sys.executable, str(HERE / script), *options]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def best(tries: list[dict[str, Any]]) -> dict[str, Any]:
    """Least seconds of each stage, most memory, and the rest as in the last try."""
    rows = dict(tries[-1])
    rows["stages"] = {
        stage: {
            kind: min(one["stages"][stage][kind] for one in tries) for kind in ("wall_s", "cpu_s")
        }
        for stage in rows["stages"]
    }
    rows["peak_memory_gb"] = max(one["peak_memory_gb"] for one in tries)
    return rows


def targets(
    runs: list[dict[str, Any]],
    figures: Callable[[list[dict[str, Any]], str], list[tuple[str, float, float]]],
) -> list[dict[str, Any]]:
    """Figures to reach and those reached, by wall seconds; the same by CPU seconds for comparison.

    Args:
        runs: rows of the result.
        figures: what is judged, its value and its limit, of the rows and "wall_s" or "cpu_s".
    """
    wall, cpu = figures(runs, "wall_s"), figures(runs, "cpu_s")
    return [
        {"what": what, "value": value, "limit": limit, "met": value <= limit, "by_cpu": by_cpu}
        for (what, value, limit), (_, by_cpu, _) in zip(wall, cpu, strict=True)
    ]


def figures(runs: list[dict[str, Any]], kind: str) -> list[tuple[str, float, float]]:
    """What is judged, its value and its limit; ratios are of the same command.

    Args:
        runs: rows of the result; what they lack is left out.
        kind: of seconds, "wall_s" or "cpu_s".
    """
    rows = {(row["run"], row["element"], row["rtol"]): row["stages"] for row in runs}
    found: list[tuple[str, float, float]] = []

    def seconds(run: tuple[str, str, float | None], *stages: str) -> float | None:
        return sum(rows[run][stage][kind] for stage in stages) if run in rows else None

    def judge(what: str, value: float | None, limit: float, over: float | None = 1.0) -> None:
        if value is not None and over is not None:
            found.append((what, round(value / over, 3), limit))

    ours = ("fea assembly", "tet4", None)
    judge("tet4 stiffness and assembly, pattern included [s]", seconds(ours, "first"), 1.5)
    for element, order in (("tet4", 0), ("tet10", 2)):
        ours = ("fea assembly", element, None)
        theirs = (f"scikit-fem assembly, intorder {order}", element, None)
        for stage in ("first", "again"):
            what = f"{element} assembly ({stage}) over {theirs[0]}"
            judge(what, seconds(ours, stage), 0.25, seconds(theirs, stage))
    solve = ("fea solve", "tet4", 1e-8)
    judge("tet4 solve to 1e-8, set-up included [s]", seconds(solve, "factor", "solve"), 5)
    for rtol in (1e-8, 1e-10):
        what = f"tet4 assembly and solve to {rtol:g} over torch-fem"
        theirs = ("torch-fem solve", "tet4", rtol)
        judge(what, seconds(("fea solve", "tet4", rtol), "total"), 0.5, seconds(theirs, "total"))
    for element in ("tet4", "tet10"):
        run = ("fea gradients", element, 1e-10)
        for what, stage, over in (
            ("compliance over one assembly", "gradient of compliance", "stiffness, pattern known"),
            ("stress norm over one more solve", "gradient of stress norm", "factor and solve"),
        ):
            judge(f"{element} gradient of {what}", seconds(run, stage), 1, seconds(run, over))
    return found + [figure for row in runs for figure in _whole(row, kind)]


def _whole(row: dict[str, Any], kind: str) -> list[tuple[str, float, float]]:
    if row["run"] != "fea whole":
        return []
    what = f"{row['dofs']:,} dofs from mesh to stress"
    return [
        (f"{what} [s]", row["stages"]["total"][kind], 45),
        (f"{what} [GB]", row["peak_memory_gb"], 6),
    ]


def judged_table(result: dict[str, Any], note: str, number: str) -> list[str]:
    """Lines with the machine, the versions, and every figure against its limit.

    Args:
        result: of a benchmark with targets.
        note: ends the first line.
        number: how numbers are written, such as "{:g}".
    """
    about, versions = result["machine"], result["versions"]
    lines = [
        f"{about['cpu']}, {about['cores']} cores, {about['memory_gb']:g} GB; "
        + ", ".join(f"{name} {version or 'not installed'}" for name, version in versions.items())
        + f". Least of {result['repeats']} repeats{note}.",
        "",
        "| figure | value | limit | | by CPU seconds |",
        "|---|---|---|---|---|",
    ]
    for row in result["targets"]:
        met = "met" if row["met"] else "**missed**"
        value, limit, by_cpu = (
            row[key] if isinstance(row[key], str) else number.format(row[key])
            for key in ("value", "limit", "by_cpu")
        )
        lines.append(f"| {row['what']} | {value} | {limit} | {met} | {by_cpu} |")
    return lines


def markdown(result: dict[str, Any]) -> str:
    """The tables for readers."""
    lines = judged_table(result, "", "{:g}")
    lines += [
        "",
        "| run | dofs | rtol | stages, wall / CPU s | GB, before / peak | residual | iterations | also |",
        "|---|---|---|---|---|---|---|---|",
    ]
    shown = {"run", "element", "dofs", "rtol", "stages", "peak_memory_gb", "memory_before_gb"}
    shown |= {"residual", "iterations"}
    for row in result["runs"]:
        stages = "; ".join(
            f"{name} {spent['wall_s']:.2f} / {spent['cpu_s']:.2f}"
            for name, spent in row["stages"].items()
        )
        also = "; ".join(f"{name} {_short(row[name])}" for name in row if name not in shown)
        lines.append(
            f"| {row['run']}, {row['element']} | {row['dofs']:,} | {_short(row['rtol'])} | {stages} | "
            f"{row['memory_before_gb']:.2f} / {row['peak_memory_gb']:.2f} | "
            f"{_short(row.get('residual'))} | {_short(row.get('iterations'))} | {also} |"
        )
    return "\n".join(lines) + "\n"


def _short(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, list):
        return ", ".join(_short(one) for one in value)
    return f"{value:.3g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
