"""3MF beam lattice: joints and round struts themselves, not their triangles.

3MF Beam Lattice Extension 1.2.0 (3MF Consortium): `beamlattice` of namespace 2017/02, and `balls`
of namespace 2020/07. Beams have a radius at each end and flat ends; a ball at every joint has the
radius of its thickest strut. A program that knows the lattice only still gets round ends: both
namespaces are required, as the specification recommends for lattices with balls.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from texmap_opt.errors import OutputError
from texmap_opt.export.rows_text import rows_text
from texmap_opt.export.three_mf_package import model_text, vertices_text, write_package
from texmap_opt.structure.structure import WALL, Structure

BEAMS = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"
BALLS = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/balls/2020/07"
# Readers leave out shorter beams [mm]; none of ours is.
MIN_LENGTH = 1e-6


def write_beam_lattice(path: Path, structure: Structure) -> None:
    """Writes the joints and struts of a structure.

    Raises:
        OutputError: for struts that are not round, or when the file cannot be written.
    """
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
    attributes = f' xmlns:b="{BEAMS}" xmlns:b2="{BALLS}" requiredextensions="b b2"'
    write_package(path, model_text(_lattice(structure), attributes=attributes, name="lattice"))


def _lattice(structure: Structure) -> Iterator[str]:
    # A joint without struts may not carry a ball, and would only be in the way.
    joints, struts = np.unique(structure.struts, return_inverse=True)
    struts = struts.reshape(-1, 2).astype(np.int64)
    ball = np.zeros(len(joints))
    np.maximum.at(ball, struts.ravel(), structure.radii.ravel())
    typical = float(np.median(structure.radii))
    yield from vertices_text(structure.joints[joints])
    yield (
        f'<b:beamlattice radius="{typical:.9g}" minlength="{MIN_LENGTH:.9f}" cap="butt" '
        f'b2:ballmode="all" b2:ballradius="{typical:.9g}">\n<b:beams>\n'
    )
    yield from rows_text('<b:beam v1="%d" v2="%d" r1="%.9g" r2="%.9g"/>\n', struts, structure.radii)
    yield "</b:beams>\n<b2:balls>\n"
    yield from rows_text('<b2:ball vindex="%d" r="%.9g"/>\n', np.arange(len(joints)), ball)
    yield "</b2:balls>\n</b:beamlattice>\n"
