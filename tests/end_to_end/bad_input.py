"""Every kind of bad input with the command that meets it; run it to print what the program says.

`python3 tests/end_to_end/bad_input.py > docs/bad-input.md`
"""

import contextlib
import io
import re
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from sound_case import BOX, CASE, FACES, changed_case, write_stl

# A painted region.
SPHERE = """[[paint]]
region = { sphere = { center = [20, 10, 10], radius = 5 } }
value = 2"""
# The sound case from the number of cells to the method.
FROM_CELLS = CASE[CASE.index("cell_mm") : CASE.index("[output]")]
# What the faults themselves put into the folder.
INPUTS = {"case.toml", "box.stl", "small.stl", "field.csv"}


@dataclass(frozen=True)
class BadInput:
    """One fault.

    Attributes:
        name: what is wrong, in a few words.
        change: turns the sound case into the faulty one.
        part: writes the part's file; None: the sound box.
        code: exit code of the contract: 2 for bad input, 1 where computing revealed it, 0 where it
            was repaired or doubted, with a warning.
        says: what the message must contain.
    """

    name: str
    change: tuple[str, str] = ("", "")
    part: Callable[[Path], object] | None = None
    code: int = 2
    says: tuple[str, ...] = ()


def _box(vertices: np.ndarray = BOX, faces: np.ndarray = FACES) -> Callable[[Path], object]:
    return lambda path: write_stl(path, vertices, faces)


def _two(shift: tuple[float, float, float]) -> Callable[[Path], object]:
    both = np.concatenate([BOX, BOX + np.array(shift)])
    return lambda path: write_stl(path, both, np.concatenate([FACES, FACES + 8]))


def _nan() -> Callable[[Path], object]:
    spoilt = BOX.copy()
    spoilt[0, 0] = np.nan
    return _box(spoilt)


def _importing(field: str, file: str = "field.csv", more: str = "") -> tuple[str, str]:
    warp = f'"least-squares"\ndriver = ["file"]\n{more}'
    return '"uniform"', f'{warp}\n[imported]\nfile = "{file}"\nfield = "{field}"'


def _results(
    f: Callable[[np.ndarray], np.ndarray] = lambda points: 1 + points[:, 0],
    *,
    scale: float = 1.0,
    names: str = "v",
) -> Callable[[Path], object]:
    """The sound box, and a table of values f all over it whose coordinates are scaled."""
    axes = [np.linspace(0, length, n) for length, n in zip((40, 20, 20), (9, 5, 5), strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    with np.errstate(invalid="ignore"):
        table = np.column_stack([scale * points, f(points)])

    def write(path: Path) -> None:
        write_stl(path, BOX, FACES)
        np.savetxt(
            path.with_name("field.csv"), table, delimiter=",", header=f"x,y,z,{names}", comments=""
        )

    return write


def _zone(cell: str, choice: str, after: str = "[warp]") -> str:
    return f'[[zone]]\ncell = "{cell}"\n{choice}\n{after}'


BAD_INPUTS = (
    BadInput("file that is not there", ('"box.stl"', '"bax.stl"'), says=("bax.stl", "no such file")),
    BadInput("empty file", part=lambda path: path.write_bytes(b""), says=("box.stl", "empty")),
    BadInput("open surface", part=_box(faces=FACES[2:]), says=("box.stl", "open")),
    BadInput("inside-out", part=_box(faces=FACES[:, ::-1]), code=0, says=("box.stl", "inside out")),
    BadInput("unit that makes the part 50 m", ('"box.stl"', '"box.stl"\nunit = "m"'), says=("very large", "should [part] unit be")),
    BadInput("unit that makes the part 0.05 mm", ('"box.stl"', '"small.stl"'), part=lambda path: write_stl(path.with_name("small.stl"), BOX / 1000, FACES), says=("very small", "cell_mm")),
    BadInput("NaN coordinates", part=_nan(), says=("box.stl", "not finite")),
    BadInput("two solids", part=_two((100, 0, 0)), says=("box.stl", "2 solids", "solid = 1")),
    BadInput("self-intersecting", part=_two((30, 7, 3)), says=("box.stl", "cross")),
    BadInput("region that selects nothing", ("[40, 0, 0]", "[50, 0, 0]"), says=("[[load]] 1", "nothing")),
    BadInput(
        "no supports",
        ("[[support]]\nregion = { plane = { point = [0, 0, 0], normal = [1, 0, 0] } }\n", ""),
        says=("[[support]]",),
    ),
    BadInput(
        "supports that leave a rigid motion",
        ("normal = [1, 0, 0] } }\n[[load]]", 'normal = [1, 0, 0] } }\nfix = ["x"]\n[[load]]'),
        says=("[[support]]", "can slide along"),
    ),
    BadInput("load on nothing but held nodes", ("[40, 0, 0]", "[0, 0, 0]"), says=("held",)),
    BadInput("load of zero", ("[0, 0, -10]", "[0, 0, 0]"), says=("force_N", "zero")),
    BadInput("unknown cell", ('"bcc"', '"bbc"'), says=("bbc", '"bcc"')),
    BadInput("unknown key", ("skin_mm", "skn_mm"), says=("skn_mm", '"skin_mm"')),
    BadInput("unknown section", ("[warp]", "[wrap]"), says=("wrap", '"warp"')),
    BadInput("unknown method", ('"uniform"', '"unifrm"'), says=("unifrm", '"uniform"')),
    BadInput("unknown material", ('"PA12"', '"PA13"'), says=("PA13", "PA12")),
    BadInput("cells larger than the part", ("cell_mm = 10.0", "cell_mm = 50"), says=("cell_mm", "larger")),
    BadInput("three counts of cells in the plane", ('"bcc"\ncell_mm = 10.0', '"octagon"\ncells = [4, 2, 2]'), says=("cells = [4, 2, 2]", "octagon", "2 numbers", "x and y")),
    BadInput("two counts of cells in space", ("cell_mm = 10.0", "cells = [4, 2]"), says=("cells = [4, 2]", "bcc", "3 numbers", "x and y and z")),
    BadInput("extrusion of a 3-D cell", ('"bcc"', '"bcc"\nextrusion = "x"'), says=("extrusion", "bcc", "2.5-D")),
    BadInput("section of walls", ('"bcc"', '"octagon"\nsection = "round"'), says=("section", "octagon", "walls")),
    BadInput("fixed end of an extrusion", ('"bcc"\n' + FROM_CELLS, '"octagon"\n' + FROM_CELLS.replace('"uniform"', '"uniform"\nfixed_faces = ["+z"]')), says=("fixed_faces", "+z", "extrusion")),
    BadInput("load along the walls of a 2.5-D cell", ('"bcc"', '"octagon"'), says=("[[load]] 1", "bend about that axis only", "extrusion")),
    BadInput("radius that fills the cells", ("radius_mm = 0.8", "radius_mm = 6"), says=("radius_mm", "fills")),
    BadInput("radius too thin to print", ("radius_mm = 0.8", "radius_mm = 0.01"), says=("radius_mm", "print")),
    BadInput("skin thicker than the part", ("skin_mm = 1.0", "skin_mm = 11"), code=1, says=("skin_mm", "no room")),
    BadInput("negative number", ("skin_mm = 1.0", "skin_mm = -1"), says=("skin_mm = -1", "at least 0")),
    BadInput("zero where none may be", ("edge_mm = 6.0", "edge_mm = 0"), says=("edge_mm = 0", "above 0")),
    BadInput("an error that nothing refines to", ("edge_mm = 6.0", "edge_mm = 6.0\nmax_error = 0.9"), says=("max_error = 0.9", "0.5")),
    BadInput("wrong type", ("cell_mm = 10.0", 'cell_mm = "10"'), says=("cell_mm", "number")),
    BadInput("bounds in the wrong order", ("[output]", "[sizing]\nmin_radius_mm = 2\nmax_radius_mm = 1\n[output]"), says=("min_radius_mm", "max_radius_mm")),
    BadInput("sizing of holes", ("radius_mm = 0.8", "radius_mm = 0.8\nkind = \"plate\"\n[sizing]\nmethod = \"mma\""), says=("plate", "none")),
    BadInput("not TOML", ("[lattice]", "[lattice"), says=("TOML",)),
    BadInput("volume out of reach", ("[output]", "[sizing]\nvolume_fraction = 0.3\nmax_radius_mm = 0.9\n[output]"), code=1, says=("reach",)),
    BadInput("contrast below 1", ('"uniform"', '"uniform"\ncontrast = 0.5'), says=("contrast = 0.5", "at least 1")),
    BadInput("one cell along an axis to warp", (FROM_CELLS, FROM_CELLS.replace("cell_mm = 10.0", "cells = [4, 2, 1]").replace('"uniform"', '"least-squares"\nmargin_cells = 0')), says=("least-squares", "4 x 2 x 1", "along z", "uniform")),
    BadInput("driver that is not there", ('"uniform"', '"uniform"\ndriver = ["von-mises", "tresca"]'), says=("driver", "tresca", "not known")),
    BadInput("paint without a region", ('"uniform"', '"uniform"\ndriver = ["paint"]'), says=('driver = ["paint"]', "[[paint]]")),
    BadInput("painted region that drives nothing", ('"uniform"', '"uniform"\n' + SPHERE), says=("[[paint]]", "drives nothing", '"von-mises"')),
    BadInput("painted region outside the box", ('"uniform"', '"uniform"\ndriver = ["paint"]\n' + SPHERE.replace("20, 10, 10", "90, 10, 10")), says=("[[paint]] 1", "sphere", "outside", "margin")),
    BadInput("painted factor of zero", ('"uniform"', '"uniform"\ndriver = ["paint"]\n' + SPHERE.replace("value = 2", "value = 0")), says=("[[paint]] 1", "value = 0", "above 0")),
    BadInput("painted part of the surface", ('"uniform"', '"uniform"\ndriver = ["paint"]\n' + SPHERE.replace("{ sphere = { center = [20, 10, 10], radius = 5 } }", "{ normal = [1, 0, 0] }")), says=("[[paint]] 1", "normal", "surface")),
    BadInput("opening of a part without a skin", ("skin_mm = 1.0\nradius_mm = 0.8", 'skin_mm = 0\nradius_mm = 0.8\n[[opening]]\nregion = { normal = [0, 0, 1] }'), says=("[[opening]] 1", "skin_mm = 0")),
    BadInput("opening beside the part", ("[warp]", "[[opening]]\nregion = { sphere = { center = [90, 10, 20], radius = 5 } }\n[warp]"), says=("[[opening]] 1", "holds nothing", "[40, 20, 20]")),
    BadInput("opening narrower than two skins", ("[warp]", "[[opening]]\nregion = { sphere = { center = [20, 10, 20], radius = 0.8 } }\n[warp]"), says=("[[opening]] 1", "opens nothing", "1 mm thick", "wider")),
    BadInput("opening of everything", ("[warp]", "[[opening]]\nregion = { box = [[-1, -1, -1], [41, 21, 21]] }\n[warp]"), says=("[[opening]] 1", "leaves nothing", "skin_mm = 0")),
    BadInput("drain hole without a diameter", ("[warp]", "[[drain]]\npoint = [20, 10, 20]\n[warp]"), says=("[[drain]] 1", "diameter_mm is missing")),
    BadInput("drain hole along no direction", ("[warp]", "[[drain]]\npoint = [20, 10, 20]\ndiameter_mm = 2\ndirection = [0, 0, 0]\n[warp]"), says=("[[drain]] 1", "no length")),
    BadInput("drain hole out of the part", ("[warp]", "[[drain]]\npoint = [20, 10, 20]\ndiameter_mm = 2\ndirection = [0, 0, 1]\n[warp]"), says=("[[drain]] 1", "leads out of the part")),
    BadInput("zone without a choice of cells", ("[warp]", '[[zone]]\ncell = "octet"\n[warp]'), says=("[[zone]] 1", "no choice", "grid_cells")),
    BadInput("zone with an unknown cell", ("[warp]", _zone("octed", "f_least = 1")), says=("[[zone]] 1", "octed", '"octet"')),
    BadInput("zone with a cell of other dimensions", ("[warp]", _zone("honeycomb", "f_least = 1")), says=("[[zone]] 1", "2 dimensions", '"bcc" has 3')),
    BadInput("zone beyond the grid", ("[warp]", _zone("octet", "grid_cells = [[0, 0, 0], [9, 1, 1]]")), says=("[[zone]] 1", "[4, 2, 2]", "margin_cells = 1")),
    BadInput("zone outside the part", ("[warp]", _zone("octet", "region = { box = [[50, 0, 0], [60, 9, 9]] }")), says=("[[zone]] 1", "centre of no cell", "smaller cells")),
    BadInput("zone where f never is", ('"uniform"', '"uniform"\ndriver = ["paint"]\n' + SPHERE + "\n" + _zone("octet", "f_least = 5", "")), says=("[[zone]] 1", "f_least = 5", "runs from")),
    BadInput("anisotropy without a tensor", ('"uniform"', '"least-squares"\nalignment = 10\ndriver = ["paint"]\n' + SPHERE), says=("alignment = 10", "tensor", '"paint"')),
    BadInput("weights for other drivers", ('"uniform"', '"uniform"\ndriver_weights = [1, 2]'), says=("driver_weights", "2 for 1")),
    BadInput("weight of an unknown load case", ('"uniform"', '"uniform"\ncase_weights = { lead = 2 }'), says=("case_weights lead", '"load"')),
    BadInput("all load cases left out", ('"uniform"', '"uniform"\ncase_weights = { load = 0 }'), says=("case_weights", "nothing drives")),
    BadInput("axes that are not at right angles", ('"uniform"', '"uniform"\naxes = [[1, 0, 0], [1, 1, 0], [0, 0, 1]]'), says=("axes", "right angles")),
    BadInput("left-handed axes", ('"uniform"', '"uniform"\naxes = [[0, 1, 0], [1, 0, 0], [0, 0, 1]]'), says=("axes", "left-handed")),
    BadInput("imported result without its table", ('"uniform"', '"uniform"\ndriver = ["file"]'), says=("[imported]",)),
    BadInput("imported result that is not there", _importing("v", "filed.csv"), says=("[imported]", "filed.csv")),
    BadInput("imported field that is not there", _importing("mises"), part=_results(), says=("[imported]", "mises", '"v"')),
    BadInput("imported field that is not positive", _importing("v"), part=_results(lambda p: p[:, 0] - 1), says=("[imported]", "not positive")),
    BadInput("imported field with NaN", _importing("v"), part=_results(lambda p: np.sqrt(p[:, 0] - 1)), says=("[imported]", "not a finite number")),
    BadInput("imported stress of zero", _importing("S"), part=_results(lambda p: np.zeros((len(p), 6)), names="S11,S22,S33,S12,S13,S23"), says=("[imported]", '"S" of field.csv', "zero at all 225 points")),
    BadInput("imported results in another unit", _importing("v"), part=_results(scale=0.1), says=("[imported]", "does not cover the part", '"cm"')),
    BadInput("anisotropy with an imported scalar", _importing("v", more="alignment = 10"), part=_results(), says=("alignment = 10", "tensor", "scalar")),
    BadInput("warp that does not come to rest", (FROM_CELLS, FROM_CELLS.replace("skin_mm = 1.0", 'skin_mm = 0\nkind = "plate"').replace('"uniform"', '"successive-approximation"\nmax_sweeps = 3')), code=0, says=("3 sweeps", "still moving")),
    BadInput("least squares with too few steps", (FROM_CELLS, FROM_CELLS.replace("skin_mm = 1.0", 'skin_mm = 0\nkind = "plate"').replace('"uniform"', '"least-squares"\nmax_steps = 1')), code=0, says=("after 1 step ", "no folds", "allow more steps")),
)  # fmt: skip


@dataclass(frozen=True)
class BadCommand:
    """A command that is typed wrongly, in the folder of the sound case; its exit code is 2.

    Attributes:
        name: what is wrong, in a few words.
        typed: after `texmap`; CASE stands for the case file.
        says: what the message must contain.
    """

    name: str
    typed: str
    says: tuple[str, ...]


BAD_COMMANDS = (
    BadCommand("no command", "", says=("COMMAND", "`texmap --help`")),
    BadCommand("unknown command", "rnu CASE", says=("rnu", "'run'", "`texmap --help`")),
    BadCommand("option left out", "run CASE", says=("texmap run:", "--out", "`texmap run --help`")),
    BadCommand("unknown option", "run CASE --out out --foo", says=("texmap run:", "--foo", "--help")),
    BadCommand("a word for a number", "cells --rank E --density tenth", says=("texmap cells:", "--density", "tenth")),
    BadCommand("options that exclude each other", "run CASE --out out --quiet --json-progress", says=("texmap run:", "--json-progress", "--quiet")),
    BadCommand("picture that is no PNG", "cell octet --png octet.pdf", says=("octet.pdf", "octet.png")),
    BadCommand("stiffness that is no PNG", "cell octet --radius 0.05 --stiffness octet.svg", says=("octet.svg", "octet.png")),
    BadCommand("look without ending", "look CASE --png seen", says=("seen", '""', "seen.png")),
)  # fmt: skip


def run_bad_command(bad: BadCommand, folder: Path) -> tuple[int, str, list[str]]:
    """Exit code, all of stderr, and files left behind by a command that is typed wrongly."""
    from texmap_opt.cli import main

    case = changed_case(folder)
    said = io.StringIO()
    code = 0
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        try:
            main([str(case) if word == "CASE" else word for word in bad.typed.split()])
        except SystemExit as ended:
            code = int(ended.code or 0)
    left = sorted(p.name for p in folder.iterdir() if p.name not in INPUTS)
    return code, said.getvalue().rstrip("\n"), left


def run_bad_input(bad: BadInput, folder: Path) -> tuple[int, str, list[str]]:
    """Exit code, message, and files left behind by `texmap run` on a faulty case."""
    from texmap_opt.cli import main

    old, new = bad.change
    if old not in CASE:
        raise ValueError(f"{bad.name}: the sound case has no {old!r}")
    (folder / "case.toml").write_text(CASE.replace(old, new, 1) if old else CASE)
    (bad.part or _box())(folder / "box.stl")
    said = io.StringIO()
    code = 0
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        try:
            main(["run", str(folder / "case.toml"), "--out", str(folder / "out"), "--no-cache"])
        except SystemExit as ended:
            code = int(ended.code or 0)
    # The stages' lines are of no interest here; what is said to the user begins with one of these.
    lines = [
        line for line in said.getvalue().splitlines() if line.startswith(("texmap:", "warning:"))
    ]
    left = sorted(p.name for p in folder.iterdir() if p.name not in INPUTS)
    return code, " ".join(lines).replace(str(folder), "DIR"), left


def table() -> str:
    """Every fault with its exit code and the exact message, as Markdown."""
    lines = [
        "# What the program says to bad input\n",
        "Written by `python3 tests/end_to_end/bad_input.py > docs/bad-input.md`; a test checks each of",
        "them. `DIR` is the case's folder. Nothing is left behind in the output folder unless the code is 0.\n",
        "| fault | exit code | message |",
        "|---|---|---|",
    ]
    for bad in BAD_INPUTS:
        with tempfile.TemporaryDirectory() as folder:
            code, message, _ = run_bad_input(bad, Path(folder))
        shown = re.sub(r"\s+", " ", message).replace("|", "\\|")
        lines.append(f"| {bad.name} | {code} | {shown} |")
    lines += [
        "\nCommands that are typed wrongly end with exit code 2 and one line.\n",
        "| fault | typed | message |",
        "|---|---|---|",
    ]
    for wrong in BAD_COMMANDS:
        with tempfile.TemporaryDirectory() as folder:
            _, message, _ = run_bad_command(wrong, Path(folder))
        typed = f"texmap {wrong.typed.replace('CASE', 'case.toml')}".rstrip()
        lines.append(f"| {wrong.name} | `{typed}` | {message} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.stdout.write(table())
