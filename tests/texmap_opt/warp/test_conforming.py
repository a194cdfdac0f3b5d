"""Nodes next to a part's surface are drawn onto it."""

import equinox as eqx
import hypothesis
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from hypothesis import strategies as st

from tests.texmap_opt.test_signed_distance import ball
from tests.verification.small_frames import remainder_orders
from texmap_opt.box import Box
from texmap_opt.errors import WarpError
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.warp import surface_layer as layer_module
from texmap_opt.warp.certificate import folded, grid_coefficients
from texmap_opt.warp.conforming import Conforming
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.part_distance import PartDistance
from texmap_opt.warp.surface_layer import crossing_edges, surface_layer

# Its chords are within 0.003 mm of the sphere.
SPHERE = TriMesh(10 * ball(128).vertices, ball(128).faces)
# One shape for most tests, so that JAX compiles once.
CELLS = (10, 11, 9)
CUBE = np.array([[-14.0, -14.0, -14.0], [14.0, 14.0, 14.0]])


def prism(outline: np.ndarray, low: float, high: float) -> TriMesh:
    """The convex polygon `outline`, counter-clockwise, extruded along z."""
    n = len(outline)
    ends = [np.column_stack([outline, np.full(n, z)]) for z in (low, high)]
    a, b = np.arange(n), np.roll(np.arange(n), -1)
    fan = np.stack([np.zeros(n - 2, int), a[1:-1], b[1:-1]], axis=1)
    walls = [np.stack([a, b, b + n], axis=1), np.stack([a, b + n, a + n], axis=1)]
    return TriMesh(np.concatenate(ends), np.concatenate([fan[:, ::-1], fan + n, *walls]))


def block(half: tuple[float, float, float]) -> TriMesh:
    x, y, z = half
    return prism(np.array([[-x, -y], [x, -y], [x, y], [-x, y]], float), -z, z)


def cylinder(radius: float, half_height: float) -> TriMesh:
    angle = 2 * np.pi * np.arange(256) / 256
    outline = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return prism(outline, -half_height, half_height)


def turn(seed: int) -> np.ndarray:
    Q, R = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q * np.linalg.det(Q)


def ellipsoid(axes: tuple[float, float, float], seed: int) -> TriMesh:
    unit = ball()
    return TriMesh(unit.vertices * np.array(axes) @ turn(seed).T, unit.faces)


def jittered(grid: Grid, seed: int, share: float = 0.2) -> Grid:
    """Nodes moved by up to a share of an edge, those on faces within their face."""
    move = np.random.default_rng(seed).uniform(-share, share, grid.nodes.shape) * grid.uniform_edge
    return grid.with_nodes(grid.nodes + np.where(np.moveaxis(grid.free, 0, -1), move, 0.0))


def component_first(grid: Grid) -> np.ndarray:
    return np.moveaxis(grid.nodes, -1, 0)


@eqx.filter_jit
def energy(conforming: Conforming, nodes):
    return conforming.energy(jnp.asarray(nodes))


def relaxed(grid: Grid, conforming: Conforming) -> Grid:
    """The grid with the least energy and squared differences of neighbours' displacements."""
    start, free = component_first(grid), np.flatnonzero(grid.free)
    edge = grid.uniform_edge.reshape(-1, *[1] * grid.dimensions)

    def moved(z):
        return jnp.zeros(start.size).at[free].set(z).reshape(start.shape)

    @jax.jit
    @jax.value_and_grad
    def objective(z):
        strain = [jnp.diff(moved(z), axis=1 + k) / edge for k in range(grid.dimensions)]
        smooth = 0.5 * sum(jnp.sum(e**2) for e in strain)
        return conforming.energy(start + moved(z)) + smooth

    found = scipy.optimize.minimize(
        lambda z: tuple(np.asarray(value) for value in objective(z)),
        np.zeros(len(free)),
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": 120},
    )
    return grid.with_nodes(np.moveaxis(start + np.asarray(moved(found.x)), 0, -1))


@pytest.mark.parametrize(
    ("part", "grid", "most"),
    [
        (SPHERE, Grid.uniform(Box.aligned(CUBE), CELLS), 0.003),
        # Faces half way between layers of nodes: every node of the layer moves half an edge.
        (block((10, 6, 4)), Grid.uniform(Box.aligned(CUBE * [13, 9, 7] / 14), (13, 9, 7)), 0.06),
        (
            cylinder(10, 2),
            Grid.uniform(Box.aligned(CUBE * [1, 1, 1 / 7], extrusion="z"), CELLS[:2]),
            0.003,
        ),
    ],
)
def test_nodes_land_on_the_surface(part: TriMesh, grid: Grid, most: float):
    """Up to the spline: 0.3 % of an edge where the part is smooth, 6 % at its sharp edges."""
    conforming = Conforming.of(grid, part, 1e4)
    before, moved = conforming.measure(grid, part), relaxed(grid, conforming)
    after = conforming.measure(moved, part)
    assert before.rms_relative > 0.15
    assert after.max_relative < most
    assert after.nodes == len(conforming.chosen)
    assert not folded(grid_coefficients(moved)).any()


@hypothesis.given(
    axes=st.tuples(*[st.floats(4, 12)] * 3), seed=st.integers(0, 999), share=st.floats(0, 0.2)
)
@hypothesis.settings(max_examples=12, deadline=None)
def test_every_edge_that_crosses_the_surface_has_a_chosen_end(axes, seed: int, share: float):
    """So the chosen nodes are a closed layer; in unfolded grids flat corners cost it nothing."""
    grid = jittered(Grid.uniform(Box.aligned(CUBE), CELLS), seed, share)
    hypothesis.assume(not folded(grid_coefficients(grid)).any())
    part = ellipsoid(axes, seed)
    conforming = Conforming.of(grid, part, 1.0)
    edges = crossing_edges(grid, PartDistance(part, grid.box)(grid.nodes.reshape(-1, 3)))
    chosen = np.isin(edges, np.asarray(conforming.chosen))
    assert len(edges) > 20
    assert chosen.any(axis=1).all()


@hypothesis.given(
    normal=st.tuples(*[st.floats(-1, 1)] * 3),
    offset=st.floats(-3, 3),
    cells=st.permutations((7, 9)),
)
@hypothesis.settings(max_examples=30, deadline=None)
def test_on_a_plane_each_grid_line_across_it_has_one_chosen_node(normal, offset: float, cells):
    """A naive digital plane: on every line along the axis the plane is steepest in, edges counted."""
    hypothesis.assume(np.linalg.norm(normal) > 0.1)
    n = np.array(normal) / np.linalg.norm(normal)
    grid = Grid.uniform(Box.aligned(CUBE), (*cells, 8))
    distance = grid.nodes @ n - offset
    slope = np.broadcast_to(n, grid.nodes.shape).reshape(-1, 3)
    chosen = np.zeros(distance.shape, bool)
    chosen.ravel()[surface_layer(grid, distance.ravel(), slope.copy())] = True
    axis = int(np.argmax(np.abs(n) * grid.uniform_edge))
    # Lines inside the box, along which the plane is not in the outermost cells.
    inner = tuple(slice(None) if k == axis else slice(1, -1) for k in range(3))
    along, inside = (np.moveaxis(part[inner], axis, 0) for part in (chosen, distance < 0))
    crosses = inside[1] != inside[-2]
    assert (along.sum(axis=0)[crosses] == 1).all()


def test_rounding_does_not_choose_between_two_layers_that_are_equally_near():
    """The solver's tolerance, 1e-3 of an edge, is the noise; the inner layer is taken as a whole."""
    grid = Grid.uniform(Box.aligned(CUBE), (7, 7, 7))
    noise = np.random.default_rng(0).uniform(-4e-3, 4e-3, grid.nodes.shape[:-1])
    distance = grid.nodes[..., 2] + noise
    slope = np.broadcast_to([0.0, 0.0, 1.0], grid.nodes.shape).reshape(-1, 3)
    chosen = surface_layer(grid, distance.ravel(), slope.copy())
    np.testing.assert_allclose(grid.nodes.reshape(-1, 3)[chosen][:, 2], -2.0)
    assert len(chosen) == 64


def test_no_corner_of_a_cell_is_laid_flat_into_a_curved_surface(monkeypatch):
    """Nor is it by chance: without taking nodes back there are such corners in these grids."""
    # 0.2 is the limit, by a step of Newton's method instead of the nearest point.
    assert _flattest_corner() > 0.1
    monkeypatch.setattr(layer_module, "LEAST_CORNER", -np.inf)
    assert _flattest_corner() < 0.1


def _flattest_corner() -> float:
    """Least volume of corners whose nodes have all gone to the nearest point of the surface."""
    worst = []
    for seed in range(4):
        part = ellipsoid((12, 7, 5), seed)
        grid = jittered(Grid.uniform(Box.aligned(CUBE), CELLS), seed, 0.15)
        chosen = np.asarray(Conforming.of(grid, part, 1.0).chosen)
        moved = grid.nodes.reshape(-1, 3).copy()
        moved[chosen] = SignedDistance(part)(moved[chosen])[2]
        there = np.isin(np.arange(len(moved)), chosen).reshape(grid.nodes.shape[:-1])
        moved = grid.with_nodes(moved.reshape(grid.nodes.shape))
        worst.append(_corner_volumes(moved)[_crowded(there)].min(initial=1.0))
    return float(min(worst))


def _crowded(there: np.ndarray) -> np.ndarray:
    """Lower corners of cells whose node and three neighbours are all there."""
    low = there[:-1, :-1, :-1]
    return low & there[1:, :-1, :-1] & there[:-1, 1:, :-1] & there[:-1, :-1, 1:]


def _corner_volumes(grid: Grid) -> np.ndarray:
    x = grid.nodes
    edges = [x[1:, :-1, :-1], x[:-1, 1:, :-1], x[:-1, :-1, 1:]]
    J = np.stack([e - x[:-1, :-1, :-1] for e in edges], axis=-2) / grid.uniform_edge[:, None]
    return np.linalg.det(J)


def test_a_grid_whose_layers_lie_on_a_box_shaped_part_stays_there():
    """All 250 nodes of its surface, edges and corners too; the spline has the plane to 1e-5."""
    bounds = np.array([[-10.0, -6.0, -4.0], [10.0, 6.0, 4.0]])
    grid = Grid.around(Box.aligned(bounds), (10, 6, 4), margin_cells=1, radius_mm=0.5)
    part = block((10, 6, 4))
    conforming = Conforming.of(grid, part, 10.0)
    on_surface = np.abs(PartDistance(part, grid.box)(grid.nodes.reshape(-1, 3))) < 1e-9
    np.testing.assert_array_equal(conforming.chosen, np.flatnonzero(on_surface))
    assert float(energy(conforming, component_first(grid))) < 1e-8
    residual = conforming.measure(grid, part)
    assert residual.nodes == 250
    assert residual.max_mm < 1e-12


def test_the_energy_is_half_the_squared_distance_over_the_edge():
    """A layer moved off a plane by a tenth of an edge: 1/2 w n / 100, and the residual says so."""
    grid = Grid.uniform(Box.aligned(CUBE), (7, 7, 7))
    part = block((30, 30, 10))  # its large faces are layers of nodes; the rest is outside the box
    conforming = Conforming.of(grid, part, 10.0)
    assert len(conforming.chosen) == 2 * 64
    away = component_first(grid) + np.array([0.0, 0.0, 0.4]).reshape(3, 1, 1, 1)
    expected = 0.5 * 10.0 * 128 * 0.1**2
    # The spline smooths the limit, four of its nodes away, by 2e-3 of the distance there.
    np.testing.assert_allclose(energy(conforming, away), expected, rtol=5e-3)
    residual = conforming.measure(grid.with_nodes(np.moveaxis(away, 0, -1)), part)
    np.testing.assert_allclose([residual.max_mm, residual.rms_mm], 0.4, rtol=1e-12)
    np.testing.assert_allclose([residual.max_relative, residual.rms_relative], 0.1, rtol=1e-12)


@pytest.mark.parametrize("extrusion", [None, "z"])
def test_the_gradient_has_a_second_order_taylor_remainder(extrusion: str | None):
    grid = Grid.uniform(Box.aligned(CUBE, extrusion=extrusion), CELLS[: 2 if extrusion else 3])
    conforming = Conforming.of(grid, SPHERE, 10.0)
    at = component_first(grid)
    orders = remainder_orders(lambda nodes: energy(conforming, nodes), at)
    np.testing.assert_allclose(orders, 2, atol=0.1)
    by = eqx.filter_grad(energy)(conforming, at)
    np.testing.assert_allclose(by.weight, energy(conforming, at) / 10.0, rtol=1e-12)


def test_the_field_is_the_distance_within_an_edge_of_the_surface():
    """The estimate that stands for it far away does not reach there; the spline rounds facets."""
    grid = Grid.uniform(Box.aligned(CUBE), (14, 14, 14))
    conforming = Conforming.of(grid, SPHERE, 1.0)
    points = np.random.default_rng(0).uniform(-13, 13, (20_000, 3))
    true = PartDistance(SPHERE, grid.box)(points)
    near = np.abs(true) < 2.0
    np.testing.assert_allclose(conforming.field(points[near])[:, 0], true[near], atol=7e-3)
    far = np.abs(true) > 8.0
    np.testing.assert_allclose(
        conforming.field(points[far])[:, 0], 4.0 * np.sign(true[far]), rtol=6e-3
    )


def test_the_outline_of_an_extruded_part_does_not_depend_on_its_thickness():
    """A plate thinner than a cell: by the distance in space its middle would be at the surface."""
    results = []
    for half in (0.2, 40.0):
        bounds = CUBE * [1, 1, half / 14]
        grid = Grid.uniform(Box.aligned(bounds, extrusion="z"), CELLS[:2])
        conforming = Conforming.of(grid, cylinder(10, half), 1.0)
        results.append(np.asarray(conforming.chosen))
        points = grid.nodes.reshape(-1, 2)
        # The polygon's chords are 10 (1 - cos(pi/256)) = 8e-4 mm inside the circle.
        expected = np.linalg.norm(points, axis=1) - 10
        np.testing.assert_allclose(
            PartDistance(cylinder(10, half), grid.box)(points), expected, atol=1e-3
        )
    np.testing.assert_array_equal(*results)


def test_the_outline_of_a_tapered_part_is_that_of_its_shadow():
    """A frustum of radii 7 to 13, whose walls are nearer in space than their shadow's edge is."""
    part = cylinder(10, 3)
    part = TriMesh(part.vertices * (1 - part.vertices[:, 2:] / 10 * [1, 1, 0]), part.faces)
    box = Box.aligned(CUBE * [1, 1, 3 / 14], extrusion="z")
    points = np.array([[0.0, 0.0], [8.0, 0.0], [0.0, 13.0]])
    np.testing.assert_allclose(PartDistance(part, box)(points), [-13, -5, 0], atol=2e-3)


def test_a_turned_box_around_a_turned_part_chooses_the_same_nodes():
    R, part = turn(4), block((10.3, 6.2, 4.4))
    bounds = CUBE * [0.9, 0.6, 0.5]
    grids = [Grid.uniform(Box(axes, bounds), (9, 8, 7)) for axes in (np.eye(3), R.T)]
    turned = TriMesh(part.vertices @ R.T, part.faces)
    straight, other = (
        Conforming.of(grid, surface, 1.0)
        for grid, surface in zip(grids, (part, turned), strict=True)
    )
    np.testing.assert_array_equal(straight.chosen, other.chosen)
    at = component_first(grids[0])
    np.testing.assert_allclose(energy(straight, at), energy(other, at), rtol=1e-9)


def test_only_nodes_that_can_reach_the_surface_are_chosen():
    """A bar through the box: nodes on the box's faces slide to its walls, fixed ones stay."""
    box = Box.aligned(CUBE)
    part = block((20, 5, 5))
    sliding = Conforming.of(Grid.uniform(box, (7, 7, 7)), part, 1.0)
    on_face = sliding.chosen[sliding.chosen < 64]
    # The ring of nodes at y or z = +-6 (the walls are at 5, nodes at 2, 6).
    y, z = np.divmod(np.asarray(on_face), 8)
    assert len(on_face) > 0
    assert (np.maximum(np.abs(y - 3.5), np.abs(z - 3.5)) == 1.5).all()
    fixed = np.zeros((2, 3), bool)
    fixed[0, 0] = True
    held = Conforming.of(Grid.uniform(box, (7, 7, 7), fixed=fixed), part, 1.0)
    np.testing.assert_array_equal(held.chosen, sliding.chosen[sliding.chosen >= 64])


def test_what_cannot_conform_is_refused():
    grid = Grid.uniform(Box.aligned(CUBE), (7, 7, 7))
    with pytest.raises(WarpError, match="no node next to the part's surface that may move"):
        Conforming.of(grid, block((20, 20, 20)), 1.0)
    for weight in (0.0, -1.0, np.nan):
        with pytest.raises(WarpError, match="must be a positive number"):
            Conforming.of(grid, SPHERE, weight)
