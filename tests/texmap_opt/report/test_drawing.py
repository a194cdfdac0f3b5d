"""Pictures are drawn in a process of their own, which may fail in every way without harm."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from texmap_opt.errors import OutputError
from texmap_opt.report import drawing
from texmap_opt.report.drawing import Drawn, draw, draw_cell
from texmap_opt.report.overlay import KIND_COLOURS
from texmap_opt.report.scenes import (
    Action,
    CutOpen,
    LoadedPart,
    Mark,
    PlannedPart,
    Scene,
    StiffnessSurface,
    Struts,
    WarpedGrid,
    Whole,
)
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.structure import Structure
from texmap_opt.warp.cell_volumes import equivalent_edges

NO_FACES = TriMesh(np.zeros((0, 3)), np.zeros((0, 3), int))


def box(low, high) -> TriMesh:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    return TriMesh(np.array(low) + corners * (np.array(high, float) - low), faces)


def grid_nodes(cells) -> np.ndarray:
    axes = [np.linspace(0, extent, n + 1) for extent, n in zip((40, 10, 10), cells, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def all_scenes() -> dict[str, Scene]:
    part = box([0, 0, 0], [40, 10, 10])
    end = TriMesh(part.vertices, part.faces[2:4])
    root = TriMesh(part.vertices, part.faces[:2])
    down = np.array([0.0, 0, -1])
    marks = (
        Mark(Action.SUPPORT, "held", root, np.zeros(3)),
        Mark(Action.FORCE, "force", end, down),
        Mark(Action.PRESSURE, "pressure", end, np.zeros(3)),
        Mark(Action.SUCTION, "suction", end, np.zeros(3)),
        Mark(Action.MOMENT, "moment", end, np.array([1.0, 0, 0])),
        Mark(Action.GRAVITY, "gravity", NO_FACES, down),
    )
    nodes = grid_nodes((8, 2, 2))
    sizes = equivalent_edges(nodes)
    joints = nodes.reshape(-1, 3)
    ends = np.array([[a, a + 1] for a in range(len(joints) - 1)])
    radii = np.full((len(ends), 2), 0.4)
    use = np.linspace(0, 1.3, len(ends))[:, None].repeat(2, axis=1)
    hollow = box([1, 1, 1], [39, 9, 9])
    shell = TriMesh(
        np.concatenate([part.vertices, hollow.vertices]),
        np.concatenate([part.faces, hollow.faces[:, ::-1] + 8]),
    )
    return {
        "load": LoadedPart(part, np.linspace(0, 50, 8), marks),
        "grid": WarpedGrid(nodes, sizes, np.ones(sizes.shape, bool), part),
        "size-error": WarpedGrid(
            nodes,
            np.broadcast_to(np.linspace(0.5, 1.5, 8)[:, None, None], sizes.shape),
            np.ones(sizes.shape, bool),
            part,
            quantity="achieved over\nwanted size",
            middle=1.0,
        ),
        "kinds": WarpedGrid(
            nodes,
            np.broadcast_to((np.arange(8.0) // 4)[:, None, None], sizes.shape),
            np.ones(sizes.shape, bool),
            part,
            names=("octet", "kelvin"),
        ),
        "radius": Struts(joints, ends, radii, radii, "strut radius", "mm"),
        "utilisation": Struts(joints, ends, radii, use, "utilisation", "", 1.0),
        "cut": CutOpen(shell),
        "whole": Whole(shell),
        "look": PlannedPart(part, marks, nodes),
        "stiffness": StiffnessSurface(box([-1, -1, -1], [1, 1, 1]), np.linspace(1, 2, 8), "E"),
    }


def pixels(png: Path) -> np.ndarray:
    from PIL import Image

    with Image.open(png) as image:
        return np.asarray(image.convert("RGB")).astype(float)


def close_to(image: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    return np.abs(image - np.array(colour)).max(axis=-1) < 12


@pytest.fixture(scope="module")
def drawn(tmp_path_factory) -> Drawn:
    result = draw(all_scenes(), tmp_path_factory.mktemp("pictures"), timeout_s=120.0)
    if not result.pictures:
        pytest.skip(f"this machine cannot draw: {next(iter(result.missing.values()))}")
    return result


def test_every_scene_becomes_a_picture_that_shows_something(drawn):
    assert drawn.missing == {}
    assert list(drawn.pictures) == list(all_scenes())
    for name, png in drawn.pictures.items():
        image = pixels(png)
        assert image.shape == (900, 1200, 3), name
        shown = ~close_to(image, (255, 255, 255))
        # A long part in a 4:3 frame covers at least a tenth of it.
        assert 0.1 < shown.mean() < 0.95, name
        assert image[shown].std() > 5, name


def test_kinds_of_cells_have_the_colours_of_the_legend(drawn):
    """Each on its half of the part, as a spot beside its name, and no colour bar."""
    image = pixels(drawn.pictures["kinds"])
    spots = [tuple(bytes.fromhex(colour[1:])) for colour in KIND_COLOURS[:2]]
    for row, spot in enumerate(spots):
        places = np.argwhere(close_to(image, spot)) / image.shape[:2]
        legend = places[(places[:, 1] < 0.05) & (places[:, 0] < 0.12)]
        np.testing.assert_allclose(legend.mean(axis=0), [0.042 + 0.036 * row, 0.032], atol=0.01)
    # Under the veil of the part: bluer here, redder there.
    body = image[100:].reshape(-1, 3)
    hue = body[:, 2] - body[:, 0]
    assert (hue > 40).mean() > 0.05
    assert (hue < -40).mean() > 0.05
    # Negative control: a grid of sizes has a bar on the right and no such spots.
    sizes = pixels(drawn.pictures["grid"])
    assert close_to(image[200:700, 1150:], (255, 255, 255)).all()
    assert not close_to(sizes[200:700, 1065:], (255, 255, 255)).all()
    assert close_to(sizes[:90, :60], (255, 255, 255)).all()


def test_the_part_fills_the_width_of_the_frame(drawn):
    columns = np.flatnonzero(~close_to(pixels(drawn.pictures["whole"]), (255,) * 3).all(axis=0))
    assert columns[0] == pytest.approx(0.05 * 1200, abs=4)
    assert columns[-1] == pytest.approx(0.95 * 1200, abs=4)


def test_a_cut_shell_shows_its_wall_as_section_and_its_inside_as_hollow(drawn):
    section = close_to(pixels(drawn.pictures["cut"]), (0xE3, 0x9A, 0x4F))
    # The wall is 1 mm of a 40 x 10 mm section: 80/400 less than a fifth of the picture's section.
    assert 0.005 < section.mean() < 0.1


def test_loads_are_red_and_supports_blue(drawn):
    image = pixels(drawn.pictures["look"])
    red = (image[..., 0] > 120) & (image[..., 1:].max(axis=-1) < 70)
    blue = (image[..., 2] > 120) & (image[..., 0] < 70)
    assert red.sum() > 1000
    assert blue.sum() > 200


def test_struts_above_the_limit_are_red_and_others_are_not(drawn):
    image = pixels(drawn.pictures["utilisation"])[:, :950]
    red = (image[..., 0] > 150) & (image[..., 1:].max(axis=-1) < 60)
    assert red.sum() > 200


def test_cells_too_small_are_blue_and_cells_too_large_red(drawn):
    image = pixels(drawn.pictures["size-error"])[:, :950]
    reddish = image[..., 0] - image[..., 2]
    small, large = (np.argwhere(side)[:, 1].mean() for side in (reddish < -60, reddish > 60))
    # The size grows along x, which lies along the width of the picture.
    assert abs(large - small) > 300


def test_a_unit_cell_is_drawn(tmp_path):
    joints = np.array([[0.0, 0, 0], [10, 10, 10]])
    cell = Structure(
        joints, np.array([[0, 1]]), np.full((1, 2), 0.5), np.zeros(2, bool), np.ones(1)
    )
    try:
        draw_cell(cell, tmp_path / "cell.png")
    except OutputError as failure:
        pytest.skip(str(failure))
    assert pixels(tmp_path / "cell.png").std() > 5
    assert [file.name for file in tmp_path.iterdir()] == ["cell.png"]


def instead_of_vtk(monkeypatch, code: str) -> None:
    """The drawing process runs this program; `job` and `scenes` (names) are given to it."""
    start = (
        "import os, pathlib, sys, time; job = pathlib.Path(sys.argv[-1]); "
        "scenes = sorted(p.stem for p in job.glob('*.scene'))\n"
    )
    popen = subprocess.Popen

    def other(command, **options):
        return popen([sys.executable, "-c", start + code, command[-1]], **options)

    monkeypatch.setattr(drawing.subprocess, "Popen", other)


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("os.abort()", "SIGABRT"),
        ("os.kill(os.getpid(), 11)", "SIGSEGV"),
        ("sys.exit('ImportError: libGL.so.1: cannot open')", "libGL.so.1"),
    ],
)
def test_without_graphics_every_scene_is_missing_with_a_reason_and_a_remedy(
    monkeypatch, tmp_path, code, said
):
    instead_of_vtk(monkeypatch, code)
    drawn = draw(all_scenes(), tmp_path, timeout_s=30.0)
    assert drawn.pictures == {}
    assert set(drawn.missing) == set(all_scenes())
    for reason in drawn.missing.values():
        assert said in reason
        assert "apt-get install libegl1 libgl1" in reason
    assert list(tmp_path.iterdir()) == []


def test_a_hang_ends_at_the_timeout(monkeypatch, tmp_path):
    instead_of_vtk(monkeypatch, "time.sleep(60)")
    drawn = draw(all_scenes(), tmp_path, timeout_s=1.0)
    assert drawn.pictures == {}
    assert all("did not end within" in reason for reason in drawn.missing.values())


def test_one_bad_scene_does_not_cost_the_others_their_pictures(monkeypatch, tmp_path):
    instead_of_vtk(
        monkeypatch,
        "for name in scenes:\n"
        "    (job / 'current').write_text(name)\n"
        "    if name == 'load': os.abort()\n"
        "    (job / f'{name}.png').write_bytes(b'picture')\n",
    )
    drawn = draw(all_scenes(), tmp_path, timeout_s=30.0)
    assert set(drawn.missing) == {"load"}
    assert set(drawn.pictures) == set(all_scenes()) - {"load"}


def test_an_error_that_is_not_about_graphics_is_told_as_it_is(monkeypatch, tmp_path):
    instead_of_vtk(monkeypatch, "sys.exit('ValueError: no points')")
    reason = draw(all_scenes(), tmp_path, timeout_s=30.0).missing["load"]
    assert "ValueError: no points" in reason
    assert "apt-get" not in reason


def test_a_cell_that_cannot_be_drawn_is_an_error(monkeypatch, tmp_path):
    instead_of_vtk(monkeypatch, "os.abort()")
    joints = np.array([[0.0, 0, 0], [1, 1, 1]])
    cell = Structure(
        joints, np.array([[0, 1]]), np.full((1, 2), 0.1), np.zeros(2, bool), np.ones(1)
    )
    with pytest.raises(OutputError, match="apt-get"):
        draw_cell(cell, tmp_path / "cell.png")
    assert list(tmp_path.iterdir()) == []
