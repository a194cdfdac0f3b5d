"""Unit cells as homogeneous solids, and what the command line says of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fea.beam import StrutMaterial
from fea.homogenise import homogenise_frame
from fea.sections import section
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.homogenised import fitting_joint_model, homogenised_cell
from texmap_opt.cells.periodic_frame import periodic_frame
from texmap_opt.cells.rigidity import mechanisms
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.cli import main
from texmap_opt.errors import CellError

# All strains bend, some, none; in space, mirrored, and in the plane.
BY_MECHANISMS = (
    "dodecahedron",
    "bcc",
    "cube",
    "octet",
    "tetrahedron",
    "rubber-band",
    "honeycomb",
    "square",
    "kagome",
)


def stiffness(cell: UnitCell, edge: float = 1.0, radius: float = 0.05) -> np.ndarray:
    material = StrutMaterial(1.0, 0.3, section(cell.section))
    frame = periodic_frame(cell, edge=edge, radius=radius * edge, material=material)
    return homogenise_frame(frame).C


@pytest.mark.parametrize("name", ["bcc", "octet", "kelvin"])
def test_a_cell_that_is_its_own_mirror_image_may_be_tiled_either_way(name):
    """Mirrored, its period is two cells: eight times the struts, the same stiffness."""
    cell = unit_cell(name)
    expected = stiffness(cell)
    np.testing.assert_allclose(
        stiffness(replace(cell, mirrored=(True, True, True))), expected, atol=1e-11 * expected.max()
    )


def test_a_mirrored_cell_has_the_symmetry_of_its_mirrors():
    """The tetrahedron in the cube, odd cells reflected: no shear couples to anything."""
    tetrahedron = replace(
        unit_cell("cube"),
        joint_names=("a", "b", "c", "d"),
        joints=np.array([[0.0, 0, 0], [0, 1, 1], [1, 0, 1], [1, 1, 0]]),
        struts=np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]),
        relative_radius=np.linspace(0.5, 1.0, 6),
        mirrored=(True, True, True),
    )
    C = stiffness(tetrahedron)
    coupling = C.copy()
    coupling[:3, :3] = 0
    coupling[[3, 4, 5], [3, 4, 5]] = 0
    np.testing.assert_allclose(coupling, 0, atol=1e-12 * C.max())
    assert np.linalg.eigvalsh(C).min() > 0


def test_stiffness_does_not_depend_on_the_size_of_the_cell():
    cell = unit_cell("diamond")
    np.testing.assert_allclose(stiffness(cell, 7.0), stiffness(cell), rtol=1e-10, atol=1e-15)


@pytest.mark.parametrize("name", BY_MECHANISMS)
def test_how_stiffness_falls_with_the_radius_is_that_of_the_mechanisms(name):
    """Stiffness against a strain is as the area where struts stretch, else as the second moment.

    Area as r^2, second moment as r^4; of walls r and r^3.
    """
    cell = unit_cell(name)
    d = cell.dimensions
    thin, thick = (stiffness(cell, radius=r) for r in (0.001, 0.002))
    order = np.log2(np.linalg.eigvalsh(thick) / np.linalg.eigvalsh(thin))
    # Stretch beside bending leaves (r/L)^2, which is 1e-4 for the shortest struts.
    np.testing.assert_allclose(order, order.round(), atol=0.005)
    bending = int(np.sum(order.round() == {2: 3, 3: 4}[d]))
    assert bending == mechanisms(cell).strain_producing
    assert int(np.sum(order.round() == d - 1)) == len(order) - bending


def test_the_report_names_what_matters():
    octet = homogenised_cell(unit_cell("octet"), radius=0.05)
    text = octet.text()
    assert "from 0.01537 along (1, 0, 0) to 0.02696 along (1, 1, 1)" in text
    assert "centre lines 0.1333" in text
    assert "Zener ratio 1.945" in text
    assert octet.density < octet.centre_line_density


@pytest.mark.parametrize("radius", [0.0, -0.1, np.nan])
def test_a_radius_that_is_none_is_refused(radius):
    with pytest.raises(CellError, match="must be a positive number"):
        homogenised_cell(unit_cell("octet"), radius=radius)


@pytest.mark.parametrize("radius", [0.3, 2.0])
def test_struts_that_fill_the_cell_are_refused(radius):
    with pytest.raises(CellError, match=r"struts of radius .* fill the cell"):
        homogenised_cell(unit_cell("octet"), radius=radius)


def test_a_lattice_that_resists_a_strain_with_nothing_is_named():
    """Squares in planes that nothing joins do not even hang together."""
    sheets = replace(
        unit_cell("cube"),
        name="sheets",
        joint_names=("a", "b", "c", "d"),
        joints=np.array([[0.0, 0, 0.5], [0, 1, 0.5], [1, 0, 0.5], [1, 1, 0.5]]),
        struts=np.array([[0, 1], [0, 2], [1, 3], [2, 3]]),
        relative_radius=np.ones(4),
    )
    with pytest.raises(CellError, match='"sheets": The stiffness does not resist the strain'):
        homogenised_cell(sheets, radius=0.05)


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    return int(ended.value.code or 0)


def test_the_command_line_prints_the_stiffness_of_a_cell_by_any_of_its_names(capsys):
    assert run("cell", "kelvin", "--radius", "0.05") == 0
    said = capsys.readouterr().out
    assert said.startswith("tetrakaidecahedron (also called kelvin):")
    assert "universal anisotropy" in said


def test_the_command_line_draws_the_stiffness(tmp_path: Path, capsys):
    png = tmp_path / "stiffness.png"
    code = run("cell", "bcc", "--radius", "0.05", "--stiffness", str(png))
    if code:
        pytest.skip(f"this machine cannot draw: {capsys.readouterr().err}")
    assert png.stat().st_size > 10_000


def test_the_command_line_takes_a_density_and_knows_extruded_cells(tmp_path: Path, capsys):
    """Honeycomb: E = 3/2 density^3 Es for thin walls, isotropic; its axis has Voigt's bound."""
    png = tmp_path / "honeycomb.png"
    assert run("cell", "honeycomb", "--density", "0.1", "--stiffness", str(png)) == 0
    said = capsys.readouterr().out
    assert "2.5-D, extruded; 7 joints, 7 struts (wall); edges 1 x 1.732; hexagonal" in said
    assert "density   0.1 (centre lines 0.102" in said
    assert "0.001548 along y, 0.1 along the axis of extrusion" in said
    assert png.stat().st_size > 10_000


def test_the_command_line_wants_a_radius_for_the_picture(capsys):
    assert run("cell", "bcc", "--stiffness", "x.png") == 2
    assert "--stiffness needs --radius" in capsys.readouterr().err
    assert run("cell", "bcc", "--radius", "0.05", "--density", "0.1") == 2
    assert "--radius and --density were both given" in capsys.readouterr().err


def test_the_command_stiffens_joints_where_the_cell_was_fitted_to_such_struts(capsys):
    """Octet, r/L up to 0.134 of edges/sqrt(2); beyond, and for cells without a model, it says so."""
    for name, radius, words in (
        ("octet", "0.05", "fitted to solids, within 5.4 %"),
        ("octet", "0.12", "thicker than the joint model was fitted to"),
        ("diamond", "0.05", "no joint model"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(["cell", name, "--radius", radius])
        assert ended.value.code == 0
        assert words in capsys.readouterr().out
    cell = unit_cell("octet")
    plain = homogenised_cell(cell, radius=0.05)
    fitted = homogenised_cell(cell, radius=0.05, joint_model=fitting_joint_model(cell, 0.05))
    E = [each.stiffness.engineering_constants.E[0] for each in (plain, fitted)]
    assert 1.05 < E[1] / E[0] < 1.2
