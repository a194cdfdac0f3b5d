"""Progress times stages, tells warnings once, and writes JSON that a program can read."""

import json

import pytest

from texmap_opt.progress import JsonLines, Live, Progress, Silent


def test_stages_are_timed_and_times_of_equal_names_add_up():
    progress = Progress(Silent())
    for _ in range(2):
        with progress.stage("sizing"):
            pass
    assert list(progress.seconds) == ["sizing"]
    assert 0 <= progress.seconds["sizing"] <= progress.total()


def test_a_stage_that_fails_has_no_time():
    progress = Progress(Silent())
    with pytest.raises(ZeroDivisionError), progress.stage("warp"):
        _ = 1 / 0
    assert progress.seconds == {}


def test_a_warning_is_told_once():
    progress = Progress(Silent())
    for _ in range(3):
        progress.warn("thin")
    assert progress.warnings == ["thin"]


def test_json_lines_are_one_object_a_line_on_stderr(capsys: pytest.CaptureFixture):
    progress = Progress(JsonLines())
    with progress.stage("part"):
        progress.detail("12 triangles")
    progress.warn("small")
    shown = capsys.readouterr()
    assert shown.out == ""
    events = [json.loads(line) for line in shown.err.splitlines()]
    assert [e["event"] for e in events] == ["start", "detail", "done", "warning"]
    assert events[2]["stage"] == "part"


def test_the_live_line_names_stage_and_detail_on_stderr(capsys: pytest.CaptureFixture):
    progress = Progress(Live())
    with progress.stage("part"):
        progress.detail("12 triangles")
    shown = capsys.readouterr()
    assert shown.out == ""
    assert "part" in shown.err
    assert "12 triangles" in shown.err
