"""How much of the strain energy that turning cells can save is saved: `target = "energy"`.

    python3 studies/warp/energy.py [--again]

Octet and cube cells in the built-in cantilever, L-bracket and torsion bar; cells of 5 mm, margin 1,
contrast 1.5 and 3. The energy is the sum over the nodes of the part's tets of
volume / 2 stress : compliance : stress, the stress that of the analysis, the compliance that of the
endless lattice in the frame of the cell the node lies in: turning alone, at equal density everywhere.
Writes results/energy.json, results/energy.md and docs/images/warp_energy.png.
"""

from dataclasses import dataclass
from functools import cache, partial

import jax.numpy as jnp
import numpy as np
from drawn_grids import panels, save
from jaxtyping import Float, Int
from kept_results import ENDING, IMAGES, Row, markdown, started
from part_stress import PartStress, builtin_stress

from fea.effective_stiffness import EffectiveStiffness
from fea.voigt import tensor
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.homogenised import fitting_joint_model, homogenised_cell
from texmap_opt.warp.alignment import alignment_for
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.inverse_map import grid_coordinates
from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warp.orientation import energy_share
from texmap_opt.warp.quality import frames, quality
from texmap_opt.warping_function.stress_driver import StressSamples

PARTS = ("cantilever", "l-bracket", "torsion-bar")
CELLS = ("octet", "cube")
CELL_MM, RADIUS = 5.0, 0.1  # the radius in cell edges
CONTRASTS = (1.5, 3.0)
MAX_STEPS = 1000
# Where turning could save less than this share of the energy, shares of it mean nothing.
NOTHING_TO_GAIN = 0.01
# Of the picture: cubes turned the worst way have ten times the energy.
WIDEST = 2.0


@dataclass(frozen=True)
class Trial:
    """A cell in a part, and what turns it."""

    part: str
    cell: str
    contrast: float
    target: str
    weight: float
    size_weight: float = 10.0

    @property
    def turned(self) -> str:
        """What turns the cells, in words."""
        if not self.weight:
            return "unaligned"
        return f"{self.target} {self.weight:g}"

    @property
    def key(self) -> str:
        """What it is kept under."""
        return (
            f"{self.part}, {self.cell}, contrast {self.contrast:g}, {self.turned}, "
            f"size_weight {self.size_weight:g}"
        )


def trials(part: str) -> list[Trial]:
    """Both cells with their own target at two weights; octet with the other; neither."""
    of = []
    for contrast in CONTRASTS:
        of += [Trial(part, cell, contrast, "energy", 0.0) for cell in CELLS]
        of += [Trial(part, cell, contrast, "energy", w) for cell in CELLS for w in (30.0, 100.0)]
        of += [Trial(part, cell, contrast, "energy", 100.0, 1.0) for cell in CELLS]
        of.append(Trial(part, "octet", contrast, "axes", 100.0))
    return of


def stiffness(cell: str, nu: float) -> EffectiveStiffness:
    """Of the endless lattice, over the solid's Young's modulus."""
    unit = unit_cell(cell)
    joints = fitting_joint_model(unit, RADIUS)
    return homogenised_cell(unit, radius=RADIUS, nu=nu, joint_model=joints).stiffness


def measure(trial: Trial, stressed: PartStress) -> Row:
    """Energies over that of unturned cells, and how the search ended."""
    C = stiffness(trial.cell, stressed.case.material.nu)
    grid = stressed.grid(CELL_MM)
    f = stressed.function(grid, contrast=trial.contrast)
    turning = alignment_for(trial.target, C, trial.weight)
    warp = LeastSquares(trial.size_weight, turning, max_steps=MAX_STEPS)
    result = warp.fit(grid, f)
    measured = quality(result.grid, f)
    mesh = stressed.stress.mesh
    samples = StressSamples.from_mesh(mesh, stressed.stress.stress)
    # Nodes on the part's surface are in the box, which has a margin.
    at = cell_of(result.grid, samples.points)
    stress = np.asarray(tensor(jnp.asarray(samples.stress)))
    energy = energy_share(C.compliance, stress, frames(result.grid)[at], samples.volumes)
    return {
        "zener": C.zener_ratio,
        "warped": energy.warped / energy.uniform,
        "best": energy.best / energy.uniform,
        "worst": energy.worst / energy.uniform,
        "share": energy.share,
        "min_jacobian": measured.min_jacobian,
        "folded": measured.folded_cells,
        "slope": measured.size_slope,
        "aspect": measured.max_aspect,
        "steps": result.iterations,
        "gain": result.measures["gain"],
        "converged": result.converged,
        "cells": " x ".join(map(str, grid.cells)),
    }


def cell_of(grid: Grid, points: Float[np.ndarray, "samples 3"]) -> Int[np.ndarray, " samples"]:
    """Flat number of the cell that each point lies in."""
    found = grid_coordinates(grid, points)
    if not found.found.all():
        raise RuntimeError(f"{int((~found.found).sum())} points of the part lie in no cell.")
    return np.asarray(np.ravel_multi_index(tuple(found.cell.T), grid.cells))


def draw(rows: dict[str, Row]) -> None:
    """Energies between the best and the worst, part by part."""
    figure, axes = panels(len(PARTS), width=4.4)
    for panel, part in zip(axes, PARTS, strict=True):
        shown = [t for t in trials(part) if t.size_weight == 10.0 and t.weight != 30.0]
        for line, trial in enumerate(reversed(shown)):
            row = rows[trial.key]
            panel.plot([row["best"], row["worst"]], [line, line], color="0.75", linewidth=5)
            higher = row["warped"] > 1 + NOTHING_TO_GAIN
            panel.plot(row["warped"], line, "o", color="tab:red" if higher else "tab:blue")
        panel.axvline(1, color="0.3", linewidth=0.8)
        labels = [f"{t.cell}, {t.contrast:g}, {t.turned}" for t in reversed(shown)]
        panel.set_yticks(range(len(shown)), labels if panel is axes[0] else [], fontsize=8)
        panel.set_xlim(0, WIDEST)
        panel.set_title(part, fontsize=10)
        panel.set_xlabel("strain energy over unturned cells", fontsize=9)
    save(figure, IMAGES / "warp_energy.png")


def main() -> None:
    """Measure what is not known yet; write the table and the figure."""
    kept, _ = started("energy", __doc__)
    lines = []
    names = ("zener", "warped", "best", "worst")
    for part in PARTS:
        stressed = cache(partial(builtin_stress, part))
        for trial in trials(part):
            row = kept.row(
                trial.key, lambda trial=trial, stressed=stressed: measure(trial, stressed())
            )
            of = [part, trial.cell, f"{trial.contrast:g}", trial.turned, f"{trial.size_weight:g}"]
            shares = [f"{row[n]:.3f}" for n in names]
            gains = 1 - row["best"] > NOTHING_TO_GAIN
            shares.append(f"{row['share']:.2f}" if gains else "–")
            lines.append([*of, *shares, *[row[name] for name in ENDING.values()]])
    head = (
        "part",
        "cell",
        "contrast",
        "target and weight",
        "size_weight",
        "Zener ratio",
        "energy over unturned",
        "the best",
        "the worst",
        "share of the gain",
        *ENDING,
    )
    kept.write_table(markdown(head, lines))
    draw(kept.rows)


if __name__ == "__main__":
    main()
