"""The cache gives back what was put in, only for equal inputs, within its limit."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from texmap_opt.cache import StageCache, stage_key


@dataclass(frozen=True)
class Section:
    edge: float
    names: tuple[str, ...]


def test_arrays_come_back_bit_for_bit(tmp_path: Path):
    cache = StageCache(tmp_path / "cache")
    arrays = {"a": np.linspace(0, 1, 7), "b": np.array(["lift", "push"])}
    cache.put("key", arrays)
    found = cache.get("key")
    assert found is not None
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)
    assert cache.get("other") is None


def test_no_directory_keeps_nothing():
    cache = StageCache(None)
    cache.put("key", {"a": np.zeros(1)})
    assert cache.get("key") is None


def test_a_damaged_file_counts_as_absent(tmp_path: Path):
    cache = StageCache(tmp_path)
    cache.put("key", {"a": np.zeros(1000)})
    file = tmp_path / "key.npz"
    file.write_bytes(file.read_bytes()[:200])
    assert cache.get("key") is None


def test_the_least_recently_used_goes_first(tmp_path: Path):
    cache = StageCache(tmp_path, limit_mb=0.02)
    for age, name in enumerate(("old", "older")):
        cache.put(name, {"a": np.zeros(1000)})
        os.utime(tmp_path / f"{name}.npz", (1000 - age, 1000 - age))
    cache.put("new", {"a": np.zeros(1000)})
    assert cache.get("older") is None
    assert cache.get("old") is not None
    assert cache.get("new") is not None


def test_a_folder_that_cannot_be_written_only_keeps_nothing(tmp_path: Path):
    file = tmp_path / "file"
    file.write_text("not a folder")
    cache = StageCache(file / "cache")
    cache.put("key", {"a": np.zeros(1)})
    assert cache.get("key") is None


def test_equal_inputs_have_equal_keys():
    def key(edge=1.0):
        return stage_key("tets", np.arange(3.0), Section(edge, ("x", "y")), None, {"b": 1, "a": 2})

    assert key() == key()
    assert key() != key(2.0)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (np.zeros(3), np.zeros((3, 1))),
        (np.zeros(2), np.zeros(2, np.int64)),
        (Section(1.0, ("ab",)), Section(1.0, ("a", "b"))),
        (("a", ("b",)), (("a", "b"),)),
        (1, "1"),
        (1, 1.0),
        (None, "None"),
    ],
)
def test_different_inputs_have_different_keys(one: object, other: object):
    assert stage_key("s", one) != stage_key("s", other)


def test_an_input_that_cannot_be_told_apart_is_refused():
    with pytest.raises(TypeError, match="object"):
        stage_key("s", object())
