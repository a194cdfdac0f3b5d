"""Which stiffness belongs to a thin surface, for which "auto" takes a direct solver at any size."""

import numpy as np
import pytest

from fea import FrameProblem, Round
from fea.linear_solve import thin_structures
from fea.linear_solve.thin_structures import is_thin, is_thin_surface, widest_front
from fea.skin import Skin
from fea.system import Assembled

SQUARES = 12


def plate(thinness: float) -> FrameProblem:
    """A plate of two triangles a square, its edges fixed nowhere, so that no node leaves K."""
    i, j = np.meshgrid(np.arange(SQUARES + 1), np.arange(SQUARES + 1), indexing="ij")
    number = i * (SQUARES + 1) + j
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    corners = [np.stack(three, axis=-1).reshape(-1, 3) for three in ((a, b, c), (a, c, d))]
    triangles = np.concatenate(corners)
    x = np.column_stack([i.ravel(), j.ravel(), np.zeros(i.size)]).astype(float)
    skin = Skin(triangles, np.full(len(triangles), thinness), 70e3, 0.3)
    none = np.zeros((0, 2))
    return frame_of(x, none.astype(np.int64), skin)


def grid(cells: int) -> FrameProblem:
    """Cubes of struts."""
    number = np.arange((cells + 1) ** 3).reshape((cells + 1,) * 3)
    struts = [
        np.stack([np.moveaxis(number, k, 0)[:-1].ravel(), np.moveaxis(number, k, 0)[1:].ravel()], 1)
        for k in range(3)
    ]
    x = np.argwhere(number >= 0).astype(float)
    return frame_of(x, np.concatenate(struts), None)


def frame_of(x: np.ndarray, struts: np.ndarray, skin: Skin | None) -> FrameProblem:
    free = np.zeros((len(x), 6), dtype=bool)
    radii = np.full(struts.shape, 0.05)
    zero = np.zeros((len(x), 6))
    return FrameProblem(x, struts, radii, 70e3, 0.3, Round(), free, zero, zero[None], skin=skin)


def stiffness(frame: FrameProblem):
    return Assembled.of(frame).stiffness(frame)[1]


@pytest.mark.parametrize(("thinness", "thin"), [(0.05, True), (1.0, False)])
def test_a_plate_is_thin_when_its_thickness_is_a_small_part_of_its_edges(thinness, thin):
    assert is_thin(stiffness(plate(thinness))) == thin


def test_a_grid_of_struts_is_not_thin():
    assert not is_thin(stiffness(grid(4)))


def test_the_widest_front_of_a_cube_grows_with_its_section_and_that_of_a_plate_with_its_edge():
    """From a corner, steps i + j + k: three quarters of a section of (n + 1)² at n = 4, 19 nodes.

    A plate's triangles have diagonals, so that steps are max(i, j) at least and i + j at most.
    """
    assert widest_front(stiffness(grid(4))) == 19
    assert SQUARES <= widest_front(stiffness(plate(0.05))) <= 2 * SQUARES + 1


def test_a_thin_plate_with_wide_fronts_is_left_to_multigrid(monkeypatch):
    K = stiffness(plate(0.05))
    assert is_thin_surface(K)
    monkeypatch.setattr(thin_structures, "FRONT_LIMIT", 6 * SQUARES - 1)
    assert not is_thin_surface(K)
