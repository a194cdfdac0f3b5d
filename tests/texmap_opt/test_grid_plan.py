"""The box around a part, how many cells a case asks for, and the radius that a density stands for."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sound_case import BOX as CORNERS
from sound_case import FACES, case_of

from texmap_opt.box import Box
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.errors import CaseError
from texmap_opt.grid_plan import plan_grid
from texmap_opt.part_box import part_box, principal_axes_of_solid
from texmap_opt.solid.tri_mesh import TriMesh

MIDDLE = np.array([7.0, -3.0, 11.0])
BOX = Box.aligned(np.array([[0.0, 0.0, 0.0], [40.0, 20.0, 20.0]]))


def test_cells_cover_the_part_and_the_margin_surrounds_it(tmp_path: Path):
    plan = plan_grid(case_of(tmp_path), BOX, unit_cell("bcc"))
    assert plan.grid.cells == (6, 4, 4)
    np.testing.assert_allclose(plan.grid.box.bounds, [[-10, -10, -10], [50, 30, 30]])
    assert plan.radius_mm == 0.8


def test_without_margin_the_box_shrinks_by_the_radius(tmp_path: Path):
    case = case_of(tmp_path, ('"uniform"', '"uniform"\nmargin_cells = 0'))
    plan = plan_grid(case, BOX, unit_cell("bcc"))
    np.testing.assert_allclose(plan.grid.box.bounds, [[0.8, 0.8, 0.8], [39.2, 19.2, 19.2]])


@pytest.mark.parametrize(
    ("cell", "length"),
    [
        ("cube", 3.0),
        ("bcc", 4 * np.sqrt(3)),
        ("octet", 24 / np.sqrt(2)),
        ("octahedron", 12 / np.sqrt(2)),
    ],
)
def test_a_density_is_the_radius_of_the_centre_line_formula(
    tmp_path: Path, cell: str, length: float
):
    """Rho = pi r² L / a³ with L the strut length of one cell of an endless lattice, edge a = 10."""
    case = case_of(tmp_path, ("radius_mm = 0.8", "relative_density = 0.1"))
    plan = plan_grid(case, BOX, unit_cell(cell))
    assert np.pi * plan.radius_mm**2 * length * 10 / 1000 == pytest.approx(0.1, rel=1e-9)


def test_more_cells_than_a_machine_holds_are_refused(tmp_path: Path):
    case = case_of(tmp_path, ("cell_mm = 10.0", "cells = [400, 200, 200]"))
    with pytest.raises(CaseError, match="larger cells"):
        plan_grid(case, BOX, unit_cell("bcc"))


def test_a_warp_needs_two_cells_along_every_axis(tmp_path: Path):
    flat = ("cell_mm = 10.0", "cells = [4, 2, 1]")
    one = case_of(tmp_path, flat, ('"uniform"', '"least-squares"\nmargin_cells = 0'))
    with pytest.raises(CaseError, match="nothing to move along z"):
        plan_grid(one, BOX, unit_cell("bcc"))
    margin = case_of(tmp_path, flat, ('"uniform"', '"least-squares"'))
    assert plan_grid(margin, BOX, unit_cell("bcc")).grid.cells == (6, 4, 3)
    uniform = case_of(tmp_path, flat, ('"uniform"', '"uniform"\nmargin_cells = 0'))
    assert plan_grid(uniform, BOX, unit_cell("bcc")).grid.cells == (4, 2, 1)


def test_nodes_of_fixed_faces_may_not_move(tmp_path: Path):
    case = case_of(tmp_path, ('"uniform"', '"uniform"\nfixed_faces = ["-y", "+z"]'))
    free = plan_grid(case, BOX, unit_cell("bcc")).grid.free
    assert not free[:, :, 0].any()
    assert not free[:, :, :, -1].any()
    # Sliding in the face x = low: everything but along x, away from the fixed faces.
    assert not free[0, 0].any()
    assert free[1:, 0, 1:-1, 1:-1].all()


def brick(extent: tuple[float, float, float], turn: Rotation) -> TriMesh:
    """A turned cuboid with its middle at `MIDDLE`."""
    corners = (CORNERS / [40, 20, 20] - 0.5) * extent
    return TriMesh(turn.apply(corners) + MIDDLE, FACES)


def test_principal_axes_are_those_of_a_turned_brick():
    turn = Rotation.from_rotvec([0.3, -0.5, 0.4])
    axes = principal_axes_of_solid(brick((40, 20, 10), turn))
    # Unit vectors up to sign, the longest edge first.
    np.testing.assert_allclose(np.abs(axes @ turn.as_matrix()), np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(axes), 1)


def test_principal_axes_do_not_depend_on_how_a_surface_is_divided():
    """Triangles cut finely on one end only: a mean over vertices would shift and turn."""
    whole = brick((40, 20, 10), Rotation.from_rotvec([0.2, 0.1, 0.3]))
    corners = whole.vertices[whole.faces]
    for _ in range(3):
        cut, rest = corners[:4], corners[4:]
        a, b, c = np.moveaxis(cut, 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        corners = np.concatenate([*(np.stack(part, axis=1) for part in parts), rest])
    fine = TriMesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    np.testing.assert_allclose(
        principal_axes_of_solid(fine), principal_axes_of_solid(whole), atol=1e-12
    )


@pytest.mark.parametrize("extent", [(40, 20, 20), (20, 20, 20), (20, 20, 5), (200, 10, 10)])
def test_equal_moments_leave_the_axes_along_x_y_z(extent: tuple[float, float, float]):
    axes = principal_axes_of_solid(brick(extent, Rotation.identity()))
    np.testing.assert_allclose(np.abs(axes).max(axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(axes), 1)


def test_a_slender_part_has_the_axes_of_its_own_section():
    """Its second and third moments differ by a fifth, by 5e-4 of the first."""
    turn = Rotation.from_rotvec([0.6, 0, 0])
    axes = principal_axes_of_solid(brick((200, 11, 10), turn))
    np.testing.assert_allclose(np.abs(axes @ turn.as_matrix()), np.eye(3), atol=1e-9)


def test_a_beam_turned_about_z_keeps_one_axis_along_z():
    """Square section: the axes across the beam are free, and one of them is chosen along z."""
    axes = principal_axes_of_solid(brick((40, 10, 10), Rotation.from_rotvec([0, 0, 0.5])))
    along = [np.cos(0.5), np.sin(0.5), 0]
    np.testing.assert_allclose(axes[0], along, atol=1e-12)
    np.testing.assert_allclose(np.abs(axes[:, 2]).max(), 1, atol=1e-12)


def test_the_box_of_given_axes_is_the_smallest_that_holds_the_part(tmp_path: Path):
    given = '"uniform"\naxes = [[3, 4, 0], [-4, 3, 0], [0, 0, 2]]'
    surface = TriMesh(np.concatenate([CORNERS, [[900, 900, 900]]]), FACES)  # one vertex unused
    box = part_box(case_of(tmp_path, ('"uniform"', given)), surface, unit_cell("bcc"))
    np.testing.assert_allclose(box.axes, [[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]], atol=1e-15)
    np.testing.assert_allclose(box.bounds, [[0, -32, 0], [40, 12, 20]], atol=1e-12)


def test_cells_are_counted_along_the_axes_of_the_box(tmp_path: Path):
    turned = brick((40, 20, 10), Rotation.from_rotvec([0, 0, 0.4]))
    case = case_of(tmp_path, ('"uniform"', '"uniform"\naxes = "principal"\nmargin_cells = 0'))
    grid = plan_grid(case, part_box(case, turned, unit_cell("bcc")), unit_cell("bcc")).grid
    assert grid.cells == (4, 2, 1)
    np.testing.assert_allclose(grid.uniform_edge, [38.4 / 4, 18.4 / 2, 8.4])
    np.testing.assert_allclose(grid.positions.reshape(-1, 3).mean(axis=0), MIDDLE)


def in_plane(*changes: tuple[str, str]) -> tuple[tuple[str, str], ...]:
    """Changes of the sound case, whose part is 40 x 20 x 20 mm, to a cell that is extruded."""
    return (('"bcc"', '"octagon"'), *changes)


@pytest.mark.parametrize(
    ("extrusion", "cells", "axes", "edges"),
    [
        ("z", (8, 5), [0, 1, 2], [5, 4]),
        ("x", (8, 5), [1, 2, 0], [2.5, 4]),
        # Cells count x, then z; the grid of an extrusion along y runs along z, then x.
        ("y", (5, 8), [2, 0, 1], [4, 5]),
    ],
)
def test_two_counts_are_along_the_axes_across_the_extrusion(
    tmp_path: Path, extrusion: str, cells: tuple, axes: list, edges: list
):
    given = ("cell_mm = 10.0", f'cells = [8, 5]\nextrusion = "{extrusion}"')
    case = case_of(tmp_path, *in_plane(given, ('"uniform"', '"uniform"\nmargin_cells = 1')))
    cell = unit_cell("octagon")
    box = part_box(case, TriMesh(CORNERS, FACES), cell)
    grid = plan_grid(case, box, cell).grid
    np.testing.assert_array_equal(box.axes, np.eye(3)[axes])
    assert grid.cells == (cells[0] + 2, cells[1] + 2)
    np.testing.assert_allclose(grid.uniform_edge, edges)


def test_a_cell_edge_is_the_first_of_the_proportions(tmp_path: Path):
    """Honeycombs are sqrt(3) longer one way: 40 / 4 and 20 / 6.93, so 10 and 3 cells."""
    case = case_of(tmp_path, ('"bcc"', '"honeycomb"'), ("cell_mm = 10.0", "cell_mm = 4"))
    cell = unit_cell("honeycomb")
    assert cell.proportions == pytest.approx((1, np.sqrt(3)))
    grid = plan_grid(case, part_box(case, TriMesh(CORNERS, FACES), cell), cell).grid
    assert grid.cells == (12, 5)


@pytest.mark.parametrize(("cell", "length"), [("square", 2.0), ("octagon", 6 * (np.sqrt(2) - 1))])
def test_the_density_of_walls_is_their_thickness_times_their_length_over_the_area(
    tmp_path: Path, cell: str, length: float
):
    """Rho = 2 r L / a² with L the length of the walls of one cell of an endless lattice, edge a = 10."""
    case = case_of(tmp_path, ('"bcc"', f'"{cell}"'), ("radius_mm = 0.8", "relative_density = 0.2"))
    read = unit_cell(cell)
    plan = plan_grid(case, part_box(case, TriMesh(CORNERS, FACES), read), read)
    assert 2 * plan.radius_mm * length * 10 / 100 == pytest.approx(0.2, rel=1e-9)


def test_a_density_of_walls_too_thin_to_print_names_the_least(tmp_path: Path):
    """It goes with the radius, not its square: 0.005 means 0.0125 mm, so 0.05 mm are 0.02."""
    case = case_of(tmp_path, ('"bcc"', '"square"'), ("radius_mm = 0.8", "relative_density = 0.005"))
    cell = unit_cell("square")
    with pytest.raises(CaseError, match=r"radius of 0.0125 mm.* give at least 0.02,"):
        plan_grid(case, part_box(case, TriMesh(CORNERS, FACES), cell), cell)


def test_faces_across_the_extrusion_are_fixed_in_the_order_of_the_grid(tmp_path: Path):
    changes = (
        ("cell_mm = 10.0", 'cell_mm = 10.0\nextrusion = "y"'),
        ('"uniform"', '"uniform"\nfixed_faces = ["+x"]'),
    )
    case, cell = case_of(tmp_path, *in_plane(*changes)), unit_cell("octagon")
    free = plan_grid(case, part_box(case, TriMesh(CORNERS, FACES), cell), cell).grid.free
    # The grid runs along z, then x.
    assert not free[:, :, -1].any()
    assert free[0, 1:-1, 0].all()
