"""What a case's drivers make of stress, paint and imported results, and what a stored warp hangs on."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sound_case import BOX, FACES, case_of, write_stl

from fea import TetMesh
from texmap_opt.cache import stage_key
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.endless_lattice import endless_lattice
from texmap_opt.errors import CaseError
from texmap_opt.given_drivers import given_drivers
from texmap_opt.grid_plan import plan_grid
from texmap_opt.part import Part
from texmap_opt.part_box import part_box
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.stress_field import StressField
from texmap_opt.warp.driving_function import driving_function
from texmap_opt.warp_inputs import WarpInputs, warp_inputs

PART = Part(TriMesh(BOX, FACES), "box")
MESH = TetMesh.box((40.0, 20.0, 20.0), (8, 4, 4))
ALONG_X = np.array([[12.0, 10, 10], [28.0, 10, 10]])
# Two load cases: tension along x that grows with x, and one that falls with it.
GROWING = np.exp(MESH.nodes[:, 0] / 80)
FALLING = 1.5 * np.exp(-MESH.nodes[:, 0] / 80)
SECOND = """[[load]]
case = "pull"
region = { plane = { point = [40, 0, 0], normal = [1, 0, 0] } }
force_N = [10, 0, 0]
"""


def inputs(
    folder: Path, warp: str, *tensions: np.ndarray, method: str = 'method = "uniform"'
) -> WarpInputs:
    """Of the sound case, two load cases, with tensions along x in place of an analysis."""
    more = ('method = "uniform"\n', f"{method}\ncontrast = 10.0\n{warp}\n")
    case = case_of(folder, ("[lattice]", f"{SECOND}[lattice]"), more)
    stress = np.zeros((len(tensions), len(MESH.nodes), 6))
    stress[..., 0] = tensions
    zeros = np.zeros((len(tensions), len(MESH.nodes), 3))
    names = case.load_cases[: len(tensions)]
    field = StressField(MESH, names, zeros, stress, zeros, zeros[:, 0], zeros[:, 0, 0], 0.0, 0.0)
    cell = unit_cell("bcc")
    plan = plan_grid(case, part_box(case, PART.surface, cell), cell)
    lattice = endless_lattice(case, plan, cell)
    return warp_inputs(case, PART, field, plan.grid, lattice, given_drivers(case, plan.grid))


def growth(folder: Path, warp: str, *tensions: np.ndarray) -> float:
    """Log of f at one point over that at another, 16 mm on."""
    function = driving_function(inputs(folder, warp, *tensions))
    low, high = np.log(np.asarray(function.f(ALONG_X)))
    return float(high - low)


@pytest.mark.parametrize(("driver", "power"), [("principal", 1), ("strain-energy", 2)])
def test_a_driver_is_a_measure_of_the_stress(tmp_path: Path, driver: str, power: int):
    """Uniaxial tension s: von Mises and principal stress s, energy s²/2E; all smoothed alike.

    The limit of the contrast takes 1e-4 of the steeper one.
    """
    von_mises = growth(tmp_path, 'driver = ["von-mises"]', GROWING)
    # 16/80 less what smoothing over 10 mm takes from the ends of a part of 40 mm.
    assert 0.1 < von_mises < 0.2
    measured = growth(tmp_path, f'driver = ["{driver}"]', GROWING)
    np.testing.assert_allclose(measured, power * von_mises, rtol=1e-3)


def test_weights_are_powers_in_a_product(tmp_path: Path):
    both = 'driver = ["von-mises", "strain-energy"]\ndriver_weights = [0.5, 0.25]'
    alone = growth(tmp_path, "", GROWING)
    np.testing.assert_allclose(growth(tmp_path, both, GROWING), alone, rtol=1e-3)


def test_drivers_combine_as_asked(tmp_path: Path):
    """Tension s and energy s²: the maximum is s² at one end and s at the other, the sum between."""
    drivers = 'driver = ["von-mises", "strain-energy"]\n'
    product = growth(tmp_path, drivers, GROWING)
    alone = growth(tmp_path, "", GROWING)
    np.testing.assert_allclose(product, 3 * alone, rtol=1e-3)
    for how in ("maximum", "sum"):
        combined = growth(tmp_path, f'{drivers}combine = "{how}"', GROWING)
        assert 1.2 * alone < combined < 1.8 * alone


def test_load_cases_are_the_worst_or_the_sum_by_their_weights(tmp_path: Path):
    """The falling case, weighted by 10, is the worst everywhere; the sum of both hardly varies."""
    alone = growth(tmp_path, "", GROWING)
    falls = growth(tmp_path, "case_weights = { pull = 10.0 }", GROWING, FALLING)
    np.testing.assert_allclose(falls, -alone, rtol=1e-3)
    grows = growth(tmp_path, "case_weights = { pull = 0.0 }", GROWING, FALLING)
    np.testing.assert_allclose(grows, alone, rtol=1e-3)
    summed = growth(tmp_path, 'load_cases = "sum"', GROWING, FALLING)
    assert abs(summed) < 0.3 * alone


def test_an_imported_table_drives_like_the_stress_it_holds(tmp_path: Path):
    """In centimetres; its points have other volumes than the mesh's nodes, so within a quarter."""
    table = np.column_stack([MESH.nodes / 10, 3 * GROWING])
    np.savetxt(tmp_path / "f.csv", table, delimiter=",", header="x,y,z,f", comments="")
    warp = 'driver = ["file"]\n[imported]\nfile = "f.csv"\nfield = "f"\nunit = "cm"'
    measured = growth(tmp_path, warp, GROWING)
    np.testing.assert_allclose(measured, growth(tmp_path, "", GROWING), rtol=0.25)


def test_a_stress_turns_cells_and_a_scalar_does_not(tmp_path: Path):
    names = "x,y,z,f,S11,S22,S33,S12,S13,S23"
    stress = np.zeros((len(MESH.nodes), 6))
    stress[:, 0] = GROWING
    table = np.column_stack([MESH.nodes, GROWING, stress])
    np.savetxt(tmp_path / "f.csv", table, delimiter=",", header=names, comments="")
    warp = 'alignment = 2.0\ndriver = ["file"]\n[imported]\nfile = "f.csv"\nfield = '
    function = driving_function(inputs(tmp_path, warp + '"S"', GROWING))
    assert function.cases == 1
    S = np.asarray(function.direction(ALONG_X))[0]
    # The deviator of a tension along x, over its norm.
    np.testing.assert_allclose(S[:, 0, 0], 2 / 3, rtol=0.01)
    with pytest.raises(CaseError, match="without a tensor"):
        inputs(tmp_path, warp + '"f"', GROWING)


ALIGNED = 'method = "least-squares"\nalignment = 2.0'


def test_the_lattice_counts_only_where_its_stiffness_turns_the_cells(tmp_path: Path):
    """So that another radius starts from the stored warp wherever it may."""
    turned = inputs(tmp_path, "", GROWING, method=ALIGNED)
    assert turned.lattice is not None
    # Bcc is stiffest along its diagonals: Zener ratio far above 1.
    assert turned.lattice.stiffness.zener_ratio > 2
    for method in ('method = "uniform"', ALIGNED + '\ntarget = "axes"', 'method = "least-squares"'):
        assert inputs(tmp_path, "", GROWING, method=method).lattice is None


def test_a_stored_warp_that_is_turned_hangs_on_the_lattice(tmp_path: Path):
    turned = inputs(tmp_path, "", GROWING, method=ALIGNED)
    assert turned.lattice is not None
    other = ({"cell": unit_cell("cube")}, {"radius": 0.1}, {"nu": 0.2}, {"joint_model": False})
    keys = {
        stage_key("warp", replace(turned, lattice=replace(turned.lattice, **changed)))
        for changed in ({}, *other)
    }
    assert len(keys) == 1 + len(other)


@pytest.mark.parametrize(
    "changed",
    [
        "axes = [[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]]",
        'fixed_faces = ["-x"]',
        "smoothing_cells = 1.5",
        "case_weights = { pull = 2.0 }",
        'target = "axes"',
        'driver = ["paint"]\n[[paint]]\nregion = { stl = "tool.stl" }\nvalue = 3',
        'driver = ["paint"]\n[[paint]]\nregion = { stl = "tool.stl" }\nvalue = 2\nfalloff_mm = 9',
    ],
)
def test_a_stored_warp_is_not_that_of_another_request(tmp_path: Path, changed: str):
    write_stl(tmp_path / "tool.stl", BOX / 2, FACES)
    painted = 'driver = ["paint"]\n[[paint]]\nregion = { stl = "tool.stl" }\nvalue = 2'
    before = stage_key("warp", inputs(tmp_path, painted, GROWING, FALLING))
    assert before == stage_key("warp", inputs(tmp_path, painted, GROWING, FALLING))
    assert before != stage_key("warp", inputs(tmp_path, changed, GROWING, FALLING))


def test_a_stored_warp_hangs_on_the_content_of_files(tmp_path: Path):
    write_stl(tmp_path / "tool.stl", BOX / 2, FACES)
    np.savetxt(
        tmp_path / "f.csv", np.column_stack([MESH.nodes, GROWING]), delimiter=",",
        header="x,y,z,f", comments="",
    )  # fmt: skip
    warp = """driver = ["paint", "file"]
[[paint]]
region = { stl = "tool.stl" }
value = 2
[imported]
file = "f.csv"
field = "f"
"""
    given = inputs(tmp_path, warp, GROWING)
    keys = [stage_key("warp", given)]
    write_stl(tmp_path / "tool.stl", BOX / 4, FACES)
    keys.append(stage_key("warp", inputs(tmp_path, warp, GROWING)))
    np.savetxt(
        tmp_path / "f.csv", np.column_stack([MESH.nodes, FALLING]), delimiter=",",
        header="x,y,z,f", comments="",
    )  # fmt: skip
    keys.append(stage_key("warp", inputs(tmp_path, warp, GROWING)))
    assert len(set(keys)) == 3
