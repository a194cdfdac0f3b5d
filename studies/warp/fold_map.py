"""Which methods fold cells on rough f: printed, midpoint, least squares.

    python3 studies/warp/fold_map.py [--fields 5] [--again]

log f is Gaussian noise in the unit cube of standard deviation sigma and correlation
exp(-r^2 / 2 l^2), l = 0.1 or 0.15 of its edge; 8^3 and 15^3 cells (9^3 and 16^3 nodes). The contrast
limit cuts f to a ratio of 3 for all methods; the iterations also run on f as it is. As many fields of
each of the eight kinds as --fields says. Writes results/fold_map.json, results/fold_map.md,
results/fold_map_runs.md (every run of least squares) and docs/images/warp_fold_map.png.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from drawn_grids import panels, save
from kept_results import IMAGES, Row, markdown, started
from scipy.ndimage import gaussian_filter

from texmap_opt.box import Box
from texmap_opt.warp.certificate import folded, grid_coefficients
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warp.quality import quality
from texmap_opt.warp.successive_approximation import SuccessiveApproximation
from texmap_opt.warp.warp import AbstractWarp
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.warping_function import WarpingFunction

UNIT_CUBE = Box.aligned(np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))
SIGMAS, LENGTHS, NODES = (1.5, 2.0), (0.1, 0.15), (9, 16)
# Of the background grid: finer than the shortest correlation by far.
SPACING = 0.04
CONTRAST, NO_LIMIT = 3.0, 1e6
# A swinging iteration never rests; what settles has long done so.
SWEEPS = 6000
# Trial grids of least squares.
STEPS = 1000


def iteration(weights: str, relaxation: float) -> SuccessiveApproximation:
    """The paper's iteration."""
    return SuccessiveApproximation(weights=weights, relaxation=relaxation, max_sweeps=SWEEPS)


# Name, warp and contrast. The iterations swing without a limit; relaxation 1/2 calms them and has the
# same fixed points.
METHODS: dict[str, tuple[AbstractWarp, float]] = {
    "printed": (iteration("printed", 1.0), CONTRAST),
    "midpoint": (iteration("midpoint", 1.0), CONTRAST),
    "printed, f unlimited": (iteration("printed", 0.5), NO_LIMIT),
    "midpoint, f unlimited": (iteration("midpoint", 0.5), NO_LIMIT),
    "least-squares": (LeastSquares(max_steps=STEPS), CONTRAST),
    "least-squares, size_weight 1": (LeastSquares(1.0, max_steps=STEPS), CONTRAST),
}


@dataclass(frozen=True)
class Kind:
    """Fields and grids of one kind."""

    sigma: float
    length: float
    nodes: int

    def __str__(self) -> str:
        return f"sigma {self.sigma:g}, l {self.length:g}, {self.nodes}³ nodes"

    def f(self, seed: int, contrast: float) -> WarpingFunction:
        """A rough field; grids of both sizes get the same one."""
        grid = BackgroundGrid.covering(UNIT_CUBE, SPACING)
        own = [seed, round(100 * self.sigma), round(100 * self.length)]
        noise = np.random.default_rng(own).standard_normal(grid.shape)
        # White noise filtered by a Gaussian of width l / sqrt(2) has the correlation exp(-r²/2l²).
        log_f = gaussian_filter(noise, self.length / SPACING / np.sqrt(2), mode="reflect")
        log_f *= self.sigma / log_f.std()
        return WarpingFunction.on_grid(grid, log_f, SizeLaw(contrast=contrast))


KINDS = [Kind(*values) for values in product(SIGMAS, LENGTHS, NODES)]


def runs(fields: int) -> Iterator[tuple[str, Kind, int]]:
    """Method, kind and seed, so that a stopped study has a few fields of every kind."""
    for seed in range(fields):
        for kind in KINDS:
            for method in METHODS:
                yield method, kind, seed


def key(method: str, kind: Kind, seed: int) -> str:
    """What a run is kept under."""
    return f"{method}; {kind}; seed {seed}"


def measure(method: str, kind: Kind, seed: int) -> Row:
    """Folded cells of one grid, and how the method ended."""
    warp, contrast = METHODS[method]
    f = kind.f(seed, contrast)
    result = warp.fit(Grid.uniform(UNIT_CUBE, (kind.nodes - 1,) * 3), f)
    measured = quality(result.grid, f)
    return {
        "folded": int(folded(grid_coefficients(result.grid)).sum()),
        "min_jacobian": measured.min_jacobian,
        "slope": measured.size_slope,
        "steps": result.iterations,
        "gain": result.measures.get("gain"),
        "gradient_norm": result.measures.get("gradient_norm"),
        "tolerance": result.measures.get("tolerance"),
        "converged": result.converged,
    }


def summary(rows: dict[str, Row]) -> str:
    """One line per method and kind."""
    lines = []
    for kind, method in product(KINDS, METHODS):
        of = [row for k, row in rows.items() if k.startswith(f"{method}; {kind};")]
        if not of:
            continue
        count = [row["folded"] for row in of]
        settled = sum(row["converged"] for row in of)
        clean = sum(row["converged"] and row["folded"] == 0 for row in of)
        lines.append(
            [
                str(kind),
                method,
                len(of),
                settled,
                sum(n > 0 for n in count),
                clean,
                f"{np.mean(count):.1f}",
                max(count),
                float(min(row["min_jacobian"] for row in of)),
                worst(of, "gradient_norm"),
                worst(of, "gain"),
                worst(of, "tolerance"),
            ]
        )
    head = (
        "kind",
        "method",
        "fields",
        "settled",
        "with folds",
        "settled without",
        "folded cells, mean",
        "most",
        "smallest B/s³",
        "largest gradient norm",
        "largest gain of a step",
        "limit of it",
    )
    return markdown(head, lines)


def worst(rows: list[Row], name: str) -> float | None:
    """The largest value; None where the method has none."""
    values = [row[name] for row in rows if row[name] is not None]
    return max(values) if values else None


def every_run(rows: dict[str, Row]) -> str:
    """One line per run of least squares."""
    lines = []
    names = (
        "folded",
        "min_jacobian",
        "slope",
        "steps",
        "gradient_norm",
        "gain",
        "tolerance",
        "converged",
    )
    for k, row in rows.items():
        method, kind, seed = k.split("; ")
        if method.startswith("least-squares"):
            weight = "1" if "size_weight 1" in method else "10"
            lines.append([kind, seed.split()[1], weight, *[row[name] for name in names]])
    head = (
        "kind",
        "seed",
        "size_weight",
        "folded",
        "smallest B/s³",
        "slope of size",
        "steps",
        "gradient norm",
        "gain of a step",
        "limit",
        "converged",
    )
    return markdown(head, lines)


def draw(rows: dict[str, Row], fields: int) -> None:
    """Folded cells, method by kind and field."""
    figure, (axes,) = panels(1, width=8)
    figure.set_size_inches(9, 6)
    share = np.full((len(METHODS) * len(KINDS), fields), np.nan)
    labels = []
    for line, (method, kind) in enumerate(product(METHODS, KINDS)):
        labels.append(f"{method} | {kind.sigma:g}, {kind.length:g}, {kind.nodes}")
        for seed in range(fields):
            row = rows.get(key(method, kind, seed))
            if row is not None:
                share[line, seed] = 100 * row["folded"] / (kind.nodes - 1) ** 3
    colours = axes.imshow(
        np.where(share > 0, share, np.nan), aspect="auto", cmap="inferno_r", vmin=0
    )
    axes.set_yticks(range(len(labels)), labels, fontsize=6)
    axes.set_xticks(range(0, fields, 2))
    axes.set_xlabel("seed")
    axes.set_title("method | sigma, l, nodes: folded cells; white: none", fontsize=10)
    figure.colorbar(colours, label="folded cells [%]")
    save(figure, IMAGES / "warp_fold_map.png")


def main() -> None:
    """Measure what is not known yet; write the tables and the figure."""
    fields = {"type": int, "default": 5, "help": "fields of each of the eight kinds"}
    kept, given = started("fold_map", __doc__, fields=fields)
    for run in runs(given.fields):
        kept.row(key(*run), lambda run=run: measure(*run))
    (kept.path.parent / "fold_map_runs.md").write_text(every_run(kept.rows) + "\n")
    kept.write_table(summary(kept.rows))
    draw(kept.rows, given.fields)


if __name__ == "__main__":
    main()
