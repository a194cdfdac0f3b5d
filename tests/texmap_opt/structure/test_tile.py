"""Cells side by side: what neighbours share is there once, whatever the tiling rule."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.unit_cell import TICKS, UnitCell
from texmap_opt.structure.tile import tile

TETRAHEDRON = UnitCell(
    name="tetrahedron",
    joint_names=("a", "b", "c", "d"),
    joints=np.array([[0, 0, 0], [1, 1, 0], [1, 0, 1], [0, 1, 1]], float),
    struts=np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]),
    relative_radius=np.ones(6),
    section="round",
    mirrored=(True, True, True),
    proportions=(1.0, 1.0, 1.0),
    classification="stretching",
    symmetry="cubic",
    source="",
    description="",
)


def test_mirrored_tetrahedra_share_face_diagonals():
    """Six diagonals per cell, each shared by two cells within the block: 3 n^2 (n+1) in all.

    Joints are every other point of the cubic grid: 14 of 27 for n = 2.
    """
    net = tile(TETRAHEDRON, (2, 2, 2))
    assert (len(net.joints), len(net.struts)) == (14, 36)


def test_translated_tetrahedra_share_no_diagonal():
    """In the shared face neighbours have the crossing diagonals: 6 n^3 of them, none shared."""
    net = tile(replace(TETRAHEDRON, mirrored=(False, False, False)), (2, 2, 2))
    assert len(net.struts) == 6 * 8


def test_thirds_meet_their_mirror_images_exactly():
    """1 - 1/3 and 2/3 differ in floating point, not in steps."""
    ticks = replace(TETRAHEDRON, joints=np.full((4, 3), 1 / 3)).ticks
    twice = replace(TETRAHEDRON, joints=np.full((4, 3), 2 / 3)).ticks
    np.testing.assert_array_equal(TICKS - ticks, twice)


@settings(max_examples=20, deadline=None, derandomize=True)
@given(shape=st.tuples(*[st.integers(1, 4)] * 3), name=st.sampled_from(["octet", "cube", "vector"]))
def test_a_net_knows_where_everything_came_from(shape, name):
    net = tile(unit_cell(name), shape)
    np.testing.assert_allclose(net.joint_cell + net.joint_local, net.joints, atol=1e-15)
    assert (net.joint_cell < np.array(shape)).all()
    np.testing.assert_allclose(net.sharing.sum(axis=1), 1, rtol=1e-14)
    # A strut lies in every cell that shares it: its middle is within that cell, faces included.
    middle = net.joints[net.struts].mean(axis=1)
    strut, cell = net.sharing.nonzero()
    low = np.stack(np.unravel_index(cell, shape), axis=1)
    assert ((middle[strut] >= low) & (middle[strut] <= low + 1)).all()


def test_a_strut_inside_a_large_block_of_cubes_is_shared_by_four_cells():
    net = tile(unit_cell("cube"), (4, 4, 4))
    sharers = np.diff(net.sharing.indptr)
    assert sharers.min() == 1
    assert sharers.max() == 4
    assert sharers.sum() == 12 * 4**3


def test_cells_mirrored_along_one_axis_alternate_along_that_axis_only():
    """A square with one diagonal: mirrored along x, diagonals meet in zigzags that y repeats."""
    diagonal = replace(
        TETRAHEDRON,
        joints=np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]]),
        struts=np.array([[0, 1], [0, 2], [1, 3], [2, 3], [0, 3]]),
        relative_radius=np.ones(5),
        section="wall",
        mirrored=(True, False),
        proportions=(1.0, 1.0),
    )
    net = tile(diagonal, (2, 2))
    step = np.diff(net.joints[net.struts], axis=1)[:, 0]
    slope = step[:, 0] * step[:, 1]
    middle = net.joints[net.struts].mean(axis=1)
    np.testing.assert_array_equal(slope[(middle[:, 0] == 0.5) & (middle[:, 1] % 1 == 0.5)], 1)
    np.testing.assert_array_equal(slope[(middle[:, 0] == 1.5) & (middle[:, 1] % 1 == 0.5)], -1)
    assert (len(net.joints), len(net.struts)) == (9, 16)


@settings(max_examples=20, deadline=None, derandomize=True)
@given(shape=st.tuples(*[st.integers(1, 4)] * 3), name=st.sampled_from(["octet", "cube", "vector"]))
def test_the_cell_of_a_strut_is_the_first_that_holds_it(shape, name):
    net = tile(unit_cell(name), shape)
    first = np.full(len(net.struts), np.prod(shape))
    strut, cell = net.sharing.nonzero()
    np.minimum.at(first, strut, cell)
    np.testing.assert_array_equal(net.cell, first)
