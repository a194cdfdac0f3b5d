"""What a run would do, told in seconds: regions, cells, counts, and the time and memory it needs."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from texmap_opt.case import DesignCase, Load, Support
from texmap_opt.case_sections import WarpSection
from texmap_opt.cell_layout import case_cells, planned_layout, require_zones_in_grid
from texmap_opt.errors import CaseError
from texmap_opt.export.picture_file import require_png, write_png
from texmap_opt.given_drivers import given_drivers
from texmap_opt.grid_plan import plan_grid
from texmap_opt.part import Part, read_part
from texmap_opt.part_box import part_box
from texmap_opt.plane_loads import require_loads_in_plane
from texmap_opt.report.drawing import draw
from texmap_opt.report.grid_layers import hexahedra
from texmap_opt.report.marks import mark_of
from texmap_opt.report.run_scenes import kinds_of_cells
from texmap_opt.report.scenes import PlannedPart, Scene
from texmap_opt.run_cost import RunCost, run_cost
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.stress_field import region_slack
from texmap_opt.structure.layout import Layout
from texmap_opt.structure.mixed_net import mixed_net
from texmap_opt.structure.silhouette import silhouette
from texmap_opt.structure.trim import trim
from texmap_opt.structure.volume import lattice_volume
from texmap_opt.thickness import thinnest_wall
from texmap_opt.trimmed_lattice import uncut_lattice
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.occupied import occupied_volume

# Fewer cells than this across a wall behave as no continuum: stiffness then depends on where the
# grid happens to lie (Onck, Andrews, Gibson, Int. J. Mech. Sci. 43 (2001) 681).
LEAST_CELLS_ACROSS = 4
# Triangles of the part's surface are divided until their edges are below this share of its
# diagonal, so that a region's area is right on a coarse surface.
SAMPLE_SHARE = 1 / 60
MOST_SAMPLES = 400_000
PICTURE_TIMEOUT_S = 60.0


@dataclass(frozen=True, eq=False)
class SeenRegion:
    """A support or a load as the part's surface sees it.

    Attributes:
        action: the support or load.
        patch: the selected pieces of the surface; no faces for gravity.
        resultant: total force [N]; zero for supports.
        label: one line.
    """

    action: Support | Load
    patch: TriMesh
    resultant: Float[np.ndarray, " 3"]
    label: str


@dataclass(frozen=True, eq=False)
class Look:
    """What was seen.

    Attributes:
        case: what was asked.
        part: the part.
        grid: the planned uniform grid.
        layout: which unit cell is in which of its cells, as far as that is known before the warp.
        regions: supports, then loads.
        cells_across: cells across the thinnest wall.
        thinnest_mm: its thickness [mm].
        struts: of a uniform grid, trimmed.
        density: relative density of such struts.
        cost: what a run will take.
        warnings: what to think about before the long run.
    """

    case: DesignCase
    part: Part
    grid: Grid
    layout: Layout
    regions: tuple[SeenRegion, ...]
    cells_across: float
    thinnest_mm: float
    struts: int
    density: float
    cost: RunCost
    warnings: tuple[str, ...]

    def text(self) -> str:
        """The report in lines."""
        cost, (low, high) = self.cost, self.part.bounds
        size = " x ".join(f"{x:.4g}" for x in high - low)
        edge = " x ".join(f"{x:.3g}" for x in self.grid.uniform_edge)
        cells = " x ".join(str(n) for n in self.grid.cells)
        lines = [
            f"part      {self.part.name}: {size} mm, {len(self.part.surface.faces):,} triangles, "
            f"{self.part.volume:,.0f} mm³",
            f"grid      {cells} cells of {edge} mm; {self.cells_across:.1f} across the thinnest "
            f"wall, {self.thinnest_mm:.3g} mm",
            f"warp      {_warp_line(self.case.warp)}",
            f"lattice   about {self.struts:,} struts, relative density {self.density:.3f}",
            f"estimate  {cost.triangles:,} triangles; {cost.time_text} and {cost.memory_mb:.0f} MB for a "
            "first run on two cores",
            *(seen.label for seen in self.regions),
            *(f"warning   {warning}" for warning in self.warnings),
        ]
        return "\n".join(lines)


def _warp_line(warp: WarpSection) -> str:
    """What moves the cells, in words."""
    if warp.method == "uniform":
        return "none: uniform cells"
    drivers = f" ({warp.combine}) ".join(warp.driver)
    line = f"{warp.method}, driven by {drivers}, contrast {warp.contrast:g}"
    if warp.method != "least-squares":
        return line
    turning = (
        f"cells turn, {warp.target} {warp.alignment:g}" if warp.alignment else "cells do not turn"
    )
    return f"{line}; {turning}"


def look(case: DesignCase) -> Look:
    """Read the part, find the regions, and count what a uniform grid would hold.

    Raises:
        CaseError: a region selects nothing, the cells do not fit, or a driver of the warp cannot be used.
        PartError: the part cannot be used.
        LatticeError: no lattice would be left.
    """
    part = read_part(case.part, case.directory)
    cells = case_cells(case)
    cell = cells.cells[0]
    plan = plan_grid(case, part_box(case, part.surface, cell), cell)
    grid = plan.grid
    require_loads_in_plane(case, grid.box)
    require_zones_in_grid(case, grid)
    given_drivers(case, grid)
    facets = _subdivided(part.surface, part.diagonal)
    regions = tuple(_seen(facets, action) for action in (*case.supports, *case.loads))
    layout = planned_layout(case, cells, grid)
    net, _ = mixed_net(layout)
    net = uncut_lattice(case, net, grid, radius_mm=plan.radius_mm)
    trimmed = trim(
        net,
        part,
        skin_mm=case.lattice.skin_mm,
        least_share=0.0,
        sliver_mm=case.lattice.sliver_share * float(grid.uniform_edge.mean()),
    )
    struts = len(trimmed.structure.struts)
    # The cells of walls lie side by side in their plane only.
    filled = part
    if net.extrusion is not None:
        filled = Part(silhouette(part.surface, net.extrusion.axis), part.name)
    thinnest = thinnest_wall(filled.surface, query=filled.signed_distance)
    across = thinnest / float(grid.uniform_edge.max())
    warnings = [*part.notes]
    unknown = [zone.where.split(": ", 1)[-1] for zone in case.zones if zone.f is not None]
    if unknown:
        warnings.append(
            f"{', '.join(unknown)}: only the warp tells which cells have such an f; they are counted "
            "and drawn as without the zone."
        )
    if across < LEAST_CELLS_ACROSS:
        warnings.append(
            f"only {across:.1f} cells across the thinnest wall ({thinnest:.3g} mm): below "
            f"{LEAST_CELLS_ACROSS} a lattice's stiffness depends on how the grid lies; cell_mm = "
            f"{thinnest / LEAST_CELLS_ACROSS:.2g} would give {LEAST_CELLS_ACROSS}."
        )
    return Look(
        case=case,
        part=part,
        grid=grid,
        layout=layout,
        regions=regions,
        cells_across=across,
        thinnest_mm=thinnest,
        struts=struts,
        density=lattice_volume(trimmed.structure) / part.volume,
        cost=run_cost(case, part, grid, struts),
        warnings=tuple(warnings),
    )


def draw_look(seen: Look, png: Path) -> tuple[dict[str, Path], dict[str, str]]:
    """Draw part, regions and grid into a PNG file; with several unit cells these into another.

    The other's name is the file's with `-kinds` at the end of its stem.

    Returns:
        The files by what they show, "look" and "kinds"; and why one was not drawn.

    Raises:
        InputError: the file is not named .png.
        OutputError: it cannot be written.
    """
    require_png(png)
    marks = tuple(mark_of(r.action, r.patch, r.label, r.resultant) for r in seen.regions)
    corners, part = hexahedra(seen.grid), seen.part.surface
    scenes: dict[str, Scene] = {"look": PlannedPart(part, marks, corners)}
    if len(seen.layout.cells) > 1:
        meets = occupied_volume(seen.grid, part) > 0
        shape = tuple(n - 1 for n in corners.shape[:3])
        scenes["kinds"] = kinds_of_cells(seen.layout, corners, meets.reshape(shape), part)
    files = {"look": png, "kinds": png.with_stem(f"{png.stem}-kinds")}
    with tempfile.TemporaryDirectory(prefix="texmap-look-") as folder:
        drawn = draw(scenes, Path(folder), timeout_s=PICTURE_TIMEOUT_S)
        for name, picture in drawn.pictures.items():
            write_png(files[name], picture.read_bytes())
    return {name: files[name] for name in drawn.pictures}, drawn.missing


def _seen(facets: TriMesh, action: Support | Load) -> SeenRegion:
    """Which pieces of the finely divided surface a support or load selects."""
    name = action.where.split(": ", 1)[-1]
    if action.region is None:
        acceleration = np.array(action.gravity_m_s2)  # pyright: ignore[reportAttributeAccessIssue]
        label = f"{name}: gravity {np.linalg.norm(acceleration):.4g} m/s²"
        return SeenRegion(
            action, TriMesh(np.zeros((0, 3)), np.zeros((0, 3), int)), acceleration, label
        )
    centroids = facets.vertices[facets.faces].mean(axis=1)
    slack = region_slack(facets.vertices)
    inside = action.region.contains(centroids, facets.face_normals, slack=slack)
    if isinstance(action, Support) and not inside.any():
        normals = np.repeat(facets.face_normals, 3, axis=0)
        corners = facets.vertices[facets.faces].reshape(-1, 3)
        if action.region.contains(corners, normals, slack=slack).any():
            empty = TriMesh(np.zeros((0, 3)), np.zeros((0, 3), int))
            label = f"{name}: holds {', '.join(action.fix)} on a line or points, 0 mm²"
            return SeenRegion(action, empty, np.zeros(3), label)
    if not inside.any():
        raise CaseError(
            f"{action.where} region: {action.region.describe()} selects nothing of the part's "
            "surface; move or widen the region."
        )
    patch = facets.select(inside)
    area = float(facets.face_areas[inside].sum())
    if isinstance(action, Support):
        label = f"{name}: holds {', '.join(action.fix)} on {area:.4g} mm²"
        return SeenRegion(action, patch, np.zeros(3), label)
    resultant = _resultant(action, patch)
    force = ", ".join(f"{x:.4g}" for x in resultant)
    label = f"{name}: {action.case}, resultant [{force}] N on {area:.4g} mm²"
    return SeenRegion(action, patch, resultant, label)


def _resultant(load: Load, patch: TriMesh) -> Float[np.ndarray, " 3"]:
    total = np.zeros(3)
    if load.force_N is not None:
        total += np.array(load.force_N)
    if load.traction_MPa is not None:
        total += np.array(load.traction_MPa) * patch.face_areas.sum()
    if load.pressure_MPa is not None:
        total -= load.pressure_MPa * (patch.face_areas @ patch.face_normals)
    return total


def _subdivided(surface: TriMesh, diagonal: float) -> TriMesh:
    """The surface cut into triangles small enough to tell a region's area by their centroids."""
    longest = SAMPLE_SHARE * diagonal
    corners = surface.vertices[surface.faces]
    while True:
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        large = edges > longest
        if not large.any() or len(corners) > MOST_SAMPLES:
            break
        a, b, c = np.moveaxis(corners[large], 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        corners = np.concatenate([corners[~large], *(np.stack(q, axis=1) for q in quarters)])
    return TriMesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
