"""Booleans keep volumes, and refuse what is no solid."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from texmap_opt.combine import boolean
from texmap_opt.errors import SolidError
from texmap_opt.solid.tri_mesh import TriMesh


def surface(mesh: trimesh.Trimesh) -> TriMesh:
    return TriMesh(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64))


BOX = surface(trimesh.creation.box((4, 3, 2)))
BALL = surface(trimesh.creation.icosphere(subdivisions=2, radius=1.7))

shift = st.floats(-2.0, 2.0)


@settings(max_examples=30, deadline=None)
@given(shift, shift, shift)
def test_union_and_intersection_share_the_volumes(x, y, z):
    """vol(A or B) + vol(A and B) = vol A + vol B, and A - B + (A and B) = A."""
    ball = TriMesh(BALL.vertices + np.array([x, y, z]), BALL.faces)
    common = boolean.intersection(BOX, ball).volume
    either = boolean.union([BOX, ball]).volume
    np.testing.assert_allclose(either + common, BOX.volume + ball.volume, rtol=1e-12)
    np.testing.assert_allclose(
        boolean.difference(BOX, ball).volume + common, BOX.volume, rtol=1e-12
    )
    np.testing.assert_allclose(boolean.overlap_volume([BOX, ball]), common, atol=1e-10)


def test_double_precision_survives():
    """1e-9 is far below float32 at 1000: a library that goes through float32 loses it."""
    far = TriMesh(BOX.vertices + 1000.0, BOX.faces)
    shifted = TriMesh(far.vertices + np.array([1e-9, 0, 0]), far.faces)
    joined = boolean.union([far, TriMesh(shifted.vertices + np.array([9.0, 0, 0]), far.faces)])
    assert joined.vertices[:, 0].max() == shifted.vertices[:, 0].max() + 9.0


def test_many_solids_are_united_in_groups():
    """A row of 400 overlapping boxes is one box, whatever the grouping."""
    row = [TriMesh(BOX.vertices + np.array([k, 0, 0.0]), BOX.faces) for k in range(400)]
    np.testing.assert_allclose(boolean.union(row).volume, (399 + 4) * 3 * 2, rtol=1e-12)


def test_a_plane_splits_a_solid_into_two_closed_ones():
    front, back = boolean.split_by_plane(BOX, np.array([0.0, 0, 2.0]), 1.0)  # z = 1/2
    np.testing.assert_allclose([front.volume, back.volume], [6, 18], rtol=1e-12)
    assert front.vertices[:, 2].min() == 0.5


def test_shells_of_a_hollow_ball():
    hollow = boolean.difference(BOX, TriMesh(BALL.vertices / 2, BALL.faces))
    volumes = sorted(shell.volume for shell in boolean.shells(hollow))
    np.testing.assert_allclose(volumes, [-BALL.volume / 8, BOX.volume])


def test_simplification_moves_nothing_farther_than_its_tolerance():
    fine = surface(trimesh.creation.box((4, 3, 2)).subdivide().subdivide())
    coarse = boolean.simplified(fine, 1e-6)
    assert len(coarse.faces) == 12
    np.testing.assert_allclose(coarse.volume, fine.volume, rtol=1e-12)


def test_an_open_surface_is_refused_with_the_reason():
    with pytest.raises(SolidError, match="two opposite triangles"):
        boolean.union([BOX, TriMesh(BALL.vertices, BALL.faces[1:])])
    assert "two opposite triangles" in boolean.fault(TriMesh(BALL.vertices, BALL.faces[1:]))
    assert boolean.fault(BALL) == ""
