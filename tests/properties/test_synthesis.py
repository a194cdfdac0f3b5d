"""What holds for every cell of the library in every grid that the certificate passes."""

import io

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt.box import Box
from texmap_opt.cells.catalogue import cell_names, unit_cell
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.structure.map import RADIUS_MODES, map_structure
from texmap_opt.structure.net import Net
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.structure_xml import read_structure, write_structure
from texmap_opt.structure.tile import tile
from texmap_opt.warp.certificate import folded, grid_coefficients
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.inverse_map import PointStatus, grid_coordinates

CELLS = [unit_cell(name) for name in cell_names()]
names = st.integers(0, len(CELLS) - 1)
seeds = st.integers(0, 2**32 - 1)


def uniform_grid(cell: UnitCell, cells: tuple[int, ...]) -> Grid:
    """Cells of 7 x 5 x 6 mm, a box that is not at the origin; turned for extruded ones."""
    extent = np.array([7.0, 5.0, 6.0]) * np.array([*cells, 1][:3])
    low = np.array([-3.0, 40.0, 0.1])
    extrusion = None if cell.dimensions == 3 else "z"
    return Grid.uniform(Box.aligned(np.stack([low, low + extent]), extrusion=extrusion), cells)


def certified_grid(cell: UnitCell, cells: tuple[int, ...], seed: int) -> Grid:
    """Nodes moved at random as far as the certificate allows, less a tenth."""
    grid = uniform_grid(cell, cells)
    move = np.random.default_rng(seed).uniform(-2.5, 2.5, grid.nodes.shape)
    move = np.where(np.moveaxis(grid.free, 0, -1), move, 0.0)
    share = 1.0
    while folded(grid_coefficients(grid.with_nodes(grid.nodes + share * move))).any():
        share *= 0.8
    return grid.with_nodes(grid.nodes + 0.9 * share * move)


def shapes(cell: UnitCell) -> tuple[int, ...]:
    return (3, 2, 2)[: cell.dimensions]


def filled(cell: UnitCell, seed: int, **options) -> tuple[Grid, Net, Structure]:
    grid = certified_grid(cell, shapes(cell), seed)
    net = tile(cell, grid.cells)
    structure = map_structure(net, grid.positions, 0.3, **options)
    if cell.dimensions == 2:
        structure = structure.extruded(grid.box.axes[2], grid.box.bounds[:, 2])
    return grid, net, structure


@settings(max_examples=30, deadline=None, derandomize=True)
@given(names, seeds)
def test_a_certified_grid_changes_no_count_and_joins_no_two_joints(which, seed):
    """The map is one-to-one, so different joints of the net stay different."""
    _, net, structure = filled(CELLS[which], seed)
    assert structure.joints.shape == (len(net.joints), 3)
    np.testing.assert_array_equal(structure.struts, net.struts)
    structure.validate()
    # Joints of a cell are at least 1e-3 cells apart; the map shrinks them with its cells.
    distinct = np.unique(np.round(structure.joints, 9), axis=0)
    assert len(distinct) == len(structure.joints)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(names, seeds)
def test_all_joints_lie_in_their_cells(which, seed):
    """The inverse map, which knows nothing of the net, finds each where the net has it."""
    grid, net, structure = filled(CELLS[which], seed)
    found = grid_coordinates(grid, structure.joints)
    assert (found.status == int(PointStatus.FOUND)).all()
    np.testing.assert_allclose(found.xi, net.joints, atol=1e-8)
    assert ((net.joint_local >= 0) & (net.joint_local <= 1)).all()
    cell = np.stack(np.unravel_index(net.cell, net.shape), axis=1)
    ends = found.xi[structure.struts]
    inside = (ends >= cell[:, None] - 1e-8) & (ends <= cell[:, None] + 1 + 1e-8)
    assert inside.all()


@settings(max_examples=30, deadline=None, derandomize=True)
@given(names)
def test_the_identity_map_gives_the_uniform_lattice(which):
    """To 1e-14 of the box."""
    cell = CELLS[which]
    grid = uniform_grid(cell, shapes(cell))
    net = tile(cell, grid.cells)
    structure = map_structure(net, grid.positions, 0.3)
    expected = grid.box.positions(grid.box.low + net.joints * grid.uniform_edge)
    size = np.linalg.norm(np.ptp(grid.box.bounds, axis=0)) + np.abs(grid.box.bounds).max()
    np.testing.assert_allclose(structure.joints, expected, rtol=0, atol=1e-14 * size)
    np.testing.assert_allclose(structure.cell_size, 1, rtol=1e-14)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(names, seeds, st.sampled_from(RADIUS_MODES))
def test_the_round_trip_through_xml_is_exact(which, seed, mode):
    cell = CELLS[which]
    _, _, structure = filled(cell, seed, radius_mode=mode)
    text = io.StringIO()
    write_structure(structure, text, provenance={"cell": cell.name})
    again = read_structure(io.BytesIO(text.getvalue().encode()))
    for name in ("joints", "struts", "radii", "cut", "cell_size"):
        np.testing.assert_array_equal(getattr(again, name), getattr(structure, name))
    assert again.section == structure.section
    assert again.origin is not None
    assert structure.origin is not None
    assert again.origin.kinds == structure.origin.kinds
    np.testing.assert_array_equal(again.origin.cell, structure.origin.cell)
    assert (again.extrusion is None) == (structure.extrusion is None)


def test_a_folded_grid_puts_joints_elsewhere():
    """The control: without the certificate the inverse map does not find the joints."""
    cell = unit_cell("octet")
    grid = uniform_grid(cell, (2, 2, 2))
    nodes = grid.nodes.copy()
    nodes[1, 1, 1] += [11.0, 0, 0]
    over = grid.with_nodes(nodes)
    assert folded(grid_coefficients(over)).any()
    structure = map_structure(tile(cell, over.cells), over.positions, 0.3)
    found = grid_coordinates(over, structure.joints)
    assert not (found.status == int(PointStatus.FOUND)).all()
