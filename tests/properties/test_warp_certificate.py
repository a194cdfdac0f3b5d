"""Invariants of the certificate over random hexahedra and quadrilaterals."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from texmap_opt.box import Box
from texmap_opt.warp.certificate import folded, grid_coefficients
from texmap_opt.warp.grid import Grid

UNIT = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
BOXES = {2: Box.aligned(UNIT, extrusion="z"), 3: Box.aligned(UNIT)}
UNIT_CELLS = {d: Grid.uniform(box, (1,) * d).nodes for d, box in BOXES.items()}
FACTORS = {2: "ix,jy", 3: "ix,jy,kz"}


def cells(d):
    """Corners of a cell, each up to 0.45 from those of the unit cell in every component."""
    moves = arrays(np.float64, (*[2] * d, d), elements=st.floats(-0.45, 0.45))
    return moves.map(lambda move: UNIT_CELLS[d] + move)


either = st.sampled_from([2, 3]).flatmap(cells)


def coefficients(corners):
    return grid_coefficients(Grid(corners, BOXES[corners.shape[-1]]))


def determinant(corners, n=7):
    """Det J on a lattice of points of the multilinear map."""
    d = corners.shape[-1]
    u = np.linspace(0, 1, n)
    shape, slope = np.stack([1 - u, u]), np.stack([-np.ones(n), np.ones(n)])
    sums = f"{FACTORS[d]},{'ijk'[:d]}c->{'xyz'[:d]}c"
    columns = [
        np.einsum(sums, *(slope if k == axis else shape for k in range(d)), corners)
        for axis in range(d)
    ]
    return np.linalg.det(np.stack(columns, axis=-1))


@settings(max_examples=40, derandomize=True, deadline=None)
@given(either)
def test_the_bezier_form_is_the_determinant(corners):
    """Sum of coefficients times Bernstein polynomials, at points other than those it came from."""
    d = corners.shape[-1]
    u = np.linspace(0, 1, 7)
    bernstein = np.stack([(1 - u) ** 2, 2 * u * (1 - u), u**2])
    B = coefficients(corners).reshape(*[3] * d)
    value = np.einsum(f"{'ijk'[:d]},{FACTORS[d]}->{'xyz'[:d]}", B, *[bernstein] * d)
    # Entries of J are below 2, so of det J below 50: twelve digits of that.
    np.testing.assert_allclose(value, determinant(corners), atol=1e-12 * 50)


@settings(max_examples=60, derandomize=True, deadline=None)
@given(either)
def test_certified_cells_have_a_positive_determinant_everywhere(corners):
    B, sampled = coefficients(corners), determinant(corners)
    assert B.min() <= sampled.min() + 1e-12
    if not folded(B)[0]:
        assert sampled.min() > 0
    if sampled.min() < -1e-9:
        assert folded(B)[0]


@settings(max_examples=40, derandomize=True, deadline=None)
@given(either, st.tuples(*[st.floats(-3, 3)] * 3), st.floats(0.1, 10))
def test_the_certificate_is_blind_to_rotation_and_scales_with_volume(corners, turn, scale):
    d = corners.shape[-1]
    R = Rotation.from_rotvec(turn if d == 3 else (0.0, 0.0, turn[2])).as_matrix()[:d, :d]
    turned = coefficients(scale * corners @ R.T)
    np.testing.assert_allclose(turned, scale**d * coefficients(corners), atol=1e-10 * scale**d)
