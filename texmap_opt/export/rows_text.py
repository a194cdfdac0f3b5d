"""Many rows of numbers as lines of text, a column of digits at a time.

Formatting number by number takes Python half a microsecond each, minutes for ten million triangles.
Here the digits of thousands of rows are computed together, each in its place in a table of characters;
places that a number does not need hold a zero byte, and these are taken out at the end.
"""

import re
from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Int, Num, UInt8

from texmap_opt.errors import OutputError

# Rows turned into text at once: their table of characters, some hundred bytes a row, fits the cache.
ROWS_PER_CHUNK = 8192
CONVERSION = re.compile(r"%(?:d|\.(\d+)g)")
# Significant digits that the product of a float64 with a power of ten still has, and one to spare.
MAX_DIGITS = 14
# Exponents of ten beyond which %g writes them.
FEWEST_ZEROS, ZEROS = -4, 3
# Powers of ten from the smallest to the largest float64, each the float64 nearest to it.
LOWEST_POWER = -330
POWERS = np.array([float(f"1e{min(k, 308)}") for k in range(LOWEST_POWER, 331)])

ABSENT, ZERO_CHARACTER = 0, ord("0")

Characters = UInt8[np.ndarray, " rows"]


def rows_text(pattern: str, *columns: Num[np.ndarray, "rows ..."]) -> Iterator[str]:
    """One line a row, many rows at a time: the pattern filled in with the row's numbers.

    Args:
        pattern: text with the conversions `%d` of whole numbers and `%.Ng` of others, N from 2 to 14, in
            ASCII. They write what Python's do, but for the last digit of numbers that lie half way between
            two texts, within rounding.
        columns: numbers for the conversions in their order; arrays of two axes have several.

    Raises:
        OutputError: for a number that is not finite.
    """
    literals, digits = _parsed(pattern)
    for start in range(0, len(columns[0]), ROWS_PER_CHUNK):
        numbers = [
            part[:, k]
            for column in columns
            for part in [column[start : start + ROWS_PER_CHUNK].reshape(-1, _width(column))]
            for k in range(part.shape[1])
        ]
        if len(numbers) != len(digits):
            raise ValueError(f"{len(numbers)} columns of numbers for {pattern!r}.")
        places: list[int | Characters] = [*literals[0]]
        for values, count, literal in zip(numbers, digits, literals[1:], strict=True):
            places += _whole(values.astype(np.int64)) if count is None else _decimal(values, count)
            places += literal
        table = np.zeros((len(numbers[0]), len(places)), np.uint8)
        for k, place in enumerate(places):
            table[:, k] = place
        yield table.tobytes().translate(None, delete=bytes([ABSENT])).decode("ascii")


def _parsed(pattern: str) -> tuple[list[bytes], list[int | None]]:
    """The texts between conversions, and the digits of each of these (None: whole numbers)."""
    pieces = CONVERSION.split(pattern)
    digits = [None if word is None else int(word) for word in pieces[1::2]]
    for count in digits:
        if count is not None and not 2 <= count <= MAX_DIGITS:
            raise ValueError(
                f"{pattern!r} asks for {count} digits; 2 to {MAX_DIGITS} are possible."
            )
    return [piece.encode("ascii") for piece in pieces[::2]], digits


def _width(column: np.ndarray) -> int:
    return 1 if column.ndim == 1 else column.shape[1]


def _whole(values: Int[np.ndarray, " rows"]) -> list[int | Characters]:
    """The characters of whole numbers, right-aligned."""
    negative = values < 0
    rest = np.abs(values)
    largest = int(rest.max())
    rest = rest.astype(np.uint32) if largest < 1 << 32 else rest
    found: list[int | Characters] = []
    for place in range(len(str(largest))):
        quotient = rest // 10
        digit = (rest - quotient * 10 + ZERO_CHARACTER).astype(np.uint8)
        # The last digit is there even of zero.
        found.append(digit * (rest > 0) if place else digit)
        rest = quotient
    if negative.any():
        found.append(_where(negative, "-"))
    return found[::-1]


def _decimal(values: np.ndarray, count: int) -> list[int | Characters]:
    """The characters of decimal numbers in so many digits, as C's %g (ISO C 7.21.6.1) writes them."""
    if not np.isfinite(values).all():
        raise OutputError(
            "a number to be written is not finite (NaN or infinite); check radii and coordinates."
        )
    exponent, digits, needed = _digits(np.abs(values.astype(np.float64)), count)
    scientific = (exponent < FEWEST_ZEROS) | (exponent >= count)
    point = np.where(scientific, 0, exponent)
    first, last = int(point.min()), int(point.max())
    places: list[int | Characters] = []
    if np.signbit(values).any():
        places.append(_where(np.signbit(values), "-"))
    if first < 0:
        places += [_where(point < 0, "0"), _where(point < 0, ".")]
        places += [_where(point < -zeros, "0") for zeros in range(1, ZEROS + 1)]
    for k in range(count):
        places.append(digits[k] * (needed[k] | (k <= point)))
        if k + 1 < count and first <= k <= last:
            places.append(_where((point == k) & needed[k + 1], "."))
    if scientific.any():
        places += _exponents(exponent, scientific)
    return places


def _digits(
    size: np.ndarray, count: int
) -> tuple[np.ndarray, list[Characters], list[Bool[np.ndarray, " rows"]]]:
    """The exponent of the first digit, all digits, and whether any digit from there on is not 0."""
    size, nothing = np.where(size == 0, 1.0, size), size == 0
    exponent = np.floor(np.log10(size)).astype(np.int64)
    whole = _scaled(size, count - 1 - exponent)
    # By rounding up, or of the logarithm: one digit too many or too few.
    off = (whole >= 10**count).astype(np.int64) - (whole < 10 ** (count - 1))
    if off.any():
        exponent += off
        whole = _scaled(size, count - 1 - exponent)
    whole[nothing] = 0
    rest = whole.astype(np.uint32 if 10**count < 1 << 32 else np.int64)
    digits: list[Characters] = []
    needed: list[Bool[np.ndarray, " rows"]] = []
    any_yet = np.zeros(len(rest), bool)
    for _ in range(count):
        quotient = rest // 10
        digit = (rest - quotient * 10).astype(np.uint8)
        any_yet = any_yet | (digit > 0)
        digits.append(digit + np.uint8(ZERO_CHARACTER))
        needed.append(any_yet)
        rest = quotient
    return exponent, digits[::-1], needed[::-1]


def _scaled(size: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Numbers times powers of ten, rounded; in two steps, as one can be beyond float64."""
    half = power // 2
    return np.rint(size * POWERS[half - LOWEST_POWER] * POWERS[power - half - LOWEST_POWER])


def _exponents(exponent: np.ndarray, there: Bool[np.ndarray, " rows"]) -> list[int | Characters]:
    """The letter e, a sign, and two or three digits."""
    size = np.abs(exponent)
    hundreds, tens, ones = (
        (size // 10**k % 10 + ZERO_CHARACTER).astype(np.uint8) for k in (2, 1, 0)
    )
    sign = np.where(exponent < 0, ord("-"), ord("+")).astype(np.uint8)
    return [
        _where(there, "e"),
        sign * there,
        hundreds * (there & (size >= 100)),
        tens * there,
        ones * there,
    ]


def _where(there: Bool[np.ndarray, " rows"], character: str) -> Characters:
    return there * np.uint8(ord(character))
