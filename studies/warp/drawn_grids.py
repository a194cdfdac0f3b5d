"""Grids and curves as pictures in files."""

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image

DOTS_PER_INCH, COLOURS = 100, 64


def panels(columns: int, *, rows: int = 1, width: float = 4.0) -> tuple[Figure, Sequence[Axes]]:
    """An empty figure and its axes, row by row; width of one of them in inches."""
    figure = Figure(figsize=(width * columns, width * rows), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, list(np.atleast_1d(figure.subplots(rows, columns)).ravel())


def grid_lines(nodes: Float[np.ndarray, "_ _ 2"]) -> list[Float[np.ndarray, "_ 2"]]:
    """The lines of a grid in the plane."""
    return [*nodes, *np.swapaxes(nodes, 0, 1)]


def draw_grid(axes: Axes, nodes: Float[np.ndarray, "_ _ 2"], *, colour: str = "0.35") -> None:
    """A grid in the plane, to scale and without axes."""
    axes.add_collection(LineCollection(grid_lines(nodes), colors=colour, linewidths=0.7))
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.autoscale_view()


def save(figure: Figure, path: Path) -> None:
    """Write a picture, with few colours to keep it small."""
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=DOTS_PER_INCH)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.open(drawn).convert("RGB").quantize(COLOURS).save(path, optimize=True)
