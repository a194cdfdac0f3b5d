"""Every target is reached within its tolerance, and docs/verification.md says what is reached."""

from pathlib import Path

import pytest
from targets import BENCHMARKS, page

PAGE = Path(__file__).parents[2] / "docs" / "verification.md"
TARGETS = [
    pytest.param(target, id=f"{benchmark.name}: {target.quantity}")
    for benchmark in BENCHMARKS
    for target in benchmark.targets
]


@pytest.mark.parametrize("target", [p for p in TARGETS if p.values[0].tolerance is not None])
def test_target_is_reached(target):
    measured = target.measure()
    assert target.met_by(measured.value), (measured, target.expected, target.tolerance)


def test_names_of_targets_are_unique():
    names = [parameter.id for parameter in TARGETS]
    assert len(set(names)) == len(names)


def test_the_page_is_what_the_command_writes():
    """Otherwise: python3 tests/verification/targets.py > docs/verification.md."""
    assert PAGE.read_text(encoding="utf-8") == page()
