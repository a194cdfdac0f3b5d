"""Octets below, Kelvin cells above: one printable part, and a report of how they were joined."""

import re
import tomllib
from pathlib import Path

import pytest

from texmap_opt.case import DesignCase
from texmap_opt.look import draw_look, look
from texmap_opt.pipeline import run

ROOT = Path(__file__).parents[2]
STUDY = ROOT / "studies" / "two_cells" / "case.toml"
PAGE = (ROOT / "docs" / "several-cells.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def test_a_block_of_two_cells_is_one_printable_part():
    """The shipped case, half as long and without its pictures."""
    tables = tomllib.loads(STUDY.read_text(encoding="utf-8"))
    tables["part"] |= {"length_mm": 20}
    tables["output"] = {"pictures": False, "tolerance_mm": 0.3}
    result = run(DesignCase.from_tables(tables, STUDY))
    structure = result.report["structure"]
    assert structure["connected_components"] == 1
    assert structure["trimmed"]["loose_struts"] == 0
    # 2 x 2 faces between the two layers of each kind, four half diagonals and four sides in each.
    assert structure["interfaces"] == [
        {
            "kinds": ["octet", "tetrakaidecahedron"],
            "method": "crossed",
            "faces": 4,
            "shared_joints": 0,
            "split_struts": 32,
            "transition_struts": 0,
        }
    ]
    kinds = structure["struts_of_kind"]
    assert min(kinds["octet"], kinds["tetrakaidecahedron"]) > 0
    assert sum(kinds.values()) == structure["struts"]
    final = result.report["result"]
    assert final["printable"]
    assert final["connected_components"] == 1
    assert result.report["joint_model"]["cells"] == ["octet", "tetrakaidecahedron"]


def test_look_counts_and_draws_both_kinds(tmp_path: Path):
    seen = look(DesignCase.from_toml(STUDY))
    # Four by two cells in each of two layers of octets below, and of Kelvin cells above.
    assert [int((seen.layout.kinds == kind).sum()) for kind in (0, 1)] == [16, 16]
    assert not [warning for warning in seen.warnings if "[[zone]]" in warning]
    files, missing = draw_look(seen, tmp_path / "seen.png")
    if missing:
        pytest.skip(f"this machine cannot draw: {next(iter(missing.values()))}")
    assert files == {"look": tmp_path / "seen.png", "kinds": tmp_path / "seen-kinds.png"}
    assert {file.name for file in tmp_path.iterdir()} == {"seen.png", "seen-kinds.png"}


def test_look_says_which_zones_only_the_warp_knows():
    tables = tomllib.loads(STUDY.read_text(encoding="utf-8"))
    tables["zone"].append({"cell": "bcc", "f_least": 1.0})
    seen = look(DesignCase.from_tables(tables, STUDY))
    assert any("[[zone]] 2" in warning and "only the warp" in warning for warning in seen.warnings)


@pytest.mark.parametrize("block", blocks("toml"))
def test_the_zones_of_the_page_are_read(block: str):
    tables = tomllib.loads(STUDY.read_text(encoding="utf-8")) | tomllib.loads(block)
    case = DesignCase.from_tables(tables, STUDY)
    assert [zone.cell for zone in case.zones] == ["kelvin", "bcc", "octet"]


@pytest.mark.parametrize("block", blocks("python"))
def test_the_programs_of_the_page_run(block: str):
    exec(compile(block, "several-cells.md", "exec"), {})
