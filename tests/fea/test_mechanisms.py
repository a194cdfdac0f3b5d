"""Which part of a solid its supports leave free, and how it can move."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fea import FeaError, SolidProblem, TetMesh, material
from fea.assembly import Pattern
from fea.mechanisms import Bodies, describe_mode, free_body


def block(low, size, cells=(2, 2, 2)):
    return TetMesh.box(size, cells, origin=low)


def joined(*meshes, merge=True):
    """Several meshes as one, nodes at the same place merged where asked."""
    nodes = np.concatenate([mesh.nodes for mesh in meshes])
    start = np.cumsum([0] + [len(mesh.nodes) for mesh in meshes[:-1]])
    tets = np.concatenate([mesh.tets + first for mesh, first in zip(meshes, start, strict=True)])
    if not merge:
        return TetMesh(nodes, tets)
    _, first, number = np.unique(
        np.round(nodes, 9) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    return TetMesh(nodes[first], number.ravel()[tets])


def held(mesh, where, axes=(0, 1, 2)):
    fixed = np.zeros(mesh.nodes.shape, dtype=bool)
    fixed[np.ix_(np.flatnonzero(where(*mesh.nodes.T)), axes)] = True
    return fixed


def test_one_solid_is_judged_by_its_rigid_motions():
    mesh = block((0.0, 0.0, 0.0), (10.0, 4.0, 6.0))
    assert free_body(mesh, held(mesh, lambda x, y, z: x == 0)) is None
    floor = held(mesh, lambda x, y, z: z == 0, axes=(2,))
    words = free_body(mesh, floor)
    assert words is not None
    assert words.startswith("the solid can slide along x and y and turn about an axis along z")
    nothing = np.zeros(mesh.nodes.shape, dtype=bool)
    assert free_body(mesh, nothing) == "the solid can slide and turn in every direction"


@pytest.mark.parametrize(
    ("away", "side"),
    [
        ((-20.0, 0.0, 0.0), "left"),
        ((20.0, 0.0, 0.0), "right"),
        ((0.0, -20.0, 0.0), "front"),
        ((0.0, 20.0, 0.0), "back"),
        ((0.0, 0.0, -20.0), "lower"),
        ((0.0, 0.0, 20.0), "upper"),
    ],
)
def test_a_separate_part_is_named_by_where_it_is(away, side):
    one = block((0.0, 0.0, 0.0), (10.0, 4.0, 6.0))
    mesh = joined(one, TetMesh(one.nodes + np.array(away), one.tets))
    fixed = np.zeros(mesh.nodes.shape, dtype=bool)
    fixed[(np.abs(mesh.nodes - one.nodes.mean(axis=0)) < 11).all(axis=1)] = True
    other = ~fixed.any(axis=1)
    fixed[other] = [False, True, True]
    words = free_body(mesh, fixed)
    assert words is not None
    x = mesh.nodes[other, 0]
    assert words.startswith(
        f"the {side} one of 2 separate parts (x {x.min():.4g} to {x.max():.4g}, "
    )
    assert "48 cells) can slide along x" in words
    fixed[other, 0] = True
    assert free_body(mesh, fixed) is None


def test_several_free_parts_are_counted_and_the_largest_described():
    parts = [block((20.0 * k, 0.0, 0.0), (10.0, 4.0, 6.0), (1 + k, 1, 1)) for k in range(3)]
    mesh = joined(*parts)
    words = free_body(mesh, held(mesh, lambda x, y, z: x == 0))
    assert words is not None
    assert words.startswith("2 of 3 separate parts can move; the largest of them, the right one")
    assert "18 cells), can slide and turn in every direction" in words
    assert "coincide" not in words


def test_parts_that_touch_without_sharing_nodes_are_said_to():
    """The usual slip: two meshes put together, nodes of the common face not merged."""
    mesh = joined(
        block((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
        block((1.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
        merge=False,
    )
    words = free_body(mesh, held(mesh, lambda x, y, z: x == 0))
    assert words is not None
    assert "9 of its nodes coincide with nodes of other parts: merge them" in words


@pytest.mark.parametrize("element", ["tet4", "tet10"])
def test_bodies_that_share_an_edge_are_hinged_about_it(element):
    """Two blocks with the edge x = 10, z = 6 in common, one clamped: the other is a door."""
    mesh = joined(
        block((0.0, 0.0, 0.0), (10.0, 4.0, 6.0)), block((10.0, 0.0, 6.0), (5.0, 4.0, 8.0))
    )
    mesh = mesh if element == "tet4" else mesh.to_tet10()
    assert Bodies.of_mesh(mesh).count == 2
    fixed = held(mesh, lambda x, y, z: x == 0)
    words = free_body(mesh, fixed)
    number = 3 if element == "tet4" else 5
    assert words == (
        "the right part (x 10 to 15, y 0 to 4, z 6 to 14 mm, 48 cells), which shares only "
        f"{number} nodes with the rest, can turn about an axis along y through (10, 2, 6)"
    )
    # One more support along the door's swing holds it; one along its hinge does not.
    top = np.flatnonzero((mesh.nodes == [15.0, 0.0, 14.0]).all(axis=1))
    along = fixed.copy()
    along[top, 1] = True
    assert free_body(mesh, along) == words
    fixed[top, 0] = True
    assert free_body(mesh, fixed) is None


def test_bodies_that_share_one_node_turn_about_it():
    mesh = joined(block((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), block((1.0, 1.0, 1.0), (1.0, 1.0, 1.0)))
    words = free_body(mesh, held(mesh, lambda x, y, z: x == 0))
    assert words is not None
    assert "shares only 1 node with the rest, can turn about every axis through (1, 1, 1)" in words


def test_the_outer_half_of_a_chain_moves_on_its_own_hinge():
    """Three blocks in a row by their edges; the last is held against swinging, the middle too."""
    blocks = [block((2.0 * k, 0.0, 2.0 * k), (2.0, 2.0, 2.0), (1, 1, 1)) for k in range(4)]
    mesh = joined(*blocks)
    fixed = held(mesh, lambda x, y, z: x == 0)
    # Four bodies, three hinges: three mechanisms.
    words = free_body(mesh, fixed)
    assert words is not None and "shares only" in words
    # The third held alone leaves the second between two hinges (held) and the fourth swinging.
    fixed |= held(mesh, lambda x, y, z: (x >= 4) & (x <= 6) & (z >= 4) & (z <= 6) & (y == 0))
    words = free_body(mesh, fixed)
    assert words is not None
    assert words.startswith("the right part (x 6 to 8, y 0 to 2, z 6 to 8 mm, 6 cells)")
    assert "turn about an axis along y through (6, 1, 6)" in words


def prism(*plan):
    """Three cells on a triangle in the plane z = 0, of height 1."""
    foot = np.array([[x, y, 0.0] for x, y in plan])
    nodes = np.concatenate([foot, foot + np.array([0.0, 0.0, 1.0])])
    tets = np.array([[0, 1, 2, 5], [0, 1, 5, 4], [0, 4, 5, 3]])
    mesh = TetMesh(nodes, tets)
    turned = mesh.volumes < 0
    return TetMesh(nodes, np.where(turned[:, None], tets[:, [0, 2, 1, 3]], tets))


def test_three_bodies_hinged_in_a_triangle_swing_as_one():
    """A triangle of three bars is rigid; one hinge on the ground lets it turn as a whole."""
    a, b, c, ground = (0.0, 0.0), (4.0, 0.0), (2.0, 3.0), (2.0, -1.0)
    mesh = joined(
        prism(a, b, ground),
        prism(b, c, (4.0, 3.0)),
        prism(c, a, (0.0, 3.0)),
        prism(ground, (0.0, -3.0), (4.0, -3.0)),
    )
    assert Bodies.of_mesh(mesh).count == 4
    words = free_body(mesh, held(mesh, lambda x, y, z: y < -2))
    assert words is not None
    assert "9 cells), which shares only 2 nodes with the rest" in words
    assert "turn about an axis along z through (2, -1, " in words
    assert free_body(mesh, held(mesh, lambda x, y, z: (y < -2) | ((x == 4) & (y == 3)))) is None


def test_a_face_with_other_diagonals_is_no_hinge():
    """Two blocks glued at nodes whose facets do not match are two bodies that move as one."""
    left, right = block((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), block((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    mirrored = right.tets[:, [0, 2, 1, 3]]
    mesh = joined(left, TetMesh((right.nodes * [1, -1, 1]) + [1.0, 1.0, 0.0], mirrored))
    assert Bodies.of_mesh(mesh).count == 2
    assert free_body(mesh, held(mesh, lambda x, y, z: x == 0)) is None


def singular(mesh, fixed):
    """Whether the stiffness without the fixed dofs has a null vector, by its eigenvalues."""
    problem = SolidProblem.from_supports(mesh, material("steel"), [], np.zeros(mesh.nodes.shape))
    K = problem.stiffness(Pattern.from_groups([mesh.tets], len(mesh.nodes))).toarray()
    free = np.flatnonzero(~fixed)
    values = np.linalg.eigvalsh(K[np.ix_(free, free)])
    return len(values) > 0 and bool(values[0] < 1e-10 * np.abs(K).max())


@settings(max_examples=40, derandomize=True, deadline=None)
@given(
    cells=st.sets(st.integers(0, 47), min_size=1, max_size=6),
    dofs=st.sets(st.integers(0, 100), min_size=0, max_size=40),
)
@pytest.mark.parametrize("element", ["tet4", "tet10"])
def test_a_body_is_free_exactly_where_the_stiffness_is_singular(element, cells, dofs):
    """Any few cells of a box, hinged as they happen to be, any dofs fixed."""
    box = block((0.0, 0.0, 0.0), (1.0, 1.1, 1.2))
    used, tets = np.unique(box.tets[sorted(cells)], return_inverse=True)
    mesh = TetMesh(box.nodes[used], tets.reshape(-1, 4))
    mesh = mesh if element == "tet4" else mesh.to_tet10()
    fixed = np.zeros(mesh.nodes.size, dtype=bool)
    fixed[[d for d in dofs if d < fixed.size]] = True
    fixed = fixed.reshape(-1, 3)
    assert (free_body(mesh, fixed) is not None) == singular(mesh, fixed)


@pytest.mark.parametrize("dense", [0, 10_000])
def test_many_bodies_in_rings_are_judged_by_the_stiffness_too(monkeypatch, dense):
    """Half the cells of a box: a hundred bodies that hold each other round in circles, or do not."""
    monkeypatch.setattr("fea.mechanisms.DENSE", dense)
    said = []
    for seed in (0, 5, 6):
        box = TetMesh.box((1.0, 1.0, 1.0), (4, 4, 4))
        kept = box.tets[np.random.default_rng(seed).random(len(box.tets)) < 0.5]
        used, tets = np.unique(kept, return_inverse=True)
        mesh = TetMesh(box.nodes[used], tets.reshape(-1, 4))
        # Both answers come up.
        fixed = held(mesh, lambda x, y, z, seed=seed: x < 0.1 + 0.1 * seed)
        assert Bodies.of_mesh(mesh).count > 8
        words = free_body(mesh, fixed)
        assert (words is not None) == singular(mesh, fixed)
        said.append(words or "held")
    assert "held" in said
    assert any("shares only" in words for words in said)


def test_many_bodies_are_judged_alike_by_their_sparse_system(monkeypatch):
    """The same mechanism by both ways: dense singular values, and shifted eigenvalues."""
    mesh = joined(*[block((k, 0.0, k), (1.0, 1.0, 1.0), (1, 1, 1)) for k in map(float, range(12))])
    fixed = held(mesh, lambda x, y, z: (y == 0) & (x <= 11) & (z <= 11))
    fixed |= held(mesh, lambda x, y, z: x == 0)
    dense = free_body(mesh, fixed)
    monkeypatch.setattr("fea.mechanisms.DENSE", 0)
    assert dense is not None and "turn about an axis along y through (11, 0.5, 11)" in dense
    assert free_body(mesh, fixed) == dense
    fixed |= held(mesh, lambda x, y, z: (x == 12) & (y == 0))
    assert free_body(mesh, fixed) is None


def test_a_large_box_and_a_soup_of_unmerged_cells_take_seconds():
    box = TetMesh.box((3.0, 2.0, 1.0), (24, 24, 24))
    soup = TetMesh(box.nodes[box.tets].reshape(-1, 3), np.arange(4 * len(box.tets)).reshape(-1, 4))
    start = time.perf_counter()
    assert free_body(box, held(box, lambda x, y, z: x == 0)) is None
    words = free_body(soup, held(soup, lambda x, y, z: x == 0))
    assert words is not None and "merge them" in words
    # 83,000 cells; measured 0.5 s.
    assert time.perf_counter() - start < 5


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        (lambda x: np.broadcast_to([0.0, 0.3, 0.0], x.shape), "slide along y"),
        (
            lambda x: np.cross([0.0, 0.0, 1.0], x - [2.0, 0.0, 0.0]),
            "turn about an axis along z through (2, 0, ",
        ),
    ],
)
def test_a_rigid_null_vector_is_described_with_where_it_is(motion, words):
    one = block((0.0, 0.0, 0.0), (2.0, 2.0, 2.0)).nodes
    points = np.concatenate([one, one + np.array([10.0, 0.0, 0.0])])
    mode = np.concatenate([motion(one), np.zeros_like(one)])
    mode += 1e-4 * np.random.default_rng(0).standard_normal(mode.shape)
    said = describe_mode(points, mode)
    assert said.endswith(words) or words in said
    assert "in the left part (x 0 to 2, y 0 to 2, z 0 to 2 mm)," in said
    assert " of 54 nodes" in said


def test_a_null_vector_that_is_no_rigid_motion_is_said_to_deform():
    points = block((0.0, 0.0, 0.0), (2.0, 2.0, 2.0)).nodes
    said = describe_mode(points, (points - 1) * [1.0, -1.0, 0.0])
    assert said.startswith("24 of 27 nodes")
    assert "deform without resistance, most at (" in said
    assert describe_mode(points, np.ones_like(points)) == (
        "all 27 nodes slide along (0.577, 0.577, 0.577)"
    )
    with pytest.raises(FeaError, match="largest displacement is 0"):
        describe_mode(points, np.zeros_like(points))
