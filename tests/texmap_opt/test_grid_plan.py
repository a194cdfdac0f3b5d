"""How many cells a case asks for, and the radius that a density stands for."""

from pathlib import Path

import numpy as np
import pytest
from sound_case import case_of

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.errors import CaseError
from texmap_opt.grid_plan import plan_grid

BOUNDS = np.array([[0.0, 0.0, 0.0], [40.0, 20.0, 20.0]])


def test_cells_cover_the_part_and_the_margin_surrounds_it(tmp_path: Path):
    plan = plan_grid(case_of(tmp_path), BOUNDS, unit_cell("bcc"))
    assert plan.grid.cells == (6, 4, 4)
    np.testing.assert_allclose(plan.grid.box, [[-10, -10, -10], [50, 30, 30]])
    assert plan.radius_mm == 0.8


def test_without_margin_the_box_shrinks_by_the_radius(tmp_path: Path):
    case = case_of(tmp_path, ('"uniform"', '"uniform"\nmargin_cells = 0'))
    plan = plan_grid(case, BOUNDS, unit_cell("bcc"))
    np.testing.assert_allclose(plan.grid.box, [[0.8, 0.8, 0.8], [39.2, 19.2, 19.2]])


@pytest.mark.parametrize(
    ("cell", "length"),
    [
        ("cube", 3.0),
        ("bcc", 4 * np.sqrt(3)),
        ("octet", 24 / np.sqrt(2)),
        ("octahedron", 12 / np.sqrt(2)),
    ],
)
def test_a_density_is_the_radius_of_the_centre_line_formula(
    tmp_path: Path, cell: str, length: float
):
    """Rho = pi r² L / a³ with L the strut length of one cell of an endless lattice, edge a = 10."""
    case = case_of(tmp_path, ("radius_mm = 0.8", "relative_density = 0.1"))
    plan = plan_grid(case, BOUNDS, unit_cell(cell))
    assert np.pi * plan.radius_mm**2 * length * 10 / 1000 == pytest.approx(0.1, rel=1e-9)


def test_more_cells_than_a_machine_holds_are_refused(tmp_path: Path):
    case = case_of(tmp_path, ("cell_mm = 10.0", "cells = [400, 200, 200]"))
    with pytest.raises(CaseError, match="larger cells"):
        plan_grid(case, BOUNDS, unit_cell("bcc"))
