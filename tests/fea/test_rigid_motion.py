import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fea import SolidProblem, TetMesh, free_motion, rigid_body_modes
from fea.assembly import Pattern
from fea.materials import material
from fea.rigid_motion import motion_in_words

POINTS = np.array(
    [[x, y, z] for x in (0.0, 10.0) for y in (0.0, 4.0) for z in (0.0, 6.0)] + [[5.0, 1.0, 2.0]]
)


def fixed(*entries, dofs=3):
    """Fixed dofs from (point, axes) pairs."""
    mask = np.zeros((len(POINTS), dofs), dtype=bool)
    for point, axes in entries:
        mask[point, list(axes)] = True
    return mask


@pytest.mark.parametrize(
    ("held", "words"),
    [
        (fixed(), "slides and turns in every direction"),
        (fixed((slice(None), (0,))), "slides along y and z and turns about an axis along x"),
        (fixed((slice(None), (0, 1))), "slides along z"),
        (fixed((0, (0, 1, 2))), "turns about every axis through (0, 0, 0)"),
        (
            fixed((0, (0, 1, 2)), (1, (0, 1, 2))),
            "turns about an axis along z through (0, 0, ",
        ),
        (
            fixed((2, (0, 1, 2)), (6, (0, 1, 2))),
            "turns about an axis along x through (",
        ),
        (fixed((0, (0, 1, 2)), (1, (0, 1)), (2, (0,)), (4, (1,))), None),
    ],
)
def test_motion_left_by_supports_is_named(held, words):
    found = free_motion(POINTS, held)
    if words is None:
        assert found is None
    else:
        assert found is not None and found.startswith(words)


def test_three_points_of_a_statically_determinate_support_hold_everything():
    """3-2-1 location of fixtures."""
    assert free_motion(POINTS, fixed((0, (0, 1, 2)), (4, (1, 2)), (2, (2,)))) is None
    assert free_motion(POINTS, fixed((0, (0, 1, 2)), (4, (1, 2)))) is not None


def test_an_oblique_hinge_is_named_by_its_direction():
    R = Rotation.from_rotvec([0.3, 0.5, -0.2]).as_matrix()
    points = POINTS @ R.T
    motion = free_motion(points, fixed((0, (0, 1, 2)), (1, (0, 1, 2))))
    assert motion is not None and motion.startswith("turns about an axis along (")


def test_a_clamped_joint_of_a_frame_holds_everything_and_a_ball_joint_does_not():
    assert free_motion(POINTS, fixed((3, range(6)), dofs=6)) is None
    motion = free_motion(POINTS, fixed((3, range(3)), dofs=6))
    assert motion == "turns about every axis through (0, 4, 6)"


def test_position_and_size_do_not_change_what_is_free():
    held = fixed((0, (0, 1, 2)), (1, (0, 1, 2)))
    for scale, shift in [(1e-3, 0.0), (1e3, 0.0), (1.0, 1e4)]:
        motion = free_motion(scale * POINTS + shift, held)
        assert motion is not None and motion.startswith("turns about an axis along z")


@pytest.mark.parametrize(("offset", "free"), [(1e-5, False), (1e-12, True)])
@pytest.mark.parametrize("number", [3, 3000])
def test_supports_nearly_in_line_hold_when_they_are_meant_to(offset, free, number):
    """Nodes on the edge along x, one of them off it by a share of the extent."""
    line = np.zeros((number, 3))
    line[:, 0] = np.linspace(0, 10, number)
    line[1, 2] = offset * 10
    points = np.concatenate([POINTS, line])
    held = np.zeros(points.shape, dtype=bool)
    held[len(POINTS) :] = True
    motion = free_motion(points, held)
    if free:
        assert motion is not None
        assert motion.startswith("turns about an axis along x through (")
    else:
        assert motion is None


def test_motion_can_follow_a_verb():
    held = fixed((slice(None), (0,)))
    assert free_motion(POINTS, held, base_form=True) == (
        "slide along y and z and turn about an axis along x through (5, 1.8889, 2.8889)"
    )


def test_a_motion_found_with_rounding_is_named_within_its_tolerance():
    motion = np.array([[1.0, 1e-3, 0.0, 2e-4, 0.0, 0.0]]).T
    where = {"centre": np.zeros(3), "extent": 5.0}
    assert motion_in_words(motion, **where, tolerance=0.02) == "slides along x"
    assert motion_in_words(motion, **where).startswith("screws about an axis")


def test_rigid_body_modes_have_no_elastic_energy():
    mesh = TetMesh.box((3.0, 2.0, 1.0), (1, 1, 1)).to_tet10()
    problem = SolidProblem.from_supports(
        mesh, material("steel"), [], np.zeros((1, *mesh.nodes.shape))
    )
    K = problem.stiffness(Pattern.from_groups([mesh.tets], len(mesh.nodes)))
    # Rounding of K, whose entries are about 1e5.
    np.testing.assert_allclose(
        K @ rigid_body_modes(mesh.nodes), 0, atol=1e-9 * np.abs(K.data).max()
    )
    assert np.linalg.matrix_rank(rigid_body_modes(mesh.nodes)) == 6
    assert rigid_body_modes(mesh.nodes, rotations=True).shape == (6 * len(mesh.nodes), 6)
