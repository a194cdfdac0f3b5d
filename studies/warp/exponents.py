"""How the size of a cell follows f, by method: the exponent p of size ~ f^-p, measured.

    python3 studies/warp/exponents.py [--again]

f = F^((1 - cos 2 pi x) / 2) varies along x by a factor F and not across; 48 cells along x, two across,
faces sliding. Writes results/exponents.json, results/exponents.md and docs/images/warp_exponents.png.
"""

from dataclasses import dataclass

import numpy as np
from drawn_grids import panels, save
from jaxtyping import Float
from kept_results import IMAGES, Row, markdown, started

from texmap_opt.box import Box
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warp.quality import achieved_sizes
from texmap_opt.warp.successive_approximation import SuccessiveApproximation
from texmap_opt.warp.warp import AbstractWarp
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.warping_function import WarpingFunction

CELLS, ACROSS = 48, 2
# The contrast limit is this power of what f asks for: below half the limit it cuts 0.05 %.
ROOM = 4


@dataclass(frozen=True)
class Trial:
    """One measurement: a method, the factor F by which f varies, the exponent asked for."""

    name: str
    warp: AbstractWarp
    factor: float
    exponent: float = 1.0
    dimensions: int = 3

    @property
    def key(self) -> str:
        """What it is kept under."""
        return f"{self.name}, {self.dimensions}-D, F = {self.factor:g}, p = {self.exponent:g}"

    @property
    def grid(self) -> Grid:
        """Cubes, or squares, in a row along x."""
        box = Box.aligned(
            np.array([[0.0, 0.0, 0.0], [1.0, ACROSS / CELLS, ACROSS / CELLS]]),
            extrusion="z" if self.dimensions == 2 else None,
        )
        return Grid.uniform(box, (CELLS, *[ACROSS] * (self.dimensions - 1)))

    def f(self, points: Float[np.ndarray, "samples _"]) -> Float[np.ndarray, " samples"]:
        """The formula, as a function of x."""
        return self.factor ** ((1 - np.cos(2 * np.pi * points[:, 0])) / 2)


def trials() -> list[Trial]:
    """Printed and midpoint iteration, and least squares with several exponents."""
    iterations = [
        Trial(weights, SuccessiveApproximation(weights=weights), factor)
        for weights in ("printed", "midpoint")
        for factor in (1.3, 3.0)
    ]
    squares = [
        Trial("least-squares", LeastSquares(gtol=1e-6), factor, exponent, dimensions)
        for dimensions in (2, 3)
        for exponent in (0.5, 1.0, 2.0)
        for factor in (1.3, 1.7)
    ]
    heavy = Trial("least-squares, size_weight 100", LeastSquares(100.0, gtol=1e-6), 1.7, 2.0)
    return [*iterations, *squares, heavy]


def measure(trial: Trial) -> Row:
    """Exponents of the cell's edge along x and of its size, by linear regression of logarithms."""
    grid = trial.grid
    law = SizeLaw(trial.exponent, trial.factor ** (ROOM * trial.exponent))
    f = WarpingFunction.from_formula(
        trial.f, grid.box, spacing_mm=float(grid.uniform_edge[0]) / 2, law=law
    )
    result = trial.warp.fit(grid, f)
    size = achieved_sizes(result.grid)
    corners = result.grid.nodes.reshape(-1, trial.dimensions)[grid.corners]
    edge = np.ptp(corners[..., 0], axis=1) / grid.uniform_edge[0]
    log_f = np.log(trial.f(result.grid.centres))
    return {
        "edge": -slope(log_f, np.log(edge)),
        "size": -slope(log_f, np.log(size)),
        "edge_contrast": float(edge.max() / edge.min()),
        "size_contrast": float(size.max() / size.min()),
        "gain": result.measures.get("gain"),
        "converged": result.converged,
        # One row of the cells along x; they are all alike.
        "log_f": log_f[:: ACROSS ** (trial.dimensions - 1)].round(4).tolist(),
        "log_size": np.log(size)[:: ACROSS ** (trial.dimensions - 1)].round(4).tolist(),
    }


def slope(x: Float[np.ndarray, " cells"], y: Float[np.ndarray, " cells"]) -> float:
    """Slope of the regression line of y over x."""
    return float(np.polyfit(x, y, 1)[0])


def draw(rows: dict[str, Row]) -> None:
    """Size of cells over f, with lines of the slope asked for."""
    figure, (axes,) = panels(1, width=5.5)
    for key, row in rows.items():
        if "F = 1.7" in key and "3-D" in key and "100" not in key:
            (line,) = axes.plot(row["log_f"], row["log_size"], ".", label=key)
            asked = -float(key.split("p = ")[1]) * np.array(row["log_f"])
            axes.plot(
                row["log_f"],
                asked - asked.mean() + np.mean(row["log_size"]),
                color=line.get_color(),
                linewidth=0.8,
            )
    axes.set(xlabel="log f at the middle of a cell", ylabel="log of the cube root of its volume")
    axes.set_title("dots: cells; lines: the slope asked for", fontsize=10)
    axes.legend(fontsize=8)
    save(figure, IMAGES / "warp_exponents.png")


def main() -> None:
    """Measure what is not known yet; write the table and the figure."""
    kept, _ = started("exponents", __doc__)
    lines = []
    for trial in trials():
        row = kept.row(trial.key, lambda trial=trial: measure(trial))
        asked = trial.exponent if isinstance(trial.warp, LeastSquares) else None
        names = ("edge", "size", "edge_contrast", "size_contrast")
        measured = [f"{row[name]:.3f}" for name in names]
        lines.append([trial.name, trial.dimensions, trial.factor, asked, *measured])
    head = (
        "method",
        "dimensions",
        "F",
        "p asked of size",
        "p of edge along x",
        "p of size",
        "longest over shortest edge",
        "largest over smallest size",
    )
    kept.write_table(markdown(head, lines))
    draw(kept.rows)


if __name__ == "__main__":
    main()
