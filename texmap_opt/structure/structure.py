"""A lattice as joints and struts."""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse.csgraph
from jaxtyping import Bool, Float, Int

from texmap_opt.errors import StructureError
from texmap_opt.structure.strut_geometry import strut_lengths


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
        return strut_lengths(self.joints, self.struts)

    def degrees(self) -> Int[np.ndarray, " joints"]:
        """How many struts meet at each joint."""
        return np.bincount(self.struts.reshape(-1), minlength=len(self.joints))

    def components(self) -> Int[np.ndarray, " joints"]:
        """Label 0, 1, 2... of the connected piece of each joint; a bare joint is a piece."""
        n = len(self.joints)
        a, b = self.struts.T
        graph = scipy.sparse.coo_array((np.ones(len(a)), (a, b)), shape=(n, n))
        return scipy.sparse.csgraph.connected_components(graph, directed=False)[1].astype(np.int64)

    def with_radii(self, radii: Float[np.ndarray, "struts 2"]) -> "Structure":
        """The same joints and struts with other radii [mm]."""
        return replace(self, radii=radii)

    def select(self, struts: Bool[np.ndarray, " struts"]) -> "Structure":
        """The marked struts and the joints they need, in the same order."""
        used = np.zeros(len(self.joints), bool)
        used[self.struts[struts]] = True
        number = np.cumsum(used) - 1
        return replace(
            self,
            joints=self.joints[used],
            struts=number[self.struts[struts]],
            radii=self.radii[struts],
            cut=self.cut[used],
            cell_size=self.cell_size[struts],
        )

    def validate(self) -> None:
        """Check what every later stage relies on.

        Raises:
            StructureError: naming the first joint or strut that breaks an invariant.
        """
        _refuse(
            ~np.isfinite(self.joints).all(axis=1),
            "joint {} has a coordinate that is not a finite number.",
        )
        _refuse(
            ((self.struts < 0) | (self.struts >= len(self.joints))).any(axis=1),
            f"strut {{}} ends at a joint that does not exist; there are {len(self.joints)} joints.",
        )
        _refuse(self.lengths() == 0, "strut {} has no length; remove it or move its joint.")
        _refuse(
            ~(np.isfinite(self.radii) & (self.radii > 0)).all(axis=1),
            "strut {} has a radius that is not a positive number.",
        )
        _refuse(
            ~(np.isfinite(self.cell_size) & (self.cell_size > 0)),
            "strut {} has a cell size that is not a positive number.",
        )
        a, b = np.sort(self.struts, axis=1).T
        key = a * len(self.joints) + b
        first = np.unique(key, return_index=True)[1]
        again = np.ones(len(key), bool)
        again[first] = False
        _refuse(again, "strut {} repeats an earlier strut; remove one of them.")


def _refuse(wrong: Bool[np.ndarray, " samples"] | np.bool, message: str) -> None:
    wrong = np.atleast_1d(wrong)
    if wrong.any():
        raise StructureError("structure: " + message.format(int(np.argmax(wrong))))
