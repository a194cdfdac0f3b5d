"""Structures in XML files (schema: library/structure.xsd), written and read as streams.

Neither direction holds a tree: a file is as long as it needs to be, memory holds the arrays.
"""

import re
from array import array
from collections.abc import Iterator, Mapping
from io import BufferedIOBase, TextIOBase
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from texmap_opt.errors import StructureError, nearest_name
from texmap_opt.export.whole_file import whole_file
from texmap_opt.structure.structure import SECTIONS, WALL, Extrusion, Origin, Structure
from texmap_opt.xml_stream import XmlStream

# Joints or struts turned into text at once: three megabytes.
ROWS_PER_CHUNK = 4_000
VERSION = "1"
# What XML 1.0 cannot hold, even escaped; repr() shows it instead.
FORBIDDEN = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
# A carriage return that is not escaped is read back as a line feed.
ESCAPES = {"\r": "&#13;"}
# What the root contains, in this order, and what need not be there.
ORDER = ("provenance", "kinds", "extrusion", "joints", "struts")
OPTIONAL = ("kinds", "extrusion")
# What each element may contain, and its attributes: needed ones first, then those with a default.
CHILDREN = {
    "structure": ORDER,
    "provenance": ("entry",),
    "kinds": ("kind",),
    "joints": ("joint",),
    "struts": ("strut",),
}
ATTRIBUTES: dict[str, tuple[tuple[str, ...], dict[str, str]]] = {
    "structure": (("version", "unit", "section"), {}),
    "provenance": ((), {}),
    "entry": (("key",), {}),
    "kinds": ((), {}),
    "kind": ((), {}),
    "extrusion": (("axis", "low", "high"), {}),
    "joints": (("count",), {}),
    "joint": (("id",), {"cut": "false"}),
    "struts": (("count",), {}),
    "strut": (("from", "to", "radius_from", "radius_to"), {"cell_size": "1"}),
}
# What struts have when the file has this element, and only then.
WITH_KINDS, WITH_EXTRUSION = ("cell", "kind"), ("depth",)
REQUISITE = {"cell": "kinds", "kind": "kinds", "depth": "extrusion"}
CUT = {"true": True, "1": True, "false": False, "0": False}
# Characters a joint's three coordinates may take; more is no joint.
MAX_POSITION = 1_000


def write_structure(
    structure: Structure, target: str | Path | TextIOBase, *, provenance: Mapping[str, str]
) -> None:
    """Write a structure; numbers are written so that reading gives back the same bits.

    Args:
        structure: what to write.
        target: a path, where the file appears whole or not at all, or an open text file (UTF-8).
        provenance: how the structure came about, such as {"cell": "octet"}.

    Raises:
        OutputError: when the file cannot be written.
    """
    if isinstance(target, str | Path):
        with whole_file(Path(target)) as file:
            for text in _text(structure, provenance):
                file.write(text.encode())
    else:
        target.writelines(_text(structure, provenance))


def read_structure(source: str | Path | BufferedIOBase) -> Structure:
    """Read and check a structure.

    Raises:
        StructureError: with file and line, when the file cannot be read, is not XML, does not
            follow the schema, or breaks an invariant of `Structure`.
    """
    return read_structure_and_provenance(source)[0]


def read_provenance(source: str | Path | BufferedIOBase) -> dict[str, str]:
    """How the structure in a file came about.

    Raises:
        StructureError: as `read_structure`.
    """
    return read_structure_and_provenance(source)[1]


def read_structure_and_provenance(
    source: str | Path | BufferedIOBase,
) -> tuple[Structure, dict[str, str]]:
    """Read and check a structure, and how it came about.

    Raises:
        StructureError: as `read_structure`.
    """
    if not isinstance(source, str | Path):
        return _read(source, str(getattr(source, "name", "structure file")))
    try:
        with Path(source).open("rb") as file:
            return _read(file, Path(source).name)
    except OSError as failure:
        raise StructureError(
            f"{source}: structure file cannot be read ({failure.strerror}); give an existing "
            "structure.xml."
        ) from failure


def _read(source: BufferedIOBase, file: str) -> tuple[Structure, dict[str, str]]:
    reader = _Reader(file)
    reader.xml.read(source, start=reader.start, end=reader.end, text=reader.characters)
    return reader.structure(), reader.provenance


def _text(structure: Structure, provenance: Mapping[str, str]) -> Iterator[str]:
    origin, extrusion = structure.origin, structure.extrusion
    yield '<?xml version="1.0" encoding="UTF-8"?>\n'
    yield f'<structure version="{VERSION}" unit="mm" section="{structure.section}">\n'
    yield "  <provenance>\n"
    for key, value in provenance.items():
        yield f"    <entry key={quoteattr(_clean(key))}>{escape(_clean(value), ESCAPES)}</entry>\n"
    yield "  </provenance>\n"
    if origin is not None:
        kinds = (f"    <kind>{escape(_clean(kind), ESCAPES)}</kind>\n" for kind in origin.kinds)
        yield f"  <kinds>\n{''.join(kinds)}  </kinds>\n"
    if extrusion is not None:
        x, y, z = extrusion.axis.tolist()
        low, high = float(extrusion.low), float(extrusion.high)
        yield f'  <extrusion axis="{x!r} {y!r} {z!r}" low="{low!r}" high="{high!r}"/>\n'
    yield f'  <joints count="{len(structure.joints)}">\n'
    for rows in _chunks(len(structure.joints)):
        joints, cut = structure.joints[rows].tolist(), structure.cut[rows].tolist()
        yield "".join(
            f'    <joint id="{i}"{_cut(c)}>{x!r} {y!r} {z!r}</joint>\n'
            for i, (x, y, z), c in zip(range(rows.start, rows.stop), joints, cut, strict=True)
        )
    yield f'  </joints>\n  <struts count="{len(structure.struts)}">\n'
    # Everything between a strut's name and its end, as one pattern for all of them.
    pattern = '    <strut from="%d" to="%d" radius_from="%r" radius_to="%r" cell_size="%r"'
    pattern += ' cell="%d" kind=%s' if origin is not None else ""
    pattern += ' depth="%r"/>\n' if extrusion is not None else "/>\n"
    for rows in _chunks(len(structure.struts)):
        yield "".join(pattern % values for values in _strut_values(structure, rows))
    yield "  </struts>\n</structure>\n"


def _strut_values(structure: Structure, rows: slice) -> Iterator[tuple]:
    """The values of each strut's attributes, in the order they are written in."""
    columns: list[list] = [
        *structure.struts[rows].T.tolist(),
        *structure.radii[rows].T.tolist(),
        structure.cell_size[rows].tolist(),
    ]
    if structure.origin is not None:
        kinds = [quoteattr(_clean(kind)) for kind in structure.origin.kinds]
        columns.append(structure.origin.cell[rows].tolist())
        columns.append([kinds[kind] for kind in structure.origin.kind[rows].tolist()])
    if structure.extrusion is not None:
        columns.append(structure.extrusion.depth[rows].tolist())
    return zip(*columns, strict=True)


def _cut(cut: bool) -> str:  # noqa: FBT001  (the value itself, not a switch)
    return ' cut="true"' if cut else ""


def _clean(text: str) -> str:
    return FORBIDDEN.sub(lambda found: repr(found.group())[1:-1], text)


def _chunks(rows: int) -> Iterator[slice]:
    for start in range(0, rows, ROWS_PER_CHUNK):
        yield slice(start, min(start + ROWS_PER_CHUNK, rows))


class _Reader:
    """Listens to the parser's events and fills flat arrays."""

    def __init__(self, file: str) -> None:
        self.xml = XmlStream(file)
        self.refuse = self.xml.refuse
        self.attributes = dict(ATTRIBUTES)
        self.open: list[str] = []
        self.text: list[str] = []
        self.section, self.key = "", ""
        self.count = {"joints": 0, "struts": 0}
        self.seen: list[str] = []
        self.provenance: dict[str, str] = {}
        self.number: dict[int, int] = {}
        self.coordinates, self.sizes, self.radii = array("d"), array("d"), array("d")
        self.cut, self.ends = array("b"), array("q")
        self.kinds: dict[str, int] = {}
        self.cell, self.kind, self.depth = array("q"), array("q"), array("d")
        self.axis, self.low, self.high = [0.0, 0.0, 0.0], 0.0, 0.0

    def structure(self) -> Structure:
        origin = extrusion = None
        if "kinds" in self.seen:
            origin = Origin(_whole(self.cell), _whole(self.kind), tuple(self.kinds))
        if "extrusion" in self.seen:
            axis, depth = np.array(self.axis), np.array(self.depth)
            extrusion = Extrusion(axis, self.low, self.high, depth)
        structure = Structure(
            joints=np.array(self.coordinates).reshape(-1, 3),
            struts=_whole(self.ends).reshape(-1, 2),
            radii=np.array(self.radii).reshape(-1, 2),
            cut=np.array(self.cut).astype(bool),
            cell_size=np.array(self.sizes),
            section=self.section,
            origin=origin,
            extrusion=extrusion,
        )
        try:
            structure.validate()
        except StructureError as failure:
            raise StructureError(f"{self.xml.file}: {failure}") from failure
        return structure

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        allowed = CHILDREN.get(self.open[-1], ()) if self.open else ("structure",)
        if tag not in allowed:
            self.refuse(f"<{tag}> where <{'> or <'.join(allowed) or 'nothing'}> is expected.")
        needed, optional = self.attributes[tag]
        self.xml.demand(tag, attributes, needed)
        for key in attributes.keys() - needed - optional.keys():
            remedy = nearest_name(key, [*needed, *optional]) if needed else "remove it."
            if tag == "strut" and key in REQUISITE:
                remedy = f"it needs an element <{REQUISITE[key]}> before the joints."
            self.refuse(f'attribute "{key}" of <{tag}> is unknown; {remedy}')
        self.open.append(tag)
        self.text.clear()
        getattr(self, f"start_{tag}")(optional | attributes)

    def end(self, tag: str) -> None:
        if tag == "joint":
            words = "".join(self.text).split()
            self.coordinates.extend(self.xml.numbers(words, "joint", 3))
        elif tag == "entry":
            self.provenance[self.key] = "".join(self.text)
        elif tag == "kind":
            self.end_kind("".join(self.text))
        elif tag == "structure":
            missing = [tag for tag in ORDER if tag not in (*self.seen, *OPTIONAL)]
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
        if self.open[-1] in ("joint", "entry", "kind"):
            self.text.append(text)
            if self.open[-1] == "joint" and sum(map(len, self.text)) > MAX_POSITION:
                self.refuse("a joint holds more text than three coordinates take.")
        elif not text.isspace():
            self.refuse(f'text "{text.strip()[:20]}" in <{self.open[-1]}>; remove it.')

    def start_structure(self, attributes: dict[str, str]) -> None:
        for key, known in (("version", (VERSION,)), ("unit", ("mm",)), ("section", SECTIONS)):
            if attributes[key] not in known:
                self.refuse(f'{key} is "{attributes[key]}"; {nearest_name(attributes[key], known)}')
        self.section = attributes["section"]

    def start_provenance(self, _: dict[str, str]) -> None:
        self.once("provenance")

    def start_kinds(self, _: dict[str, str]) -> None:
        self.once("kinds")
        self.demand_of_struts(WITH_KINDS)

    def start_kind(self, _: dict[str, str]) -> None:
        """Its name is the text."""

    def end_kind(self, name: str) -> None:
        if not name or name in self.kinds:
            self.refuse(f'kind "{name}" is empty or there twice; names must differ.')
        self.kinds[name] = len(self.kinds)

    def start_extrusion(self, attributes: dict[str, str]) -> None:
        self.once("extrusion")
        self.axis = self.xml.numbers(attributes["axis"].split(), "axis", 3)
        words = [attributes["low"], attributes["high"]]
        self.low, self.high = self.xml.numbers(words, "extrusion", 2)
        self.demand_of_struts(WITH_EXTRUSION)

    def demand_of_struts(self, keys: tuple[str, ...]) -> None:
        needed, optional = self.attributes["strut"]
        self.attributes["strut"] = ((*needed, *keys), optional)

    def start_joints(self, attributes: dict[str, str]) -> None:
        self.once("joints")
        if (self.section == WALL) != ("extrusion" in self.seen):
            self.refuse(
                f'section is "{self.section}", which needs '
                f"{'an' if self.section == WALL else 'no'} <extrusion> before the joints."
            )
        self.count["joints"] = self.xml.whole(attributes["count"], "count")

    def start_struts(self, attributes: dict[str, str]) -> None:
        self.once("struts")
        self.count["struts"] = self.xml.whole(attributes["count"], "count")

    def start_entry(self, attributes: dict[str, str]) -> None:
        self.key = attributes["key"]
        if self.key in self.provenance:
            self.refuse(f'a second entry with key "{self.key}"; keys must differ.')

    def start_joint(self, attributes: dict[str, str]) -> None:
        joint = self.xml.whole(attributes["id"], "id")
        if joint in self.number:
            self.refuse(f"a second joint with id {joint}; ids must differ.")
        self.number[joint] = len(self.number)
        if attributes["cut"] not in CUT:
            self.refuse(f'cut is "{attributes["cut"]}"; give true or false.')
        self.cut.append(CUT[attributes["cut"]])

    def start_strut(self, attributes: dict[str, str]) -> None:
        for key in ("from", "to"):
            joint = self.xml.whole(attributes[key], key)
            if joint not in self.number:
                self.refuse(f"strut ends at joint {joint}, but there is no joint with that id.")
            self.ends.append(self.number[joint])
        words = [attributes[key] for key in ("radius_from", "radius_to", "cell_size")]
        first, last, size = self.xml.numbers(words, "strut", 3)
        if min(first, last, size) <= 0:
            self.refuse(f"radii and cell size are {' '.join(words)}; they must be positive.")
        self.radii.extend((first, last))
        self.sizes.append(size)
        if "kind" in attributes:
            if attributes["kind"] not in self.kinds:
                self.refuse(
                    f'kind is "{attributes["kind"]}"; {nearest_name(attributes["kind"], self.kinds)}'
                )
            self.cell.append(self.xml.whole(attributes["cell"], "cell"))
            self.kind.append(self.kinds[attributes["kind"]])
        if "depth" in attributes:
            self.depth.append(self.xml.positive(attributes["depth"], "depth"))

    def once(self, tag: str) -> None:
        """Refuse a second one, and any order but that of the schema."""
        last = ORDER.index(self.seen[-1]) if self.seen else -1
        place = ORDER.index(tag)
        if place <= last or any(other not in OPTIONAL for other in ORDER[last + 1 : place]):
            self.refuse(f"<{tag}> is out of place; the order is {', '.join(ORDER)}, each once.")
        self.seen.append(tag)


def _whole(numbers: array) -> np.ndarray:
    return np.array(numbers, dtype=np.int64)
