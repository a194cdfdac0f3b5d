"""The zip package a 3MF file is, and the text of its model, written as streams.

3MF Core Specification 1.4.0.
"""

import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from jaxtyping import Float

from texmap_opt.export.metadata import Metadata
from texmap_opt.export.rows_text import rows_text
from texmap_opt.export.whole_file import whole_file
from texmap_opt.solid.tri_mesh import TriMesh

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


def model_text(
    resources: Iterable[str], *, built: Iterable[int], metadata: Metadata, attributes: str = ""
) -> Iterator[str]:
    """The XML of a model in millimetres that builds objects where they are.

    Args:
        resources: what stands inside `<resources>`.
        built: numbers of the objects.
        metadata: title and origin.
        attributes: further attributes of `<model>`: namespaces and required extensions.
    """
    yield '<?xml version="1.0" encoding="UTF-8"?>\n'
    yield f'<model unit="millimeter" xml:lang="en-US" xmlns="{CORE}"{attributes}>\n'
    for name, text in metadata.entries().items():
        yield f'<metadata name="{name}">{escape(text)}</metadata>\n'
    yield "<resources>\n"
    yield from resources
    items = "".join(f'<item objectid="{number}"/>' for number in built)
    yield f"</resources>\n<build>{items}</build>\n</model>\n"


def object_text(number: int, name: str, mesh: Iterable[str]) -> Iterator[str]:
    """An object that is a mesh; its number is above 0, its name plain letters."""
    yield f'<object id="{number}" type="model" name="{name}"><mesh>\n'
    yield from mesh
    yield "</mesh></object>\n"


def assembly_text(number: int, name: str, parts: Iterable[int]) -> Iterator[str]:
    """An object that is the union of other ones, which stand before it."""
    yield f'<object id="{number}" type="model" name="{name}"><components>\n'
    for part in parts:
        yield f'<component objectid="{part}"/>\n'
    yield "</components></object>\n"


def mesh_text(surface: TriMesh) -> Iterator[str]:
    """The vertices and triangles of a surface."""
    yield from vertices_text(surface.vertices)
    yield "<triangles>\n"
    yield from rows_text('<triangle v1="%d" v2="%d" v3="%d"/>\n', surface.faces)
    yield "</triangles>\n"


def vertices_text(vertices: Float[np.ndarray, "n 3"]) -> Iterator[str]:
    """The `<vertices>` element; nine digits, which hold any float32 exactly."""
    yield "<vertices>\n"
    yield from rows_text('<vertex x="%.9g" y="%.9g" z="%.9g"/>\n', vertices)
    yield "</vertices>\n"
