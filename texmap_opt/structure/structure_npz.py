"""Structures in NumPy's NPZ files: the arrays as they are, for speed.

A zip of arrays that `numpy.load` reads too. Entries are stored, never compressed, so that a file
cannot be larger in memory than on disk; nothing is pickled.
"""

import io
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from texmap_opt.errors import StructureError
from texmap_opt.export.whole_file import whole_file
from texmap_opt.structure.structure import Extrusion, Origin, Structure

VERSION = 1
# A fixed time stamp, so that equal structures give equal files; the earliest zip can hold.
TIMESTAMP = (1980, 1, 1, 0, 0, 0)
# Type, and shape beyond the first axis, of every array; texts are UTF-8 bytes.
TEXT = np.dtype(np.uint8)
FLOAT, WHOLE, YES_NO = np.dtype(np.float64), np.dtype(np.int64), np.dtype(np.bool_)
BASE: dict[str, tuple[np.dtype, tuple[int, ...]]] = {
    "version": (WHOLE, ()),
    "section": (TEXT, ()),
    "provenance": (TEXT, ()),
    "joints": (FLOAT, (3,)),
    "struts": (WHOLE, (2,)),
    "radii": (FLOAT, (2,)),
    "cut": (YES_NO, ()),
    "cell_size": (FLOAT, ()),
}
ORIGIN: dict[str, tuple[np.dtype, tuple[int, ...]]] = {
    "cell": (WHOLE, ()),
    "kind": (WHOLE, ()),
    "kinds": (TEXT, ()),
}
EXTRUSION: dict[str, tuple[np.dtype, tuple[int, ...]]] = {
    "axis": (FLOAT, ()),
    "heights": (FLOAT, ()),
    "depth": (FLOAT, ()),
}


def write_structure_npz(path: Path, structure: Structure, *, provenance: Mapping[str, str]) -> None:
    """Write all arrays of a structure, and how it came about.

    Raises:
        OutputError: when the file cannot be written.
    """
    arrays = {
        "version": np.array([VERSION]),
        "section": _bytes(structure.section),
        "provenance": _bytes(dict(provenance)),
        "joints": structure.joints,
        "struts": structure.struts,
        "radii": structure.radii,
        "cut": structure.cut,
        "cell_size": structure.cell_size,
    }
    if structure.origin is not None:
        origin = structure.origin
        arrays |= {"cell": origin.cell, "kind": origin.kind, "kinds": _bytes(list(origin.kinds))}
    if structure.extrusion is not None:
        extrusion = structure.extrusion
        heights = np.array([extrusion.low, extrusion.high])
        arrays |= {"axis": extrusion.axis, "heights": heights, "depth": extrusion.depth}
    known = BASE | ORIGIN | EXTRUSION
    with whole_file(path) as file, zipfile.ZipFile(file, "w") as package:
        for name, array in arrays.items():
            entry = zipfile.ZipInfo(f"{name}.npy", TIMESTAMP)
            with package.open(entry, "w", force_zip64=True) as stream:
                values = np.ascontiguousarray(array, dtype=known[name][0])
                npy.write_array(stream, values, allow_pickle=False)


def read_structure_npz(path: Path) -> tuple[Structure, dict[str, str]]:
    """Read and check a structure, and how it came about.

    Raises:
        StructureError: the file cannot be read, is no such package, or breaks an invariant of
            `Structure`.
    """
    path = Path(path)
    try:
        with zipfile.ZipFile(path) as package:
            structure, provenance = _structure(_arrays(path, package))
    except OSError as failure:
        raise StructureError(
            f"{path}: structure file cannot be read ({failure.strerror or failure}); give an existing "
            "structure.npz."
        ) from failure
    # Broken bytes reach zipfile and NumPy, which meet them with whatever they happen to raise.
    except Exception as failure:
        if isinstance(failure, StructureError):
            raise
        reason = " ".join(str(failure).split())[:120]
        raise StructureError(
            f"{path.name}: is not a structure in NumPy's format ({reason}); write the file again."
        ) from failure
    try:
        structure.validate()
    except StructureError as failure:
        raise StructureError(f"{path.name}: {failure}") from failure
    return structure, provenance


def _arrays(path: Path, package: zipfile.ZipFile) -> dict[str, np.ndarray]:
    names = {entry.filename.removesuffix(".npy"): entry for entry in package.infolist()}
    expected = dict(BASE)
    for group in (ORIGIN, EXTRUSION):
        if group.keys() & names.keys():
            expected |= group
    missing, unknown = expected.keys() - names.keys(), names.keys() - expected.keys()
    if missing or unknown or len(names) < len(package.infolist()):
        what = (
            f"lacks {', '.join(sorted(missing))}" if missing else "has arrays beyond a structure's"
        )
        raise StructureError(f"{path.name}: {what}; write the file again with this program.")
    arrays = {}
    for name, (dtype, beyond) in expected.items():
        if names[name].compress_type != zipfile.ZIP_STORED:
            raise StructureError(
                f'{path.name}: array "{name}" is compressed; write it without compression.'
            )
        array = _array(package.read(names[name]))
        if array.dtype != dtype or array.shape[1:] != beyond or array.ndim == 0:
            shape = " x ".join(("n", *map(str, beyond)))
            raise StructureError(
                f'{path.name}: array "{name}" is {array.dtype} {array.shape}; it must be {dtype}, '
                f"{shape}."
            )
        arrays[name] = array
    if arrays["version"].tolist() != [VERSION]:
        raise StructureError(
            f"{path.name}: is of version {arrays['version'].tolist()}, known is {VERSION}; write it "
            "again with this program."
        )
    return arrays


def _array(content: bytes) -> np.ndarray:
    """An array from its bytes; their number is compared before anything is made of them."""
    stream = io.BytesIO(content)
    if npy.read_magic(stream) != (1, 0):
        raise ValueError("an array of a format that is not 1.0")
    shape, in_columns, dtype = npy.read_array_header_1_0(stream)
    if in_columns or dtype.hasobject:
        raise ValueError("an array of objects, or in Fortran order")
    # bytearray: the array may be written to, as every other structure's.
    values = np.frombuffer(bytearray(content[stream.tell() :]), dtype=dtype)
    return values.reshape(shape)


def _structure(arrays: Mapping[str, np.ndarray]) -> tuple[Structure, dict[str, str]]:
    counts = dict.fromkeys(("radii", "cell_size", "cell", "kind", "depth"), len(arrays["struts"]))
    counts |= {"cut": len(arrays["joints"]), "axis": 3, "heights": 2}
    for name, count in counts.items():
        if name in arrays and len(arrays[name]) != count:
            raise ValueError(
                f'array "{name}" has {len(arrays[name])} rows and needs {count}; write the file '
                "again."
            )
    provenance = json.loads(arrays["provenance"].tobytes())
    if not isinstance(provenance, dict) or not all(isinstance(v, str) for v in provenance.values()):
        raise ValueError("provenance is not a table of texts; write the file again.")
    origin = extrusion = None
    if "kinds" in arrays:
        kinds = json.loads(arrays["kinds"].tobytes())
        if not isinstance(kinds, list) or not all(isinstance(kind, str) for kind in kinds):
            raise ValueError("kinds are not a list of names; write the file again.")
        origin = Origin(arrays["cell"], arrays["kind"], tuple(kinds))
    if "axis" in arrays:
        low, high = arrays["heights"].tolist()
        extrusion = Extrusion(arrays["axis"], low, high, arrays["depth"])
    section = json.loads(arrays["section"].tobytes())
    structure = Structure(
        *(arrays[name] for name in ("joints", "struts", "radii", "cut", "cell_size")),
        section=str(section),
        origin=origin,
        extrusion=extrusion,
    )
    return structure, provenance


def _bytes(value: str | dict[str, str] | list[str]) -> np.ndarray:
    """A value as the bytes of its JSON text."""
    return np.frombuffer(json.dumps(value).encode(), dtype=np.uint8)
