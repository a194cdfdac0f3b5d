"""Loads on straight and curved cells, their derivatives, and supports."""

import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fea import FeaError, Material, Support, TetMesh
from fea.boundary_conditions import (
    body_forces,
    check_loads,
    force_on_facets,
    gravity_forces,
    load_on_supports,
    moment_on_facets,
    prescribed_dofs,
    pressure_forces,
    traction_forces,
)
from fea.elements import TRIANGLES
from fea.isoparametric import facet_points
from fea.quadrature import Quadrature

ELEMENTS = ["tet4", "tet10"]


def curved(element="tet10"):
    """A block bent by a quadratic map, so that tet10 cells are exactly the image."""
    mesh = TetMesh.box((2.0, 1.0, 1.0), (2, 1, 1))
    mesh = mesh if element == "tet4" else mesh.to_tet10()
    x, y, z = mesh.nodes.T
    return TetMesh(np.stack([x + 0.1 * y * z, y + 0.1 * x**2, z + 0.2 * x * y], axis=1), mesh.tets)


def right(mesh):
    return mesh.facets_where(lambda c: c[:, 0] > 1.9)


def resultants(mesh, forces):
    return forces.sum(axis=0), np.cross(mesh.nodes, forces).sum(axis=0)


@pytest.mark.parametrize("element", ELEMENTS)
def test_pressure_on_a_closed_curved_surface_has_no_resultant(element):
    mesh = curved(element)
    force, moment = resultants(mesh, pressure_forces(mesh, mesh.boundary_facets, 3.0))
    np.testing.assert_allclose(np.concatenate([force, moment]), 0, atol=1e-13)


@pytest.mark.parametrize("element", ELEMENTS)
def test_hydrostatic_pressure_is_archimedes(element):
    """Pressure rho g (h - z) lifts by the weight of the displaced fluid, at its centroid."""
    mesh = curved(element)
    lift = pressure_forces(mesh, mesh.boundary_facets, lambda x: 5.0 - 2.0 * x[:, 2])
    weight = gravity_forces(mesh, 2.0, np.array([0.0, 0.0, -1.0]))
    for a, b in zip(resultants(mesh, lift), resultants(mesh, -weight), strict=True):
        # z times N times the normal has degree 6 on a curved facet, where the rule is exact to 4.
        np.testing.assert_allclose(a, b, atol=1e-13 if element == "tet4" else 2e-4)
    straight = TetMesh.box((2.0, 1.0, 1.0), (2, 1, 1)).to_tet10()
    lift = pressure_forces(straight, straight.boundary_facets, lambda x: 5.0 - 2.0 * x[:, 2])
    np.testing.assert_allclose(lift.sum(axis=0), [0, 0, 4.0], atol=1e-13)


@pytest.mark.parametrize("element", ELEMENTS)
def test_weight_of_curved_cells_is_density_times_volume(element):
    """N det J has degree 5 on a curved tet10; a rule of degree 2 is off by about 1e-4."""
    mesh = curved(element)
    weight = gravity_forces(mesh, 3.0, np.array([1.0, 2.0, -9.0]))
    volume = np.einsum(
        "f,fx,fx->", mesh.facet_areas, mesh.facet_normals, mesh.facet_centroids
    )  # of straight facets only
    if element == "tet4":
        np.testing.assert_allclose(mesh.volume, volume / 3, rtol=1e-13)
    np.testing.assert_allclose(weight.sum(axis=0), 3 * mesh.volume * np.array([1, 2, -9]))
    same = body_forces(mesh, np.array([3.0, 6.0, -27.0]))
    np.testing.assert_allclose(weight, same, atol=1e-13)
    by_cell = gravity_forces(mesh, np.full(len(mesh.tets), 3.0), np.array([1.0, 2.0, -9.0]))
    np.testing.assert_allclose(weight, by_cell, atol=1e-14)


def test_nodal_weights_on_a_curved_cell_are_the_integrals_of_the_shape_functions():
    """Against 20³ Gauss points collapsed onto the tetrahedron, which nothing here uses."""
    mesh = curved()
    t, w = np.polynomial.legendre.leggauss(20)
    t, w = (t + 1) / 2, w / 2
    r, s, u = (a.ravel() for a in np.meshgrid(t, t, t, indexing="ij"))
    weight = (w[:, None, None] * w[None, :, None] * w[None, None, :]).ravel()
    # Duffy's map from the cube: Jacobian (1 - r)² (1 - s).
    points = np.stack([r, (1 - r) * s, (1 - r) * (1 - s) * u], axis=1)
    weight = weight * (1 - r) ** 2 * (1 - s)
    kind = mesh.element_type
    J = np.einsum("cnx,qnr->cqxr", mesh.nodes[mesh.tets], kind.gradient(points))
    share = np.einsum("cq,q,qn->cn", np.linalg.det(J), weight, kind.shape(points))
    expected = np.zeros(len(mesh.nodes))
    np.add.at(expected, mesh.tets, share)
    found = gravity_forces(mesh, 1.0, np.array([0.0, 0.0, 1.0]))[:, 2]
    np.testing.assert_allclose(found, expected, atol=1e-13)


@pytest.mark.parametrize(
    ("mesh", "pressure"),
    [
        (curved(), lambda x: 2.0 + 0 * x[:, 0]),
        (TetMesh.box((2.0, 1.0, 1.0), (2, 1, 1)).to_tet10(), lambda x: x[:, 1] * (3 - x[:, 2])),
    ],
    ids=["constant on curved facets", "quadratic on straight facets"],
)
def test_nodal_forces_of_pressure_are_the_integrals_against_the_shape_functions(mesh, pressure):
    """Against 10² Gauss points collapsed onto the facets, which nothing here uses."""
    t, w = np.polynomial.legendre.leggauss(10)
    t, w = (t + 1) / 2, w / 2
    r, s = (a.ravel() for a in np.meshgrid(t, t, indexing="ij"))
    points = np.stack([r, (1 - r) * s], axis=1)
    rule = Quadrature(points, (w[:, None] * w[None, :]).ravel() * (1 - r), 19)
    facets = mesh.boundary_facets
    x, n = facet_points(mesh.nodes[facets], rule)
    load = -pressure(x.reshape(-1, 3)).reshape(x.shape[:2])[:, :, None] * n
    expected = np.zeros_like(mesh.nodes)
    np.add.at(expected, facets, np.einsum("fqx,qn->fnx", load, TRIANGLES[6].shape(points)))
    np.testing.assert_allclose(pressure_forces(mesh, facets, pressure), expected, atol=1e-13)


@pytest.mark.parametrize("element", ELEMENTS)
def test_traction_may_vary_in_space(element):
    """A traction linear in y on the flat end of a straight bar: resultant and moment by hand."""
    mesh = TetMesh.box((2.0, 1.0, 1.0), (2, 2, 2))
    mesh = mesh if element == "tet4" else mesh.to_tet10()
    end = right(mesh)
    forces = traction_forces(
        mesh, end, lambda x: np.stack([x[:, 1], 0 * x[:, 1], 2 * x[:, 1]], axis=1)
    )
    force, moment = resultants(mesh, forces)
    # ∫ y = 1/2, ∫ y² = 1/3, ∫ y z = 1/4 over the unit square at x = 2.
    np.testing.assert_allclose(force, [0.5, 0, 1.0], atol=1e-14)
    np.testing.assert_allclose(moment, [2 / 3, 0.25 - 2 * 1.0, -1 / 3], atol=1e-14)
    constant = np.array([1.0, -2.0, 3.0])
    np.testing.assert_allclose(
        traction_forces(mesh, end, constant),
        traction_forces(mesh, end, lambda x: np.broadcast_to(constant, x.shape)),
        atol=1e-15,
    )


def work(load):
    """Work of a load on a fixed displacement, as a function of the mesh's nodes, and a direction."""
    mesh = curved()
    rng = np.random.default_rng(3)
    u, v = rng.standard_normal((2, *mesh.nodes.shape))
    return mesh, lambda x: jnp.sum(load(mesh, x) * u), v


LOADS = {
    "pressure": lambda m, x: pressure_forces(m, right(m), 2.0, nodes=x),
    "varying pressure": lambda m, x: pressure_forces(
        m, right(m), lambda p: jnp.sin(p[:, 1]) + p[:, 0] ** 2, nodes=x
    ),
    "traction": lambda m, x: traction_forces(m, right(m), np.array([1.0, 2.0, 3.0]), nodes=x),
    "force": lambda m, x: force_on_facets(m, right(m), np.array([1.0, 2.0, 3.0]), nodes=x),
    "moment": lambda m, x: moment_on_facets(m, right(m), np.array([1.0, 2.0, 3.0]), nodes=x),
    "gravity": lambda m, x: gravity_forces(m, 2.0, np.array([0.0, 1.0, 3.0]), nodes=x),
    "body force": lambda m, x: body_forces(m, lambda p: jnp.sin(p), nodes=x),
}


@pytest.mark.parametrize("name", LOADS)
def test_gradient_of_a_loads_work_by_nodes_has_a_second_order_taylor_remainder(name):
    mesh, f, v = work(LOADS[name])
    x = jnp.asarray(mesh.nodes)
    slope = float(jnp.vdot(jax.jit(jax.grad(f))(x), v))
    f = jax.jit(f)
    # Cells are 0.5 wide and the direction has unit deviation: 0.1 % of a cell, and rounding (1e-15
    # over a remainder of 1e-6) is far.
    steps = 5e-4 / 2.0 ** np.arange(4)
    remainder = [abs(float(f(x + h * v) - f(x)) - h * slope) for h in steps]
    order = np.log2(np.array(remainder[:-1]) / np.array(remainder[1:]))
    np.testing.assert_allclose(order, 2, atol=0.05)
    # Negative control: with a wrong gradient the remainder is of first order.
    wrong = [abs(float(f(x + h * v) - f(x)) - 1.01 * h * slope) for h in steps]
    assert np.log2(wrong[-2] / wrong[-1]) < 1.6


@pytest.mark.parametrize("name", LOADS)
def test_jax_and_numpy_give_the_same_forces(name):
    mesh = curved()
    traced = LOADS[name](mesh, jnp.asarray(mesh.nodes))
    assert isinstance(traced, jax.Array)
    plain = LOADS[name](mesh, mesh.nodes)
    np.testing.assert_allclose(plain, traced, atol=1e-13)
    moved = TetMesh(1.1 * mesh.nodes, mesh.tets)
    np.testing.assert_allclose(
        LOADS[name](mesh, 1.1 * mesh.nodes), LOADS[name](moved, moved.nodes), atol=1e-13
    )


def test_loads_are_differentiable_by_their_size():
    mesh = curved()
    f = jax.grad(lambda p: jnp.sum(pressure_forces(mesh, right(mesh), p)[:, 0]))(2.0)
    np.testing.assert_allclose(f, pressure_forces(mesh, right(mesh), 1.0)[:, 0].sum())
    g = jax.grad(lambda a: gravity_forces(mesh, 1.0, a)[:, 2].sum())(jnp.ones(3))
    np.testing.assert_allclose(g, [0, 0, mesh.volume], atol=1e-14)


def test_kinds_of_arrays_are_kept():
    mesh = curved()
    assert type(pressure_forces(mesh, right(mesh), 1.0)) is np.ndarray
    assert type(gravity_forces(mesh, 1.0, np.ones(3))) is np.ndarray


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m, f: pressure_forces(m, f[:, :3], 1.0), r"tet10 mesh takes 6 nodes a row"),
        (lambda m, f: pressure_forces(m, f + 1000, 1.0), "Facets refer to nodes"),
        (lambda m, f: pressure_forces(m, f, float("nan")), "pressure is not a number"),
        (lambda m, f: pressure_forces(m, f, lambda x: x), r"return shape \(\d+,\)"),
        (lambda m, f: traction_forces(m, f, np.ones(2)), r"traction has shape \(2,\)"),
        (lambda m, f: traction_forces(m, f, np.ones(3, np.float32)), "float32"),
        (lambda m, f: traction_forces(m, f, lambda x: np.nan * x), "traction is not a number"),
        (lambda m, f: force_on_facets(m, f[:0], np.ones(3)), "without area"),
        (lambda m, f: moment_on_facets(m, f[:0], np.ones(3)), "without area"),
        (lambda m, f: gravity_forces(m, np.ones(2), np.ones(3)), r"density has shape \(2,\)"),
        (lambda m, f: gravity_forces(m, 1.0, np.full(3, np.inf)), "acceleration is not a number"),
    ],
)
def test_impossible_loads_are_refused(call, message):
    mesh = curved()
    with pytest.raises(FeaError, match=message):
        call(mesh, right(mesh))


LOAD_OF = {
    "traction": lambda m, load, **more: traction_forces(m, right(m), load, **more),
    "force": lambda m, load, **more: force_on_facets(m, right(m), load, **more),
    "moment": lambda m, load, **more: moment_on_facets(m, right(m), load, **more),
    "gravity": lambda m, load, **more: gravity_forces(m, 2.0, load, **more),
    "body force": lambda m, load, **more: body_forces(m, load, **more),
}
SINGLE = [np.ones(3, np.float32), jnp.ones(3, jnp.float32), jnp.ones(3, jnp.bfloat16)]


@pytest.mark.parametrize("name", LOAD_OF)
def test_lists_and_whole_numbers_are_loads_too(name):
    mesh, load = curved(), LOAD_OF[name]
    expected = load(mesh, np.array([1.0, -2.0, 3.0]))
    for numbers in ([1, -2, 3], (1.0, -2, 3), np.array([1, -2, 3]), jnp.array([1, -2, 3])):
        found = load(mesh, numbers)
        assert found.dtype == np.float64
        assert isinstance(found, jax.Array) == isinstance(numbers, jax.Array)
        np.testing.assert_allclose(found, expected, atol=1e-14)
    moved = load(mesh, [1, -2, 3], nodes=jnp.asarray(mesh.nodes))
    np.testing.assert_allclose(moved, expected, atol=1e-14)
    # A list may hold what JAX traces.
    slope = jax.grad(lambda p: load(mesh, [0.0, 0, p])[:, 2].sum())(2.0)
    unit = load(mesh, [0.0, 0.0, 1.0])[:, 2].sum()
    np.testing.assert_allclose(slope, unit, atol=1e-13)


@pytest.mark.parametrize("name", LOAD_OF)
def test_single_precision_is_refused_wherever_it_enters(name):
    mesh, load = curved(), LOAD_OF[name]
    for single in SINGLE:
        with pytest.raises(FeaError, match=f"are {single.dtype}"):
            load(mesh, single)
    for nodes in (mesh.nodes.astype(np.float32), jnp.asarray(mesh.nodes, jnp.float32)):
        with pytest.raises(FeaError, match="array `nodes` are float32"):
            load(mesh, np.ones(3), nodes=nodes)
    with pytest.raises(FeaError, match="float32"):
        jax.jit(lambda single: load(mesh, single))(SINGLE[1])
    with pytest.raises(FeaError, match="float32"):
        jax.grad(lambda x: load(mesh, np.ones(3), nodes=x).sum())(
            jnp.asarray(mesh.nodes, jnp.float32)
        )


def test_single_precision_of_pressure_density_and_functions_is_refused():
    mesh = curved()
    facets, down = right(mesh), np.array([0.0, 0.0, -1.0])
    for single in (np.float32(2), jnp.float32(2)):
        with pytest.raises(FeaError, match="pressure are float32"):
            pressure_forces(mesh, facets, single)
        with pytest.raises(FeaError, match="density are float32"):
            gravity_forces(mesh, single, down)
    for xp in (np, jnp):
        with pytest.raises(FeaError, match="pressure are float32"):
            pressure_forces(mesh, facets, lambda x, xp=xp: xp.asarray(x[:, 0], xp.float32))
    # What Python's numbers become when JAX traces them is float64.
    total = jax.jit(lambda p: pressure_forces(mesh, facets, p))(2.0)
    np.testing.assert_allclose(total, pressure_forces(mesh, facets, 2), atol=1e-14)


def test_jax_without_float64_is_refused_with_its_remedy():
    mesh = curved()
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(FeaError, match="jax_enable_x64"):
            pressure_forces(mesh, right(mesh), jnp.asarray(2.0))
    finally:
        jax.config.update("jax_enable_x64", True)


def test_jax_arrays_that_have_values_are_looked_at():
    mesh = curved()
    with pytest.raises(FeaError, match=r"force is not a number, nan at \[1\]"):
        force_on_facets(mesh, right(mesh), jnp.array([0.0, jnp.nan, 0.0]))
    with pytest.raises(FeaError, match="array `nodes` is not a number"):
        force_on_facets(mesh, right(mesh), np.ones(3), nodes=jnp.asarray(mesh.nodes) / 0.0)
    with pytest.raises(FeaError, match="no real number"):
        force_on_facets(mesh, right(mesh), ["a", "b", "c"])
    with pytest.raises(FeaError, match="give float64"):
        force_on_facets(mesh, right(mesh), jnp.ones(3, complex))


@pytest.mark.parametrize("xp", [np, jnp])
def test_a_body_without_mass_has_no_weight(xp):
    mesh, down = curved(), np.array([0.0, 0.0, -9810.0])
    cells = len(mesh.tets)
    some = np.where(np.arange(cells) > 2, 1.0, 0.0)
    assert gravity_forces(mesh, xp.asarray(some), down).sum() < 0  # voids among other cells
    for none in (xp.asarray(0.0), xp.zeros(cells)):
        with pytest.raises(FeaError, match=r"density is zero, .* give the material its own"):
            gravity_forces(mesh, none, down)
    for negative in (xp.asarray(-2.0), xp.asarray(np.where(some > 0, some, -2.0))):
        with pytest.raises(FeaError, match="density is -2 tonne/mm³ somewhere"):
            gravity_forces(mesh, negative, down)
    with pytest.raises(FeaError, match="density is zero"):
        gravity_forces(mesh, Material(1.0, 0.3, 0.0).density, down)


def test_nodes_of_another_mesh_are_refused():
    mesh = curved()
    with pytest.raises(FeaError, match="but the mesh has"):
        pressure_forces(mesh, right(mesh), 1.0, nodes=mesh.nodes[:-1])


# Supports -----------------------------------------------------------------------------------

ALL = np.ones(3, dtype=bool)


def test_a_value_for_each_node_is_prescribed_there():
    value = np.arange(12.0).reshape(4, 3)
    fixed, found = prescribed_dofs([Support(np.array([5, 1, 2, 7]), ALL, value)], 9)
    assert fixed.sum() == 12
    np.testing.assert_array_equal(found[[5, 1, 2, 7]], value)


@settings(max_examples=25, derandomize=True, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 7)), min_size=1, max_size=20))
def test_one_support_a_node_is_the_same_as_one_for_all(picks):
    nodes = np.array([node for node, _ in picks])
    axes = np.array([[mask >> k & 1 for k in range(3)] for _, mask in picks], dtype=bool)
    value = np.random.default_rng(0).standard_normal((10, 3))
    supports = [Support(nodes[k : k + 1], axes[k], value[nodes[k]]) for k in range(len(nodes))]
    fixed, found = prescribed_dofs(supports, 10)
    expected = np.zeros((10, 3), dtype=bool)
    np.logical_or.at(expected, nodes, axes)
    np.testing.assert_array_equal(fixed, expected)
    np.testing.assert_array_equal(found, np.where(expected, value, 0))


def test_values_are_read_only_where_they_are_prescribed():
    only_x = np.array([True, False, False])
    fixed, value = prescribed_dofs(
        [Support(np.arange(2), only_x, np.array([1, np.nan, np.nan]))], 3
    )
    assert fixed.sum() == 2
    assert np.isfinite(value).all()


@pytest.mark.parametrize(
    ("supports", "message"),
    [
        ([Support.clamp(np.array([1, 9]))], "Support 1 names node 9, a node outside 0 to 8"),
        ([Support.clamp(np.array([-1]))], "node outside 0 to 8"),
        (
            [Support.clamp(np.array([0])), Support(np.array([3]), ALL, np.array([0, np.nan, 0]))],
            r"Support 2 prescribes a displacement that is not a number \(nan along y at node 3\)",
        ),
        (
            [Support.clamp(np.array([4])), Support.clamp(np.array([], int))],
            "Support 2 names no node, so it holds nothing",
        ),
        (
            [Support.clamp(np.array([4])), Support(np.array([4]), ALL, np.array([0.0, 0, 2]))],
            "Support 2 prescribes 2 mm along z at node 4, where another support prescribes 0 mm",
        ),
    ],
)
def test_impossible_supports_are_refused(supports, message):
    with pytest.raises(FeaError, match=message):
        prescribed_dofs(supports, 9)


@pytest.fixture
def unchecked(monkeypatch):
    """Users' programs run without the checks of annotations that these tests run with."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)


MASK = np.arange(9) < 2


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Support(MASK, ALL, np.zeros(3)),
            r"mask of shape \(9,\); .*np.flatnonzero\(mask\)",
        ),
        (
            lambda: Support(np.array([1.0]), ALL, np.zeros(3)),
            r"float64 of shape \(1,\); give integers",
        ),
        (
            lambda: Support(np.array([[1, 2, 3]]), ALL, np.zeros(3)),
            "in one row, as mesh.nodes_where",
        ),
        (lambda: Support([0], [0, 2], np.zeros(3)), "three truth values, for x, y and z"),
        (lambda: Support([0], [1, 1, 0], np.zeros(3)), "three truth values"),
        (lambda: Support([0], ALL, np.zeros(3, np.float32)), "of a support are float32, single"),
        (lambda: Support([0], ALL, [None, 1.0, 1.0]), "object, which is no real number"),
        (
            lambda: Support([0], ALL, np.zeros((2, 3))),
            r"shape \(2, 3\); give x, y, z once, or in 1 ",
        ),
        (lambda: Support([0], ALL, [[0, 0, 0], [0, 0]]), "rows of equal length"),
    ],
)
def test_supports_that_would_be_misread_are_refused(make, message, unchecked):
    with pytest.raises(FeaError, match=message):
        make()


def test_a_mask_beside_numbers_holds_what_it_says_once_it_is_made_numbers(unchecked):
    """Concatenated with numbers, a mask would clamp nodes 0 and 1, whatever it chooses."""
    mask = np.arange(9) > 6
    supports = [Support([3], ALL, [0, 0, 1]), Support(np.flatnonzero(mask), ALL, np.zeros(3))]
    fixed, value = prescribed_dofs(supports, 9)
    np.testing.assert_array_equal(np.flatnonzero(fixed.all(axis=1)), [3, 7, 8])
    assert value[3, 2] == 1.0
    assert value.dtype == np.float64


def test_unsigned_node_numbers_stay_integers(unchecked):
    supports = [Support(np.array([2], np.uint64), ALL, np.zeros(3)), Support.clamp(np.array([1]))]
    np.testing.assert_array_equal(prescribed_dofs(supports, 3)[0][:, 0], [False, True, True])


def test_no_supports_prescribe_nothing():
    fixed, value = prescribed_dofs([], 4)
    assert not fixed.any()
    assert not value.any()


# Loads against supports ---------------------------------------------------------------------


def test_the_share_of_a_load_on_fixed_dofs_is_told():
    fixed = np.zeros((4, 3), dtype=bool)
    fixed[0] = True
    forces = np.zeros((3, 4, 3))
    forces[0, 0, 0], forces[0, 1, 1] = 3.0, -1.0
    forces[1, 0] = 1.0
    np.testing.assert_allclose(load_on_supports(fixed, forces), [0.75, 1.0, 0.0])


def test_impossible_load_cases_are_refused():
    fixed = np.zeros((4, 3), dtype=bool)
    fixed[:2] = True
    forces = np.zeros((3, 4, 3))
    forces[:, 3, 1] = 1.0
    check_loads(fixed, forces)
    forces[2] = 0
    with pytest.raises(FeaError, match=r"Load case 2 \(from 0\) is zero, so there is nothing"):
        check_loads(fixed, forces)
    check_loads(fixed, forces, moved=True)
    forces[2, 0, 1], forces[2, 1, 1] = 0.5, 5.0
    with pytest.raises(FeaError, match=r"Load case 2 .* held, so nothing .* on node 1\);"):
        check_loads(fixed, forces)
    with pytest.raises(FeaError, match=r"on node 1 at \(3, 4, 5\) mm\);"):
        check_loads(fixed, forces, points=np.arange(12.0).reshape(4, 3))
    check_loads(fixed, forces, moved=True)
    forces[1, 3, 0] = np.nan
    with pytest.raises(FeaError, match=r"Load case 1 .* not a number, nan at node 3"):
        check_loads(fixed, forces)
    with pytest.raises(FeaError, match="single precision"):
        check_loads(fixed, np.zeros((1, 4, 3), np.float32))
    with pytest.raises(FeaError, match=r"give one of shape \(4, 3\)"):
        check_loads(fixed, np.zeros((1, 5, 3)))
    with pytest.raises(FeaError, match=r"give one of shape \(4, 3\)"):
        check_loads(fixed, np.zeros((4, 3)))


def test_forces_and_moments_of_a_frame_are_judged_apart():
    """N and N mm do not add up: a moment of 1e12 N mm is no reason to overlook a newton."""
    fixed = np.zeros((3, 6), dtype=bool)
    fixed[0] = True
    force, moment = np.zeros((2, 1, 3, 6))
    force[0, 2, 1], force[0, 0, 4] = 1.0, 1e12
    moment[0, 2, 5], moment[0, 0, 0] = 1.0, 1e12
    for loads in (force, moment):
        check_loads(fixed, loads)
        np.testing.assert_array_equal(load_on_supports(fixed, loads), 1.0)  # the larger share
    # Negative controls: what acts elsewhere taken away, in part (rounding) or whole.
    force[0, 2, 1] = moment[0, 2, 5] = 0.0
    force[0, 2, 4] = moment[0, 2, 0] = 1e-3
    for loads in (force, moment):
        with pytest.raises(FeaError, match="acts only where the structure is held"):
            check_loads(fixed, loads)
    force[0, 2, 4] = 3e12
    np.testing.assert_allclose(load_on_supports(fixed, force), 0.25)
