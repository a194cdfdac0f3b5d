"""Parts that nobody here drew, good and broken, through the whole program. Minutes: `-m slow`."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from texmap_opt import cli
from texmap_opt.part_file import read_surface_file
from texmap_opt.solid.validity import validity

SHARED = Path(__file__).parents[2] / ".." / "shared"
STATUE = Path(__file__).parents[2] / "studies" / "statue" / "case.toml"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (SHARED / "parts").is_dir(), reason="the real parts are not here"),
]


def texmap(*arguments: str | Path) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main([str(a) for a in arguments])
    return int(ended.value.code or 0)


def case_for(part: str, folder: Path, *changes: str) -> Path:
    """A case made for any part: clamped at the bottom, pressed at the top."""
    case = folder / "case.toml"
    tool = SHARED / "tools" / "make_case.py"
    subprocess.run([sys.executable, tool, SHARED / "parts" / part, case, *changes], check=True)
    return case


@pytest.mark.parametrize(
    ("part", "changes"),
    [("72214.stl", ()), ("fandisk.obj", ()), ("spot.obj", ()), ("112932.stl", ("part.solid=1",))],
)
def test_a_real_part_becomes_one_printable_solid(
    part: str, changes: tuple[str, ...], tmp_path: Path
):
    case = case_for(part, tmp_path, *changes)
    assert texmap("run", case, "--out", tmp_path / "out", "--quiet") == 0
    found = validity(read_surface_file(tmp_path / "out" / "part.stl"))
    assert found.printable
    assert found.connected_components == 1


@pytest.mark.parametrize(
    ("part", "words"),
    [
        ("112932.stl", "2 solids"),
        ("broken/teapot.obj", "open"),
        ("broken/suzanne.obj", "open"),
        ("broken/openscad-nonmanifold-crash.obj", "more than two triangles"),
    ],
)
def test_a_broken_part_is_refused_in_words(part: str, words: str, tmp_path: Path, capsys):
    case = case_for(part, tmp_path)
    assert texmap("run", case, "--out", tmp_path / "out", "--quiet") == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_scan_with_holes_is_repaired_and_the_report_says_how(tmp_path: Path):
    case = case_for("broken/stanford-bunny.obj", tmp_path)
    assert texmap("run", case, "--out", tmp_path / "out", "--quiet") == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert any("closed 5 holes" in note for note in report["part"]["notes"])
    assert report["result"]["connected_components"] == 1


@pytest.mark.parametrize("method", ["uniform", "successive-approximation", "least-squares"])
def test_the_statue_with_each_warp_at_equal_volume(method: str, tmp_path: Path):
    """Either a compliance at the volume fraction of the case, or a refusal that counts the folds."""
    part = SHARED / "parts" / "beethoven.ply"
    out = tmp_path / "out"
    code = texmap("run", STATUE, "--part", part, "--out", out, "--method", method, "--quiet")
    assert code in ({0, 1} if method == "successive-approximation" else {0})
    if code == 0:
        report = json.loads((out / "report.json").read_text())
        assert report["structure"]["struts"] >= 5000
        assert report["warp"]["folded_cells"] == 0
        assert report["sizing"]["volume_fraction"] == pytest.approx(0.14, rel=1e-5)
