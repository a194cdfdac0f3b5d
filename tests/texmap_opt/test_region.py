"""Regions: what they contain, and what a case file may write."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from texmap_opt.errors import CaseError
from texmap_opt.region import AbstractRegion, Box, Cylinder, Normal, Plane, Sphere
from texmap_opt.region_table import REGION_KEYS, region_from_table

WHERE = "case.toml: [[load]] 2 region"
POINTS = np.random.default_rng(0).uniform(-2, 2, (500, 3))

STL_TETRAHEDRON = """solid t
facet normal 0 0 0
outer loop
vertex 0 0 0
vertex 0 1 0
vertex 1 0 0
endloop
endfacet
facet normal 0 0 0
outer loop
vertex 0 0 0
vertex 1 0 0
vertex 0 0 1
endloop
endfacet
facet normal 0 0 0
outer loop
vertex 0 0 0
vertex 0 0 1
vertex 0 1 0
endloop
endfacet
facet normal 0 0 0
outer loop
vertex 1 0 0
vertex 0 1 0
vertex 0 0 1
endloop
endfacet
endsolid t
"""


def read(table, base=Path()) -> AbstractRegion:
    return region_from_table(table, WHERE, base)


def contains(region, points, normals=None, slack=0.0):
    points = np.atleast_2d(np.array(points, dtype=float))
    normals = None if normals is None else np.atleast_2d(np.array(normals, dtype=float))
    return region.contains(points, normals, slack=slack)


def test_a_box_takes_its_corners_in_any_order_and_includes_its_faces():
    region = read({"box": [[1, 0, 2], [0, 3, 0]]})
    assert contains(region, [[0, 0, 0], [1, 3, 2], [0.5, 1, 1]]).all()
    assert not contains(region, [[1.001, 0, 0], [-0.001, 0, 0]]).any()


def test_a_sphere_is_a_ball():
    region = read({"sphere": {"center": [1, 0, 0], "radius": 2}})
    assert list(contains(region, [[1, 0, 0], [3, 0, 0], [3.01, 0, 0]])) == [True, True, False]


def test_a_cylinder_ends_flat():
    region = read({"cylinder": {"from": [0, 0, 0], "to": [0, 0, 10], "radius": 1}})
    inside = [[0, 0, 0], [1, 0, 5], [0, 1, 10]]
    outside = [[0, 0, -0.01], [0, 0, 10.01], [0.8, 0.8, 5]]
    assert contains(region, inside).all() and not contains(region, outside).any()


def test_a_plane_is_near_on_both_sides():
    region = read({"plane": {"point": [0, 0, 1], "normal": [0, 0, 5], "tolerance": 0.1}})
    heights = contains(region, [[9, 9, 0.91], [0, 0, 1.09], [0, 0, 0.89], [0, 0, 1.11]])
    assert list(heights) == [True, True, False, False]


def test_a_normal_is_a_cone_of_directions():
    region = read({"normal": {"direction": [0, 0, -2], "angle_deg": 30}})
    tilt = np.radians([0, 29.9, 30, 30.1, 180])
    normals = np.stack([np.sin(tilt), 0 * tilt, -np.cos(tilt)], axis=1)
    inside = region.contains(np.zeros((5, 3)), normals, slack=0.0)
    assert list(inside) == [True, True, True, False, False]


def test_a_normal_may_be_written_as_its_direction_alone():
    region = read({"normal": [1, 0, 0]})
    assert isinstance(region, Normal) and region.angle_deg == 15


def test_a_normal_without_normals_is_a_mistake_of_the_caller():
    with pytest.raises(ValueError, match="normals"):
        contains(read({"normal": [1, 0, 0]}), [0, 0, 0])


def test_an_stl_region_is_its_inside_in_its_unit(tmp_path):
    (tmp_path / "grip.stl").write_text(STL_TETRAHEDRON)
    points = [[0.2, 0.2, 0.2], [2, 2, 2], [5, 5, 5]]
    assert list(contains(read({"stl": "grip.stl"}, tmp_path), points)) == [True, False, False]
    in_cm = read({"stl": {"file": "grip.stl", "unit": "cm"}}, tmp_path)
    assert list(contains(in_cm, points)) == [True, True, False]


def test_several_keys_must_all_hold():
    region = read({"box": [[0, 0, 0], [1, 1, 1]], "normal": [0, 0, 1]})
    points, normals = [[0.5, 0.5, 1], [0.5, 0.5, 1], [2, 2, 1]], [[0, 0, 1], [1, 0, 0], [0, 0, 1]]
    assert list(contains(region, points, normals)) == [True, False, False]
    assert " and " in region.describe()


def test_slack_widens_lengths_but_not_angles():
    assert contains(read({"box": [[0, 0, 0], [1, 1, 1]]}), [1.05, 0, 0], slack=0.1).all()
    normal = read({"normal": [0, 0, 1]})
    assert not contains(normal, [0, 0, 0], [1, 0, 0], slack=100.0).any()


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({}, "at least one of"),
        ({"spere": {}}, 'did you mean "sphere"'),
        ({"box": [[0, 0, 0]]}, "two corners"),
        ({"box": [[0, 0], [1, 1]]}, "three numbers"),
        ({"box": [[0, 0, 0], [1, 1, float("nan")]]}, "finite"),
        ({"box": [[0, 0, 0], [1, 1, "a"]]}, "finite number"),
        ({"sphere": {"center": [0, 0, 0]}}, "radius is missing"),
        ({"sphere": {"center": [0, 0, 0], "radius": 0}}, "above 0"),
        ({"sphere": {"centre": [0, 0, 0], "radius": 1}}, 'did you mean "center"'),
        ({"cylinder": {"from": [0, 0, 0], "to": [0, 0, 0], "radius": 1}}, "same point"),
        ({"plane": {"point": [0, 0, 0], "normal": [0, 0, 0]}}, "no direction"),
        ({"plane": {"point": [0, 0, 0], "normal": [0, 0, 1], "tolerance": -1}}, "at least 0"),
        ({"normal": {"direction": [0, 0, 1], "angle_deg": 181}}, "between 0 and 180"),
        ({"stl": "missing.stl"}, "no such file"),
        ({"stl": {"file": "missing.stl", "unit": "ft"}}, "not one of mm"),
        ({"stl": 3}, "must be a table"),
    ],
)
def test_a_wrong_region_is_one_sentence_that_says_where(table, words, tmp_path):
    with pytest.raises(CaseError, match=words) as caught:
        read(table, tmp_path)
    assert str(caught.value).startswith(WHERE)


def test_an_stl_region_without_inside_is_refused(tmp_path):
    turned = STL_TETRAHEDRON.replace("vertex 0 1 0\nvertex 1 0 0", "vertex 1 0 0\nvertex 0 1 0")
    open_stl = "solid t\n" + turned.split("endfacet\n")[0].split("solid t\n")[1] + "endfacet\n"
    (tmp_path / "flat.stl").write_text(open_stl + "endsolid t\n")
    with pytest.raises(CaseError, match="encloses no volume"):
        read({"stl": "flat.stl"}, tmp_path)


def test_every_key_is_documented_and_every_region_describes_itself(tmp_path):
    (tmp_path / "a.stl").write_text(STL_TETRAHEDRON)
    tables = {
        "box": [[0, 0, 0], [1, 1, 1]],
        "sphere": {"center": [0, 0, 0], "radius": 1},
        "cylinder": {"from": [0, 0, 0], "to": [1, 0, 0], "radius": 1},
        "plane": {"point": [0, 0, 0], "normal": [1, 0, 0]},
        "normal": [1, 0, 0],
        "stl": "a.stl",
    }
    assert tables.keys() == REGION_KEYS.keys()
    for key, value in tables.items():
        assert len(read({key: value}, tmp_path).describe()) > 10


vectors = st.tuples(*[st.floats(-50, 50)] * 3).map(np.array)


@settings(derandomize=True, max_examples=25, deadline=None)
@given(shift=vectors, radius=st.floats(0.1, 3))
def test_regions_move_with_their_points(shift, radius):
    axis = np.array([0.0, 0.0, 1.0])
    here = [
        Box(-np.ones(3), np.ones(3)),
        Sphere(np.zeros(3), radius),
        Cylinder(-axis, axis, radius),
        Plane(np.zeros(3), axis, radius),
    ]
    there = [
        Box(shift - 1, shift + 1),
        Sphere(shift, radius),
        Cylinder(shift - axis, shift + axis, radius),
        Plane(shift, axis, radius),
    ]
    for one, other in zip(here, there, strict=True):
        # Rounding of the shifted points: nothing within 1e-9 of a limit may tell.
        strict = one.contains(POINTS, None, slack=-1e-9)
        loose = one.contains(POINTS, None, slack=1e-9)
        moved = other.contains(POINTS + shift, None, slack=0.0)
        assert (strict <= moved).all() and (moved <= loose).all()


@settings(derandomize=True, max_examples=25, deadline=None)
@given(a=st.floats(0, 1), b=st.floats(0, 1), radius=st.floats(0.1, 2))
def test_more_slack_never_takes_a_point_away(a, b, radius):
    low, high = sorted((a, b))
    for region in (
        Box(-np.ones(3) * radius, np.ones(3)),
        Sphere(np.ones(3), radius),
        Cylinder(np.zeros(3), np.ones(3), radius),
        Plane(np.zeros(3), np.array([1.0, 0, 0]), radius),
    ):
        less = region.contains(POINTS, None, slack=low)
        more = region.contains(POINTS, None, slack=high)
        assert (less <= more).all()


SOLIDS = [
    Box(np.array([-1.0, -0.5, 0]), np.array([1.0, 0.7, 1.5])),
    Sphere(np.array([0.3, -0.2, 0.1]), 0.9),
    Cylinder(np.array([-0.5, 0, -1.0]), np.array([0.8, 0.4, 0.9]), 0.6),
    Plane(np.array([0.1, 0, 0]), np.array([0.6, 0.0, 0.8]), 0.3),
]


@pytest.mark.parametrize("region", SOLIDS, ids=lambda region: type(region).__name__)
def test_the_distance_is_that_to_the_nearest_point_of_the_boundary(region):
    """Against a cloud of points: outside to those in the region, inside to those out of it."""
    cloud = np.random.default_rng(1).uniform(-2.5, 2.5, (200_000, 3))
    inside = region.contains(cloud, None, slack=0.0)
    distance = region.distance(POINTS)
    np.testing.assert_array_equal(distance <= 0, region.contains(POINTS, None, slack=0.0))
    near = np.where(
        distance > 0,
        KDTree(cloud[inside]).query(POINTS)[0],
        -KDTree(cloud[~inside]).query(POINTS)[0],
    )
    # A point of the cloud is found a little beyond the boundary: the cloud has one in 0.086³ mm³.
    found = np.abs(near) - np.abs(distance)
    assert found.min() > -1e-12 and found.max() < 0.15


def test_the_distance_to_a_closed_surface_and_to_an_intersection(tmp_path):
    (tmp_path / "t.stl").write_text(STL_TETRAHEDRON)
    points = np.array([[0.1, 0.2, 0.2], [-1, 0.1, 0.1], [0, 0, 3]])
    distance = read({"stl": "t.stl"}, tmp_path).distance(points)
    np.testing.assert_allclose(distance, [-0.1, 1, 2], rtol=1e-6)
    both = read({"stl": "t.stl", "plane": {"point": [0, 0, 2], "normal": [0, 0, 1]}}, tmp_path)
    np.testing.assert_allclose(both.distance(points), [1.799, 1.899, 2], rtol=1e-6)


def test_a_region_of_the_surface_has_no_distance():
    with pytest.raises(CaseError, match=r"the surface facing .* has no inside; give a box"):
        Normal(np.array([0.0, 0, 1])).distance(POINTS)
