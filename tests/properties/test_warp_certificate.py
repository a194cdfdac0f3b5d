"""Invariants of the certificate over random hexahedra."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from texmap_opt.warp.certificate import folded, grid_coefficients
from texmap_opt.warp.hex_grid import HexGrid

CUBE = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
CORNERS = HexGrid.uniform(CUBE, (1, 1, 1)).nodes

moves = arrays(np.float64, (2, 2, 2, 3), elements=st.floats(-0.45, 0.45))
rotations = arrays(np.float64, (4,), elements=st.floats(-1, 1))


def coefficients(corners):
    return grid_coefficients(HexGrid(corners, CUBE))


def determinant(corners, n=7):
    """Det J on a lattice of points of the trilinear map."""
    u = np.linspace(0, 1, n)
    shape, slope = np.stack([1 - u, u]), np.stack([-np.ones(n), np.ones(n)])
    columns = []
    for axis in range(3):
        a, b, c = (slope if d == axis else shape for d in range(3))
        columns.append(np.einsum("ix,jy,kz,ijkd->xyzd", a, b, c, corners))
    return np.linalg.det(np.stack(columns, axis=-1))


@settings(max_examples=40, derandomize=True, deadline=None)
@given(moves)
def test_the_bezier_form_is_the_determinant(move):
    """Sum of coefficients times Bernstein polynomials, at points other than those it came from."""
    u = np.linspace(0, 1, 7)
    bernstein = np.stack([(1 - u) ** 2, 2 * u * (1 - u), u**2])
    B = coefficients(CORNERS + move).reshape(3, 3, 3)
    value = np.einsum("ijk,ix,jy,kz->xyz", B, bernstein, bernstein, bernstein)
    # Entries of J are below 2, so of det J below 50: twelve digits of that.
    np.testing.assert_allclose(value, determinant(CORNERS + move), atol=1e-12 * 50)


@settings(max_examples=60, derandomize=True, deadline=None)
@given(moves)
def test_certified_cells_have_a_positive_determinant_everywhere(move):
    B = coefficients(CORNERS + move)
    sampled = determinant(CORNERS + move)
    assert B.min() <= sampled.min() + 1e-12
    if not folded(B)[0]:
        assert sampled.min() > 0
    if sampled.min() < -1e-9:
        assert folded(B)[0]


@settings(max_examples=40, derandomize=True, deadline=None)
@given(moves, rotations, st.floats(0.1, 10))
def test_the_certificate_is_blind_to_rotation_and_scales_with_volume(move, q, scale):
    norm = np.linalg.norm(q)
    w, x, y, z = q / norm if norm > 1e-3 else np.array([1.0, 0, 0, 0])
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    corners = CORNERS + move
    turned = coefficients(scale * corners @ R.T)
    np.testing.assert_allclose(turned, scale**3 * coefficients(corners), atol=1e-10 * scale**3)
