"""Whole runs on a small part, from the command line and from Python."""

import json
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
from read_by_lib3mf import MILLIMETRE, read_package
from sound_case import BOX, FACES, changed_case, write_stl

from texmap_opt import DesignCase, cli, run
from texmap_opt.part_file import read_surface_file
from texmap_opt.signed_distance import SignedDistance
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.solid.validity import validity

CONTRACT = {
    "part": ["triangles", "volume_mm3", "watertight"],
    "tet_mesh": ["nodes", "tets", "element"],
    "stress": [
        "max_displacement_mm", "compliance_Nmm", "max_von_mises_MPa", "reaction_N", "residual",
    ],
    "warp": [
        "method", "nodes", "min_jacobian", "folded_cells", "max_aspect", "mean_angle_deg",
        "iterations", "converged",
    ],
    "structure": [
        "cell", "cells", "joints", "struts", "connected_components", "total_length_mm",
    ],
    "sizing": [
        "method", "iterations", "converged", "compliance_before_Nmm", "compliance_after_Nmm",
        "volume_mm3", "max_utilisation", "max_euler_utilisation", "min_radius_mm", "max_radius_mm",
    ],
    "skin": ["triangles", "thickness_mm", "max_von_mises_MPa", "max_utilisation"],
    "lattice": ["triangles", "watertight", "volume_mm3", "genus"],
    "result": [
        "triangles", "watertight", "volume_mm3", "mass_g", "relative_density",
        "connected_components", "closed_voids",
    ],
}  # fmt: skip
FILES = {
    "part.stl", "part.3mf", "structure.xml", "lattice.3mf", "stress.vtu", "grid.vtu", "struts.vtp",
    "report.json", "report.html", "case.toml",
}  # fmt: skip


def texmap(*arguments: str | Path) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main([str(a) for a in arguments])
    return int(ended.value.code or 0)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run with a skin and sized struts; its folder."""
    folder = tmp_path_factory.mktemp("run")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TEXMAP_CACHE_DIR", str(folder / "cache"))
        assert texmap("run", changed_case(folder), "--out", folder / "out", "--quiet") == 0
    return folder


def test_every_file_of_the_contract_is_there_and_nothing_else(done: Path):
    assert {p.name for p in (done / "out").iterdir()} == FILES
    assert {p.name for p in done.iterdir()} == {"box.stl", "case.toml", "cache", "out"}


def test_the_report_has_every_key_of_the_contract(done: Path):
    report = json.loads((done / "out" / "report.json").read_text())
    for section, keys in CONTRACT.items():
        assert set(keys) <= set(report[section]), section
    assert report["model"] == "frame and skin"
    assert (
        report["seconds"]["total"]
        >= sum(v for k, v in report["seconds"].items() if k != "total") - 0.1
    )


def test_the_file_is_the_solid_that_the_report_describes(done: Path):
    report = json.loads((done / "out" / "report.json").read_text())["result"]
    found = validity(read_surface_file(done / "out" / "part.stl"))
    assert found.printable
    assert found.connected_components == report["connected_components"] == 1
    # The inside, and now and then a pocket that struts close off at the skin.
    assert found.closed_voids == report["closed_voids"] >= 1
    np.testing.assert_allclose(found.volume_mm3, report["volume_mm3"], rtol=1e-6)


def test_the_outer_surface_stays_the_designers(done: Path):
    """No point of the result is outside the box, and the box's own corners are in the result."""
    result = read_surface_file(done / "out" / "part.stl")
    outside = SignedDistance(TriMesh(BOX, FACES))(result.vertices)[0]
    assert outside.max() < 1e-5
    assert SignedDistance(result).unsigned(BOX)[0].max() < 1e-5


def test_the_beam_lattice_and_its_skin_are_the_same_solid(done: Path):
    """Skin, and beams cut at the part's surface, as the 3MF Consortium's library reads them.

    Points farther from the result's surface than polygons are from their circles (tolerance_mm = 0.1,
    and joints that contain the ends of polygons) are in both or in neither.
    """
    package = read_package(done / "out" / "lattice.3mf")
    assert package.warnings == ()
    assert package.unit == MILLIMETRE
    assert package.built == ("skin", "lattice")
    assert package.metadata["Title"] == "box.stl with a lattice"
    lattice, skin = package.objects["lattice"], package.objects["skin"]
    assert lattice.clipping == ("Inside", "clipping")
    report = json.loads((done / "out" / "report.json").read_text())
    assert len(lattice.beams) == report["structure"]["struts"]
    points = np.random.default_rng(7).uniform(BOX.min(axis=0) - 1, BOX.max(axis=0) + 1, (20_000, 3))
    clipped = SignedDistance(package.objects["clipping"].mesh).contains(points)
    ends = lattice.mesh.vertices[lattice.beams]
    found = SignedDistance(skin.mesh).contains(points)
    found |= clipped & in_beams(points, ends, lattice.radii)
    result = SignedDistance(read_surface_file(done / "out" / "part.stl"))
    distance = result(points)[0]
    clear = np.abs(distance) > 0.2
    assert clear.mean() > 0.7
    np.testing.assert_array_equal(found[clear], distance[clear] < 0)
    # The negative control: without the skin they are not the same.
    alone = clipped & in_beams(points, ends, lattice.radii)
    assert (alone[clear] != (distance[clear] < 0)).any()


def in_beams(points: np.ndarray, ends: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Points in conical frusta, or in the balls at their ends."""
    inside = np.zeros(len(points), bool)
    for (first, last), (a, b) in zip(ends, radii, strict=True):
        axis = last - first
        share = (points - first) @ axis / (axis @ axis)
        across = np.linalg.norm(points - first - share[:, None] * axis, axis=1)
        inside |= (share >= 0) & (share <= 1) & (across <= a + share * (b - a))
        inside |= np.linalg.norm(points - first, axis=1) <= a
        inside |= np.linalg.norm(points - last, axis=1) <= b
    return inside


def test_sizing_lowers_compliance_at_equal_volume(done: Path):
    sizing = json.loads((done / "out" / "report.json").read_text())["sizing"]
    assert sizing["compliance_after_Nmm"] < sizing["compliance_before_Nmm"]
    assert sizing["min_radius_mm"] < sizing["max_radius_mm"]


def test_the_written_case_runs_again(done: Path):
    written = tomllib.loads((done / "out" / "case.toml").read_text())
    assert written["sizing"]["method"] == "optimality-criteria"
    assert DesignCase.from_toml(done / "out" / "case.toml").lattice.radius_mm == 0.8


def test_check_accepts_the_result_and_refuses_a_hole(done: Path, capsys: pytest.CaptureFixture):
    assert texmap("check", done / "out" / "part.stl") == 0
    assert json.loads(capsys.readouterr().out)["printable"] is True
    write_stl(done / "cache" / "open.stl", BOX, FACES[1:])
    assert texmap("check", done / "cache" / "open.stl") == 1
    assert json.loads(capsys.readouterr().out)["faults"]


def test_mesh_and_combine_repeat_the_run_from_its_structure(done: Path, tmp_path: Path):
    """The commands are the stages: same lattice, same skin, same volume to the tolerance."""
    lattice = tmp_path / "S.stl"
    assert texmap("mesh", done / "out" / "structure.xml", "-o", lattice, "--tolerance", "0.1") == 0
    arguments = ["--kind", "rod", "--skin", "1.0", "--tolerance", "0.1"]
    result = tmp_path / "P.stl"
    assert texmap("combine", done / "box.stl", lattice, "-o", result, *arguments) == 0
    expected = json.loads((done / "out" / "report.json").read_text())["result"]["volume_mm3"]
    np.testing.assert_allclose(read_surface_file(result).volume, expected, rtol=1e-3)


def test_another_radius_starts_from_the_cached_warp_and_changes_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """With the cache, and without it on the same tets, the numbers are the same bits."""
    monkeypatch.setenv("TEXMAP_CACHE_DIR", str(tmp_path / "cache"))
    changes = [("radius_mm = 0.8", "radius_mm = 0.7"), ('"uniform"', '"least-squares"')]
    first = changed_case(tmp_path / "first", changes[1])
    assert texmap("run", first, "--out", tmp_path / "0", "--quiet") == 0
    stored = {path.name for path in (tmp_path / "cache").glob("*.npz")}
    assert {name.split("-")[0] for name in stored} == {"tets", "stress", "warp"}
    thin = changed_case(tmp_path / "cached", *changes)
    assert texmap("run", thin, "--out", tmp_path / "1", "--quiet") == 0
    # Whatever is computed anew is stored.
    assert {path.name for path in (tmp_path / "cache").glob("*.npz")} == stored
    mesh = f'edge_mm = 6.0\nmesh = "{(tmp_path / "0" / "stress.vtu").as_posix()}"'
    again = changed_case(tmp_path / "anew", *changes, ("edge_mm = 6.0", mesh))
    assert texmap("run", again, "--out", tmp_path / "2", "--quiet", "--no-cache") == 0
    cached, anew = (json.loads((tmp_path / n / "report.json").read_text()) for n in "12")
    for section in ("tet_mesh", "stress", "warp", "structure", "sizing", "lattice", "result"):
        assert cached[section] == anew[section], section


def test_a_plate_is_the_part_less_the_lattice(tmp_path: Path):
    changes = ("skin_mm = 1.0", 'kind = "plate"\nskin_mm = 0')
    result = run(DesignCase.from_toml(changed_case(tmp_path, changes)))
    report = result.report
    assert report["sizing"]["compliance_after_Nmm"] is None
    volume = report["part"]["volume_mm3"] - report["lattice"]["inside_mm3"]
    np.testing.assert_allclose(report["result"]["volume_mm3"], volume, rtol=1e-6)


def test_a_relative_density_is_met_on_the_mesh(tmp_path: Path):
    changes = [("radius_mm = 0.8", "relative_density = 0.12"), ("skin_mm = 1.0", "skin_mm = 0")]
    changes.append(('"uniform"', '"uniform"\nmargin_cells = 0\n[sizing]\nmethod = "none"'))
    report = run(DesignCase.from_toml(changed_case(tmp_path, *changes))).report
    np.testing.assert_allclose(report["lattice"]["relative_density"], 0.12, rtol=0.005)
    np.testing.assert_allclose(report["result"]["relative_density"], 0.12, rtol=0.006)


def test_a_full_disk_is_one_sentence_and_leaves_nothing(tmp_path: Path):
    """A limit on file size stands for the disk; the system's own words reach the user."""
    case = changed_case(tmp_path)
    probe = (
        "import resource, signal, sys\n"
        "from texmap_opt.cli import main\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))\n"
        f"main(['run', {str(case)!r}, '--out', {str(tmp_path / 'out')!r}, '--quiet', '--no-cache'])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", probe], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    last = done.stderr.strip().splitlines()[-1]
    assert last.startswith("texmap: ")
    assert "cannot be written" in last
    assert "space" in last
    assert sorted(p.name for p in tmp_path.iterdir()) == ["box.stl", "case.toml"]


def test_an_interrupt_leaves_no_partial_files(tmp_path: Path):
    case = changed_case(tmp_path)
    arguments = [sys.executable, "-c", "from texmap_opt.cli import main; main()"]
    arguments += ["run", str(case), "--out", str(tmp_path / "out"), "--json-progress", "--no-cache"]
    with subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if '"stage": "stress"' in line:
                break
        time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        rest = process.stderr.read()
    assert process.returncode == cli.INTERRUPTED
    assert "interrupted" in rest
    assert "Traceback" not in rest
    assert sorted(p.name for p in tmp_path.iterdir()) == ["box.stl", "case.toml"]


def test_a_starter_case_can_be_looked_at(tmp_path: Path, capsys: pytest.CaptureFixture):
    assert texmap("new", tmp_path / "mine") == 0
    assert {p.name for p in (tmp_path / "mine").iterdir()} == {"case.toml", "part.stl"}
    assert texmap("new", tmp_path / "mine") == 2
    capsys.readouterr()
    look = texmap("look", tmp_path / "mine" / "case.toml", "--png", tmp_path / "look.png")
    assert look == 0
    said = capsys.readouterr().out
    assert "resultant [0, 0, 500] N" in said
    assert "struts" in said


def test_a_run_never_replaces_its_own_input(tmp_path: Path, capsys: pytest.CaptureFixture):
    case = changed_case(tmp_path)
    before = case.read_text()
    assert texmap("run", case, "--out", tmp_path, "--quiet") == 1
    assert "own input case.toml" in capsys.readouterr().err
    assert case.read_text() == before


def test_a_second_run_into_a_folder_leaves_nothing_of_the_first(tmp_path: Path):
    """A plate has no beam lattice: that of an earlier run must not stay beside it."""
    out = tmp_path / "out"
    assert texmap("run", changed_case(tmp_path), "--out", out, "--quiet") == 0
    (out / "mine.txt").write_text("not the program's")
    plate = changed_case(tmp_path, ("skin_mm = 1.0", 'kind = "plate"\nskin_mm = 0'))
    assert texmap("run", plate, "--out", out, "--quiet") == 0
    assert {p.name for p in out.iterdir()} == FILES - {"lattice.3mf"} | {"mine.txt"}


def test_look_sees_a_support_along_an_edge(tmp_path: Path, capsys: pytest.CaptureFixture):
    edge = "region = { box = [[0, 0, 0], [0, 20, 0]] }\n[[support]]\nregion = { plane"
    case = changed_case(tmp_path, ("region = { plane", edge))
    assert texmap("look", case, "--png", tmp_path / "look.png") == 0
    assert "line or points" in capsys.readouterr().out


def test_own_weight_does_not_depend_on_the_radius_before_scaling(tmp_path: Path):
    """Gravity alone, radii scaled to one volume: equal results from a thin and a thick start."""
    load = "region = { plane = { point = [40, 0, 0], normal = [1, 0, 0] } }\nforce_N = [0, 0, -10]"
    compliance = []
    for radius in ("0.5", "1.2"):
        case = changed_case(
            tmp_path / radius,
            (load, "gravity_m_s2 = [0, 0, -9.81]"),
            ("radius_mm = 0.8", f"radius_mm = {radius}"),
            ("[output]", '[sizing]\nmethod = "none"\nvolume_fraction = 0.08\n[output]'),
        )
        report = run(DesignCase.from_toml(case)).report
        compliance.append(report["sizing"]["compliance_after_Nmm"])
    np.testing.assert_allclose(compliance[0], compliance[1], rtol=0.02)
