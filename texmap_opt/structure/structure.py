"""A lattice as joints and struts."""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse.csgraph
from jaxtyping import Bool, Float, Int

from texmap_opt.errors import StructureError, nearest_name
from texmap_opt.structure.strut_geometry import strut_lengths


@dataclass(frozen=True, eq=False)
class Origin:
    """Where in the grid each strut came from.

    Attributes:
        cell: number of the grid cell, in C order; of those that share a strut the first.
        kind: index into `kinds`.
        kinds: names of unit cells, and `TRANSITION` for struts that join two kinds.
    """

    cell: Int[np.ndarray, " struts"]
    kind: Int[np.ndarray, " struts"]
    kinds: tuple[str, ...]

    def select(self, struts: Bool[np.ndarray, " struts"] | Int[np.ndarray, " kept"]) -> "Origin":
        """That of some struts, in their order."""
        return Origin(self.cell[struts], self.kind[struts], self.kinds)


# Kind of the struts that join unit cells whose faces differ.
TRANSITION = "transition"
# Sections of bars, and that of the walls of an extruded lattice.
WALL = "wall"
SECTIONS = ("round", "square", WALL)
# Share by which a direction's length, and what follows from it, may be off: an axis typed with
# seven digits.
AXIS_TOLERANCE = 1e-6
# Largest coordinate and radius [mm], a thousand kilometres: powers of lengths stay finite, and float64
# still tells a ten-thousandth of a millimetre.
FARTHEST = 1e9


@dataclass(frozen=True, eq=False)
class Extrusion:
    """What makes walls of the struts of a cross-section (2.5-D): a direction and two heights.

    Attributes:
        axis: unit vector of the direction of extrusion.
        low, high: coordinates along it between which the walls stand [mm].
        depth: of each wall inside the part, on the mean [mm]; at most high - low.
    """

    axis: Float[np.ndarray, " 3"]
    low: float
    high: float
    depth: Float[np.ndarray, " struts"]

    def select(self, struts: Bool[np.ndarray, " struts"] | Int[np.ndarray, " kept"]) -> "Extrusion":
        """That of some struts, in their order."""
        return replace(self, depth=self.depth[struts])


@dataclass(frozen=True, eq=False)
class Structure:
    """Joints, and straight struts between them.

    The struts of an extruded (2.5-D) lattice are walls: joints lie in the plane half way between
    its two heights, the radius is half the thickness of a wall, and `section` is "wall".

    Attributes:
        joints: positions [mm].
        struts: the two joints of each strut.
        radii: radius of each strut at its first and its second joint [mm]; for a square section
            half the side.
        cut: joints made by cutting a strut at the part's surface (they lie on it).
        cell_size: mean edge of the warped cell each strut came from, over the edge of a uniform
            cell: what `radius_mode = "scaled"` multiplies the radius by.
        section: "round", "square", or "wall" where there is an extrusion.
        origin: where struts came from; None: they are not from a grid.
        extrusion: of the walls; None: struts are bars.
    """

    joints: Float[np.ndarray, "joints 3"]
    struts: Int[np.ndarray, "struts 2"]
    radii: Float[np.ndarray, "struts 2"]
    cut: Bool[np.ndarray, " joints"]
    cell_size: Float[np.ndarray, " struts"]
    section: str = "round"
    origin: Origin | None = None
    extrusion: Extrusion | None = None

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

    def extruded(
        self, axis: Float[np.ndarray, " 3"], heights: Float[np.ndarray, " 2"]
    ) -> "Structure":
        """The same joints and struts as walls along a unit vector, between two heights [mm]."""
        low, high = (float(height) for height in heights)
        depth = np.full(len(self.struts), high - low)
        return replace(self, section="wall", extrusion=Extrusion(axis, low, high, depth))

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
            origin=None if self.origin is None else self.origin.select(struts),
            extrusion=None if self.extrusion is None else self.extrusion.select(struts),
        )

    def validate(self) -> None:
        """Check what every later stage relies on.

        Raises:
            StructureError: naming the first joint or strut that breaks an invariant.
        """
        _refuse(
            ~(np.abs(self.joints) <= FARTHEST).all(axis=1),
            f"joint {{}} has a coordinate that is not a finite number within {FARTHEST:g} mm.",
        )
        _refuse(
            ((self.struts < 0) | (self.struts >= len(self.joints))).any(axis=1),
            f"strut {{}} ends at a joint that does not exist; there are {len(self.joints)} joints.",
        )
        _refuse(self.lengths() == 0, "strut {} has no length; remove it or move its joint.")
        _refuse(
            ~((self.radii > 0) & (self.radii <= FARTHEST)).all(axis=1),
            f"strut {{}} has a radius that is not a positive number up to {FARTHEST:g} mm.",
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
        if self.section not in SECTIONS:
            raise StructureError(
                f'structure: section is "{self.section}"; {nearest_name(self.section, SECTIONS)}'
            )
        if self.origin is not None:
            self._validate_origin(self.origin)
        if (self.section == WALL) != (self.extrusion is not None):
            raise StructureError(
                f'structure: section is "{self.section}" '
                f"{'with' if self.extrusion else 'without'} an extrusion; walls have one, bars have "
                "none."
            )
        if self.extrusion is not None:
            self._validate_extrusion(self.extrusion)

    def _validate_origin(self, origin: Origin) -> None:
        if len(set(origin.kinds)) < len(origin.kinds):
            raise StructureError(
                f"structure: kinds are {', '.join(origin.kinds)}; names must differ."
            )
        _refuse(origin.cell < 0, "strut {} is of a cell with a negative number.")
        _refuse(
            (origin.kind < 0) | (origin.kind >= len(origin.kinds)),
            f"strut {{}} is of a kind that does not exist; there are {len(origin.kinds)} kinds.",
        )

    def _validate_extrusion(self, extrusion: Extrusion) -> None:
        axis, low, high = extrusion.axis, extrusion.low, extrusion.high
        if not abs(np.linalg.norm(axis) - 1) < AXIS_TOLERANCE:
            raise StructureError(
                f"structure: the axis of extrusion {axis.tolist()} is not a unit vector."
            )
        if not -FARTHEST <= low < high <= FARTHEST:
            raise StructureError(
                f"structure: walls stand from {low:g} to {high:g} mm; give two heights, the lower "
                "first."
            )
        room = (high - low) * (1 + AXIS_TOLERANCE)
        _refuse(
            ~((extrusion.depth > 0) & (extrusion.depth <= room)),
            f"wall {{}} has a depth that is not between 0 and {high - low:g} mm.",
        )
        off = np.abs(self.joints @ axis - (low + high) / 2)
        reach = np.abs(self.joints).max(initial=high - low)
        _refuse(
            off > AXIS_TOLERANCE * reach,
            f"joint {{}} is not half way between the heights {low:g} and {high:g} mm of its walls.",
        )


def _refuse(wrong: Bool[np.ndarray, " samples"] | np.bool, message: str) -> None:
    wrong = np.atleast_1d(wrong)
    if wrong.any():
        raise StructureError("structure: " + message.format(int(np.argmax(wrong))))
