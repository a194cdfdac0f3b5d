"""Relative density of endless lattices of walls against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.periodic_density import periodic_density


def voids(radius: float, *polygons: tuple[float, float]) -> float:
    """Density when walls leave polygons of less apothem: each one's share of the plane and apothem."""
    return 1 - sum(share * (1 - radius / apothem) ** 2 for share, apothem in polygons)


# Polygons between the middles of the walls, with edges of the cell along its first axis: inside of
# them the walls leave like polygons, since no joint's disc reaches beyond the corners.
PLANE = {
    "square": [(1.0, 0.5)],
    "honeycomb": [(1.0, 0.5)],
    "triangular": [(1.0, 1 / np.sqrt(12))],
    "kagome": [(3 / 4, np.sqrt(3) / 4), (1 / 4, 1 / np.sqrt(48))],
}


@pytest.mark.parametrize("name", sorted(PLANE))
@pytest.mark.parametrize("radius", [0.01, 0.05])
def test_walls_leave_smaller_polygons(name, radius):
    density = periodic_density(unit_cell(name), radius)
    # The kinks of the overlaps fall between directions: 432 leave a ten-thousandth.
    np.testing.assert_allclose(density, voids(radius, *PLANE[name]), rtol=1e-4)
    # Negative control: the walls' own areas, (2 r) length per area, are off by far more.
    own = sum(2 * radius * share / apothem for share, apothem in PLANE[name])
    assert own > density * (1 + 0.4 * radius)


def test_the_density_of_a_mirrored_cell_is_that_of_its_translated_image():
    """Two square cells of which odd ones are reflected are the same lattice."""
    square = unit_cell("square")
    mirrored = replace(square, mirrored=(True, True))
    np.testing.assert_allclose(
        periodic_density(mirrored, 0.05), periodic_density(square, 0.05), rtol=1e-12
    )
