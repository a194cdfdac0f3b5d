"""The report's plots as inline SVG that follows the page's colours."""

import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from texmap_opt.report.grid_layers import GridLayer
from texmap_opt.report.histograms import angle_shares, ratio_counts
from texmap_opt.report.overlay import DIVERGING
from texmap_opt.warp.quality import log_fit

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

# Layers of more cells than this are drawn as a picture within the plot.
MOST_POLYGONS = 2000


@dataclass(frozen=True, eq=False)
class PlotData:
    """Arrays behind the plots; one that is absent has no plot.

    Attributes:
        radii: of the struts [mm].
        utilisation: of the struts, worst stress over yield.
        lengths: of the struts [mm].
        strut_angles_deg: of the struts to the direction of the numerically largest principal stress.
        strut_weights: how much the angle of each strut counts.
        wanted_mm: cell size that was asked for.
        achieved_mm: cell size of the same cells that came out; NaN where inside out.
        turns_deg: per cell, load case and pair of axes: angle to the nearest principal axis.
        turn_weights: how much each counts.
        unturned_deg: the same of cells that are not turned.
        unturned_weights: likewise.
        layers: layers of the grid, coloured by achieved over wanted size.
    """

    radii: Float[np.ndarray, " struts"] | None = None
    utilisation: Float[np.ndarray, " struts"] | None = None
    lengths: Float[np.ndarray, " struts"] | None = None
    strut_angles_deg: Float[np.ndarray, " struts"] | None = None
    strut_weights: Float[np.ndarray, " struts"] | None = None
    wanted_mm: Float[np.ndarray, " cells"] | None = None
    achieved_mm: Float[np.ndarray, " cells"] | None = None
    turns_deg: Float[np.ndarray, " samples"] | None = None
    turn_weights: Float[np.ndarray, " samples"] | None = None
    unturned_deg: Float[np.ndarray, " samples"] | None = None
    unturned_weights: Float[np.ndarray, " samples"] | None = None
    layers: tuple[GridLayer, ...] = ()


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
    """Achieved against wanted cell size, with their fit and the line where both agree."""

    def draw(axes: Any) -> None:
        good = np.isfinite(achieved_mm)
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
        slope, _ = log_fit(x, y)
        if slope is not None:
            ends = np.array([x.min(), x.max()])
            fit = np.exp(np.log(y).mean() + slope * (np.log(ends) - np.log(x).mean()))
            axes.plot(ends, fit, color=INK, linewidth=1.4)
        _log_sizes(axes, low, high)
        axes.set_xlabel("wanted cell size [mm]")
        axes.set_ylabel("achieved [mm]")

    return _svg(draw, "achieved against wanted cell size")


def _log_sizes(axes: Any, low: float, high: float) -> None:
    """Both axes logarithmic from low to high, with a handful of plain numbers."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    marks = [float(f"{mark:.2g}") for mark in np.geomspace(low, high, 6)[1:-1]]
    axes.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(FixedLocator(marks))
        axis.set_major_formatter(FuncFormatter(lambda mark, _: f"{mark:g}"))
        axis.set_minor_locator(NullLocator())


def size_ratios(
    wanted_mm: Float[np.ndarray, " cells"], achieved_mm: Float[np.ndarray, " cells"]
) -> str:
    """Counts of cells over achieved over wanted size, in equal steps of its logarithm."""

    def draw(axes: Any) -> None:
        count, edges = ratio_counts(achieved_mm / wanted_mm)
        axes.bar(
            edges[:-1], count, np.diff(edges), align="edge", color=FIRST, edgecolor=FIRST, alpha=0.9
        )
        axes.axvline(1.0, color=SECOND, linewidth=1.6, linestyle="--")
        axes.set_xscale("log")
        marks = [0.5, 0.7, 0.85, 1.0, 1.2, 1.4, 2.0]
        axes.set_xticks(marks, [f"{mark:g}" for mark in marks])
        axes.set_xticks([], minor=True)
        axes.set_xlabel("achieved over wanted cell size")
        axes.set_ylabel("cells")

    return _svg(draw, "achieved over wanted cell size")


def turns(
    cells: tuple[Float[np.ndarray, " samples"], Float[np.ndarray, " samples"]],
    unturned: tuple[Float[np.ndarray, " samples"], Float[np.ndarray, " samples"]],
) -> str:
    """Angles to the nearest principal axis [deg] with their weights: of the cells, and unturned."""

    def draw(axes: Any) -> None:
        warped, edges = angle_shares(*cells, largest=45)
        uniform, _ = angle_shares(*unturned, largest=45)
        axes.stairs(100 * warped, edges, fill=True, color=FIRST, alpha=0.85, label="warped")
        axes.stairs(100 * uniform, edges, color=SECOND, linewidth=1.8, label="not turned")
        axes.set_xticks([0, 15, 30, 45])
        axes.set_xlabel("angle to the nearest principal axis [°]")
        axes.set_ylabel("share [%]")
        _legend(axes)

    return _svg(draw, "angles to the principal axes")


def strut_angles(
    angles_deg: Float[np.ndarray, " struts"], weights: Float[np.ndarray, " struts"]
) -> str:
    """Angles of struts to the direction of the largest principal stress, beside those of chance."""

    def draw(axes: Any) -> None:
        share, edges = angle_shares(angles_deg, weights, largest=90)
        axes.stairs(100 * share, edges, fill=True, color=FIRST, alpha=0.85, label="struts")
        # Directions at random: the part of the sphere between two angles.
        chance = -np.diff(np.cos(np.radians(edges)))
        axes.stairs(100 * chance, edges, color=SECOND, linewidth=1.8, label="at random")
        axes.set_xticks([0, 15, 30, 45, 60, 75, 90])
        axes.set_xlabel("angle to the largest principal stress [°]")
        axes.set_ylabel("share [%]")
        _legend(axes)

    return _svg(draw, "angles of struts to the largest principal stress")


def _legend(axes: Any) -> None:
    axes.legend(frameon=False, labelcolor=INK, fontsize=10)


def grid_layer(layer: GridLayer, *, half: float) -> str:
    """A layer of the grid laid flat, cells of the part coloured by achieved over wanted size.

    Args:
        layer: what is drawn.
        half: the colours reach from 1 - half to 1 + half.
    """
    across = [str(k + 1) for k in range(3) if k != layer.axis]

    def draw(axes: Any) -> None:
        from matplotlib.collections import LineCollection, PolyCollection

        inside = layer.meets & np.isfinite(layer.values)
        solid = len(layer.quads) > MOST_POLYGONS
        lines = {"linewidths": 0.35, "rasterized": solid}
        outside = list(layer.quads[~inside])
        axes.add_collection(
            PolyCollection(outside, facecolors="none", edgecolors=MUTED, alpha=0.6, **lines)
        )
        cells = PolyCollection(list(layer.quads[inside]), cmap=DIVERGING, edgecolors=INK, **lines)
        cells.set_array(layer.values[inside])
        cells.set_clim(1 - half, 1 + half)
        axes.add_collection(cells)
        axes.add_collection(LineCollection(list(layer.outline), colors=INK, linewidths=1.4))
        # The grid alone sets the frame, that all of it is seen.
        low, high = layer.quads.min(axis=(0, 1)), layer.quads.max(axis=(0, 1))
        margin = 0.02 * float((high - low).max())
        axes.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin))
        axes.set_aspect("equal")
        axes.grid(visible=False)
        axes.set(xticks=[], yticks=[])
        axes.set_xlabel(f"axis {across[0]} of the grid", fontsize=10)
        axes.set_ylabel(f"axis {across[1]}", fontsize=10)
        axes.spines["bottom"].set_visible(False)
        bar = axes.figure.colorbar(cells, ax=axes, shrink=0.8, aspect=16, pad=0.02)
        bar.outline.set_visible(False)
        bar.ax.tick_params(colors=MUTED, labelcolor=INK, length=0, labelsize=10)

    return _svg(draw, f"layer normal to axis {layer.axis + 1}")


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
