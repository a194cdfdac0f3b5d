"""A starter case for `texmap new`: a commented case file and its part, ready to run and to change."""

from pathlib import Path

from texmap_opt.builtin_part import builtin_part
from texmap_opt.errors import InputError, OutputError
from texmap_opt.export.solid_file import Solid
from texmap_opt.export.whole_file import whole_file

STARTER = """\
# A starter case: a bracket held at its plate's underside, its lug pulled up.
# Look first:  texmap look case.toml
# Then run:    texmap run case.toml --out out
# Every key is explained in docs/case.md. Units: mm, N, MPa.

[part]
file = "part.stl"               # put your own STL, OBJ, PLY or 3MF here
unit = "mm"                     # unit of its coordinates: mm, cm, m, in

[material]
name = "AlSi10Mg"               # or E_MPa, nu, density_g_cm3 and yield_MPa

[analysis]
element = "tet10"               # quadratic tets; tet4 is faster and too stiff
edge_mm = {edge:g}                   # target edge of the tets

[[support]]                     # where the part is held
region = {{ plane = {{ point = [0, 0, {bottom:g}], normal = [0, 0, -1] }} }}
fix = ["x", "y", "z"]

[[load]]                        # several loads with the same `case` act together
case = "lift"
region = {{ plane = {{ point = [0, 0, {top:g}], normal = [0, 0, 1], tolerance = {band:g} }} }}
force_N = [0, 0, 500]

[lattice]
cell = "octet"                  # `texmap cells` lists the library
cell_mm = {cell:g}
kind = "rod"                    # plate: the lattice is cut out instead
skin_mm = 1.0                   # 0: no skin
radius_mm = 0.5                 # or relative_density = 0.15

[warp]
method = "least-squares"        # uniform | successive-approximation | least-squares
contrast = 3.0                  # largest over smallest wanted cell, at most
alignment = 0                   # cells turn by the stress: try 30, then 100
# docs/warp.md: painted regions and results of other programs as drivers

[sizing]
method = "optimality-criteria"  # none | optimality-criteria | mma

[output]
tolerance_mm = 0.05             # bound on geometric error
"""


def write_starter(directory: Path) -> Path:
    """Write case.toml and part.stl into a folder that has neither; returns the case's path.

    Raises:
        InputError: one of the two files is already there.
        OutputError: the folder cannot be written.
    """
    case, part_file = directory / "case.toml", directory / "part.stl"
    for path in (case, part_file):
        if path.exists():
            raise InputError(f"{path}: is already there and would be lost; name another folder.")
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as failure:
        raise OutputError(f"{directory}: cannot be made ({failure.strerror}).") from failure
    part = builtin_part("bracket", {})
    low, high = part.bounds
    text = STARTER.format(edge=4.0, bottom=low[2], top=high[2], band=4.0, cell=7.0)
    with whole_file(case) as file:
        file.write(text.encode())
    Solid(part).save(part_file)
    return case
