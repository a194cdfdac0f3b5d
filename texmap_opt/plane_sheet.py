"""The skin of an extruded lattice, seen along the axis of extrusion: a flat sheet in its plane.

Two plates close the lattice at its ends, each as thick as the skin; a rim as wide as the skin and as
deep as the part goes around it and around every hole. In the plane of the walls that is one sheet in
plane stress whose thickness differs from place to place. Its triangles are those of Delaunay's
triangulation of points on the outline, on the inner edge of the rim, and evenly between.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import Delaunay

from texmap_opt.combine.boolean import inset, shadow
from texmap_opt.errors import LatticeError
from texmap_opt.part import Part
from texmap_opt.shadow_distance import near_shadow
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.chords import chords
from texmap_opt.structure.plane_axes import plane_axes
from texmap_opt.structure.silhouette import OUTLINE_TOLERANCE
from texmap_opt.structure.structure import Extrusion

# Distance of a corner from the line through its neighbours, over the edge of the triangles, below
# which curves of the outline are cut short.
SAG = 0.02

# Points between the rims keep this distance from them, over the edge: triangles there stay fat.
CLEARANCE = 0.5

# Triangles of less than this area, over the square of the edge, are the rounding of straight rims.
LEAST_AREA = 1e-6

# Relative error of the sheet's area above which some triangle crosses the outline; edges are then
# halved, so many times.
AREA_ERROR = 0.01
HALVINGS = 4

# Points asked at once whether they are inside an outline.
AT_ONCE = 4096

Polygons = list[Float[np.ndarray, "_ 2"]]


@dataclass(frozen=True, eq=False)
class PlaneSheet:
    """A flat sheet half way between the ends of the walls.

    Attributes:
        surface: its triangles [mm], all facing along the axis of extrusion.
        thickness: of each along the axis [mm]: of both plates, or in the rim the depth of the part.
        plates: thickness of both plates at each triangle [mm], also in the rim.
        thin_share: share of the area where the part is not as deep as two plates.
        edge: of the triangles, about [mm].
    """

    surface: TriMesh
    thickness: Float[np.ndarray, " faces"]
    plates: Float[np.ndarray, " faces"]
    thin_share: float
    edge: float

    @property
    def held_back(self) -> int:
        """Vertices that could not go where the skin's thickness asks for: none."""
        return 0


def plane_sheet(part: Part, walls: Extrusion, *, skin_mm: float, edge: float) -> PlaneSheet:
    """The skin of a part as the walls of an extruded lattice see it.

    Args:
        part: what the walls stand in.
        walls: axis and heights of the extrusion.
        skin_mm: thickness of the skin [mm].
        edge: longest edge of the triangles, about [mm].

    Raises:
        LatticeError: the outline is finer than triangles can follow.
    """
    axes = plane_axes(walls.axis)
    outline = shadow(part.surface, axes, tolerance=OUTLINE_TOLERANCE * part.diagonal)
    whole = _area(outline)
    for length in (edge / 2**halving for halving in range(HALVINGS + 1)):
        outer, inner = (inset(outline, by, tolerance=SAG * length) for by in (0.0, skin_mm))
        points, faces = _triangles(outer, inner, length)
        areas = _signed_areas(points, faces)
        if abs(areas.sum() - whole) <= AREA_ERROR * whole:
            break
    else:
        raise LatticeError(
            f"[lattice] skin_mm = {skin_mm:g}: the outline of the part along the axis of extrusion is "
            f"finer than triangles of {edge / 2**HALVINGS:.3g} mm can follow; use smaller cells, or a part "
            "without such detail."
        )
    middle = (walls.low + walls.high) / 2
    centre = points[faces].mean(axis=1)
    depth = chords(part.surface, centre @ axes[:2] + middle * axes[2], walls.axis)
    depth = np.where(np.isfinite(depth), depth, np.nanmean(depth))
    plates = np.minimum(2 * skin_mm, depth)
    thin = depth < 2 * skin_mm * (1 - 1e-9)
    return PlaneSheet(
        surface=TriMesh(points @ axes[:2] + middle * axes[2], faces),
        thickness=np.where(_inside(inner, centre), plates, depth),
        plates=plates,
        thin_share=float(areas[thin].sum() / areas.sum()),
        edge=length,
    )


def _triangles(
    outer: Polygons, inner: Polygons, edge: float
) -> tuple[Float[np.ndarray, "vertices 2"], Int[np.ndarray, "faces 3"]]:
    """Points, and counter-clockwise triangles between them that lie in the outer outline."""
    rims = [_divided(polygon, edge) for polygon in (*outer, *inner)]
    border = np.concatenate(rims)
    even = _even(border.min(axis=0), border.max(axis=0), edge)
    even = even[_inside(inner, even)]
    segments = [
        np.stack([polygon, np.roll(polygon, -1, axis=0), polygon], axis=1) for polygon in inner
    ]
    if segments and len(even):
        even = even[~near_shadow(even, np.concatenate(segments), CLEARANCE * edge)]
    points = np.concatenate([border, even])
    faces = Delaunay(points).simplices.astype(np.int64)
    areas = _signed_areas(points, faces)
    faces[areas < 0] = faces[areas < 0][:, [0, 2, 1]]
    kept = np.abs(areas) > LEAST_AREA * edge**2
    kept &= _inside(outer, points[faces].mean(axis=1))
    used, faces = np.unique(faces[kept], return_inverse=True)
    return points[used], faces.reshape(-1, 3)


def _divided(polygon: Float[np.ndarray, "_ 2"], edge: float) -> Float[np.ndarray, "points 2"]:
    """Corners of a polygon, and points between them so that none are farther apart than an edge."""
    ends = np.roll(polygon, -1, axis=0)
    parts = np.maximum(np.ceil(np.linalg.norm(ends - polygon, axis=1) / edge), 1).astype(int)
    return np.concatenate(
        [
            a + np.arange(n)[:, None] / n * (b - a)
            for a, b, n in zip(polygon, ends, parts, strict=True)
        ]
    )


def _even(
    low: Float[np.ndarray, " 2"], high: Float[np.ndarray, " 2"], edge: float
) -> Float[np.ndarray, "points 2"]:
    """Corners of equilateral triangles over a rectangle."""
    rise = edge * np.sqrt(3) / 2
    across, up = np.arange(low[0], high[0] + edge, edge), np.arange(low[1], high[1] + rise, rise)
    x, y = np.meshgrid(across, up)
    x[1::2] += edge / 2
    return np.column_stack([x.ravel(), y.ravel()])


def _inside(
    outline: Polygons, points: Float[np.ndarray, "points 2"]
) -> Bool[np.ndarray, " points"]:
    """Which points an outline with holes encloses, by the crossings of a ray."""
    if not outline or not len(points):
        return np.zeros(len(points), bool)
    a = np.concatenate(outline)
    b = np.concatenate([np.roll(polygon, -1, axis=0) for polygon in outline])
    inside = np.zeros(len(points), bool)
    for first in range(0, len(points), AT_ONCE):
        x, y = points[first : first + AT_ONCE, :, None].swapaxes(0, 1)
        spans = (a[:, 1] > y) != (b[:, 1] > y)
        rise = np.where(a[:, 1] == b[:, 1], 1.0, b[:, 1] - a[:, 1])
        at = a[:, 0] + (y - a[:, 1]) / rise * (b[:, 0] - a[:, 0])
        inside[first : first + AT_ONCE] = (spans & (x < at)).sum(axis=1) % 2 == 1
    return inside


def _signed_areas(
    points: Float[np.ndarray, "vertices 2"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, " faces"]:
    """Areas of triangles, negative for clockwise ones [mm²]."""
    a, b, c = np.moveaxis(points[faces], 1, 0)
    (x, y), (u, v) = (b - a).T, (c - a).T
    return (x * v - y * u) / 2


def _area(outline: Polygons) -> float:
    """Area that an outline with holes encloses [mm²]."""
    return sum(
        float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2 for x, y in (p.T for p in outline)
    )
