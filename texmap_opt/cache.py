"""Results of slow stages kept on disk, under a key made of everything that affects them."""

import dataclasses
import hashlib
import importlib.metadata
import os
import uuid
import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

import fea

# Libraries whose version changes the numbers that a stage leaves.
NUMERIC_LIBRARIES = ("numpy", "scipy", "jax", "optimistix", "pytetwild", "libigl", "pyamg")
DEFAULT_LIMIT_MB = 2048.0


@dataclass(frozen=True)
class StageCache:
    """A folder of `.npz` files, the least recently used removed above a size limit.

    Attributes:
        directory: where the files are; made when first written to. None: nothing is kept.
        limit_mb: size above which the least recently used files go [MB].
    """

    directory: Path | None
    limit_mb: float = DEFAULT_LIMIT_MB

    @staticmethod
    def default(*, limit_mb: float = DEFAULT_LIMIT_MB) -> "StageCache":
        """The user's cache folder, or the one that TEXMAP_CACHE_DIR names."""
        named = os.environ.get("TEXMAP_CACHE_DIR")
        folder = Path(named) if named else Path(platformdirs.user_cache_dir("texmap-opt"))
        return StageCache(folder, limit_mb)

    def get(self, key: str) -> dict[str, np.ndarray] | None:
        """Arrays stored under `key`, or None. A file that cannot be read counts as absent."""
        if self.directory is None:
            return None
        path = self.directory / f"{key}.npz"
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
                arrays = {name: stored[name] for name in stored.files}
            os.utime(path)
        except (OSError, ValueError, EOFError, zipfile.BadZipFile):
            return None
        return arrays

    def put(self, key: str, arrays: dict[str, np.ndarray]) -> None:
        """Store arrays under `key`; a full or read-only disk only means that nothing is kept."""
        if self.directory is None:
            return
        part = self.directory / f"{uuid.uuid4().hex}.part"
        # Whatever the disk refuses, the run goes on without a cache.
        with suppress(OSError):
            self.directory.mkdir(parents=True, exist_ok=True)
            with part.open("wb") as file:
                np.savez(file, **arrays)  # pyright: ignore[reportArgumentType]
            part.replace(self.directory / f"{key}.npz")
            self._shrink()
        with suppress(OSError):
            part.unlink(missing_ok=True)

    def put_new(
        self, key: str, stored: object, arrays: Callable[[], dict[str, np.ndarray]]
    ) -> None:
        """Store what `arrays` returns, unless `stored` shows that it came from here."""
        if stored is None and self.directory is not None:
            self.put(key, arrays())

    def _shrink(self) -> None:
        if self.directory is None:
            return
        files = sorted(self.directory.glob("*.npz"), key=lambda path: path.stat().st_mtime)
        size = sum(path.stat().st_size for path in files)
        for path in files:
            if size <= self.limit_mb * 1e6:
                return
            size -= path.stat().st_size
            path.unlink(missing_ok=True)


def stage_key(stage: str, *inputs: object) -> str:
    """Key of a stage's result: its name, the program's code, libraries, and all inputs.

    Args:
        stage: name of the stage; the key begins with it.
        inputs: arrays, numbers, text, and containers and dataclasses of them.
    """
    digest = hashlib.sha256(f"{stage}|{_code_fingerprint()}".encode())
    for value in inputs:
        _feed(digest, value)
    return f"{stage}-{digest.hexdigest()[:40]}"


def _feed(digest: Any, value: object) -> None:
    """Feed a value with its type and structure, so that different values feed different bytes."""
    if isinstance(value, np.ndarray):
        digest.update(f"array {value.dtype} {value.shape}:".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        digest.update(f"{type(value).__name__}(".encode())
        for field in dataclasses.fields(value):
            digest.update(f"{field.name}=".encode())
            _feed(digest, getattr(value, field.name))
        digest.update(b")")
    elif isinstance(value, dict):
        _feed(digest, sorted(value.items()))
    elif isinstance(value, list | tuple):
        digest.update(b"[")
        for entry in value:
            _feed(digest, entry)
        digest.update(b"]")
    elif value is None or isinstance(value, str | int | float | bool | Path):
        digest.update(f"{value!r};".encode())
    else:
        raise TypeError(f"a {type(value).__name__} cannot enter a cache key")


@cache
def _code_fingerprint() -> str:
    """Hash of both packages' sources and of the versions of the numeric libraries."""
    digest = hashlib.sha256()
    for module_file in (fea.__file__, __file__):
        folder = Path(module_file).parent
        for path in sorted(folder.rglob("*.py")):
            digest.update(path.relative_to(folder).as_posix().encode())
            digest.update(path.read_bytes())
    for library in NUMERIC_LIBRARIES:
        digest.update(f"{library}=={importlib.metadata.version(library)}".encode())
    return digest.hexdigest()
