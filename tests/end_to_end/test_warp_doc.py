"""docs/warp.md: its cases are looked at, and its Python runs and prints what is written there."""

import re
from pathlib import Path

import numpy as np
import pytest

from fea.tet_mesh import TetMesh
from texmap_opt.case import DesignCase
from texmap_opt.export.vtk import write_stress
from texmap_opt.look import look

PAGE = (Path(__file__).parents[2] / "docs" / "warp.md").read_text(encoding="utf-8")
CASES = dict(re.findall(r"`(\w+)\.toml`\. .*?```toml\n(.*?)```", PAGE, flags=re.DOTALL))

# What `texmap look` says of each.
WARPS = {
    "own": "driven by von-mises, contrast 2; cells do not turn",
    "imported": "driven by file, contrast 2; cells turn, energy 30",
    "painted": "driven by paint, contrast 3; cells do not turn",
    "both": "driven by von-mises (maximum) paint, contrast 2; cells turn, energy 30",
}


def stressed_tet(path: Path) -> None:
    """What a run leaves of its stress, on a single tet."""
    nodes = np.array([[0.0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]])
    mesh = TetMesh(nodes, np.array([[0, 1, 2, 3]]))
    write_stress(
        path,
        mesh=(mesh.nodes, mesh.tets),
        case_names=["load"],
        displacement=np.zeros((1, 4, 3)),
        stress=np.ones((1, 4, 6)),
        von_mises=np.ones((1, 4)),
    )


def test_the_page_has_a_case_for_each_kind_of_driver():
    assert list(CASES) == ["own", "imported", "painted", "both"]
    assert PAGE.count("```toml") == len(CASES)


@pytest.mark.parametrize("name", CASES)
def test_a_case_of_the_page_can_be_looked_at(name: str, tmp_path: Path):
    path = tmp_path / f"{name}.toml"
    path.write_text(CASES[name])
    (tmp_path / "own").mkdir()
    stressed_tet(tmp_path / "own" / "stress.vtu")
    case = DesignCase.from_toml(path)
    assert case.warp.method == "least-squares"
    seen = look(case)
    assert not [warning for warning in seen.warnings if "cells across" in warning]
    assert f"warp      least-squares, {WARPS[name]}\n" in seen.text()


def test_the_python_of_the_page_prints_what_is_written_below_it(capsys: pytest.CaptureFixture):
    block, printed = re.findall(r"```python\n(.*?)```\s+It prints `(.*?)`", PAGE, re.DOTALL)[0]
    # The tests' own set-up must not hide that the page forgets it.
    assert 'jax.config.update("jax_enable_x64", True)' in block
    exec(block, {})
    wanted, got = (np.array(text.split(), float) for text in (printed, capsys.readouterr().out))
    # A minimum is exact to 1e-10; four decimals are printed.
    np.testing.assert_allclose(got, wanted, atol=1.01e-4)
