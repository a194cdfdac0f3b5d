"""Whether cells get the size that a part's von Mises stress asks for.

    python3 studies/warp/size_law.py [--part FANDISK.obj --unit cm] [--again]

The built-in cantilever and bracket, and the part of a file, clamped at its lowest tenth and pressed on
its highest; 16 to 20 cells along the longest axis, margin 1, contrast 3, f smoothed over one cell.
Writes results/size_law.json, results/size_law.md and docs/images/warp_size_law.png.
"""

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np
from drawn_grids import panels, save
from kept_results import IMAGES, Row, markdown, started
from part_stress import PartStress, builtin_stress, clamped_and_pressed

from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warp.occupied import occupied_volume
from texmap_opt.warp.quality import achieved_sizes, quality, wanted_sizes
from texmap_opt.warp.successive_approximation import SuccessiveApproximation
from texmap_opt.warp.warp import AbstractWarp

CONTRAST, CELLS = 3.0, 18
METHODS: dict[str, AbstractWarp] = {
    "printed": SuccessiveApproximation(max_sweeps=5000),
    "midpoint": SuccessiveApproximation(weights="midpoint", max_sweeps=5000),
    "least-squares": LeastSquares(max_steps=3000),
}
# Dots of a picture, at most.
DOTS = 600


def measure(stressed: PartStress, warp: AbstractWarp) -> Row:
    """Slope and correlation over all cells and over those in the part."""
    longest = float(np.ptp(stressed.part.bounds, axis=0).max())
    grid = stressed.grid(longest / CELLS)
    f = stressed.function(grid, contrast=CONTRAST)
    result = warp.fit(grid, f)
    occupied = occupied_volume(result.grid, stressed.part.surface)
    measured = quality(result.grid, f, weights=occupied)
    wanted, achieved = np.log(wanted_sizes(result.grid, f)), np.log(achieved_sizes(result.grid))
    shown = slice(None, None, max(1, len(wanted) // DOTS))
    # Cells that a fold has turned inside out have no size.
    usable = np.isfinite(achieved[shown])
    return {
        "cells": " x ".join(map(str, result.grid.cells)),
        "nodes": len(stressed.stress.mesh.nodes),
        "wanted_contrast": float(np.exp(np.ptp(wanted))),
        "slope": measured.size_slope,
        "correlation": measured.size_correlation,
        "part_slope": measured.part_size_slope,
        "part_correlation": measured.part_size_correlation,
        "folded": measured.folded_cells,
        "min_jacobian": measured.min_jacobian,
        "aspect": measured.max_aspect,
        "steps": result.iterations,
        "gain": result.measures.get("gain"),
        "converged": result.converged,
        "wanted": wanted[shown][usable].round(3).tolist(),
        "achieved": achieved[shown][usable].round(3).tolist(),
    }


def draw(rows: dict[str, Row], parts: list[str]) -> None:
    """Achieved over wanted size of the cells, part by part."""
    figure, axes = panels(len(parts))
    for panel, part in zip(axes, parts, strict=True):
        for method, colour in (("printed", "tab:orange"), ("least-squares", "tab:blue")):
            row = rows[f"{part}, {method}"]
            panel.plot(
                row["wanted"],
                row["achieved"],
                ".",
                color=colour,
                markersize=2,
                label=f"{method}: slope {row['slope']:.2f}, correlation {row['correlation']:.3f}",
            )
        panel.axline((0, 0), slope=1, color="0.3", linewidth=0.8)
        panel.set(xlabel="log wanted size", ylabel="log achieved size", title=part)
        panel.legend(fontsize=8, markerscale=4)
    save(figure, IMAGES / "warp_size_law.png")


def _not_given() -> PartStress:
    raise SystemExit("Rows of a part are missing whose file is not given: give it with --part.")


def main() -> None:
    """Measure what is not known yet; write the table and the figure."""
    kept, given = started(
        "size_law",
        __doc__,
        part={"type": Path, "help": "a surface file, such as fandisk.obj"},
        unit={"default": "cm", "help": "of its coordinates: mm, cm, m, in"},
        edge={"type": float, "default": 5.0, "help": "of its tets [mm]"},
    )
    parts: dict[str, Callable[[], PartStress]] = {
        name: partial(builtin_stress, name) for name in ("cantilever", "bracket")
    }
    if given.part:
        parts[given.part.stem] = partial(
            clamped_and_pressed, given.part, unit=given.unit, edge_mm=given.edge
        )
    # Parts of other people's files stay in the table when their file is not given again.
    known = dict.fromkeys([*parts, *(key.rsplit(", ", 1)[0] for key in kept.rows)])
    lines = []
    for part in known:
        stressed = cache(parts.get(part, _not_given))
        for method, warp in METHODS.items():
            row = kept.row(
                f"{part}, {method}",
                lambda stressed=stressed, warp=warp: measure(stressed(), warp),
            )
            names = (
                *("cells", "nodes", "wanted_contrast", "slope", "correlation", "part_slope"),
                *(
                    "part_correlation",
                    "folded",
                    "min_jacobian",
                    "aspect",
                    "steps",
                    "gain",
                    "converged",
                ),
            )
            shown = [f"{row[n]:.4f}" if "correlation" in n else row[n] for n in names]
            lines.append([part, method, *shown])
    head = (
        "part",
        "method",
        "cells",
        "nodes of the tets",
        "largest over smallest wanted size",
        "slope",
        "correlation",
        "slope in the part",
        "correlation there",
        "folded",
        "smallest B/s³",
        "worst edge ratio",
        "steps",
        "gain of another",
        "converged",
    )
    kept.write_table(markdown(head, lines))
    draw(kept.rows, list(known))


if __name__ == "__main__":
    main()
