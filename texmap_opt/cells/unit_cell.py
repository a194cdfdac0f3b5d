"""A unit cell: the pattern of joints and struts that is repeated to make a lattice."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.cells.joint_model import JointModel

SECTIONS = ("round", "square")
TILINGS = ("translate", "mirror")
CLASSIFICATIONS = ("stretching", "bending")

# Steps per cell edge in which joints are compared: lcm(1..16) x 1000, so that fractions with
# denominators up to 16 and decimals of three digits fall on steps exactly; others (the golden ratio
# of an icosahedron) are rounded by 1e-9 of a cell, far below any strut.
TICKS = 720_720_000


@dataclass(frozen=True, eq=False)
class UnitCell:
    """Joints in the unit cube, struts between them, and how copies are put side by side.

    Attributes:
        name: what the case file calls it.
        joint_names: the id of each joint in its file.
        joints: positions in the unit cube.
        struts: the two joints of each strut.
        relative_radius: radius of each strut over the radius asked for.
        section: "round" or "square".
        tiling: "translate" (every cell is a copy) or "mirror" (odd cells are reflected, along each
            axis by itself).
        classification: "stretching" or "bending" (Deshpande, Ashby, Fleck 2001).
        source: publication.
        description: one or two sentences.
        aliases: other names it goes by.
        joint_model: what its joints add to a frame; None where nobody has calibrated it.
    """

    name: str
    joint_names: tuple[str, ...]
    joints: Float[np.ndarray, "joints 3"]
    struts: Int[np.ndarray, "struts 2"]
    relative_radius: Float[np.ndarray, " struts"]
    section: str
    tiling: str
    classification: str
    source: str
    description: str
    aliases: tuple[str, ...] = ()
    joint_model: JointModel | None = None

    @property
    def ticks(self) -> Int[np.ndarray, "joints 3"]:
        """Positions in whole steps of 1/`TICKS`: exact to compare, and to reflect."""
        return np.rint(self.joints * TICKS).astype(np.int64)
