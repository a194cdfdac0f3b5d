"""Segments against a triangle surface: every crossing, also through edges and corners."""

import numpy as np
import pytest

from texmap_opt.part import Part
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.segment_cuts import crossings


def box(low=(0, 0, 0), high=(1, 1, 1)) -> TriMesh:
    """Twelve facets; vertex 4 i + 2 j + k is the corner (i, j, k)."""
    vertices = np.array(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), float)
    quads = np.array(
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    )
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return TriMesh(vertices.reshape(3, -1).T.copy(), faces)


def torus(around: int = 40, across: int = 16) -> TriMesh:
    """Radii 10 and 4: a line meets it up to four times."""
    u, v = np.meshgrid(
        2 * np.pi * np.arange(around) / around,
        2 * np.pi * np.arange(across) / across,
        indexing="ij",
    )
    rho = 10 + 4 * np.cos(v)
    vertices = np.stack([rho * np.cos(u), rho * np.sin(u), 4 * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b, c, d = (
        ((i + di) % around * across + (j + dj) % across).ravel()
        for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1))
    )
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return TriMesh(vertices, faces)


def positions(surface: TriMesh, start, end) -> np.ndarray:
    found = crossings(surface, np.atleast_2d(np.array(start, float)), np.atleast_2d(end))
    return np.unique(np.round(found.position, 9))


def test_the_solids_of_these_tests_are_what_they_seem():
    """The torus of 640 quads is smaller than the round one, 2 pi^2 R r^2, by 3 %."""
    assert box().volume == pytest.approx(1)
    assert torus().volume == pytest.approx(2 * np.pi**2 * 10 * 16, rel=0.04)


@pytest.mark.parametrize(
    ("start", "end", "expected"),
    [
        ([-1.0, 0.3, 0.4], [0.5, 0.3, 0.4], [2 / 3]),
        ([-1.0, 0.3, 0.4], [3.0, 0.3, 0.4], [0.25, 0.5]),
        ([-1.0, -1.0, -1.0], [2.0, 2.0, 2.0], [1 / 3, 2 / 3]),  # two corners
        ([-1.0, -1.0, 0.5], [2.0, 2.0, 0.5], [1 / 3, 2 / 3]),  # two edges
        ([-1.0, 0.5, 0.5], [2.0, 0.5, 0.5], [1 / 3, 2 / 3]),  # diagonals that halve the faces
        ([-1.0, 0.5, 0.0], [2.0, 0.5, 0.0], [1 / 3, 2 / 3]),  # within the face z = 0
        ([0.2, 0.2, 0.2], [0.8, 0.7, 0.6], []),
        ([2.0, 2.0, 2.0], [3.0, 2.0, 2.0], []),
    ],
)
def test_a_box_is_crossed_where_arithmetic_says(start, end, expected):
    np.testing.assert_allclose(positions(box(), start, np.array(end)), expected, atol=1e-8)


def test_crossings_agree_with_trying_every_pair():
    surface = torus()
    rng = np.random.default_rng(1)
    low, high = surface.bounds
    start, end = rng.uniform(low - 5, high + 5, size=(2, 300, 3))
    found = crossings(surface, start, end)
    a, b, c = np.moveaxis(surface.vertices[surface.faces], 1, 0)
    count = np.zeros(len(start), int)
    for i in range(len(start)):
        # Signed volumes: the ends on either side of the plane, the line on one side of all edges.
        def volume(p, q, r, s):
            return np.einsum("ij,ij->i", np.cross(q - p, r - p), s - p)

        s, e = (np.broadcast_to(x[i], a.shape) for x in (start, end))
        through = volume(a, b, c, s) * volume(a, b, c, e) < 0
        turns = np.stack([volume(s, e, a, b), volume(s, e, b, c), volume(s, e, c, a)])
        count[i] = np.sum(through & ((turns > 0).all(axis=0) | (turns < 0).all(axis=0)))
    np.testing.assert_array_equal(np.bincount(found.segment, minlength=len(start)), count)
    assert count.max() >= 4


def test_an_odd_number_of_crossings_joins_inside_and_outside():
    rng = np.random.default_rng(2)
    low, high = torus().bounds
    start, end = rng.uniform(low - 1, high + 1, size=(2, 2000, 3))
    odd = np.bincount(crossings(torus(), start, end).segment, minlength=2000) % 2 == 1
    part = Part(torus(), "torus")
    np.testing.assert_array_equal(odd, part.contains(start) != part.contains(end))


def test_no_segments_cross_nothing():
    found = crossings(box(), np.zeros((0, 3)), np.zeros((0, 3)))
    assert len(found.segment) == len(found.position) == len(found.face) == 0


def test_a_facet_without_area_is_no_obstacle():
    surface = box()
    faces = np.concatenate([surface.faces, [[0, 0, 1], [3, 3, 3]]])
    found = crossings(
        TriMesh(surface.vertices, faces), np.array([[-1.0, 0.3, 0.4]]), np.array([[0.5, 0.3, 0.4]])
    )
    assert len(found.segment) == 1
