"""The lattice of a case without end: its radius in units of the cell, and its stiffness."""

from pathlib import Path

import numpy as np
import pytest
from sound_case import BOX, FACES, case_of

from fea.plane_stiffness import PlaneStiffness
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.endless_lattice import EndlessLattice, endless_lattice
from texmap_opt.grid_plan import plan_grid
from texmap_opt.part_box import part_box
from texmap_opt.solid.tri_mesh import TriMesh


def lattice_of(folder: Path, cell: str, *changes: tuple[str, str]) -> EndlessLattice:
    case, read = case_of(folder, ('"bcc"', f'"{cell}"'), *changes), unit_cell(cell)
    plan = plan_grid(case, part_box(case, TriMesh(BOX, FACES), read), read)
    lattice = endless_lattice(case, plan, read)
    assert lattice is not None
    return lattice


def test_square_walls_carry_along_their_axes_by_their_thickness(tmp_path: Path):
    """E = t/L of the solid's, per depth; Wang, McDowell, J. Eng. Mater. Technol. 126 (2004) 137."""
    lattice = lattice_of(tmp_path, "square")
    assert (lattice.cell.section, lattice.radius) == ("wall", pytest.approx(0.08))
    stiffness = lattice.stiffness
    assert isinstance(stiffness, PlaneStiffness)
    axes = np.array([[1.0, 0], [0, 1]])
    np.testing.assert_allclose(stiffness.youngs_modulus(axes), 0.16, rtol=1e-9)


def test_a_honeycomb_keeps_its_proportions_in_a_grid_that_stretches_it(tmp_path: Path):
    """Isotropic; its radius is over the edge that a cell of the same area has along its first axis."""
    lattice = lattice_of(tmp_path, "honeycomb", ("cell_mm = 10.0", "cells = [8, 3]"))
    edge = np.sqrt(40 / 8 * 20 / 3 / np.sqrt(3))
    assert lattice.radius == pytest.approx(0.8 / edge, rel=1e-6)
    assert isinstance(lattice.stiffness, PlaneStiffness)
    assert lattice.stiffness.is_isotropic


def test_the_section_of_the_case_goes_before_that_of_the_cell(tmp_path: Path):
    assert lattice_of(tmp_path, "bcc").cell.section == "round"
    square = lattice_of(tmp_path, "bcc", ("skin_mm = 1.0", 'skin_mm = 1.0\nsection = "square"'))
    assert square.cell.section == "square"
