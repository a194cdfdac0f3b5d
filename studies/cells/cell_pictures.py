"""Pictures of the cells for docs/cells.md: one alone, and with its neighbours."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from PIL import Image

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.drawn_cell import drawn_cell
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.report.drawing import cell_scene, draw
from texmap_opt.structure.tile import tile

IMAGES = Path(__file__).parents[2] / "docs" / "images" / "cells"
# Edge of one of the two halves of a picture [pixels], and quality of the JPEG: below 25 kB each.
HALF = 280
QUALITY = 62

# All cells are drawn as thick as at this relative density.
DRAWN_DENSITY = 0.1
# Height of extruded cells over their first edge, in pictures.
LOW = 0.45

# What README shows of the library.
OVERVIEW = (
    "octet",
    "tetrakaidecahedron",
    "dodecahedron",
    "rhombic-dodecahedron",
    "column",
    "honeycomb",
    "octagon",
    "rubber-band",
)

DARK, PALE, LINE = "#3f5468", "#c9d3dc", "#93a2b1"
TIMEOUT_S = 900.0

# Rounding of places in a face, in cell edges.
ON_FACE = 1e-9


def drawn_radius(results: dict[str, dict], name: str) -> float:
    """Radius that a cell is drawn with, in cell edges."""
    rows = results[name]["rows"]
    return next(row["radius"] for row in rows if row["density"] == DRAWN_DENSITY)


def draw_pictures(names: Sequence[str], results: dict[str, dict]) -> None:
    """Draw cells into docs/images/cells, side by side alone and in a block."""
    IMAGES.mkdir(parents=True, exist_ok=True)
    cells = [unit_cell(name) for name in names]
    scenes = {}
    for cell in cells:
        radius = drawn_radius(results, cell.name)
        scenes[cell.name] = cell_scene(_alone(cell, radius))
        if cell.dimensions == 3:
            block = drawn_cell(cell, repeat=2, edge_mm=1.0, radius_mm=radius)
            scenes[f"{cell.name}-block"] = cell_scene(block)
    with tempfile.TemporaryDirectory() as folder:
        drawn = draw(scenes, Path(folder), timeout_s=TIMEOUT_S)
        if drawn.missing:
            raise SystemExit(f"no picture: {drawn.missing}")
        for cell in cells:
            alone = _cropped(drawn.pictures[cell.name])
            if cell.dimensions == 3:
                block = _cropped(drawn.pictures[f"{cell.name}-block"])
            else:
                block = _plan(cell, drawn_radius(results, cell.name))
            _save([alone, block], IMAGES / f"{cell.name}.jpg")
    if "bi-stable" in names:
        draw_snap(drawn_radius(results, "bi-stable"))


def draw_snap(radius: float) -> None:
    """Both stable shapes of the bi-stable cell: as made, and with its arches mirrored at their ends."""
    cell = unit_cell("bi-stable")
    figure = Figure(figsize=(2 * HALF / 100, HALF / 100), dpi=100, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    made, snapped = figure.subplots(1, 2, sharey=True)
    for axes, joints, title in (
        (made, cell.joints, "as made"),
        (snapped, snapped_joints(cell), "snapped through"),
    ):
        height = float(joints[:, 1].max())
        for row, column in ((0, 0), (0, 1), (1, 0), (1, 1)):
            placed = joints + np.array([column, 0.0])
            if row:  # Odd rows are reflected.
                placed = np.stack([placed[:, 0], 2 * height - placed[:, 1]], axis=1)
            colour = PALE if row or column else DARK
            _walls(axes, placed[cell.struts], radius * cell.relative_radius, colour)
        axes.set(xlim=(-0.1, 2.1), ylim=(-0.1, 2.1), aspect="equal")
        axes.set_title(title, fontsize=12)
        axes.set_axis_off()
    canvas.draw()
    _save([Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")], IMAGES / "snap.jpg")


def snapped_joints(cell: UnitCell) -> Float[np.ndarray, "joints 2"]:
    """Joints of the bi-stable cell with each arch mirrored at the line of its two ends.

    Clamped arches in the first buckling mode have that as their second stable shape (Qiu, Lang, Slocum,
    J. MEMS 13 (2004) 137); the stem follows, posts and tie stay.
    """
    joints = cell.joints.copy()
    number = {name: k for k, name in enumerate(cell.joint_names)}
    drop = 0.0
    for arch in "ab":
        links = [k for name, k in number.items() if name[0] == arch and name[1:].isdigit()]
        foot = joints[number[f"{arch}0"], 1]
        drop = 2 * float(joints[links, 1].max() - foot)
        joints[links, 1] = 2 * foot - joints[links, 1]
    joints[number["tip"], 1] -= drop
    return joints


def _alone(cell: UnitCell, radius: float):
    structure = drawn_cell(cell, edge_mm=1.0, radius_mm=radius)
    if cell.dimensions == 3:
        return structure
    return structure.extruded(np.array([0.0, 0.0, 1.0]), np.array([0.0, LOW]))


def _plan(cell: UnitCell, radius: float) -> Image.Image:
    """The cross-section of a cell, dark, and what is around it."""
    # The third of five along each axis: an even cell, which is not reflected.
    net = tile(cell, (5, 5))
    scale = np.array(cell.proportions)
    figure = Figure(figsize=(HALF / 100, HALF / 100), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.02, 0.02, 0.96, 0.96))
    ends = net.joints[net.struts]
    inside = ((ends >= 2 - ON_FACE) & (ends <= 3 + ON_FACE)).all(axis=(1, 2))
    for shown, colour in ((~inside, PALE), (inside, DARK)):
        _walls(axes, (ends * scale)[shown], radius * net.relative_radius[shown], colour)
    corners = np.array([[2, 2], [3, 2], [3, 3], [2, 3], [2, 2]]) * scale
    axes.plot(*corners.T, color=LINE, linewidth=1.2, linestyle="--")
    middle = 2.5 * scale
    # Enough of the cells around to see how the middle one goes on.
    low, high = (middle + side * (0.5 * scale.max() + 0.45) for side in (-1, 1))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set_axis_off()
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def _walls(
    axes: Axes,
    ends: Float[np.ndarray, "struts 2 2"],
    radius: Float[np.ndarray, " struts"],
    colour: str,
) -> None:
    """Walls to scale, their joints rounded."""
    along = ends[:, 1] - ends[:, 0]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    side = radius[:, None] * np.stack([-along[:, 1], along[:, 0]], axis=1)
    first, last = ends[:, 0], ends[:, 1]
    quads = np.stack([first - side, last - side, last + side, first + side], axis=1)
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    discs = ends.reshape(-1, 1, 2) + np.repeat(radius, 2)[:, None, None] * ring
    for shapes in (quads, discs):
        axes.add_collection(PolyCollection(list(shapes), facecolors=colour, linewidths=0))


def draw_overview() -> None:
    """Eight cells in two rows, for README, out of their pictures."""
    halves = []
    for name in OVERVIEW:
        with Image.open(IMAGES / f"{name}.jpg") as opened:
            halves.append(opened.crop((0, 0, HALF, HALF)))
    rows = len(halves) // 2
    whole = Image.new("RGB", (rows * HALF, 2 * HALF), "white")
    for number, half in enumerate(halves):
        whole.paste(half, (number % rows * HALF, number // rows * HALF))
    whole.save(IMAGES.with_suffix(".jpg"), quality=QUALITY, optimize=True)


def _cropped(png: Path) -> Image.Image:
    """What is drawn, in a square with a little room around."""
    with Image.open(png) as opened:
        image = opened.convert("RGB")
    drawn = np.argwhere((np.asarray(image) < 250).any(axis=-1))
    (top, left), (bottom, right) = drawn.min(axis=0), drawn.max(axis=0)
    side = int(1.04 * max(bottom - top, right - left))
    square = Image.new("RGB", (side, side), "white")
    part = image.crop((int(left), int(top), int(right) + 1, int(bottom) + 1))
    square.paste(part, ((side - part.width) // 2, (side - part.height) // 2))
    return square.resize((HALF, HALF), Image.Resampling.LANCZOS)


def _save(parts: Sequence[Image.Image], path: Path) -> None:
    whole = Image.new("RGB", (sum(part.width for part in parts), parts[0].height), "white")
    left = 0
    for part in parts:
        whole.paste(part, (left, 0))
        left += part.width
    whole.save(path, quality=QUALITY, optimize=True)
