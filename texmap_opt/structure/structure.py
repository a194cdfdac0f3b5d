"""A lattice as joints and struts."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True, eq=False)
class Structure:
    """Joints, and straight struts between them.

    Attributes:
        joints: positions [mm].
        struts: the two joints of each strut.
        radii: radius of each strut at its first and its second joint [mm]; for a square section
            half the side.
        cut: joints made by cutting a strut at the part's surface (they lie on it).
        cell_size: mean edge of the warped cell each strut came from, over the edge of a uniform
            cell: what `radius_mode = "scaled"` multiplies the radius by.
        section: "round" or "square".
    """

    joints: Float[np.ndarray, "joints 3"]
    struts: Int[np.ndarray, "struts 2"]
    radii: Float[np.ndarray, "struts 2"]
    cut: Bool[np.ndarray, " joints"]
    cell_size: Float[np.ndarray, " struts"]
    section: str = "round"

    def lengths(self) -> Float[np.ndarray, " struts"]:
        """Length of each strut between its joints [mm]."""
        start, end = self.joints[self.struts[:, 0]], self.joints[self.struts[:, 1]]
        return np.linalg.norm(end - start, axis=1)

    def with_radii(self, radii: Float[np.ndarray, "struts 2"]) -> "Structure":
        """The same joints and struts with other radii [mm]."""
        return replace(self, radii=radii)
