"""The order of the stages, and nothing else."""

from functools import partial

import jax

from texmap_opt.cache import StageCache, stage_key
from texmap_opt.case import DesignCase
from texmap_opt.cell_layout import case_cells, cell_layout, require_zones_in_grid
from texmap_opt.combine.part_with_lattice import plate_result, rod_result
from texmap_opt.endless_lattice import EndlessLattice, endless_lattice
from texmap_opt.errors import TexmapError
from texmap_opt.export.solid_file import Solid
from texmap_opt.filling import fill
from texmap_opt.given_drivers import given_drivers
from texmap_opt.grid_plan import plan_grid
from texmap_opt.part import read_part
from texmap_opt.part_box import part_box
from texmap_opt.plane_loads import require_loads_in_plane
from texmap_opt.progress import Progress, Silent
from texmap_opt.report.numbers import report_numbers
from texmap_opt.run_result import Run
from texmap_opt.solid.float32_solid import printable_mesh
from texmap_opt.solid.validity import require_printable
from texmap_opt.stress_field import StressField, solid_solution, stress_field
from texmap_opt.structure.mixed_net import mixed_net
from texmap_opt.tet_source import part_tets
from texmap_opt.trimmed_lattice import trimmed_lattice
from texmap_opt.warp.warped_grid import WarpedGrid, warped_grid
from texmap_opt.warp_inputs import WarpInputs, warp_inputs

# Share of the strut length in dropped pieces that the user is told of.
NOTABLE_SHARE = 0.05
COMBINE = {"rod": rod_result, "plate": plate_result}


def run(
    case: DesignCase, *, progress: Progress | None = None, cache: StageCache | None = None
) -> Run:
    """From a case to a printable part.

    Args:
        case: the validated input.
        progress: is told of every stage; absent: nobody is.
        cache: where tets, stress and warp are kept; absent: nowhere.

    Raises:
        TexmapError: one sentence that says what is wrong and what to do.
    """
    progress = progress or Progress(Silent())
    try:
        with jax.enable_x64(True):
            return _run(case, progress, cache or StageCache(None))
    except TexmapError as failure:
        if case.path.name in str(failure):
            raise
        raise type(failure)(f"{case.path.name}: {failure}") from failure


def _run(case: DesignCase, progress: Progress, cache: StageCache) -> Run:
    cells = case_cells(case)
    cell = cells.cells[0]
    with progress.stage("part"):
        part = read_part(case.part, case.directory)
        for note in part.notes:
            progress.warn(f"{part.name}: {note}")
        plan = plan_grid(case, part_box(case, part.surface, cell), cell)
        require_loads_in_plane(case, plan.grid.box)
        require_zones_in_grid(case, plan.grid)
        given = given_drivers(case, plan.grid)
        progress.detail(f"{len(part.surface.faces):,} triangles, {part.volume:,.0f} mm³")
    with progress.stage("tets"):
        mesh = part_tets(case, part, cache, solve=partial(solid_solution, case))
        progress.detail(f"{len(mesh.tets):,} {mesh.element}, {len(mesh.nodes):,} nodes")
    stress_of = stage_key("stress", mesh.nodes, mesh.tets, case.material, case.supports, case.loads)
    with progress.stage("stress"):
        stored = cache.get(stress_of)
        stress = StressField.from_arrays(mesh, stored) if stored else stress_field(case, mesh)
        cache.put_new(stress_of, stored, stress.to_arrays)
        progress.detail(f"largest displacement {stress.max_displacement:.3g} mm")
    lattice = endless_lattice(case, plan, cell)
    inputs = warp_inputs(case, part, stress, plan.grid, lattice, given)
    warp = _warped(inputs, lattice, progress, cache)
    with progress.stage("structure"):
        layout = cell_layout(case, cells, warp)
        net, interfaces = mixed_net(layout)
        trimmed = trimmed_lattice(case, part, stress, net, warp.grid, radius_mm=plan.radius_mm)
        progress.detail(f"{len(trimmed.structure.struts):,} struts")
        dropped = trimmed.counts.dropped_share
        if dropped > NOTABLE_SHARE:
            progress.warn(
                f"structure: {100 * dropped:.0f} % of the strut length, in "
                f"{trimmed.counts.components - 1} small pieces that nothing holds, was left out; "
                "smaller cells would connect them"
            )
    filling = fill(case, part, stress, warp, trimmed, progress)
    with progress.stage("result"):
        combined = COMBINE[case.lattice.kind](
            part.surface,
            filling.lattice,
            skin_mm=case.lattice.skin_mm,
            tolerance_mm=case.output.tolerance_mm,
        )
        surface, snapped_mm = printable_mesh(combined.surface)
        validity = require_printable(surface, "The result", given=part.surface)
        progress.detail(f"{len(surface.faces):,} triangles, {surface.volume:,.0f} mm³")
    run = Run(
        case,
        part,
        stress,
        warp,
        cell,
        layout,
        interfaces,
        trimmed,
        filling,
        combined,
        Solid(surface),
        validity,
        {},
    )
    run.report.update(report_numbers(run, progress, snapped_mm=snapped_mm))
    return run


def _warped(
    inputs: WarpInputs, lattice: EndlessLattice | None, progress: Progress, cache: StageCache
) -> WarpedGrid:
    warp_of = stage_key("warp", inputs)
    with progress.stage("warp"):
        stored = cache.get(warp_of)
        warp = WarpedGrid.from_arrays(stored) if stored else warped_grid(inputs)
        cache.put_new(warp_of, stored, warp.to_arrays)
        progress.detail(f"{warp.method}, {warp.grid.cell_count:,} cells")
        if not warp.converged:
            progress.warn(f"warp: {warp.message}")
        return warp.with_energies(lattice)
