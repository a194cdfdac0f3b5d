"""Extruded lattices in their plane beyond the targets: other walls, bounds, and a solid instead of beams."""

from math import sqrt

import numpy as np
import pytest
import skfem
from lattice_cases.plane import (
    COWPER,
    EULER,
    EXACT,
    HEXAGONS,
    LATTICES,
    NU,
    closed_forms,
    found,
    frame,
    homogenised,
)
from skfem.models.elasticity import linear_elasticity

from fea.stiffness_bounds import extruded_modulus, plane_hashin_shtrikman_bound, voigt_bound

ISOTROPIC = ["triangular", "kagome", "honeycomb"]


@pytest.mark.parametrize("kappa", [EULER, COWPER], ids=["euler", "cowper"])
@pytest.mark.parametrize("t", [0.02, 0.25])
@pytest.mark.parametrize("name", [*LATTICES, *HEXAGONS])
def test_a_lattice_has_the_stiffness_of_its_closed_form(name, t, kappa):
    effective = homogenised(name, t, kappa)
    for what, expected in closed_forms(name, t, kappa).items():
        np.testing.assert_allclose(
            found(effective)[what], expected, rtol=EXACT, atol=1e-14, err_msg=what
        )
    assert effective.departure_from_orthotropy < EXACT
    assert (effective.departure_from_isotropy < EXACT) == (name in ISOTROPIC)


def test_a_wrong_thickness_or_shear_factor_misses_the_closed_forms():
    """Negative control: 1 % of the thickness, or kappa = 5/6, is far outside the tolerance."""
    expected = closed_forms("honeycomb", 0.1, COWPER)["Ex"]
    assert abs(found(homogenised("honeycomb", 0.101, COWPER))["Ex"] / expected - 1) > 2e-2
    assert abs(found(homogenised("honeycomb", 0.1, 5 / 6))["Ex"] / expected - 1) > 10 * EXACT


def test_a_re_entrant_lattice_widens_when_it_is_pulled():
    """Both Poisson's ratios negative; their product is below one (Gibson, Ashby, equation 4.9)."""
    constants = found(homogenised("re-entrant hexagons", 0.05, COWPER))
    assert constants["nu_xy"] < 0
    assert constants["nu_yx"] < 0
    assert 0.9 < constants["nu_xy"] * constants["nu_yx"] < 1


@pytest.mark.parametrize("name", [*LATTICES, *HEXAGONS])
def test_no_lattice_beats_the_bounds(name):
    """Voigt's in any direction; Hashin and Shtrikman's for the average over orientations.

    The centre-line density is above the true one, which only loosens the bounds by what joints share.
    """
    effective, rho = homogenised(name, 0.05, COWPER), frame(name, 0.05, COWPER).density
    assert effective.polar_modulus().E.max() < voigt_bound(1.0, rho)
    assert extruded_modulus(1.0, rho) == voigt_bound(1.0, rho)
    bound = plane_hashin_shtrikman_bound(1.0, NU, rho)
    assert effective.reuss_average.area < bound.area
    assert effective.reuss_average.shear < bound.shear


def test_thin_triangles_and_kagome_reach_the_bound():
    """E = rho/3, what Hashin and Shtrikman's is at low density (Hyun, Torquato, JMR 17 (2002) 137)."""
    for name in ("triangular", "kagome"):
        rho = frame(name, 1e-3, COWPER).density
        bound = plane_hashin_shtrikman_bound(1.0, NU, rho)
        # The bound is E rho/(3 - 2 rho).
        np.testing.assert_allclose(found(homogenised(name, 1e-3, COWPER))["Ex"], bound.E, rtol=rho)


def solid_square(t: float, strain: str) -> float:
    """E or G of a square lattice of solid walls in plane stress, quadratic elements of scikit-fem.

    One cell is the cross of half walls around a joint. Under tension, and shear, along the walls the
    lattice has mirrors at their middles, where the cross is cut: under tension the ends move along
    the wall and are free across it, under shear the other way round.
    """
    # Short elements at the joint, where the stress is not that of beams.
    arm = t / 2 + (0.5 - t / 2) * np.linspace(0, 1, 51) ** 2
    line = np.concatenate([-arm[::-1], np.linspace(-t / 2, t / 2, 5)[1:-1], arm])
    box = skfem.MeshQuad.init_tensor(line, line)
    middle = np.abs(box.p[:, box.t].mean(axis=1))
    mesh = box.restrict(np.flatnonzero(middle.min(axis=0) < t / 2))
    element = skfem.ElementVector(skfem.ElementQuad2())
    basis = skfem.Basis(mesh, element)
    # Plane stress.
    lame = NU / (1 - NU**2), 1 / (2 * (1 + NU))
    K = linear_elasticity(*lame).assemble(basis)
    u, held = np.zeros(basis.N), []
    for axis, side in ((0, -1), (0, 1), (1, -1), (1, 1)):
        facets = mesh.facets_satisfying(lambda x, a=axis, s=side: np.isclose(x[a], s / 2))
        normal, across = f"u^{axis + 1}", f"u^{2 - axis}"
        name, value = (normal, side / 2 if axis == 0 else None)
        if strain == "xy":
            name, value = across, side / 4
        if value is None:
            continue
        dofs = basis.get_dofs(facets).all([name])
        u[dofs] = value
        held.append(dofs)
    if strain == "xx":
        # Nothing else holds the cross: the point of the joint's middle in y.
        centre = basis.get_dofs(nodes=mesh.nodes_satisfying(lambda x: np.isclose(x, 0).all(axis=0)))
        held.append(centre.all(["u^2"]))
    D = np.unique(np.concatenate(held))
    u = skfem.solve(*skfem.condense(K, x=u, D=D))
    # Unit mean strain of a cell of edge one: the energy is half the modulus.
    return float(u @ (K @ u))


@pytest.mark.parametrize(("strain", "what"), [("xx", "Ex"), ("xy", "G")], ids=["tension", "shear"])
def test_solid_walls_tend_to_beams_as_they_get_thinner(strain, what):
    """A joint stiffens each wall over about its thickness, a share of t/l; then nothing is left."""
    thickness = np.array([0.04, 0.02, 0.01])
    beams = [found(homogenised("square", t, COWPER))[what] for t in thickness]
    more = np.array([solid_square(t, strain) for t in thickness]) / beams - 1
    left, first, _ = np.linalg.solve(np.vander(thickness, increasing=True), more)
    assert first > 0
    # What is left of the third order, and of the elements.
    np.testing.assert_allclose(left, 0, atol=4e-4)


def test_the_density_of_the_honeycomb_is_that_of_gibson_and_ashby():
    """Thin walls: 2/sqrt(3) t/l (Cellular Solids, equation 4.1a), whatever the depth."""
    for depth in (1.0, 7.0):
        np.testing.assert_allclose(
            frame("honeycomb", 0.01, COWPER, depth).density, 2 / sqrt(3) * 0.01, rtol=1e-14
        )
