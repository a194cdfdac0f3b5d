"""Endless lattices of a wanted density, and that they are computed once."""

from pathlib import Path

import hypothesis.strategies as st
import jax
import numpy as np
import pytest
from hypothesis import given, settings

from texmap_opt.cache import StageCache
from texmap_opt.cells import at_density
from texmap_opt.cells.at_density import (
    all_homogenised_at,
    homogenised,
    homogenised_at,
    radius_of_density,
)
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.homogenised import HomogenisedCell, homogenised_cell, radius_ratio
from texmap_opt.cells.homogenised_plane import HomogenisedPlaneCell
from texmap_opt.cells.periodic_density import periodic_density
from texmap_opt.errors import CellError

NOTHING_KEPT = StageCache(None)
# So thin that the share of bending, (r/L)^2 or density squared, is below the tolerances.
THIN = 1e-3


@pytest.mark.parametrize("name", ["octet", "honeycomb"])
@settings(max_examples=6, derandomize=True, deadline=None)
@given(density=st.floats(0.002, 0.4))
def test_the_radius_gives_the_density(name: str, density: float):
    """To 3e-9: the root is found to 1e-9 in the radius' logarithm, and density grows as its square."""
    cell = unit_cell(name)
    radius = radius_of_density(cell, density)
    np.testing.assert_allclose(periodic_density(cell, radius), density, rtol=3e-9)


def test_the_radius_grows_with_the_density():
    cell = unit_cell("octet")
    radii = [radius_of_density(cell, rho) for rho in (0.05, 0.1, 0.2, 0.4)]
    assert np.all(np.diff(radii) > 0)
    assert radius_ratio(cell, radii[0]) == pytest.approx(radii[0] * np.sqrt(2), rel=1e-12)


def test_a_density_at_which_struts_are_as_thick_as_long_is_out_of_reach():
    with pytest.raises(CellError, match=r'"kelvin|tetrakaidecahedron": a relative density of 0\.9'):
        radius_of_density(unit_cell("kelvin"), 0.9)


@pytest.mark.parametrize("density", [0.0, 1.0, -0.1, np.nan])
def test_a_density_that_is_none_is_refused(density: float):
    with pytest.raises(CellError, match="must be above 0 and below 1"):
        radius_of_density(unit_cell("octet"), density)


def test_thin_lattices_have_the_moduli_of_their_textbooks():
    """Cube: a third of the struts along each axis. Square: half the walls.

    Honeycomb: E = 3/2 density^3 Es (Gibson, Ashby, Cellular Solids, 2nd edition, equation 4.12 with
    density = 2/sqrt(3) t/l), alike in all directions of the plane.
    """
    cube = homogenised_at(unit_cell("cube"), THIN, cache=NOTHING_KEPT)
    assert isinstance(cube, HomogenisedCell)
    # Two: what struts share, r/L = 0.01, and that the cube's joint model stiffens them.
    np.testing.assert_allclose(cube.stiffness.engineering_constants.E, THIN / 3, rtol=0.02)
    honeycomb = homogenised_at(unit_cell("honeycomb"), THIN, cache=NOTHING_KEPT)
    assert isinstance(honeycomb, HomogenisedPlaneCell)
    np.testing.assert_allclose(honeycomb.stiffness.polar_modulus().E, 1.5 * THIN**3, rtol=0.01)
    assert honeycomb.extruded_modulus == pytest.approx(THIN, rel=1e-8)
    square = homogenised_at(unit_cell("square"), THIN, cache=NOTHING_KEPT)
    assert isinstance(square, HomogenisedPlaneCell)
    np.testing.assert_allclose(square.stiffness.engineering_constants.E, THIN / 2, rtol=0.01)


@pytest.mark.parametrize("name", ["cube", "square"])
def test_what_is_kept_is_what_was_computed(name: str, tmp_path: Path, monkeypatch):
    cell, cache = unit_cell(name), StageCache(tmp_path)
    first = homogenised_at(cell, 0.1, cache=cache)
    monkeypatch.setattr(at_density, "radius_of_density", not_again)
    again = homogenised_at(cell, 0.1, cache=cache)
    np.testing.assert_array_equal(again.stiffness.C, first.stiffness.C)
    for field in ("radius", "nu", "density", "centre_line_density", "joint_model"):
        assert getattr(again, field) == getattr(first, field)
    with pytest.raises(AssertionError):  # another density is another key
        homogenised_at(cell, 0.11, cache=cache)


def test_only_what_is_missing_is_told_to_be_computed(tmp_path: Path):
    cells, cache = [unit_cell(name) for name in ("cube", "square", "kelvin")], StageCache(tmp_path)
    told: list[int] = []
    all_homogenised_at(cells[:1], 0.6, cache=cache, computing=told.append)
    results = all_homogenised_at(cells, 0.6, cache=cache, computing=told.append)
    all_homogenised_at(cells[:2], 0.6, cache=cache, computing=told.append)
    assert told == [1, 2]
    assert list(results) == ["cube", "square", "tetrakaidecahedron"]
    failure = results["tetrakaidecahedron"]
    assert isinstance(failure, CellError)
    assert "out of reach" in str(failure)


def test_a_density_out_of_reach_is_found_out_once(tmp_path: Path, monkeypatch):
    cell, cache = unit_cell("kelvin"), StageCache(tmp_path)
    with pytest.raises(CellError, match="out of reach") as first:
        homogenised_at(cell, 0.9, cache=cache)
    monkeypatch.setattr(at_density, "radius_of_density", not_again)
    told: list[int] = []
    again = all_homogenised_at([cell], 0.9, cache=cache, computing=told.append)
    assert str(again[cell.name]) == str(first.value)
    assert not told
    with pytest.raises(AssertionError):  # nothing is kept where nothing can be
        homogenised_at(cell, 0.9, cache=NOTHING_KEPT)


def test_a_further_cell_compiles_nothing(caplog: pytest.LogCaptureFixture):
    """So the whole library takes seconds: JAX would spend one on each cell."""
    radius = radius_of_density(unit_cell("bcc"), 0.1)
    homogenised(unit_cell("diamond"), radius)
    with jax.log_compiles():
        found = homogenised_at(unit_cell("dodecahedron"), 0.1, cache=NOTHING_KEPT)
        assert "Compiling" not in caplog.text
        # Negative control: another material is a constant of the compiled code.
        homogenised_cell(unit_cell("diamond"), radius=radius, nu=0.123)
    assert "Compiling" in caplog.text
    assert found.density == pytest.approx(0.1, rel=3e-9)


def not_again(*_: object) -> float:
    raise AssertionError("computed again")
