"""3MF beam lattice: joints and round struts themselves, not their triangles.

3MF Beam Lattice Extension 1.2.0 (3MF Consortium), section 2.1. Beams have a radius at each end and
spheres of these radii as caps, whose union at a joint is the ball of its thickest strut. Its balls
(namespace of 2020) would say the same to fewer programs.
"""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from texmap_opt.errors import OutputError
from texmap_opt.export.metadata import Metadata
from texmap_opt.export.rows_text import rows_text
from texmap_opt.export.three_mf_package import (
    assembly_text,
    mesh_text,
    model_text,
    object_text,
    vertices_text,
    write_package,
)
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.structure import WALL, Structure

BEAMS = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"
# Readers must leave out shorter beams, and writers may not write them [mm]; float32 numbers that differ
# are farther apart from 16 mm on.
MIN_LENGTH = 1e-6
# Numbers of the objects; a mesh stands before the objects that name it.
CLIPPING, PREVIEW, SKIN, LATTICE, BUILT = 1, 2, 3, 4, 5


def write_beam_lattice(
    path: Path,
    structure: Structure,
    *,
    clipping: TriMesh | None = None,
    skin: TriMesh | None = None,
    preview: TriMesh | None = None,
    metadata: Metadata | None = None,
) -> tuple[str, ...]:
    """Writes the joints and struts of a structure, and what surrounds them.

    With `clipping` the solid is the part of the struts inside that mesh, with `skin` the union of this
    with that mesh. Coordinates and radii have nine digits. Struts of less than a millionth of a millimetre
    are left out: they are inside the balls at their ends.

    Args:
        path: the file.
        structure: round struts [mm].
        clipping: a closed surface that the struts are cut at [mm].
        skin: a closed surface that is built as it is, beside the struts [mm].
        preview: a closed surface that programs may show instead of the struts [mm] (`representationmesh`).
        metadata: title and origin; None: the file's name is the title.

    Returns:
        What the file could not keep, in sentences.

    Raises:
        OutputError: for struts that are not round or all too short, or when the file cannot be written.
    """
    _require_round(path, structure)
    long = _long_enough(structure)
    if not long.any():
        raise OutputError(
            f"{path}: no strut is longer than {MIN_LENGTH:g} mm in the file's single precision; check the "
            "structure's unit."
        )
    meshes = {
        number: (name, mesh)
        for number, name, mesh in (
            (CLIPPING, "clipping", clipping),
            (PREVIEW, "preview", preview),
            (SKIN, "skin", skin),
        )
        if mesh is not None
    }
    objects = [object_text(n, name, mesh_text(mesh)) for n, (name, mesh) in meshes.items()]
    attributes = "".join(
        text
        for mesh, text in (
            (clipping, f' clippingmode="inside" clippingmesh="{CLIPPING}"'),
            (preview, f' representationmesh="{PREVIEW}"'),
        )
        if mesh is not None
    )
    lattice = _lattice(structure.joints, structure.struts[long], structure.radii[long], attributes)
    objects.append(object_text(LATTICE, "lattice", lattice))
    if skin is not None:
        objects.append(assembly_text(BUILT, "part", (SKIN, LATTICE)))
    text = model_text(
        chain.from_iterable(objects),
        built=[LATTICE if skin is None else BUILT],
        metadata=metadata or Metadata(title=Path(path).stem),
        attributes=f' xmlns:b="{BEAMS}" requiredextensions="b"',
    )
    write_package(path, text)
    short = int((~long).sum())
    return (f"{short} struts shorter than {MIN_LENGTH:g} mm were left out",) if short else ()


def _long_enough(structure: Structure) -> Bool[np.ndarray, " struts"]:
    """Which struts have a length in float32, as readers hold vertices."""
    first, last = structure.joints.astype(np.float32)[structure.struts].swapaxes(0, 1)
    return np.linalg.norm((last - first).astype(np.float64), axis=1) >= MIN_LENGTH


def _require_round(path: Path, structure: Structure) -> None:
    if structure.section == WALL:
        raise OutputError(
            f"{path}: the 3MF beam lattice knows round struts only, these are walls; write their solid "
            "instead (texmap mesh)."
        )
    if structure.section != "round":
        raise OutputError(
            f"{path}: the 3MF beam lattice knows round struts only, these are "
            f'"{structure.section}". Use section = "round".'
        )


def _lattice(
    joints: Float[np.ndarray, "joints 3"],
    struts: Int[np.ndarray, "struts 2"],
    radii: Float[np.ndarray, "struts 2"],
    attributes: str,
) -> Iterator[str]:
    # Joints without struts would only be in the way.
    used, ends = np.unique(struts, return_inverse=True)
    yield from vertices_text(joints[used])
    yield (
        f'<b:beamlattice radius="{float(np.median(radii)):.9g}" minlength="{MIN_LENGTH:.9f}" '
        f'cap="sphere"{attributes}>\n<b:beams>\n'
    )
    row = '<b:beam v1="%d" v2="%d" r1="%.9g" r2="%.9g"/>\n'
    yield from rows_text(row, ends.reshape(-1, 2), radii)
    yield "</b:beams>\n</b:beamlattice>\n"
