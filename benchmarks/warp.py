"""The warp's speed and memory: seconds from cold, steps and objective reached, peers beside it.

`python3 benchmarks/warp.py` writes benchmarks/results/warp.json and warp.md beside it. Each measurement has a
process of its own, `benchmarks/warp_runs.py`, in which nothing is compiled yet; all are repeated in turn,
and each figure is the least of its repeats. `--only fit --cells 8 12` measures a part, on small grids.
"""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from frame import least, repeated
from solid import installed, judged_table, machine, printed_by, write

# This process stays small and imports no numerics: a child's peak memory starts from its parent's.

HERE = Path(__file__).parent
PACKAGES = ("numpy", "scipy", "jax", "jaxlib", "equinox", "optimistix", "lineax")

# Seconds of f and fit together by cells along an edge, and GB of the largest.
FIT_SECONDS = {16: 6.0, 32: 20.0, 64: 150.0}
FIT_GB = {64: 8.0}
CERTIFICATE_SECONDS = 0.5
# Of a sweep over NumPy's: at least twice as fast.
SWEEP_RATIO = 0.5
# What a figure is worth: nodes of the two sweeps, in cells, and the derivative against a difference.
SWEEP_DIFFERENCE, GRADIENT_DIFFERENCE = 1e-9, 1e-4


@dataclass(frozen=True)
class Run:
    """One measurement: what `warp_runs.py` is asked for.

    Attributes:
        name: one of its runs.
        subject: one of its fields, or its grid "waves".
        cells: along each edge of the unit cube.
    """

    name: str
    subject: str
    cells: int

    def __str__(self) -> str:
        return f"{self.name} {self.subject} {self.cells}³"


PLAN = [
    *(Run("fit", subject, n) for n in FIT_SECONDS for subject in ("ball", "bending")),
    *(Run("peer", subject, 16) for subject in ("ball", "bending")),
    Run("certificate", "waves", 64),
    Run("sweeps", "ball", 64),
    Run("inverse", "waves", 64),
    Run("gradient", "lopsided", 12),
]


def main() -> None:
    """Measure the plan, or the part of it that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE / "results" / "warp.json")
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--only", default="", help="runs whose name and field contain this")
    parser.add_argument("--cells", type=int, nargs="+", help="along an edge, instead of the plan's")
    asked = parser.parse_args()
    wanted = [run for run in PLAN if asked.only in str(run)]
    if asked.cells is not None:
        wanted = [replace(run, cells=n) for run in wanted for n in asked.cells]
    plan = list(dict.fromkeys(wanted))
    runs = [least(tries) for tries in repeated(plan, child, asked.repeats)]
    result = {
        "machine": machine(),
        "versions": installed(PACKAGES),
        "repeats": asked.repeats,
        "runs": runs,
        "targets": targets(runs),
        "ratios": ratios(runs),
    }
    write(asked.out, result, markdown(result))


def child(run: Run) -> dict[str, Any]:
    """What `warp_runs.py` prints, run in a process of its own; a failed warp is its message."""
    row = printed_by("warp_runs.py", run.name, run.subject, str(run.cells))
    if run.name == "fit" and "failure" not in row:
        # Of one process: the least of each stage may be of two.
        stages = row["stages"]
        stages["total"] = {
            kind: round(stages["f"][kind] + stages["fit"][kind], 3) for kind in ("wall_s", "cpu_s")
        }
    return row


def targets(runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Figures to reach and those reached, by wall seconds; the same by CPU seconds for comparison.

    A figure of a run that failed, stopped short of its tolerance, or whose numbers differ from the
    peer's is not met, however fast it was.
    """
    found = []
    for row in runs:
        if "failure" in row:
            found.append(
                {"what": _named(row), "value": "failed", "limit": "", "met": False, "by_cpu": ""}
            )
            continue
        sound = row.get("converged", True) and row.get("folded_cells", 0) == 0
        if row["run"] == "sweeps":
            sound &= row["difference"] < SWEEP_DIFFERENCE
        wall, cpu = figures(row, "wall_s"), figures(row, "cpu_s")
        found += [
            {
                "what": f"{row['subject']}, {row['cells']}³: {what}{'' if sound else ' (not done)'}",
                "value": value,
                "limit": limit,
                "met": sound and value <= limit,
                "by_cpu": by_cpu,
            }
            for (what, value, limit), (_, by_cpu, _) in zip(wall, cpu, strict=True)
        ]
    return found


def figures(row: dict[str, Any], kind: str) -> list[tuple[str, float, float]]:
    """What is judged of one measurement, its value and its limit.

    Args:
        row: of the result.
        kind: of seconds, "wall_s" or "cpu_s".
    """
    spent, cells = {stage: seconds[kind] for stage, seconds in row["stages"].items()}, row["cells"]
    found: list[tuple[str, float, float]] = []
    if row["run"] == "fit" and cells in FIT_SECONDS:
        found.append(("f and fit, compilation included [s]", spent["total"], FIT_SECONDS[cells]))
        if cells in FIT_GB:
            found.append(("memory of f and fit [GB]", row["peak_memory_gb"], FIT_GB[cells]))
    if row["run"] == "certificate" and cells == 64:
        seconds = spent["coefficients"] + spent["folded"]
        what = f"certificate of {row['cells_certified']:,} cells [s]"
        found.append((what, round(seconds, 3), CERTIFICATE_SECONDS))
    if row["run"] == "gradient":
        what = "derivative through the minimiser against a central difference, relative"
        found.append((what, row["difference"], GRADIENT_DIFFERENCE))
    if row["run"] == "sweeps" and cells == 64:
        for weights in ("printed", "midpoint"):
            ratio = spent[weights] / spent[f"{weights}, NumPy"]
            found.append((f"sweep over NumPy's, {weights}", round(ratio, 3), SWEEP_RATIO))
    return found


# Stages whose seconds are divided, by run: what they say, numerator, denominator.
RATIOS = {
    "peer": (
        ("SciPy's L-BFGS-B over our fit, both from cold", "peer", "fit"),
        ("the same, both compiled before", "peer, compiled", "fit, compiled"),
    ),
    "sweeps": (
        ("NumPy's sweep over ours, printed", "printed, NumPy", "printed"),
        ("NumPy's sweep over ours, midpoint", "midpoint, NumPy", "midpoint"),
    ),
    "gradient": (
        ("gradient through the minimiser over the fit, both from cold", "gradient", "fit"),
        ("the same, both compiled before", "gradient, compiled", "fit, compiled"),
    ),
}


def ratios(runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Ratios of seconds in one process; a peer that gave up is marked: it would need longer."""
    found = []
    for row in (row for row in runs if "failure" not in row):
        short = "" if row.get("peer_reached", True) else ", which gave up"
        for what, numerator, denominator in RATIOS.get(row["run"], ()):
            above, below = row["stages"][numerator], row["stages"][denominator]
            by_wall, by_cpu = (
                round(above[kind] / below[kind], 3) if below[kind] > 0 else None
                for kind in ("wall_s", "cpu_s")
            )
            name = f"{row['subject']}, {row['cells']}³: {what}{short}"
            found.append({"what": name, "value": by_wall, "by_cpu": by_cpu})
    return found


def markdown(result: dict[str, Any]) -> str:
    """The tables for readers."""
    lines = judged_table(result, "", "{:.3g}")
    if result["ratios"]:
        lines += ["", "| ratio of seconds | value | by CPU seconds |", "|---|---|---|"]
    lines += [
        f"| {row['what']} | {_short(row['value'])} | {_short(row['by_cpu'])} |"
        for row in result["ratios"]
    ]
    lines += [
        "",
        "| run | unknowns | stages, wall / CPU s | GB, before / peak | steps | objective | "
        "gain / tolerance | size slope | correlation | smallest B/s³ | also |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [_line(row) for row in result["runs"]]
    return "\n".join(lines) + "\n"


def _named(row: dict[str, Any]) -> str:
    return f"{row['run']}, {row['subject']}, {row['cells']}³"


def _line(row: dict[str, Any]) -> str:
    name = _named(row)
    if "failure" in row:
        return f"| {name} | | {row['failure']} |||||||||"
    columns = ("steps", "objective", "size_slope", "size_correlation", "min_jacobian")
    shown = {"run", "subject", "cells", "unknowns", "stages", "peak_memory_gb", "memory_before_gb"}
    shown |= {"gain", "tolerance", *columns}
    stages = "; ".join(
        f"{stage} {spent['wall_s']:.3g} / {spent['cpu_s']:.3g}"
        for stage, spent in row["stages"].items()
    )
    steps, objective, slope, correlation, smallest = (_short(row.get(key, "")) for key in columns)
    gain = f"{row['gain']:.1e} / {row['tolerance']:.0e}" if "gain" in row else ""
    also = "; ".join(f"{key} {_short(row[key])}" for key in row if key not in shown)
    return (
        f"| {name} | {row['unknowns']:,} | {stages} | "
        f"{row['memory_before_gb']:.2f} / {row['peak_memory_gb']:.2f} | {steps} | {objective} | "
        f"{gain} | {slope} | {correlation} | {smallest} | {also} |"
    )


def _short(value: Any) -> str:
    if value is None:
        return "not measurable"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
