import jax.numpy as jnp
import numpy as np
import pytest

from fea.elements import TET4, TET10, TRI3, TRI6, barycentric, physical_gradients
from fea.quadrature import (
    TETRAHEDRON_1,
    TETRAHEDRON_2,
    TETRAHEDRON_5,
    TRIANGLE_2,
    TRIANGLE_4,
)

ELEMENTS = [TET4, TET10, TRI3, TRI6]
RULES = [TRIANGLE_2, TRIANGLE_4, TETRAHEDRON_1, TETRAHEDRON_2, TETRAHEDRON_5]


def factorials(n):
    return np.cumprod([1, *range(1, n + 1)])[-1]


@pytest.mark.parametrize("rule", RULES, ids=lambda r: f"{r.points.shape[1]}d-degree{r.degree}")
def test_quadrature_integrates_monomials_up_to_its_degree_and_no_further(rule):
    """The integral of x^a y^b z^c over the unit simplex is a! b! c! / (a + b + c + d)!."""
    dim = rule.points.shape[1]
    worst = np.zeros(rule.degree + 2)
    for powers in np.ndindex(*[rule.degree + 2] * dim):
        total = sum(powers)
        if total > rule.degree + 1:
            continue
        exact = np.prod([factorials(p) for p in powers]) / factorials(total + dim)
        value = rule.weights @ np.prod(rule.points**powers, axis=1)
        worst[total] = max(worst[total], abs(value - exact))
    assert worst[:-1].max() < 1e-15
    assert worst[-1] > 1e-6
    assert (rule.weights > 0).all()


@pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: e.name)
def test_shape_functions_are_one_at_their_node_and_zero_at_others(element):
    np.testing.assert_allclose(
        element.shape(element.nodes), np.eye(len(element.nodes)), rtol=0, atol=1e-15
    )


@pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: e.name)
def test_shape_functions_sum_to_one_and_reproduce_position(element):
    points = np.random.default_rng(0).dirichlet(np.ones(4), 20)[:, : element.nodes.shape[1]]
    N = element.shape(points)
    np.testing.assert_allclose(N.sum(axis=1), 1, rtol=1e-14)
    np.testing.assert_allclose(N @ element.nodes, points, atol=1e-15)


@pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: e.name)
def test_gradients_are_the_derivatives_of_the_shape_functions(element):
    dim = element.nodes.shape[1]
    points = np.random.default_rng(1).dirichlet(np.ones(dim + 1), 5)[:, 1:]
    step = 1e-6
    for axis in range(dim):
        d = step * np.eye(dim)[axis]
        # Central differences of a quadratic are exact up to rounding / step = 1e-10.
        slope = (element.shape(points + d) - element.shape(points - d)) / (2 * step)
        np.testing.assert_allclose(element.gradient(points)[:, :, axis], slope, atol=1e-8)


def test_physical_gradients_of_position_are_the_identity():
    rng = np.random.default_rng(2)
    A = np.eye(3) + 0.3 * rng.uniform(-1, 1, (4, 3, 3))
    x = np.einsum("cij,nj->cni", A, TET10.nodes)
    gradients, det = physical_gradients(jnp.asarray(x), TET10.gradient_at_quadrature)
    identity = np.einsum("cni,cqnj->cqij", x, gradients)
    np.testing.assert_allclose(
        identity, np.broadcast_to(np.eye(3), identity.shape), rtol=0, atol=1e-13
    )
    np.testing.assert_allclose(det, np.repeat(np.linalg.det(A)[:, None], 4, axis=1), rtol=1e-13)


def test_extrapolation_carries_a_linear_field_from_quadrature_points_to_nodes():
    slope = np.array([1.0, -2.0, 3.0])
    at_points = TET10.quadrature.points @ slope
    np.testing.assert_allclose(TET10.extrapolation @ at_points, TET10.nodes @ slope, atol=1e-14)
    np.testing.assert_array_equal(TET4.extrapolation, np.ones((4, 1)))
    assert barycentric(TET4.nodes).trace() == 4
