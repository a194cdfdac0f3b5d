"""VTK's legacy files with lines: POLYDATA or UNSTRUCTURED_GRID, ASCII or binary, versions to 5.

VTK File Formats, "Simple Legacy Formats" (The VTK User's Guide, 11th ed.). Binary numbers are big-endian;
up to version 4 every cell is its number of points and these, from 5 on offsets and points apart.
"""

from pathlib import Path

import numpy as np

from texmap_opt.imports.line_set import LineSet, line_set, select_lines

# C++'s names of numbers and VTK's own; "long" has eight bytes everywhere but on Windows.
TYPES = {
    "char": "i1",
    "signed_char": "i1",
    "unsigned_char": "u1",
    "short": "i2",
    "unsigned_short": "u2",
    "int": "i4",
    "unsigned_int": "u4",
    "long": "i8",
    "unsigned_long": "u8",
    "float": "f4",
    "double": "f8",
    "vtkidtype": "i8",
}
TYPES |= {f"vtktypeint{bits}": f"i{bits // 8}" for bits in (8, 16, 32, 64)}
TYPES |= {f"vtktypeuint{bits}": f"u{bits // 8}" for bits in (8, 16, 32, 64)}
# Cells of POLYDATA, in the order their values come in.
POLYDATA = ("VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS")
# Attributes of other than one number a row: how many.
WIDE = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9}
# Red, green, blue and opacity: bytes in binary files, shares of one in the others.
RGBA = 4


def read_vtk_legacy(path: Path) -> LineSet:
    """The lines of a legacy VTK file.

    Raises:
        OSError: no such file.
        ValueError, KeyError, IndexError: for what does not follow the format.
    """
    reader = _Reader(path.read_bytes())
    while reader.block():
        pass
    return reader.lines()


class _Reader:
    """Goes through a file's blocks, each begun by a keyword."""

    def __init__(self, content: bytes) -> None:
        self.content, self.place = content, 0
        first = self.line()
        if not first.startswith("# vtk DataFile Version"):
            raise ValueError("its first line is not that of a VTK file")
        self.new_cells = first.split()[-1].split(".")[0] >= "5"
        self.line()
        self.binary = self.line().strip().upper() == "BINARY"
        self.dataset = ""
        self.points = np.zeros((0, 3))
        self.cells: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self.types = np.zeros(0, np.int64)
        self.data: dict[str, dict[str, np.ndarray]] = {"POINT_DATA": {}, "CELL_DATA": {}}
        self.rows, self.of = 0, self.data["POINT_DATA"]

    def line(self) -> str:
        """The rest of the line."""
        end = self.content.find(b"\n", self.place)
        end = len(self.content) if end < 0 else end
        text = self.content[self.place : end].decode("ascii")
        self.place = end + 1
        return text

    def numbers(self, kind: str, count: int) -> np.ndarray:
        """The next numbers; after binary ones a line ends."""
        dtype = np.dtype(TYPES[kind.lower()])
        if count < 0 or count > len(self.content):
            raise ValueError(f"{count} numbers are more than the file can hold")
        if self.binary:
            end = self.place + count * dtype.itemsize
            values = np.frombuffer(self.content[self.place : end], dtype.newbyteorder(">"))
            if len(values) != count:
                raise ValueError("the file breaks off")
            self.place = end + 1
            return values.astype(dtype)
        words: list[str] = []
        while len(words) < count and self.place < len(self.content):
            words += self.line().split()
        if len(words) != count:
            raise ValueError(f"{len(words)} numbers where {count} are needed")
        return np.array(words, dtype=dtype)

    def block(self) -> bool:
        """Reads one block; False at the end."""
        words = self.line().split()
        if not words:
            return self.place < len(self.content)
        keyword = words[0].upper()
        if keyword == "DATASET":
            self.dataset = words[1].upper()
            if self.dataset not in ("POLYDATA", "UNSTRUCTURED_GRID"):
                raise ValueError(f"its DATASET is a {self.dataset}, which has no lines")
        elif keyword == "POINTS":
            self.points = self.numbers(words[2], 3 * int(words[1])).reshape(-1, 3)
        elif keyword in (*POLYDATA, "CELLS"):
            self.cells[keyword] = self.topology(int(words[1]), int(words[2]))
        elif keyword == "CELL_TYPES":
            self.types = self.numbers("int", int(words[1]))
        elif keyword in self.data:
            self.rows, self.of = int(words[1]), self.data[keyword]
        elif keyword == "METADATA":
            while self.line().strip():
                pass
        else:
            self.attribute(keyword, words)
        return True

    def topology(self, count: int, size: int) -> tuple[np.ndarray, np.ndarray]:
        """Points of cells, and where each cell ends."""
        if self.new_cells:
            offsets = self.numbers(self.line().split()[1], count)
            points = self.numbers(self.line().split()[1], size)
            return points, offsets[1:]
        # Each cell's number of points stands before them.
        flat = self.numbers("int", size).tolist()
        points, ends, place = [], [], 0
        for _ in range(count):
            length = flat[place]
            if length < 0 or place + 1 + length > size:
                raise ValueError("the numbers of points of its cells do not fit")
            points += flat[place + 1 : place + 1 + length]
            ends.append(len(points))
            place += 1 + length
        return np.array(points, np.int64), np.array(ends, np.int64)

    def attribute(self, keyword: str, words: list[str]) -> None:
        """Values at points or of cells."""
        if keyword == "SCALARS":
            width = int(words[3]) if len(words) > 3 else 1
            self.line()  # LOOKUP_TABLE
            self.of[words[1]] = self.numbers(words[2], width * self.rows).reshape(self.rows, width)
        elif keyword in WIDE:
            width = WIDE[keyword]
            self.of[words[1]] = self.numbers(words[2], width * self.rows).reshape(-1, width)
        elif keyword == "TEXTURE_COORDINATES":
            self.numbers(words[3], int(words[2]) * self.rows)
        elif keyword == "LOOKUP_TABLE":
            self.numbers("unsigned_char" if self.binary else "float", RGBA * int(words[2]))
        elif keyword == "FIELD":
            for _ in range(int(words[2])):
                name, width, rows, kind = self.array_head()
                values = self.numbers(kind, width * rows)
                # A field before any data is the file's own, not of points or cells.
                if rows == self.rows:
                    self.of[name] = values.reshape(rows, width)
        else:
            raise ValueError(f'its block "{words[0][:20]}" is not known')

    def array_head(self) -> tuple[str, int, int, str]:
        while True:
            words = self.line().split()
            if words and words[0].upper() == "METADATA":
                while self.line().strip():
                    pass
            elif words:
                name, width, rows, kind = words
                return name, int(width), int(rows), kind
            elif self.place >= len(self.content):
                raise ValueError("the file breaks off")

    def lines(self) -> LineSet:
        nothing = np.zeros(0, np.int64), np.zeros(0, np.int64)
        if self.dataset == "POLYDATA":
            counts = [len(self.cells.get(kind, nothing)[1]) for kind in POLYDATA]
            connectivity, offsets = self.cells.get("LINES", nothing)
            of_lines = np.arange(counts[0], counts[0] + counts[1])
            cells = sum(counts)
        else:
            cells = len(self.types)
            points, ends = self.cells.get("CELLS", nothing)
            connectivity, offsets, of_lines = select_lines(points, ends, self.types)
        if len(of_lines) == 0:
            raise ValueError("it has no lines")
        return line_set(
            self.points,
            (connectivity, offsets),
            {k: v for k, v in self.data["POINT_DATA"].items() if len(v) == len(self.points)},
            {k: v[of_lines] for k, v in self.data["CELL_DATA"].items() if len(v) == cells},
            others=cells - len(of_lines),
        )
