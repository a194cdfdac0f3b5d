"""What supports hold of a frame of walls, which moves in its plane only.

The rules are those of docs/decisions/0011-mechanics-of-extruded-lattices.md.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

import fea
from fea import FeaError
from fea.frame import FrameProblem
from fea.sections import section
from texmap_opt.case import DesignCase
from texmap_opt.errors import LatticeError
from texmap_opt.skinned_frame import FrameSkin
from texmap_opt.structure.structure import Structure


class FrameSupports(NamedTuple):
    """What holds a frame.

    Attributes:
        axes: unit vectors along which components are taken, as rows: x, y, z, but for walls whose
            axis of extrusion is none of them.
        fixed: prescribed degrees of freedom, along the axes.
        value: their values [mm, rad].
    """

    axes: Float[np.ndarray, "3 3"]
    fixed: Bool[np.ndarray, "joints 6"]
    value: Float[np.ndarray, "joints 6"]


def plane_supports(
    structure: Structure,
    axis: Float[np.ndarray, " 3"],
    skin: FrameSkin | None,
    held: Bool[np.ndarray, "joints 3"],
    moved: Float[np.ndarray, "joints 3"],
    case: DesignCase,
) -> FrameSupports:
    """Supports of a case on the joints of walls; a joint held both ways in the plane is clamped.

    Args:
        structure: joints and walls.
        axis: of extrusion.
        skin: what they hang on, whose vertices are joints after theirs; None: there is none.
        held: displacements along x, y, z that the case prescribes.
        moved: their values [mm].
        case: names the file in messages.

    Raises:
        LatticeError: a displacement out of the plane, or joints held in oblique directions.
    """
    nothing = np.zeros((len(held), 3))
    vertices = np.zeros((0, 3)) if skin is None else skin.mesh.surface.vertices
    frame = FrameProblem(
        joints=np.concatenate([structure.joints, vertices]),
        struts=structure.struts,
        radii=structure.radii,
        E=case.material.E,
        nu=case.material.nu,
        section=section(structure.section),
        fixed=np.hstack([held, nothing.astype(bool)]),
        value=np.hstack([moved, nothing]),
        forces=np.zeros((1, len(held), 6)),
        couplings=() if skin is None else (skin.tie,),
    )
    try:
        plane = fea.in_plane(frame, axis)
    except FeaError as failure:
        raise LatticeError(f"{case.path.name}: [[support]]: {failure}") from failure
    fixed, value = plane.problem.fixed.copy(), plane.problem.value
    fixed[:, 5] |= fixed[:, 0] & fixed[:, 1]
    along = np.abs(plane.axes).round() == 1
    if not np.array_equal(np.abs(plane.axes), along):
        return FrameSupports(plane.axes, fixed, value)
    # The frame's axes are x, y, z in another order: back to theirs, in which all else is given.
    order = along.argmax(axis=0)
    return FrameSupports(
        np.eye(3), fixed[:, np.concatenate([order, 3 + order])], plane.to_space(value)
    )
