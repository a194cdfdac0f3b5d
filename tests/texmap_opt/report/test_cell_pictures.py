"""Pictures of extruded cells: the solid of their walls, and stiffness as a curve in the plane."""

from pathlib import Path

import numpy as np
import pytest

from fea.plane_stiffness import PolarModulus
from texmap_opt.cells.catalogue import unit_cell
from texmap_opt.cells.drawn_cell import drawn_cell
from texmap_opt.errors import OutputError
from texmap_opt.report.drawing import cell_scene, draw_polar_stiffness
from texmap_opt.report.scenes import Cell, Whole

ANGLE = np.linspace(0, 2 * np.pi, 360, endpoint=False)


def test_bars_are_drawn_as_tubes_and_walls_as_their_solid():
    assert isinstance(cell_scene(drawn_cell(unit_cell("bcc"))), Cell)
    scene = cell_scene(drawn_cell(unit_cell("square"), edge_mm=10.0, radius_mm=0.5))
    assert isinstance(scene, Whole)
    # Four walls of 10 x 1 x 10 mm: in each corner two share a quarter, and a quarter disc is added.
    # Joints are polygons of the discs' area, so that their corners lie a little outside.
    area = 4 * (10 - 0.25 + np.pi / 16)
    np.testing.assert_allclose(scene.surface.volume, 10 * area, rtol=1e-3)
    low, high = scene.surface.bounds
    np.testing.assert_allclose([low, high], [[-0.5, -0.5, 0], [10.5, 10.5, 10]], atol=0.02)


def pixels(png: Path) -> np.ndarray:
    from PIL import Image

    with Image.open(png) as image:
        return np.asarray(image.convert("RGB")).astype(float)


def filled(png: Path) -> np.ndarray:
    """Pixels that are blue: inside the curve."""
    image = pixels(png)
    return image[..., 2] - image[..., 0] > 25


def test_the_curve_of_a_stiffness_is_its_shape(tmp_path: Path):
    """A round one fills a disc; one that is stiff along x alone lies along x."""
    shapes = {}
    for name, E in (("round", np.ones(360)), ("along", np.cos(ANGLE) ** 4 + 0.01)):
        png = tmp_path / f"{name}.png"
        draw_polar_stiffness(PolarModulus(ANGLE, E), png, quantity="E\nover Es")
        rows, columns = np.nonzero(filled(png))
        shapes[name] = float(np.ptp(columns) / np.ptp(rows))
    np.testing.assert_allclose(shapes["round"], 1, atol=0.02)
    assert shapes["along"] > 1.5
    assert sorted(file.name for file in tmp_path.iterdir()) == ["along.png", "round.png"]


def test_a_folder_that_is_not_there_is_one_sentence(tmp_path: Path):
    modulus = PolarModulus(ANGLE, np.ones(360))
    with pytest.raises(OutputError, match="cannot be written"):
        draw_polar_stiffness(modulus, tmp_path / "none" / "E.png", quantity="E")
