"""Redraw what Chen (2007) shows, as far as the program's stages go: pictures and triangle counts.

    python studies/paper/redraw.py --out DIR [--part STATUE.ply --unit cm] [--figures 7 8 10 11]

Figure numbers refer to Y. Chen, "3D Texture Mapping for Rapid Manufacturing", Computer-Aided
Design and Applications 4 (6), 2007, 761-771. README.md says what each picture corresponds to.
"""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import jax
import numpy as np

from texmap_opt.box import Box
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.combine.part_with_lattice import plate_result, rod_result
from texmap_opt.errors import TexmapError
from texmap_opt.part import Part, read_surface
from texmap_opt.report.drawing import draw
from texmap_opt.report.scenes import CutOpen, Scene, Struts, WarpedGrid, Whole
from texmap_opt.solid.float32_solid import printable_mesh
from texmap_opt.solid.lattice_solid import lattice_solid
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.solid.validity import validity
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.tile import tile
from texmap_opt.structure.trim import trim
from texmap_opt.warp.cell_volumes import equivalent_edges
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warp.quality import quality
from texmap_opt.warp.successive_approximation import SuccessiveApproximation
from texmap_opt.warp.warp import AbstractWarp
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.warping_function import WarpingFunction

UNKNOWN = "not stated here"
# Of the statue that the paper used; the one drawn here is another scan of the same kind.
PAPER_STATUE_TRIANGLES = "5,050 (input)"

PICTURE_SECONDS = 120.0

Field = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Row:
    """One line of the table; counts are None where the picture has no such mesh."""

    figure: str
    picture: str
    cells: str
    struts: int | None = None
    lattice_triangles: int | None = None
    result_triangles: int | None = None
    in_paper: str = UNKNOWN
    remark: str = ""

    def markdown(self) -> str:
        """The line as a row of a markdown table."""
        counts = (self.struts, self.lattice_triangles, self.result_triangles)
        written = ["–" if count is None else f"{count:,}" for count in counts]
        cells = [self.figure, self.picture, self.cells, *written, self.in_paper, self.remark]
        return "| " + " | ".join(cells) + " |"


@dataclass
class Sheet:
    """Pictures and table rows as they are made; told to the terminal as they come."""

    out: Path
    rows: list[Row] = field(default_factory=list)
    start: float = field(default_factory=time.perf_counter)

    def add(self, name: str, scene: Scene, row: Row, *, up: int = 2) -> None:
        """Draw one picture and note its numbers."""
        drawn = draw({name: scene}, self.out, timeout_s=PICTURE_SECONDS, up=up)
        remark = f"no picture: {drawn.missing[name]}" if drawn.missing else row.remark
        self.rows.append(Row(**(vars(row) | {"remark": remark})))
        seconds = time.perf_counter() - self.start
        print(f"{seconds:6.1f} s  " + "; ".join(text for text in (row.picture, remark) if text))

    def write_table(self) -> None:
        """Write table.md."""
        head = (
            "figure",
            "picture",
            "cells",
            "struts",
            "triangles of the lattice S",
            "triangles of the result",
            "triangles in the paper",
            "remark",
        )
        lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
        lines += [row.markdown() for row in self.rows]
        (self.out / "table.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def box_surface(box: np.ndarray) -> TriMesh:
    """The twelve triangles of a box."""
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    return TriMesh(np.where(corner, box[1], box[0]), faces)


def spot(centre: tuple[float, ...], width: float, peak: float) -> Field:
    """A painted f: 1 far away, `peak` at the centre."""

    def f(points: np.ndarray) -> np.ndarray:
        square = ((points - np.array(centre)) ** 2).sum(axis=1)
        return 1 + (peak - 1) * np.exp(-square / (2 * width**2))

    return f


def ring(centre: tuple[float, ...], radius: float, width: float, peak: float) -> Field:
    """A painted f: a ring about the z axis through the centre."""

    def f(points: np.ndarray) -> np.ndarray:
        distance = np.linalg.norm(points[:, :2] - np.array(centre)[:2], axis=1) - radius
        return 1 + (peak - 1) * np.exp(-(distance**2) / (2 * width**2))

    return f


def warped(grid: Grid, f: Field, warp: AbstractWarp, contrast: float) -> tuple[Grid, str]:
    """The grid warped under f, and what to remark on it."""
    spacing = float(grid.uniform_edge.min()) / 2
    painted = WarpingFunction.from_formula(
        f, grid.box, spacing_mm=spacing, law=SizeLaw(contrast=contrast)
    )
    result = warp.fit(grid, painted)
    measured = quality(result.grid, painted)
    remark = f"{result.method}, {measured.folded_cells} cells folded"
    return result.grid, remark if result.converged else f"{remark}; {result.message}"


def slab(grid: Grid) -> np.ndarray:
    """Nodes of the hexahedra that the cells of a grid in the plane are when extruded [mm]."""
    half = np.ptp(grid.box.bounds[:, 2]) / 2 * grid.box.axes[2]
    return np.stack([grid.positions - half, grid.positions + half], axis=2)


def figure_7(sheet: Sheet) -> None:
    """A grid warped under a painted f, by the paper's iteration and by least squares."""
    box = np.array([[0.0, 0, 0], [100, 100, 5]])
    grid = Grid.uniform(Box.aligned(box, extrusion="z"), (20, 20))
    for name, f in (("spot", spot((35, 60, 2.5), 14, 6)), ("ring", ring((50, 50), 28, 8, 5))):
        for warp in (SuccessiveApproximation(), LeastSquares()):
            moved, remark = warped(grid, f, warp, contrast=4.0)
            size = equivalent_edges(slab(moved))
            scene = WarpedGrid(slab(moved), size, np.ones(size.shape, bool), box_surface(box))
            method = type(warp).__name__
            row = Row("7", f"grid under a painted {name}, {method}", "20 x 20", remark=remark)
            sheet.add(f"figure-07-{name}-{method}", scene, row)


def figure_8(sheet: Sheet) -> None:
    """Structures of several unit cells in one warped grid."""
    box = np.array([[0.0, 0, 0], [50, 50, 50]])
    grid, remark = warped(
        Grid.uniform(Box.aligned(box), (8, 8, 8)),
        spot((50, 0, 50), 16, 5),
        LeastSquares(),
        contrast=2.2,
    )
    for name in ("cube", "octahedron", "octet", "vector"):
        net = map_structure(tile(unit_cell(name), grid.cells), grid.positions, 0.4)
        row = Row(
            "8", f"{name} cells under a painted f", "8 x 8 x 8", len(net.struts), remark=remark
        )
        sheet.add(f"figure-08-{name}", coloured_by_cell(net), row)


def coloured_by_cell(net: Structure) -> Struts:
    """Struts coloured by the size of their warped cell."""
    values = np.repeat(net.cell_size[:, None], 2, axis=1)
    return Struts(net.joints, net.struts, net.radii, values, "relative\ncell size", "")


def figure_10(sheet: Sheet) -> None:
    """A cube filled as rod kind and as plate kind."""
    box = np.array([[0.0, 0, 0], [40, 40, 40]])
    part = Part(box_surface(box), "cube")
    fill(sheet, part, Filling("10", "cube", 8.0, 0.9, 1.0), spot((40, 0, 40), 14, 4))


def figure_11(sheet: Sheet, statue: Path, unit: str, up: int) -> None:
    """A statue filled as rod kind and as plate kind, cells finer towards the head."""
    part = read_surface(statue, unit=unit)
    low, high = part.bounds[:, up]

    def height(points: np.ndarray) -> np.ndarray:
        return 1 + 2 * np.clip((points[:, up] - low) / (high - low), 0, 1)

    filling = Filling("11", "statue", 10.0, 0.7, 1.2, up=up, in_paper=PAPER_STATUE_TRIANGLES)
    fill(sheet, part, filling, height)


@dataclass(frozen=True)
class Filling:
    """How a part is filled with octet cells: figure, name, edge of a cell, radius, skin [mm]."""

    figure: str
    name: str
    cell_mm: float
    radius_mm: float
    skin_mm: float
    up: int = 2
    in_paper: str = UNKNOWN


def fill(sheet: Sheet, part: Part, how: Filling, f: Field) -> None:
    """The part with an octet lattice in a warped grid, as rod kind and as plate kind."""
    extent = part.bounds[1] - part.bounds[0]
    x, y, z = (max(2, round(float(length) / how.cell_mm)) for length in extent)
    tolerance = 0.002 * float(np.linalg.norm(extent))
    box = Box.aligned(part.bounds)
    around = Grid.around(box, (x, y, z), margin_cells=1, radius_mm=how.radius_mm)
    grid, remark = warped(around, f, LeastSquares(), contrast=2.5)
    net = map_structure(tile(unit_cell("octet"), grid.cells), grid.positions, how.radius_mm)
    inside = trim(net, part, skin_mm=how.skin_mm).structure
    lattice = lattice_solid(inside, tolerance_mm=tolerance).surface
    for kind, combine in (("rod", rod_result), ("plate", plate_result)):
        result = combine(part.surface, lattice, skin_mm=how.skin_mm, tolerance_mm=tolerance)
        solid, _ = printable_mesh(result.surface)
        checked = validity(solid)
        found = "printable" if checked.printable else "; ".join(checked.faults)
        row = Row(
            how.figure,
            f"{how.name} ({len(part.surface.faces):,} triangles), {kind} kind, cut open",
            f"{x} x {y} x {z} and a margin of 1",
            len(inside.struts),
            len(lattice.faces),
            len(solid.faces),
            how.in_paper,
            f"{remark}; {found}",
        )
        name = f"figure-{how.figure}-{how.name}-{kind}"
        sheet.add(name, CutOpen(solid), row, up=how.up)
    outside = Row(how.figure, f"{how.name} from outside", "–", in_paper=how.in_paper)
    sheet.add(f"figure-{how.figure}-{how.name}-outside", Whole(part.surface), outside, up=how.up)


def main() -> int:
    """Redraw the figures asked for; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for pictures and table.md")
    parser.add_argument("--part", type=Path, help="the statue of figure 11 (STL, OBJ, PLY, 3MF)")
    parser.add_argument("--unit", default="cm", help="unit of the statue's coordinates")
    parser.add_argument("--up", choices=("x", "y", "z"), default="y", help="the statue's height")
    parser.add_argument(
        "--figures", type=int, nargs="+", choices=(7, 8, 10, 11), default=(7, 8, 10, 11)
    )
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    options.out.mkdir(parents=True, exist_ok=True)
    sheet = Sheet(options.out)
    figures = {7: figure_7, 8: figure_8, 10: figure_10}
    try:
        for number in sorted(set(options.figures)):
            if number != 11:
                figures[number](sheet)
            elif options.part:
                figure_11(sheet, options.part, options.unit, "xyz".index(options.up))
            else:
                print("figure 11 is left out: give the statue with --part FILE")
    except TexmapError as failure:
        print(failure, file=sys.stderr)
        return failure.exit_code
    finally:
        sheet.write_table()
    print(f"{options.out / 'table.md'}: {len(sheet.rows)} pictures")
    return 0


if __name__ == "__main__":
    sys.exit(main())
