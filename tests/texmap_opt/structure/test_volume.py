"""Volume of overlapping struts against closed forms, published figures and sampling."""

from itertools import product

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from texmap_opt.errors import LatticeError
from texmap_opt.structure.directions import sphere_quadrature
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.volume import LatticeVolume, lattice_volume, uniform_radius


def structure(joints, struts, radii, cut=None, section="round") -> Structure:
    struts = np.asarray(struts)
    return Structure(
        joints=np.asarray(joints, float),
        struts=struts,
        radii=np.broadcast_to(np.asarray(radii, float), struts.shape).copy(),
        cut=np.zeros(len(joints), bool) if cut is None else np.asarray(cut, bool),
        cell_size=np.ones(len(struts)),
        section=section,
    )


def star(directions: np.ndarray, radii, length: float = 10.0, *, cut: bool = True) -> Structure:
    """Struts from the origin; their far ends are cuts."""
    n = len(directions)
    joints = np.vstack([np.zeros(3), length * np.asarray(directions)])
    struts = np.stack([np.zeros(n, int), np.arange(1, n + 1)], axis=1)
    radii = np.broadcast_to(np.asarray(radii, float), n)
    return structure(joints, struts, radii[:, None], [False] + n * [cut])


def octet(cells: int, radius: float) -> Structure:
    points = [p for p in product(range(2 * cells + 1), repeat=3) if sum(p) % 2 == 0]
    number = {p: i for i, p in enumerate(points)}
    steps = [(1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1), (0, 1, 1), (0, 1, -1)]
    struts = [
        (number[p], number[q])
        for p in points
        for step in steps
        if (q := tuple(np.add(p, step).tolist())) in number
    ]
    return structure(np.array(points) / 2, struts, radius)


def overlap(of: Structure, subdivisions: int = 3) -> float:
    return float(LatticeVolume.of(of, subdivisions=subdivisions).overlap(of.joints, of.radii))


@pytest.mark.parametrize("m", [1, 3, 5])
def test_quadrature_weights_cover_the_sphere_and_integrate_quadratics(m):
    directions, weights = sphere_quadrature(m)
    np.testing.assert_allclose(weights.sum(), 4 * np.pi, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=1e-12)
    # By symmetry each second moment is a third, mixed ones vanish.
    second = np.einsum("q,qi,qj->ij", weights, directions, directions)
    np.testing.assert_allclose(second, 4 * np.pi / 3 * np.eye(3), atol=1e-12)


def test_a_single_strut_is_a_capsule():
    """Volume pi r² L + 4/3 pi r³: a ball at each free end."""
    one = structure([[0, 0, 0], [1, 2, 7]], [[0, 1]], 0.4)
    length = np.sqrt(54)
    expected = np.pi * 0.16 * length + 4 / 3 * np.pi * 0.064
    np.testing.assert_allclose(lattice_volume(one), expected, rtol=1e-12)


def test_a_strut_cut_at_both_ends_is_a_cylinder():
    one = structure([[0, 0, 0], [1, 2, 7]], [[0, 1]], 0.4, [True, True])
    np.testing.assert_allclose(lattice_volume(one), np.pi * 0.16 * np.sqrt(54), rtol=1e-12)


def test_a_tapered_strut_is_a_frustum():
    one = structure([[0, 0, 0], [0, 0, 6]], [[0, 1]], [[0.4, 0.7]], [True, True])
    expected = np.pi * 6 / 3 * (0.16 + 0.28 + 0.49)
    np.testing.assert_allclose(lattice_volume(one), expected, rtol=1e-12)


@pytest.mark.parametrize("turn", [(0, 0, 0), (0.3, -0.8, 0.5), (1.0, 1.0, 0.2)])
def test_crossing_cylinders_overlap_by_the_steinmetz_solid(turn):
    """16/3 r³ for two equal cylinders crossing at right angles."""
    axes = Rotation.from_rotvec(turn).apply([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    # 432 directions leave a percent of the overlap; the limit is exact.
    np.testing.assert_allclose(overlap(star(axes, 1.0)), 16 / 3, rtol=1e-2)
    np.testing.assert_allclose(overlap(star(axes, 1.0), 24), 16 / 3, rtol=2e-4)


def test_three_crossing_cylinders_overlap_as_inclusion_and_exclusion_say():
    """3 (16/3) r³ less the tricylinder 8 (2 - sqrt 2) r³: Moore, Math. Gazette 58 (1974) 181."""
    axes = np.vstack([np.eye(3), -np.eye(3)])
    expected = 3 * 16 / 3 - 8 * (2 - np.sqrt(2))
    # 432 directions leave 1.2 % of the overlap.
    np.testing.assert_allclose(overlap(star(axes, 1.0)), expected, rtol=2e-2)
    np.testing.assert_allclose(overlap(star(axes, 1.0), 24), expected, rtol=5e-4)


@pytest.mark.parametrize("section", ["round", "square"])
def test_numpy_and_jax_agree_on_a_volume(section):
    """Tapered struts, joints of several valences, a cut: to rounding."""
    block = octet(2, 0.06)
    taper = np.linspace(0.5, 1.0, 2 * len(block.struts)).reshape(-1, 2)
    cut = block.joints[:, 0] == 0
    net = structure(block.joints, block.struts, 0.06 * taper, cut, section)
    measure, all_of_it = LatticeVolume.of(net), np.ones(len(net.struts))
    by_jax = float(measure(net.joints, net.radii))
    by_numpy = measure.host_volume(net.joints, net.radii, share=all_of_it)
    np.testing.assert_allclose(by_numpy, by_jax, rtol=1e-13)
    # Negative control: the overlaps are no trifle.
    own = float(np.sum(measure.strut_volumes(net.joints, net.radii)))
    assert own > 1.05 * by_numpy


def test_a_straight_joint_takes_nothing_away():
    axes = np.array([[0.6, 0.8, 0], [-0.6, -0.8, 0]])
    np.testing.assert_allclose(overlap(star(axes, 0.5)), 0, atol=2e-3)


def test_octet_of_ten_percent_density():
    """Diameter 0.0939 a: centre-line density 0.1176, true 0.100 (fits of LLNL MultiscaleTopOpt).

    The density of the infinite lattice is that of the middle cell: a difference of two blocks,
    third differences leaving only the volume per cell.
    """
    r = 0.0939 / 2
    block = [(lattice_volume(octet(n, r)), *_own(octet(n, r))) for n in (1, 2, 3, 4)]
    # Volume of n^3 cells is a cubic polynomial in n; its third difference is 3! times the cell's.
    volume, own = (np.diff([b[k] for b in block], 3)[0] / 6 for k in (0, 1))
    np.testing.assert_allclose(own, 0.1176, rtol=2e-3)
    np.testing.assert_allclose(volume, 0.100, rtol=2e-2)


def _own(of: Structure) -> tuple[float]:
    return (float(LatticeVolume.of(of).strut_volumes(of.joints, of.radii).sum()),)


def test_volume_of_a_random_joint_agrees_with_sampling():
    """Monte Carlo of the union of balls-ended struts, three standard errors."""
    rng = np.random.default_rng(5)
    axes = rng.normal(size=(5, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    radii = rng.uniform(0.3, 0.6, 5)
    of = star(axes, radii, length=3.0)
    points = rng.uniform(-3.6, 3.6, (200_000, 3))
    along = points @ axes.T
    inside = (along >= 0) & (along <= 3)
    inside &= np.linalg.norm(points[:, None] - along[..., None] * axes, axis=2) <= radii
    hit = inside.any(axis=1) | (np.linalg.norm(points, axis=1) <= radii.max())
    box = 7.2**3
    error = 3 * box * np.sqrt(hit.mean() * (1 - hit.mean()) / len(points))
    assert abs(lattice_volume(of) - box * hit.mean()) < error
    # Negative control: the sum of the struts' own volumes is far outside.
    assert abs(_own(of)[0] - box * hit.mean()) > 2 * error


@settings(max_examples=8, derandomize=True, deadline=None)
@given(st.floats(0.2, 5.0), st.tuples(*[st.floats(-3, 3)] * 3))
def test_volume_scales_as_length_cubed_and_hardly_sees_orientation(scale, turn):
    of = octet(1, 0.06)
    turned = Rotation.from_rotvec(turn).apply(of.joints)
    larger = structure(scale * of.joints, of.struts, scale * of.radii)
    measure = LatticeVolume.of(of)
    volume = float(measure(of.joints, of.radii))
    np.testing.assert_allclose(lattice_volume(larger), scale**3 * volume, rtol=1e-12)
    # The quadrature is fixed in space: a quarter of a percent is its error.
    np.testing.assert_allclose(float(measure(turned, of.radii)), volume, rtol=5e-3)


def test_a_short_stub_inside_a_joint_adds_nothing():
    axes = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]])
    joints = np.vstack([np.zeros(3), 10 * axes[:4], 0.2 * axes[4:]])
    struts = [[0, k] for k in range(1, 6)]
    stub = structure(joints, struts, 1.0, [False, True, True, True, True, True])
    np.testing.assert_allclose(lattice_volume(stub), lattice_volume(star(axes[:4], 1.0)), rtol=1e-3)


def test_square_struts_have_their_own_area():
    one = structure([[0, 0, 0], [0, 0, 6]], [[0, 1]], 0.5, [True, True], section="square")
    np.testing.assert_allclose(lattice_volume(one), 6.0, rtol=1e-12)


@pytest.mark.parametrize("varied", ["joints", "radii"])
@pytest.mark.parametrize("section", ["round", "square"])
def test_volume_gradient_has_a_second_order_taylor_remainder(varied, section):
    import jax

    of = octet(1, 0.06)
    rng = np.random.default_rng(1)
    # Away from equal radii, where the ball's radius (a maximum) has a kink.
    radii = of.radii * rng.uniform(0.8, 1.2, of.radii.shape)
    joints = of.joints + rng.uniform(-0.03, 0.03, of.joints.shape)
    of = structure(joints, of.struts, radii, section=section)
    measure = LatticeVolume.of(of)
    at = {"joints": jnp.asarray(of.joints), "radii": jnp.asarray(of.radii)}
    v = rng.normal(size=at[varied].shape)
    slope = float(jnp.sum(jax.grad(lambda x: measure(**(at | {varied: x})))(at[varied]) * v))

    def rest(h: float) -> float:
        value = float(measure(**(at | {varied: at[varied] + h * v})))
        return abs(value - float(measure(**at)) - h * slope)

    # Steps so small that no direction changes its thickest strut.
    orders = np.log2(rest(4e-7) / rest(2e-7))
    np.testing.assert_allclose(orders, 2, atol=0.2)


def test_the_uniform_radius_gives_the_volume_asked_for():
    of = octet(2, 0.01)
    radius = uniform_radius(of, 0.9)
    np.testing.assert_allclose(
        lattice_volume(of.with_radii(np.full(of.struts.shape, radius))), 0.9, rtol=1e-8
    )


@pytest.mark.parametrize("volume", [-1.0, 0.0, 1e3])
def test_a_volume_no_radius_gives_is_refused_with_the_range(volume):
    with pytest.raises(LatticeError, match=r"give 0 to \d"):
        uniform_radius(octet(1, 0.01), volume)
