"""Many rows of numbers as lines of text, at the speed of one format operation for thousands."""

from collections.abc import Iterator

import numpy as np

# Rows turned into text at once: some ten megabytes.
ROWS_PER_CHUNK = 50_000


def rows_text(pattern: str, *columns: np.ndarray) -> Iterator[str]:
    """One line a row, many rows at a time: the pattern filled in with the row's numbers."""
    count = len(columns[0])
    for start in range(0, count, ROWS_PER_CHUNK):
        parts = [
            column[start : start + ROWS_PER_CHUNK].reshape(-1, _width(column)) for column in columns
        ]
        rows = len(parts[0])
        # Interleaved as Python numbers: whole ones must stay whole for %d.
        lists = [part.tolist() for part in parts]
        flat = [x for row in zip(*lists, strict=True) for part in row for x in part]
        yield (pattern * rows) % tuple(flat)


def _width(column: np.ndarray) -> int:
    return 1 if column.ndim == 1 else column.shape[1]
