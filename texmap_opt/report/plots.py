"""The report's plots as inline SVG that follows the page's colours."""

import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

# Stand-ins that become the page's own colours, light or dark.
INK, MUTED, GRID = "#010203", "#010204", "#010205"
FIRST, SECOND = "#010206", "#010207"
PAGE_COLOURS = {
    INK: "var(--ink)",
    MUTED: "var(--muted)",
    GRID: "var(--line)",
    FIRST: "var(--accent)",
    SECOND: "var(--second)",
}

WIDTH_IN, HEIGHT_IN = 5.2, 3.0
BINS = 40


@dataclass(frozen=True, eq=False)
class PlotData:
    """Arrays behind the plots; one that is absent has no plot.

    Attributes:
        radii: of the struts [mm].
        utilisation: of the struts, worst stress over yield.
        lengths: of the struts [mm].
        wanted_mm: cell size that was asked for.
        achieved_mm: cell size of the same cells that came out.
    """

    radii: Float[np.ndarray, " struts"] | None = None
    utilisation: Float[np.ndarray, " struts"] | None = None
    lengths: Float[np.ndarray, " struts"] | None = None
    wanted_mm: Float[np.ndarray, " cells"] | None = None
    achieved_mm: Float[np.ndarray, " cells"] | None = None


def histogram(
    values: Float[np.ndarray, " samples"], label: str, *, limit: float | None = None
) -> str:
    """Counts of struts over a value, with a line at its limit."""

    def draw(axes: Any) -> None:
        finite = values[np.isfinite(values)]
        low, high = float(finite.min()), float(finite.max())
        if high - low < 1e-6 * max(abs(high), np.finfo(float).tiny):
            low, high = low - 0.1 * abs(low), high + 0.1 * abs(high) or 1.0
        axes.hist(finite, bins=np.linspace(low, high, BINS + 1), color=FIRST, rwidth=0.9)
        if limit is not None:
            axes.axvline(limit, color=SECOND, linewidth=1.6, linestyle="--")
        axes.set_xlabel(label)
        axes.set_ylabel("struts")

    return _svg(draw, label)


def convergence(history: Mapping[str, Sequence[float]]) -> str:
    """Compliance over the sizing iterations, and the volume where it is known."""

    def draw(axes: Any) -> None:
        compliance = np.asarray(history["compliance"], float)
        steps = np.arange(len(compliance))
        axes.plot(steps, compliance, color=FIRST, linewidth=2, marker="o", markersize=3.5)
        axes.set_xlabel("iteration")
        axes.set_ylabel("compliance [N mm]", color=FIRST)
        positive = compliance[compliance > 0]
        if len(positive) == len(compliance) > 0 and positive.max() > 20 * positive.min():
            axes.set_yscale("log")
        else:
            axes.set_ylim(bottom=0)
        volume = np.asarray(history.get("volume", ()), float)
        if len(volume):
            other = axes.twinx()
            other.plot(np.arange(len(volume)), volume, color=SECOND, linewidth=1.6, linestyle="--")
            other.set_ylim(0, 1.25 * volume.max())
            _style(other)
            other.grid(visible=False)
            other.set_ylabel("volume [mm³]", color=SECOND)

    return _svg(draw, "compliance over iterations")


def size_agreement(
    wanted_mm: Float[np.ndarray, " cells"], achieved_mm: Float[np.ndarray, " cells"]
) -> str:
    """Achieved against wanted cell size, with the line where both agree."""

    def draw(axes: Any) -> None:
        good = (
            np.isfinite(wanted_mm) & np.isfinite(achieved_mm) & (wanted_mm > 0) & (achieved_mm > 0)
        )
        x, y = wanted_mm[good], achieved_mm[good]
        low, high = min(x.min(), y.min()) * 0.95, max(x.max(), y.max()) * 1.05
        # One dot a cell up to a few hundred; beyond that dots on a raster, larger for more cells.
        edges = np.geomspace(low, high, 46)
        count, _, _ = np.histogram2d(x, y, bins=[edges, edges])
        i, j = np.nonzero(count)
        centre = np.sqrt(edges[1:] * edges[:-1])
        area = 4 + 46 * np.sqrt(count[i, j] / count.max())
        axes.plot([low, high], [low, high], color=SECOND, linewidth=1.4, linestyle="--")
        axes.scatter(centre[i], centre[j], s=area, color=FIRST, alpha=0.75, linewidths=0)
        axes.set_xlim(low, high)
        axes.set_ylim(low, high)
        axes.set_xlabel("wanted cell size [mm]")
        axes.set_ylabel("achieved [mm]")

    return _svg(draw, "achieved against wanted cell size")


def stage_times(seconds: Mapping[str, float]) -> str:
    """A bar for each stage."""
    names = list(seconds)
    height = 0.6 + 0.3 * len(names)

    def draw(axes: Any) -> None:
        places = np.arange(len(names))
        values = np.array([seconds[name] for name in names], float)
        axes.barh(places, values, color=FIRST, height=0.62)
        for place, value in zip(places, values, strict=True):
            axes.annotate(
                f"{value:.3g} s",
                (value, place),
                xytext=(5, 0),
                textcoords="offset points",
                va="center",
                color=INK,
                fontsize=10,
            )
        axes.set_yticks(places, names)
        axes.invert_yaxis()
        axes.set_xlim(0, 1.15 * max(values.max(), 1e-3))
        axes.set_xticks([])
        axes.grid(visible=False)
        axes.spines["bottom"].set_visible(False)

    return _svg(draw, "seconds per stage", width=2 * WIDTH_IN, height=height)


def _svg(
    draw: Callable[[Any], None], title: str, *, width: float = WIDTH_IN, height: float = HEIGHT_IN
) -> str:
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    figure.patch.set_alpha(0)
    axes = figure.add_subplot()
    _style(axes)
    draw(axes)
    out = io.StringIO()
    # Text stays text; ids depend only on the plot, and files on the data alone.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": title}):
        FigureCanvasSVG(figure).print_svg(
            out, metadata=dict.fromkeys(("Date", "Creator", "Format", "Type"))
        )
    return _for_page(out.getvalue(), title)


def _style(axes: Any) -> None:
    axes.patch.set_alpha(0)
    for side, spine in axes.spines.items():
        spine.set_visible(side == "bottom")
        spine.set_color(MUTED)
    axes.grid(visible=True, axis="y", color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(colors=MUTED, labelcolor=INK, length=0, labelsize=10)
    axes.xaxis.label.set_color(INK)
    axes.yaxis.label.set_color(INK)


def _for_page(svg: str, title: str) -> str:
    """The SVG element alone, with ids of its own and the page's colours."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r' xmlns(:\w+)?="[^"]*"', "", svg)
    prefix = re.sub(r"\W+", "-", title)
    svg = re.sub(r'\bid="', f'id="{prefix}-', svg)
    svg = re.sub(r"url\(#", f"url(#{prefix}-", svg)
    svg = svg.replace('xlink:href="#', f'href="#{prefix}-')
    # Its style sheet would hold for the whole page; the page has a font of its own.
    svg = re.sub(r"<style.*?</style>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"font-family: [^;\"]*", "font-family: inherit", svg)
    for stand_in, colour in PAGE_COLOURS.items():
        svg = svg.replace(stand_in, colour)
    return svg.replace("<svg ", f'<svg role="img" aria-label="{title}" ', 1)
