"""`texmap`: arguments to the pipeline; the only file that prints, and the only one that exits."""

import argparse
import json
import shutil
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import jax

from texmap_opt import progress
from texmap_opt.cache import DEFAULT_LIMIT_MB, StageCache
from texmap_opt.errors import InputError, TexmapError

if TYPE_CHECKING:  # commands import what they need, so that `texmap check` starts at once
    from texmap_opt.cells.unit_cell import UnitCell

# Limit of the compiled code that is kept; a run needs about 20 MB.
COMPILED_BYTES = 200_000_000
INTERRUPTED = 130  # 128 + SIGINT, the shell's custom


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the console script; ends the process with the contract's exit code."""
    jax.config.update("jax_enable_x64", True)
    options = _parser().parse_args(arguments)
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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="texmap", description="Fill a part with a lattice shaped by its own stresses."
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, function, help_text: str) -> argparse.ArgumentParser:
        added = commands.add_parser(name, help=help_text, description=help_text)
        added.set_defaults(command=function)
        return added

    run = command("run", _run, "the main job: from a case file to a printable part")
    run.add_argument("case", type=Path, help="case file (TOML)")
    run.add_argument("--out", type=Path, required=True, help="folder for the results")
    _case_options(run)
    loudness = run.add_mutually_exclusive_group()
    loudness.add_argument("--quiet", action="store_true", help="say nothing but errors")
    loudness.add_argument("--json-progress", action="store_true", help="progress as JSON lines")

    look = command("look", _look, "what a run would do: picture and estimates, in seconds")
    look.add_argument("case", type=Path, help="case file (TOML)")
    look.add_argument("--png", type=Path, default=Path("look.png"), help="where the picture goes")
    look.add_argument("--part", type=Path, help="replaces [part] file")

    new = command("new", _new, "write a commented starter case with its part")
    new.add_argument("directory", type=Path)

    _library_commands(command)

    mesh = command("mesh", _mesh, "the solid of a structure.xml")
    mesh.add_argument("structure", type=Path)
    mesh.add_argument("-o", "--output", type=Path, required=True, help="STL or 3MF")
    _tolerance(mesh)

    combine = command("combine", _combine, "join a part with a lattice solid")
    combine.add_argument("part", type=Path)
    combine.add_argument("lattice", type=Path)
    combine.add_argument("-o", "--output", type=Path, required=True, help="STL or 3MF")
    combine.add_argument("--kind", choices=["rod", "plate"], default="rod")
    combine.add_argument("--skin", type=float, default=1.0, help="skin thickness [mm]; 0: none")
    combine.add_argument("--unit", default="mm", choices=["mm", "cm", "m", "in"])
    _tolerance(combine)

    _convert_options(command("convert", _convert, "a structure from one file format to another"))

    command("check", _check, "validity report of a surface file, as JSON").add_argument(
        "file", type=Path
    )
    return parser


def _library_commands(command: Callable[..., argparse.ArgumentParser]) -> None:
    cells = command(
        "cells", _cells, "list the unit cells of the library, or order them by a property"
    )
    cells.add_argument(
        "--rank", metavar="PROPERTY", help="order them by this, such as E or E_ratio"
    )
    cells.add_argument(
        "--direction",
        help="of E, G and nu; default 1,0,0; =-1,0,0 with a minus",
    )
    cells.add_argument("--density", type=float, help="relative density to rank at; default 0.1")
    cells.add_argument("--ascending", action="store_true", help="rank the least first")
    cells.add_argument(
        "--dimensions", type=int, choices=[2, 3], help="3-D cells only, or 2.5-D (2)"
    )
    cells.add_argument("--json", action="store_true", help="print it as JSON")
    cell = command("cell", _cell, "describe one unit cell, and draw it")
    cell.add_argument("name", help="a name of `texmap cells`, or a unit-cell XML")
    cell.add_argument("--png", type=Path, help="draw it into this file")
    cell.add_argument(
        "--radius",
        type=float,
        help="strut radius over the cell's edge: print stiffness and density",
    )
    cell.add_argument("--density", type=float, help="relative density, instead of the radius")
    cell.add_argument(
        "--stiffness", type=Path, help="draw Young's modulus over all directions into this file"
    )


def _case_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--part", type=Path, help="replaces [part] file")
    parser.add_argument("--method", help="replaces [warp] method")
    parser.add_argument("--no-cache", action="store_true", help="compute every stage anew")
    parser.add_argument(
        "--cache-mb", type=float, default=DEFAULT_LIMIT_MB, help="size limit of the cache [MB]"
    )


def _convert_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("input", type=Path, help="XML, NPZ, INP, 3MF, LTCX, VTP, VTU or VTK")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, help="XML, NPZ, INP, 3MF or VTP"
    )
    parser.add_argument(
        "--unit", choices=["mm", "cm", "m", "in"], help="of an INP or VTK file read; default mm"
    )
    parser.add_argument("--radius", type=float, help="where a VTK or LTCX file has none [mm]")
    parser.add_argument(
        "--section", choices=["round", "square"], help="of a VTK or LTCX file; default round"
    )
    parser.add_argument(
        "--solver", choices=["abaqus", "calculix"], help="an INP file is for; default abaqus"
    )
    parser.add_argument(
        "--segments", type=int, help="elements of a strut in an INP file; default 1"
    )
    parser.add_argument("--material", help="of an INP file, by its name")
    parser.add_argument("--cell", metavar="NAME", help="write it as a unit cell of that name (XML)")
    parser.add_argument(
        "--tiling", help="of --cell: translate (default), mirror, or a word an axis in one argument"
    )


def _tolerance(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--tolerance", type=float, default=0.05, help="geometric error bound [mm]")


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
    from texmap_opt.look import draw_look, look

    case = DesignCase.from_toml(options.case, part_file=options.part)
    seen = look(case)
    print(seen.text())
    missing = draw_look(seen, options.png)
    print(f"no picture: {missing}" if missing else f"picture: {options.png}")
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
    surface = lattice_solid(read_structure(options.structure), tolerance_mm=tolerance)
    surface, _ = printable_mesh(surface)
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
    from texmap_opt.combine.part_with_lattice import plate_result, rod_result
    from texmap_opt.export.solid_file import Solid, check_ending
    from texmap_opt.part import read_surface
    from texmap_opt.solid.float32_solid import printable_mesh

    tolerance = _positive(options.tolerance, "--tolerance")
    if not options.skin >= 0:
        raise InputError(f"--skin {options.skin}: must be 0 or more [mm].")
    check_ending(options.output)
    part = read_surface(options.part, unit=options.unit)
    lattice = read_surface(options.lattice, unit="mm")
    join = rod_result if options.kind == "rod" else plate_result
    combined = join(part.surface, lattice.surface, skin_mm=options.skin, tolerance_mm=tolerance)
    surface, _ = printable_mesh(combined.surface)
    Solid(surface).save(options.output)
    print(f"{options.output}: {len(surface.faces):,} triangles, {surface.volume:,.1f} mm³")
    return 0


def _check(options: argparse.Namespace) -> int:
    from texmap_opt.part_file import read_surface_file
    from texmap_opt.solid.validity import validity

    report = validity(read_surface_file(options.file))
    print(json.dumps(report.as_dict(), indent=2))
    return 0 if report.printable else 1


def _positive(value: float, name: str) -> float:
    if not value > 0:
        raise InputError(f"{name} {value}: must be above 0 [mm].")
    return value
