"""Results of a study that are kept from run to run, and the Markdown table made of them."""

import argparse
import hashlib
import json
import os
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax

HERE = Path(__file__).parent
PACKAGES = ("numpy", "scipy", "jax", "optimistix")
IMAGES = HERE.parents[1] / "docs" / "images"

# What tables of warped grids end with, and the keys of their rows.
ENDING = {
    "smallest B/s³": "min_jacobian",
    "slope of size": "slope",
    "worst edge ratio": "aspect",
    "steps": "steps",
    "gain of another": "gain",
    "converged": "converged",
}

# Smaller numbers are zero and rounding.
ROUNDING = 1e-12

Row = dict[str, Any]


class KeptResults:
    """Rows of numbers by name, written after each one, so that a study can be stopped and resumed.

    Rows of another code are kept, and said to be: the study may take hours, and most changes do not
    touch it.

    Attributes:
        path: results/NAME.json.
        rows: what is known.
        made_by: code, versions and cores by which.
    """

    def __init__(self, name: str, *, again: bool):
        self.path = HERE / "results" / f"{name}.json"
        self.rows: dict[str, Row] = {}
        self.made_by = made_by()
        if self.path.exists() and not again:
            kept = json.loads(self.path.read_text(encoding="utf-8"))
            self.rows = kept["rows"]
            if kept["made_by"] != self.made_by:
                print(
                    f"{self.path.name}: made by {kept['made_by']}, not by {self.made_by}; "
                    "--again measures anew.",
                    file=sys.stderr,
                )
                self.made_by = kept["made_by"]

    def row(self, key: str, measure: Callable[[], Row]) -> Row:
        """The row of that name: an earlier run's, or measured now."""
        if key not in self.rows:
            self.rows[key] = measure()
            self.path.parent.mkdir(exist_ok=True)
            half_written = self.path.with_suffix(".part")
            lines = [f"{json.dumps(name)}: {json.dumps(row)}" for name, row in self.rows.items()]
            head = f'{{"made_by": {json.dumps(self.made_by)},\n"rows": {{\n'
            half_written.write_text(head + ",\n".join(lines) + "\n}}\n", encoding="utf-8")
            half_written.replace(self.path)
            print(key, self.rows[key], flush=True)
        return self.rows[key]

    def write_table(self, table: str) -> None:
        """Writes results/NAME.md."""
        text = f"{table}\n\nMade by {self.made_by}.\n"
        self.path.with_suffix(".md").write_text(text, encoding="utf-8")
        print(text)


def made_by() -> str:
    """Hash of the sources that the numbers hang on, versions, and number of cores."""
    package = HERE.parents[1] / "texmap_opt"
    sources = [HERE, package / "warp", package / "warping_function"]
    code = hashlib.sha256()
    for source in sorted(path for folder in sources for path in folder.glob("*.py")):
        code.update(source.read_bytes())
    versions = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    return f"sources {code.hexdigest()[:8]}, {versions}, {os.cpu_count()} cores"


def started(
    name: str, said: str | None, **options: dict[str, Any]
) -> tuple[KeptResults, argparse.Namespace]:
    """What every study begins with: its command line read, JAX in double precision.

    Args:
        name: of the results.
        said: the study's docstring, whose first line `--help` shows.
        options: of the command besides `--again`, as `argparse` takes them.
    """
    parser = argparse.ArgumentParser(description=said and said.splitlines()[0])
    for option, wishes in options.items():
        parser.add_argument(f"--{option}", **wishes)
    parser.add_argument("--again", action="store_true", help="do not keep earlier results")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    return KeptResults(name, again=given.again), given


def markdown(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table; floats with three significant digits, None as a dash, yes and no."""
    lines = [head, ["---"] * len(head)]
    lines += [[_cell(value) for value in row] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cell(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, float):
        return str(value)
    return "0" if abs(value) < ROUNDING else f"{value:.3g}"
