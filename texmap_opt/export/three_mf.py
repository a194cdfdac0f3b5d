"""3MF core files: triangle meshes in millimetres."""

from collections.abc import Mapping
from itertools import chain
from pathlib import Path

from texmap_opt.export.metadata import Metadata
from texmap_opt.export.three_mf_package import mesh_text, model_text, object_text, write_package
from texmap_opt.solid.tri_mesh import TriMesh


def write_three_mf(path: Path, surface: TriMesh, metadata: Metadata) -> None:
    """Writes a surface as one object of a 3MF package.

    Coordinates have nine digits, which hold any float32 exactly.

    Raises:
        OutputError: when the file cannot be written.
    """
    write_objects(path, {"part": surface}, metadata)


def write_objects(path: Path, surfaces: Mapping[str, TriMesh], metadata: Metadata) -> None:
    """Writes several surfaces as objects of one 3MF package, each an item that is built.

    Args:
        path: the file.
        surfaces: by the names of the objects, which are plain letters [mm].
        metadata: title and origin.

    Raises:
        OutputError: when the file cannot be written.
    """
    objects = (
        object_text(number, name, mesh_text(surface))
        for number, (name, surface) in enumerate(surfaces.items(), start=1)
    )
    built = range(1, len(surfaces) + 1)
    write_package(path, model_text(chain.from_iterable(objects), built=built, metadata=metadata))
