"""Numbers as text: what Python's own formatting writes, at the speed of whole columns."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt.errors import OutputError
from texmap_opt.export.rows_text import MAX_DIGITS, ROWS_PER_CHUNK, rows_text

# Where the length of the text changes: zeros of both signs, rounding up to another digit, the ends of
# positional notation (1e-4 and ten to the digits), of three-digit exponents and of float64.
CORNERS = [
    0.0, -0.0, 1.0, 10.0, 0.5, -0.5, 123.25, 99999.99999999999, 9999999995.0, 999999999.5, 1e8, 1e9, 1e14,
    1e-4, 9.99999999999e-5, 1e-5, -1e-5, 1e-99, 1e-100, 1e99, 1e100, 5e-324, 1.7e308, -1e-310,
]  # fmt: skip


def text(pattern: str, *columns: np.ndarray) -> str:
    return "".join(rows_text(pattern, *columns))


@pytest.mark.parametrize("digits", [2, 9, 13, MAX_DIGITS])
def test_corners_are_written_as_python_writes_them(digits: int):
    values = np.array(CORNERS)
    assert text(f"%.{digits}g\n", values) == "".join(f"%.{digits}g\n" % v for v in CORNERS)
    # Alone, each takes the places that only it needs.
    for value in CORNERS:
        assert text(f"[%.{digits}g]", np.array([value])) == f"[%.{digits}g]" % value


@settings(max_examples=200)
@given(
    values=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=30),
    digits=st.integers(2, MAX_DIGITS),
)
def test_texts_are_pythons_up_to_ties(values: list[float], digits: int):
    """The product with a power of ten is rounded twice, each time by 2^-53 of itself at most."""
    found = text(f"%.{digits}g\n", np.array(values)).split()
    for value, ours in zip(values, found, strict=True):
        python = f"%.{digits}g" % value
        if ours != python:
            # The value is half way between the two, but for rounding: in units of the last digit.
            unit = abs(float(ours) - float(python))
            middle = float(ours) / 2 + float(python) / 2
            assert abs(value - middle) <= 10**digits * 2**-51 * unit
            assert len(ours.lstrip("-")) <= digits + 6


@settings(max_examples=200)
@given(bits=st.lists(st.integers(0, 2**32 - 1), min_size=1, max_size=30))
def test_nine_digits_hold_every_float32_bit_for_bit(bits: list[int]):
    values = np.array(bits, np.uint32).view(np.float32)
    values = values[np.isfinite(values)]
    if len(values):
        back = [struct.pack("<f", float(word)) for word in text("%.9g\n", values).split()]
        assert back == [struct.pack("<f", value) for value in values]


@settings(max_examples=100)
@given(values=st.lists(st.integers(-(2**62), 2**62), min_size=1, max_size=20))
def test_whole_numbers_are_written_in_full(values: list[int]):
    assert text("%d,", np.array(values)) == "".join(f"{v}," for v in values)


def test_columns_interleave_and_chunks_join():
    rng = np.random.default_rng(2)
    rows = 2 * ROWS_PER_CHUNK + 3
    number, place = np.arange(rows), rng.integers(-40, 40, (rows, 2)) / 8
    lines = text("n%d (%.5g; %.5g)\n", number, place).splitlines()
    assert len(lines) == rows
    wanted = [f"n{n} ({x:.5g}; {y:.5g})" for n, (x, y) in zip(number, place.tolist(), strict=True)]
    assert lines == wanted
    assert text("%d\n", np.arange(0)) == ""


def test_what_cannot_be_written_is_refused():
    with pytest.raises(OutputError, match="not finite"):
        text("%.9g", np.array([1.0, np.nan]))
    with pytest.raises(ValueError, match="2 columns of numbers for"):
        text("%d", np.zeros((3, 2)))
    with pytest.raises(ValueError, match="asks for 17 digits"):
        text("%.17g", np.zeros(3))
