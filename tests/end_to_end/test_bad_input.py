"""Bad input ends with one sentence, the contract's exit code, and nothing left behind."""

from pathlib import Path

import pytest
from bad_input import BAD_INPUTS, BadInput, run_bad_input


@pytest.mark.parametrize("bad", BAD_INPUTS, ids=lambda bad: bad.name)
def test_bad_input_gets_one_sentence_and_leaves_nothing(bad: BadInput, tmp_path: Path):
    code, message, left = run_bad_input(bad, tmp_path)
    assert code == bad.code
    assert message.count("texmap: ") == (code != 0)
    for words in bad.says:
        assert words.lower() in message.lower()
    assert left == ([] if code else ["out"])
