"""A small sound case and its part, which tests change."""

import struct
from pathlib import Path

import numpy as np

from texmap_opt.case import DesignCase

BOX = np.array([[x, y, z] for x in (0, 40) for y in (0, 20) for z in (0, 20)], float)
FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip

CASE = """
[part]
file = "box.stl"
[material]
name = "PA12"
[analysis]
element = "tet4"
edge_mm = 6.0
[[support]]
region = { plane = { point = [0, 0, 0], normal = [1, 0, 0] } }
[[load]]
region = { plane = { point = [40, 0, 0], normal = [1, 0, 0] } }
force_N = [0, 0, -10]
[lattice]
cell = "bcc"
cell_mm = 10.0
skin_mm = 1.0
radius_mm = 0.8
[warp]
method = "uniform"
[output]
tolerance_mm = 0.1
pictures = false
"""


def write_stl(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """A binary STL without a check of any kind."""
    with path.open("wb") as file:
        file.write(b"test".ljust(80) + struct.pack("<I", len(faces)))
        for corners in vertices[faces]:
            file.write(struct.pack("<12fH", 0, 0, 0, *corners.reshape(-1), 0))


def changed_case(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write the part and the case, with some words replaced; returns the case's path."""
    text = CASE
    for old, new in changes:
        if old not in text:
            raise ValueError(f"the sound case has no {old!r}")
        text = text.replace(old, new, 1)
    folder.mkdir(exist_ok=True)
    write_stl(folder / "box.stl", BOX, FACES)
    (folder / "case.toml").write_text(text)
    return folder / "case.toml"


def case_of(folder: Path, *changes: tuple[str, str]) -> DesignCase:
    """The sound case with some words replaced."""
    return DesignCase.from_toml(changed_case(folder, *changes))
