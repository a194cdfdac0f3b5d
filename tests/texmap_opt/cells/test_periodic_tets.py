"""Tets of periodic cells: mirror planes, volume, matching faces, effective stiffness."""

import numpy as np
import pytest

from fea import FeaError, Material, TetMesh
from fea.homogenise_solid import homogenise_mirrored, homogenise_solid
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.periodic_density import periodic_density
from texmap_opt.cells.periodic_tets import (
    is_cubic,
    mirror_spacing,
    mirrored_surface,
    mirrored_tets,
    on_planes,
    reflected,
)
from texmap_opt.errors import CellError
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.tile import tile
from texmap_opt.structure.volume import lattice_volume

SOLID = Material(E=1.0, nu=0.3, density=1e-9)
CUBIC = ("octet", "bcc", "cube", "octahedron", "vector", "tetrakaidecahedron")


@pytest.mark.parametrize("name", CUBIC)
def test_cells_with_mirror_planes_are_cubic_too(name):
    assert mirror_spacing(unit_cell(name)) == 0.5
    assert is_cubic(unit_cell(name))


def test_diamond_has_no_mirror_planes_across_its_axes():
    with pytest.raises(CellError, match="not its own mirror image across x"):
        mirror_spacing(unit_cell("diamond"))


@pytest.mark.parametrize(("name", "radius"), [("octet", 0.0465), ("bcc", 0.0727), ("cube", 0.11)])
def test_the_corrected_density_is_that_of_the_surface(name, radius):
    """0.2 % from the quadrature's 432 directions; joints of the surface are slightly too thick."""
    cell = unit_cell(name)
    surface = mirrored_surface(cell, edge=2.0, radius=2.0 * radius)
    np.testing.assert_allclose(surface.bounds, [[0.0] * 3, [1.0] * 3], atol=1e-12)
    density = periodic_density(cell, radius, subdivisions=6)
    np.testing.assert_allclose(surface.volume, density, rtol=4e-3)


def test_the_density_of_an_endless_lattice_is_the_growth_of_a_block():
    """The mixed difference over blocks of 1 and 2 cells along each axis, which are all alike."""
    cell, total = unit_cell("bcc"), 0.0
    for counts, weight in {(1, 1, 1): -1, (1, 1, 2): 3, (1, 2, 2): -3, (2, 2, 2): 1}.items():
        ticks = [np.arange(n + 1.0) for n in counts]
        nodes = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1)
        total += weight * lattice_volume(map_structure(tile(cell, counts), nodes, 0.07))
    np.testing.assert_allclose(periodic_density(cell, 0.07), total, rtol=1e-12)


def strayed(amount: float) -> TetMesh:
    """A cube whose outer nodes stray from its faces, as a mesher leaves them."""
    box = TetMesh.box((1.0, 1.0, 1.0), (3, 3, 3))
    rng = np.random.default_rng(0)
    return box.with_nodes(box.nodes + amount * rng.uniform(-1, 1, box.nodes.shape))


def test_nodes_within_the_envelope_are_put_on_the_mirror_planes():
    mesh = on_planes(strayed(0.01), side=1.0, envelope=0.01)
    np.testing.assert_allclose(mesh.volume, 1.0, rtol=1e-12)
    outside = ~np.isclose(mesh.nodes, 1 / 3, atol=0.1) & ~np.isclose(mesh.nodes, 2 / 3, atol=0.1)
    assert np.isin(mesh.nodes[outside], [0.0, 1.0]).all()


def test_a_mesh_that_does_not_reach_its_plane_is_refused():
    with pytest.raises(FeaError, match=r"No node lies within 0\.001 of the mirror plane x = 2"):
        on_planes(strayed(0.001), side=2.0, envelope=0.001)


def test_a_cell_that_becomes_flat_on_a_plane_is_left_out():
    box = TetMesh.box((1.0, 1.0, 1.0), (2, 2, 2))
    # A sliver on one facet of x = 0, within the envelope.
    facet = box.facets_where(lambda x: x[:, 0] < 1e-9)[0]
    apex = box.nodes[facet].mean(axis=0) - [1e-3, 0.0, 0.0]
    sliver = TetMesh(np.vstack([box.nodes, apex]), np.vstack([box.tets, [*facet, len(box.nodes)]]))
    assert sliver.volumes.min() > 0
    mesh = on_planes(sliver, side=1.0, envelope=2e-3)
    assert len(mesh.tets) == len(box.tets)
    np.testing.assert_allclose(mesh.volume, 1.0, rtol=1e-12)


def test_a_reflected_mesh_repeats_with_its_period():
    """Opposite faces match: `homogenise_solid` accepts it, and finds the material of a full block."""
    eighth = on_planes(strayed(0.05), side=1.0, envelope=0.05)
    whole = reflected(eighth)
    np.testing.assert_allclose(whole.volume, 8.0, rtol=1e-12)
    C = homogenise_solid(whole, 2 * np.eye(3), SOLID).C
    np.testing.assert_allclose(C, SOLID.stiffness, atol=1e-9)
    # Negative control: the eighth alone has faces that do not match.
    with pytest.raises(FeaError, match="has no match in the opposite face"):
        homogenise_solid(eighth, np.eye(3), SOLID)


def test_a_cube_cell_meshed_and_reflected_has_the_stiffness_of_its_eighth():
    """Two ways to homogenise one mesh; its density is that of the corrected volume.

    The mesh is coarse: its surface is within a hundredth of the radius all the same.
    """
    cell, radius = unit_cell("cube"), 0.2
    eighth = mirrored_tets(cell, edge=1.0, radius=radius, tet_edge=radius)
    whole = homogenise_solid(reflected(eighth), np.eye(3), SOLID)
    mirrored = homogenise_mirrored(eighth, SOLID)
    np.testing.assert_allclose(whole.C, mirrored.C, atol=1e-6 * whole.C.max())
    np.testing.assert_allclose(mirrored.density, periodic_density(cell, radius), rtol=1e-2)
