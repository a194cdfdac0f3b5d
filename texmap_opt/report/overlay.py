"""Colour bars, numbers and legends over a rendered picture."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from jaxtyping import Bool, Float

INK = "#22292f"
DPI = 100

# Of a curve in a picture of its own, and the size of that.
CURVE = "#1f6fd6"
POLAR_INCHES = (7.0, 7.0)

SECTION_COLOUR = "#e39a4f"
SECTION_EDGE_COLOUR = "#9a5a1c"

# Too small blue, too large red, good in the middle.
DIVERGING = "RdBu_r"
# The least half width of such a scale, as a share of its middle: less than this is no error.
LEAST_HALF = 0.05

# Of kinds of cells: blue, orange, green, purple, sky, yellow, red, told apart by colour-blind eyes too
# (Okabe, Ito, "Color universal design", 2008).
KIND_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#f0e442", "#d55e00")

# Width of the rim of a section, in pixels of the rendered picture.
RIM_PIXELS = 2


@dataclass(frozen=True)
class Bar:
    """A colour bar.

    Attributes:
        title: what the colour shows, with its unit.
        colours: name of a matplotlib colour map, or one colour for each whole number from low to high.
        low: value of the lowest colour.
        high: value of the highest colour.
        beyond: largest value there is, when it lies above `high`.
    """

    title: str
    colours: str | list[str]
    low: float
    high: float
    beyond: float | None = None
    beyond_colour: str | None = None


@dataclass(frozen=True)
class Badge:
    """A numbered spot at a place in the picture [pixels from the top left]."""

    x: float
    y: float
    number: int
    colour: str


@dataclass(frozen=True, eq=False)
class Overlay:
    """What is put over a rendered picture.

    Attributes:
        bar: the colour bar.
        badges: numbers on the picture.
        legend: rows of number (0: none), text and colour.
        section: pixels of the rendered picture where a solid was cut.
    """

    bar: Bar | None = None
    badges: tuple[Badge, ...] = ()
    legend: tuple[tuple[int, str, str], ...] = ()
    section: Bool[np.ndarray, "h w"] | None = None


def colour_range(
    values: Float[np.ndarray, " samples"],
    *,
    from_zero: bool = False,
    middle: float | None = None,
) -> tuple[float, float, float | None]:
    """Lowest and highest colour, and the peak where it is cut off.

    A few values at a singular corner would leave one colour for the rest: the scale ends at the
    99.5th percentile when the peak is more than a quarter above it. Around a `middle` both ends are
    equally far, as the farthest of 99.5 % of the values.
    """
    values = values[np.isfinite(values)]
    if not len(values):
        return 0.0, 1.0, None
    if middle is not None:
        half = max(float(np.percentile(np.abs(values - middle), 99.5)), LEAST_HALF * middle)
        peak = float(values.max())
        return middle - half, middle + half, peak if peak > middle + 1.25 * half else None
    low = 0.0 if from_zero else float(values.min())
    high, peak = float(np.percentile(values, 99.5)), float(values.max())
    cut = peak > low + 1.25 * (high - low) and high > low
    high = high if cut else peak
    if high - low <= 1e-6 * max(abs(high), abs(low), np.finfo(float).tiny):
        # All the same: a scale around it.
        half = 0.05 * abs(high) or 1.0
        return low - half, high + half, None
    return low, high, peak if cut else None


def kinds_bar(names: Sequence[str]) -> Bar:
    """Colours of values that are indices of names; beyond the palette they begin again."""
    colours = [KIND_COLOURS[k % len(KIND_COLOURS)] for k in range(len(names))]
    return Bar("", colours, -0.5, len(names) - 0.5)


def write_picture(pixels: Float[np.ndarray, "h w 3"], overlay: Overlay, png: Path) -> None:
    """Write the picture with its overlay; the file appears whole or not at all."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    height, width = pixels.shape[:2]
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI)
    canvas = FigureCanvasAgg(figure)
    figure.figimage(pixels / 255, zorder=-1)
    if overlay.bar:
        _bar(figure, overlay.bar)
    for badge in overlay.badges:
        _spot(figure, badge.x / width, 1 - badge.y / height, badge.number, badge.colour)
    for row, (number, text, colour) in enumerate(overlay.legend):
        y = 0.958 - 0.036 * row
        _spot(figure, 0.032, y, number, colour)
        figure.text(0.052, y, text, color=INK, fontsize=13, va="center", ha="left")
    half_written = png.with_suffix(".part")
    canvas.print_figure(half_written, format="png", dpi=DPI)
    half_written.replace(png)


def write_polar(
    angle: Float[np.ndarray, " samples"],
    values: Float[np.ndarray, " samples"],
    file: BinaryIO,
    *,
    quantity: str,
) -> None:
    """Write a curve round the origin, its distance the value, as PNG.

    Args:
        angle: to x [rad], over a whole turn.
        values: above zero.
        file: open for writing.
        quantity: what the values are; lines end with a newline.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=POLAR_INCHES, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    axes: Any = figure.add_subplot(projection="polar")
    closed = [np.append(each, each[0]) for each in (angle, values)]
    axes.fill(*closed, color=CURVE, alpha=0.25, linewidth=0)
    axes.plot(*closed, color=CURVE, linewidth=2.5)
    axes.set_rlim(0, 1.08 * float(values.max()))
    axes.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
    axes.set_thetagrids([0, 45, 90, 135, 180, 225, 270, 315], ["x", "", "y", "", "", "", "", ""])
    axes.tick_params(labelsize=13, labelcolor=INK)
    axes.set_rlabel_position(22)
    axes.set_title(quantity.replace("\n", " "), color=INK, fontsize=14, weight="bold")
    canvas.print_figure(file, format="png", dpi=DPI)


def paint_section(image: np.ndarray, section: np.ndarray) -> None:
    """Colour the pixels where a solid was cut, with a darker rim, in place."""
    # Closing: between neighbouring triangles single pixels may show what lies behind.
    section = ~_grown(~_grown(section))
    inner = section
    for _ in range(RIM_PIXELS):
        inner = ~_grown(~inner)
    image[section] = _rgb(SECTION_EDGE_COLOUR)
    image[inner] = _rgb(SECTION_COLOUR)


def _grown(mask: np.ndarray) -> np.ndarray:
    """The mask and the pixels beside it."""
    grown = mask.copy()
    grown[1:] |= mask[:-1]
    grown[:-1] |= mask[1:]
    wide = grown.copy()
    wide[:, 1:] |= grown[:, :-1]
    wide[:, :-1] |= grown[:, 1:]
    return wide


def _rgb(colour: str) -> tuple[int, ...]:
    return tuple(bytes.fromhex(colour.removeprefix("#")))


def _spot(figure: Any, x: float, y: float, number: int, colour: str) -> None:
    text = str(number) if number else "  "
    figure.text(
        x,
        y,
        text,
        color="white",
        fontsize=11.5,
        weight="bold",
        ha="center",
        va="center",
        bbox={
            "boxstyle": "circle,pad=0.28",
            "facecolor": colour,
            "edgecolor": "white",
            "linewidth": 1.6,
        },
    )


def _bar(figure: Any, bar: Bar) -> None:
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize
    from matplotlib.ticker import MaxNLocator

    axes = figure.add_axes((0.885, 0.16, 0.02, 0.58))
    colours = (
        colormaps[bar.colours] if isinstance(bar.colours, str) else ListedColormap(bar.colours)
    )
    if bar.beyond is not None:
        colours = colours.copy()
        colours.set_over(bar.beyond_colour or colours(1.0))
    scale = ScalarMappable(Normalize(bar.low, bar.high), colours)
    drawn = figure.colorbar(
        scale, cax=axes, extend="neither" if bar.beyond is None else "max", extendfrac=0.035
    )
    drawn.ax.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
    drawn.outline.set_linewidth(0)
    drawn.ax.tick_params(labelsize=13, length=5, width=1, color=INK, labelcolor=INK, pad=5)
    figure.text(
        0.985,
        0.845,
        bar.title,
        color=INK,
        fontsize=14,
        weight="bold",
        ha="right",
        va="center",
        linespacing=1.3,
    )
    if bar.beyond is not None:
        figure.text(
            0.985,
            0.79,
            f"largest {bar.beyond:.3g}",
            color=INK,
            fontsize=12,
            ha="right",
            va="center",
        )
