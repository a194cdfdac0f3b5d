"""docs/cells.md: up to date with the library and with the numbers that are kept."""

import importlib
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from fea.stiffness_bounds import hashin_shtrikman_bound, plane_hashin_shtrikman_bound
from texmap_opt.cells import catalogue
from texmap_opt.cells.at_density import POISSON
from texmap_opt.cells.catalogue import cell_names

# Reading a cell looks for its symmetry.
unit_cell = cache(catalogue.unit_cell)

ROOT = Path(__file__).parents[3]
# Some of all: stretching, bending, with and without a joint model, mirrored, in the plane.
RECOMPUTED = {"octet": 0.1, "diamond": 0.05, "honeycomb": 0.2, "bi-stable": 0.01}
# Pictures of cells [bytes].
PICTURE_LIMIT = 25_000


@pytest.fixture(scope="module")
def study() -> Iterator[dict[str, ModuleType]]:
    """The modules of the command that writes the page; they import each other by their bare names."""
    names = ("measured", "page", "cell_pictures")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "studies" / "cells"))
        yield {name: importlib.import_module(name) for name in names}
    for name in names:
        sys.modules.pop(name)


@pytest.fixture(scope="module")
def results(study) -> dict[str, dict]:
    return study["measured"].read_results()


def test_the_page_is_what_the_command_writes(study, results):
    """`python3 studies/cells/gallery.py --page` writes it."""
    written = (ROOT / "docs" / "cells.md").read_text(encoding="utf-8")
    assert study["page"].page(results) == written
    # Negative control: one number of one cell.
    results["octet"]["rows"][3]["E 100"] *= 1.01
    try:
        assert study["page"].page(results) != written
    finally:
        results["octet"]["rows"][3]["E 100"] /= 1.01


def test_every_cell_of_the_library_is_measured_at_every_density(study, results):
    assert sorted(results) == cell_names()
    for name, result in results.items():
        assert [row["density"] for row in result["rows"]] == list(study["measured"].DENSITIES), name


@pytest.mark.parametrize("name", RECOMPUTED)
def test_the_numbers_that_are_kept_are_those_of_the_code(study, results, name: str):
    """Six digits are kept; anisotropy is what is left of a difference, 1e-5 of rubber-like cells."""
    row = next(row for row in results[name]["rows"] if row["density"] == RECOMPUTED[name])
    again = study["measured"].measured(unit_cell(name), RECOMPUTED[name])
    assert list(again) == list(row)
    for key, value in row.items():
        if isinstance(value, float):
            np.testing.assert_allclose(again[key], value, rtol=1e-5, atol=1e-9, err_msg=key)
        else:
            assert again[key] == value, key


def test_the_power_laws_are_those_of_the_numbers(study, results):
    for name, result in results.items():
        assert study["measured"].laws(unit_cell(name), result["rows"]) == result["laws"], name


def test_stretching_is_near_linear_and_bending_square_or_cubic(results):
    """Gibson, Ashby, Cellular Solids, chapters 4 and 5: along the direction that only bends."""
    for name, result in results.items():
        cell = unit_cell(name)
        density, softest = (
            np.array([row[key] for row in result["rows"][:2]]) for key in ("density", "E_min")
        )
        exponent = float(np.diff(np.log(softest))[0] / np.diff(np.log(density))[0])
        bends = {3: 2, 2: 3}[cell.dimensions]
        wanted = 1 if cell.classification == "stretching" else bends
        # What joints share, and stretch beside bending, at densities of 0.01 and 0.02.
        assert exponent == pytest.approx(wanted, abs=0.15), name


def test_no_cell_is_above_the_bounds(results):
    """Voigt's in any direction; Hashin and Shtrikman's against pressure, whatever the symmetry."""
    for name, result in results.items():
        for row in result["rows"]:
            density = row["density"]
            bulk = hashin_shtrikman_bound(1.0, POISSON, density).bulk
            if unit_cell(name).dimensions == 2:
                bulk = plane_hashin_shtrikman_bound(1.0, POISSON, density).area
            assert row["E_max"] < density, name
            assert row["bulk"] < bulk, name


def test_every_picture_of_the_page_is_there_and_small():
    page = (ROOT / "docs" / "cells.md").read_text(encoding="utf-8")
    files = re.findall(r'<img src="(.*?)"', page)
    assert len(files) == len(set(files)) == len(cell_names()) + 4
    for file in files:
        size = (ROOT / "docs" / file).stat().st_size
        assert file.endswith(".png") or size < PICTURE_LIMIT, file


def test_snapping_through_mirrors_the_arches_and_keeps_all_lengths(study):
    """Mirror images: no link is stretched between the two stable shapes, nor are posts or stem."""
    cell = unit_cell("bi-stable")
    snapped = study["cell_pictures"].snapped_joints(cell)
    lengths = [
        np.linalg.norm(np.diff(joints[cell.struts], axis=1)[:, 0], axis=1)
        for joints in (cell.joints, snapped)
    ]
    np.testing.assert_allclose(*lengths, rtol=1e-12)
    number = {name: k for k, name in enumerate(cell.joint_names)}
    for foot in ("a0", "a12", "b0", "b12", "base_left", "base_right"):
        np.testing.assert_array_equal(snapped[number[foot]], cell.joints[number[foot]])
    # Down by twice the rise of the arches, 0.12 of the cell.
    assert snapped[number["tip"], 1] == pytest.approx(1 - 0.24, abs=1e-12)
