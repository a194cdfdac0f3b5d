"""Results of other programs as a driver: what is read, what it becomes, what is refused."""

from dataclasses import replace

import meshio
import numpy as np
import pytest
import pyvista

from fea.voigt import tensor, turned_stress, von_mises
from texmap_opt.box import Box
from texmap_opt.errors import CaseError
from texmap_opt.warp.grid import Grid
from texmap_opt.warp.least_squares import LeastSquares
from texmap_opt.warp.quality import achieved_sizes, log_fit, wanted_sizes
from texmap_opt.warping_function.background_grid import BackgroundGrid
from texmap_opt.warping_function.imported import ORDERS, imported_driver, read_imported
from texmap_opt.warping_function.size_law import SizeLaw
from texmap_opt.warping_function.stress_driver import (
    StressSamples,
    largest_principal,
    stress_driver,
)

WHERE = "case.toml: [imported]"
PART = np.array([8.0, 4.0, 4.0])
BOX = Box.aligned(np.stack([np.full(3, -1.0), PART + 1]))
GRID = BackgroundGrid.covering(BOX, 1.0)
INSIDE = PART * np.random.default_rng(0).random((300, 3))
SIZED = BOX.low + BOX.extent * np.random.default_rng(1).random((100, 3))

# Column of each of ours, xx, yy, zz, yz, xz, xy, by the names in the file.
VTK = ["XX", "YY", "ZZ", "XY", "YZ", "XZ"]
OURS = ["XX", "YY", "ZZ", "YZ", "XZ", "XY"]


def stress_at(points):
    """Six different fields, in our Voigt order [MPa]."""
    x, y, z = points.T / 4
    return np.stack([1 + x, 2 - y, 0.5 * z, y * z, 0.3 + 0 * x, np.sin(x)], axis=1)


def to_vtk(stress):
    return stress[:, [OURS.index(name) for name in VTK]]


def hexahedra(cells=(16, 8, 8)):
    """The part as PyVista would hold another program's results."""
    axes = [np.linspace(0, length, n + 1) for length, n in zip(PART, cells, strict=True)]
    mesh = pyvista.StructuredGrid(*np.meshgrid(*axes, indexing="ij")).cast_to_unstructured_grid()
    stress, centre = stress_at(np.asarray(mesh.points)), np.asarray(mesh.cell_centers().points)
    mesh.point_data["S"] = to_vtk(stress)
    mesh.point_data["full"] = tensor(stress).reshape(-1, 9)
    mesh.point_data["S_Mises"] = von_mises(stress)
    mesh.point_data["U"] = np.zeros((mesh.n_points, 3))
    mesh.cell_data["S_cell"] = to_vtk(stress_at(centre))
    mesh.cell_data["energy"] = 1.0 + centre[:, 0]
    return mesh


def read(path, field="S", *, values=None, unit="mm", order=None):
    return read_imported(path, field=field, values=values, unit=unit, order=order, where=WHERE)


def function(imported, *, grid=GRID, points=INSIDE, law=None, **options):
    field = imported_driver(imported, grid, smoothing_mm=1.0, part_points=points, **options)
    return field.function(grid, law or SizeLaw(contrast=6.0))


@pytest.fixture(scope="module")
def vtu(tmp_path_factory):
    path = tmp_path_factory.mktemp("results") / "results.vtu"
    hexahedra().save(path)
    return path


@pytest.fixture(scope="module")
def own():
    """What the same stress drives when it is this program's own: the answer to all forms of it."""
    mesh = hexahedra()
    points = np.asarray(mesh.points)
    volumes = np.zeros(mesh.n_points)
    np.add.at(volumes, mesh.cell_connectivity.reshape(-1, 8), 1 / 8)
    samples = StressSamples(points, volumes, stress_at(points)[None])
    return stress_driver(samples, GRID, smoothing_mm=1.0).function(GRID, SizeLaw(contrast=6.0))


def test_a_vtu_of_pyvista_drives_like_the_programs_own_stress(vtu, own):
    imported = read(vtu)
    assert imported.is_stress
    f = function(imported)
    np.testing.assert_allclose(f.size(SIZED), own.size(SIZED), rtol=1e-9)
    np.testing.assert_allclose(f.stress(SIZED), own.stress(SIZED), atol=1e-9)


def test_nine_components_are_the_tensor_row_by_row(vtu, own):
    np.testing.assert_allclose(
        function(read(vtu, "full")).stress(SIZED), own.stress(SIZED), atol=1e-9
    )


def test_a_scalar_drives_the_size_alone(vtu, own):
    imported = read(vtu, "S_Mises")
    assert not imported.is_stress
    f = function(imported)
    assert f.cases == 0
    # log f of the driver by stress is the same, but for its floor that nothing here comes near.
    np.testing.assert_allclose(f.size(SIZED), own.size(SIZED), rtol=1e-9)


def test_values_of_cells_lie_at_their_centres_and_count_by_their_volume(vtu, own):
    imported = read(vtu, "S_cell")
    np.testing.assert_allclose(imported.volumes.sum(), PART.prod(), rtol=1e-6)
    sizes = function(imported).size(SIZED)
    # Another sampling of the same field, half a cell of 0.5 mm off, smoothed over 1 mm.
    np.testing.assert_allclose(sizes, own.size(SIZED), rtol=0.02)


@pytest.mark.parametrize("place", ["nodes", "cells"])
def test_a_place_between_coarse_and_fine_cells_takes_the_mean_of_both(tmp_path, place):
    """Log f is 0 in a half of cells of 1 mm and 1 in a half of 1/8 mm; at their border it is 1/2."""
    axes = [np.append(np.arange(4.0), np.linspace(4, 8, 33)), np.arange(5.0), np.arange(5.0)]
    mesh = pyvista.StructuredGrid(*np.meshgrid(*axes, indexing="ij")).cast_to_unstructured_grid()
    # A ninth of the volume of a node on the border is in the fine half.
    for data, points in (
        (mesh.point_data, np.asarray(mesh.points)),
        (mesh.cell_data, np.asarray(mesh.cell_centers().points)),
    ):
        data[f"f in {len(points)}"] = np.exp(np.heaviside(points[:, 0] - 4, 1 / 9))
    path = tmp_path / "results.vtu"
    mesh.save(path)
    count = mesh.n_points if place == "nodes" else mesh.n_cells
    imported, border = read(path, f"f in {count}"), np.array([[4.0, 2.0, 2.0]])

    def log_f(imported):
        return float(function(imported, law=SizeLaw(contrast=100.0)).log_f(border)[0, 0])

    # Layers of cells 1 mm thick stand for a Gaussian of 1 mm to 2 %.
    np.testing.assert_allclose(log_f(imported), 0.5, atol=0.02)
    # Were all values to count alike, the fine half with its 8 times as many would have its way.
    alike = replace(imported, volumes=np.ones(count))
    assert log_f(alike) > 0.8


def test_another_measure_may_be_taken(vtu):
    by_principal = function(read(vtu), measure=largest_principal).size(SIZED)
    assert np.abs(by_principal - function(read(vtu)).size(SIZED)).max() > 0.01


@pytest.mark.parametrize("order", sorted(ORDERS))
def test_the_order_of_six_components_is_that_which_is_asked_for(tmp_path, own, order):
    """VTK's XX, YY, ZZ, XY, YZ, XZ; Abaqus' 11, 22, 33, 12, 13, 23; and our own."""
    names = {"vtk": VTK, "abaqus": ["XX", "YY", "ZZ", "XY", "XZ", "YZ"], "voigt": OURS}[order]
    mesh = hexahedra()
    mesh.point_data["S"] = stress_at(np.asarray(mesh.points))[:, [OURS.index(n) for n in names]]
    mesh.save(tmp_path / "results.vtu")
    f = function(read(tmp_path / "results.vtu", order=order))
    np.testing.assert_allclose(f.stress(SIZED), own.stress(SIZED), atol=1e-9)
    other = "abaqus" if order == "vtk" else "vtk"
    wrong = function(read(tmp_path / "results.vtu", order=other)).stress(SIZED)
    assert np.abs(wrong - own.stress(SIZED)).max() > 0.01


@pytest.mark.parametrize("suffix", [".vtk", ".xdmf", ".msh"])
def test_other_formats_drive_the_same(tmp_path, own, suffix):
    mesh, path = hexahedra(), tmp_path / f"results{suffix}"
    cells = [("hexahedron", mesh.cell_connectivity.reshape(-1, 8))]
    full = np.asarray(mesh.point_data["full"])
    written = meshio.Mesh(np.asarray(mesh.points, np.float64), cells, point_data={"full": full})
    if suffix == ".vtk":
        mesh.save(path)
    elif suffix == ".xdmf":
        meshio.xdmf.write(path, written, data_format="XML")
    else:
        meshio.gmsh.write(str(path), written)
    found = function(read(path, "full")).stress(SIZED)
    # XDMF as XML is written with some digits less.
    np.testing.assert_allclose(found, own.stress(SIZED), atol=1e-6)


def table(columns):
    head, values = ",".join(columns), np.column_stack(list(columns.values()))
    return "\n".join([head, *(",".join(f"{v:.17g}" for v in row) for row in values)]) + "\n"


def test_a_csv_of_points_drives_by_scalar_or_tensor(tmp_path, own):
    points = np.asarray(hexahedra().points, np.float64)
    stress = stress_at(points)
    columns = dict(zip("xyz", points.T, strict=True)) | {"S_Mises": von_mises(stress)}
    columns |= {f"S{'XYZ'.index(a) + 1}{'XYZ'.index(b) + 1}": v for (a, b), v in zip(OURS, stress.T, strict=True)}  # fmt: skip # noqa: E501
    path = tmp_path / "points.csv"
    path.write_text(table(columns))
    # Weights by density instead of cells: points on the part's faces count up to 3 times as much.
    np.testing.assert_allclose(function(read(path)).size(SIZED), own.size(SIZED), rtol=0.05)
    there = function(read(path)).direction(SIZED)
    np.testing.assert_allclose(there, own.direction(SIZED), atol=0.05)
    by_scalar = function(read(path, "S_Mises"))
    np.testing.assert_allclose(by_scalar.size(SIZED), function(read(path)).size(SIZED), rtol=1e-9)


def test_dense_points_of_a_csv_count_less(tmp_path):
    """Half of the space with 16 times the points: the weights of both halves are alike."""
    random = np.random.default_rng(0)
    few, many = random.random((500, 3)), random.random((8000, 3)) + np.eye(3)[0]
    points = np.concatenate([few, many])
    path = tmp_path / "points.csv"
    path.write_text(table(dict(zip("xyz", points.T, strict=True)) | {"f": np.ones(8500)}))
    volumes = read(path, "f").volumes
    # The neighbour of rank 8 reaches over the faces of the few: they count up to twice too much.
    assert 0.5 < volumes[:500].sum() / volumes[500:].sum() < 2.5


DECK_NODES, DECK_STEP = 3, 5  # numbers in the deck neither start at 1 nor follow one another


def deck(tmp_path, mesh):
    ids = DECK_NODES + DECK_STEP * np.arange(mesh.n_points)
    nodes = "\n".join(f"{i}, {x!r}, {y!r}, {z!r}" for i, (x, y, z) in zip(ids.tolist(), np.asarray(mesh.points, np.float64).tolist(), strict=True))  # fmt: skip # noqa: E501
    rows = ids[mesh.cell_connectivity.reshape(-1, 8)]
    elements = "\n".join(
        f"{k + 100}, {', '.join(map(str, row))}" for k, row in enumerate(rows.tolist())
    )
    path = tmp_path / "mesh.inp"
    path.write_text(f"*NODE\n{nodes}\n*ELEMENT, TYPE=C3D8\n{elements}\n")
    return path, ids


def test_an_inp_mesh_takes_its_values_by_node_number(tmp_path, own):
    mesh = hexahedra()
    path, ids = deck(tmp_path, mesh)
    stress = stress_at(np.asarray(mesh.points, np.float64))
    names = ["11", "22", "33", "12", "13", "23"]
    ours = ["11", "22", "33", "23", "13", "12"]
    shuffle = np.random.default_rng(0).permutation(len(ids))
    numbered = {f"S_{k}": stress[:, ours.index(name)] for k, name in enumerate(names)}
    values = tmp_path / "values.csv"
    values.write_text(table({k: v[shuffle] for k, v in ({"Node": ids} | numbered).items()}))
    f = function(read(path, values=values))  # Abaqus' order is what an INP mesh is taken to mean
    np.testing.assert_allclose(f.stress(SIZED), own.stress(SIZED), atol=1e-9)
    np.testing.assert_allclose(f.size(SIZED), own.size(SIZED), rtol=1e-9)


def test_an_inp_mesh_takes_its_values_by_element_and_averages_integration_points(tmp_path, vtu):
    mesh = hexahedra()
    path, _ = deck(tmp_path, mesh)
    numbers = np.repeat(np.arange(mesh.n_cells) + 100, 2)
    around = np.repeat(np.asarray(mesh.cell_data["energy"]), 2) + np.tile([-0.5, 0.5], mesh.n_cells)
    values = tmp_path / "values.csv"
    values.write_text(table({"Element Label": numbers, "IntPt": numbers, "e": around}))
    f = function(read(path, "e", values=values))
    expected = function(read(vtu, "energy")).size(SIZED)
    # PyVista's points are of single precision.
    np.testing.assert_allclose(f.size(SIZED), expected, rtol=1e-6)
    # Elements without a row are left out, and then do not cover the part.
    values.write_text(table({"element": numbers[:400], "e": around[:400]}))
    with pytest.raises(CaseError, match="does not cover the part"):
        function(read(path, "e", values=values))
    values.write_text(table({"element": numbers + 1, "e": around}))
    with pytest.raises(CaseError, match=r"values\.csv: element 1124 and 1 more of 2048 rows"):
        read(path, "e", values=values)


@pytest.mark.parametrize(("unit", "mm"), [("m", 1000.0), ("cm", 10.0), ("in", 25.4)])
def test_the_unit_of_the_file_is_that_of_its_coordinates(tmp_path, own, unit, mm):
    mesh = hexahedra()
    mesh.points = np.asarray(mesh.points, np.float64) / mm
    path = tmp_path / "results.vtu"
    mesh.save(path)
    np.testing.assert_allclose(
        function(read(path, unit=unit)).size(SIZED), own.size(SIZED), rtol=1e-9
    )
    with pytest.raises(CaseError, match=f'is its unit "{unit}" instead of "mm"') as failure:
        function(read(path))
    assert "the part (0" in str(failure.value) and str(failure.value).endswith('"mm"?')


@pytest.mark.parametrize("dimensions", [3, 2])
def test_turning_results_and_box_turns_nothing_in_the_box_s_own_axes(tmp_path, dimensions):
    R = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    R *= np.sign(np.linalg.det(R))
    mesh = hexahedra()
    points = np.asarray(mesh.points, np.float64)
    mesh.points, still = points, tmp_path / "still.vtu"
    mesh.save(still)
    mesh.point_data["S"] = to_vtk(turned_stress(stress_at(points), R[None]))
    mesh.points = points @ R.T
    mesh.save(tmp_path / "turned.vtu")
    box = Box(np.eye(3), BOX.bounds, dimensions)
    turned = Box(R.T.copy(), BOX.bounds, dimensions)
    f = function(read(still), grid=BackgroundGrid.covering(box, 1.0))
    g = function(
        read(tmp_path / "turned.vtu"),
        grid=BackgroundGrid.covering(turned, 1.0),
        points=INSIDE @ R.T,
    )
    at = box.coordinates(SIZED)
    np.testing.assert_allclose(g.size(at), f.size(at), rtol=1e-10)
    np.testing.assert_allclose(g.stress(at), f.stress(at), atol=1e-10)


def test_results_of_the_rest_of_an_assembly_are_left_out(tmp_path, vtu):
    """They would otherwise pile up at the border of the grid."""
    mesh = hexahedra()
    other = mesh.copy()
    other.points = np.asarray(other.points) + 30 * np.eye(3)[0]
    other.point_data["S"] = 1000 * np.asarray(other.point_data["S"])[::-1]
    path = tmp_path / "assembly.vtu"
    mesh.merge(other).save(path)
    found, alone = function(read(path)), function(read(vtu))
    np.testing.assert_allclose(found.size(SIZED), alone.size(SIZED), rtol=1e-9)


def test_a_coarse_mesh_covers_the_part_though_its_nodes_are_far_apart(tmp_path):
    path = tmp_path / "results.vtu"
    hexahedra((2, 1, 1)).save(path)
    function(read(path))
    function(read(path, "S_cell"))


def test_nodes_without_a_cell_do_not_count(tmp_path, own):
    """The centre of a rigid coupling, say: without stress, and far away."""
    mesh = hexahedra()
    points = np.concatenate([np.asarray(mesh.points, np.float64), [[500.0, 0, 0]]])
    values = np.append(von_mises(stress_at(points[:-1])), 0.0)
    cells = [("hexahedron", mesh.cell_connectivity.reshape(-1, 8))]
    path = tmp_path / "results.vtu"
    meshio.vtu.write(str(path), meshio.Mesh(points, cells, point_data={"S_Mises": values}))
    sizes = function(read(path, "S_Mises")).size(SIZED)
    np.testing.assert_allclose(sizes, own.size(SIZED), rtol=1e-9)


def test_an_imported_vtu_drives_the_warp(vtu):
    """Cells have the size that the results ask for, from coarse to fine."""
    grid = Grid.uniform(BOX, (8, 5, 5))
    f = function(read(vtu, "energy"), law=SizeLaw(contrast=2.0))
    warped = LeastSquares().fit(grid, f)
    assert warped.converged
    slope, correlation = log_fit(wanted_sizes(warped.grid, f), achieved_sizes(warped.grid))
    assert slope is not None
    assert correlation is not None
    # 0.92 here: shape holds back the sizes of cells between faces that stay (docs/theory/warp.md).
    np.testing.assert_allclose(slope, 1, atol=0.1)
    assert correlation > 0.9


def broken(tmp_path, name, values):
    mesh = hexahedra((4, 2, 2))
    mesh.point_data[name] = values(mesh.n_points)
    mesh.save(tmp_path / "results.vtu")
    return tmp_path / "results.vtu"


def test_a_field_that_is_not_there_is_refused_with_those_that_are(vtu):
    with pytest.raises(CaseError) as failure:
        read(vtu, "S_mises")
    said = str(failure.value)
    assert said.startswith(f'{WHERE} field = "S_mises": results.vtu has no such field, only')
    for there in (
        '"S" (6 components at nodes)',
        '"S_Mises" (1 component at nodes)',
        '"energy" (1 component in cells)',
    ):
        assert there in said


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (lambda n: np.zeros(n), "is not positive at 45 of 45 points, the least being 0"),
        (lambda n: np.arange(n) - 2.5, "is not positive at 3 of 45 points, the least being -2.5"),
        (lambda n: np.where(np.arange(n) < 4, np.nan, 1.0), "not a finite number at 4 of 45"),
        (lambda n: np.where(np.arange(n) < 4, np.inf, 1.0), "not a finite number at 4 of 45"),
        (lambda n: np.ones((n, 3)), "has 3 components; give a scalar, or a stress with 6 or 9"),
        (lambda n: np.ones((n, 7)), "has 7 components"),
        (lambda n: np.tile(np.arange(9.0), (n, 1)), "halves differ by up to 4, so no stress"),
    ],
)
def test_values_that_cannot_drive_are_refused(tmp_path, values, words):
    with pytest.raises(CaseError, match=words):
        read(broken(tmp_path, "v", values), "v")


@pytest.mark.parametrize("components", [6, 9])
def test_a_stress_of_zero_everywhere_is_refused_with_its_file(tmp_path, components):
    path = broken(tmp_path, "v", lambda n: np.zeros((n, components)))
    with pytest.raises(CaseError, match=r'"v" of results\.vtu is zero at all 45 points') as failure:
        read(path, "v")
    assert str(failure.value).startswith(WHERE)


def test_a_stress_of_zero_all_over_the_part_is_refused_though_its_neighbour_has_one(tmp_path):
    mesh = hexahedra()
    mesh.point_data["S"] = np.zeros((mesh.n_points, 6))
    other = hexahedra()
    other.points = np.asarray(other.points) + 30 * np.eye(3)[0]
    path = tmp_path / "assembly.vtu"
    mesh.merge(other).save(path)
    with pytest.raises(CaseError, match=r'"S" of assembly\.vtu is zero at all 1377 points'):
        function(read(path))


def test_results_elsewhere_are_refused_with_both_places(vtu):
    with pytest.raises(CaseError) as failure:
        function(read(vtu), points=INSIDE + 3 * np.eye(3)[1])
    said = str(failure.value)
    assert '"S" of results.vtu does not cover the part' in said
    assert "(0, 0, 0) to (8, 4, 4) mm" in said and said.endswith("same place.")


def test_results_of_half_the_part_are_refused_and_a_missing_corner_is_not(vtu):
    longer = INSIDE * [2.0, 1, 1]
    with pytest.raises(CaseError, match=r"4[0-9] % of it is more than"):
        function(read(vtu), points=longer)
    corner = np.concatenate([INSIDE, [[9.0, 5.0, 5.0]]])  # one of 301 points
    function(read(vtu), points=corner)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("none.vtu", {}, "is not a file; check the path"),
        ("results.odb", {}, r"read from \.vtu, .*, \.csv and \.inp, not from"),
        ("results.vtu", {"unit": "ft"}, 'unit = "ft"'),
        ("results.vtu", {"order": "vtu"}, 'order = "vtu": did you mean "vtk"'),
        ("mesh.inp", {}, "values: mesh.inp is a mesh without values"),
        ("results.vtu", {"values": "values.csv"}, "holds its values itself"),
        ("results.vtu", {}, "cannot be read as a result"),
        ("points.csv", {"field": "f"}, "has no column z, only x, y, f"),
        ("points.csv", {"field": "g"}, r'no such field, only "x" \(1 component\)'),
        ("mesh.inp", {"values": "points.csv", "field": "f"}, "has no column node or element"),
    ],
)
def test_impossible_requests_are_refused(tmp_path, name, options, words):
    (tmp_path / "results.vtu").write_text("not a mesh")
    (tmp_path / "points.csv").write_text("x,y,f\n1,2,3\n")
    (tmp_path / "values.csv").write_text("node,f\n1,2\n")
    (tmp_path / "mesh.inp").write_text(
        "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n*ELEMENT,TYPE=C3D4\n1,1,2,3,4\n"
    )
    if "values" in options:
        options = {**options, "values": tmp_path / options["values"]}
    with pytest.raises(CaseError, match=words) as failure:
        read(tmp_path / name, **options)
    assert str(failure.value).startswith(WHERE)
