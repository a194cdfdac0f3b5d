"""VTK's XML files with lines (VTP, VTU): in ASCII, base64 or appended bytes, compressed or not.

VTK File Formats, "XML File Formats" (The VTK User's Guide, 11th ed.): before the bytes of an array stands
their number; before compressed blocks the number of blocks, their size, that of the last, and the
compressed size of each.
"""

import binascii
import io
import lzma
import re
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from texmap_opt.imports.line_set import LineSet, line_set, select_lines
from texmap_opt.xml_stream import XmlStream

# Where appended bytes begin: the rest of the file need not be XML.
APPENDED = re.compile(rb'<AppendedData\s+encoding\s*=\s*"(raw|base64)"\s*>\s*_')
BASE64_RUN = re.compile(rb"[A-Za-z0-9+/]+={0,2}")
# Bytes that one array may have when unpacked: a hundred million coordinates.
MAX_ARRAY = 2 << 30
DECOMPRESSORS: dict[str, Callable] = {
    "vtkZLibDataCompressor": zlib.decompressobj,
    "vtkLZMADataCompressor": lzma.LZMADecompressor,
}
TYPES = {
    f"{kind}{bits}": np.dtype(f"{code}{bits // 8}")
    for kind, code in (("Int", "i"), ("UInt", "u"), ("Float", "f"))
    for bits in (8, 16, 32, 64)
    if not (kind == "Float" and bits < 32)
}
# Groups whose arrays are looked at.
GROUPS = ("Points", "Lines", "Cells", "PointData", "CellData")
# Counts of the cells of PolyData, in the order their values come in.
CELLS_OF_POLYDATA = ("NumberOfVerts", "NumberOfLines", "NumberOfStrips", "NumberOfPolys")


def read_vtk_xml(path: Path) -> LineSet:
    """The lines of a VTP or VTU file.

    Raises:
        OSError: no such file.
        StructureError: with file and line, where it is no XML.
        ValueError, zlib.error, lzma.LZMAError, KeyError: for what does not follow the format.
    """
    content = path.read_bytes()
    appended = APPENDED.search(content)
    head = content if appended is None else content[: appended.start()] + b"</VTKFile>"
    reader = _Reader(path.name)
    reader.xml.read(io.BytesIO(head), start=reader.start, end=reader.end, text=reader.characters)
    if not reader.kind:
        raise ValueError("it holds neither PolyData nor an UnstructuredGrid")
    tail = b"" if appended is None else content[appended.end() :]
    decoder = _Decoder(reader, tail, raw=appended is not None and appended[1] == b"raw")
    return _joined([_piece(reader.kind, piece, decoder) for piece in reader.pieces])


@dataclass(eq=False)
class _Array:
    """A DataArray element: its attributes, and its text when it has one."""

    attributes: dict[str, str]
    text: str = ""


@dataclass(eq=False)
class _Piece:
    """A Piece element: its counts and the arrays of each group, by name."""

    counts: dict[str, str]
    groups: dict[str, dict[str, _Array]] = field(default_factory=dict)


class _Reader:
    """Listens to the parser's events and keeps the arrays as text."""

    def __init__(self, name: str) -> None:
        self.xml = XmlStream(name)
        self.text: list[str] = []
        self.kind = ""
        self.pieces: list[_Piece] = []
        self.group = ""
        self.array: _Array | None = None
        self.within = 0
        self.header, self.compressor = np.dtype("u4"), ""
        self.order: Literal["<", ">"] = "<"

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        if self.array is not None:
            # What stands within an array's element is about it, not of it.
            self.within += 1
        elif tag == "VTKFile":
            self.header = TYPES[attributes.get("header_type", "UInt32")]
            self.order = ">" if attributes.get("byte_order") == "BigEndian" else "<"
            self.compressor = attributes.get("compressor", "")
            if self.compressor not in ("", *DECOMPRESSORS):
                self.xml.refuse(
                    f"{self.compressor} is not understood; write it with ZLib or without compression."
                )
        elif tag in ("PolyData", "UnstructuredGrid"):
            self.kind = tag
        elif tag == "Piece":
            self.pieces.append(_Piece(attributes))
        elif tag in GROUPS and self.pieces:
            self.group = tag
            self.pieces[-1].groups[tag] = {}
        elif tag == "DataArray" and self.group:
            self.array = _Array(attributes)
            # Positions are the only array of their group, under any name.
            name = "" if self.group == "Points" else attributes.get("Name", "")
            self.pieces[-1].groups[self.group][name] = self.array

    def end(self, tag: str) -> None:
        if self.within:
            self.within -= 1
        elif self.array is not None:
            self.array.text = "".join(self.text)
            self.array = None
            self.text.clear()
        elif tag == self.group:
            self.group = ""

    def characters(self, text: str) -> None:
        if self.array is not None and not self.within:
            self.text.append(text)


class _Decoder:
    """Makes numbers of the text or the appended bytes of arrays."""

    def __init__(self, reader: _Reader, appended: bytes, *, raw: bool) -> None:
        self.header = reader.header.newbyteorder(reader.order)
        self.order: Literal["<", ">"] = reader.order
        self.compressor = reader.compressor
        self.raw = raw
        self.appended = appended if raw else appended.partition(b"<")[0]
        offsets = {
            int(array.attributes["offset"])
            for piece in reader.pieces
            for group in piece.groups.values()
            for array in group.values()
            if "offset" in array.attributes
        }
        self.offsets = [*sorted(offsets), len(self.appended)]

    def rows(self, array: _Array, count: int) -> np.ndarray:
        """An array's rows: of one number, or of several."""
        width = int(array.attributes.get("NumberOfComponents", "1"))
        numbers = self.numbers(array)
        if width < 1 or len(numbers) != count * width:
            name = array.attributes.get("Name", "")
            raise ValueError(f'array "{name}" has {len(numbers)} numbers for {count} rows')
        return numbers.reshape((count, width) if width > 1 else (count,))

    def numbers(self, array: _Array) -> np.ndarray:
        """All numbers of an array."""
        dtype = TYPES[array.attributes["type"]]
        how = array.attributes.get("format", "ascii")
        if how == "ascii":
            return np.array(array.text.split(), dtype=dtype)
        if how == "binary":
            content = _from_base64(array.text.encode())
        else:
            start = int(array.attributes["offset"])
            end = next(offset for offset in self.offsets if offset > start)
            content = self.appended[start:] if self.raw else _from_base64(self.appended[start:end])
        content = self.unpacked(content)
        return np.frombuffer(content, dtype=dtype.newbyteorder(self.order)).astype(dtype)

    def unpacked(self, content: bytes) -> bytes:
        """The bytes that a header, and compression, stand before."""
        size = self.header.itemsize
        if not self.compressor:
            length = int(np.frombuffer(content[:size], self.header)[0])
            return content[size : size + length]
        blocks = int(np.frombuffer(content[:size], self.header)[0])
        sizes = np.frombuffer(content[: (3 + blocks) * size], self.header)
        if blocks == 0:
            return b""
        if len(sizes) != 3 + blocks or not 0 < blocks * int(sizes[1]) <= MAX_ARRAY:
            raise ValueError("the sizes of its compressed blocks do not fit")
        start, unpacked = (3 + blocks) * size, []
        for length in sizes[3:].tolist():
            # As a limit, so that bytes made to grow without end do not.
            block = content[start : start + length]
            unpacked.append(DECOMPRESSORS[self.compressor]().decompress(block, int(sizes[1])))
            start += length
        return b"".join(unpacked)


def _from_base64(text: bytes) -> bytes:
    """Bytes of runs of base64, each of which may end with its own padding."""
    return b"".join(binascii.a2b_base64(run) for run in BASE64_RUN.findall(text))


def _piece(kind: str, piece: _Piece, decoder: _Decoder) -> LineSet:
    points = int(piece.counts["NumberOfPoints"])
    (positions,) = piece.groups["Points"].values()
    topology = piece.groups.get("Lines" if kind == "PolyData" else "Cells", {})
    parts = [
        decoder.numbers(topology[name]) if name in topology else np.zeros(0, np.int64)
        for name in ("connectivity", "offsets")
    ]
    if kind == "PolyData":
        verts, lines, strips, polygons = (
            int(piece.counts.get(key, "0")) for key in CELLS_OF_POLYDATA
        )
        cells, of_lines = verts + lines + strips + polygons, np.arange(verts, verts + lines)
        if len(parts[1]) != lines:
            raise ValueError(f"it has {len(parts[1])} lines and announces {lines}")
    else:
        cells = int(piece.counts["NumberOfCells"])
        types = decoder.rows(topology["types"], cells)
        *parts, of_lines = select_lines(parts[0], parts[1], types)
    if len(of_lines) == 0:
        raise ValueError("it has no lines")
    return line_set(
        decoder.rows(positions, points),
        (parts[0], parts[1]),
        {
            name: decoder.rows(array, points)
            for name, array in piece.groups.get("PointData", {}).items()
            if array.attributes["type"] in TYPES
        },
        {
            name: decoder.rows(array, cells)[of_lines]
            for name, array in piece.groups.get("CellData", {}).items()
            if array.attributes["type"] in TYPES
        },
        others=cells - len(of_lines),
    )


def _joined(pieces: list[LineSet]) -> LineSet:
    """One set of the pieces of a file, which have the same arrays."""
    if not pieces:
        raise ValueError("it has no pieces")
    starts = np.cumsum([0, *(len(piece.points) for piece in pieces)]).tolist()
    segments = [piece.segments + start for piece, start in zip(pieces, starts[:-1], strict=True)]
    of_points, of_segments = pieces[0].point_data, pieces[0].segment_data
    return LineSet(
        np.concatenate([piece.points for piece in pieces]),
        np.concatenate(segments),
        {name: np.concatenate([piece.point_data[name] for piece in pieces]) for name in of_points},
        {
            name: np.concatenate([piece.segment_data[name] for piece in pieces])
            for name in of_segments
        },
        sum(piece.others for piece in pieces),
    )
