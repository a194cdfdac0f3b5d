"""LTCX lattices of nTopology: a graph of nodes and beams in XML.

Schema and specification: github.com/nTopology/LTCX, `Spec.md` and `schemas/NTLG_001.xsd`,
`NTLG_002.xsd` (MIT licence, archived 2024). A node may have a radius (`r`; older files and the
published reader say `rad`), linear along a beam; beams have none of their own. Faces (`facegroup`)
are plates and are left out with a note.
"""

from array import array
from pathlib import Path

import numpy as np

from texmap_opt.errors import StructureError, nearest_name
from texmap_opt.imports.imported import Bars, Imported, imported
from texmap_opt.units import MM_PER_FOOT, MM_PER_UNIT
from texmap_opt.xml_stream import XmlStream

# The units of the specification.
UNITS = MM_PER_UNIT | {"ft": MM_PER_FOOT}
CHILDREN = {
    "graph": ("nodegroup", "beamgroup", "facegroup"),
    "nodegroup": ("node",),
    "beamgroup": ("beam",),
    "facegroup": ("face",),
}


def read_ltcx(path: Path, *, radius: float | None, section: str) -> Imported:
    """Read the graph of a file.

    Args:
        path: the file.
        radius: of nodes that have none [mm]; None: they must all have one, and only then may they.
        section: shape of the struts, which the file does not tell.

    Raises:
        StructureError: with file and line, for what is no such graph.
    """
    path = Path(path)
    reader = _Reader(path, radius)
    try:
        with path.open("rb") as file:
            reader.xml.read(file, start=reader.start, end=reader.end, text=reader.characters)
    except OSError as failure:
        raise StructureError(
            f"{path}: cannot be read ({failure.strerror}); give an LTCX file."
        ) from failure
    if radius is not None and not reader.without_radius:
        raise StructureError(f"{path.name}: every node has a radius; leave --radius out.")
    struts = np.array(reader.ends, np.int64).reshape(-1, 2)
    notes = (f"{reader.faces} faces are plates, not struts, and were left out",)
    bars = Bars(
        joints=np.array(reader.coordinates).reshape(-1, 3),
        struts=struts,
        radii=np.array(reader.radii)[struts],
        section=section,
        notes=notes if reader.faces else (),
    )
    return imported(path, bars, mm_per_unit=reader.mm_per_unit)


class _Reader:
    """Listens to the parser's events and fills flat arrays."""

    def __init__(self, path: Path, radius: float | None) -> None:
        self.xml = XmlStream(path.name)
        self.refuse = self.xml.refuse
        self.radius = radius
        self.mm_per_unit = 1.0
        self.open: list[str] = []
        self.number: dict[str, int] = {}
        self.coordinates, self.radii, self.ends = array("d"), array("d"), array("q")
        self.faces = self.without_radius = 0

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        allowed = CHILDREN.get(self.open[-1], ()) if self.open else ("graph",)
        if tag not in allowed:
            self.refuse(f"<{tag}> where <{'> or <'.join(allowed) or 'nothing'}> is expected.")
        self.open.append(tag)
        if tag == "graph":
            unit = attributes.get("units", "mm")
            if unit not in UNITS:
                self.refuse(f'units is "{unit}"; {nearest_name(unit, UNITS)}')
            self.mm_per_unit = UNITS[unit]
        elif tag == "node":
            self.node(attributes)
        elif tag == "beam":
            self.beam(attributes)
        elif tag == "face":
            self.faces += 1

    def end(self, _: str) -> None:
        self.open.pop()

    def characters(self, text: str) -> None:
        if not text.isspace():
            self.refuse(f'text "{text.strip()[:20]}" in <{self.open[-1]}>; remove it.')

    def node(self, attributes: dict[str, str]) -> None:
        self.xml.demand("node", attributes, ("id", "x", "y", "z"))
        name = attributes["id"]
        if name in self.number:
            self.refuse(f'a second node with id "{name}"; ids must differ.')
        self.number[name] = len(self.number)
        words = [attributes[key] for key in "xyz"]
        self.coordinates.extend(self.xml.numbers(words, "node", 3))
        word = attributes.get("r", attributes.get("rad"))
        if word is not None:
            self.radii.append(self.xml.positive(word, "r"))
        elif self.radius is not None:
            # The file's unit until the end; it is known by now, as an attribute of the root.
            self.radii.append(self.radius / self.mm_per_unit)
            self.without_radius += 1
        else:
            self.refuse(f'node "{name}" has no radius; give one for all such nodes with --radius.')

    def beam(self, attributes: dict[str, str]) -> None:
        self.xml.demand("beam", attributes, ("n1", "n2"))
        for key in ("n1", "n2"):
            name = attributes[key]
            if name not in self.number:
                self.refuse(f'beam ends at node "{name}", but there is no node with that id.')
            self.ends.append(self.number[name])
