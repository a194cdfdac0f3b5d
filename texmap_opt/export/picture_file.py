"""Files of pictures: PNG, whole or not at all."""

from pathlib import Path

from texmap_opt.errors import InputError
from texmap_opt.export.whole_file import whole_file

ENDING = ".png"


def require_png(path: Path) -> None:
    """Refuse a picture whose file is named after another format than the one it is written in.

    Raises:
        InputError: with a name that is right.
    """
    if path.suffix.lower() != ENDING:
        raise InputError(
            f'{path}: the ending "{path.suffix}" is not {ENDING}, the only format of pictures; name it '
            f"{path.with_suffix(ENDING).name}."
        )


def write_png(path: Path, content: bytes) -> None:
    """Write a finished picture.

    Raises:
        InputError: the file is not named .png.
        OutputError: it cannot be written.
    """
    require_png(path)
    with whole_file(path) as file:
        file.write(content)
