"""What may be typed after `texmap`: commands and their options."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NoReturn

from texmap_opt.cache import DEFAULT_LIMIT_MB
from texmap_opt.errors import InputError


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage, and where the usage is found."""

    def error(self, message: str) -> NoReturn:
        self.exit(InputError.exit_code, f"{self.prog}: {message}; see `{self.prog} --help`.\n")


def parsed(
    arguments: Sequence[str] | None, commands: Mapping[str, Callable[[argparse.Namespace], int]]
) -> argparse.Namespace:
    """What was typed; ends the process with one line and the exit code of bad input if it is wrong.

    Args:
        arguments: without the program's name; None: those of the process.
        commands: what carries out each command.

    Returns:
        The options, among them `command`, one of the functions.
    """
    parser = _parser(commands)
    options, unknown = parser.parse_known_args(arguments)
    if unknown:
        # The whole program's parser would not tell which command does not know them.
        options.parser.error(f"unknown argument {' '.join(unknown)}")
    return options


def _parser(functions: Mapping[str, Callable[[argparse.Namespace], int]]) -> _Parser:
    parser = _Parser(
        prog="texmap", description="Fill a part with a lattice shaped by its own stresses."
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, help_text: str) -> argparse.ArgumentParser:
        added = commands.add_parser(name, help=help_text, description=help_text)
        added.set_defaults(command=functions[name], parser=added)
        return added

    run = command("run", "the main job: from a case file to a printable part")
    run.add_argument("case", type=Path, help="case file (TOML)")
    run.add_argument("--out", type=Path, required=True, help="folder for the results")
    _case_options(run)
    loudness = run.add_mutually_exclusive_group()
    loudness.add_argument("--quiet", action="store_true", help="say nothing but errors")
    loudness.add_argument("--json-progress", action="store_true", help="progress as JSON lines")

    look = command("look", "what a run would do: picture and estimates, in seconds")
    look.add_argument("case", type=Path, help="case file (TOML)")
    look.add_argument("--png", type=Path, default=Path("look.png"), help="where the picture goes")
    look.add_argument("--part", type=Path, help="replaces [part] file")

    new = command("new", "write a commented starter case with its part")
    new.add_argument("directory", type=Path)

    _library_commands(command)

    mesh = command("mesh", "the solid of a structure.xml")
    mesh.add_argument("structure", type=Path)
    mesh.add_argument("-o", "--output", type=Path, required=True, help="STL or 3MF")
    mesh.add_argument("--fillet", type=float, default=0.0, help="radius of fillets at joints [mm]")
    _tolerance(mesh)

    _combine_options(command("combine", "join a part with a lattice solid"))
    _split_options(command("split", "cut a solid in two by a plane"))

    _convert_options(command("convert", "a structure from one file format to another"))

    _check_options(command("check", "validity and printability of a surface file, as JSON"))
    return parser


def _library_commands(command: Callable[..., argparse.ArgumentParser]) -> None:
    cells = command("cells", "list the unit cells of the library, or order them by a property")
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
    cell = command("cell", "describe one unit cell, and draw it")
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


def _combine_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("part", type=Path)
    parser.add_argument("lattice", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True, help="STL or 3MF")
    parser.add_argument("--kind", choices=["rod", "plate"], default="rod")
    parser.add_argument("--skin", type=float, default=1.0, help="skin thickness [mm]; 0: none")
    parser.add_argument("--unit", default="mm", choices=["mm", "cm", "m", "in"])
    parser.add_argument(
        "--opening",
        action="append",
        default=[],
        metavar="REGION",
        help="leave the skin open there; several times for several: 'box = [[0,0,0],[9,9,1]]', as in a "
        "case file",
    )
    parser.add_argument(
        "--drain",
        action="append",
        default=[],
        metavar="X,Y,Z,DIAMETER",
        help="a round hole through the skin at the nearest point of the surface; several times for "
        "several; direction appended as ,DX,DY,DZ; =-1,2,3,4 with a minus",
    )
    _tolerance(parser)


def _split_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, help="STL, OBJ, PLY or 3MF")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        nargs="+",
        required=True,
        help="two files, or one 3MF that holds both",
    )
    parser.add_argument(
        "--plane",
        metavar="NX,NY,NZ,OFFSET",
        help="at OFFSET mm along the normal, which points to the second piece; =-1,0,0,5 with a minus "
        "(absent: across the longest side, half way)",
    )
    parser.add_argument("--unit", default="mm", choices=["mm", "cm", "m", "in"])


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


def _check_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path)
    parser.add_argument(
        "--build-direction",
        default="0,0,1",
        help="away from the build plate; default 0,0,1; =-1,0,0 with a minus",
    )
    parser.add_argument(
        "--overhang",
        type=float,
        default=45.0,
        help="angle to the plate that prints without supports [degrees]; default 45",
    )
    parser.add_argument("--min-wall", type=float, help="exit 1 if a wall or strut is thinner [mm]")
    parser.add_argument("--min-gap", type=float, help="exit 1 if a gap is narrower [mm]")


def _tolerance(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--tolerance", type=float, default=0.05, help="geometric error bound [mm]")
