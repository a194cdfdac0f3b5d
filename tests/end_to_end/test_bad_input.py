"""Bad input ends with one sentence, the contract's exit code, and nothing left behind."""

import re
from pathlib import Path

import bad_input
import pytest
from bad_input import (
    BAD_COMMANDS,
    BAD_INPUTS,
    BadCommand,
    BadInput,
    run_bad_command,
    run_bad_input,
    table,
)

PAGE = Path(__file__).parents[2] / "docs" / "bad-input.md"
# Faults whose message has figures that depend on the tets, which differ from one meshing to the next.
MESHED = {
    "inside-out",
    "supports that leave a rigid motion",
    "imported results in another unit",
    "warp that does not come to rest",
    "least squares with too few steps",
}

Said = dict[str, tuple[int, str, list[str]]]


@pytest.fixture(scope="module")
def said() -> Said:
    """Exit code, message and files left behind, by fault, of those that were run."""
    return {}


@pytest.mark.parametrize("bad", BAD_INPUTS, ids=lambda bad: bad.name)
def test_bad_input_gets_one_sentence_and_leaves_nothing(bad: BadInput, said: Said, tmp_path: Path):
    code, message, left = said[bad.name] = run_bad_input(bad, tmp_path)
    assert code == bad.code
    assert message.count("texmap: ") == (code != 0)
    for words in bad.says:
        assert words.lower() in message.lower()
    assert left == ([] if code else ["out"])


@pytest.mark.parametrize("bad", BAD_COMMANDS, ids=lambda bad: bad.name)
def test_a_command_typed_wrongly_gets_one_line_and_leaves_nothing(bad: BadCommand, tmp_path: Path):
    code, message, left = run_bad_command(bad, tmp_path)
    assert code == 2
    assert message.startswith("texmap")
    assert "\n" not in message
    for words in bad.says:
        assert words in message
    assert not left


def test_the_page_is_what_its_command_writes(said: Said, monkeypatch: pytest.MonkeyPatch):
    """Written anew by `python3 tests/end_to_end/bad_input.py > docs/bad-input.md`."""
    assert {bad.name for bad in BAD_INPUTS} >= MESHED
    # What the tests above ran is not run again.
    run = bad_input.run_bad_input
    monkeypatch.setattr(
        bad_input, "run_bad_input", lambda bad, at: said.get(bad.name) or run(bad, at)
    )
    assert lines(PAGE.read_text(encoding="utf-8")) == lines(table())


def lines(page: str) -> list[str]:
    """Of the page; of messages with figures from the tets without these and what they decide."""
    return [
        re.sub(
            r"\d+(\.\d+)?(e[-+]\d+)?", "#", re.sub(r" warning: (lattice|printing): .*", "", line)
        )
        if line.removeprefix("| ").split(" | ")[0] in MESHED
        else line
        for line in page.splitlines()
    ]
