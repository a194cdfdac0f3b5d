"""Periodic frames: closed forms, invariances, gradients, bad input."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fea.beam import StrutMaterial
from fea.effective_stiffness import EffectiveStiffness
from fea.errors import FeaError
from fea.homogenise import homogenise_frame, homogenised, homogenised_gradient
from fea.linear_solve import SingularStiffness
from fea.periodic_frame import PeriodicFrame
from fea.sections import Round, Square
from fea.voigt import turned_stiffness

MATERIAL = StrutMaterial(1000.0, 0.3, Round(shear_factor=0.9))
PRIMITIVE_FCC = np.array([[0.0, 0.5, 0.5], [0.5, 0.0, 0.5], [0.5, 0.5, 0.0]])


def octet(radius: float = 0.05, material: StrutMaterial = MATERIAL) -> PeriodicFrame:
    """One joint and six struts in the primitive cell of the face-centred cubic lattice."""
    offsets = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, -1, 0], [0, 1, -1], [1, 0, -1]])
    return PeriodicFrame(
        joints=np.array([[0.2, -0.1, 0.7]]),
        struts=np.zeros((6, 2), int),
        offsets=offsets,
        periods=PRIMITIVE_FCC,
        radii=np.full((6, 2), radius),
        material=material,
    )


def octet_block(radius: float = 0.05) -> PeriodicFrame:
    """The same lattice from the cube, with what its faces share on both sides."""
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
    middles = np.array([[0.5, 0.5, z] for z in (0.0, 1.0)])
    joints = np.concatenate([corners, *(np.roll(middles, k, axis=1) for k in range(3))])
    a, b = np.triu_indices(len(joints), 1)
    near = np.isclose(np.linalg.norm(joints[a] - joints[b], axis=1), np.sqrt(0.5))
    struts = np.stack([a[near], b[near]], axis=1)
    assert len(struts) == 36
    return PeriodicFrame.from_block(joints, struts, np.full((36, 2), radius), np.eye(3), MATERIAL)


def irregular(seed: int = 0) -> PeriodicFrame:
    """Two cubes of a jittered, diagonally braced lattice with tapered struts; a skew period."""
    rng = np.random.default_rng(seed)
    struts, offsets = [], []
    steps = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (0, 1, -1)]
    for joint in (0, 1):
        for x, y, z in steps:
            # Joint 1 is beside joint 0 in the first direction.
            over, other = divmod(joint + x, 2)
            struts.append((joint, other))
            offsets.append((over, y, z))
    joints = np.array([[0.0, 0, 0], [1.0, 0, 0]]) + rng.uniform(-0.1, 0.1, (2, 3))
    return PeriodicFrame(
        joints=joints,
        struts=np.array(struts),
        offsets=np.array(offsets),
        periods=np.array([[2.0, 0.1, 0.0], [0.2, 1.1, 0.0], [0.0, -0.1, 0.9]]),
        radii=rng.uniform(0.05, 0.1, (10, 2)),
        material=MATERIAL,
        rigid_ends=rng.uniform(0.0, 0.1, (10, 2)),
        modulus=rng.uniform(0.8, 1.3, 10),
    )


def test_a_joint_of_the_primitive_cell_is_four_of_the_cube():
    """Octet: 12 struts at a joint, so 4 joints and 24 struts in a cube; faces are shared."""
    block = octet_block()
    assert (len(block.joints), len(block.struts)) == (4, 24)
    np.testing.assert_allclose(block.density, octet().density, rtol=1e-12)
    # Two factors of different structures: rounding of the solves.
    np.testing.assert_allclose(
        homogenise_frame(block).C, homogenise_frame(octet()).C, rtol=1e-12, atol=1e-10
    )


def test_octet_is_that_of_its_closed_form():
    """Exact for the beam model; for slender struts Deshpande, Fleck, Ashby, JMPS 49 (2001) 1747."""
    L, r = np.sqrt(0.5), 0.05
    A, I = np.pi * r**2, np.pi / 4 * r**4
    phi = 12 * I * 2 * 1.3 / (0.9 * A * L**2)
    eta, rho = 3 * (r / L) ** 2 / (1 + phi), 24 * A * L
    found = EffectiveStiffness(homogenise_frame(octet()).C)
    E = found.engineering_constants.E[0]
    np.testing.assert_allclose(E, 1000 * rho / 9 * (1 + 3 * eta) / (1 + eta / 3), rtol=1e-12)
    np.testing.assert_allclose(found.engineering_constants.nu, (1 - eta) / (3 + eta), rtol=1e-11)
    np.testing.assert_allclose(found.cubic[2], 1000 * rho * (1 + eta) / 12, rtol=1e-12)
    assert found.departure_from_cubic < 1e-14


def test_a_period_twice_as_long_gives_the_same_stiffness():
    frame, count = irregular(), 10
    # The second copy's struts start one period further; each ends in the copy its offset names.
    first = np.concatenate([np.zeros(count, int), np.ones(count, int)])
    offsets = np.tile(frame.offsets, (2, 1))
    over, copy = np.divmod(first + offsets[:, 0], 2)
    struts = np.tile(frame.struts, (2, 1)) + 2 * np.stack([first, copy], axis=1)
    double = replace(
        frame,
        joints=np.concatenate([frame.joints, frame.joints + frame.periods[0]]),
        struts=struts,
        offsets=np.column_stack([over, offsets[:, 1:]]),
        periods=frame.periods * np.array([[2.0], [1], [1]]),
        radii=np.tile(frame.radii, (2, 1)),
        rigid_ends=np.tile(frame.rigid_ends, (2, 1)),
        modulus=np.tile(frame.modulus, 2),
    )
    expected = homogenise_frame(frame).C
    np.testing.assert_allclose(
        homogenise_frame(double).C, expected, atol=1e-12 * np.abs(expected).max()
    )


@settings(max_examples=10, derandomize=True, deadline=None)
@given(st.tuples(*[st.floats(-3, 3)] * 3), st.floats(0.1, 10))
def test_stiffness_turns_with_the_frame_and_does_not_depend_on_its_size(angles, size):
    frame, turn = irregular(), Rotation.from_rotvec(angles)
    moved = replace(
        frame,
        joints=size * turn.apply(frame.joints) + 3.0,
        periods=size * turn.apply(frame.periods),
        radii=size * frame.radii,
        rigid_ends=size * frame.rigid_ends,
    )
    C = homogenise_frame(frame).C
    np.testing.assert_allclose(
        homogenise_frame(moved).C,
        turned_stiffness(C, turn.as_matrix()),
        atol=1e-11 * np.abs(C).max(),
    )


def test_numbering_direction_and_choice_of_image_do_not_matter():
    frame = irregular()
    shift = np.array([3, -1, 2])  # joint 1 by another of its images
    moves = np.where(frame.struts == 1, 1, 0)
    offsets = frame.offsets + (moves[:, :1] - moves[:, 1:]) * shift
    flip = np.arange(10) % 2 == 1
    struts = np.where(flip[:, None], frame.struts[:, ::-1], frame.struts)
    other = replace(
        frame,
        joints=frame.joints + np.array([[0, 0, 0], shift @ frame.periods]),
        struts=struts,
        offsets=np.where(flip[:, None], -offsets, offsets),
        radii=np.where(flip[:, None], frame.radii[:, ::-1], frame.radii),
        rigid_ends=np.where(flip[:, None], frame.rigid_ends[:, ::-1], frame.rigid_ends),
    )
    C = homogenise_frame(frame).C
    np.testing.assert_allclose(homogenise_frame(other).C, C, atol=1e-11 * np.abs(C).max())


def test_the_mean_stress_is_that_of_the_struts_forces():
    """Hill (1963): V sigma = sum of end force (x) end position; here without the energy formula."""
    frame = irregular()
    solution = homogenise_frame(frame)
    force = solution.end_forces.reshape(6, -1, 2, 6)[..., :3]
    stress = np.einsum("csei,sej->cij", force, frame.ends) / frame.volume
    rows, columns = [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]
    np.testing.assert_allclose(
        stress[:, rows, columns], solution.C, atol=1e-11 * np.abs(solution.C).max()
    )


def test_multigrid_and_direct_solver_agree():
    frame = irregular()
    C = homogenise_frame(frame, solver="superlu").C
    # Energies are off by the square of the residual, 1e-10.
    np.testing.assert_allclose(
        homogenise_frame(frame, solver="amg").C, C, atol=1e-11 * np.abs(C).max()
    )


def weights(seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(6, 6))


@pytest.mark.parametrize("name", ["joints", "radii", "rigid_ends", "modulus"])
def test_the_gradient_has_a_second_order_taylor_remainder(name):
    frame, w = irregular(), weights()
    v = np.random.default_rng(2).normal(size=frame.parameters[name].shape)
    v *= {"joints": 0.1, "radii": 0.02, "rigid_ends": 0.05, "modulus": 0.1}[name]

    def value(t: float) -> float:
        moved = replace(frame, **{name: frame.parameters[name] + t * v})
        return float(np.sum(w * homogenise_frame(moved).C))

    slope = float(np.sum(homogenised_gradient(homogenise_frame(frame), w)[name] * v))
    if name == "modulus":
        # Near-linear in the moduli: the quadratic term must stay above rounding.
        steps = [4e-1, 2e-1, 1e-1]
    else:
        steps = [4e-2, 2e-2, 1e-2]
    remainders = [abs(value(t) - value(0.0) - t * slope) for t in steps]
    orders = np.log2(np.divide(remainders[:-1], remainders[1:]))
    np.testing.assert_allclose(orders, 2, atol=0.15)
    # And without the slope it would be of first order.
    plain = [abs(value(t) - value(0.0)) for t in steps]
    assert plain[-1] > 3 * remainders[-1]


def test_jax_differentiates_through_it():
    """d/dr of Young's modulus, by the chain rule of JAX, against a central difference."""
    frame = octet()

    def modulus(radii):
        return 1 / jnp.linalg.inv(homogenised(frame, radii=radii))[0, 0]

    gradient = jax.grad(modulus)(jnp.asarray(frame.radii))
    step = 1e-5
    ends = [float(modulus(jnp.asarray(frame.radii + s))) for s in (step, -step)]
    # The error of the difference is (step/r)^2, 4e-8.
    np.testing.assert_allclose(float(gradient.sum()), (ends[0] - ends[1]) / (2 * step), rtol=1e-6)


def test_all_struts_share_the_gradient_of_a_symmetric_function():
    """By cubic symmetry the bulk modulus of octet depends equally on all six struts."""
    w = np.zeros((6, 6))
    w[:3, :3] = 1 / 9
    gradient = homogenised_gradient(homogenise_frame(octet()), w)
    np.testing.assert_allclose(gradient["radii"], gradient["radii"][0, 0], rtol=1e-9)
    # Moving the only joint moves the whole lattice.
    np.testing.assert_allclose(gradient["joints"], 0, atol=1e-9 * gradient["radii"].max())


def test_square_struts_are_taken_at_their_own_section():
    square = octet(material=StrutMaterial(1000.0, 0.3, Square()))
    np.testing.assert_allclose(square.density / octet().density, 4 / np.pi, rtol=1e-12)
    stretch = homogenise_frame(square).C.trace() / homogenise_frame(octet()).C.trace()
    np.testing.assert_allclose(stretch, 4 / np.pi, rtol=0.01)  # bending adds 1 %


def test_tapered_struts_have_the_volume_of_cones():
    frame = replace(octet(), radii=np.tile([0.02, 0.05], (6, 1)))
    cone = np.pi / 3 * (0.02**2 + 0.02 * 0.05 + 0.05**2) * np.sqrt(0.5)
    np.testing.assert_allclose(frame.strut_volume, 6 * cone, rtol=1e-12)


# Mechanisms and bad input ---------------------------------------------------------------------


def columns() -> PeriodicFrame:
    """Straight columns that nothing joins across: they turn about themselves."""
    return PeriodicFrame(
        joints=np.array([[0.0, 0, 0], [0, 0, 0.5]]),
        struts=np.array([[0, 1], [1, 0]]),
        offsets=np.array([[0, 0, 0], [0, 0, 1]]),
        periods=np.eye(3),
        radii=np.full((2, 2), 0.1),
        material=MATERIAL,
    )


def test_columns_that_turn_about_themselves_are_a_mechanism():
    with pytest.raises(SingularStiffness, match=r"mechanism: joint \d at .* can turn"):
        homogenise_frame(columns())


def test_a_net_without_thickness_resists_in_its_plane_only():
    """Squares in the plane: no stiffness along z, and the stiffness says so."""
    net = replace(
        columns(),
        joints=np.zeros((1, 3)),
        struts=np.zeros((2, 2), int),
        offsets=np.array([[1, 0, 0], [0, 1, 0]]),
    )
    C = homogenise_frame(net).C
    np.testing.assert_allclose(C[0, 0], 1000 * np.pi * 0.01, rtol=1e-12)
    np.testing.assert_allclose(C[2:5], 0, atol=1e-12)
    with pytest.raises(FeaError, match=r"does not resist the strain .*1 (zz|yz|xz)"):
        EffectiveStiffness(C)


TWICE = np.tile(np.eye(3, dtype=int), (2, 1))


def changed(**values) -> PeriodicFrame:
    return replace(irregular(), **values)


def with_first(array: np.ndarray, value: float) -> np.ndarray:
    array = array.copy()
    array.flat[0] = value
    return array


@pytest.mark.parametrize(
    ("frame", "says"),
    [
        (
            changed(radii=with_first(irregular().radii, 0.0)),
            "Strut 0 .* radius that is not positive",
        ),
        (changed(joints=with_first(irregular().joints, np.nan)), r"joints\[0\] .* not a number"),
        (changed(rigid_ends=np.full((10, 2), 2.0)), "rigid from end to end"),
        (changed(rigid_ends=np.full((10, 2), -0.1)), "negative length"),
        (changed(modulus=np.zeros(10)), "modulus that is not positive"),
        (changed(struts=irregular().struts + 1), "refer to joints 1 to 2"),
        (changed(periods=np.ones((3, 3))), "span no volume"),
        (changed(periods=np.full((3, 3), np.nan)), "span no volume"),
        (changed(material=StrutMaterial(1.0, 0.7, Round())), "nu = 0.7"),
        (replace(octet(), offsets=np.zeros((6, 3), int)), "has no length"),
        (replace(octet(), offsets=TWICE), "Strut 3 .* repeats an earlier"),
        (replace(octet(), offsets=TWICE * np.repeat([[1], [-1]], 3, axis=0)), "repeats an earlier"),
        (
            replace(
                octet(),
                struts=np.zeros((0, 2), int),
                offsets=np.zeros((0, 3), int),
                radii=np.zeros((0, 2)),
            ),
            "no struts",
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_malformed_frames_are_named(frame, says):
    with pytest.raises(FeaError, match=says):
        homogenise_frame(frame)


def test_two_nets_that_nothing_joins_are_refused():
    """Two cubic nets, one in the middle of the other."""
    net = replace(
        octet(),
        joints=np.array([[0.0, 0, 0], [0.5, 0.5, 0.5]]),
        struts=np.repeat([[0, 0], [1, 1]], 3, axis=0),
        offsets=np.tile(np.eye(3, dtype=int), (2, 1)),
        periods=np.eye(3),
    )
    with pytest.raises(FeaError, match="falls into 2 parts"):
        homogenise_frame(net)


def block(joints, struts, radii=0.1) -> PeriodicFrame:
    ends = np.broadcast_to(np.asarray(radii, float), (len(struts), 2)).copy()
    return PeriodicFrame.from_block(
        np.array(joints, float), np.array(struts), ends, np.eye(3), MATERIAL
    )


def test_images_of_a_block_must_match():
    with pytest.raises(FeaError, match="but for 5e-06 periods"):
        block([[0, 0, 0], [1, 5e-6, 0]], [[0, 1]])
    with pytest.raises(FeaError, match=r"both at \(0, 0, 0\)"):
        block([[0, 0, 0], [1, 0, 0], [0, 0, 0]], [[0, 1], [1, 2]])
    with pytest.raises(FeaError, match="same joints as an earlier"):
        block([[0, 0, 0], [1, 0, 0]], [[0, 1], [1, 0]])


def test_images_of_one_strut_must_have_the_same_radius():
    """The edges of a square in two opposite faces, once thick and once thin."""
    joints = [[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0]]
    with pytest.raises(FeaError, match=r"Struts 1 and 0 are images .* radii differ by 0.1"):
        block(joints, [[0, 1], [2, 3]], [[0.1, 0.1], [0.2, 0.2]])
    # Seen from its other end a tapered strut is the same one.
    kept = block(joints, [[0, 1], [3, 2]], [[0.1, 0.2], [0.2, 0.1]])
    np.testing.assert_array_equal(kept.radii, [[0.1, 0.2]])


def test_a_parameter_that_the_frame_lacks_is_named():
    with pytest.raises(FeaError, match=r'"modulus" is no parameter .* choose from joints, radii'):
        homogenised(octet(), modulus=np.ones(6))
    with pytest.raises(FeaError, match='"radii" has shape'):
        homogenised(octet(), radii=np.ones(6))
    with pytest.raises(FeaError, match="traced by JAX"):
        jax.jit(lambda r: homogenised(octet(), radii=r))(octet().radii)
