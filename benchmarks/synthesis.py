"""From unit cell to trimmed structure and its files, a million struts: seconds, memory, exactness.

`python3 benchmarks/synthesis.py` writes benchmarks/results/synthesis.json and synthesis.md beside it. Each
measurement has a process of its own, `benchmarks/synthesis_runs.py`; all are repeated in turn, and each
figure is the least of its repeats.
"""

import argparse
from pathlib import Path
from typing import Any

from frame import least, repeated
from solid import installed, judged_table, machine, printed_by, targets, write

# This process stays small and imports no numerics: a child's peak memory starts from its parent's.

HERE = Path(__file__).parent
PACKAGES = ("numpy", "scipy", "trimesh", "lxml", "rtree")
PLAN = (
    "synthesis",
    "weld by distance",
    "trim",
    "trimesh rays",
    "xml",
    "lxml tree",
    "npz",
    "mixed",
)
# Limits of seconds and of the process's peak memory [GB], for a million struts.
LIMITS = {
    "synthesis": (("tile and weld", "map"), 10.0, 3.0),
    "trim": (("trim",), 30.0, None),
    "xml write": (("write",), 40.0, 2.0),
    "xml read": (("read",), 40.0, 2.0),
}


def main() -> None:
    """Measure the plan, or the part of it that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE / "results" / "synthesis.json")
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--only", default="", help="runs whose name contains this")
    asked = parser.parse_args()
    plan = [run for run in PLAN if asked.only in run]
    runs = [least(tries) for tries in repeated(plan, child, asked.repeats)]
    result = {
        "machine": machine(),
        "versions": installed(PACKAGES),
        "repeats": asked.repeats,
        "left_out": [],
        "runs": runs,
        "targets": targets(runs, figures),
    }
    write(asked.out, result, markdown(result))


def child(run: str) -> dict[str, Any]:
    """What `synthesis_runs.py` prints, run in a process of its own."""
    return {"run": run} | printed_by("synthesis_runs.py", run)


def figures(runs: list[dict[str, Any]], kind: str) -> list[tuple[str, float, float]]:
    """What is judged, its value and its limit.

    Args:
        runs: rows of the result; what they lack is left out.
        kind: of seconds, "wall_s" or "cpu_s".
    """
    rows = {row["run"]: row for row in runs}
    found: list[tuple[str, float, float]] = []
    for name, (stages, seconds, memory) in LIMITS.items():
        row = rows.get(name.split()[0])
        if row is not None:
            spent = sum(row["stages"][stage][kind] for stage in stages)
            found.append((f"{name} [s]", round(spent, 3), seconds))
            if memory is not None:
                found.append((f"{name.split()[0]}: memory [GB]", row["peak_memory_gb"], memory))
    for ours, theirs in (("synthesis", "weld by distance"), ("trim", "trimesh rays")):
        if ours in rows and theirs in rows:
            a, b = (_seconds_per_strut(rows[name], kind) for name in (ours, theirs))
            found.append((f"{ours} over {theirs}, a strut", round(a / b, 4), 1.0))
    if "xml" in rows and "lxml tree" in rows:
        more = [
            rows[name]["peak_memory_gb"] - rows[name]["memory_before_gb"]
            for name in ("xml", "lxml tree")
        ]
        found.append(("memory for XML over that of lxml's tree", round(more[0] / more[1], 3), 1.0))
    return list(dict.fromkeys(found))


def _seconds_per_strut(row: dict[str, Any], kind: str) -> float:
    return sum(spent[kind] for spent in row["stages"].values()) / row["struts"]


def markdown(result: dict[str, Any]) -> str:
    """The tables for readers."""
    return "\n".join([*judged_table(result, "", "{:.3g}"), "", *markdown_rows(result)]) + "\n"


def markdown_rows(result: dict[str, Any]) -> list[str]:
    """The table of what was measured, one row a run."""
    lines = [
        "| run | struts | stages, wall / CPU s | GB, before / peak | also |",
        "|---|---|---|---|---|",
    ]
    shown = {"run", "struts", "stages", "peak_memory_gb", "memory_before_gb"}
    for row in result["runs"]:
        stages = "; ".join(
            f"{name} {spent['wall_s']:.3g} / {spent['cpu_s']:.3g}"
            for name, spent in row["stages"].items()
        )
        also = "; ".join(f"{name} {_short(row[name])}" for name in row if name not in shown)
        lines.append(
            f"| {row['run']} | {row['struts']:,} | {stages} | {row['memory_before_gb']:.2f} / "
            f"{row['peak_memory_gb']:.2f} | {also} |"
        )
    return lines


def _short(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    return f"{value:.2g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
