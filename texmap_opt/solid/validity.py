"""Whether a surface is the boundary of a printable solid, and what is wrong where it is not."""

from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.combine import boolean
from texmap_opt.errors import SolidError
from texmap_opt.signed_distance import winding_number
from texmap_opt.solid.edges import Edges
from texmap_opt.solid.tri_mesh import TriMesh

# Coordinates beyond this are no millimetres of anything, and their products overflow [mm].
FARTHEST = 1e9
# Share of the volume: far above rounding of the sums, far below a strut of a large lattice.
OVERLAP_SHARE = 1e-6
# Faces next to which the winding number is looked at, evenly through the list of faces.
WINDING_SAMPLES = 2000
# Distance of those points from the surface over its diagonal: above rounding, below any wall.
WINDING_STEP = 1e-6
# 0 and 1 are sound, 2 and -1 are overlaps.
WINDING_SLACK = 0.4
# Solid angles summed when samples are looked at again, points times triangles: about 5 s.
EXACT_TERMS = 50_000_000


@dataclass(frozen=True, eq=False)
class ValidityReport:
    """What was found on a surface.

    Attributes:
        triangles: number of triangles.
        vertices: number of vertices used.
        volume_mm3: enclosed volume [mm³].
        area_mm2: surface area [mm²].
        open_edges: directed edges without a partner running the other way.
        crowded_edges: directed edges that occur more than once.
        pinched_vertices: vertices at which several fans of triangles touch.
        degenerate_triangles: triangles with a repeated vertex or exactly no area.
        connected_components: shells of positive volume.
        closed_voids: shells of negative volume.
        genus: handles, summed over all shells.
        overlap_mm3: volume that shells enclose more than once.
        doubly_wound_samples: sampled points next to faces that the surface encloses twice or inside
            out.
        faults: why this is no printable solid, in words; empty when it is one.
    """

    triangles: int
    vertices: int
    volume_mm3: float
    area_mm2: float
    open_edges: int
    crowded_edges: int
    pinched_vertices: int
    degenerate_triangles: int
    connected_components: int
    closed_voids: int
    genus: int
    overlap_mm3: float
    doubly_wound_samples: int
    faults: list[str]

    @property
    def watertight(self) -> bool:
        """Whether every edge joins exactly two opposite triangles and encloses a volume."""
        return not self.open_edges and not self.crowded_edges and self.volume_mm3 > 0

    @property
    def printable(self) -> bool:
        """Whether no fault was found."""
        return not self.faults

    def as_dict(self) -> dict:
        """Everything, as `texmap check` prints it."""
        return {"printable": self.printable, "watertight": self.watertight} | asdict(self)


def validity(surface: TriMesh, *, given: TriMesh | None = None) -> ValidityReport:
    """Looks at a surface as a solid: edges, fans, orientation, shells, overlaps.

    Vertices must be welded: two that are equal in position but not in number are two vertices.

    Args:
        surface: what is checked [mm].
        given: the part that the surface was made from; where it crosses itself already (`repair`
            lets shallow crossings pass, with a note), the surface may do so as well.
    """
    used = np.unique(surface.faces)
    if not len(used):
        return _hopeless(surface, "there are no triangles")
    if not np.isfinite(surface.vertices[used]).all():
        return _hopeless(surface, "a coordinate is not a finite number")
    if np.abs(surface.vertices[used]).max() > FARTHEST:
        return _hopeless(surface, f"a coordinate is beyond {FARTHEST:g} mm")
    joins = _joins(surface, len(used))
    sound = joins.closed and surface.volume > 0
    overlap, twice = _overlaps(surface, joins, given) if sound else (0.0, 0)
    faults = _faults(
        {
            f"{joins.open} edges lack a neighbour (a hole, or triangles turned over)": joins.open,
            f"{joins.crowded} edges join more than two triangles": joins.crowded,
            f"{joins.repeated} triangles name a vertex twice": joins.repeated,
            f"{joins.pinched} vertices join surfaces that only touch": joins.pinched,
            f"volume is {surface.volume:.6g} mm³: it is inside out": joins.closed and not sound,
            f"shells overlap by {overlap:.3g} mm³": overlap > 0,
            f"it crosses itself: {twice} sampled points are enclosed twice or inside out": twice,
        }
    )
    if joins.closed and not faults and (refusal := boolean.fault(surface)):
        faults = [f"manifold3d refuses it: {refusal}"]
    return ValidityReport(
        triangles=len(surface.faces),
        vertices=len(used),
        volume_mm3=surface.volume,
        area_mm2=float(surface.face_areas.sum()),
        open_edges=joins.open,
        crowded_edges=joins.crowded,
        pinched_vertices=joins.pinched,
        degenerate_triangles=int((surface.face_areas == 0).sum()),
        connected_components=int((joins.shell_volumes > 0).sum()),
        closed_voids=int((joins.shell_volumes < 0).sum()),
        genus=joins.genus,
        overlap_mm3=overlap,
        doubly_wound_samples=twice,
        faults=faults,
    )


def require_printable(
    surface: TriMesh, what: str, *, given: TriMesh | None = None
) -> ValidityReport:
    """The report of a surface that must be a printable solid.

    Args:
        surface: the solid.
        what: what the message calls it.
        given: see `validity`.

    Raises:
        SolidError: naming every fault.
    """
    report = validity(surface, given=given)
    if not report.printable:
        raise SolidError(
            f"{what} is not a printable solid: {'; '.join(report.faults)}. Another tolerance_mm or "
            "radius_mm usually avoids it."
        )
    return report


def _hopeless(surface: TriMesh, fault: str) -> ValidityReport:
    """The report of a surface of which nothing can be measured."""
    return ValidityReport(len(surface.faces), 0, 0.0, 0.0, 0, 0, 0, 0, 0, 0, 0, 0.0, 0, [fault])


def _faults(conditions: dict[str, object]) -> list[str]:
    return [fault for fault, present in conditions.items() if present]


@dataclass(frozen=True, eq=False)
class _Joins:
    """How the triangles are joined, without the edges themselves, which take most of the memory."""

    open: int
    crowded: int
    repeated: int
    pinched: int
    genus: int
    shell_of_face: Int[np.ndarray, " faces"]
    shell_volumes: Float[np.ndarray, " shells"]

    @property
    def closed(self) -> bool:
        """Whether every edge joins two triangles with three different corners each."""
        return not self.open and not self.crowded and not self.repeated


def _joins(surface: TriMesh, vertices: int) -> _Joins:
    edges = Edges(surface)
    n_open, crowded = int(edges.open.sum()), int(edges.crowded.sum())
    repeated = int((surface.faces == np.roll(surface.faces, 1, axis=1)).any(axis=1).sum())
    closed = not n_open and not crowded and not repeated
    volumes = edges.shell_volumes
    euler = vertices - len(edges.ends) // 2 + len(surface.faces)
    return _Joins(
        n_open,
        crowded,
        repeated,
        int(edges.fan_of_corner.max()) + 1 - vertices if closed else 0,
        # Each shell contributes 1 - (V - E + F)/2.
        len(volumes) - euler // 2 if closed else 0,
        edges.shell_of_face,
        volumes,
    )


def _overlaps(surface: TriMesh, joins: _Joins, given: TriMesh | None) -> tuple[float, int]:
    """Volume enclosed by several positive shells [mm³], and sampled points wound about twice."""
    overlap = 0.0
    if (joins.shell_volumes > 0).sum() > 1:
        solids = _solid_shells(surface, joins)
        overlap = boolean.overlap_volume(solids)
        if overlap <= OVERLAP_SHARE * sum(solid.volume for solid in solids):
            overlap = 0.0
    step = WINDING_STEP * float(np.linalg.norm(np.ptp(surface.bounds, axis=0)))
    solid_faces = np.flatnonzero(surface.face_areas > step**2)
    stride = max(1, len(solid_faces) // WINDING_SAMPLES)
    faces = solid_faces[::stride][:WINDING_SAMPLES]
    centroids = surface.vertices[surface.faces[faces]].mean(axis=1)
    outward = step * surface.face_normals[faces]
    points = np.concatenate([centroids - outward, centroids + outward])
    suspect = points[_unsound(winding_number(surface, points))]
    # The fast winding number errs by up to 2 this close to large triangles among small ones, so
    # the sum itself decides; over at most as many points as are affordable, spread evenly.
    affordable = max(8, EXACT_TERMS // len(surface.faces))
    suspect = suspect[:: max(1, -(-len(suspect) // affordable))]
    unsound = suspect[_unsound(_winding_sum(surface, suspect))]
    if given is not None:
        unsound = unsound[~_unsound(_winding_sum(given, unsound))]
    return overlap, len(unsound)


def _unsound(winding: np.ndarray) -> np.ndarray:
    return (winding > 1 + WINDING_SLACK) | (winding < -WINDING_SLACK)


def _winding_sum(surface: TriMesh, points: np.ndarray) -> np.ndarray:
    """Winding numbers by the solid angle of every triangle (Van Oosterom and Strackee 1983)."""
    corners = surface.vertices[surface.faces]
    winding = np.zeros(len(points))
    for k, point in enumerate(points):
        a, b, c = np.moveaxis(corners - point, 1, 0)
        la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        ab, bc, ca = (np.einsum("ij,ij->i", *pair) for pair in ((a, b), (b, c), (c, a)))
        angle = 2 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
        winding[k] = angle.sum() / (4 * np.pi)
    return winding


def _solid_shells(surface: TriMesh, joins: _Joins) -> list[TriMesh]:
    """The shells of positive volume, each as a surface of its own."""
    order = np.argsort(joins.shell_of_face, kind="stable")
    ends = np.cumsum(np.bincount(joins.shell_of_face))[:-1]
    faces = np.split(order, ends)
    return [surface.select(faces[k]) for k in np.flatnonzero(joins.shell_volumes > 0)]
