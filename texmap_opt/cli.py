"""`texmap`: arguments to the pipeline; the only file that prints, and the only one that exits."""

import argparse
import json
import shutil
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import jax

from texmap_opt import progress
from texmap_opt.arguments import parsed
from texmap_opt.cache import StageCache
from texmap_opt.errors import InputError, TexmapError

if TYPE_CHECKING:  # commands import what they need, so that `texmap check` starts at once
    from texmap_opt.cells.unit_cell import UnitCell

# Limit of the compiled code that is kept; a run needs about 20 MB.
COMPILED_BYTES = 200_000_000
INTERRUPTED = 130  # 128 + SIGINT, the shell's custom


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the console script; ends the process with the contract's exit code."""
    jax.config.update("jax_enable_x64", True)
    options = parsed(arguments, COMMANDS)
    # Being told to end must end the tet mesher's process too, and leave no partial files.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    _keep_compiled_code()
    try:
        code = options.command(options)
    except TexmapError as failure:
        print(f"texmap: {failure}", file=sys.stderr)
        code = failure.exit_code
    except KeyboardInterrupt:
        print("texmap: interrupted; nothing was written.", file=sys.stderr)
        code = INTERRUPTED
    except MemoryError:
        print(
            "texmap: out of memory; use larger cells, tets (edge_mm) or tolerance_mm.",
            file=sys.stderr,
        )
        code = 1
    except BrokenPipeError:
        print("texmap: the reader of the output went away.", file=sys.stderr)
        code = 1
    except OSError as failure:
        print(f"texmap: {failure}; free some space, or check the folder.", file=sys.stderr)
        code = 1
    sys.exit(code)


def _keep_compiled_code() -> None:
    """Let JAX keep what it compiled beside the stages' cache: the next run starts seconds sooner."""
    directory = StageCache.default().directory
    if directory is not None and not jax.config.jax_compilation_cache_dir:  # pyright: ignore[reportAttributeAccessIssue]
        jax.config.update("jax_compilation_cache_dir", str(directory / "compiled"))
        jax.config.update("jax_compilation_cache_max_size", COMPILED_BYTES)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)


def _run(options: argparse.Namespace) -> int:
    from texmap_opt.case import DesignCase
    from texmap_opt.export.run_folder import check_writable, write_run
    from texmap_opt.pipeline import run

    case = DesignCase.from_toml(options.case, part_file=options.part, warp_method=options.method)
    check_writable(options.out, case.input_files)
    teller = progress.Live()
    if options.quiet:
        teller = progress.Silent()
    elif options.json_progress:
        teller = progress.JsonLines()
    told = progress.Progress(teller)
    cache = StageCache.default(limit_mb=options.cache_mb)
    result = run(case, progress=told, cache=StageCache(None) if options.no_cache else cache)
    report = write_run(result, options.out, told)
    if not options.quiet and not options.json_progress:
        print(_headline(report, options.out))
    return 0


def _headline(report: dict, out: Path) -> str:
    result, sizing = report["result"], report["sizing"]
    line = (
        f"{out / 'part.stl'}: {result['triangles']:,} triangles, {result['volume_mm3']:,.0f} mm³, "
        f"{result['mass_g']:.4g} g"
    )
    if sizing["compliance_after_Nmm"] is not None:
        line += (
            f"; compliance {sizing['compliance_before_Nmm']:.4g} -> "
            f"{sizing['compliance_after_Nmm']:.4g} N mm"
        )
    return f"{line}; {report['seconds']['total']:.0f} s. Open {out / 'report.html'}"


def _look(options: argparse.Namespace) -> int:
    from texmap_opt.case import DesignCase
    from texmap_opt.export.picture_file import require_png
    from texmap_opt.look import draw_look, look

    require_png(options.png)
    case = DesignCase.from_toml(options.case, part_file=options.part)
    seen = look(case)
    print(seen.text())
    files, missing = draw_look(seen, options.png)
    for name, file in files.items():
        print(f"picture   {file}{'' if name == 'look' else ': which unit cell is where'}")
    for reason in missing.values():
        print(f"no picture: {reason}")
    return 0


def _new(options: argparse.Namespace) -> int:
    from texmap_opt.starter import write_starter

    case = write_starter(options.directory)
    print(f"{case} is ready: try `texmap look {case}`, then `texmap run {case} --out out`.")
    return 0


def _cells(options: argparse.Namespace) -> int:
    from texmap_opt.cells.catalogue import cell_names, unit_cell
    from texmap_opt.cells.listing import listing, listing_text
    from texmap_opt.cells.ranking import ranking, wish_of

    for name, absent in (("direction", None), ("density", None), ("ascending", False)):
        if getattr(options, name) is not absent and options.rank is None:
            raise InputError(f"--{name} needs --rank, the property that cells are ordered by.")
    cells = [unit_cell(name) for name in cell_names()]
    cells = [cell for cell in cells if options.dimensions in (None, cell.dimensions)]
    kept = {"cache": StageCache.default(), "computing": _computing}
    if options.rank is not None:
        wish = wish_of(
            options.rank, options.direction, options.density, ascending=options.ascending
        )
        ranked = ranking(cells, wish, **kept)
        print(json.dumps(ranked.as_dict(), indent=2) if options.json else ranked.text())
        return 0
    rows = listing(cells, **kept)
    # As wide as the terminal; whole where it is read by another program.
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else sys.maxsize
    table = [row.as_dict() for row in rows]
    print(json.dumps(table, indent=2) if options.json else listing_text(rows, width))
    return 0


def _computing(count: int) -> None:
    print(f"computing the stiffness of {count} cells; what is found is kept", file=sys.stderr)


def _cell(options: argparse.Namespace) -> int:
    from texmap_opt.cells.at_density import radius_of_density
    from texmap_opt.cells.catalogue import cell_names, unit_cell
    from texmap_opt.cells.listing import cell_text
    from texmap_opt.export.picture_file import require_png

    for picture in (options.png, options.stiffness):
        if picture is not None:
            require_png(picture)
    if options.radius is not None and options.density is not None:
        raise InputError("--radius and --density were both given; one follows from the other.")
    if options.stiffness and options.radius is None and options.density is None:
        raise InputError(
            "--stiffness needs --radius, the strut radius over the cell's edge, or --density."
        )
    cell = unit_cell(options.name)
    print(cell_text(cell, map(unit_cell, cell_names())))
    if options.density is not None:
        _stiffness(cell, radius_of_density(cell, options.density), options.stiffness)
    elif options.radius is not None:
        _stiffness(cell, options.radius, options.stiffness)
    if options.png:
        from texmap_opt.cells.drawn_cell import drawn_cell
        from texmap_opt.report.drawing import draw_cell

        draw_cell(drawn_cell(cell), options.png)
        print(f"  picture: {options.png}")
    return 0


def _stiffness(cell: "UnitCell", radius: float, png: Path | None) -> None:
    from fea.plane_stiffness import PlaneStiffness
    from texmap_opt.cells.at_density import homogenised
    from texmap_opt.report.drawing import draw_polar_stiffness, draw_stiffness

    found = homogenised(cell, radius)
    print("\n".join(f"  {line}" for line in found.text().splitlines()))
    if png:
        quantity = "Young's modulus\nover the solid's"
        if isinstance(found.stiffness, PlaneStiffness):
            draw_polar_stiffness(found.stiffness.polar_modulus(), png, quantity=quantity)
        else:
            draw_stiffness(found.stiffness.directional_modulus(), png, quantity=quantity)
        print(f"  picture: {png}")


def _mesh(options: argparse.Namespace) -> int:
    from texmap_opt.export.solid_file import Solid, check_ending
    from texmap_opt.solid.float32_solid import printable_mesh
    from texmap_opt.solid.lattice_solid import lattice_solid
    from texmap_opt.structure.structure_xml import read_structure

    tolerance = _positive(options.tolerance, "--tolerance")
    check_ending(options.output)
    if not options.fillet >= 0:
        raise InputError(f"--fillet {options.fillet}: must be 0 or more [mm].")
    structure = read_structure(options.structure)
    lattice = lattice_solid(structure, tolerance_mm=tolerance, fillet_mm=options.fillet)
    for note in lattice.notes(options.fillet):
        print(f"texmap: {note}", file=sys.stderr)
    surface, _ = printable_mesh(lattice.surface)
    Solid(surface).save(options.output)
    print(f"{options.output}: {len(surface.faces):,} triangles, {surface.volume:,.1f} mm³")
    return 0


def _convert(options: argparse.Namespace) -> int:
    import fea
    from texmap_opt.structure_file import (
        BeamDeck,
        Reading,
        check_conversion,
        lost_in_cell,
        read_structure_file,
        write_structure_file,
    )

    check_conversion(options.input, options.output, vars(options))
    try:
        material = None if options.material is None else fea.material(options.material)
    except fea.FeaError as failure:
        raise InputError(f"--material: {failure}") from failure
    reading = Reading(options.unit or "mm", options.radius, options.section or "round")
    source = read_structure_file(options.input, reading)
    if options.cell is not None:
        from texmap_opt.export.unit_cell import write_unit_cell

        name, origin = options.cell, options.input.name
        how = {"name": name, "source": origin, "tiling": options.tiling or "translate"}
        write_unit_cell(options.output, source.structure, **how)
        lost = lost_in_cell(source.structure)
    else:
        segments = 1 if options.segments is None else options.segments
        deck = BeamDeck(options.solver or "abaqus", segments, material)
        lost = write_structure_file(options.output, source, deck)
    for path, notes in ((options.input, source.notes), (options.output, lost)):
        print("".join(f"note: {path.name}: {note}\n" for note in notes), end="")
    structure = source.structure
    print(
        f"{options.output}: {len(structure.joints):,} joints, {len(structure.struts):,} "
        f"{'walls' if structure.extrusion else f'{structure.section} struts'}"
    )
    return 0


def _combine(options: argparse.Namespace) -> int:
    from texmap_opt.case_openings import drain_from_text, opening_from_text
    from texmap_opt.combine.part_with_lattice import plate_result, rod_result
    from texmap_opt.export.solid_file import Solid, check_ending
    from texmap_opt.part import read_solid, read_surface
    from texmap_opt.solid.float32_solid import printable_mesh
    from texmap_opt.solid.validity import require_printable

    tolerance = _positive(options.tolerance, "--tolerance")
    if not options.skin >= 0:
        raise InputError(f"--skin {options.skin}: must be 0 or more [mm].")
    check_ending(options.output)
    skin = {
        "skin_mm": options.skin,
        "tolerance_mm": tolerance,
        "openings": [opening_from_text(text) for text in options.opening],
        "drains": [drain_from_text(text) for text in options.drain],
    }
    part = read_surface(options.part, unit=options.unit)
    lattice = read_solid(options.lattice, unit="mm")
    join = rod_result if options.kind == "rod" else plate_result
    combined = join(part.surface, lattice, **skin)
    for note in combined.notes():
        print(f"texmap: {note}", file=sys.stderr)
    surface, _ = printable_mesh(combined.surface)
    require_printable(surface, "The result", given=part.surface)
    Solid(surface).save(options.output)
    print(f"{options.output}: {len(surface.faces):,} triangles, {surface.volume:,.1f} mm³")
    return 0


def _split(options: argparse.Namespace) -> int:
    from texmap_opt.combine.halves import halves, middle_plane, plane_from_text
    from texmap_opt.export.metadata import Metadata
    from texmap_opt.export.solid_file import Solid, check_ending
    from texmap_opt.export.three_mf import write_objects
    from texmap_opt.part import read_solid
    from texmap_opt.solid.float32_solid import printable_mesh

    files = options.output
    together = len(files) == 1 and files[0].suffix.lower() == ".3mf"
    if not together and (len(files) != 2 or files[0].resolve() == files[1].resolve()):
        raise InputError("-o: name two different files, or one 3MF file that holds both pieces.")
    for file in files:
        check_ending(file)
    given = None if options.plane is None else plane_from_text(options.plane)
    surface = read_solid(options.file, unit=options.unit)
    pieces = [
        printable_mesh(piece)[0] for piece in halves(surface, *given or middle_plane(surface))
    ]
    if together:
        title = Metadata(title=f"{options.file.stem} in two")
        write_objects(files[0], dict(zip(("first", "second"), pieces, strict=True)), title)
    else:
        for piece, file in zip(pieces, files, strict=True):
            Solid(piece).save(file)
    for piece, file in zip(pieces, files * (3 - len(files)), strict=True):
        print(f"{file}: {len(piece.faces):,} triangles, {piece.volume:,.1f} mm³")
    return 0


def _check(options: argparse.Namespace) -> int:
    from texmap_opt.cells.properties import direction_of
    from texmap_opt.part_file import read_any_surface
    from texmap_opt.solid.printability import PrintLimits, printability
    from texmap_opt.solid.validity import validity

    x, y, z = direction_of(options.build_direction).tolist()
    limits = PrintLimits((x, y, z), options.overhang, options.min_wall, options.min_gap)
    surface = read_any_surface(options.file)
    report = validity(surface)
    measured = printability(surface, report, limits=limits)
    numbers = {"printability": None if measured is None else measured.as_dict()}
    print(json.dumps(report.as_dict() | numbers, indent=2, allow_nan=False))
    violations = [] if measured is None else measured.violations
    for violation in violations:
        print(f"texmap: {options.file.name}: {violation}.", file=sys.stderr)
    return 0 if report.printable and not violations else 1


def _positive(value: float, name: str) -> float:
    if not value > 0:
        raise InputError(f"{name} {value}: must be above 0 [mm].")
    return value


COMMANDS = {
    "run": _run,
    "look": _look,
    "new": _new,
    "cells": _cells,
    "cell": _cell,
    "mesh": _mesh,
    "combine": _combine,
    "split": _split,
    "convert": _convert,
    "check": _check,
}
