"""Lattices shaped by the stress of the part they fill: from an STL and its loads to a printable solid.

`run(DesignCase.from_toml("case.toml"))` does everything; every stage is also a function of its own.
Lengths are mm, forces N, stresses MPa.
"""

from texmap_opt.case import DesignCase as DesignCase
from texmap_opt.cells.catalogue import cell_names as cell_names
from texmap_opt.cells.catalogue import unit_cell as unit_cell
from texmap_opt.errors import TexmapError as TexmapError
from texmap_opt.pipeline import run as run
from texmap_opt.run_result import Run as Run
