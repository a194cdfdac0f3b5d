"""Openings and drain holes in a case file and after `texmap combine`."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
import trimesh

from texmap_opt import cli
from texmap_opt.case import DesignCase
from texmap_opt.errors import InputError
from texmap_opt.export.solid_file import Solid
from texmap_opt.part_file import read_surface_file
from texmap_opt.region import Box
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.solid.validity import validity

CASE = """
part = { builtin = "cantilever" }
material = { name = "PA12" }
[[support]]
region = { normal = [-1, 0, 0] }
[[load]]
region = { normal = [1, 0, 0] }
force_N = [0, 0, -1]
[lattice]
cells = [4, 2, 2]
radius_mm = 0.5
skin_mm = 1.0
[[opening]]
region = { box = [[0, 0, 0], [1, 2, 3]] }
[[opening]]
region = { stl = "lid.stl" }
[[drain]]
point = [1, 2, 3]
diameter_mm = 2.5
direction = [0, 0, 2]
"""


def surface(mesh: trimesh.Trimesh) -> TriMesh:
    return TriMesh(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64))


def read(folder: Path, text: str) -> DesignCase:
    Solid(surface(trimesh.creation.box((2, 2, 2)))).save(folder / "lid.stl")
    (folder / "case.toml").write_text(text)
    return DesignCase.from_toml(folder / "case.toml")


def test_openings_and_drains_are_read_and_written_back(tmp_path):
    case = read(tmp_path, CASE)
    first, second = case.openings
    assert isinstance(first.region, Box)
    assert second.where == "case.toml: [[opening]] 2"
    (drain,) = case.drains
    np.testing.assert_array_equal(drain.direction, [0, 0, 1])
    assert drain.diameter_mm == 2.5
    # A file that a run must not replace, and whose path is whole in the case that is written.
    assert tmp_path / "lid.stl" in [file.resolve() for file in case.input_files]
    written = tomllib.loads(case.to_toml())
    assert written["opening"][1]["region"]["stl"] == str(tmp_path / "lid.stl")
    assert written["drain"] == [{"point": [1, 2, 3], "diameter_mm": 2.5, "direction": [0, 0, 2]}]


def test_without_a_skin_there_is_nothing_to_open(tmp_path):
    with pytest.raises(InputError, match=r"\[\[opening\]\] 1: there is no skin to open"):
        read(tmp_path, CASE.replace("skin_mm = 1.0", "skin_mm = 0"))


def test_combine_takes_openings_and_drains(tmp_path, capsys):
    """A closed skin has a void; a hole, or an opening, makes it none."""
    part, post, result = (tmp_path / name for name in ("part.stl", "post.stl", "result.stl"))
    Solid(surface(trimesh.creation.box((10, 10, 10)))).save(part)
    Solid(surface(trimesh.creation.box((2, 2, 16)))).save(post)
    for options, voids in (
        ([], 1),
        (["--drain=-3,3,5,1.5"], 0),
        (["--opening", "normal = [1, 0, 0]", "--drain", "3,3,5,1,0,0,-1"], 0),
    ):
        with pytest.raises(SystemExit) as end:
            cli.main(["combine", *map(str, (part, post)), "-o", str(result), *options])
        assert end.value.code == 0, capsys.readouterr().err
        assert validity(read_surface_file(result)).closed_voids == voids
