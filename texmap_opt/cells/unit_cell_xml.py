"""Unit cells from XML files (schema: library/unit_cell.xsd); reading one checks it."""

import re
from dataclasses import fields, replace
from fractions import Fraction
from pathlib import Path
from typing import NoReturn

import numpy as np
from jaxtyping import Float
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  (compiled)

from texmap_opt.cells.joint_model import JointModel
from texmap_opt.cells.rigidity import classification
from texmap_opt.cells.symmetry import SYSTEMS, crystal_system
from texmap_opt.cells.unit_cell import CLASSIFICATIONS, SECTIONS, TICKS, TILINGS, UnitCell
from texmap_opt.cells.unit_cell_checks import first_fault
from texmap_opt.errors import CellError, nearest_name

# A decimal or a fraction, not negative, as in the schema; Python's numbers allow more (1e3, nan), and
# integers of thousands of digits are not read at all.
COORDINATE = re.compile(r"[0-9]{1,99}(\.[0-9]{1,99})?|[0-9]{1,99}/[1-9][0-9]{0,98}")
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._\-]*")
UNITS = ("cell", "mm")
NEEDED = {"name", "dimensions", "unit", "section", "tiling"}
OPTIONAL = {"aliases", "proportions", "edges_mm", "classification", "symmetry"}
# Why an attribute that is missing is needed.
REMEDIES = {
    "dimensions": 'give dimensions="3", or "2" for a cross-section that is extruded.',
    "unit": 'give unit="cell" for coordinates from 0 to 1, or unit="mm" with edges_mm.',
    "section": 'give section="round" or "square", or "wall" in two dimensions.',
    "tiling": 'give tiling="translate" or "mirror".',
}


def read_unit_cell(path: Path) -> UnitCell:
    """Read and check one unit-cell file.

    Raises:
        CellError: with file and line, when the file cannot be read, is not XML, does not follow the
            schema, or describes no lattice: a joint outside the unit cube, two joints at one place,
            a joint without struts, a strut of no length or given twice, a strut through a joint,
            opposite faces that do not match, a net that falls apart, has loose ends or struts that
            cross when it is tiled, a class or symmetry that the cell does not have.
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
        # Read first: the parser's own OSError may also mean letters that are none.
        return etree.fromstring(path.read_bytes(), parser)
    except etree.XMLSyntaxError as failure:
        raise CellError(
            f"{path.name}, line {failure.lineno or 1}: is not XML ({failure.msg}); correct it, or write "
            "the file again."
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
        self.expect_attributes(root, NEEDED, OPTIONAL)
        parts = self.children(root)
        d = int(self.choice(root, "dimensions", ("2", "3")))
        edges = self.edges(root, d)
        names, joints = self.joints(parts["joints"], edges)
        struts, relative_radius = self.struts(parts["struts"], names)
        cell = UnitCell(
            name=self.name(root, "name"),
            joint_names=tuple(names),
            joints=joints,
            struts=struts,
            relative_radius=relative_radius,
            section=self.choice(root, "section", SECTIONS[d]),
            mirrored=self.mirrored(root, d),
            proportions=self.proportions(root, edges),
            classification="",
            symmetry="",
            source=self.text(parts["source"]),
            description=self.text(parts["description"]),
            aliases=self.aliases(root),
            joint_model=self.joint_model(parts.get("joint_model")),
        )
        fault = first_fault(cell)
        if fault is not None:
            elements = {"joint": parts["joints"], "strut": parts["struts"], "cell": [root]}
            self.refuse(elements[fault.kind][fault.index], fault.message)
        return replace(
            cell,
            classification=self.stated(root, "classification", classification(cell)),
            symmetry=self.stated(root, "symmetry", crystal_system(cell)),
        )

    def stated(self, root: etree._Element, key: str, found: str) -> str:
        """What was found, which the file may say too."""
        if key in root.attrib:
            known = {"classification": CLASSIFICATIONS, "symmetry": SYSTEMS}[key]
            given = self.choice(root, key, known)
            if given != found:
                self.refuse(
                    root, f'{key} is "{given}", but the lattice is {found}; give that, or nothing.'
                )
        return found

    def edges(self, root: etree._Element, d: int) -> tuple[Fraction, ...] | None:
        """Edges of a cell in millimetres; None where coordinates are shares of them."""
        if self.choice(root, "unit", UNITS) == "cell":
            if "edges_mm" in root.attrib:
                self.refuse(root, 'edges_mm is for unit="mm"; remove one of them.')
            return None
        if "edges_mm" not in root.attrib:
            self.refuse(root, f'unit="mm" needs the {d} edges of the cell: add edges_mm.')
        if "proportions" in root.attrib:
            self.refuse(root, "proportions follow from edges_mm; remove them.")
        return self.lengths(root, "edges_mm", d)

    def proportions(
        self, root: etree._Element, edges: tuple[Fraction, ...] | None
    ) -> tuple[float, ...]:
        d = int(root.attrib["dimensions"])
        if edges is None:
            if "proportions" not in root.attrib:
                return (1.0,) * d
            edges = self.lengths(root, "proportions", d)
        return tuple(float(edge / edges[0]) for edge in edges)

    def lengths(self, root: etree._Element, key: str, d: int) -> tuple[Fraction, ...]:
        words = str(root.attrib[key]).split()
        positive = len(words) == d and all(
            COORDINATE.fullmatch(word) and Fraction(word) > 0 for word in words
        )
        if not positive:
            self.refuse(
                root,
                f'{key} is "{root.attrib[key]}"; it needs {d} positive numbers, such as '
                f"{' '.join(['1', '1.5', '2'][:d])}.",
            )
        return tuple(Fraction(word) for word in words)

    def mirrored(self, root: etree._Element, d: int) -> tuple[bool, ...]:
        words = str(root.attrib["tiling"]).split()
        for word in words:
            if word not in TILINGS:
                self.refuse(root, f'tiling is "{word}"; {nearest_name(word, TILINGS)}')
        if len(words) not in (1, d):
            self.refuse(
                root, f'tiling is "{" ".join(words)}"; give one word, or one for each of {d} axes.'
            )
        return tuple(word == "mirror" for word in words) * (d if len(words) == 1 else 1)

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

    def joints(
        self, element: etree._Element, edges: tuple[Fraction, ...] | None
    ) -> tuple[dict[str, int], np.ndarray]:
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
            position = self.position(joint, name, edges)
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

    def position(
        self, joint: etree._Element, name: str, edges: tuple[Fraction, ...] | None
    ) -> list[Fraction]:
        d = int(joint.getparent().getparent().attrib["dimensions"])
        words = [str(word) for word in (joint.text or "").split()]
        if len(joint) or len(words) != d or not all(COORDINATE.fullmatch(w) for w in words):
            if all(COORDINATE.fullmatch(w.removeprefix("-")) for w in words) and len(words) == d:
                self.refuse_outside(joint, name, words, edges)
            self.refuse(
                joint,
                f'joint "{name}" is at "{(joint.text or "").strip()}"; it needs {d} coordinates, '
                f"decimals or fractions, such as {' '.join(['0', '0.5', '1/3'][:d])}.",
            )
        position = [Fraction(w) for w in words]
        if edges is not None:
            position = [x / edge for x, edge in zip(position, edges, strict=True)]
        if max(position) > 1:
            self.refuse_outside(joint, name, words, edges)
        return position

    def refuse_outside(
        self,
        joint: etree._Element,
        name: str,
        words: list[str],
        edges: tuple[Fraction, ...] | None,
    ) -> NoReturn:
        shape = "unit square" if len(words) == 2 else "unit cube"
        limit = "0 and 1"
        if edges is not None:
            shape, limit = "cell", f"0 and edges_mm = {' '.join(f'{float(e):g}' for e in edges)}"
        self.refuse(
            joint,
            f'joint "{name}" at {" ".join(words)} is outside the {shape}; every coordinate must lie '
            f"between {limit}.",
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
        for name in ("rigid_end", "radius_ratio", "error"):
            if values[name] < 0:
                self.refuse(element, f"{name} is {values[name]:g}; it must not be negative.")
        model = JointModel(**values)
        # Half the strut at either end, at most, and a factor above zero.
        if not model.rigid_end * model.radius_ratio < 1 / 2:
            self.refuse(
                element,
                f"struts of radius/length {model.radius_ratio:g} would be rigid from end to end; "
                "lower radius_ratio or rigid_end.",
            )
        if not 1 + model.modulus * model.radius_ratio > 0:
            self.refuse(
                element,
                f"the modulus of struts of radius/length {model.radius_ratio:g} would not be positive; "
                "lower radius_ratio, or raise modulus.",
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
                remedy = f"; {REMEDIES[key]}" if key in REMEDIES else "."
                self.refuse(element, f'<{element.tag}> lacks its attribute "{key}"{remedy}')

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
