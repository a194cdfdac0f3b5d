"""Lattices and skins as solids: seconds, memory, exactness.

`python3 benchmarks/geometry.py` writes benchmarks/results/geometry.json and geometry.md beside it. Each
measurement has a process of its own, `benchmarks/geometry_runs.py`; each figure is the least of its repeats,
except that the unions by manifold3d, of eight minutes each, run once.
"""

import argparse
from pathlib import Path
from typing import Any

from frame import least, repeated
from solid import installed, judged_table, machine, printed_by, targets, write
from synthesis import markdown_rows

# This process stays small and imports no numerics: a child's peak memory starts from its parent's.

HERE = Path(__file__).parent
PACKAGES = ("numpy", "scipy", "manifold3d", "libigl")
UNIONS = ("union of uniform struts", "union of different struts")
PLAN = (
    "uniform",
    "different",
    "filleted",
    "million uniform",
    "million different",
    "offset",
    "combine",
    *UNIONS,
)


def main() -> None:
    """Measure the plan, or the part of it that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE / "results" / "geometry.json")
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--only", default="", help="runs whose name contains this")
    parser.add_argument(
        "--parts",
        type=Path,
        default=HERE.parent.parent / "shared" / "parts",
        help="folder with beethoven.ply; runs that need it are left out without",
    )
    asked = parser.parse_args()
    here = (asked.parts / "beethoven.ply").is_file()
    wanted = [run for run in PLAN if asked.only in run]
    plan = [run for run in wanted if here or run != "offset"]
    tries = repeated(
        plan,
        lambda run: {"run": run} | printed_by("geometry_runs.py", run, str(asked.parts)),
        asked.repeats,
        once=UNIONS,
    )
    runs = [least(each) for each in tries]
    result = {
        "machine": machine(),
        "versions": installed(PACKAGES),
        "repeats": asked.repeats,
        "left_out": [run for run in wanted if run not in plan],
        "runs": runs,
        "targets": targets(runs, figures),
    }
    write(asked.out, result, markdown(result))


def figures(runs: list[dict[str, Any]], kind: str) -> list[tuple[str, float, float]]:
    """What is judged, its value and its limit.

    Args:
        runs: rows of the result; what they lack is left out.
        kind: of seconds, "wall_s" or "cpu_s".
    """
    rows = {row["run"]: row for row in runs}
    found: list[tuple[str, float, float]] = []

    def seconds(run: str) -> float:
        return sum(spent[kind] for spent in rows[run]["stages"].values())

    for ours, share in (("uniform", 1 / 60), ("different", 1 / 20)):
        theirs = f"union of {ours} struts"
        if ours in rows and theirs in rows:
            ratio = round(seconds(ours) / seconds(theirs), 4)
            found.append((f"{ours}: direct mesh over union", ratio, round(share, 4)))
    for run in ("million uniform", "million different"):
        if run in rows:
            found.append((f"{run}: to a written STL [s]", round(seconds(run), 1), 150.0))
            found.append((f"{run}: memory [GB]", rows[run]["peak_memory_gb"], 12.0))
    for run, limit in (("offset", 20.0), ("combine", 15.0)):
        if run in rows:
            found.append((f"{run} [s]", round(seconds(run), 2), limit))
    return found


def markdown(result: dict[str, Any]) -> str:
    """The tables for readers."""
    return "\n".join([*judged_table(result, "", "{:.3g}"), "", *markdown_rows(result)]) + "\n"


if __name__ == "__main__":
    main()
