"""Octagons in a plane grid that is finer where it was painted, as in the paper's figure 8.

    python3 studies/warp/octagon.py [--again]

100 x 100 mm, 16 x 16 quadrilaterals warped in two dimensions under a painted f: printed iteration and
least squares, contrast 4. Into each goes the 2.5-D cell of an octagon with struts to the middles of
the cell's edges, by the bilinear map. Writes results/octagon.json, results/octagon.md and
docs/images/warp_octagon.png.

Figure 8: Y. Chen, "3D Texture Mapping for Rapid Manufacturing", Computer-Aided Design and
Applications 4 (6), 2007, 761-771.
"""

import numpy as np
from drawn_grids import draw_grid, panels, save
from jaxtyping import Float
from kept_results import IMAGES, Row, markdown, started
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from texmap_opt.box import Box
from texmap_opt.structure.map import multilinear
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warp.quality import quality
from texmap_opt.warp.successive_approximation import SuccessiveApproximation
from texmap_opt.warp.uniform import Uniform
from texmap_opt.warp.warp import AbstractWarp
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.warping_function import WarpingFunction

EDGE_MM, CELLS, CONTRAST = 100.0, 16, 4.0
# A spot of f: where, how wide and how high over the surroundings.
SPOT_MM, WIDTH_MM, PEAK = np.array([68.0, 64.0]), 16.0, 4.0
# Distance of an octagon's corners from the cell's edges: its eight sides are equal.
CORNER = 1 / (2 + np.sqrt(2))
# Part of the cell's half width that the octagon takes.
SHARE = 0.8

WARPS: dict[str, AbstractWarp] = {
    "uniform": Uniform(),
    "printed": SuccessiveApproximation(),
    "least-squares": LeastSquares(),
}


def painted(points: Float[np.ndarray, "samples 3"]) -> Float[np.ndarray, " samples"]:
    """1 far away, `PEAK` in the middle of the spot."""
    square = ((points[:, :2] - SPOT_MM) ** 2).sum(axis=1)
    return PEAK ** np.exp(-square / (2 * WIDTH_MM**2))


def octagon_cell() -> Float[np.ndarray, "struts 2 2"]:
    """Ends of the twelve struts of the cell in the unit square."""
    near, far = CORNER, 1 - CORNER
    x = np.array([near, far, 1, 1, far, near, 0, 0])
    y = np.array([0, 0, near, far, 1, 1, far, near])
    corners = 0.5 + SHARE * (np.stack([x, y], axis=1) - 0.5)
    sides = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    middles = np.array([[0.5, 0.0], [1.0, 0.5], [0.5, 1.0], [0.0, 0.5]])
    # Each joins the middle of the side beside it.
    spokes = np.stack([middles, sides[::2].mean(axis=1)], axis=1)
    return np.concatenate([sides, spokes])


def mapped(nodes: Float[np.ndarray, "_ _ 2"]) -> Float[np.ndarray, "struts 2 2"]:
    """The cell in every quadrilateral of a grid."""
    struts = octagon_cell()
    n, m = (k - 1 for k in nodes.shape[:2])
    cell = np.stack(np.meshgrid(np.arange(n), np.arange(m), indexing="ij"), axis=-1).reshape(-1, 2)
    ends = struts.reshape(-1, 2)
    local = np.tile(ends, (len(cell), 1))
    return multilinear(nodes, np.repeat(cell, len(ends), axis=0), local).reshape(-1, 2, 2)


def measure(warp: AbstractWarp) -> Row:
    """The grid, and how well it follows f."""
    bounds = np.array([[0.0, 0.0, 0.0], [EDGE_MM, EDGE_MM, 5.0]])
    grid = Grid.uniform(Box.aligned(bounds, extrusion="z"), (CELLS, CELLS))
    f = WarpingFunction.from_formula(
        painted, grid.box, spacing_mm=EDGE_MM / CELLS / 2, law=SizeLaw(contrast=CONTRAST)
    )
    result = warp.fit(grid, f)
    measured = quality(result.grid, f)
    return {
        "folded": measured.folded_cells,
        "min_jacobian": measured.min_jacobian,
        "slope": measured.size_slope,
        "correlation": measured.size_correlation,
        "aspect": measured.max_aspect,
        "converged": result.converged,
        "nodes": result.grid.nodes.round(4).tolist(),
    }


def draw_octagons(axes: Axes, nodes: Float[np.ndarray, "_ _ 2"]) -> None:
    """The mapped cells over their grid."""
    draw_grid(axes, nodes, colour="0.8")
    axes.add_collection(LineCollection(list(mapped(nodes)), colors="tab:blue", linewidths=0.9))


def main() -> None:
    """Warp, map, write the table and draw."""
    kept, _ = started("octagon", __doc__)
    names = ("folded", "min_jacobian", "slope", "correlation", "aspect")
    lines = []
    figure, axes = panels(len(WARPS), width=4.2)
    for panel, (name, warp) in zip(axes, WARPS.items(), strict=True):
        row = kept.row(name, lambda warp=warp: measure(warp))
        lines.append([name, *[row[key] for key in names]])
        draw_octagons(panel, np.array(row["nodes"]))
        panel.set_title(name, fontsize=11)
    head = ("method", "folded", "smallest B/s²", "slope", "correlation", "worst edge ratio")
    kept.write_table(markdown(head, lines))
    save(figure, IMAGES / "warp_octagon.png")


if __name__ == "__main__":
    main()
