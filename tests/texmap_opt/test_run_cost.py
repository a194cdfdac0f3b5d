"""The time that `texmap look` foresees, beside runs that were timed."""

import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from texmap_opt.case import DesignCase
from texmap_opt.look import Look, look
from texmap_opt.run_cost import run_cost
from texmap_opt.starter import write_starter

STUDIES = Path(__file__).parents[2] / "studies"

# Seconds of whole runs without any cache on two cores, the least of up to three (other work on them made
# the same case take up to 1.7 times as long):
# `TEXMAP_CACHE_DIR=/tmp/empty texmap run CASE --out OUT --no-cache`.
MEASURED_S = {"two_cells": 26, "extruded": 37, "cantilever": 56, "starter": 213, "bracket": 227}
# A little more than the range that `texmap look` names, for the machine.
WITHIN = 1.5


def look_at(name: str, folder: Path) -> Look:
    case = write_starter(folder / "mine") if name == "starter" else STUDIES / name / "case.toml"
    return look(DesignCase.from_toml(case))


@pytest.mark.parametrize("name", sorted(MEASURED_S))
def test_the_time_foreseen_is_the_one_measured(name: str, tmp_path: Path):
    cost = look_at(name, tmp_path).cost
    assert MEASURED_S[name] / WITHIN < cost.seconds < MEASURED_S[name] * WITHIN
    low, _, high, _ = cost.time_text.split()
    assert int(low) < cost.seconds < int(high)


def test_what_is_not_done_takes_no_time():
    """A plate has no frame, and a case without pictures none to draw; skins and sizing cost the most."""
    tables = tomllib.loads((STUDIES / "cantilever" / "case.toml").read_text(encoding="utf-8"))
    case = DesignCase.from_tables(tables, STUDIES / "cantilever" / "case.toml")
    seen = look(case)

    def stages(changed: DesignCase) -> dict[str, float]:
        return run_cost(changed, seen.part, seen.grid, seen.struts).stages

    whole = stages(case)
    plate = stages(replace(case, lattice=replace(case.lattice, kind="plate")))
    assert plate["frame"] == plate["sizing"] == 0 < whole["frame"] < whole["sizing"]
    blind = stages(replace(case, output=replace(case.output, pictures=False)))
    assert blind["pictures"] == 0 < whole["pictures"]
    bare = stages(replace(case, lattice=replace(case.lattice, skin_mm=0.0)))
    assert bare["result"] == 0 < whole["result"]
    assert bare["sizing"] < whole["sizing"]
    dense = stages(
        replace(case, lattice=replace(case.lattice, relative_density=0.2, radius_mm=None))
    )
    assert dense["lattice"] == 2 * whole["lattice"]
