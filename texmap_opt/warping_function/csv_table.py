"""A table of numbers from a CSV file, and the tensors that its columns spell."""

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from texmap_opt.errors import CaseError

# Component in Voigt order xx, yy, zz, yz, xz, xy of what programs put after a tensor's name.
LABELS = {
    **{"XX": 0, "YY": 1, "ZZ": 2, "YZ": 3, "ZY": 3, "XZ": 4, "ZX": 4, "XY": 5, "YX": 5},
    **{"11": 0, "22": 1, "33": 2, "23": 3, "32": 3, "13": 4, "31": 4, "12": 5, "21": 5},
}

# "S11", "S-XX", "stress:YZ" by the labels above; "S:0", "S_5" by number, which takes a separator: S1 to
# S3 are principal stresses.
TENSOR_COLUMN = re.compile(
    r"(?P<name>.*?)(?:[ :._-]*(?P<label>[XYZ]{2}|[123]{2})|[ :._-](?P<number>\d))", re.IGNORECASE
)


@dataclass(frozen=True, eq=False)
class CsvTable:
    """Named columns of numbers.

    Attributes:
        names: of the columns that hold numbers, without quotes and units in brackets.
        values: one row a line of the file.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, "samples _"]

    def column(self, *names: str) -> Float[np.ndarray, " samples"] | None:
        """The first column of one of these names, whatever their case; None if there is none."""
        for k, name in enumerate(self.names):
            if name.lower() in names:
                return self.values[:, k]
        return None

    def field(self, name: str) -> tuple[Float[np.ndarray, "samples _"], bool] | None:
        """A scalar or tensor of this name.

        Returns:
            the column of this name; or, where several begin with it, the tensor they spell. Then
            whether its components have labels: if so they are in Voigt order xx, yy, zz, yz, xz, xy,
            otherwise in the order of their numbers. None if there is no such field.
        """
        if name in self.names:
            return self.values[:, [self.names.index(name)]], False
        columns = self._tensors().get(name)
        if columns is None:
            return None
        if all(label in LABELS for label in columns):
            places = {label: LABELS[label] for label in columns}
            kinds = sorted(set(places.values()))
            parts = [
                np.mean([self.values[:, columns[c]] for c in places if places[c] == k], axis=0)
                for k in kinds
            ]
            return np.stack(parts, axis=1), True
        return self.values[:, [columns[number] for number in sorted(columns)]], False

    def fields(self) -> dict[str, int]:
        """Number of components of all that `field` finds."""
        tensors = {name: len(columns) for name, columns in self._tensors().items()}
        return dict.fromkeys(self.names, 1) | tensors

    def _tensors(self) -> dict[str, dict[str, int]]:
        """Columns that spell a tensor, by its name and their labels or numbers."""
        tensors: dict[str, dict[str, int]] = {}
        for k, name in enumerate(self.names):
            found = TENSOR_COLUMN.fullmatch(name)
            if found and found["name"]:
                label = (found["label"] or found["number"]).upper()
                tensors.setdefault(found["name"], {})[label] = k
        return {name: columns for name, columns in tensors.items() if len(columns) > 1}


def read_csv(path: Path, where: str) -> CsvTable:
    """A table whose first line names its columns; separated by comma, semicolon or tab.

    Between semicolons a comma may stand for the decimal point. Columns of text are left out: those
    whose first entry is no number.

    Args:
        path: the file.
        where: file and section for messages.

    Raises:
        CaseError: no file, no rows, or entries that are no numbers.
    """
    if not path.is_file():
        raise CaseError(f"{where}: {path} is not a file; check the path.")
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    numbered = [(n, line) for n, line in enumerate(text.splitlines(), start=1) if line.strip()]
    if len(numbered) < 2:
        raise CaseError(
            f"{where}: {path.name} has no rows of values; give a line of names and rows of numbers."
        )
    (_, head), *rows = numbered
    separator = max(",;\t", key=head.count)
    names = [_plain(name) for name in _entries(head, separator)]
    if separator == ";":
        rows = [(n, line.replace(",", ".")) for n, line in rows]
    # Programs write the name of a part or a step beside the numbers.
    first = _entries(rows[0][1], separator)
    numeric = [k for k, entry in enumerate(first) if _is_number(entry) and k < len(names)]
    if not numeric:
        raise CaseError(
            f"{where}: {path.name} has no numbers in its second line; give a line of names and rows of "
            "numbers."
        )
    for n, line in rows:
        # A quoted entry may hold the separator; those lines are split in full.
        found = line.count(separator) + 1 if '"' not in line else len(_entries(line, separator))
        if found != len(names):
            raise CaseError(
                f"{where}: {path.name}, line {n}: has {found} entries for the {len(names)} columns "
                f"named in the first line; separate all lines by the same sign."
            )
    lines = [line for _, line in rows]
    try:
        if '"' in text:
            entries = (_entries(line, separator) for line in lines)
            values = np.array([[_number(row[k]) for k in numeric] for row in entries])
        else:
            # Ten times as fast, but a quote behind a blank is no quote to it.
            values = np.loadtxt(lines, delimiter=separator, ndmin=2, comments=None, usecols=numeric)
    except ValueError as failure:
        n, name, entry = _first_wrong(rows, separator, names, numeric)
        raise CaseError(
            f'{where}: {path.name}, line {n}: column "{name}" has "{entry}", which is not a number; '
            "give a number in every row, or leave the row out."
        ) from failure
    return CsvTable(tuple(names[k] for k in numeric), values)


def _entries(line: str, separator: str) -> list[str]:
    return next(csv.reader([line], delimiter=separator, skipinitialspace=True))


def _number(entry: str) -> float:
    if "_" in entry:  # which Python allows between digits
        raise ValueError(entry)
    return float(entry)


def _is_number(entry: str) -> bool:
    try:
        _number(entry)
    except ValueError:
        return False
    return True


def _first_wrong(
    rows: list[tuple[int, str]], separator: str, names: list[str], numeric: list[int]
) -> tuple[int, str, str]:
    """Line, column and entry of the first that is no number."""
    split = ((n, _entries(line, separator)) for n, line in rows)
    return next(
        (n, names[k], entries[k].strip())
        for n, entries in split
        for k in numeric
        if not _is_number(entries[k])
    )


def _plain(name: str) -> str:
    """A column's name without quotes, blanks, and the unit in brackets behind it."""
    return re.sub(r"\s*[(\[][^)\]]*[)\]]$", "", name.strip(' "\t')).strip()
