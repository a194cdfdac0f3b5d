"""Cells mapped into warped hexahedra."""

import numpy as np
import pytest

from texmap_opt.cells.catalogue import cell_names, unit_cell
from texmap_opt.errors import CaseError
from texmap_opt.structure.map import cell_sizes, map_structure, multilinear
from texmap_opt.structure.net import Net
from texmap_opt.structure.tile import tile


def box_grid(size=(30.0, 20.0, 10.0), cells=(3, 4, 2)) -> np.ndarray:
    axes = [np.linspace(0, s, n + 1) for s, n in zip(size, cells, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def warped_grid(seed: int = 3) -> np.ndarray:
    """Inner nodes moved by up to a fifth of a cell; the box's faces stay."""
    grid = box_grid()
    move = np.random.default_rng(seed).uniform(-1, 1, grid.shape)
    grid[1:-1, 1:-1, 1:-1] += move[1:-1, 1:-1, 1:-1]
    return grid


@pytest.mark.parametrize("name", cell_names())
def test_a_uniform_grid_gives_the_net_itself(name: str):
    cell = unit_cell(name)
    edges, cells = np.array([10.0, 5, 5])[: cell.dimensions], (3, 4, 2)[: cell.dimensions]
    net = tile(cell, cells)
    s = map_structure(net, positions(edges, cells), 0.5)
    np.testing.assert_allclose(s.joints[:, : cell.dimensions], net.joints * edges, atol=1e-13)
    np.testing.assert_array_equal(s.joints[:, cell.dimensions :], 0)
    np.testing.assert_allclose(s.cell_size, 1, rtol=1e-14)
    np.testing.assert_allclose(s.radii, 0.5 * np.stack([net.relative_radius] * 2, axis=1))
    assert not s.cut.any()
    # In two dimensions the net is a cross-section until it is extruded.
    walls = s.extruded(np.array([0.0, 0, 1]), np.array([-1.0, 1.0]))
    (s if cell.dimensions == 3 else walls).validate()


def positions(edges: np.ndarray, cells: tuple[int, ...]) -> np.ndarray:
    """Nodes of a uniform grid in space; one of two directions lies in the plane z = 0."""
    axes = [np.arange(n + 1) * edge for n, edge in zip(cells, edges, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return np.concatenate([nodes, np.zeros((*nodes.shape[:-1], 3 - len(cells)))], axis=-1)


def octet(grid: np.ndarray) -> Net:
    return tile(unit_cell("octet"), tuple(n - 1 for n in grid.shape[:3]))


CUBES = tile(unit_cell("cube"), (3, 4, 2))


def test_every_cell_sharing_a_joint_puts_it_in_the_same_place():
    """Otherwise welding by lattice position would tear or bend the cells of a warped grid."""
    grid = warped_grid()
    net = octet(grid)
    s = map_structure(net, grid, 0.5)
    for side in (np.floor(net.joints), np.ceil(net.joints) - 1):
        cell = np.clip(side, 0, np.array(net.shape) - 1).astype(np.int64)
        again = multilinear(grid, cell, net.joints - cell)
        np.testing.assert_allclose(again, s.joints, atol=1e-12)


def test_sizes_average_to_the_mean_edge_and_do_not_see_rotation():
    grid = warped_grid()
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    np.testing.assert_allclose(cell_sizes(grid @ turn.T), cell_sizes(grid), rtol=1e-12)
    assert abs(cell_sizes(grid).mean() - 1) < 0.05


def test_a_layer_of_half_thickness_is_five_sixths_as_large():
    """Of twelve edges four are half as long: (8 + 4/2)/12; in its neighbour (8 + 4 3/2)/12."""
    grid = box_grid((20.0, 10.0, 10.0), (2, 1, 1))
    grid[1, :, :, 0] = 5.0
    np.testing.assert_allclose(cell_sizes(grid).ravel(), [10 / 12, 14 / 12])
    s = map_structure(tile(unit_cell("cube"), (2, 1, 1)), grid, 0.6, radius_mode="scaled")
    middle = s.joints[s.struts].mean(axis=1)
    shared = (s.joints[s.struts][:, :, 0] == 5.0).all(axis=1)
    expected = np.where(shared, 1.0, np.where(middle[:, 0] < 5, 10 / 12, 14 / 12))
    np.testing.assert_allclose(s.cell_size, expected)
    np.testing.assert_allclose(s.radii, 0.6 * np.stack([expected, expected], axis=1))


def test_the_case_may_override_the_section():
    assert map_structure(CUBES, box_grid(), 0.5).section == "round"
    assert map_structure(CUBES, box_grid(), 0.5, section="square").section == "square"


def test_impossible_values_are_refused():
    with pytest.raises(CaseError, match="radius_mm is 0 mm; it must be a positive"):
        map_structure(CUBES, box_grid(), 0.0)
    with pytest.raises(CaseError, match='did you mean "scaled"'):
        map_structure(CUBES, box_grid(), 0.5, radius_mode="scale")
