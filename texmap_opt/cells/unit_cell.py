"""A unit cell: the pattern of joints and struts that is repeated to make a lattice."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.cells.joint_model import JointModel

# Of struts that are bars, by the number of dimensions; those of a cross-section become walls.
SECTIONS = {2: ("wall",), 3: ("round", "square")}
TILINGS = ("translate", "mirror")
CLASSIFICATIONS = ("stretching", "bending")

# Steps per cell edge in which joints are compared: lcm(1..16) x 1000, so that fractions with
# denominators up to 16 and decimals of three digits fall on steps exactly; others (the golden ratio
# of an icosahedron) are rounded by 1e-9 of a cell, far below any strut.
TICKS = 720_720_000


@dataclass(frozen=True, eq=False)
class UnitCell:
    """Joints in the unit cube or square, struts between them, and how copies are put side by side.

    A cell of two dimensions (2.5-D) is the cross-section of one that is extruded.

    Attributes:
        name: what the case file calls it.
        joint_names: the id of each joint in its file.
        joints: positions in the unit cube or square.
        struts: the two joints of each strut.
        relative_radius: radius of each strut over the radius asked for.
        section: "round" or "square"; "wall" in two dimensions.
        mirrored: for each axis whether odd cells along it are reflected; else all are copies.
        proportions: edges of the undistorted cell, whose longest is of no special length. What has a
            size in space (stiffness, pictures, the grid of `cell_mm`) stretches the unit cube so.
        classification: "stretching" or "bending" (Deshpande, Ashby, Fleck 2001).
        symmetry: crystal system of the endless undistorted lattice.
        source: publication.
        description: one or two sentences.
        aliases: other names it goes by.
        joint_model: what its joints add to a frame; None where nobody has calibrated it.
    """

    name: str
    joint_names: tuple[str, ...]
    joints: Float[np.ndarray, "joints d"]
    struts: Int[np.ndarray, "struts 2"]
    relative_radius: Float[np.ndarray, " struts"]
    section: str
    mirrored: tuple[bool, ...]
    proportions: tuple[float, ...]
    classification: str
    symmetry: str
    source: str
    description: str
    aliases: tuple[str, ...] = ()
    joint_model: JointModel | None = None

    @property
    def dimensions(self) -> int:
        """3, or 2 for a cell that is extruded."""
        return self.joints.shape[1]

    @property
    def tiling(self) -> str:
        """As in the file: translate or mirror, one word for each axis, or one where all agree."""
        words = ["mirror" if mirrored else "translate" for mirrored in self.mirrored]
        return words[0] if len(set(words)) == 1 else " ".join(words)

    @property
    def period(self) -> tuple[int, ...]:
        """Cells along each axis after which the lattice repeats."""
        return tuple(2 if mirrored else 1 for mirrored in self.mirrored)

    @property
    def ticks(self) -> Int[np.ndarray, "joints d"]:
        """Positions in whole steps of 1/`TICKS`: exact to compare, and to reflect."""
        return np.rint(self.joints * TICKS).astype(np.int64)

    @property
    def edges(self) -> Float[np.ndarray, "struts d"]:
        """From the first joint of each strut to its second, in the undistorted cell."""
        ends = self.joints[self.struts] * np.array(self.proportions)
        return ends[:, 1] - ends[:, 0]
