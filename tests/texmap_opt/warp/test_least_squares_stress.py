"""How stress turns the cells of the least-squares warp (design section 4, items 3 and 4c)."""

from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fea import Material, SolidProblem, Support, TetMesh, force_on_facets, solve_solid
from fea.effective_stiffness import EffectiveStiffness
from texmap_opt.box import Box
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.homogenised import homogenised_cell
from texmap_opt.warp.alignment import EqualStretch, NoShear, Unaligned, alignment_for
from texmap_opt.warp.certificate import grid_coefficients
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warp.quality import quality
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.stress_driver import StressSamples, stress_driver

CUBE = Box.aligned(np.array([[0.0, 0, 0], [1.0, 1.0, 1.0]]))

SMALL = Box.aligned(np.array([[0.0, 0, 0], [1.0, 0.8, 0.9]]))


def stressed_points():
    """Points in a box with a stress that varies in space."""
    points = np.random.default_rng(0).uniform(size=(200, 3)) * SMALL.extent
    waves = [np.sin(3 * points[:, 0] + k) + np.cos(2 * points[:, 1] * k) for k in range(6)]
    return points, np.stack(waves, axis=1)


def driven(points, stress, box, law):
    """The warping function of a stress [cases, samples, 6] given at points of equal volume."""
    background = BackgroundGrid.covering(box, 0.25)
    samples = StressSamples(points, np.full(len(points), 1 / len(points)), stress)
    return stress_driver(samples, background, smoothing_mm=0.25).function(background, law)


def test_turning_the_box_and_its_stress_turns_the_grid():
    """Positions in space, with alignment: nothing in the program prefers the axes of space."""
    points, stress = stressed_points()
    R = Rotation.from_rotvec([0.4, -0.3, 0.8]).as_matrix()
    tensors = stress[:, np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])]
    turned = np.einsum("ia,nab,jb->nij", R, tensors, R)
    turned = turned[:, [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]

    def warped(points, stress, axes):
        box = Box(axes, SMALL.bounds)
        f = driven(points, stress[None], box, SizeLaw())
        warp = LeastSquares(alignment=NoShear(jnp.asarray(5.0)))
        return warp.fit(Grid.uniform(box, (4, 3, 3)), f).grid.positions

    there = warped(points, stress, np.eye(3))
    back = warped(points @ R.T, turned, R.T)
    np.testing.assert_allclose(back, there @ R.T, atol=1e-6)


BAR = (4.0, 2.0, 2.0)


@cache
def loaded_bar(R_rows, turned_load):
    """Nodal stress of a bar turned by R, clamped at one end, under an oblique force on the other."""
    R = np.array(R_rows)
    mesh = TetMesh.box(BAR, (6, 3, 3))
    held = Support.clamp(np.flatnonzero(mesh.nodes[:, 0] < 1e-9))
    end = mesh.boundary_facets[np.abs(mesh.facet_centroids[:, 0] - BAR[0]) < 1e-9]
    turned = TetMesh(mesh.nodes @ R.T, mesh.tets)
    force = np.array([2.0, 1.0, -3.0])
    forces = force_on_facets(turned, end, R @ force if turned_load else force)
    material = Material(1000.0, 0.3, 1e-9)
    problem = SolidProblem.from_supports(turned, material, [held], forces)
    return turned, solve_solid(problem).stress


def test_turning_part_loads_and_box_turns_the_grid():
    """From the tets of the part to the nodes of the grid; a load left behind warps otherwise."""
    R = Rotation.from_rotvec([0.4, -0.3, 0.8]).as_matrix()
    bounds = np.array([[-0.5, -0.5, -0.5], [4.5, 2.5, 2.5]])

    def warped(R, *, turned_load):
        mesh, stress = loaded_bar(tuple(map(tuple, R)), turned_load)
        box = Box(R.T.copy(), bounds)
        background = BackgroundGrid.covering(box, 0.6)
        samples = StressSamples.from_mesh(mesh, stress)
        f = stress_driver(samples, background, smoothing_mm=0.6).function(background, SizeLaw())
        warp = LeastSquares(alignment=NoShear(jnp.asarray(5.0)))
        return warp.fit(Grid.uniform(box, (6, 4, 4)), f).grid

    there = warped(np.eye(3), turned_load=True)
    assert np.abs(there.nodes - there.at_rest.nodes).max() > 0.1
    turned = warped(R, turned_load=True).positions
    # The analysis is exact to 1e-12; the search multiplies it.
    np.testing.assert_allclose(turned, there.positions @ R.T, atol=1e-6)
    behind = warped(R, turned_load=False).positions
    assert np.abs(behind - there.positions @ R.T).max() > 0.1


def bending(p):
    """Stress sxx = 12 (1 - x) (y - 1/2), txy = -0.75 (1 - 4 (y - 1/2)²), section 4, item 3."""
    x, y, _ = p.T
    stress = np.zeros((len(p), 6))
    stress[:, 0], stress[:, 5] = 12 * (1 - x) * (y - 0.5), -0.75 * (1 - 4 * (y - 0.5) ** 2)
    return stress


def mean_angle(grid):
    """In-plane angle between the first axis of cells and the nearest principal axis, mean [deg]."""
    corners = grid.nodes.reshape(-1, 3)[grid.corners]
    edge = corners[:, [1, 2, 5, 6]].mean(axis=1) - corners[:, [0, 3, 4, 7]].mean(axis=1)
    stress = bending(grid.centres)
    principal = 0.5 * np.arctan2(2 * stress[:, 5], stress[:, 0] - stress[:, 1])
    angle = np.arctan2(edge[:, 1], edge[:, 0]) - principal
    return np.degrees(np.abs((angle + np.pi / 4) % (np.pi / 2) - np.pi / 4)).mean()


def test_cells_turn_along_the_principal_stresses():
    """From 22 degrees to at most 8; det J nowhere below a fifth of what is wanted (Bezier bound)."""
    grid = Grid.uniform(CUBE, (12, 12, 12))
    background = BackgroundGrid.covering(CUBE, 1 / 12)
    points = background.positions.reshape(-1, 3)
    points = points[np.all((points > -1e-9) & (points < 1 + 1e-9), axis=1)]
    samples = StressSamples(points, np.full(len(points), 1 / len(points)), bending(points)[None])
    f = stress_driver(samples, background, smoothing_mm=1 / 12).function(background, SizeLaw())
    np.testing.assert_allclose(mean_angle(grid), 22.05, atol=0.01)
    warp = LeastSquares(size_weight=1.0, alignment=NoShear(jnp.asarray(200.0)))
    result = warp.fit(grid, f)
    relative = (
        grid_coefficients(result.grid) / np.asarray(f.size(result.grid.centres))[:, None] ** 3
    )
    assert mean_angle(result.grid) < 8
    assert relative.min() > 0.2


# Cubes of cells; the fields below vary over it like over the unit cube.
BLOCK = Box.aligned(np.array([[0.0, 0, 0], [1.0, 0.75, 0.5]]))


def torsion(p):
    """Shear in planes through z, growing with the distance from the axis."""
    x, y, _ = p.T
    stress = np.zeros((len(p), 6))
    stress[:, 3], stress[:, 4] = x - 0.5, 0.5 - y
    return stress


@cache
def stiffness(name) -> EffectiveStiffness:
    return homogenised_cell(unit_cell(name), radius=0.05).stiffness


@cache
def block_function(field):
    background = BackgroundGrid.covering(BLOCK, 1 / 8)
    points = background.positions.reshape(-1, 3)
    points = points[np.all((points > -1e-9) & (points < BLOCK.extent + 1e-9), axis=1)]
    samples = StressSamples(
        points, np.full(len(points), 1 / len(points)), field(points / BLOCK.extent)[None]
    )
    law = SizeLaw(contrast=1.5)
    return stress_driver(samples, background, smoothing_mm=1 / 8).function(background, law)


def block_energy(field, alignment, cell):
    """Homogenised strain energy of a warped block over that of its unturned cells; no folds."""
    f = block_function(field)
    result = LeastSquares(size_weight=1.0, alignment=alignment).fit(
        Grid.uniform(BLOCK, (8, 6, 4)), f
    )
    assert result.converged
    assert grid_coefficients(result.grid).min() > 0
    measured = quality(result.grid, f, stiffness=stiffness(cell))
    assert measured.energy_warped is not None
    return measured.energy_warped


@pytest.mark.parametrize(("cell", "kind"), [("octet", EqualStretch), ("cube", NoShear)])
def test_turned_towards_least_energy_a_lattice_in_bending_stores_less(cell, kind):
    """Zener ratios 1.9 and 0.01: by 26 and 77 %; the best orientations would save 40 and 93 %."""
    alignment = alignment_for("energy", stiffness(cell), 100.0)
    assert isinstance(alignment, kind)
    turned = block_energy(bending, alignment, cell)
    plain = block_energy(bending, Unaligned(), cell)
    assert turned < 0.8 * plain


def test_an_octet_in_torsion_is_best_left_alone_and_worst_along_the_principal_stresses():
    """Shear in its own axes is what it is stiffest against."""
    by_energy = alignment_for("energy", stiffness("octet"), 100.0)
    along = alignment_for("axes", stiffness("octet"), 100.0)
    plain = block_energy(torsion, Unaligned(), "octet")
    # Of the unturned cells' energy, which is the least there is: sizes alone turn nothing here.
    np.testing.assert_allclose([plain, block_energy(torsion, by_energy, "octet")], 1, atol=1e-3)
    assert block_energy(torsion, along, "octet") > 1.4


def test_cells_that_already_lie_best_are_found_perfect():
    """Torsion pulls no axis of the box: the objective is zero, and no share of it is left to gain."""
    grid, flat = Grid.uniform(BLOCK, (8, 6, 4)), block_function(torsion).softened(1e-9)
    result = LeastSquares(alignment=EqualStretch(jnp.asarray(100.0))).fit(grid, flat)
    assert result.converged
    assert result.measures["gain"] == 0
    np.testing.assert_allclose(result.grid.nodes, grid.nodes, atol=1e-6)
