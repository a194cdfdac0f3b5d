"""Beams of an Abaqus or CalculiX input deck (INP), with the sections their sets have.

Read are flat decks, or one part that its instance does not move: *NODE, *ELEMENT of beam types,
*ELSET, *BEAM SECTION and *BEAM GENERAL SECTION with SECTION=CIRC or RECT (Abaqus Keywords Guide;
CalculiX CrunchiX User's Manual 2.20). Everything else in a deck is passed over.
"""

import re
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np
from jaxtyping import Int

from texmap_opt.errors import StructureError
from texmap_opt.imports.beam_sections import BeamSection, sized
from texmap_opt.imports.imported import Bars, Imported, imported

# Beam elements in space by name; the digit is the order of their displacement.
BEAM = re.compile(r"B3([123])H?R?(?:OS)?H?")
# Keywords that make or move nodes and elements in ways that are not followed.
REFUSED = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM", "INCLUDE")
SECTION_KEYWORDS = ("BEAM SECTION", "BEAM GENERAL SECTION")
MAX_DIGITS = 18
# Distance of a bent beam's middle from the chord over its length above which it is not straight.
STRAIGHT = 1e-4


def read_beam_deck(path: Path, *, mm_per_unit: float) -> Imported:
    """Read the beams of a deck.

    Args:
        path: the file.
        mm_per_unit: millimetres in the deck's unit of length, which it does not tell.

    Raises:
        StructureError: with file and line, for what is not understood, for beams without a section,
            and for sections that are not all round, all square, or walls of one direction.
    """
    path = Path(path)
    deck = _Deck(path.name)
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            for number, text in enumerate(file, 1):
                deck.line_number = number
                deck.take(text.strip())
            deck.end_row()
    except OSError as failure:
        raise StructureError(
            f"{path}: cannot be read ({failure.strerror}); give an INP file."
        ) from failure
    # Numbers too large to be multiplied become infinite, which a structure refuses.
    with np.errstate(over="ignore", invalid="ignore"):
        return imported(path, deck.bars(mm_per_unit), mm_per_unit=mm_per_unit)


@dataclass(eq=False)
class _Set:
    """Numbers of elements, ranges of them, and names of other sets."""

    numbers: array = field(default_factory=lambda: array("q"))
    ranges: list[tuple[int, int, int]] = field(default_factory=list)
    others: list[str] = field(default_factory=list)


class _Deck:
    """What has been read so far."""

    def __init__(self, file: str) -> None:
        self.file, self.line_number = file, 0
        self.keyword, self.options, self.row = "", dict[str, str](), 0
        # A keyword's line, or an element's row, that goes on in the next line, and where it began.
        self.begun, self.unfinished, self.began = "", list[str](), 0
        self.direction_may_follow = False
        self.nodes: dict[int, int] = {}
        self.coordinates = array("d")
        self.elements: dict[int, int] = {}
        self.ends, self.middles = array("q"), array("q")
        self.sets: dict[str, _Set] = {}
        self.sections: list[BeamSection] = []
        self.left_out = 0
        self.parts = 0
        self.in_assembly = False

    def refuse(self, message: str) -> NoReturn:
        raise StructureError(f"{self.file}, line {self.line_number}: {message}")

    def take(self, text: str) -> None:
        """One line."""
        if not text or text.startswith("**"):
            return
        if self.begun and text.startswith("*"):
            # The comma was the last of its keyword, not a promise of more.
            begun, self.begun = self.begun, ""
            self.take(begun.rstrip(" ,"))
        text, self.begun = self.begun + text, ""
        if text.startswith("*"):
            self.end_row()
            if text.endswith(","):
                self.begun = text
                return
            head, *given = [entry.strip() for entry in text[1:].upper().split(",")]
            pairs = (entry.partition("=") for entry in given)
            self.keyword, self.row = " ".join(head.split()), 0
            self.options = {key.strip(): value.strip().strip('"') for key, _, value in pairs}
            self.begin()
        else:
            self.data_row(text)

    def data_row(self, text: str) -> None:
        """A line of the keyword before it."""
        self.row += 1
        entries = [entry.strip() for entry in text.split(",")]
        if self.keyword == "INSTANCE":
            self.refuse("an instance that is moved is not followed; write one flat deck.")
        if self.in_assembly:
            return
        if self.keyword == "NODE":
            self.node(entries)
        elif self.keyword == "ELEMENT":
            self.element_row(entries)
        elif self.keyword == "ELSET":
            self.add_to_set(entries)
        elif self.keyword in SECTION_KEYWORDS:
            self.section_row(entries)

    def begin(self) -> None:
        """A keyword."""
        options = self.options
        if self.keyword in REFUSED:
            self.refuse(f"*{self.keyword} is not followed; write one flat deck.")
        if self.keyword in ("ASSEMBLY", "END ASSEMBLY"):
            self.in_assembly = self.keyword == "ASSEMBLY"
        elif self.keyword == "PART":
            self.parts += 1
            if self.parts > 1:
                self.refuse("a second part is not followed; write one flat deck.")
        elif self.keyword == "NODE" and options.get("SYSTEM", "R") != "R":
            self.refuse(
                "*NODE in other than rectangular coordinates is not followed; "
                "write rectangular ones."
            )
        elif self.keyword == "ELEMENT" and "ELSET" in options:
            self.sets.setdefault(options["ELSET"], _Set())
        elif self.keyword == "ELSET":
            self.sets.setdefault(self.required("ELSET"), _Set())
        elif self.keyword in SECTION_KEYWORDS:
            elset, shape = self.required("ELSET"), self.required("SECTION")
            self.sections.append(BeamSection(elset, shape, self.line_number))

    def required(self, key: str) -> str:
        if not self.options.get(key):
            self.refuse(f"*{self.keyword} lacks {key}=...; add it.")
        return self.options[key]

    def node(self, entries: list[str]) -> None:
        number = self.whole(entries[0])
        if number in self.nodes:
            self.refuse(f"a second node {number}; numbers must differ.")
        self.nodes[number] = len(self.nodes)
        self.coordinates.extend([*self.floats(entries[1:4]), 0.0, 0.0, 0.0][:3])

    def element_row(self, entries: list[str]) -> None:
        """A row; one that ends with a comma is continued, unless the beam is complete without."""
        if self.direction_may_follow and len(list(filter(None, entries))) == 1:
            # No element has one entry: it is the node that tells the section's direction.
            self.whole(entries[0])
            self.direction_may_follow = False
            return
        if not self.unfinished:
            self.began = self.line_number
        entries = self.unfinished[:-1] + entries
        found = BEAM.fullmatch(self.options.get("TYPE", ""))
        # Its number, two or three nodes, and the nothing behind the last comma.
        needed = 4 if found is not None and found[1] == "2" else 3
        complete = found is not None and len(entries) > needed
        self.direction_may_follow = complete and not entries[-1] and len(entries) == needed + 1
        self.unfinished = entries if entries[0] and not entries[-1] and not complete else []
        if not self.unfinished:
            self.element(entries)

    def end_row(self) -> None:
        """No row continues the one before."""
        self.direction_may_follow = False
        if self.unfinished:
            entries, self.unfinished = self.unfinished, []
            here, self.line_number = self.line_number, self.began
            self.element(entries)
            self.line_number = here

    def element(self, entries: list[str]) -> None:
        found = BEAM.fullmatch(self.options.get("TYPE", ""))
        if found is None:
            self.left_out += 1
            return
        given = entries[0], *filter(None, entries[1:])
        number, *nodes = [self.whole(entry) for entry in given]
        size = 3 if found[1] == "2" else 2
        # One more node may tell the direction of the section's first axis.
        if len(nodes) not in (size, size + 1):
            self.refuse(
                f"a {self.options['TYPE']} has {size} nodes, not {len(nodes)}; "
                "a row goes on in the next when it ends with a comma."
            )
        if number in self.elements:
            self.refuse(f"a second beam {number}; numbers must differ.")
        missing = [node for node in nodes[:size] if node not in self.nodes]
        if missing:
            self.refuse(
                f"beam {number} ends at node {missing[0]}, which no *NODE before it defines."
            )
        self.elements[number] = len(self.elements)
        first, *middle, last = [self.nodes[node] for node in nodes[:size]]
        self.ends.extend((first, last))
        self.middles.append(middle[0] if middle else -1)
        if "ELSET" in self.options:
            self.sets[self.options["ELSET"]].numbers.append(number)

    def add_to_set(self, entries: list[str]) -> None:
        members = self.sets[self.options["ELSET"]]
        entries = [entry for entry in entries if entry]
        if "GENERATE" in self.options:
            if len(entries) not in (2, 3):
                self.refuse("a range of a set is its first and last number, and a step.")
            first, last, step = [*(self.whole(entry) for entry in entries), 1][:3]
            members.ranges.append((first, last, max(step, 1)))
            return
        for entry in entries:
            if entry.isdigit():
                members.numbers.append(self.whole(entry))
            else:
                members.others.append(entry.upper().strip('"'))

    def section_row(self, entries: list[str]) -> None:
        section = self.sections[-1]
        if self.row == 1:
            section.sizes = self.floats([entry for entry in entries if entry])
        elif self.row == 2 and any(entries):
            section.normal = [*self.floats([entry or "0" for entry in entries[:3]]), 0.0, 0.0][:3]

    def whole(self, text: str) -> int:
        if not (text.isascii() and text.isdigit() and len(text) <= MAX_DIGITS):
            self.refuse(f'"{text[:40]}" under *{self.keyword} must be a whole number, 0 or more.')
        return int(text)

    def floats(self, words: list[str]) -> list[float]:
        try:
            values = [float(word or 0) for word in words]
        except ValueError:
            values = [np.nan]
        if not np.isfinite(values).all():
            self.refuse(f'"{", ".join(words)[:60]}" under *{self.keyword} must be finite numbers.')
        return values

    def bars(self, mm_per_unit: float) -> Bars:
        """All beams with their sections; the unit is for notes."""
        if not self.elements:
            raise StructureError(
                f"{self.file}: holds no beams (B31, B32, B33) among {self.left_out} elements; give a "
                "deck of beams."
            )
        joints = np.array(self.coordinates).reshape(-1, 3)
        numbers = np.array(list(self.elements), np.int64)
        order = np.argsort(numbers)
        struts = np.array(self.ends, np.int64).reshape(-1, 2)[order]
        middles = np.array(self.middles, np.int64)[order]
        _check_straight(f"{self.file}: beam {{}}", numbers[order], (joints, struts, middles))
        of_beam = self.section_of(numbers[order])
        sizes = sized(self.file, self.sections, of_beam, (joints, struts), mm_per_unit=mm_per_unit)
        notes = list(sizes.notes)
        if self.left_out:
            notes.append(f"{self.left_out} elements that are no beams in space were left out")
        radii = np.repeat(sizes.radius[:, None], 2, axis=1)
        return Bars(joints, struts, radii, sizes.section, sizes.extrusion, tuple(notes))

    def section_of(self, numbers: Int[np.ndarray, " beams"]) -> Int[np.ndarray, " beams"]:
        """The section of each beam, by their sorted numbers."""
        of_beam = np.full(len(numbers), -1)
        for index, section in enumerate(self.sections):
            self.line_number = section.line
            members = self.members(numbers, section.elset)
            if (of_beam[members] >= 0).any():
                self.refuse(
                    f"some beams of set {section.elset} have a section already; give each one."
                )
            of_beam[members] = index
        if (of_beam < 0).any():
            raise StructureError(
                f"{self.file}: beam {numbers[np.argmin(of_beam)]} has no *BEAM SECTION with CIRC or "
                "RECT; give one."
            )
        return of_beam

    def members(self, numbers: Int[np.ndarray, " beams"], name: str) -> Int[np.ndarray, " members"]:
        """Places, among the sorted numbers of beams, of those of a set, each once."""
        found = [np.zeros(0, np.int64)]
        for members in self.nested(name):
            wanted = np.array(members.numbers, np.int64)
            place = np.minimum(np.searchsorted(numbers, wanted), len(numbers) - 1)
            found.append(place[numbers[place] == wanted])
            for first, last, step in members.ranges:
                low, high = np.searchsorted(numbers, [first, last + 1])
                found.append(low + np.flatnonzero((numbers[low:high] - first) % step == 0))
        return np.unique(np.concatenate(found))

    def nested(self, name: str) -> Iterator[_Set]:
        """A set and all that it names, each once."""
        waiting, seen = [name], set()
        while waiting:
            one = waiting.pop()
            if one in seen:
                continue
            seen.add(one)
            if one not in self.sets:
                self.refuse(f"set {one}, which a section needs, is not defined; add an *ELSET.")
            yield self.sets[one]
            waiting += self.sets[one].others


def _check_straight(
    beam: str,
    numbers: Int[np.ndarray, " beams"],
    geometry: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """Refuse beams whose middle node is not half way between their ends.

    Args:
        beam: what the message calls one, with a place for its number.
        numbers: of the beams.
        geometry: joints, the two ends of each beam, and its middle; -1: it has none.
    """
    joints, struts, middles = geometry
    bent = np.flatnonzero(middles >= 0)
    first, last = joints[struts[bent]].swapaxes(0, 1)
    off = np.linalg.norm(joints[middles[bent]] - (first + last) / 2, axis=1)
    curved = off > STRAIGHT * np.linalg.norm(last - first, axis=1)
    if curved.any():
        raise StructureError(
            beam.format(numbers[bent[np.argmax(curved)]])
            + " is curved, or its middle node is not half way; divide it into straight beams."
        )
