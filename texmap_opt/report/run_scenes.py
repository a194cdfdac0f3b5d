"""The pictures of a run: which values each of them shows."""

import numpy as np
from jaxtyping import Bool

from texmap_opt.case import Load, Support
from texmap_opt.report.marks import mark_of
from texmap_opt.report.scenes import (
    CutOpen,
    LoadedPart,
    Mark,
    Scene,
    Struts,
    WarpedGrid,
    Whole,
    cell_sizes,
    triangles_of_facets,
)
from texmap_opt.run_result import Run
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.stress_field import StressField, selected_facets

# A resultant below this share of the sum of its forces is their rounding: the load is a moment.
ROUNDING = 1e-9


def run_scenes(run: Run) -> dict[str, Scene]:
    """All scenes of a run by the names that the page knows."""
    stress, grid = run.stress, run.warp.grid
    mesh = stress.mesh
    faces = triangles_of_facets(mesh.boundary_facets)
    used, numbered = np.unique(faces, return_inverse=True)
    marks = tuple(_mark(stress, k, a) for k, a in _numbered(run))
    scenes: dict[str, Scene] = {
        "load": LoadedPart(
            TriMesh(mesh.nodes[used], numbered.reshape(-1, 3)),
            stress.von_mises.max(axis=0)[used],
            marks,
        ),
        "grid": WarpedGrid(grid.nodes, cell_sizes(grid.nodes), _meets(run), run.part.surface),
    }
    structure, sized = run.filling.structure, run.filling.sized
    scenes["radius"] = Struts(
        structure.joints, structure.struts, structure.radii, structure.radii, "strut radius", "mm"
    )
    if sized is not None and sized.utilisation is not None:
        worst = np.repeat(sized.utilisation[:, None], 2, axis=1)
        scenes["utilisation"] = Struts(
            structure.joints, structure.struts, structure.radii, worst, "utilisation", "", limit=1.0
        )
    return scenes | {"cut": CutOpen(run.solid.surface), "whole": Whole(run.solid.surface)}


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


def _meets(run: Run) -> Bool[np.ndarray, "x y z"]:
    """Cells whose centre is in the part, or within half their diagonal of its surface."""
    grid = run.warp.grid
    corners = grid.nodes.reshape(-1, 3)[grid.hexes]
    reach = np.linalg.norm(corners - grid.centres[:, None], axis=2).max(axis=1)
    _, distance, _ = run.part.closest(grid.centres)
    return (distance < 0.5 * reach).reshape(grid.cells)
