"""Tables of a case file read against declared keys: every error names file, key, value, limit, remedy."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass
from typing import Any, TypeVar

import numpy as np

from texmap_opt.errors import CaseError, nearest_name

Section = TypeVar("Section")


# No length, force or stress of a part comes near this; whole numbers of any length stay below.
LARGEST = 1e15
# How far from right angles typed axes may be: people give three digits. They are made exact.
ORTHOGONAL = 2e-3


@dataclass(frozen=True)
class Kind:
    """What a key accepts: `read` returns the value, or raises ValueError with the limit."""

    name: str
    read: Callable[[Any], Any]


def key(
    kind: Kind,
    doc: str,
    *,
    default: Any = MISSING,
    later: str = "",
    not_yet: tuple[Any, ...] = (),
) -> Any:
    """Declare one key of a section.

    Args:
        kind: what it accepts.
        doc: one line for docs/case.md, with the unit's meaning.
        default: value when absent; left out, the key is required.
        later: why values are refused for now; empty when none are.
        not_yet: which; empty: all but the default.
    """
    metadata = {"kind": kind, "doc": doc, "later": later, "not_yet": not_yet}
    return dataclasses.field(default=default, metadata=metadata)


def read_section(
    section: type[Section], table: Any, where: str, *, extra: frozenset[str] = frozenset()
) -> Section:
    """Build a section's dataclass from its TOML table.

    Args:
        section: dataclass whose fields were made by `key`.
        table: what the TOML file holds under the section's name.
        where: file and section for messages, such as "case.toml: [lattice]".
        extra: keys that the caller reads itself.

    Raises:
        CaseError: for a missing, unknown or impossible entry.
    """
    if not isinstance(table, Mapping):
        raise CaseError(f"{where} = {table!r}: must be a table of keys.")
    keys = {f.name: f for f in dataclasses.fields(section) if "kind" in f.metadata}  # pyright: ignore[reportArgumentType]
    for name in table:
        if name not in keys and name not in extra:
            remedy = nearest_name(name, [*keys, *extra])
            raise CaseError(f"{where} {name}: there is no such key; {remedy}")
    values = {}
    for name, declared in keys.items():
        if name in table:
            values[name] = _value(declared, table[name], f"{where} {name}")
        elif declared.default is MISSING:
            doc = declared.metadata["doc"]
            raise CaseError(f"{where} {name} is missing: {doc}")
    return section(**values)


def _value(declared: dataclasses.Field, value: Any, where: str) -> Any:
    kind: Kind = declared.metadata["kind"]
    try:
        read = kind.read(value)
    except ValueError as failure:
        raise CaseError(f"{where} = {value!r}: {failure}") from failure
    later, not_yet = declared.metadata["later"], declared.metadata["not_yet"]
    if later and (read in not_yet if not_yet else read != declared.default):
        raise CaseError(f"{where} = {value!r}: {later}")
    return read


def number(*, above: float = -math.inf, least: float = -math.inf, most: float = math.inf) -> Kind:
    """A finite number; `above` is an open limit, `least` and `most` are closed."""
    words = {"above": above, "at least": least, "at most": most}
    limits = " and ".join(f"{word} {v:g}" for word, v in words.items() if math.isfinite(v))

    def read(value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError("must be a number.")
        if not abs(value) < LARGEST:
            raise ValueError(f"must be a finite number, below {LARGEST:g} in size.")
        if value <= above or value < least or value > most:
            raise ValueError(f"must be {limits}.")
        return float(value)

    return Kind(f"number {limits}".strip(), read)


def whole(*, least: int) -> Kind:
    """A whole number of at least `least`."""

    def read(value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise ValueError("must be a whole number.")
        if value < least:
            raise ValueError(f"must be at least {least}.")
        return value

    return Kind(f"whole number, at least {least}", read)


def vector(component: Kind, *, or_two: bool = False) -> Kind:
    """Three components, such as [0, 0, -500]; or two, where those of a plane will do."""
    count = "two or three" if or_two else "three"

    def read(value: Any) -> tuple:
        if not isinstance(value, list) or len(value) not in ((2, 3) if or_two else (3,)):
            raise ValueError(f"must be {count} numbers, such as [1, 2, 3].")
        return tuple(component.read(entry) for entry in value)

    return Kind(f"{count} of: {component.name}", read)


def choice(*names: str) -> Kind:
    """One of the given words."""

    def read(value: Any) -> str:
        if value not in names:
            raise ValueError(f"is not known; {nearest_name(str(value), names)}")
        return value

    return Kind(" \\| ".join(f'"{name}"' for name in names), read)


def choices(*names: str, least: int = 1) -> Kind:
    """A list of at least `least` of the given words, each of them once."""

    def read(value: Any) -> tuple[str, ...]:
        if not isinstance(value, list) or len(value) < least:
            raise ValueError(f'must be a list, such as ["{names[0]}"].')
        for name in value:
            if name not in names:
                raise ValueError(f"{name!r} is not known; {nearest_name(str(name), names)}")
            if value.count(name) > 1:
                raise ValueError(f"names {name!r} twice; once is enough.")
        return tuple(value)

    return Kind(f"list of {choice(*names).name}", read)


def numbers(entry: Kind) -> Kind:
    """A list of one or more numbers."""

    def read(value: Any) -> tuple[float, ...]:
        if not isinstance(value, list) or not value:
            raise ValueError("must be a list of numbers, such as [1.0, 0.5].")
        return tuple(entry.read(number) for number in value)

    return Kind(f"list of: {entry.name}", read)


def number_by_name(entry: Kind) -> Kind:
    """A table of numbers under names that its user knows."""

    def read(value: Any) -> dict[str, float]:
        if not isinstance(value, Mapping) or not value:
            raise ValueError("must be a table of numbers, such as { lift = 1.0 }.")
        return {name: entry.read(number) for name, number in value.items()}

    return Kind(f"table of name = {entry.name}", read)


def directions(*names: str) -> Kind:
    """One of the given words, or three vectors at right angles, right-handed, of any length."""
    one = choice(*names)
    three = vector(vector(number()))

    def read(value: Any) -> str | tuple:
        if isinstance(value, str):
            return one.read(value)
        axes = np.array(three.read(value))
        length = np.linalg.norm(axes, axis=1, keepdims=True)
        if not np.all(length > 0):
            raise ValueError("has a vector of length zero; give three directions.")
        axes = axes / length
        # The nearest axes at exactly right angles.
        left, _, right = np.linalg.svd(axes)
        exact = left @ right
        if np.abs(axes - exact).max() > ORTHOGONAL:
            raise ValueError("must be three vectors at right angles to each other.")
        if np.linalg.det(exact) < 0:
            raise ValueError("is a left-handed system; swap two vectors or turn one round.")
        return tuple(tuple(float(x) for x in axis) for axis in exact)

    return Kind(f"{one.name} \\| three vectors", read)


def text() -> Kind:
    """Any words that are not empty."""

    def read(value: Any) -> str:
        if not isinstance(value, str) or not value.strip():
            raise ValueError("must be text that is not empty.")
        return value

    return Kind("text", read)


def table() -> Kind:
    """A table that its own reader checks."""

    def read(value: Any) -> dict:
        if not isinstance(value, Mapping):
            raise ValueError("must be a table, such as { box = [[0, 0, 0], [1, 1, 1]] }.")
        return dict(value)

    return Kind("table", read)


def yes_no() -> Kind:
    """True or false."""

    def read(value: Any) -> bool:
        if not isinstance(value, bool):
            raise ValueError("must be true or false.")
        return value

    return Kind("true \\| false", read)
