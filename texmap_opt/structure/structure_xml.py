"""Structures in XML files (schema: library/structure.xsd), written and read as streams.

Neither direction holds a tree: a file is as long as it needs to be, memory holds the arrays.
"""

import math
import re
from array import array
from collections.abc import Iterator, Mapping
from io import BufferedIOBase, TextIOBase
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from texmap_opt.errors import StructureError, nearest_name
from texmap_opt.structure.structure import Structure

# Joints or struts turned into text at once: three megabytes.
ROWS_PER_CHUNK = 4_000
VERSION = "1"
SECTIONS = ("round", "square")
# What XML 1.0 cannot hold, even escaped; repr() shows it instead.
FORBIDDEN = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
# What each element may contain, and its attributes: needed ones first, then those with a default.
CHILDREN = {
    "structure": ("provenance", "joints", "struts"),
    "provenance": ("entry",),
    "joints": ("joint",),
    "struts": ("strut",),
}
ATTRIBUTES: dict[str, tuple[tuple[str, ...], dict[str, str]]] = {
    "structure": (("version", "unit", "section"), {}),
    "provenance": ((), {}),
    "entry": (("key",), {}),
    "joints": (("count",), {}),
    "joint": (("id",), {"cut": "false"}),
    "struts": (("count",), {}),
    "strut": (("from", "to", "radius_from", "radius_to"), {"cell_size": "1"}),
}
CUT = {"true": True, "1": True, "false": False, "0": False}


def write_structure(
    structure: Structure, target: str | Path | TextIOBase, *, provenance: Mapping[str, str]
) -> None:
    """Write a structure; numbers are written so that reading gives back the same bits.

    Args:
        structure: what to write.
        target: a path, or an open text file (UTF-8).
        provenance: how the structure came about, such as {"cell": "octet"}.
    """
    if isinstance(target, str | Path):
        with Path(target).open("w", encoding="utf-8", newline="\n") as file:
            file.writelines(_text(structure, provenance))
    else:
        target.writelines(_text(structure, provenance))


def read_structure(source: str | Path | BufferedIOBase) -> Structure:
    """Read and check a structure.

    Raises:
        StructureError: with file and line, when the file cannot be read, is not XML, does not
            follow the schema, or breaks an invariant of `Structure`.
    """
    reader = _Reader(source)
    reader.run()
    return reader.structure()


def read_provenance(source: str | Path | BufferedIOBase) -> dict[str, str]:
    """How the structure in a file came about.

    Raises:
        StructureError: as `read_structure`.
    """
    reader = _Reader(source)
    reader.run()
    return reader.provenance


def _text(structure: Structure, provenance: Mapping[str, str]) -> Iterator[str]:
    yield '<?xml version="1.0" encoding="UTF-8"?>\n'
    yield f'<structure version="{VERSION}" unit="mm" section="{structure.section}">\n'
    yield "  <provenance>\n"
    for key, value in provenance.items():
        key, value = _clean(key), escape(_clean(value))
        yield f"    <entry key={quoteattr(key)}>{value}</entry>\n"
    yield f'  </provenance>\n  <joints count="{len(structure.joints)}">\n'
    for rows in _chunks(len(structure.joints)):
        joints, cut = structure.joints[rows].tolist(), structure.cut[rows].tolist()
        yield "".join(
            f'    <joint id="{i}"{_cut(c)}>{x!r} {y!r} {z!r}</joint>\n'
            for i, (x, y, z), c in zip(range(rows.start, rows.stop), joints, cut, strict=True)
        )
    yield f'  </joints>\n  <struts count="{len(structure.struts)}">\n'
    for rows in _chunks(len(structure.struts)):
        struts, radii = structure.struts[rows].tolist(), structure.radii[rows].tolist()
        yield "".join(
            f'    <strut from="{a}" to="{b}" radius_from="{r!r}" radius_to="{s!r}" '
            f'cell_size="{c!r}"/>\n'
            for (a, b), (r, s), c in zip(
                struts, radii, structure.cell_size[rows].tolist(), strict=True
            )
        )
    yield "  </struts>\n</structure>\n"


def _cut(cut: bool) -> str:  # noqa: FBT001  (the value itself, not a switch)
    return ' cut="true"' if cut else ""


def _clean(text: str) -> str:
    return FORBIDDEN.sub(lambda found: repr(found.group())[1:-1], text)


def _chunks(rows: int) -> Iterator[slice]:
    for start in range(0, rows, ROWS_PER_CHUNK):
        yield slice(start, min(start + ROWS_PER_CHUNK, rows))


class _Reader:
    """Listens to the parser's events and fills flat arrays."""

    def __init__(self, source: str | Path | BufferedIOBase) -> None:
        self.source = source
        named = Path(source) if isinstance(source, str | Path) else None
        self.file = named.name if named else str(getattr(source, "name", "structure file"))
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self.start
        self.parser.EndElementHandler = self.end
        self.parser.CharacterDataHandler = self.characters
        self.parser.StartDoctypeDeclHandler = self.doctype
        self.open: list[str] = []
        self.text: list[str] = []
        self.section, self.key = "", ""
        self.count = {"joints": 0, "struts": 0}
        self.seen: set[str] = set()
        self.provenance: dict[str, str] = {}
        self.number: dict[int, int] = {}
        self.coordinates, self.sizes, self.radii = array("d"), array("d"), array("d")
        self.cut, self.ends = array("b"), array("q")

    def run(self) -> None:
        try:
            if isinstance(self.source, str | Path):
                with Path(self.source).open("rb") as file:
                    self.parser.ParseFile(file)
            else:
                self.parser.ParseFile(self.source)
        except OSError as failure:
            raise StructureError(
                f"{self.source}: structure file cannot be read ({failure.strerror}); give an "
                "existing structure.xml."
            ) from failure
        except expat.ExpatError as failure:
            raise StructureError(
                f"{self.file}, line {failure.lineno}: is not XML "
                f"({expat.ErrorString(failure.code)}); write the file again."
            ) from failure

    def structure(self) -> Structure:
        structure = Structure(
            joints=np.array(self.coordinates).reshape(-1, 3),
            struts=np.array(self.ends, dtype=np.int64).reshape(-1, 2),
            radii=np.array(self.radii).reshape(-1, 2),
            cut=np.array(self.cut).astype(bool),
            cell_size=np.array(self.sizes),
            section=self.section,
        )
        try:
            structure.validate()
        except StructureError as failure:
            raise StructureError(f"{self.file}: {failure}") from failure
        return structure

    def refuse(self, message: str) -> NoReturn:
        raise StructureError(f"{self.file}, line {self.parser.CurrentLineNumber}: {message}")

    def doctype(self, *_: object) -> None:
        self.refuse("has a document type; a structure file has none, remove it.")

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        allowed = CHILDREN.get(self.open[-1], ()) if self.open else ("structure",)
        if tag not in allowed:
            self.refuse(f"<{tag}> where <{'> or <'.join(allowed) or 'nothing'}> is expected.")
        needed, optional = ATTRIBUTES[tag]
        for key in needed:
            if key not in attributes:
                self.refuse(f'<{tag}> lacks its attribute "{key}".')
        for key in attributes.keys() - needed - optional.keys():
            remedy = nearest_name(key, [*needed, *optional]) if needed else "remove it."
            self.refuse(f'attribute "{key}" of <{tag}> is unknown; {remedy}')
        self.open.append(tag)
        self.text.clear()
        getattr(self, f"start_{tag}")(optional | attributes)

    def end(self, tag: str) -> None:
        if tag == "joint":
            self.coordinates.extend(self.numbers("".join(self.text).split(), "joint", 3))
        elif tag == "entry":
            self.provenance[self.key] = "".join(self.text)
        elif tag == "structure":
            missing = [tag for tag in CHILDREN["structure"] if tag not in self.seen]
            if missing:
                self.refuse(f"<{missing[0]}> is missing.")
        elif tag in self.count:
            have = len(self.number) if tag == "joints" else len(self.sizes)
            if have != self.count[tag]:
                self.refuse(
                    f"<{tag}> announces {self.count[tag]} and holds {have}; correct the count, or "
                    "write the file again."
                )
        self.text.clear()
        self.open.pop()

    def characters(self, text: str) -> None:
        if self.open[-1] in ("joint", "entry"):
            self.text.append(text)
        elif not text.isspace():
            self.refuse(f'text "{text.strip()[:20]}" in <{self.open[-1]}>; remove it.')

    def start_structure(self, attributes: dict[str, str]) -> None:
        for key, known in (("version", (VERSION,)), ("unit", ("mm",)), ("section", SECTIONS)):
            if attributes[key] not in known:
                self.refuse(f'{key} is "{attributes[key]}"; {nearest_name(attributes[key], known)}')
        self.section = attributes["section"]

    def start_provenance(self, _: dict[str, str]) -> None:
        self.once("provenance")

    def start_joints(self, attributes: dict[str, str]) -> None:
        self.once("joints")
        self.count["joints"] = self.whole(attributes["count"], "count")

    def start_struts(self, attributes: dict[str, str]) -> None:
        self.once("struts")
        self.count["struts"] = self.whole(attributes["count"], "count")

    def start_entry(self, attributes: dict[str, str]) -> None:
        self.key = attributes["key"]
        if self.key in self.provenance:
            self.refuse(f'a second entry with key "{self.key}"; keys must differ.')

    def start_joint(self, attributes: dict[str, str]) -> None:
        joint = self.whole(attributes["id"], "id")
        if joint in self.number:
            self.refuse(f"a second joint with id {joint}; ids must differ.")
        self.number[joint] = len(self.number)
        if attributes["cut"] not in CUT:
            self.refuse(f'cut is "{attributes["cut"]}"; give true or false.')
        self.cut.append(CUT[attributes["cut"]])

    def start_strut(self, attributes: dict[str, str]) -> None:
        for key in ("from", "to"):
            joint = self.whole(attributes[key], key)
            if joint not in self.number:
                self.refuse(f"strut ends at joint {joint}, but there is no joint with that id.")
            self.ends.append(self.number[joint])
        words = [attributes[key] for key in ("radius_from", "radius_to", "cell_size")]
        first, last, size = self.numbers(words, "strut", 3)
        if min(first, last, size) <= 0:
            self.refuse(f"radii and cell size are {' '.join(words)}; they must be positive.")
        self.radii.extend((first, last))
        self.sizes.append(size)

    def once(self, tag: str) -> None:
        """Refuse a second one, and any order but that of the schema."""
        order = CHILDREN["structure"]
        expected = order[len(self.seen)] if len(self.seen) < len(order) else None
        if tag != expected:
            self.refuse(f"<{tag}> is out of place; the order is {', '.join(order)}, each once.")
        self.seen.add(tag)

    def numbers(self, words: list[str], what: str, count: int) -> list[float]:
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) != count or not all(map(math.isfinite, values)):
            self.refuse(f'{what} has "{" ".join(words)[:60]}"; it needs {count} finite numbers.')
        return values

    def whole(self, text: str, key: str) -> int:
        if not (text.isascii() and text.isdigit()):
            self.refuse(f'{key} is "{text}"; it must be a whole number, 0 or more.')
        return int(text)
