"""One period of a unit cell as a frame of struts, with or without a joint model."""

from dataclasses import replace

import numpy as np

from fea.beam import StrutMaterial
from fea.periodic_frame import PeriodicFrame
from texmap_opt.cells.joint_model import JointModel
from texmap_opt.cells.unit_cell import UnitCell
from texmap_opt.structure.tile import tile


def periodic_frame(
    cell: UnitCell,
    *,
    edge: float,
    radius: float,
    material: StrutMaterial,
    joint_model: JointModel | None = None,
) -> PeriodicFrame:
    """The struts of one period: one cell, or two along each axis where cells are mirrored.

    Args:
        cell: the unit cell.
        edge: of the undistorted cell along its first axis [mm].
        radius: of struts of relative radius 1 [mm].
        material: E [MPa], nu and section.
        joint_model: None: beams from joint to joint.

    Raises:
        LatticeError: for struts thicker than the joint model was fitted to.
    """
    net = tile(cell, cell.period)
    edges = edge * np.array(cell.proportions)
    frame = PeriodicFrame.from_block(
        edges * net.joints,
        net.struts,
        np.repeat(radius * net.relative_radius[:, None], 2, axis=1),
        np.diag(edges * np.array(cell.period)),
        material,
    )
    if joint_model is None:
        return frame
    lengths = np.linalg.norm(np.diff(frame.ends, axis=1)[:, 0], axis=1)
    joint_model.check(frame.radii, lengths)
    return replace(
        frame,
        rigid_ends=np.asarray(joint_model.rigid_ends(frame.radii)),
        modulus=np.asarray(joint_model.relative_modulus(frame.radii, lengths)),
    )
