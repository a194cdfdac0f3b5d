"""Periodic frames in the plane: the same in space, invariances, gradients, bad input."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fea.beam import StrutMaterial
from fea.errors import FeaError
from fea.homogenise import homogenise_frame, homogenised, homogenised_gradient
from fea.periodic_frame import PeriodicFrame
from fea.plane_stiffness import PlaneStiffness
from fea.sections import Given, Round, Wall

WALLS = StrutMaterial(1000.0, 0.3, Wall())


def irregular(seed: int = 0, depth: float = 1.0) -> PeriodicFrame:
    """Two jittered squares, diagonally braced, with tapered walls; skew periods."""
    rng = np.random.default_rng(seed)
    struts, offsets = [], []
    for joint in (0, 1):
        for x, y in ((1, 0), (0, 1), (1, 1)):
            # Joint 1 is beside joint 0 in the first direction.
            over, other = divmod(joint + x, 2)
            struts.append((joint, other))
            offsets.append((over, y))
    return PeriodicFrame(
        joints=np.array([[0.0, 0], [1.0, 0]]) + rng.uniform(-0.1, 0.1, (2, 2)),
        struts=np.array(struts),
        offsets=np.array(offsets),
        periods=np.array([[2.0, 0.1], [0.2, 1.1]]),
        radii=rng.uniform(0.05, 0.1, (6, 2)),
        material=StrutMaterial(1000.0, 0.3, Wall(depth=depth)),
        rigid_ends=rng.uniform(0.0, 0.1, (6, 2)),
        modulus=rng.uniform(0.8, 1.3, 6),
    )


def braced_block() -> PeriodicFrame:
    """A unit square with a diagonal, from a block with what its edges share on both sides."""
    joints = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])
    struts = np.array([[0, 1], [2, 3], [0, 2], [1, 3], [0, 3]])
    return PeriodicFrame.from_block(joints, struts, np.full((5, 2), 0.05), np.eye(2), WALLS)


def test_images_of_a_block_become_one():
    block = braced_block()
    assert (len(block.joints), len(block.struts)) == (1, 3)
    np.testing.assert_allclose(block.density, 0.1 * (2 + np.sqrt(2)), rtol=1e-14)
    single = replace(
        block, struts=np.zeros((3, 2), int), offsets=np.array([[1, 0], [0, 1], [1, 1]])
    )
    np.testing.assert_allclose(homogenise_frame(block).C, homogenise_frame(single).C, rtol=1e-12)


def test_bars_stacked_in_space_have_the_same_stiffness_in_their_plane():
    """Layers of the plane's lattice, of bars with the wall's area and second moment, one mm apart.

    Posts join the layers; in a mirror plane of the stack they neither bend nor stretch under strains of
    the plane.
    """
    frame = replace(irregular(), radii=np.full((6, 2), 0.08), rigid_ends=None)
    wall = WALLS.section
    r = np.array([0.08])
    constants = {
        "A": float(wall.area(r)[0]),
        "I": float(wall.second_moment(r)[0]),
        "J": float(wall.torsion_constant(r)[0]),
        "shear_factor": wall.kappa(0.3),
    }
    posts = np.array([[0, 0], [1, 1]])
    stack = PeriodicFrame(
        joints=np.pad(frame.joints, ((0, 0), (0, 1))),
        struts=np.concatenate([frame.struts, posts]),
        offsets=np.concatenate(
            [np.pad(frame.offsets, ((0, 0), (0, 1))), np.array([[0, 0, 1], [0, 0, 1]])]
        ),
        periods=np.diag([1.0, 1.0, 1.0]) + np.pad(frame.periods - np.eye(2), ((0, 1), (0, 1))),
        radii=np.full((8, 2), 0.08),
        material=StrutMaterial(1000.0, 0.3, Given(**constants)),
        modulus=np.concatenate([frame.modulus, np.ones(2)]),
    )
    in_space = homogenise_frame(stack).C[np.ix_([0, 1, 5], [0, 1, 5])]
    np.testing.assert_allclose(homogenise_frame(frame).C, in_space, rtol=1e-10)


@pytest.mark.parametrize("solver", ["superlu", "auto"])
def test_stiffness_does_not_depend_on_the_depth_or_the_solver(solver):
    C = homogenise_frame(irregular()).C
    deep = homogenise_frame(irregular(depth=7.0), solver=solver)
    np.testing.assert_allclose(deep.C, C, rtol=1e-12)
    assert deep.residual < 1e-12


@settings(max_examples=10, derandomize=True, deadline=None)
@given(st.floats(-3, 3), st.floats(0.1, 10))
def test_stiffness_turns_with_the_frame_and_does_not_depend_on_its_size(angle, size):
    frame = irregular()
    c, s = np.cos(angle), np.sin(angle)
    R = size * np.array([[c, s], [-s, c]])
    moved = replace(
        frame,
        joints=frame.joints @ R + 3.0,
        periods=frame.periods @ R,
        radii=size * frame.radii,
        rigid_ends=size * frame.rigid_ends,
    )
    expected = PlaneStiffness(homogenise_frame(frame).C).turned(angle).C
    np.testing.assert_allclose(
        homogenise_frame(moved).C, expected, atol=1e-11 * np.abs(expected).max()
    )


def test_joints_are_in_equilibrium_and_forces_are_those_of_the_mean_stress():
    """The virial: stress = sum over walls of force and span, over the area and the depth."""
    solution = homogenise_frame(irregular(depth=2.0))
    frame = solution.frame
    ends = solution.end_forces.reshape(3, -1, 2, 3)
    total = np.zeros((3, 2, 3))
    np.add.at(total, (slice(None), frame.struts), ends)
    np.testing.assert_allclose(total, 0, atol=1e-10 * np.abs(ends).max())
    span = frame.ends[:, 1] - frame.ends[:, 0]
    stress = np.einsum("csx,sy->cxy", ends[:, :, 1, :2], span) / frame.volume
    mean = np.stack([stress[:, 0, 0], stress[:, 1, 1], (stress[:, 0, 1] + stress[:, 1, 0]) / 2])
    np.testing.assert_allclose(mean.T, solution.C, atol=1e-10 * np.abs(solution.C).max())


def test_gradient_is_that_of_central_differences():
    frame = irregular()
    rng = np.random.default_rng(1)
    weights = rng.normal(size=(3, 3))
    gradient = homogenised_gradient(homogenise_frame(frame), weights)
    assert set(gradient) == {"joints", "radii", "rigid_ends", "modulus"}
    for name, at in frame.parameters.items():
        by, h = rng.normal(size=at.shape), 1e-5
        plus, minus = (
            homogenise_frame(replace(frame, **{name: at + step * by})).C for step in (h, -h)
        )
        expected = np.sum(weights * (plus - minus)) / (2 * h)
        # h² times the third derivative, and rounding of C over h.
        np.testing.assert_allclose(np.sum(gradient[name] * by), expected, rtol=1e-5, err_msg=name)


def test_jax_differentiates_the_stiffness_by_radii():
    frame = irregular()
    weights = np.random.default_rng(2).normal(size=(3, 3))
    found = jax.grad(lambda radii: jnp.sum(jnp.asarray(weights) * homogenised(frame, radii=radii)))(
        jnp.asarray(frame.radii)
    )
    expected = homogenised_gradient(homogenise_frame(frame), weights)["radii"]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_rows_that_nothing_joins_are_a_mechanism():
    """Walls along x only: nothing resists yy, and their joints turn with the shear."""
    row = replace(
        braced_block(),
        struts=np.zeros((1, 2), int),
        offsets=np.array([[1, 0]]),
        radii=np.full((1, 2), 0.05),
    )
    with pytest.raises(FeaError, match=r"does not resist the strain .*1 (yy|xy)"):
        PlaneStiffness(homogenise_frame(row).C)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"material": StrutMaterial(1.0, 0.3, Round())}, "section Round, which says nothing"),
        ({"periods": np.array([[1.0, 0], [2, 0]])}, "span no area; give two vectors"),
        ({"radii": np.zeros((3, 2))}, "radius that is not positive"),
    ],
)
def test_bad_frames_are_refused(values, says):
    with pytest.raises(FeaError, match=says):
        homogenise_frame(replace(braced_block(), **values))


def test_walls_in_space_are_refused():
    frame = PeriodicFrame(
        joints=np.zeros((1, 3)),
        struts=np.zeros((3, 2), int),
        offsets=np.eye(3, dtype=int),
        periods=np.eye(3),
        radii=np.full((3, 2), 0.05),
        material=WALLS,
    )
    with pytest.raises(FeaError, match="bends in its plane only; give joints and periods two"):
        homogenise_frame(frame)
