"""Is a surface the boundary of one solid? Small defects are repaired and reported, others refused.

Every repair says what it changed. No vertex is ever moved: triangles are dropped, turned or added,
so away from closed holes the surface that leaves is the one that came.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Int

from texmap_opt.combine.boolean import union
from texmap_opt.edge_pairs import EdgePairs, consistently_oriented, with_single_fans
from texmap_opt.errors import PartError, SolidError
from texmap_opt.holes import MAX_HOLE_EDGES, MAX_PATCH_SHARE, hole_loops, patched
from texmap_opt.self_intersection import crossing_faces, self_overlap
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.solids import solids_of

# A closed shell whose volume is below this share of area^(3/2) is a fold without inside.
FLAT_SHARE = 1e-9
# Share of the whole area below which an open shell is debris.
DEBRIS_SHARE = 1e-4
# Depth, as a share of the diagonal, and share of the triangles up to which a surface may pass
# through itself: both are what the tet mesher's envelope closes anyway (its epsilon is 1e-3).
MAX_OVERLAP_DEPTH = 1e-3
MAX_OVERLAP_SHARE = 0.02
# Share of the volume that crossing shells may have in common to be united unasked.
MAX_UNITED_SHARE = 0.05

REMEDY = (
    "Repair it in the program it came from, or in a mesh program (Blender: 3D Print Toolbox, "
    "Make Manifold), and export it again."
)


@dataclass(frozen=True, eq=False)
class Repaired:
    """A surface that bounds one solid.

    Attributes:
        surface: closed, oriented outwards, every edge between two triangles, every vertex in one
            fan; voids are shells of negative volume.
        notes: what was changed, in sentences; empty when nothing was.
    """

    surface: TriMesh
    notes: tuple[str, ...] = field(default=())


def repaired(surface: TriMesh, name: str, *, solid: int | None = None) -> Repaired:
    """The one solid a surface bounds, after small repairs.

    Args:
        surface: welded triangles.
        name: of the part, for messages.
        solid: which solid to take, by falling volume from 1; None when there must be one only.

    Raises:
        PartError: the surface is no solid and cannot be made one within the limits above, or it
            holds several and none is chosen.
    """
    notes: list[str] = []
    try:
        surface = _without_flat_pieces(surface, notes)
        surface = _closed(surface, notes)
        surface = _one_solid(surface, solid, notes)
        surface = _without_crossings(surface, notes)
    except PartError as failure:
        raise PartError(f"{name}: {failure}") from failure
    surface, _ = with_single_fans(surface)
    return Repaired(surface, tuple(notes))


def _without_flat_pieces(surface: TriMesh, notes: list[str]) -> TriMesh:
    """Degenerate and duplicate triangles dropped, and shells that only fold back on themselves."""
    faces = surface.faces
    distinct = (
        (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    )
    if not distinct.all():
        notes.append(f"dropped {_count(~distinct)} degenerate triangles (a corner twice)")
        faces = faces[distinct]
    if len(faces) == 0:
        raise PartError("all its triangles are degenerate; export the part again.")
    # Whole shells first, so that they are reported as what they are.
    faces = _without_doubled_shells(faces, notes)
    kept = _cancelled(faces)
    if not kept.all():
        notes.append(f"dropped {_count(~kept)} duplicate triangles")
        faces = faces[kept]
    if len(faces) == 0:
        raise PartError(f"its triangles only cover each other and enclose no volume. {REMEDY}")
    return TriMesh(surface.vertices, faces)


def _without_doubled_shells(faces: Int[np.ndarray, "faces 3"], notes: list[str]) -> np.ndarray:
    """Without shells in which every triangle lies on another one."""
    _, group, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    single = count[group.reshape(-1)] % 2 == 1
    shells = EdgePairs(faces).shells
    doubled = np.bincount(shells, weights=single) == 0
    if not doubled.any():
        return faces
    sizes = np.bincount(shells)[doubled]
    notes.append(_zero_volume_note(sizes))
    return faces[~doubled[shells]]


def _zero_volume_note(sizes: np.ndarray) -> str:
    shells = "shell" if len(sizes) == 1 else "shells"
    listed = ", ".join(str(size) for size in sizes[:5]) + (", ..." if len(sizes) > 5 else "")
    return f"dropped {len(sizes)} zero-volume {shells} ({listed} triangles)"


def _cancelled(faces: Int[np.ndarray, "faces 3"]) -> np.ndarray:
    """Which triangles stay (bool[faces]): copies add up with their sense, opposite ones cancel."""
    order = np.argsort(faces, axis=1)
    even = np.isin(order @ np.array([9, 3, 1]), (0 * 9 + 1 * 3 + 2, 1 * 9 + 2 * 3, 2 * 9 + 1))
    sense = np.where(even, 1, -1)
    _, group = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True)
    group = group.reshape(-1)
    total = np.bincount(group, weights=sense)[group]
    kept = np.zeros(len(faces), dtype=bool)
    # Of each group the first triangle with the sense of the sum.
    wanted = np.flatnonzero(sense == np.sign(total))
    kept[wanted[np.unique(group[wanted], return_index=True)[1]]] = True
    return kept


def _closed(surface: TriMesh, notes: list[str]) -> TriMesh:
    """Consistently oriented and without open edges."""
    edges = EdgePairs(surface.faces)
    if edges.crowded:
        raise _not_closed(surface, edges)
    oriented = consistently_oriented(surface.faces)
    if oriented is None:
        raise PartError(f"it is one-sided, like a Möbius strip, and has no inside. {REMEDY}")
    faces, turned = oriented
    if turned:
        notes.append(f"turned {turned} of {len(faces)} triangles to agree with their neighbours")
    # Fans are split so that holes which meet in a point have loops of their own.
    surface, _ = with_single_fans(TriMesh(surface.vertices, faces))
    surface = _without_flat_shells(_without_debris(surface, notes), notes)
    edges = EdgePairs(surface.faces)
    if edges.open.size == 0:
        return surface
    loops = hole_loops(surface.faces)
    closed = patched(surface, loops) if loops else None
    if closed is None:
        raise _not_closed(surface, edges)
    after = EdgePairs(closed.surface.faces)
    if after.open.size or after.crowded:
        raise _not_closed(surface, edges)
    share = closed.area / float(closed.surface.face_areas.sum())
    notes.append(
        f"closed {closed.holes} holes (largest {closed.largest} edges) with flat-most patches: "
        f"{100 * share:.2g} % of the surface, nowhere further than {closed.reach:.3g} mm from the "
        "holes' rims, no vertex moved"
    )
    return closed.surface


def _without_debris(surface: TriMesh, notes: list[str]) -> TriMesh:
    """Without open shells of hardly any area, unless nothing else would remain."""
    edges = EdgePairs(surface.faces)
    if edges.open.size == 0:
        return surface
    shells = edges.shells
    area = np.bincount(shells, weights=surface.face_areas)
    is_open = np.bincount(shells[edges.open // 3], minlength=len(area)) > 0
    debris = is_open & (area < DEBRIS_SHARE * area.sum())
    if not debris.any() or debris.all():
        return surface
    gone = debris[shells]
    notes.append(
        f"dropped {int(debris.sum())} open scraps ({_count(gone)} triangles, "
        f"{area[debris].sum():.3g} mm² of {area.sum():.3g})"
    )
    return TriMesh(surface.vertices, surface.faces[~gone])


def _without_flat_shells(surface: TriMesh, notes: list[str]) -> TriMesh:
    """Without closed shells that enclose nothing."""
    edges = EdgePairs(surface.faces)
    shells = edges.shells
    corner = surface.vertices[surface.faces]
    corner = corner - corner.reshape(-1, 3).mean(axis=0)
    volume = np.bincount(shells, weights=np.linalg.det(corner) / 6)
    area = np.bincount(shells, weights=surface.face_areas)
    closed = np.bincount(shells[edges.open // 3], minlength=len(area)) == 0
    flat = closed & (np.abs(volume) <= FLAT_SHARE * area**1.5)
    if not flat.any():
        return surface
    notes.append(_zero_volume_note(np.bincount(shells)[flat]))
    if flat.all():
        raise PartError(f"it encloses no volume: all its shells are flat. {REMEDY}")
    return TriMesh(surface.vertices, surface.faces[~flat[shells]])


def _not_closed(surface: TriMesh, edges: EdgePairs) -> PartError:
    """Everything that keeps a surface from being closed, counted, in one sentence."""
    defects = []
    if edges.open.size:
        loops = None if edges.crowded else hole_loops(surface.faces)
        sizes = [len(loop) for loop in loops or []]
        where = f" around {len(sizes)} holes of up to {max(sizes)} edges" if sizes else ""
        defects.append(f"it is open: {edges.open.size} edges have one triangle only{where}")
    if edges.crowded:
        defects.append(f"{edges.crowded} edges have more than two triangles")
    crossing = len(crossing_faces(surface))
    if crossing:
        defects.append(f"{crossing} pairs of triangles cross each other")
    limit = ""
    if edges.open.size and not edges.crowded:
        limit = (
            f" Holes are closed unasked up to {MAX_HOLE_EDGES} edges and "
            f"{100 * MAX_PATCH_SHARE:g} % of the surface."
        )
    return PartError(f"{'; '.join(defects)}; so it bounds no solid.{limit} {REMEDY}")


def _one_solid(surface: TriMesh, solid: int | None, notes: list[str]) -> TriMesh:
    """The chosen solid with its voids, outward oriented; crossing solids count as one."""
    solids, turned = solids_of(surface)
    if turned:
        notes.append(f"turned inside out: {turned} shells had their triangles facing inwards")
    solids = _united_where_they_cross(solids, notes)
    solids.sort(key=lambda each: -each.volume)
    listed = ", ".join(f"{each.volume:.4g}" for each in solids[:8])
    listed += ", ..." if len(solids) > 8 else ""
    if solid is None and len(solids) > 1:
        raise PartError(
            f"it holds {len(solids)} solids (volumes {listed} mm³), and a lattice needs one: "
            "choose with [part] solid = 1 for the largest, or unite them."
        )
    if solid is not None and solid > len(solids):
        raise PartError(
            f"[part] solid = {solid}: it holds {len(solids)} (volumes {listed} mm³); choose 1 to "
            f"{len(solids)}."
        )
    if len(solids) > 1:
        notes.append(f"took solid {solid} of {len(solids)} (volumes {listed} mm³)")
    return solids[(solid or 1) - 1]


def _united_where_they_cross(solids: list[TriMesh], notes: list[str]) -> list[TriMesh]:
    """Solids whose surfaces pass through each other united, when they share little."""
    if len(solids) == 1:
        return solids
    owner = np.repeat(np.arange(len(solids)), [len(each.faces) for each in solids])
    start = np.cumsum([0] + [len(each.vertices) for each in solids[:-1]])
    everything = TriMesh(
        np.concatenate([each.vertices for each in solids]),
        np.concatenate([each.faces + at for each, at in zip(solids, start, strict=True)]),
    )
    pairs = owner[crossing_faces(everything)].reshape(-1, 2)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    if len(pairs) == 0:
        return solids
    both = np.unique(pairs)
    before = sum(solids[i].volume for i in both)
    try:
        whole = union([solids[i] for i in both])
    except SolidError as failure:
        raise PartError(
            f"{len(pairs)} pairs of triangles of {len(both)} solids cross each other, and uniting "
            f"them failed ({failure}) {REMEDY}"
        ) from failure
    lost = (before - whole.volume) / before
    if not -1e-9 <= lost <= MAX_UNITED_SHARE:
        raise PartError(
            f"{len(pairs)} pairs of triangles of {len(both)} solids cross each other, which have "
            f"{100 * lost:.3g} % of their volume in common; up to {100 * MAX_UNITED_SHARE:g} % are "
            "united unasked. Unite them in the program they came from."
        )
    notes.append(
        f"united {len(both)} solids that cross each other; {100 * lost:.2g} % of their volume was "
        "common, and no outer surface moved"
    )
    united, _ = solids_of(whole)
    return [each for i, each in enumerate(solids) if i not in both] + united


def _without_crossings(surface: TriMesh, notes: list[str]) -> TriMesh:
    """The surface, unless it passes through itself deeper or oftener than the limits."""
    overlap = self_overlap(surface)
    if len(overlap.pairs) == 0:
        return surface
    diagonal = float(np.linalg.norm(np.diff(surface.bounds, axis=0)))
    where = f"{overlap.faces} of {len(surface.faces)} triangles cross others"
    deep = overlap.depth > MAX_OVERLAP_DEPTH * diagonal
    if deep or overlap.faces > MAX_OVERLAP_SHARE * len(surface.faces):
        raise PartError(
            f"it intersects itself: {where} ({len(overlap.pairs)} pairs), up to "
            f"{overlap.depth:.3g} mm deep; tolerated are {100 * MAX_OVERLAP_SHARE:g} % of "
            f"the triangles and {MAX_OVERLAP_DEPTH * diagonal:.3g} mm (a thousandth of the "
            f"diagonal). {REMEDY}"
        )
    deepest = f"at most {overlap.depth:.2g} mm deep"
    notes.append(f"{where} ({len(overlap.pairs)} pairs), {deepest}: left as they are")
    return surface


def _count(chosen: np.ndarray) -> int:
    return int(np.count_nonzero(chosen))
