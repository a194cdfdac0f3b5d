"""The zip package a 3MF file is, and the text of its vertices and triangles, written as streams."""

import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.export.rows_text import rows_text
from texmap_opt.export.whole_file import whole_file

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
# Fastest deflate: a third of the file of none, in a fifth of the time of the default.
COMPRESSION = 1
# A fixed time stamp, so that equal content gives equal files; the earliest zip can hold.
TIMESTAMP = (1980, 1, 1, 0, 0, 0)

_CONTENT_TYPES = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" '
    'ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" '
    'ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>\n'
)
_RELATIONSHIPS = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Target="/3D/3dmodel.model" Id="rel0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>\n'
)


def write_package(path: Path, model: Iterable[str]) -> None:
    """Writes a 3MF package around the text of its model.

    Args:
        path: the file.
        model: pieces of the XML of `3D/3dmodel.model`.

    Raises:
        OutputError: when the file cannot be written.
    """
    with whole_file(path) as file, zipfile.ZipFile(file, "w") as package:
        for name, pieces in (
            ("[Content_Types].xml", (_CONTENT_TYPES,)),
            ("_rels/.rels", (_RELATIONSHIPS,)),
            ("3D/3dmodel.model", model),
        ):
            entry = zipfile.ZipInfo(name, TIMESTAMP)
            entry.compress_type = zipfile.ZIP_DEFLATED
            # The private attribute is the documented constructor's one way to a level before 3.13.
            entry._compresslevel = COMPRESSION  # pyright: ignore[reportAttributeAccessIssue]
            with package.open(entry, "w", force_zip64=True) as stream:
                for piece in pieces:
                    stream.write(piece.encode())


def model_text(body: Iterable[str], *, attributes: str = "", name: str) -> Iterator[str]:
    """The XML of a model with one mesh object in millimetres.

    Args:
        body: what stands inside `<mesh>`.
        attributes: further attributes of `<model>`: namespaces and required extensions.
        name: name of the object, plain letters.
    """
    yield '<?xml version="1.0" encoding="UTF-8"?>\n'
    yield f'<model unit="millimeter" xml:lang="en-US" xmlns="{CORE}"{attributes}>\n'
    yield f'<resources><object id="1" type="model" name="{name}"><mesh>\n'
    yield from body
    yield '</mesh></object></resources>\n<build><item objectid="1"/></build>\n</model>\n'


def vertices_text(vertices: Float[np.ndarray, "n 3"]) -> Iterator[str]:
    """The `<vertices>` element; nine digits, which hold any float32 exactly."""
    yield "<vertices>\n"
    yield from rows_text('<vertex x="%.9g" y="%.9g" z="%.9g"/>\n', vertices)
    yield "</vertices>\n"


def triangles_text(faces: Int[np.ndarray, "n 3"]) -> Iterator[str]:
    """The `<triangles>` element."""
    yield "<triangles>\n"
    yield from rows_text('<triangle v1="%d" v2="%d" v3="%d"/>\n', faces)
    yield "</triangles>\n"
