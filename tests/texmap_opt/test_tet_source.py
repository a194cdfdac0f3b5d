"""Where tets come from: the mesher, its cache, refinement, an earlier run's file."""

from pathlib import Path

import numpy as np
import pytest
from sound_case import BOX, FACES, case_of

import fea
from fea import SolidProblem, Support, TetMesh
from fea.mesh_files import write_tets
from texmap_opt import tet_source as module
from texmap_opt.cache import StageCache
from texmap_opt.errors import CaseError, TetrahedralisationError
from texmap_opt.part import Part
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.tet_source import part_tets

PART = Part(TriMesh(BOX, FACES), "box")


def solve(mesh: TetMesh) -> fea.SolidSolution:
    """The sound case's load: clamped at x = 0, pulled down at x = 40."""
    clamp = Support.clamp(mesh.nodes_where(lambda x: x[:, 0] < 1e-6))
    end = mesh.facets_where(lambda x: x[:, 0] > 40 - 1e-6)
    forces = fea.force_on_facets(mesh, end, np.array([0.0, 0.0, -10.0]))
    return fea.solve_solid(SolidProblem.from_supports(mesh, fea.material("PA12"), [clamp], forces))


def unwanted(mesh: TetMesh) -> fea.SolidSolution:
    raise AssertionError("nothing is solved without max_error")


def test_one_mesh_is_made_without_a_solve_and_kept(tmp_path: Path, monkeypatch):
    case, cache = case_of(tmp_path), StageCache(tmp_path / "cache")
    first = part_tets(case, PART, cache, solve=unwanted)
    monkeypatch.setattr(module, "tetrahedralise", None)
    again = part_tets(case, PART, cache, solve=unwanted)
    np.testing.assert_array_equal(again.nodes, first.nodes)
    np.testing.assert_array_equal(again.tets, first.tets)


def test_max_error_refines_until_the_estimate_is_below_it_and_is_kept(tmp_path: Path, monkeypatch):
    coarse = part_tets(case_of(tmp_path), PART, StageCache(None), solve=unwanted)
    asked = 0.8 * float(solve(coarse).error_estimate.relative.max())
    case = case_of(tmp_path, ("edge_mm = 6.0", f"edge_mm = 6.0\nmax_error = {asked:.4f}"))
    cache = StageCache(tmp_path / "cache")
    mesh = part_tets(case, PART, cache, solve=solve)
    assert mesh.element == case.analysis.element
    assert float(solve(mesh).error_estimate.relative.max()) <= asked
    # Its boundary is on the part, as that of one mesh is.
    boundary = np.unique(mesh.boundary_facets)
    distance, _, _ = PART.signed_distance.unsigned(mesh.nodes[boundary])
    assert np.quantile(distance, 0.95) < 1e-9
    again = part_tets(case, PART, cache, solve=unwanted)
    np.testing.assert_array_equal(again.nodes, mesh.nodes)
    # Another load is another refinement; one mesh without max_error is not taken for it.
    changed = case_of(
        tmp_path,
        ("edge_mm = 6.0", f"edge_mm = 6.0\nmax_error = {asked:.4f}"),
        ("force_N = [0, 0, -10]", "force_N = [0, -10, 0]"),
    )
    with pytest.raises(AssertionError, match="nothing is solved"):
        part_tets(changed, PART, cache, solve=unwanted)


def test_an_error_out_of_reach_is_one_sentence(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(module, "MAX_ROUNDS", 1)
    case = case_of(tmp_path, ("edge_mm = 6.0", "edge_mm = 6.0\nmax_error = 0.001"))
    with pytest.raises(
        TetrahedralisationError,
        match=r"\[analysis\] max_error = 0\.001: the estimated error is .* after 1 of 1 rounds",
    ):
        part_tets(case, PART, StageCache(None), solve=solve)
    monkeypatch.setattr(module, "MAX_NODES", 10)
    with pytest.raises(TetrahedralisationError, match="more than the 10 allowed"):
        part_tets(case, PART, StageCache(None), solve=solve)


def test_max_error_and_the_tets_of_a_file_contradict(tmp_path: Path):
    with pytest.raises(CaseError, match=r"\[analysis\] max_error = 0\.1: .* give one of them"):
        case_of(tmp_path, ("edge_mm = 6.0", 'max_error = 0.1\nmesh = "stress.vtu"'))


@pytest.mark.parametrize("value", ["0", "-0.1", "0.9", '"5 %"'])
def test_max_error_is_a_share(tmp_path: Path, value: str):
    with pytest.raises(CaseError, match=r"\[analysis\] max_error"):
        case_of(tmp_path, ("edge_mm = 6.0", f"max_error = {value}"))


def test_the_tets_of_an_earlier_run_are_taken_as_they_are(tmp_path: Path):
    mesh = TetMesh.box((40.0, 20.0, 20.0), (4, 2, 2))
    write_tets(tmp_path / "stress.vtu", mesh)
    case = case_of(tmp_path, ("edge_mm = 6.0", 'mesh = "stress.vtu"'))
    taken = part_tets(case, PART, StageCache(None), solve=unwanted)
    np.testing.assert_array_equal(taken.nodes, mesh.nodes)
    np.testing.assert_array_equal(taken.tets, mesh.tets)


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        (None, r"case\.toml: \[analysis\] mesh = 'stress\.vtu': .*stress\.vtu is not a file"),
        (TetMesh.box((30.0, 20.0, 20.0), (2, 2, 2)), r"fill 1\.2e\+04 mm³, the part 1\.6e\+04 mm³"),
        (
            TetMesh.box((40.0, 20.0, 20.0), (2, 2, 2)).to_tet10(),
            "holds tet10, but element = 'tet4'",
        ),
    ],
    ids=["missing", "another part's", "another element"],
)
def test_tets_that_do_not_fit_are_refused(tmp_path: Path, mesh: TetMesh | None, words: str):
    if mesh is not None:
        write_tets(tmp_path / "stress.vtu", mesh)
    case = case_of(tmp_path, ("edge_mm = 6.0", 'mesh = "stress.vtu"'))
    with pytest.raises(CaseError, match=words):
        part_tets(case, PART, StageCache(None), solve=unwanted)


def test_a_file_that_is_no_mesh_is_refused(tmp_path: Path):
    (tmp_path / "stress.vtu").write_text("no mesh")
    case = case_of(tmp_path, ("edge_mm = 6.0", 'mesh = "stress.vtu"'))
    with pytest.raises(
        CaseError, match=r"cannot be read as a tet mesh; write it anew, or give the"
    ):
        part_tets(case, PART, StageCache(None), solve=unwanted)
