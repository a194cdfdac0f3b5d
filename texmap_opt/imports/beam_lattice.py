"""3MF beam lattices: the beams of the objects that a package builds.

3MF Core Specification 1.4.0 (units, build items, components and their transforms) and Beam Lattice
Extension 1.2.0 (beams, radii, minimal length). Triangles, balls, caps and clipping are left out, with a note
where that changes the shape.
"""

import posixpath
import zipfile
from array import array
from dataclasses import dataclass, field
from io import BufferedIOBase
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.errors import StructureError, nearest_name
from texmap_opt.export.beam_lattice import BEAMS
from texmap_opt.export.three_mf_package import CORE
from texmap_opt.imports.imported import Bars, Imported, imported
from texmap_opt.units import MM_PER_FOOT, MM_PER_UNIT
from texmap_opt.xml_stream import NAMESPACE_SEPARATOR, XmlStream

RELATIONSHIPS = "http://schemas.openxmlformats.org/package/2006/relationships"
MODEL_TYPE = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
# Core specification, section 3.4.
UNITS = {
    "micron": 1e-3,
    "millimeter": MM_PER_UNIT["mm"],
    "centimeter": MM_PER_UNIT["cm"],
    "inch": MM_PER_UNIT["in"],
    "foot": MM_PER_FOOT,
    "meter": MM_PER_UNIT["m"],
}
CLIPPING = ("none", "inside", "outside")
# A model's text when unpacked [bytes]: some twenty million beams. A zip holds a thousandth of it.
MAX_MODEL = 2 << 30
# Objects that the build places, components within components counted each time: a few lines could ask for
# billions.
MAX_PLACED = 10_000
# Relative difference of the lengths to which a transform takes the axes below which beams stay round.
ROUND = 1e-6
IDENTITY = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]])


def read_beam_lattice(path: Path) -> Imported:
    """Read the beams of a package, where its build items put them.

    Args:
        path: the file.

    Raises:
        StructureError: for what is no 3MF package, builds no beams, or puts them through a transform
            after which they are not round.
    """
    path = Path(path)
    try:
        with zipfile.ZipFile(path) as package:
            reader = _read(path, package)
    except OSError as failure:
        raise StructureError(
            f"{path}: cannot be read ({failure.strerror or failure}); give a 3MF file."
        ) from failure
    # Broken bytes reach zipfile and zlib, which meet them with whatever they happen to raise.
    except Exception as failure:
        if isinstance(failure, StructureError):
            raise
        reason = " ".join(str(failure).split())[:120]
        raise StructureError(
            f"{path.name}: is no 3MF package ({reason}); write it again."
        ) from failure
    # Numbers too large to be multiplied become infinite, which a structure refuses.
    with np.errstate(over="ignore", invalid="ignore"):
        return imported(path, _built(path, reader), mm_per_unit=reader.mm_per_unit)


def _read(path: Path, package: zipfile.ZipFile) -> "_Reader":
    relations = _Relations(f"{path.name}, _rels/.rels")
    with _opened(path, package, "_rels/.rels") as stream:
        relations.xml.read(stream, start=relations.start, end=_pass, text=_pass)
    if relations.model is None:
        raise StructureError(f"{path.name}: names no 3D model; write it again as 3MF.")
    reader = _Reader(f"{path.name}, {relations.model}")
    with _opened(path, package, relations.model) as stream:
        reader.xml.read(stream, start=reader.start, end=reader.end, text=_pass)
    return reader


def _opened(path: Path, package: zipfile.ZipFile, name: str) -> BufferedIOBase:
    if name not in package.namelist():
        raise StructureError(f"{path.name}: has no part {name}; write it again as 3MF.")
    if package.getinfo(name).file_size > MAX_MODEL:
        raise StructureError(
            f"{path.name}: {name} takes {package.getinfo(name).file_size:,} bytes unpacked; at most "
            f"{MAX_MODEL:,} are read: divide the lattice."
        )
    return package.open(name)  # pyright: ignore[reportReturnType]


def _pass(_: str) -> None:
    """An event that tells nothing here."""


def _built(path: Path, reader: "_Reader") -> Bars:
    """The lattices of all build items, each through its transform."""
    joints: list[np.ndarray] = []
    struts: list[np.ndarray] = []
    radii: list[np.ndarray] = []
    count, notes = 0, []
    for lattice, transform in _placed(path, reader):
        if not lattice.beams:
            notes.append(f"object {lattice.number} has no beams and was left out")
            continue
        vertices, ends, scale = lattice.placed(path, transform)
        joints.append(vertices)
        struts.append(ends + count)
        radii.append(np.array(lattice.radii).reshape(-1, 2)[lattice.long_enough()] * scale)
        count += len(vertices)
        notes += lattice.notes()
    if not joints:
        raise StructureError(
            f"{path.name}: builds no beam lattice; export one, or give a structure."
        )
    # Objects that are placed several times have the same to say each time.
    notes = tuple(dict.fromkeys(notes))
    return Bars(np.concatenate(joints), np.concatenate(struts), np.concatenate(radii), notes=notes)


def _placed(path: Path, reader: "_Reader") -> list[tuple["_Object", Float[np.ndarray, "4 3"]]]:
    """The meshes that the build's objects come down to, and where each goes."""
    for number, _ in reader.items:
        if number not in reader.objects:
            raise StructureError(
                f"{path.name}: the build names object {number}, which is not defined; write it again."
            )
    found: list[tuple[_Object, np.ndarray]] = []
    waiting = [(reader.objects[number], transform) for number, transform in reversed(reader.items)]
    while waiting:
        placed, outer = waiting.pop()
        if not placed.components:
            found.append((placed, outer))
        for number, inner in reversed(placed.components):
            # Row vectors: first the component's transform, then that of the object it is in.
            turn, shift = inner[:3] @ outer[:3], inner[3] @ outer[:3] + outer[3]
            waiting.append((reader.objects[number], np.vstack([turn, shift])))
        if len(found) + len(waiting) > MAX_PLACED:
            raise StructureError(
                f"{path.name}: its assemblies place more than {MAX_PLACED:,} objects; export the beam "
                "lattice as one object."
            )
    return found


@dataclass(eq=False)
class _Object:
    """An object as its elements are read."""

    number: int
    vertices: array = field(default_factory=lambda: array("d"))
    beams: array = field(default_factory=lambda: array("q"))
    radii: array = field(default_factory=lambda: array("d"))
    radius: float = 0.0
    min_length: float = 0.0
    triangles: int = 0
    balls: int = 0
    clipping: str = "none"
    components: list[tuple[int, np.ndarray]] = field(default_factory=list)

    def points(self) -> Float[np.ndarray, "vertices 3"]:
        return np.array(self.vertices).reshape(-1, 3)

    def ends(self) -> Int[np.ndarray, "struts 2"]:
        return np.array(self.beams, np.int64).reshape(-1, 2)

    def long_enough(self) -> np.ndarray:
        """Beams that are not to be left out: at least as long as the lattice says."""
        first, last = self.points()[self.ends()].swapaxes(0, 1)
        return np.linalg.norm(last - first, axis=1) >= self.min_length

    def placed(
        self, path: Path, transform: Float[np.ndarray, "4 3"]
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Vertices, beams, and the factor of radii, after a transform."""
        turn = transform[:3]
        lengths = np.linalg.norm(turn, axis=1)
        scale = float(lengths.mean())
        if not (
            scale > 0 and np.abs(turn @ turn.T - scale**2 * np.eye(3)).max() <= ROUND * scale**2
        ):
            raise StructureError(
                f"{path.name}: the transform of object {self.number} stretches or shears, and its "
                "beams would not be round; scale all axes alike."
            )
        return self.points() @ turn + transform[3], self.ends()[self.long_enough()], scale

    def notes(self) -> list[str]:
        about = f"object {self.number}:"
        notes = []
        if self.triangles:
            notes.append(f"{about} {self.triangles} triangles beside the beams were left out")
        if self.balls:
            notes.append(f"{about} {self.balls} balls at the ends of beams were left out")
        if self.clipping != "none":
            notes.append(f"{about} beams were not clipped {self.clipping} its clipping mesh")
        short = int((~self.long_enough()).sum())
        if short:
            notes.append(f"{about} {short} beams shorter than its minlength were left out")
        return notes


class _Relations:
    """Finds the model among the relationships of a package."""

    def __init__(self, name: str) -> None:
        self.xml = XmlStream(name, namespaces=True)
        self.model: str | None = None

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        if (
            tag == f"{RELATIONSHIPS}{NAMESPACE_SEPARATOR}Relationship"
            and attributes.get("Type") == MODEL_TYPE
            and self.model is None
        ):
            # Relative to the package's root, with a slash before or without.
            self.model = posixpath.normpath(attributes.get("Target", "").lstrip("/"))


class _Reader:
    """Listens to the parser's events and fills the arrays of objects."""

    def __init__(self, name: str) -> None:
        self.xml = XmlStream(name, namespaces=True)
        self.refuse = self.xml.refuse
        self.mm_per_unit = 1.0
        self.objects: dict[int, _Object] = {}
        self.items: list[tuple[int, np.ndarray]] = []
        self.open: list[str] = []
        self.taken = {
            f"{CORE} model": self.model,
            f"{CORE} object": self.object,
            f"{CORE} component": self.component,
            f"{CORE} vertex": self.vertex,
            f"{CORE} triangle": self.triangle,
            f"{CORE} item": self.item,
            f"{BEAMS} beamlattice": self.beamlattice,
            f"{BEAMS} beam": self.beam,
        }
        self.current: _Object | None = None

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        if not self.open and tag != f"{CORE} model":
            self.refuse("is no 3MF model; write it again as 3MF.")
        self.open.append(tag)
        if tag in self.taken:
            self.taken[tag](attributes)
        # Balls have a namespace of their own since version 1.2, and had the beams' before.
        elif tag.rpartition(NAMESPACE_SEPARATOR)[2] == "ball":
            self.inside("ball").balls += 1

    def end(self, tag: str) -> None:
        self.open.pop()
        if tag == f"{CORE} object":
            self.current = None

    def inside(self, tag: str) -> _Object:
        if self.current is None:
            self.refuse(f"<{tag}> is outside of an object; write it again.")
        return self.current

    def model(self, attributes: dict[str, str]) -> None:
        unit = attributes.get("unit", "millimeter")
        if unit not in UNITS:
            self.refuse(f'unit is "{unit}"; {nearest_name(unit, UNITS)}')
        self.mm_per_unit = UNITS[unit]

    def object(self, attributes: dict[str, str]) -> None:
        self.xml.demand("object", attributes, ("id",))
        number = self.xml.whole(attributes["id"], "id")
        if number in self.objects:
            self.refuse(f"a second object with id {number}; ids must differ.")
        self.current = self.objects[number] = _Object(number)

    def component(self, attributes: dict[str, str]) -> None:
        assembly = self.inside("component")
        number, transform = self.place("component", attributes)
        # So no assembly contains itself.
        if number not in self.objects or number == assembly.number:
            self.refuse(f"component names object {number}, which does not stand before it.")
        assembly.components.append((number, transform))

    def vertex(self, attributes: dict[str, str]) -> None:
        self.xml.demand("vertex", attributes, "xyz")
        words = [attributes[key] for key in "xyz"]
        self.inside("vertex").vertices.extend(self.xml.numbers(words, "vertex", 3))

    def triangle(self, _: dict[str, str]) -> None:
        self.inside("triangle").triangles += 1

    def beamlattice(self, attributes: dict[str, str]) -> None:
        lattice = self.inside("beamlattice")
        self.xml.demand("beamlattice", attributes, ("radius", "minlength"))
        lattice.radius = self.xml.positive(attributes["radius"], "radius")
        lattice.min_length = self.xml.positive(attributes["minlength"], "minlength")
        lattice.clipping = attributes.get("clippingmode", "none")
        if lattice.clipping not in CLIPPING:
            self.refuse(
                f'clippingmode is "{lattice.clipping}"; {nearest_name(lattice.clipping, CLIPPING)}'
            )

    def beam(self, attributes: dict[str, str]) -> None:
        lattice = self.inside("beam")
        if lattice.radius == 0:
            self.refuse("<beam> is outside of a beam lattice; write it again.")
        count = len(lattice.vertices) // 3
        self.xml.demand("beam", attributes, ("v1", "v2"))
        ends = [self.xml.whole(attributes[key], key) for key in ("v1", "v2")]
        if max(ends) >= count or ends[0] == ends[1]:
            self.refuse(
                f"beam joins vertices {ends[0]} and {ends[1]}; two different ones of {count} are needed."
            )
        lattice.beams.extend(ends)
        if "r2" in attributes and "r1" not in attributes:
            self.refuse("beam has r2 without r1; give both, or r1 alone.")
        first = last = lattice.radius
        if "r1" in attributes:
            first = last = self.xml.positive(attributes["r1"], "r1")
        if "r2" in attributes:
            last = self.xml.positive(attributes["r2"], "r2")
        lattice.radii.extend((first, last))

    def item(self, attributes: dict[str, str]) -> None:
        self.items.append(self.place("item", attributes))

    def place(self, tag: str, attributes: dict[str, str]) -> tuple[int, np.ndarray]:
        """The number of an object and its transform."""
        self.xml.demand(tag, attributes, ("objectid",))
        number = self.xml.whole(attributes["objectid"], "objectid")
        if "transform" not in attributes:
            return number, IDENTITY
        numbers = self.xml.numbers(attributes["transform"].split(), "transform", 12)
        return number, np.array(numbers).reshape(4, 3)
