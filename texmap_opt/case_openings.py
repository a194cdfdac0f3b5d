"""Openings and drain holes of a skin: the tables of a case file, and the same on the command line."""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from texmap_opt.case_table import key, number, table, vector
from texmap_opt.errors import CaseError, InputError
from texmap_opt.region import AbstractRegion
from texmap_opt.region_table import region_from_table


@dataclass(frozen=True)
class OpeningSection:
    """`[[opening]]`: a region of the part's surface that gets no skin, so that the lattice shows."""

    region: dict = key(
        table(),
        "what of the surface: see Regions; the skin stays within `skin_mm` of the rest of the surface, so "
        "that walls beside the opening keep their thickness and its mouth is that much smaller all round",
    )


@dataclass(frozen=True)
class DrainSection:
    """`[[drain]]`: a round hole through the skin, for powder or resin to come out."""

    point: tuple[float, float, float] = key(
        vector(number()), "the hole is at the point of the surface nearest to this"
    )
    diameter_mm: float = key(number(above=0.0), "of the hole")
    direction: tuple[float, float, float] | None = key(
        vector(number()),
        "along which it goes into the part (absent: straight into the surface)",
        default=None,
    )


@dataclass(frozen=True, eq=False)
class Opening:
    """A region of a part's surface without skin.

    Attributes:
        where: for messages, such as "case.toml: [[opening]] 1".
        region: what of the surface.
    """

    where: str
    region: AbstractRegion


@dataclass(frozen=True, eq=False)
class Drain:
    """A round hole through a skin.

    Attributes:
        where: for messages, such as "case.toml: [[drain]] 1".
        point: at the point of the surface nearest to this [mm].
        diameter_mm: of the hole [mm].
        direction: unit vector into the part; None: against the surface's normal.
    """

    where: str
    point: Float[np.ndarray, " 3"]
    diameter_mm: float
    direction: Float[np.ndarray, " 3"] | None


def openings(sections: list[OpeningSection], file: str, base: Path) -> tuple[Opening, ...]:
    """The openings of a case.

    Args:
        sections: the tables `[[opening]]`.
        file: name of the case file, for messages.
        base: folder that relative paths start at.

    Raises:
        CaseError: for an impossible region.
    """
    places = [f"{file}: [[opening]] {i}" for i in range(1, len(sections) + 1)]
    return tuple(
        Opening(where, region_from_table(section.region, f"{where} region", base))
        for where, section in zip(places, sections, strict=True)
    )


def drains(sections: list[DrainSection], file: str) -> tuple[Drain, ...]:
    """The drain holes of a case, from the tables `[[drain]]`.

    Raises:
        CaseError: for a direction of no length.
    """
    places = [f"{file}: [[drain]] {i}" for i in range(1, len(sections) + 1)]
    return tuple(
        Drain(
            where,
            np.array(section.point),
            section.diameter_mm,
            _unit(section.direction, f"{where} direction"),
        )
        for where, section in zip(places, sections, strict=True)
    )


def require_skin(entries: Sequence[Opening | Drain], skin_mm: float) -> None:
    """Refuse openings and drain holes of a part without a skin.

    Raises:
        InputError: naming the first.
    """
    for entry in entries:
        if skin_mm == 0:
            raise InputError(
                f"{entry.where}: there is no skin to open, since skin_mm = 0; give a skin_mm above 0 or "
                "leave this out."
            )


def opening_from_text(text: str) -> Opening:
    """An opening as typed after `--opening`: the entries of a region's table.

    Args:
        text: such as "box = [[0, 0, 0], [9, 9, 1]]"; paths start at the working folder.

    Raises:
        InputError: it is no such text.
        CaseError: for an impossible region.
    """
    where = f"--opening '{text}'"
    try:
        region = tomllib.loads(text)
    except tomllib.TOMLDecodeError as failure:
        raise InputError(
            f"{where}: is not the entry of a region's table, such as 'box = [[0, 0, 0], [9, 9, 1]]' "
            f"({failure})."
        ) from failure
    return Opening(where, region_from_table(region, "--opening", Path()))


def drain_from_text(text: str) -> Drain:
    """A drain hole as typed after `--drain`: x,y,z,diameter and, where wanted, a direction dx,dy,dz.

    Raises:
        InputError: it is not four or seven numbers, or one of them is impossible.
    """
    where = f"--drain {text}"
    try:
        numbers = [number().read(float(entry)) for entry in text.split(",")]
    except ValueError as failure:
        raise InputError(f"{where}: must be numbers with commas between ({failure}).") from failure
    if len(numbers) not in (4, 7):
        raise InputError(
            f"{where}: has {len(numbers)} numbers, not the four of x,y,z,diameter or the seven of "
            "x,y,z,diameter,dx,dy,dz."
        )
    if not numbers[3] > 0:
        raise InputError(f"{where}: the diameter {numbers[3]:g} must be above 0 [mm].")
    direction = tuple(numbers[4:]) or None
    return Drain(where, np.array(numbers[:3]), numbers[3], _unit(direction, f"{where} direction"))


def _unit(direction: tuple[float, ...] | None, where: str) -> Float[np.ndarray, " 3"] | None:
    if direction is None:
        return None
    length = float(np.linalg.norm(direction))
    if length == 0:
        raise CaseError(f"{where}: has no length; give a vector that is not zero.")
    return np.array(direction) / length
