"""The folder of a run: whole or not at all, and messages that name what the user named."""

from pathlib import Path

import pytest

from texmap_opt.errors import OutputError
from texmap_opt.export.run_folder import _staged, check_writable
from texmap_opt.export.whole_file import whole_file


def fill_up(out: Path) -> None:
    with _staged(out) as folder:
        (folder / "part.3mf").write_bytes(b"whole")
        with whole_file(folder / "part.stl") as file:
            file.write(b"half")
            raise OSError(28, "No space left on device")


def test_a_disk_that_fills_up_leaves_the_folder_as_it_was_and_names_it(tmp_path: Path):
    """The hidden folder of the files on their way is not in the message, nor on the disk."""
    out = tmp_path / "out"
    with pytest.raises(OutputError) as caught:
        fill_up(out)
    assert str(caught.value).startswith(f"{out / 'part.stl'} cannot be written: No space left")
    assert not list(tmp_path.iterdir())
    out.mkdir()
    (out / "part.3mf").write_bytes(b"old")
    with pytest.raises(OutputError):
        fill_up(out)
    assert [p.name for p in out.iterdir()] == ["part.3mf"]
    assert (out / "part.3mf").read_bytes() == b"old"


def test_a_folder_in_the_place_of_a_file_is_refused_before_anything_is_computed(tmp_path: Path):
    check_writable(tmp_path, ())
    (tmp_path / "report.json").mkdir()
    with pytest.raises(OutputError, match=r"has a folder named report\.json.*rename it"):
        check_writable(tmp_path, ())
