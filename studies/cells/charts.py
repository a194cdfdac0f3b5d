"""Charts of docs/cells.md: stiffness against density beside the bounds, and against its direction."""

import io
from collections.abc import Sequence

import numpy as np
from cell_pictures import IMAGES
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator
from PIL import Image
from scipy.optimize import isotonic_regression

from fea.stiffness_bounds import hashin_shtrikman_bound, plane_hashin_shtrikman_bound, voigt_bound
from texmap_opt.cells.at_density import POISSON
from texmap_opt.cells.catalogue import unit_cell

INK, STRETCHING, BENDING, BOUND = "#22292f", "#1f6fd6", "#c8501e", "#7b8791"
DOTS_PER_INCH, COLOURS = 100, 64
# Least distance of labels, as a share of the height of a chart.
SPACING = 0.034
MARKERS = "osD^v<>ph8*PXds"


def draw_charts(results: dict[str, dict]) -> None:
    """All three charts, into docs/images/cells."""
    by_dimensions = {
        d: {name: row for name, row in results.items() if unit_cell(name).dimensions == d}
        for d in (2, 3)
    }
    _stiffness(
        by_dimensions[3], "E 100", "Young's modulus along [100] over the solid's", "stiffness"
    )
    _stiffness(
        by_dimensions[2], "E x", "Young's modulus along x over the solid's", "stiffness_plane"
    )
    _directions(by_dimensions[3])


def _stiffness(results: dict[str, dict], quantity: str, label: str, name: str) -> None:
    figure, axes = _figure()
    labels = []
    for marker, (cell, result) in zip(MARKERS, results.items(), strict=False):
        density, E = (
            np.array([row[key] for row in result["rows"]]) for key in ("density", quantity)
        )
        colour = STRETCHING if unit_cell(cell).classification == "stretching" else BENDING
        axes.plot(density, E, color=colour, linewidth=1.3, marker=marker, markersize=4)
        labels.append((float(E[-1]), cell, colour))
    rho = np.geomspace(0.01, 0.3, 40)
    bounds = {"Voigt": [voigt_bound(1.0, float(r)) for r in rho]}
    bound = hashin_shtrikman_bound if quantity == "E 100" else plane_hashin_shtrikman_bound
    bounds["Hashin-Shtrikman"] = [bound(1.0, POISSON, float(r)).E for r in rho]
    for kind, values in bounds.items():
        axes.plot(
            rho, values, color=BOUND, linewidth=2.2, linestyle="--" if kind == "Voigt" else "-"
        )
        labels.append((float(values[-1]), kind, BOUND))
    axes.set(
        xscale="log", yscale="log", xlim=(0.0095, 0.315), xlabel="relative density", ylabel=label
    )
    axes.xaxis.set_major_locator(FixedLocator([0.01, 0.02, 0.05, 0.1, 0.2, 0.3]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda mark, _: f"{mark:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    _right_labels(axes, labels)
    _save(figure, name)


def _directions(results: dict[str, dict]) -> None:
    """How stiff, and how alike in all directions, at one density."""
    figure, axes = _figure()
    labels = []
    for cell, result in results.items():
        row = next(row for row in result["rows"] if row["density"] == 0.1)
        colour = STRETCHING if unit_cell(cell).classification == "stretching" else BENDING
        axes.scatter(row["E_min"], row["E_max"], s=42, color=colour, zorder=3)
        labels.append((row["E_max"], cell, colour, row["E_min"]))
    axes.plot([1e-4, 0.1], [1e-4, 0.1], color=BOUND, linewidth=2.2)
    axes.text(
        2.5e-3,
        2.0e-3,
        "equal in all directions",
        rotation=45,
        rotation_mode="anchor",
        transform_rotates_text=True,
        color=BOUND,
    )
    axes.set(
        xscale="log",
        yscale="log",
        xlim=(1.5e-4, 0.03),
        ylim=(1.5e-3, 0.1),
        xlabel="least Young's modulus over all directions, over the solid's",
        ylabel="largest Young's modulus, over the solid's",
    )
    _right_labels(axes, [label[:3] for label in labels], from_x=[label[3] for label in labels])
    _save(figure, "directions")


def _figure() -> tuple[Figure, Axes]:
    figure = Figure(figsize=(8.4, 6.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.grid(visible=True, color="#e3e8ec", linewidth=0.8)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return figure, axes


def _right_labels(
    axes: Axes, labels: Sequence[tuple[float, str, str]], *, from_x: Sequence[float] | None = None
) -> None:
    """Names to the right of the chart, apart from each other, with lines to where they belong."""
    low, high = np.log(np.array(axes.get_ylim()))
    at = np.array([(np.log(value) - low) / (high - low) for value, _, _ in labels])
    order = np.argsort(at)
    place = _spread(at[order])
    start = axes.get_xlim()
    for k, y in zip(order, place, strict=True):
        _, text, colour = labels[k]
        x = 1.0
        if from_x is not None:
            x = float(np.log(from_x[k] / start[0]) / np.log(start[1] / start[0]))
        axes.annotate(
            text,
            xy=(x, at[k]),
            xytext=(1.035, y),
            xycoords="axes fraction",
            textcoords="axes fraction",
            color=colour,
            fontsize=9.5,
            va="center",
            annotation_clip=False,
            arrowprops={
                "arrowstyle": "-",
                "color": colour,
                "linewidth": 0.5,
                "alpha": 0.7,
                "relpos": (0, 0.5),
                "shrinkA": 2,
                "shrinkB": 0,
            },
        )


def _spread(wanted: Float[np.ndarray, " samples"]) -> Float[np.ndarray, " samples"]:
    """Ascending heights moved as little as may be so that none are too close: least squares.

    With the spacing taken off, heights must only ascend: isotonic regression.
    """
    steps = SPACING * np.arange(len(wanted))
    return isotonic_regression(np.clip(wanted, 0.0, 1.0) - steps).x + steps


def _save(figure: Figure, name: str) -> None:
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=DOTS_PER_INCH)
    with Image.open(drawn) as opened:
        opened.convert("RGB").quantize(COLOURS).save(IMAGES / f"{name}.png", optimize=True)
