"""Files that appear whole or not at all."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from texmap_opt.errors import OutputError


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A binary file to write to, which gets its name when the block ends without an error.

    It is written next to its place, so that the renaming cannot fail half way; any error, and
    Ctrl-C, removes it and leaves an older file of that name as it was.

    Args:
        path: the file wanted.

    Raises:
        OutputError: when the system refuses (no folder, no permission, disk full).
    """
    path = Path(path)
    temporary: Path | None = None
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
        temporary = Path(name)
        with os.fdopen(handle, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(path)
        temporary = None
    except OSError as failure:
        raise OutputError(
            f"{path} cannot be written: {failure.strerror or failure}. Name a file in a folder that "
            "is there and can be written, or free some space."
        ) from failure
    finally:
        if temporary is not None:
            with suppress(OSError):
                temporary.unlink()


def _umask() -> int:
    """The permissions new files lack; mkstemp made ours readable by the owner alone."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
