"""Unit cells from XML files (schema: library/unit_cell.xsd); reading one checks it."""

import re
from dataclasses import fields
from fractions import Fraction
from pathlib import Path
from typing import NoReturn

import numpy as np
import scipy.sparse.csgraph
from jaxtyping import Bool, Float
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  (compiled)

from texmap_opt.cells.joint_model import JointModel
from texmap_opt.cells.unit_cell import CLASSIFICATIONS, SECTIONS, TICKS, TILINGS, UnitCell
from texmap_opt.errors import CellError, nearest_name
from texmap_opt.structure.tile import tile

# A decimal or a fraction, not negative, as in the schema; Python's numbers allow more (1e3, nan).
COORDINATE = re.compile(r"[0-9]+(\.[0-9]+)?|[0-9]+/[1-9][0-9]*")
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._\-]*")
# Enough to see a net fall apart: a cell meets its neighbours on all sides, and both parities of a
# mirrored tiling occur along each axis.
BLOCK = (2, 2, 2)
AXES = "xyz"


def read_unit_cell(path: Path) -> UnitCell:
    """Read and check one unit-cell file.

    Raises:
        CellError: with file and line, when the file cannot be read, is not XML, does not follow the
            schema, or describes no lattice: a joint outside the unit cube, two joints at one place,
            a joint without struts, a strut of no length or given twice, opposite faces that do not
            match, a net that falls apart when it is tiled.
    """
    return _Reader(path.name).cell(_root(path))


def read_aliases(path: Path) -> tuple[str, ...]:
    """Other names of the cell in a file, whatever else is in it.

    Raises:
        CellError: when the file cannot be read, is not XML, or a name has impossible letters.
    """
    return _Reader(path.name).aliases(_root(path))


def _root(path: Path) -> etree._Element:
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, remove_comments=True, remove_pis=True
    )
    try:
        return etree.parse(str(path), parser).getroot()
    except etree.XMLSyntaxError as failure:
        raise CellError(
            f"{path.name}, line {failure.lineno}: is not XML ({failure.msg})."
        ) from failure
    except OSError as failure:
        raise CellError(
            f"{path}: unit-cell file cannot be read; give an existing file or a library name."
        ) from failure


class _Reader:
    """Turns elements into a cell; knows the file's name for messages."""

    def __init__(self, file: str) -> None:
        self.file = file

    def refuse(self, element: etree._Element, message: str) -> NoReturn:
        raise CellError(f"{self.file}, line {element.sourceline}: {message}")

    def cell(self, root: etree._Element) -> UnitCell:
        self.expect_tag(root, "unit_cell")
        self.expect_attributes(root, {"name", "section", "tiling", "classification"}, {"aliases"})
        parts = self.children(root)
        names, joints = self.joints(parts["joints"])
        struts, relative_radius = self.struts(parts["struts"], names)
        cell = UnitCell(
            name=self.name(root, "name"),
            joint_names=tuple(names),
            joints=joints,
            struts=struts,
            relative_radius=relative_radius,
            section=self.choice(root, "section", SECTIONS),
            tiling=self.choice(root, "tiling", TILINGS),
            classification=self.choice(root, "classification", CLASSIFICATIONS),
            source=self.text(parts["source"]),
            description=self.text(parts["description"]),
            aliases=self.aliases(root),
            joint_model=self.joint_model(parts.get("joint_model")),
        )
        self.check_joints(cell, parts["joints"])
        if cell.tiling == "translate":
            self.check_faces(cell, parts)
        self.check_block(cell, root)
        return cell

    def children(self, root: etree._Element) -> dict[str, etree._Element]:
        order = ["description", "source", "joints", "struts", "joint_model"]
        found = {}
        for child in root:
            if child.tag not in order:
                self.refuse(child, f"<{child.tag}> is unknown; {nearest_name(child.tag, order)}")
            if child.tag in found:
                self.refuse(child, f"a second <{child.tag}>; a cell has one.")
            found[child.tag] = child
        needed = order[:-1]
        missing = [tag for tag in needed if tag not in found]
        if missing:
            self.refuse(root, f"<{missing[0]}> is missing; a cell has " + ", ".join(needed) + ".")
        if list(found) != [tag for tag in order if tag in found]:
            self.refuse(root, "the elements must come in the order " + ", ".join(order) + ".")
        return found

    def joints(self, element: etree._Element) -> tuple[dict[str, int], np.ndarray]:
        self.expect_attributes(element, set())
        names: dict[str, int] = {}
        places: dict[tuple[int, ...], str] = {}
        joints = []
        for joint in element:
            self.expect_tag(joint, "joint")
            self.expect_attributes(joint, {"id"})
            name = self.name(joint, "id")
            if name in names:
                self.refuse(joint, f'a second joint with id "{name}"; ids must differ.')
            position = self.position(joint, name)
            place = tuple(round(x * TICKS) for x in position)
            if place in places:
                self.refuse(
                    joint, f'joint "{name}" is at the place of "{places[place]}"; keep one of them.'
                )
            names[name] = len(names)
            places[place] = name
            joints.append([float(x) for x in position])
        if len(joints) < 2:
            self.refuse(element, f"{len(joints)} joints; a cell needs at least two.")
        return names, np.array(joints)

    def position(self, joint: etree._Element, name: str) -> list[Fraction]:
        words = [str(word) for word in (joint.text or "").split()]
        if len(joint) or len(words) != 3 or not all(COORDINATE.fullmatch(w) for w in words):
            if all(COORDINATE.fullmatch(w.removeprefix("-")) for w in words) and len(words) == 3:
                self.refuse_outside(joint, name, words)
            self.refuse(
                joint,
                f'joint "{name}" is at "{(joint.text or "").strip()}"; it needs three coordinates, '
                "decimals or fractions, such as 0 0.5 1/3.",
            )
        position = [Fraction(w) for w in words]
        if max(position) > 1:
            self.refuse_outside(joint, name, words)
        return position

    def refuse_outside(self, joint: etree._Element, name: str, words: list[str]) -> NoReturn:
        self.refuse(
            joint,
            f'joint "{name}" at {" ".join(words)} is outside the unit cube; every coordinate must '
            "lie between 0 and 1.",
        )

    def struts(
        self, element: etree._Element, names: dict[str, int]
    ) -> tuple[np.ndarray, Float[np.ndarray, " struts"]]:
        self.expect_attributes(element, set())
        lines: dict[tuple[int, ...], int | None] = {}
        radii = []
        for strut in element:
            self.expect_tag(strut, "strut")
            self.expect_attributes(strut, {"from", "to"}, optional={"radius"})
            a, b = strut.attrib["from"], strut.attrib["to"]
            for end in (a, b):
                if end not in names:
                    self.refuse(
                        strut,
                        f'strut "{a}"–"{b}" ends at "{end}", which is no joint; '
                        f"{nearest_name(end, names)}",
                    )
            if a == b:
                self.refuse(strut, f'strut "{a}"–"{b}" has no length; it must join two joints.')
            ends = tuple(sorted((names[a], names[b])))
            if ends in lines:
                self.refuse(strut, f'strut "{a}"–"{b}" repeats line {lines[ends]}; remove one.')
            lines[ends] = strut.sourceline
            radii.append(self.radius(strut))
        if not lines:
            self.refuse(element, "there are no struts; a cell needs at least one.")
        return np.array(list(lines)), np.array(radii)

    def joint_model(self, element: etree._Element | None) -> JointModel | None:
        if element is None:
            return None
        names = [field.name for field in fields(JointModel)]
        self.expect_attributes(element, set(names))
        values = {name: self.number(element, name) for name in names}
        for name in ("rigid_end", "slenderness", "error"):
            if values[name] < 0:
                self.refuse(element, f"{name} is {values[name]:g}; it must not be negative.")
        model = JointModel(**values)
        # Half the strut at either end, at most, and a factor above zero.
        if not model.rigid_end * model.slenderness < 1 / 2:
            self.refuse(
                element,
                f"struts of slenderness {model.slenderness:g} would be rigid from end to end; "
                "lower slenderness or rigid_end.",
            )
        if not 1 + model.modulus * model.slenderness > 0:
            self.refuse(
                element,
                f"the modulus of struts of slenderness {model.slenderness:g} would not be positive; "
                "lower slenderness, or raise modulus.",
            )
        return model

    def number(self, element: etree._Element, key: str) -> float:
        text = str(element.attrib[key])
        try:
            value = float(text)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            self.refuse(element, f'{key} is "{text}"; it must be a number.')
        return value

    def radius(self, strut: etree._Element) -> float:
        text = strut.attrib.get("radius", "1")
        try:
            radius = float(text)
        except ValueError:
            radius = np.nan
        if not (np.isfinite(radius) and radius > 0):
            self.refuse(
                strut, f'radius is "{text}"; it must be a positive number (1: as designed).'
            )
        return float(radius)

    def check_joints(self, cell: UnitCell, element: etree._Element) -> None:
        bare = set(range(len(cell.joints))) - set(cell.struts.reshape(-1).tolist())
        if bare:
            joint = min(bare)
            self.refuse(
                element[joint],
                f'joint "{cell.joint_names[joint]}" has no strut; remove it or join it.',
            )

    def check_faces(self, cell: UnitCell, parts: dict[str, etree._Element]) -> None:
        """Whatever lies in a face must lie in the opposite one, for neighbours to share it."""
        for axis in range(3):
            across = np.delete(cell.ticks, axis, axis=1)
            faces = [cell.ticks[:, axis] == 0, cell.ticks[:, axis] == TICKS]
            for this, other in (faces, faces[::-1]):
                lone = self.unmatched(_points(across, this), _points(across, other))
                if lone is not None:
                    self.refuse_face(cell, parts["joints"][lone], axis, "joint")
                lone = self.unmatched(_lines(cell, across, this), _lines(cell, across, other))
                if lone is not None:
                    self.refuse_face(cell, parts["struts"][lone], axis, "strut")

    def unmatched(self, here: dict[tuple, int], there: dict[tuple, int]) -> int | None:
        return next((index for place, index in here.items() if place not in there), None)

    def refuse_face(
        self, cell: UnitCell, element: etree._Element, axis: int, kind: str
    ) -> NoReturn:
        what = element.get("id") or f"{element.get('from')}–{element.get('to')}"
        self.refuse(
            element,
            f'{kind} "{what}" lies in a face across {AXES[axis]} and has no match in the opposite '
            f'face, so neighbours would not share it; add the match or use tiling="mirror".',
        )

    def check_block(self, cell: UnitCell, root: etree._Element) -> None:
        net = tile(cell, BLOCK)
        n = len(net.joints)
        graph = scipy.sparse.coo_array(
            (np.ones(len(net.struts)), tuple(net.struts.T)), shape=(n, n)
        )
        pieces = scipy.sparse.csgraph.connected_components(graph, directed=False)[0]
        if pieces > 1:
            self.refuse(
                root,
                f'a block of {" x ".join(map(str, BLOCK))} cells with tiling="{cell.tiling}" falls '
                f"into {pieces} separate nets; neighbours must share joints: change the tiling, or "
                "add struts.",
            )

    def expect_tag(self, element: etree._Element, tag: str) -> None:
        if element.tag != tag:
            self.refuse(element, f"<{element.tag}> where <{tag}> is expected.")

    def expect_attributes(
        self,
        element: etree._Element,
        needed: set[str],
        optional: frozenset[str] | set[str] = frozenset(),
    ) -> None:
        for key in element.attrib:
            if key not in needed | optional:
                remedy = nearest_name(str(key), needed | optional) if needed else "remove it."
                self.refuse(element, f'attribute "{key}" of <{element.tag}> is unknown; {remedy}')
        for key in sorted(needed):
            if key not in element.attrib:
                self.refuse(element, f'<{element.tag}> lacks its attribute "{key}".')

    def name(self, element: etree._Element, key: str) -> str:
        return self.word(element, key, str(element.attrib[key]))

    def aliases(self, root: etree._Element) -> tuple[str, ...]:
        words = str(root.attrib.get("aliases", "")).split()
        return tuple(self.word(root, "aliases", word) for word in words)

    def word(self, element: etree._Element, key: str, text: str) -> str:
        if not NAME.fullmatch(text):
            self.refuse(
                element,
                f'{key} is "{text}"; use letters, digits, ".", "_" and "-", no spaces.',
            )
        return text

    def choice(self, element: etree._Element, key: str, known: tuple[str, ...]) -> str:
        text = str(element.attrib[key])
        if text not in known:
            self.refuse(element, f'{key} is "{text}"; {nearest_name(text, known)}')
        return text

    def text(self, element: etree._Element) -> str:
        self.expect_attributes(element, set())
        text = " ".join((element.text or "").split())
        if not text or len(element):
            self.refuse(element, f"<{element.tag}> must hold text and nothing else.")
        return text


def _points(across: np.ndarray, in_face: Bool[np.ndarray, " joints"]) -> dict[tuple, int]:
    """Joints in a face, by their place in it."""
    return {tuple(across[j].tolist()): int(j) for j in np.flatnonzero(in_face)}


def _lines(
    cell: UnitCell, across: np.ndarray, in_face: Bool[np.ndarray, " joints"]
) -> dict[tuple, int]:
    """Struts in a face, by the places of their ends and their radius."""
    lines = {}
    for s in np.flatnonzero(in_face[cell.struts].all(axis=1)):
        ends = sorted(map(tuple, across[cell.struts[s]].tolist()))
        lines[(*ends, float(cell.relative_radius[s]))] = int(s)
    return lines
