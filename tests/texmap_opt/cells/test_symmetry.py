"""The crystal system of a lattice is that of its point group, however its cell is cut out of it."""

from dataclasses import replace

import numpy as np
import pytest

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.symmetry import crystal_system
from texmap_opt.cells.unit_cell import UnitCell


def plane_cell(joints: list, struts: list, proportions: tuple[float, float]) -> UnitCell:
    return replace(
        unit_cell("cube"),
        joints=np.array(joints, float),
        struts=np.array(struts),
        relative_radius=np.ones(len(struts)),
        section="wall",
        mirrored=(False, False),
        proportions=proportions,
    )


def honeycomb(proportions: tuple[float, float]) -> UnitCell:
    """Two hexagons to the rectangle 1 x sqrt(3)."""
    joints = [[0, 0], [1, 0], [1 / 2, 1 / 6], [1 / 2, 1 / 2], [0, 2 / 3], [1, 2 / 3]]
    joints += [[0, 1], [1, 1]]
    struts = [[0, 2], [1, 2], [2, 3], [3, 4], [3, 5], [4, 6], [5, 7]]
    return plane_cell(joints, struts, proportions)


SQUARE = plane_cell([[0, 0], [1, 0], [0, 1], [1, 1]], [[0, 1], [0, 2], [1, 3], [2, 3]], (1.0, 1.0))


def test_a_honeycomb_is_hexagonal_in_its_proportions_only():
    """60 degrees are no symmetry of the rectangle that repeats, but of the lattice."""
    assert crystal_system(honeycomb((1.0, float(np.sqrt(3))))) == "hexagonal"
    assert crystal_system(honeycomb((1.0, 1.0))) == "rectangular"


def test_systems_of_the_plane():
    assert crystal_system(SQUARE) == "square"
    assert crystal_system(replace(SQUARE, proportions=(1.0, 1.2))) == "rectangular"
    # One diagonal: the rhombus has mirror lines along both diagonals.
    struts = np.append(SQUARE.struts, [[0, 3]], axis=0)
    rhombic = replace(SQUARE, struts=struts, relative_radius=np.ones(5))
    assert crystal_system(rhombic) == "rectangular"
    assert crystal_system(replace(rhombic, proportions=(1.0, 1.2))) == "oblique"


@pytest.mark.parametrize(
    ("proportions", "radii", "system"),
    [
        ((1.0, 1.0, 1.0), (1, 1, 1), "cubic"),
        ((1.0, 1.0, 2.0), (1, 1, 1), "tetragonal"),
        ((1.0, 1.0, 1.0), (1, 1, 2), "tetragonal"),
        ((1.0, 1.5, 2.0), (1, 1, 1), "orthorhombic"),
        ((1.0, 1.0, 1.0), (1, 2, 3), "orthorhombic"),
    ],
)
def test_cubes_of_unequal_edges_or_radii(proportions, radii, system):
    cube = unit_cell("cube")
    axis = np.argmax(np.abs(cube.edges), axis=1)
    cell = replace(cube, proportions=proportions, relative_radius=np.array(radii, float)[axis])
    assert crystal_system(cell) == system


def test_one_more_diagonal_leaves_the_turns_about_it():
    """A cube with one body diagonal: three-fold about that diagonal."""
    cube = unit_cell("cube")
    low, high = (int(np.argmin(s * cube.joints.sum(axis=1))) for s in (1, -1))
    with_diagonal = replace(
        cube,
        struts=np.append(cube.struts, [[low, high]], axis=0),
        relative_radius=np.ones(len(cube.struts) + 1),
    )
    assert crystal_system(with_diagonal) == "trigonal"
    leaning = replace(with_diagonal, proportions=(1.0, 1.0, 1.5))
    assert crystal_system(leaning) == "monoclinic"
    assert crystal_system(replace(with_diagonal, proportions=(1.0, 1.2, 1.5))) == "triclinic"


def test_mirrored_tiling_adds_mirrors():
    """The cube with a diagonal again; reflected along every axis it is cubic."""
    cube = unit_cell("cube")
    low, high = (int(np.argmin(s * cube.joints.sum(axis=1))) for s in (1, -1))
    cell = replace(
        cube,
        struts=np.append(cube.struts, [[low, high]], axis=0),
        relative_radius=np.ones(len(cube.struts) + 1),
        mirrored=(True, True, True),
    )
    assert crystal_system(cell) == "cubic"
    assert crystal_system(replace(cell, mirrored=(True, False, False))) == "orthorhombic"
