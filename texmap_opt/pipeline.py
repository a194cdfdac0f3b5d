"""The order of the stages, and nothing else."""

from functools import partial

import jax

from texmap_opt.cache import StageCache, stage_key
from texmap_opt.case import DesignCase
from texmap_opt.cell_layout import case_cells, cell_layout, require_zones_in_grid
from texmap_opt.combine.opened_surface import opened_surface
from texmap_opt.combine.part_with_lattice import Result as CombinedResult
from texmap_opt.combine.part_with_lattice import plate_result, rod_result
from texmap_opt.endless_lattice import EndlessLattice, endless_lattice
from texmap_opt.errors import TexmapError
from texmap_opt.export.solid_file import Solid
from texmap_opt.filling import Filling, fill
from texmap_opt.given_drivers import given_drivers
from texmap_opt.grid_plan import GridPlan, plan_grid
from texmap_opt.part import Part, read_part
from texmap_opt.part_box import part_box
from texmap_opt.plane_loads import require_loads_in_plane
from texmap_opt.progress import Progress, Silent
from texmap_opt.report.numbers import report_numbers
from texmap_opt.run_result import Run
from texmap_opt.solid.float32_solid import printable_mesh
from texmap_opt.solid.printability import Printability, printability
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.solid.validity import ValidityReport, require_printable
from texmap_opt.stress_field import StressField, solid_solution, stress_field
from texmap_opt.structure.mixed_net import mixed_net
from texmap_opt.structure.trim import Trimmed
from texmap_opt.tet_source import part_tets
from texmap_opt.trimmed_lattice import trimmed_lattice
from texmap_opt.unreached import Unreached, unreached
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
        _require_possible(case, part, plan)
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
        bare = unreached(
            trimmed.structure,
            mesh,
            part,
            cell_mm=float(plan.grid.uniform_edge.max()),
            skin_mm=case.lattice.skin_mm,
        )
        _warn_of_gaps(case, trimmed, bare, progress)
    filling = fill(case, part, stress, warp, trimmed, progress)
    with progress.stage("result"):
        combined = _combined(case, part, filling, progress)
        surface, snapped_mm = printable_mesh(combined.surface)
        validity = require_printable(surface, "The result", given=part.surface)
        progress.detail(f"{len(surface.faces):,} triangles, {surface.volume:,.0f} mm³")
    with progress.stage("printability"):
        printing = _printing(case, part, filling, (surface, validity), progress)
    run = Run(
        case,
        part,
        stress,
        warp,
        cell,
        layout,
        interfaces,
        trimmed,
        bare,
        filling,
        combined,
        Solid(surface),
        validity,
        printing,
        {},
    )
    run.report.update(report_numbers(run, progress, snapped_mm=snapped_mm))
    return run


def _require_possible(case: DesignCase, part: Part, plan: GridPlan) -> None:
    """What a case asks for in vain is told before anything is computed."""
    require_loads_in_plane(case, plan.grid.box)
    require_zones_in_grid(case, plan.grid)
    sizes = {"skin_mm": case.lattice.skin_mm, "tolerance_mm": case.output.tolerance_mm}
    if case.openings:
        opened_surface(part.surface, case.openings, **sizes)


def _combined(case: DesignCase, part: Part, filling: Filling, progress: Progress) -> CombinedResult:
    combined = COMBINE[case.lattice.kind](
        part.surface,
        filling.lattice.surface,
        skin_mm=case.lattice.skin_mm,
        tolerance_mm=case.output.tolerance_mm,
        openings=case.openings,
        drains=case.drains,
    )
    for note in combined.notes():
        progress.warn(note)
    opened = None if combined.skin is None else combined.skin.opened
    if opened is not None and filling.model is not None:
        progress.warn(
            f"result: openings take {sum(opened.mouths_mm2):.3g} mm² off the skin, which the analysis of "
            "the struts takes as closed; a part that needs it there is less stiff"
        )
    return combined


def _printing(
    case: DesignCase,
    part: Part,
    filling: Filling,
    result: tuple[TriMesh, ValidityReport],
    progress: Progress,
) -> Printability | None:
    # The struts of a plate are holes.
    struts = filling.structure if case.lattice.kind == "rod" else None
    printing = printability(*result, structure=struts, given=part.surface)
    for warning in () if printing is None else printing.warnings:
        progress.warn(f"printing: {warning}")
    return printing


def _warn_of_gaps(case: DesignCase, trimmed: Trimmed, bare: Unreached, progress: Progress) -> None:
    dropped = trimmed.counts.dropped_share
    if dropped > NOTABLE_SHARE:
        progress.warn(
            f"structure: {100 * dropped:.0f} % of the strut length, in "
            f"{trimmed.counts.components - 1} small pieces that nothing holds, was left out; "
            "smaller cells would connect them"
        )
    warning = bare.warning(case.lattice.kind)
    if warning is not None:
        progress.warn(warning)


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
