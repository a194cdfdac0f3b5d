"""What trimming never does, whatever the struts: leave something outside, lose what is inside."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.part import Part
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.map import map_structure
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.strut_pieces import ON_SURFACE, strut_pieces
from texmap_opt.structure.tile import tile
from texmap_opt.structure.trim import trim

FEW = settings(max_examples=25, deadline=None, derandomize=True)
SEED = st.integers(0, 2**32 - 1)
SIZE = np.array([30.0, 20.0, 12.0])
SKIN = 0.4


def box() -> TriMesh:
    axes = [[0.0, s] for s in SIZE]
    vertices = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    quads = np.array(
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    )
    return TriMesh(vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))


def bumpy_ball(seed: int, around: int = 24, across: int = 12) -> TriMesh:
    """A ball of radius about 15 with dents; closed, star-shaped, curved both ways."""
    rng = np.random.default_rng(seed)
    phi = 2 * np.pi * np.arange(around) / around
    theta = np.pi * np.arange(1, across) / across
    t, p = np.meshgrid(theta, phi, indexing="ij")
    unit = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    poles = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    unit = np.concatenate([unit.reshape(-1, 3), poles])
    vertices = unit * (15 + rng.uniform(-2, 2, size=len(unit)))[:, None]
    i, j = np.meshgrid(np.arange(across - 2), np.arange(around), indexing="ij")
    a, b = (i * around + j).ravel(), (i * around + (j + 1) % around).ravel()
    ring, last = np.arange(around), (across - 2) * around
    top, bottom = len(unit) - 2, len(unit) - 1
    faces = [
        np.stack([a, a + around, b + around], axis=1),
        np.stack([a, b + around, b], axis=1),
        np.stack([np.full(around, top), ring, (ring + 1) % around], axis=1),
        np.stack([np.full(around, bottom), last + (ring + 1) % around, last + ring], axis=1),
    ]
    return TriMesh(vertices, np.concatenate(faces))


def random_struts(seed: int, n: int = 200) -> Structure:
    rng = np.random.default_rng(seed)
    joints = rng.uniform(-0.3, 1.3, size=(2 * n, 3)) * SIZE
    return Structure(
        joints,
        np.arange(2 * n).reshape(-1, 2),
        rng.uniform(0.1, 0.5, size=(n, 2)),
        np.zeros(2 * n, bool),
        np.ones(n),
    )


def octet(low, edge: float, cells: int) -> Structure:
    axes = [a + edge * np.arange(cells + 1) for a in low]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return map_structure(tile(unit_cell("octet"), tuple(n - 1 for n in grid.shape[:3])), grid, 0.3)


def rotation(seed: int) -> np.ndarray:
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return q * np.sign(np.linalg.det(q))


def length_in_box(s: Structure) -> float:
    """Liang and Barsky (1984): clip each segment's parameter against the three slabs."""
    start, end = np.moveaxis(s.joints[s.struts], 1, 0)
    with np.errstate(divide="ignore"):
        t = np.sort(np.stack([-start, SIZE - start]) / (end - start), axis=0)
    low, high = np.maximum(t[0].max(axis=1), 0), np.minimum(t[1].min(axis=1), 1)
    return float((np.maximum(high - low, 0) * s.lengths()).sum())


@FEW
@given(seed=SEED)
def test_length_inside_a_box_is_that_of_clipping(seed: int):
    s = random_struts(seed)
    pieces = strut_pieces(s, Part(box(), "box"))
    np.testing.assert_allclose(pieces.structure.lengths().sum(), length_in_box(s), rtol=1e-9)
    assert pieces.outside + len(pieces.structure.struts) == len(s.struts)


@FEW
@given(seed=SEED)
def test_no_joint_is_left_outside_and_every_cut_is_on_the_surface(seed: int):
    part = Part(bumpy_ball(seed), "ball")
    assert part.volume > 0
    slack = ON_SURFACE * part.diagonal
    trimmed = trim(octet((-20, -19, -18), 5.0, 8), part, skin_mm=SKIN)
    s = trimmed.structure
    s.validate()
    distance = part.closest(s.joints)[1]
    assert distance.max() <= slack
    assert np.abs(distance[s.cut]).max() <= slack
    # Nor does a strut leave the part between its joints.
    for share in (0.1, 0.5, 0.9):
        along = s.joints[s.struts[:, 0]] * (1 - share) + s.joints[s.struts[:, 1]] * share
        assert part.closest(along)[1].max() <= slack
    # The skin holds every piece, and every end.
    pieces = s.components()
    np.testing.assert_array_equal(np.unique(pieces[trimmed.in_skin]), np.unique(pieces))
    assert trimmed.in_skin[s.degrees() == 1].all()


@FEW
@given(seed=SEED)
def test_inside_and_outside_together_are_the_whole(seed: int):
    """The same struts against the part and against its inverse: the pieces add up.

    What lies within `ON_SURFACE` of the surface is inside both: some 0.01 mm in 46 m.
    """
    surface = bumpy_ball(seed)
    far = 100 * (box().vertices / SIZE - 0.5)
    shell = TriMesh(
        np.concatenate([surface.vertices, far]),
        np.concatenate([surface.faces[:, ::-1], box().faces + len(surface.vertices)]),
    )
    s = octet((-20.1, -19.3, -18.7), 5.0, 8)
    inside = strut_pieces(s, Part(surface, "ball")).structure.lengths().sum()
    outside = strut_pieces(s, Part(shell, "mould")).structure.lengths().sum()
    np.testing.assert_allclose(inside + outside, s.lengths().sum(), rtol=1e-6)


@FEW
@given(seed=SEED)
def test_trimming_commutes_with_rigid_motion(seed: int):
    surface, whole = bumpy_ball(seed), octet((-20.3, -19.1, -18.2), 5.0, 8)
    turn, shift = rotation(seed), np.array([50.0, -20.0, 7.0])
    here = trim(whole, Part(surface, "here"), skin_mm=SKIN)
    there = trim(
        Structure(
            whole.joints @ turn.T + shift,
            whole.struts,
            whole.radii,
            whole.cut,
            whole.cell_size,
        ),
        Part(TriMesh(surface.vertices @ turn.T + shift, surface.faces), "there"),
        skin_mm=SKIN,
    )
    assert here.counts.struts == there.counts.struts
    np.testing.assert_array_equal(here.structure.struts, there.structure.struts)
    np.testing.assert_allclose(
        here.structure.joints @ turn.T + shift, there.structure.joints, atol=1e-8
    )


@FEW
@given(seed=SEED)
def test_trimming_twice_is_trimming_once(seed: int):
    """What is left lies inside, holds on, and is in one piece."""
    part = Part(bumpy_ball(seed), "ball")
    once = trim(octet((-20.3, -19.1, -18.2), 5.0, 8), part, skin_mm=0.0)
    twice = trim(once.structure, part, skin_mm=0.0)
    np.testing.assert_array_equal(once.structure.struts, twice.structure.struts)
    np.testing.assert_allclose(once.structure.joints, twice.structure.joints, atol=1e-12)
