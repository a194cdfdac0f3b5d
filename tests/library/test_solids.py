"""Every cell of the library as a solid: uniform and warped, with fillets and without."""

import pytest
from lattices import block
from sound_solid import assert_sound

from texmap_opt.cells.catalogue import cell_names
from texmap_opt.solid.lattice_solid import lattice_solid

# Struts ten times as long as thick, in the shortest of each cell; fillets half as wide as struts.
SLENDERNESS = 0.1
FILLET = 0.5
# Over the cell's edge; below 0.15 no cell folds.
WARP = 0.1


def check(name: str, cells: int, warp: float, fillet: float) -> None:
    """Closed, oriented, genus of the net, winding 0 or 1, nothing united by booleans."""
    lattice = block(name, cells, slenderness=SLENDERNESS, warp=warp)
    radius = float(lattice.radii.min())
    solid = lattice_solid(
        lattice, tolerance_mm=0.03 * radius, segments=12, fillet_mm=fillet * radius
    )
    assert_sound(solid.surface, lattice, points=30)
    assert solid.clusters == solid.clamped_fillets == 0


@pytest.mark.parametrize("name", cell_names())
def test_a_warped_cell_with_fillets_is_a_sound_solid(name):
    check(name, 1, WARP, FILLET)


@pytest.mark.slow
@pytest.mark.parametrize("fillet", [0.0, FILLET])
@pytest.mark.parametrize("warp", [0.0, WARP])
@pytest.mark.parametrize("cells", [1, 3])
@pytest.mark.parametrize("name", cell_names())
def test_blocks_of_cells_are_sound_solids(name, cells, warp, fillet):
    check(name, cells, warp, fillet)
