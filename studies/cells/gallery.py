"""Measure every cell of the library, draw it, and write docs/cells.md.

    python3 studies/cells/gallery.py [CELL ...] [--page] [--no-numbers] [--no-pictures]

Homogenises each cell (or those named) at several densities, a minute or two in all, draws it, and
writes results.json here, docs/images/cells/, docs/images/cells.jpg and docs/cells.md. With --page nothing
is measured or drawn anew: the page is written from results.json.
"""

import argparse

import jax
from cell_pictures import draw_overview, draw_pictures
from charts import draw_charts
from measured import DENSITIES, laws, measured, read_results, write_results
from page import PAGE, page

from texmap_opt.cells.catalogue import cell_names, unit_cell


def main() -> None:
    """Measure, draw and write."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("cells", nargs="*", metavar="CELL", help="default: all")
    arguments.add_argument("--page", action="store_true", help="write the page only")
    arguments.add_argument("--no-pictures", action="store_true", help="draw no cells, only charts")
    arguments.add_argument("--no-numbers", action="store_true", help="keep the numbers there are")
    given = arguments.parse_args()
    jax.config.update("jax_enable_x64", True)
    if not given.page:
        names = given.cells or cell_names()
        if not given.no_numbers:
            measure(names)
        results = read_results()
        if not given.no_pictures:
            draw_pictures(names, results)
            draw_overview()
        draw_charts(results)
    PAGE.write_text(page(read_results()), encoding="utf-8")


def measure(names: list[str]) -> None:
    """Homogenise cells at all densities, and keep the numbers; those of cells that are gone, drop."""
    try:
        results = {name: row for name, row in read_results().items() if name in cell_names()}
    except FileNotFoundError:
        results = {}
    for name in names:
        cell = unit_cell(name)
        rows = [measured(cell, density) for density in DENSITIES]
        results[cell.name] = {"laws": laws(cell, rows), "rows": rows}
        write_results(results)
        print(f"{cell.name}: done", flush=True)


if __name__ == "__main__":
    main()
