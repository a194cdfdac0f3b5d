"""Cells of several kinds side by side: one net, nothing dangles, and how it was joined is known."""

import functools
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.csgraph
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt.cells.catalogue import cell_names, unit_cell
from texmap_opt.errors import CellError
from texmap_opt.structure.layout import Layout
from texmap_opt.structure.map import mapped_joints
from texmap_opt.structure.mixed_net import mixed_net
from texmap_opt.structure.net import Net
from texmap_opt.structure.structure import TRANSITION
from texmap_opt.structure.tile import tile

cell = functools.cache(unit_cell)
# Read here: beartype draws random numbers when it checks, which hypothesis forbids its strategies.
DIMENSIONS = {name: cell(name).dimensions for name in cell_names()}
# Coordinates in cells are rounded to 1/720,720,000; joints that differ are much farther apart.
SAME = 1e-6


def degrees(net: Net) -> np.ndarray:
    return np.bincount(net.struts.ravel(), minlength=len(net.joints))


def pieces(net: Net) -> int:
    n = len(net.joints)
    graph = scipy.sparse.coo_array((np.ones(len(net.struts)), tuple(net.struts.T)), shape=(n, n))
    return int(scipy.sparse.csgraph.connected_components(graph, directed=False)[0])


def outside(net: Net) -> np.ndarray:
    """Joints on the outer surface of the block."""
    return ((net.joints < SAME) | (net.joints > np.array(net.shape) - SAME)).any(axis=1)


def places(net: Net, joints: np.ndarray) -> set[tuple[int, ...]]:
    return set(map(tuple, np.rint(net.joints[joints] / SAME).astype(int).tolist()))


def crossings(ends: np.ndarray, axis: int) -> int:
    """How many pairs of struts in the faces at 1 along an axis cross, touch within, or overlap."""
    ends = ends[(np.abs(ends[:, :, axis] - 1) < SAME).all(axis=1)]
    ends = np.delete(ends, axis, axis=2)
    first, second = np.triu_indices(len(ends), 1)
    (a, b), (c, d) = np.moveaxis(ends[first], 1, 0), np.moveaxis(ends[second], 1, 0)
    u, v, w = b - a, d - c, c - a

    def cross(p, q):
        return p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]

    det = cross(u, v)
    parallel = np.abs(det) < SAME
    shares = np.stack([cross(w, v), cross(w, u)]) / np.where(parallel, 1.0, det)
    within = ((shares > -SAME) & (shares < 1 + SAME)).all(axis=0)
    # Both at an end is a joint.
    at_ends = (np.minimum(np.abs(shares), np.abs(1 - shares)) < SAME).all(axis=0)
    length = (u**2).sum(axis=1)
    along = np.sort([(w * u).sum(axis=1) / length, ((w + v) * u).sum(axis=1) / length], axis=0)
    on_line = parallel & (np.abs(cross(u, w)) < SAME)
    over = on_line & (along[0] < 1 - SAME) & (along[1] > SAME)
    return int((~parallel & within & ~at_ends).sum() + over.sum())


@st.composite
def arrangements(draw) -> tuple[list[str], np.ndarray]:
    """Names of cells, and which of them is in which cell of a small grid."""
    dimensions = draw(st.sampled_from([3, 3, 2]))
    pool = [name for name, count in DIMENSIONS.items() if count == dimensions]
    names = draw(st.lists(st.sampled_from(pool), min_size=2, max_size=3, unique=True))
    shape = draw(st.tuples(*[st.integers(1, 3)] * dimensions))
    count = int(np.prod(shape))
    kinds = draw(st.lists(st.integers(0, len(names) - 1), min_size=count, max_size=count))
    return names, np.array(kinds).reshape(shape)


def laid_out(arrangement: tuple[list[str], np.ndarray]) -> Layout:
    names, kinds = arrangement
    return Layout(tuple(map(cell, names)), kinds)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(arrangements())
def test_any_layout_of_any_cells_is_one_net_without_loose_ends(arrangement):
    """Inside the block; on its surface a joint may have one strut, as it may in a block of one kind."""
    layout = laid_out(arrangement)
    net, _ = mixed_net(layout)
    degree = degrees(net)
    assert pieces(net) == 1
    assert degree[~outside(net)].min(initial=2) >= 2
    alone = [tile(one, layout.shape) for one in layout.cells]
    loose = set().union(*(places(block, degrees(block) == 1) for block in alone))
    if layout.cells[0].dimensions == 3:
        assert places(net, degree == 1) <= loose


@settings(max_examples=40, deadline=None, derandomize=True)
@given(arrangements())
def test_a_mixed_net_is_as_sound_as_a_tiled_one(arrangement):
    layout = laid_out(arrangement)
    net, _ = mixed_net(layout)
    assert len(places(net, np.arange(len(net.joints)))) == len(net.joints)
    assert (net.struts[:, 0] < net.struts[:, 1]).all()
    assert len(np.unique(net.struts, axis=0)) == len(net.struts)
    np.testing.assert_allclose(net.joint_cell + net.joint_local, net.joints, atol=1e-15)
    assert ((net.joint_local >= 0) & (net.joint_local <= 1)).all()
    np.testing.assert_allclose(net.sharing.sum(axis=1), 1, rtol=1e-14)
    # A strut lies in each of the cells that share it, and none of them is of a kind after its own.
    strut, number = net.sharing.nonzero()
    low = np.stack(np.unravel_index(number, layout.shape), axis=1)[:, None]
    ends = net.joints[net.struts[strut]]
    assert ((ends > low - SAME) & (ends < low + 1 + SAME)).all()
    own = layout.kinds.ravel()[number] == net.kind[strut]
    of_cell = net.kind < len(layout.cells)
    assert np.array_equal(np.unique(strut[own]), np.flatnonzero(of_cell))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.data())
def test_struts_between_two_kinds_meet_at_joints_only(data):
    """All struts in the faces between the kinds, edges of the grid included, for any two cells."""
    pool = [name for name, count in DIMENSIONS.items() if count == 3]
    names = data.draw(st.lists(st.sampled_from(pool), min_size=2, max_size=2, unique=True))
    axis = data.draw(st.integers(0, 2))
    kinds = np.zeros((2, 2, 2), np.int64)
    np.moveaxis(kinds, axis, 0)[1] = 1
    net, _ = mixed_net(Layout(tuple(map(cell, names)), kinds))
    assert crossings(net.joints[net.struts], axis) == 0


def test_crossings_are_seen():
    """Negative control of the test above: the faces of both kinds without what joins them."""
    octet, kelvin = (tile(cell(name), (1, 1, 1)) for name in ("octet", "kelvin"))
    upper = kelvin.joints + np.array([0.0, 0.0, 1.0])
    both = np.concatenate([octet.joints[octet.struts], upper[kelvin.struts]])
    assert crossings(both, 2) == 4


def halves(lower: str, upper: str, n: int = 2) -> Layout:
    kinds = np.zeros((n, n, 2), np.int64)
    kinds[:, :, 1] = 1
    return Layout((cell(lower), cell(upper)), kinds)


def test_octet_and_kelvin_cross():
    """In each face the four half diagonals of the octet cross the four sides of the square.

    They do so in the middles of the sides, whose corners are a quarter from the centre of the face.
    """
    net, (met,) = mixed_net(halves("octet", "kelvin"))
    assert met.kinds == ("octet", "tetrakaidecahedron")
    assert (met.method, met.faces) == ("crossed", 4)
    # Four half diagonals and four sides in each of four faces.
    assert (met.shared_joints, met.split_struts, met.transition_struts) == (0, 32, 0)
    assert TRANSITION not in {net.kinds[k] for k in net.kind}
    crossing = np.array([0.375, 0.375, 1.0])
    (joint,) = np.flatnonzero(np.linalg.norm(net.joints - crossing, axis=1) < SAME)
    assert degrees(net)[joint] == 4


def test_bcc_and_kelvin_are_tied_corner_by_corner():
    """No joint of the one is on a strut of the other.

    Each corner of a face is as near to two of the square's four: sqrt(1/4 + 1/16) of an edge.
    """
    net, (met,) = mixed_net(halves("bcc", "kelvin"))
    assert (met.method, met.transition_struts) == ("transition", 4 * 8)
    tied = net.kind == net.kinds.index(TRANSITION)
    ends = net.joints[net.struts[tied]]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    np.testing.assert_allclose(length, np.sqrt(5) / 4, rtol=1e-8)
    # Each is shared by the cell below and the cell above.
    assert (np.diff(net.sharing.indptr)[tied] == 2).all()


def test_diamond_and_octet_are_tied_along_edges_and_to_the_centre():
    """Diamond's joints are the middles of the edges: as near to two corners as to the centre.

    In 2 x 2 faces 12 edges have a middle with two halves each; the middle of an outer edge is tied
    to one centre, that of the four inner edges to two.
    """
    _, (met,) = mixed_net(halves("diamond", "octet"))
    assert (met.method, met.shared_joints, met.split_struts) == ("transition", 0, 0)
    assert met.transition_struts == 12 * 2 + 8 + 4 * 2


def test_coordinates_of_few_digits_are_those_of_the_other_kind():
    """An icosahedron typed with four digits beside one with twelve: the same joints, all shared."""
    typed = replace(
        cell("icosahedron"), name="typed", joints=np.round(cell("icosahedron").joints, 4)
    )
    kinds = np.zeros((2, 2, 2), np.int64)
    kinds[:, :, 1] = 1
    net, (interface,) = mixed_net(Layout((cell("icosahedron"), typed), kinds))
    assert (interface.method, interface.transition_struts, interface.split_struts) == (
        "shared",
        0,
        0,
    )
    alone = tile(cell("icosahedron"), (2, 2, 2))
    np.testing.assert_array_equal(net.struts, alone.struts)
    np.testing.assert_allclose(net.joints, alone.joints, atol=1e-8)


def test_cells_with_the_same_joints_in_their_faces_just_share_them():
    _, (met,) = mixed_net(halves("bcc", "cube"))
    assert (met.method, met.shared_joints) == ("shared", 9)
    # A strut that both have is there once: the cube's edges in the octet's faces add nothing.
    net, (met,) = mixed_net(halves("cube", "vector"))
    assert (met.method, met.shared_joints) == ("shared", 9)
    assert len(net.struts) == len(tile(cell("cube"), (2, 2, 2)).struts) + 4 * 8


def test_a_strut_on_an_edge_is_cut_where_a_third_kind_has_a_joint():
    """Cubes have a strut on the edge that diamond, two cells away across it, has a joint on."""
    kinds = np.array([[0, 1], [1, 2]])[:, :, None]
    cells = (cell("cube"), cell("octet"), cell("diamond"))
    net, _ = mixed_net(Layout(cells, kinds))
    middle = np.array([1.0, 1.0, 0.5])
    (joint,) = np.flatnonzero(np.linalg.norm(net.joints - middle, axis=1) < SAME)
    # Two halves of the cube's strut, and diamond's own.
    assert degrees(net)[joint] >= 3
    whole = (np.abs(net.joints[net.struts][:, :, :2] - 1) < SAME).all(axis=(1, 2))
    length = np.abs(np.diff(net.joints[net.struts][:, :, 2], axis=1))[whole, 0]
    np.testing.assert_allclose(length, 0.5, rtol=1e-8)


def test_the_thicker_radius_is_kept_where_two_kinds_share_a_strut():
    thick = cell("cube")
    thick = replace(thick, name="thick", relative_radius=1.5 * thick.relative_radius)
    net, _ = mixed_net(Layout((cell("cube"), thick), np.array([[[0, 1]]])))
    level = net.joints[net.struts][:, :, 2].mean(axis=1)
    np.testing.assert_array_equal(net.relative_radius[level < 1], 1.0)
    np.testing.assert_array_equal(net.relative_radius[level >= 1], 1.5)
    assert (net.kind[level == 1] == 0).all()


def test_crossing_joints_stay_on_both_faces_of_a_warped_grid():
    """A joint where struts cross is mapped in the face: the same from the cells on either side."""
    layout = halves("octet", "kelvin", n=1)
    net, _ = mixed_net(layout)
    rng = np.random.default_rng(3)
    ticks = [np.arange(n + 1.0) for n in layout.shape]
    nodes = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1)
    nodes = nodes + rng.uniform(-0.2, 0.2, nodes.shape)
    crossing = np.flatnonzero(
        (np.abs(np.abs(net.joints[:, :2] - 0.5) - 0.125) < SAME).all(axis=1)
        & (np.abs(net.joints[:, 2] - 1) < SAME)
    )
    assert len(crossing) == 4
    x, y = net.joints[crossing, 0], net.joints[crossing, 1]
    face = nodes[:, :, 1]
    bilinear = (
        ((1 - x) * (1 - y))[:, None] * face[0, 0]
        + (x * (1 - y))[:, None] * face[1, 0]
        + ((1 - x) * y)[:, None] * face[0, 1]
        + (x * y)[:, None] * face[1, 1]
    )
    np.testing.assert_allclose(mapped_joints(net, nodes)[crossing], bilinear, atol=1e-12)


@pytest.mark.parametrize(
    ("cells", "kinds", "words"),
    [
        (("octet", "octet"), (1, 1, 2), "several kinds"),
        (("octet", "honeycomb"), (1, 1, 2), "dimensions"),
        (("octet", "bcc"), (1, 2), "dimensions"),
    ],
)
def test_cells_that_do_not_go_together_are_refused(cells, kinds, words):
    with pytest.raises(CellError, match=words):
        Layout(tuple(map(cell, cells)), np.zeros(kinds, np.int64))


def test_sections_that_differ_are_refused():
    square = replace(cell("bcc"), section="square")
    with pytest.raises(CellError, match="section"):
        Layout((cell("octet"), square), np.zeros((1, 1, 1), np.int64))
