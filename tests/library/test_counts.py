"""Joints, struts, valences and lengths of the library's cells: those of their definitions."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from texmap_opt.cells import catalogue
from texmap_opt.cells.catalogue import cell_names
from texmap_opt.cells.rigidity import maxwell_number, mechanisms
from texmap_opt.structure.net import Net
from texmap_opt.structure.tile import tile

# Reading checks a cell in full, which takes up to a third of a second.
unit_cell = cache(catalogue.unit_cell)

# Joints and struts of a block of n x n x n or n x n cells.
BLOCK_OF = {
    "bcc": lambda n: ((n + 1) ** 3 + n**3, 8 * n**3),
    # Columns on the corners, a chevron in each face along them.
    "column": lambda n: (
        (n + 1) ** 3 + 2 * n**2 * (n + 1),
        n * (n + 1) ** 2 + 4 * n**2 * (n + 1),
    ),
    "cube": lambda n: ((n + 1) ** 3, 3 * n * (n + 1) ** 2),
    "cuboctahedron": lambda n: (3 * n * (n + 1) ** 2, 12 * n**2 * (n + 1)),
    # Middles of the cubes' edges, four tetrahedra and the middle of each cube; all struts inside.
    "diamond": lambda n: (3 * n * (n + 1) ** 2 + 5 * n**3, 16 * n**3),
    # An edge in each face; the cube within, and 24 struts.
    "dodecahedron": lambda n: (6 * n**2 * (n + 1) + 8 * n**3, 3 * n**2 * (n + 1) + 24 * n**3),
    "fcc": lambda n: ((n + 1) ** 3 + 3 * n**2 * (n + 1), 12 * n**2 * (n + 1)),
    "icosahedron": lambda n: (6 * n**2 * (n + 1), 3 * n**2 * (n + 1) + 24 * n**3),
    "octahedron": lambda n: (3 * n**2 * (n + 1), 12 * n**3),
    # Corners and face centres of the cubes, four struts in each face and the inner octahedron.
    "octet": lambda n: ((n + 1) ** 3 + 3 * n**2 * (n + 1), 12 * n**2 * (n + 1) + 12 * n**3),
    "rhombic-dodecahedron": lambda n: ((n + 1) ** 3 + 3 * n**2 * (n + 1) + 8 * n**3, 32 * n**3),
    # Every other corner of the cubes, that of the origin included; a diagonal in each face.
    "tetrahedron": lambda n: (((n + 1) ** 3 + 1) // 2, 3 * n**2 * (n + 1)),
    # A square in each face, and the twelve struts between the squares.
    "tetrakaidecahedron": lambda n: (12 * n**2 * (n + 1), 12 * n**2 * (n + 1) + 12 * n**3),
    # A rhombus in each face; the cube within, and 36 struts.
    "triacontahedron": lambda n: (
        12 * n**2 * (n + 1) + 8 * n**3,
        12 * n**2 * (n + 1) + 36 * n**3,
    ),
    "vector": lambda n: ((n + 1) ** 3 + n**3, 3 * n * (n + 1) ** 2 + 8 * n**3),
    # Two arches of twelve links, between posts of two pieces; stems of two, their tips in every other
    # row of sides; feet and ties in the others.
    "bi-stable": lambda n: (
        22 * n**2 + 2 * n * (n + 1) + (n + 1) * (n // 2 + 1) + n * ((n + 1) // 2),
        24 * n**2 + 2 * n * (n + 1) + 2 * n**2 + n * (n // 2 + 1),
    ),
    "honeycomb": lambda n: (2 * n**2 + n + 2 * n * (n + 1), 5 * n**2 + n * (n + 1)),
    # The honeycomb, corners, and hubs in the middle and in the sides.
    "iso-material": lambda n: (
        2 * n**2 + n + 2 * n * (n + 1) + (n + 1) ** 2 + n**2 + n * (n + 1),
        5 * n**2 + n * (n + 1) + 6 * n**2 + 4 * n**2 + 3 * n * (n + 1),
    ),
    "kagome": lambda n: (
        (n + 1) ** 2 + 2 * n * (n + 1) + 3 * n**2,
        2 * n * (n + 1) + 2 * n**2 + 8 * n**2,
    ),
    "octagon": lambda n: (4 * n * (n + 1), 2 * n * (n + 1) + 4 * n**2),
    "re-entrant": lambda n: (2 * n**2 + n * (n + 1) + 2 * n * (n + 1), 6 * n**2 + n * (n + 1)),
    "rubber-band": lambda n: (2 * n * (n + 1) + 8 * n**2, 12 * n**2),
    "square": lambda n: ((n + 1) ** 2, 2 * n * (n + 1)),
    "triangular": lambda n: ((n + 1) ** 2 + n**2 + n * (n + 1), n * (n + 1) + 6 * n**2),
}
# Sides of the faces of the cells that are one convex polyhedron.
FACES = {
    "tetrahedron": [3] * 4,
    "octahedron": [3] * 8,
    "cube": [4] * 6,
    "icosahedron": [3] * 20,
    "dodecahedron": [5] * 12,
    "tetrakaidecahedron": [4] * 6 + [6] * 8,
    "triacontahedron": [4] * 30,
    "cuboctahedron": [3] * 8 + [4] * 6,
}
# b - 3 j + 6 and b - 2 j + 3 of the others, from the counts of their definitions.
MAXWELL = {
    "bcc": 8 - 3 * 9 + 6,
    "column": 12 - 3 * 12 + 6,
    "diamond": 16 - 3 * 17 + 6,
    "fcc": 24 - 3 * 14 + 6,
    # As a tetrahedron on each face of the octahedron: zero (Deshpande, Fleck, Ashby, 2001).
    "octet": 0,
    "rhombic-dodecahedron": 32 - 3 * 22 + 6,
    "vector": 20 - 3 * 9 + 6,
    "bi-stable": 31 - 2 * 29 + 3,
    "honeycomb": 7 - 2 * 7 + 3,
    "iso-material": 23 - 2 * 14 + 3,
    "kagome": 14 - 2 * 11 + 3,
    "octagon": 8 - 2 * 8 + 3,
    "re-entrant": 8 - 2 * 8 + 3,
    "rubber-band": 12 - 2 * 12 + 3,
    "square": 4 - 2 * 4 + 3,
    "triangular": 8 - 2 * 7 + 3,
}
GOLDEN = (1 + np.sqrt(5)) / 2
# Struts at each joint, and their length in the first edge of the cell. Octet: Deshpande, Fleck,
# Ashby, J. Mech. Phys. Solids 49 (2001) 1747; Kelvin foam: Warren, Kraynik, J. Appl. Mech. 64 (1997)
# 787; polyhedra: edge over the width across the middles of opposite edges (Coxeter, Regular Polytopes,
# table I), neighbours adding to the valence; plane nets: Grünbaum, Shephard, Tilings and Patterns 2.1.
REGULAR = {
    "cuboctahedron": ({8}, 1 / np.sqrt(2)),
    "diamond": ({4}, np.sqrt(3) / 4),
    "dodecahedron": ({3, 5}, 1 / GOLDEN**2),
    "fcc": ({4, 12}, 1 / np.sqrt(2)),
    "icosahedron": ({9}, 1 / GOLDEN),
    "kelvin": ({4}, 1 / (2 * np.sqrt(2))),
    "octahedron": ({8}, 1 / np.sqrt(2)),
    "octet": ({12}, 1 / np.sqrt(2)),
    "rhombic-dodecahedron": ({4, 8}, np.sqrt(3) / 4),
    "tetrahedron": ({12}, np.sqrt(2)),
    "triacontahedron": ({3, 4, 8}, np.hypot(1 / GOLDEN**2, 1 / GOLDEN) / 2),
    "honeycomb": ({3}, 1 / np.sqrt(3)),
    "kagome": ({4}, 1 / 2),
    "octagon": ({3}, np.sqrt(2) - 1),
    "square": ({4}, 1.0),
}


def test_every_cell_is_counted():
    assert set(BLOCK_OF) == set(cell_names()) == set(MAXWELL) | set(FACES)


@pytest.mark.parametrize("name", sorted(BLOCK_OF))
@pytest.mark.parametrize("n", [1, 2, 4])
def test_block_has_the_joints_and_struts_of_its_closed_form(name: str, n: int):
    cell = unit_cell(name)
    net = tile(cell, (n,) * cell.dimensions)
    assert (len(net.joints), len(net.struts)) == BLOCK_OF[name](n)


@pytest.mark.parametrize("name", sorted(FACES))
def test_a_polyhedron_lacks_the_diagonals_of_its_faces(name: str):
    """Triangulated, a convex polyhedron is just rigid (Cauchy; Maxwell, Phil. Mag. 27 (1864) 294).

    A face of n sides needs n - 3 diagonals for that; Euler's formula gives the same number.
    """
    assert maxwell_number(unit_cell(name)) == -sum(sides - 3 for sides in FACES[name])


@pytest.mark.parametrize("name", sorted(MAXWELL))
def test_maxwell_number(name: str):
    assert maxwell_number(unit_cell(name)) == MAXWELL[name]


@pytest.mark.parametrize("name", sorted(REGULAR))
def test_as_many_struts_meet_at_joints_as_published_all_of_one_length(name: str):
    cell = unit_cell(name)
    valences, length = REGULAR[name]
    net = tile(cell, (3,) * cell.dimensions)
    inside = ((net.joints > 0.1) & (net.joints < 2.9)).all(axis=1)
    assert set(block_degree(net)[inside].tolist()) == valences
    ends = net.joints[net.struts] * np.array(cell.proportions)
    # Files give fifteen digits.
    np.testing.assert_allclose(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), length, rtol=1e-12)


@pytest.mark.parametrize("name", ["triangular", "iso-material"])
def test_six_walls_at_equal_angles_meet_in_a_triangular_net(name: str):
    cell = unit_cell(name)
    net = tile(cell, (3, 3))
    degree = block_degree(net)
    inside = ((net.joints > 0.1) & (net.joints < 2.9)).all(axis=1)
    # The others cut a wall in halves, where it crosses a side of the cell.
    assert set(degree[inside].tolist()) == {2, 6}
    hub = int(np.flatnonzero(inside & (degree == 6))[0])
    at_hub = net.struts[(net.struts == hub).any(axis=1)]
    away = (net.joints[at_hub.sum(axis=1) - hub] - net.joints[hub]) * np.array(cell.proportions)
    angles = np.sort(np.degrees(np.arctan2(away[:, 1], away[:, 0])))
    np.testing.assert_allclose(np.diff(angles), 60, atol=1e-6)


def test_cube_shears_three_ways_and_bcc_stretches_two_ways_for_free():
    """A pin-jointed cube has three shears; half diagonals allow any stretch of constant volume."""
    assert mechanisms(unit_cell("cube")).strain_producing == 3
    assert mechanisms(unit_cell("bcc")).strain_producing == 2


def test_octahedra_and_cuboctahedra_are_one_lattice_half_a_cell_apart():
    """Rectified cubic honeycomb: Coxeter, Regular Polytopes, section 4.7."""
    octahedra, cuboctahedra = (
        tile(unit_cell(f"{kind}hedron"), (4, 4, 4)) for kind in ("octa", "cubocta")
    )
    assert strut_set(octahedra, 0.0, 1, 3) == strut_set(cuboctahedra, 0.5, 1, 3) != set()


def test_mirrored_tetrahedra_are_the_octet_of_twice_the_size():
    small, large = tile(unit_cell("tetrahedron"), (4, 4, 4)), tile(unit_cell("octet"), (2, 2, 2))
    assert strut_set(small, 0.0, 0, 4) == strut_set(
        replace(large, joints=2 * large.joints), 0, 0, 4
    )


def block_degree(net: Net) -> np.ndarray:
    return np.bincount(net.struts.ravel(), minlength=len(net.joints))


def strut_set(net: Net, shift: float, low: float, high: float) -> set[frozenset]:
    """Struts with both ends between two heights along every axis, by the places of their ends."""
    places = net.joints + shift
    ends = np.round(places[net.struts], 9)
    ends = ends[((ends >= low) & (ends <= high)).all(axis=(1, 2))]
    return {frozenset(map(tuple, pair)) for pair in ends.tolist()}
