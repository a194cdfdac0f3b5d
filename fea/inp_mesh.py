"""Nodes and elements of an Abaqus or CalculiX input file (INP), with their numbers in it."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Int

from fea.errors import FeaError
from fea.result_mesh import CORNERS, ResultMesh

# Kind of cell by the elements' family and number of nodes. Of bars the name gives the order instead.
# Abaqus Analysis User's Guide 2016, part VI; CalculiX CrunchiX User's Manual 2.21, section 6.2.
SOLIDS = {4: "tetra", 10: "tetra10", 5: "pyramid", 6: "wedge", 15: "wedge15", 8: "hexahedron"}
SOLIDS |= {20: "hexahedron20", 27: "hexahedron27"}
SHEETS = {3: "triangle", 6: "triangle6", 4: "quad", 8: "quad8", 9: "quad9"}
FAMILIES = (
    (re.compile(r"(?:DC|AC|C)3D(\d+)"), SOLIDS),
    (re.compile(r"(?:CPS|CPE|CPEG|CAX|M3D|SFM3D|DS|S|STRI)(\d+)"), SHEETS),
    (re.compile(r"T3D([23])"), {2: "line", 3: "line3"}),
    (re.compile(r"B3([12])"), {1: "line", 2: "line3"}),
)

# Keywords that make or move nodes and elements in ways that are not followed.
REFUSED = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM")


@dataclass(frozen=True, eq=False)
class InpMesh:
    """A mesh whose nodes and elements are known by number.

    Attributes:
        mesh: without values.
        node_ids: number of each of its points in the file.
        element_ids: number of each of its cells in the file, block after block.
    """

    mesh: ResultMesh
    node_ids: Int[np.ndarray, " nodes"]
    element_ids: Int[np.ndarray, " cells"]


def read_inp(path: Path | str) -> InpMesh:
    """The mesh of an INP file: what *NODE and *ELEMENT define, also through *INCLUDE.

    Elements that fill nothing, such as springs and masses, are left out, and nodes of the assembly
    beside those of the part.

    Args:
        path: the file.

    Raises:
        FeaError: no file, no mesh in it, lines that are not understood, or a mesh of several parts or
            of generated or moved nodes.
    """
    path = Path(path)
    deck = _Deck(path)
    for name, options, rows in _blocks(path):
        deck.take(name, options, rows)
    return deck.mesh()


class _Deck:
    """What has been read so far."""

    def __init__(self, path: Path):
        self.path = path
        self.nodes: dict[int, tuple[float, float, float]] = {}
        self.elements: dict[str, dict[int, list[int]]] = {}
        self.left_out: set[str] = set()
        self.parts = 0
        self.in_assembly = False

    def take(self, name: str, options: dict[str, str], rows: list[str]) -> None:
        """Adds what one keyword and its lines define."""
        if name in ("ASSEMBLY", "END ASSEMBLY"):
            self.in_assembly = name == "ASSEMBLY"
        elif name == "PART":
            self.parts += 1
        elif name == "INSTANCE" and rows:
            self._refuse("an *INSTANCE that is moved")
        elif name in REFUSED or (name == "NODE" and options.get("SYSTEM", "R") != "R"):
            self._refuse(f"*{name}" if name != "NODE" else f"*NODE, SYSTEM={options['SYSTEM']}")
        elif name == "NODE" and not self.in_assembly:
            self._add_nodes(rows)
        elif name == "ELEMENT" and not self.in_assembly:
            self._add_elements(options.get("TYPE", ""), rows)
        if self.parts > 1:
            self._refuse("several parts")

    def mesh(self) -> InpMesh:
        """The mesh, its points in the order of their numbers."""
        if not self.nodes or not self.elements:
            others = f" (only {', '.join(sorted(self.left_out))})" if self.left_out else ""
            raise FeaError(
                f"{self.path.name} holds {len(self.nodes)} nodes and no elements that fill space"
                f"{others}; give the mesh that the values belong to."
            )
        ids = np.array(sorted(self.nodes), np.int64)
        points = np.array([self.nodes[i] for i in ids.tolist()])
        cells, element_ids = [], []
        for kind, elements in self.elements.items():
            corners = np.array(list(elements.values()), np.int64)
            place = np.minimum(np.searchsorted(ids, corners), len(ids) - 1)
            missing = corners[ids[place] != corners]
            if missing.size:
                raise FeaError(
                    f"{self.path.name}: elements name node {missing[0]}, which *NODE does not define; "
                    "give the whole deck."
                )
            cells.append((kind, place))
            element_ids += elements
        mesh = ResultMesh(points, tuple(cells), {}, {})
        return InpMesh(mesh, ids, np.array(element_ids, np.int64))

    def _add_nodes(self, rows: list[str]) -> None:
        for row in rows:
            number, *coordinates = [entry.strip() for entry in row.split(",")]
            try:
                x, y, z = ([float(entry or 0) for entry in coordinates] + [0.0] * 3)[:3]
                self.nodes[int(number)] = (x, y, z)
            except ValueError as failure:
                raise self._not_understood("NODE", row) from failure

    def _add_elements(self, element: str, rows: list[str]) -> None:
        kind = _kind(element)
        if kind is None:
            self.left_out.add(element or "elements without a type")
            return
        base = kind.rstrip("0123456789")
        size = int(kind.removeprefix(base) or CORNERS[base][1])
        elements, entries = self.elements.setdefault(kind, {}), []
        for row in rows:
            entries += [entry for entry in row.split(",") if entry.strip()]
            # The nodes of one element may take several lines.
            if len(entries) <= size:
                continue
            try:
                number, *corners = [int(entry) for entry in entries]
            except ValueError as failure:
                raise self._not_understood("ELEMENT", row) from failure
            if len(corners) != size:
                raise self._not_understood(f"ELEMENT, TYPE={element}", row)
            elements[number], entries = corners, []
        if entries:
            raise self._not_understood(f"ELEMENT, TYPE={element}", rows[-1])

    def _refuse(self, what: str) -> None:
        raise FeaError(
            f"{self.path.name} has {what}, which is not followed; write the mesh as one flat *NODE and "
            "*ELEMENT list, or give the results as VTU."
        )

    def _not_understood(self, keyword: str, row: str) -> FeaError:
        return FeaError(
            f'{self.path.name}: the line "{row[:60]}" under *{keyword} is not understood.'
        )


def _kind(element: str) -> str | None:
    """What meshio calls the cells of an element type such as C3D10M; None for what fills nothing."""
    for pattern, kinds in FAMILIES:
        found = pattern.match(element)
        if found:
            return kinds.get(int(found.group(1)))
    return None


def _blocks(path: Path) -> Iterator[tuple[str, dict[str, str], list[str]]]:
    """Each keyword of a deck, its options, and the lines of data under it."""
    name, options, rows = "", {}, []
    for line in _lines(path, ()):
        if not line.startswith("*"):
            rows.append(line)
            continue
        if name:
            yield name, options, rows
        head, *given = [entry.strip().upper() for entry in line[1:].split(",")]
        pairs = (entry.partition("=") for entry in given)
        name, options = head, {key.strip(): value.strip() for key, _, value in pairs}
        rows = []
    if name:
        yield name, options, rows


def _lines(path: Path, outer: tuple[Path, ...]) -> Iterator[str]:
    """Lines of a deck without comments; those of an included file in its place."""
    if path in outer:
        raise FeaError(f"{path.name} includes itself; remove the *INCLUDE.")
    if not path.is_file():
        raise FeaError(f"{path} is not a file; check the path.")
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        line = line.strip()
        if not line or line.startswith("**"):
            continue
        if line.upper().startswith("*INCLUDE"):
            yield from _lines(path.parent / line.partition("=")[2].strip(' "'), (*outer, path))
        else:
            yield line
