"""The pictures of a run: which values each of them shows."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from texmap_opt.case import Load, Support
from texmap_opt.report.grid_layers import hexahedra
from texmap_opt.report.marks import mark_of
from texmap_opt.report.scenes import (
    CutOpen,
    LoadedPart,
    Mark,
    Scene,
    Struts,
    WarpedGrid,
    Whole,
    triangles_of_facets,
)
from texmap_opt.run_result import Run
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.stress_field import StressField, selected_facets
from texmap_opt.structure.layout import Layout
from texmap_opt.structure.structure import Structure
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.quality import achieved_sizes

# A resultant below this share of the sum of its forces is their rounding: the load is a moment.
ROUNDING = 1e-9


def run_scenes(run: Run) -> dict[str, Scene]:
    """All scenes of a run by the names that the page knows."""
    stress, grid = run.stress, run.warp.grid
    mesh = stress.mesh
    faces = triangles_of_facets(mesh.boundary_facets)
    used, numbered = np.unique(faces, return_inverse=True)
    marks = tuple(_mark(stress, k, a) for k, a in _numbered(run))
    corners = hexahedra(grid)
    shape = tuple(n - 1 for n in corners.shape[:3])
    size = achieved_sizes(grid).reshape(shape)
    meets = run.warp.occupied_mm3.reshape(shape) > 0
    scenes: dict[str, Scene] = {
        "load": LoadedPart(
            TriMesh(mesh.nodes[used], numbered.reshape(-1, 3)),
            stress.von_mises.max(axis=0)[used],
            marks,
        ),
        "grid": WarpedGrid(corners, size * mean_edge(grid), meets, run.part.surface),
        "size-error": WarpedGrid(
            corners,
            size / run.warp.wanted_size.reshape(size.shape),
            meets,
            run.part.surface,
            quantity="achieved over\nwanted size",
            middle=1.0,
        ),
    }
    layout = run.layout
    if len(layout.cells) > 1:
        scenes["kinds"] = kinds_of_cells(layout, corners, meets, run.part.surface)
    structure, sized = run.filling.structure, run.filling.sized
    scenes["radius"] = _struts(structure)
    if sized is not None and sized.utilisation is not None:
        worst = np.repeat(sized.utilisation[:, None], 2, axis=1)
        scenes["utilisation"] = replace(
            scenes["radius"], values=worst, quantity="utilisation", unit="", limit=1.0
        )
    return scenes | {"cut": CutOpen(run.solid.surface), "whole": Whole(run.solid.surface)}


def kinds_of_cells(
    layout: Layout,
    corners: Float[np.ndarray, "i j k 3"],
    meets: Bool[np.ndarray, "x y z"],
    part: TriMesh,
) -> WarpedGrid:
    """Cells of a grid coloured by the unit cell they hold.

    Args:
        layout: which unit cell is where.
        corners: of the cells [mm].
        meets: cells that meet the part.
        part: its surface.
    """
    kinds = layout.kinds.reshape(meets.shape).astype(float)
    names = tuple(cell.name for cell in layout.cells)
    return WarpedGrid(corners, kinds, meets, part, quantity="unit cell", names=names)


def _struts(structure: Structure) -> Struts:
    """Struts by their radius; walls by half their thickness."""
    walls = structure.extrusion
    return Struts(
        structure.joints,
        structure.struts,
        structure.radii,
        structure.radii,
        "strut radius" if walls is None else "half the wall's\nthickness",
        "mm",
        axis=None if walls is None else walls.axis,
    )


def _numbered(run: Run) -> list[tuple[int | None, Support | Load]]:
    numbered: list[tuple[int | None, Support | Load]] = [(None, s) for s in run.case.supports]
    return numbered + list(enumerate(run.case.loads))


def _mark(stress: StressField, number: int | None, action: Support | Load) -> Mark:
    """The mark of a support (`number` None) or of a load with its forces."""
    mesh, name = stress.mesh, action.where.split(": ", 1)[-1]
    facets = np.zeros(0, int) if action.region is None else selected_facets(mesh, action.region)
    patch = TriMesh(mesh.nodes, triangles_of_facets(mesh.boundary_facets[facets])).select(
        slice(None)
    )
    area = float(mesh.facet_areas[facets].sum())
    if isinstance(action, Support) or number is None:
        return mark_of(action, patch, f"{name}: {area:.4g} mm²", np.zeros(3))
    forces = stress.load_forces[number]
    force = forces.sum(axis=0)
    force = np.where(np.abs(force) < ROUNDING * np.abs(forces).sum(), 0.0, force)
    if action.region is None:
        label = f"{name} ({action.case}): gravity, {np.linalg.norm(force):.4g} N"
    elif not force.any():
        label = f"{name} ({action.case}): moment or balanced load on {area:.4g} mm²"
    else:
        label = f"{name} ({action.case}): {np.linalg.norm(force):.4g} N on {area:.4g} mm²"
    return mark_of(action, patch, label, force)


def mean_edge(grid: Grid) -> float:
    """Edge of the cube, or square, as large as a uniform cell [mm]."""
    return float(grid.uniform_edge.prod() ** (1 / grid.dimensions))
