"""What turns cells along the stress (design section 4, item 4c)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fea.effective_stiffness import EffectiveStiffness
from fea.plane_stiffness import PlaneStiffness
from texmap_opt.box import Box
from texmap_opt.errors import WarpError
from texmap_opt.warp.alignment import (
    EqualStretch,
    LeastEnergy,
    NoShear,
    Unaligned,
    alignment_for,
)
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.warping_function import WarpingFunction

POINT = jnp.asarray([[0.5, 0.5, 0.5]])


def cubic(c11, c12, c44):
    C = np.diag([c11 - c12] * 3 + [c44] * 3).astype(float)
    C[:3, :3] += c12
    return EffectiveStiffness(C)


def everywhere(stress, dimensions=3):
    """A warping function whose stress, over its root mean square, is the same at all points."""
    unit = np.array([[0.0, 0, 0], [1, 1, 1]])
    box = Box.aligned(unit, extrusion="z" if dimensions == 2 else None)
    grid = BackgroundGrid.covering(box, 0.5)
    field = np.broadcast_to(stress, (*grid.shape, len(stress)))
    return WarpingFunction.on_grid(grid, np.zeros(grid.shape), SizeLaw(), stress=field)


def turned_energies(alignment, stress, count=200):
    """Energy of one cell in many orientations, and the orientations (rows are the cell's axes)."""
    R = Rotation.random(count, random_state=np.random.default_rng(0)).as_matrix()
    f = everywhere(stress)
    energy = jax.jit(jax.vmap(lambda frame: alignment.energy(frame[None], f, POINT)))
    return np.asarray(energy(jnp.asarray(R))), R


def strain_energy(stiffness, stress, R):
    """1/2 sigma:S:sigma in the frames R, by rotating the tensor."""
    tensor = np.asarray(stress)[np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])]
    local = np.einsum("nia,ab,njb->nij", R, tensor, R)
    voigt = np.stack(
        [local[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))], axis=1
    )
    return 0.5 * np.einsum("nv,vw,nw->n", voigt, stiffness.compliance, voigt)


STRESS = np.array([0.5, -0.2, 0.1, 0.3, -0.25, 0.2])


@pytest.mark.parametrize(
    ("stiffness", "kind"), [(cubic(3, 1, 2.0), EqualStretch), (cubic(3, 1, 0.4), NoShear)]
)
def test_the_energy_target_of_a_cubic_cell_is_its_strain_energy_up_to_a_constant(stiffness, kind):
    """Zener ratios 2 and 0.4: both residuals measure the same quadratic form of the stress."""
    alignment = alignment_for("energy", stiffness, 1.0)
    assert isinstance(alignment, kind)
    ours, R = turned_energies(alignment, STRESS)
    true = strain_energy(stiffness, STRESS, R)
    slope, constant = np.polyfit(ours, true, 1)
    assert slope > 0
    np.testing.assert_allclose(true, slope * ours + constant, rtol=1e-10)


def test_any_other_cell_is_turned_by_its_own_compliance():
    rng = np.random.default_rng(1)
    A = rng.standard_normal((6, 6))
    stiffness = EffectiveStiffness(A @ A.T + np.eye(6))
    alignment = alignment_for("energy", stiffness, 1.0)
    assert isinstance(alignment, LeastEnergy)
    ours, R = turned_energies(alignment, STRESS)
    true = strain_energy(stiffness, STRESS, R)
    slope, constant = np.polyfit(ours, true, 1)
    assert slope > 0
    np.testing.assert_allclose(true, slope * ours + constant, rtol=1e-9)
    assert ours.min() >= 0


def test_the_general_form_weighs_a_cubic_cell_like_the_special_ones():
    """A cell cubic in other axes than its own: the same spread of energy for the same weight."""
    R = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()
    for c44 in (2.0, 0.4):
        special, _ = turned_energies(alignment_for("energy", cubic(3, 1, c44), 1.0), STRESS, 500)
        general, _ = turned_energies(
            alignment_for("energy", cubic(3, 1, c44).turned(R), 1.0), STRESS, 500
        )
        np.testing.assert_allclose(np.ptp(general), np.ptp(special), rtol=0.05)


def test_an_isotropic_cell_is_not_turned():
    assert isinstance(alignment_for("energy", cubic(3, 1, 1.0), 5.0), Unaligned)


def test_no_weight_turns_nothing():
    assert isinstance(alignment_for("axes", None, 0.0), Unaligned)


def test_in_the_plane_the_compliance_in_the_plane_counts():
    """A square cell, stiffer along its axes: shear in its frame costs, pull along the axes least."""
    alignment = alignment_for("energy", cubic(3, 1, 0.4), 1.0, dimensions=2)
    f = everywhere(np.array([1.0, -1.0, 0.0, 0.0, 0.0, 0.0]), dimensions=2)
    energy = {}
    for angle in (0.0, 45.0):
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        frame = jnp.asarray([[[c, s], [-s, c]]])
        energy[angle] = float(alignment.energy(frame, f, jnp.asarray([[0.5, 0.5]])))
    assert energy[0.0] < 1e-12 < 0.1 < energy[45.0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("size", None, 1.0), "energy or axes"),
        (("axes", None, -1.0), "at least 0"),
        (("energy", None, 1.0), "needs the stiffness"),
    ],
)
def test_impossible_alignments_are_refused(arguments, words):
    with pytest.raises(WarpError, match=words):
        alignment_for(*arguments)


def test_a_sheet_is_turned_as_the_solid_whose_plane_has_its_compliance():
    """The stiffness of a plane, as of walls, is another way to give what is in the plane."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(6, 6))
    solid = EffectiveStiffness(A @ A.T + np.eye(6))
    sheet = PlaneStiffness(np.linalg.inv(solid.compliance[np.ix_([0, 1, 5], [0, 1, 5])]))
    of_solid, of_sheet = (
        alignment_for("energy", stiffness, 3.0, dimensions=2) for stiffness in (solid, sheet)
    )
    assert isinstance(of_solid, LeastEnergy)
    assert isinstance(of_sheet, LeastEnergy)
    np.testing.assert_allclose(of_sheet.compliance, of_solid.compliance, rtol=1e-9, atol=1e-12)
