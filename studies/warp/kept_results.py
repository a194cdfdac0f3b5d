"""Results of a study that are kept from run to run, and the Markdown table made of them."""

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax

HERE = Path(__file__).parent
IMAGES = HERE.parents[1] / "docs" / "images"

# Smaller numbers are zero and rounding.
ROUNDING = 1e-12

Row = dict[str, Any]


class KeptResults:
    """Rows of numbers by name, written after each one, so that a study can be stopped and resumed.

    Attributes:
        path: results/NAME.json.
        rows: what is known.
    """

    def __init__(self, name: str, *, again: bool):
        self.path = HERE / "results" / f"{name}.json"
        self.rows: dict[str, Row] = {}
        if self.path.exists() and not again:
            self.rows = json.loads(self.path.read_text(encoding="utf-8"))

    def row(self, key: str, measure: Callable[[], Row]) -> Row:
        """The row of that name: an earlier run's, or measured now."""
        if key not in self.rows:
            self.rows[key] = measure()
            self.path.parent.mkdir(exist_ok=True)
            half_written = self.path.with_suffix(".part")
            lines = [f"{json.dumps(name)}: {json.dumps(row)}" for name, row in self.rows.items()]
            half_written.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
            half_written.replace(self.path)
            print(key, self.rows[key], flush=True)
        return self.rows[key]

    def write_table(self, table: str) -> None:
        """Writes results/NAME.md."""
        self.path.with_suffix(".md").write_text(table + "\n", encoding="utf-8")
        print(table)


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
    """A table; floats with three significant digits, None as a dash."""
    lines = [head, ["---"] * len(head)]
    lines += [[_cell(value) for value in row] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cell(value: object) -> str:
    if value is None:
        return "–"
    if not isinstance(value, float):
        return str(value)
    return "0" if abs(value) < ROUNDING else f"{value:.3g}"
