"""How far cells turn into the principal axes of an analytic stress: `target = "axes"`.

    python3 studies/warp/alignment.py [--again]

Bending of the unit cube: sxx = 12 (1 - x) (y - 1/2), txy = -3/4 (1 - 4 (y - 1/2)^2), else 0; f is its
von Mises stress, smoothed over one cell; 12 x 12 x 12 cells, contrast 3 or 1, no margin. Then two
load cases at once: the same bending in the xz plane, or turned about z. Writes results/alignment.json,
results/alignment.md and docs/images/warp_alignment.png, warp_two_cases.png.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from drawn_grids import draw_grid, panels, save
from jaxtyping import Float
from kept_results import ENDING, IMAGES, Row, markdown, started
from matplotlib.axes import Axes

from texmap_opt.box import Box
from texmap_opt.warp.alignment import NoShear
from texmap_opt.warp.cell_volumes import cell_volumes
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warp.orientation import best_energy, strain_energy
from texmap_opt.warp.quality import frames, quality
from texmap_opt.warp.successive_approximation import SuccessiveApproximation
from texmap_opt.warp.uniform import Uniform
from texmap_opt.warp.warp import AbstractWarp
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.stress_driver import StressSamples, stress_driver
from texmap_opt.warping_function.warping_function import WarpingFunction

CELLS = 12
# Points per axis at which the stress is handed over: more than two per cell.
SAMPLES = 30
# Limit of the search: the heaviest weights crawl.
MAX_STEPS = 1000
UNIT_CUBE = Box.aligned(np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))
# Turn of the second load case about z.
TURN = np.radians(30.0)
# With this as compliance the strain energy of a cell is the sum of its squared shears.
SHEAR_ONLY = np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])

Stress = Callable[[Float[np.ndarray, "samples 3"]], Float[np.ndarray, "samples 3 3"]]


def bending(points: Float[np.ndarray, "samples 3"]) -> Float[np.ndarray, "samples 3 3"]:
    """The beam's stress in the xy plane."""
    x, y, _ = points.T
    stress = np.zeros((len(points), 3, 3))
    stress[:, 0, 0] = 12 * (1 - x) * (y - 0.5)
    stress[:, 0, 1] = stress[:, 1, 0] = -0.75 * (1 - 4 * (y - 0.5) ** 2)
    return stress


def turned(turn: Float[np.ndarray, "3 3"]) -> Stress:
    """The same about the middle of the cube, turned."""

    def stress(points: Float[np.ndarray, "samples 3"]) -> Float[np.ndarray, "samples 3 3"]:
        return turn @ bending((points - 0.5) @ turn + 0.5) @ turn.T

    return stress


ABOUT_X = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
ABOUT_Z = np.array(
    [[np.cos(TURN), -np.sin(TURN), 0.0], [np.sin(TURN), np.cos(TURN), 0.0], [0.0, 0.0, 1.0]]
)

# Load cases, each with the two axes that span the plane of its stress.
LOADS: dict[str, list[tuple[Stress, tuple[int, int]]]] = {
    "bending": [(bending, (0, 1))],
    "bending in xy and in xz": [(bending, (0, 1)), (turned(ABOUT_X), (0, 2))],
    "bending, and turned by 30°": [(bending, (0, 1)), (turned(ABOUT_Z), (0, 1))],
}


@dataclass(frozen=True)
class Trial:
    """A method under some load cases."""

    loads: str
    name: str
    warp: AbstractWarp
    contrast: float = 3.0

    @property
    def key(self) -> str:
        """What it is kept under."""
        return f"{self.loads}, contrast {self.contrast:g}: {self.name}"


def trials() -> list[Trial]:
    """Uniform, printed and least squares with several weights, then two load cases at once."""
    several = [
        least_squares("bending", size_weight, weight)
        for size_weight in (1.0, 10.0)
        for weight in (0.0, 10.0, 30.0, 100.0, 200.0)
    ]
    one_size = [least_squares("bending", 1.0, weight, contrast=1.0) for weight in (30.0, 100.0)]
    first, *both = LOADS
    two = [
        trial
        for loads in both
        for trial in (
            Trial(loads, "uniform", Uniform()),
            *[least_squares(loads, 1.0, weight) for weight in (10.0, 30.0, 100.0)],
        )
    ]
    printed = Trial(first, "printed", SuccessiveApproximation())
    return [Trial(first, "uniform", Uniform()), printed, *several, *one_size, *two]


def least_squares(loads: str, size_weight: float, weight: float, *, contrast: float = 3.0) -> Trial:
    """Least squares with these weights of size and alignment."""
    name = f"least-squares, size_weight {size_weight:g}, alignment {weight:g}"
    turning = NoShear(jnp.asarray(weight))
    warp = LeastSquares(size_weight=size_weight, alignment=turning, max_steps=MAX_STEPS)
    return Trial(loads, name, warp, contrast)


def warping_function(loads: str, contrast: float) -> WarpingFunction:
    """Of the stress at regular points; smoothed over one cell."""
    ticks = (np.arange(SAMPLES) + 0.5) / SAMPLES
    points = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    rows, columns = [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]
    stress = np.stack([case(points)[:, rows, columns] for case, _ in LOADS[loads]])
    samples = StressSamples(points, np.full(len(points), 1 / len(points)), stress)
    background = BackgroundGrid.covering(UNIT_CUBE, 1 / CELLS)
    return stress_driver(samples, background, smoothing_mm=1 / CELLS).function(
        background, SizeLaw(contrast=contrast)
    )


def first_axes(grid: Grid) -> Float[np.ndarray, "cells 3"]:
    """Mean edge of each cell along its first axis [mm]."""
    corners = grid.nodes.reshape(-1, 3)[grid.corners]
    return (corners[:, [1, 2, 5, 6]] - corners[:, [0, 3, 4, 7]]).mean(axis=1)


def in_plane_angles(
    first: Float[np.ndarray, "cells 3"],
    stress: Float[np.ndarray, "cells 3 3"],
    plane: tuple[int, int],
) -> Float[np.ndarray, " cells"]:
    """The angle in a plane from a direction to the nearest principal axis [deg]."""
    i, j = plane
    principal = np.arctan2(2 * stress[:, i, j], stress[:, i, i] - stress[:, j, j]) / 2
    angle = np.arctan2(first[:, j], first[:, i]) - principal
    quarter = np.pi / 2
    return np.degrees(np.abs((angle + quarter / 2) % quarter - quarter / 2))


def measure(trial: Trial) -> Row:
    """Angles per load case, squared shear in the cells' frames, sizes, and how the search ended."""
    f = warping_function(trial.loads, trial.contrast)
    result = trial.warp.fit(Grid.uniform(UNIT_CUBE, (CELLS,) * 3), f)
    grid = result.grid
    measured = quality(grid, f)
    planes = [plane for _, plane in LOADS[trial.loads]]
    stress = np.stack([case(grid.centres) for case, _ in LOADS[trial.loads]])
    first, along_x = first_axes(grid), np.broadcast_to(np.eye(3)[0], (grid.cell_count, 3))
    volumes = cell_volumes(grid.nodes).reshape(-1)
    angles = [in_plane_angles(first, s, p) for s, p in zip(stress, planes, strict=True)]
    before = [in_plane_angles(along_x, s, p) for s, p in zip(stress, planes, strict=True)]
    uniform = np.broadcast_to(np.eye(3), (grid.cell_count, 3, 3))
    shear = strain_energy(SHEAR_ONLY, stress, frames(grid)).sum()
    unturned = strain_energy(SHEAR_ONLY, stress, uniform).sum()
    return {
        "angles": [float(a.mean()) for a in angles],
        "unturned_angles": [float(a.mean()) for a in before],
        "angles_by_volume": [float(np.average(a, weights=volumes)) for a in angles],
        "shear": float(shear / unturned),
        "least_shear": float(best_energy(SHEAR_ONLY, stress).sum() / unturned),
        "min_jacobian": measured.min_jacobian,
        "folded": measured.folded_cells,
        "slope": measured.size_slope,
        "aspect": measured.max_aspect,
        "steps": result.iterations,
        "gain": result.measures.get("gain"),
        "gradient_norm": result.measures.get("gradient_norm"),
        "converged": result.converged,
        "layers": {str(plane): middle_layer(grid, plane).tolist() for plane in planes},
    }


def middle_layer(grid: Grid, plane: tuple[int, int]) -> Float[np.ndarray, "_ _ 2"]:
    """The nodes of the grid's middle layer, seen along the normal of a plane."""
    normal = ({0, 1, 2} - set(plane)).pop()
    return np.take(grid.nodes, CELLS // 2, axis=normal)[..., list(plane)].round(5)


def draw_axes(
    axes: Axes, stress: Stress, plane: tuple[int, int], colour: str, level: float
) -> None:
    """Crosses along the principal axes in a plane, as long as the stress differs along them."""
    ticks = (np.arange(CELLS) + 0.5) / CELLS
    i, j = plane
    points = np.full((CELLS**2, 3), level)
    points[:, [i, j]] = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    s = stress(points)
    difference = s[:, i, i] - s[:, j, j]
    angle = np.arctan2(2 * s[:, i, j], difference) / 2
    length = np.hypot(2 * s[:, i, j], difference) ** 0.5
    length *= 0.35 / CELLS / length.max()
    for turn in (0, np.pi / 2):
        arm = np.stack([np.cos(angle + turn), np.sin(angle + turn)], axis=1) * length[:, None]
        ends = np.stack([points[:, [i, j]] - arm, points[:, [i, j]] + arm])
        axes.plot(*ends.transpose(2, 0, 1), color=colour, linewidth=1.1)


def draw_one_case(rows: dict[str, Row]) -> None:
    """The layer at z = 1/2: uniform, printed and aligned."""
    best = least_squares("bending", 1.0, 100.0).key
    figure, three = panels(3)
    names = ("bending, contrast 3: uniform", "bending, contrast 3: printed", best)
    for axes, key in zip(three, names, strict=True):
        draw_grid(axes, np.array(rows[key]["layers"]["(0, 1)"]))
        draw_axes(axes, bending, (0, 1), "tab:red", 0.5)
        title = key.split(": ")[1].replace(", size", "\nsize")
        axes.set_title(f"{title}: {rows[key]['angles'][0]:.1f}°", fontsize=10)
    save(figure, IMAGES / "warp_alignment.png")


def draw_two_cases(rows: dict[str, Row]) -> None:
    """Middle layers under two load cases at once."""
    figure, four = panels(3)
    planes = [("bending in xy and in xz", (0, 1)), ("bending in xy and in xz", (0, 2))]
    planes.append(("bending, and turned by 30°", (0, 1)))
    for axes, (loads, plane) in zip(four, planes, strict=True):
        row = rows[least_squares(loads, 1.0, 30.0).key]
        draw_grid(axes, np.array(row["layers"][str(plane)]))
        for (stress, of_case), colour in zip(LOADS[loads], ("tab:red", "tab:blue"), strict=True):
            if of_case == plane:
                draw_axes(axes, stress, plane, colour, 0.5)
        axes.set_title(f"{loads}:\nthe {'xyz'[plane[0]]}{'xyz'[plane[1]]} plane", fontsize=10)
    save(figure, IMAGES / "warp_two_cases.png")


def main() -> None:
    """Measure what is not known yet; write the table and the figures."""
    kept, _ = started("alignment", __doc__)
    lines = []
    for trial in trials():
        row = kept.row(trial.key, lambda trial=trial: measure(trial))
        names = ("shear", "least_shear", *ENDING.values())
        lines.append(
            [
                trial.loads,
                f"{trial.contrast:g}",
                trial.name,
                degrees(row["angles"]),
                degrees(row["unturned_angles"]),
                degrees(row["angles_by_volume"]),
                *[row[name] for name in names],
            ]
        )
    head = (
        "load cases",
        "contrast",
        "method",
        "mean angle of each case [deg]",
        "unturned cells at the same places",
        "mean angle weighted by volume",
        "squared shear over unturned cells",
        "the least possible",
        *ENDING,
    )
    kept.write_table(markdown(head, lines))
    draw_one_case(kept.rows)
    draw_two_cases(kept.rows)


def degrees(angles: list[float]) -> str:
    """Angles of the load cases."""
    return ", ".join(f"{angle:.2f}" for angle in angles)


if __name__ == "__main__":
    main()
