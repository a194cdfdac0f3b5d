"""Properties for which cells are in the library, found with their frame of beams."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from jaxtyping import Float

from fea.beam import StrutMaterial
from fea.effective_stiffness import EffectiveStiffness
from fea.homogenise import homogenise_frame
from fea.sections import section
from texmap_opt.cells import catalogue
from texmap_opt.cells.periodic_frame import periodic_frame
from texmap_opt.cells.unit_cell import UnitCell

unit_cell = cache(catalogue.unit_cell)

NU = 0.3
# Of the density: struts so thin that what bends is 1e-5 of what stretches.
THIN = 1e-3
# The same with joints that bend: at a tenth of the density of the solid.
PRINTED = 0.1


def homogenised(cell: UnitCell, density: float) -> Float[np.ndarray, "cases cases"]:
    """Effective stiffness for a solid with E = 1, at a density counted from joint to joint."""
    material = StrutMaterial(1.0, NU, section(cell.section))
    trial = periodic_frame(cell, edge=1.0, radius=0.01, material=material)
    # The density of walls is as the radius, that of bars as its square.
    radius = 0.01 * (density / trial.density) ** (1 / (cell.dimensions - 1))
    frame = periodic_frame(cell, edge=1.0, radius=float(radius), material=material)
    np.testing.assert_allclose(frame.density, density, rtol=1e-9)
    return homogenise_frame(frame).C


def poissons_ratios(C: Float[np.ndarray, "3 3"], steps: int = 36) -> Float[np.ndarray, " samples"]:
    """In-plane contraction under tension along directions over half a turn."""
    angle = np.linspace(0, np.pi, steps, endpoint=False)
    c, s = np.cos(angle), np.sin(angle)
    along = np.stack([c * c, s * s, c * s], axis=1)
    across = np.stack([s * s, c * c, -c * s], axis=1)
    S = np.linalg.inv(C)
    return -np.einsum("ni,ij,nj->n", across, S, along) / np.einsum("ni,ij,nj->n", along, S, along)


@pytest.mark.parametrize(("density", "tolerance"), [(THIN, 1e-4), (PRINTED, 0.005)])
def test_iso_material_is_isotropic_with_poissons_ratio_one_half(density: float, tolerance: float):
    """The property Chen (2007), figure 5b, gives the cell of Kikuchi; its thin walls only stretch."""
    C = homogenised(unit_cell("iso-material"), density)
    np.testing.assert_allclose(poissons_ratios(C), 0.5, atol=tolerance)
    # Of what pin-jointed walls can have at most: E = 2 K (1 - nu) and K = density/4 (Hashin, Shtrikman).
    E = 1 / np.linalg.inv(C)[0, 0]
    np.testing.assert_allclose(E, density / 4, rtol=0.02)


@pytest.mark.parametrize("spoke", [0.1, 0.25, 1.0, 4.0])
def test_spokes_set_bulk_over_shear_modulus(spoke: float):
    """Pin-jointed, with x the thickness of spokes: K/G = 2 (1 + 2x)(2 + x)/(9x); 3 for x = 1/4, 4."""
    cell = unit_cell("iso-material")
    thin = cell.relative_radius < 1
    C = homogenised(replace(cell, relative_radius=np.where(thin, spoke, 1.0)), 1e-4)
    K, G = (C[0, 0] + C[0, 1]) / 2, C[2, 2]
    np.testing.assert_allclose(K / G, 2 * (1 + 2 * spoke) * (2 + spoke) / (9 * spoke), rtol=1e-5)


@pytest.mark.parametrize(("density", "tolerance"), [(THIN, 0.005), (PRINTED, 0.015)])
def test_rubber_band_is_isotropic_with_a_poissons_ratio_near_one_half(
    density: float, tolerance: float
):
    """The property Chen (2007), figure 5b, gives the cell of Sigmund."""
    C = homogenised(unit_cell("rubber-band"), density)
    np.testing.assert_allclose(poissons_ratios(C), 0.5, atol=tolerance)
    # Coordinates of three digits leave half a percent of anisotropy.
    np.testing.assert_allclose(2 * C[2, 2] / (C[0, 0] - C[0, 1]), 1, atol=0.01)


def test_rubber_band_is_soft_for_it_bends():
    """Modulus as the cube of the density (Gibson, Ashby, Cellular Solids, chapter 4)."""
    E = [
        1 / np.linalg.inv(homogenised(unit_cell("rubber-band"), rho))[0, 0] for rho in (1e-3, 2e-3)
    ]
    np.testing.assert_allclose(np.log2(E[1] / E[0]), 3, atol=0.001)
    assert 1 / np.linalg.inv(homogenised(unit_cell("rubber-band"), PRINTED))[0, 0] < PRINTED / 250


def test_without_its_pinch_the_frame_is_no_rubber():
    """Square frames joined at mid-side: 3/5, by the bending of two half sides and a rigid corner."""
    cell = unit_cell("rubber-band")
    half = 0.5 - cell.joints[cell.joint_names.index("left"), 0]
    joints = cell.joints.copy()
    corner = [name.startswith("c") for name in cell.joint_names]
    joints[corner] = 0.5 + half * np.sign(joints[corner] - 0.5)
    nu = poissons_ratios(homogenised(replace(cell, joints=joints), THIN))
    np.testing.assert_allclose(nu[0], 0.6, atol=1e-4)


def test_re_entrant_walls_widen_when_pulled():
    """With h = 2 l and t = -30 degrees nu = cos(t)^2/((h/l + sin(t)) sin(t)) = -1, and E1 = E2.

    Gibson, Ashby, Cellular Solids, 2nd edition (1997), section 4.3.
    """
    S = np.linalg.inv(homogenised(unit_cell("re-entrant"), THIN))
    np.testing.assert_allclose([-S[0, 1] / S[0, 0], -S[0, 1] / S[1, 1]], -1, atol=1e-4)
    S = np.linalg.inv(homogenised(unit_cell("re-entrant"), PRINTED))
    np.testing.assert_allclose([-S[0, 1] / S[0, 0], -S[0, 1] / S[1, 1]], -0.98, atol=0.01)


def test_column_is_stiff_in_one_direction_and_flexible_in_the_others():
    """What Chen (2007) asks for: two orders of magnitude between the axes, and soft off them."""
    stiffness = EffectiveStiffness(homogenised(unit_cell("column"), PRINTED))
    E = stiffness.youngs_modulus(
        np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 1], [1, 1, 1]])
    )
    # More than half of what all material in columns would give.
    assert E[0] > PRINTED / 2
    assert E[0] / E[1:].max() > 100
    assert E[0] / max(stiffness.engineering_constants.G) > 100


@pytest.mark.parametrize("name", ["fcc", "octahedron", "cuboctahedron", "tetrahedron", "octet"])
def test_lattices_along_face_diagonals_have_the_octets_moduli(name: str):
    """E100 = density/9, G = density/12 where all directions of struts are <110>, in equal shares.

    Deshpande, Fleck, Ashby, J. Mech. Phys. Solids 49 (2001) 1747.
    """
    stiffness = EffectiveStiffness(homogenised(unit_cell(name), THIN))
    constants = stiffness.engineering_constants
    np.testing.assert_allclose(constants.E, THIN / 9, rtol=0.005)
    np.testing.assert_allclose(constants.G, THIN / 12, rtol=0.005)


def test_rhombic_dodecahedra_are_nearly_incompressible():
    """Thin, nu is 1/2 and E as the square of the density.

    Babaee et al., Acta Mater. 60 (2012) 2873.
    """
    low, high = (
        EffectiveStiffness(homogenised(unit_cell("rhombic-dodecahedron"), rho))
        for rho in (THIN, 2 * THIN)
    )
    np.testing.assert_allclose(low.engineering_constants.nu, 0.5, atol=0.001)
    ratio = high.engineering_constants.E[0] / low.engineering_constants.E[0]
    np.testing.assert_allclose(np.log2(ratio), 2, atol=0.01)


def test_bi_stable_arches_are_the_first_buckling_mode_and_have_room_to_snap():
    """h/2 (1 - cos 2 pi x), and h/t > 2.31 (Qiu, Lang, Slocum, J. MEMS 13 (2004) 137)."""
    cell = unit_cell("bi-stable")
    arches = [
        cell.joints[[cell.joint_names.index(f"{arch}{k}") for k in range(13)]] for arch in "ab"
    ]
    rise = 0.12
    for arch in arches:
        x, y = arch.T
        np.testing.assert_allclose(y - y[0], rise / 2 * (1 - np.cos(2 * np.pi * x)), atol=1e-11)
    # Radii up to 0.015 of the cell, thickness twice that.
    assert rise / (2 * 0.015) > 2.31
    # Snapped, an arch is its mirror image: the lower one must clear the tie at the foot.
    assert (2 * arches[0][0, 1] - arches[0][:, 1]).min() > 0.1
