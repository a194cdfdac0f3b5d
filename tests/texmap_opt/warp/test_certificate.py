"""The certificate that a hexahedron does not fold."""

import numpy as np

from texmap_opt.warp.certificate import folded, grid_coefficients
from texmap_opt.warp.hex_grid import HexGrid

CUBE = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
HIDDEN_FOLD = np.array(
    [
        [[[0.3, -0.2, 0.6], [0.8, 0.5, 0.8]], [[0.4, 1.8, -0.4], [-0.6, 1.3, 0.5]]],
        [[[0.6, 0.0, -0.6], [0.7, -0.7, 0.6]], [[1.6, 0.8, -0.1], [1.3, 0.7, 1.7]]],
    ]
)


def one_cell(corners):
    """A cell from corners indexed [i, j, k]."""
    return HexGrid(corners, CUBE)


def cube():
    return HexGrid.uniform(CUBE, (1, 1, 1)).nodes


def test_the_uniform_grid_has_27_coefficients_of_one():
    coefficients = grid_coefficients(HexGrid.uniform(CUBE * [1, 2, 3], (3, 2, 4)))
    assert coefficients.shape == (24, 27)
    np.testing.assert_allclose(coefficients, 1, rtol=1e-12)


def test_a_cell_can_fold_although_all_corners_are_right_handed():
    """Knupp, "On the invertibility of the isoparametric map", CMAME 78 (1990) 313-329.

    Right-handed corners do not suffice: this cell (found by random search) has det J > 0 at all
    eight and -0.5 inside.
    """
    coefficients = grid_coefficients(one_cell(HIDDEN_FOLD))
    outer = coefficients.reshape(3, 3, 3)[::2, ::2, ::2]
    assert outer.min() > 0
    assert sampled_determinant(HIDDEN_FOLD, 9).min() < -0.5
    assert folded(coefficients)[0]


def test_an_inside_out_cell_is_folded():
    """Negative control: two opposite faces exchanged."""
    assert folded(grid_coefficients(one_cell(cube()[::-1])))[0]


def test_a_collapsed_cell_is_folded():
    flat = cube()
    flat[..., 2] = 0
    assert folded(grid_coefficients(one_cell(flat)))[0]


def test_a_negative_coefficient_with_a_positive_determinant_is_no_fold():
    """(2 u - 1)² + 1/5 is positive, and its middle Bezier coefficient is -4/5."""
    middle = np.array([6 / 5, -4 / 5, 6 / 5])
    coefficients = np.broadcast_to(middle[:, None, None], (3, 3, 3)).reshape(1, 27)
    assert not folded(coefficients)[0]
    # With 1/5 taken away twice it dips below zero, and nothing but subdivision can tell.
    assert folded(coefficients - 0.4)[0]


def test_the_mean_coefficient_is_the_volume_of_the_cell():
    """By the divergence theorem: a frustum with faces 2x2 and 1x1 and height 1 has volume 7/3."""
    frustum = cube()
    frustum[:, :, 0, :2] = 2 * frustum[:, :, 0, :2] - 0.5
    np.testing.assert_allclose(grid_coefficients(one_cell(frustum)).mean(), 7 / 3, rtol=1e-12)


def sampled_determinant(corners, n):
    """Det J on a lattice of points, from the trilinear map and its derivatives."""
    u = np.linspace(0, 1, n)
    shape, slope = np.stack([1 - u, u]), np.stack([-np.ones(n), np.ones(n)])
    columns = []
    for axis in range(3):
        a, b, c = (slope if d == axis else shape for d in range(3))
        columns.append(np.einsum("ix,jy,kz,ijkd->xyzd", a, b, c, corners))
    return np.linalg.det(np.stack(columns, axis=-1))
