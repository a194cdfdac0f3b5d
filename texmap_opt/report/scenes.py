"""What each picture shows, as plain arrays: nothing here draws."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Bool, Float, Int

from texmap_opt.solid.tri_mesh import TriMesh

# A modulus that varies by less than this share over the directions is shown as constant.
ISOTROPIC = 1e-3


class Action(Enum):
    """What a mark on the part stands for."""

    SUPPORT = "support"
    FORCE = "force"
    PRESSURE = "pressure"
    SUCTION = "suction"
    MOMENT = "moment"
    GRAVITY = "gravity"


@dataclass(frozen=True, eq=False)
class Mark:
    """A support or a load, shown as a coloured area with cones or arrows.

    Attributes:
        action: what it is; pressure pushes along the inward normals, suction pulls.
        label: one line for the legend, such as "lift: 500 N on 400 mm²".
        patch: the facets it acts on; no faces for gravity.
        direction: of the force, the acceleration, or the axis of the moment; zero for supports
            and pressure.
    """

    action: Action
    label: str
    patch: TriMesh
    direction: Float[np.ndarray, "3"]


@dataclass(frozen=True, eq=False)
class LoadedPart:
    """The part's surface coloured by von Mises stress, supports and loads marked.

    Attributes:
        surface: boundary of the tet mesh, triangles only.
        von_mises: at its vertices [MPa].
        marks: supports and loads.
    """

    surface: TriMesh
    von_mises: Float[np.ndarray, " vertices"]
    marks: tuple[Mark, ...] = ()


@dataclass(frozen=True, eq=False)
class WarpedGrid:
    """The cells that meet the part, coloured by a value, in the translucent part.

    Attributes:
        nodes: corners of the cells [mm].
        values: what the colour shows, one a cell.
        meets: cells that meet the part.
        part: the part's surface.
        quantity: name for the colour bar; lines end with a newline.
        middle: value of the middle colour, for values that are good there; None: lowest to highest.
        names: where values are indices of these, which the legend tells by their colours; empty: they
            are amounts.
    """

    nodes: Float[np.ndarray, "i j k 3"]
    values: Float[np.ndarray, "x y z"]
    meets: Bool[np.ndarray, "x y z"]
    part: TriMesh
    quantity: str = "cell size\n[mm]"
    middle: float | None = None
    names: tuple[str, ...] = ()

    def behind(self, towards_eye: Float[np.ndarray, "3"]) -> Bool[np.ndarray, "x y z"]:
        """Cells that meet the part, less the octant towards the eye: so those inside are seen."""
        middles = (self.nodes[:-1, :-1, :-1] + self.nodes[1:, 1:, 1:]) / 2
        near = (middles - self.part.bounds.mean(axis=0)) * np.sign(towards_eye) > 0
        return self.meets & ~near.all(axis=-1)


@dataclass(frozen=True, eq=False)
class Struts:
    """Struts as tubes of their own radius, or walls seen along them, coloured by a value at both ends.

    Attributes:
        joints: positions [mm].
        struts: the two joints of each strut.
        radii: radius at its two ends [mm].
        values: what the colour shows, at its two ends.
        quantity: name for the colour bar, such as "strut radius".
        unit: of the values; empty for none.
        limit: a value not to be exceeded; what lies above it is drawn red.
        axis: of walls, that of their extrusion, along which they are seen; None: they are tubes.
    """

    joints: Float[np.ndarray, "joints 3"]
    struts: Int[np.ndarray, "struts 2"]
    radii: Float[np.ndarray, "struts 2"]
    values: Float[np.ndarray, "struts 2"]
    quantity: str
    unit: str
    limit: float | None = None
    axis: Float[np.ndarray, "3"] | None = None


@dataclass(frozen=True, eq=False)
class CutOpen:
    """A solid with the half towards the viewer taken away; the section is filled."""

    surface: TriMesh


@dataclass(frozen=True, eq=False)
class Whole:
    """A solid from outside."""

    surface: TriMesh


@dataclass(frozen=True, eq=False)
class Cell:
    """One unit cell in its cube.

    Attributes:
        joints: positions; the cube is their bounding box.
        struts: the two joints of each strut.
        radii: radius at its two ends.
    """

    joints: Float[np.ndarray, "joints 3"]
    struts: Int[np.ndarray, "struts 2"]
    radii: Float[np.ndarray, "struts 2"]


@dataclass(frozen=True, eq=False)
class PlannedPart:
    """The part before a run: supports and loads numbered, the grid's outline behind it.

    Attributes:
        part: the part's surface.
        marks: supports and loads; their labels become the legend.
        grid: corners of the cells that are planned [mm].
    """

    part: TriMesh
    marks: tuple[Mark, ...]
    grid: Float[np.ndarray, "i j k 3"]


@dataclass(frozen=True, eq=False)
class StiffnessSurface:
    """A surface whose distance from the origin is the modulus in that direction.

    Attributes:
        surface: round the origin, in units of the largest modulus.
        modulus: at its vertices: what the colour shows.
        quantity: name for the colour bar; lines end with a newline.
    """

    surface: TriMesh
    modulus: Float[np.ndarray, " vertices"]
    quantity: str

    @property
    def colour_range(self) -> tuple[float, float]:
        """Lowest and highest colour; one colour for a sphere, not its rounding over the scale."""
        low, high = float(self.modulus.min()), float(self.modulus.max())
        return (low if high - low > ISOTROPIC * high else 0.0), high


Scene = LoadedPart | WarpedGrid | Struts | CutOpen | Whole | Cell | PlannedPart | StiffnessSurface


def triangles_of_facets(
    facets: Int[np.ndarray, "facets corners"],
) -> Int[np.ndarray, "faces 3"]:
    """Triangles of tet-mesh facets: one for three nodes, four for six (VTK order)."""
    if facets.shape[1] == 3:
        return facets
    corner = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
    return facets[:, corner].reshape(-1, 3)
