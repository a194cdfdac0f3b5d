"""Triangle surfaces from STL, OBJ, PLY and 3MF files; the only user of trimesh.

Positions stay in the file's unit. Vertices at equal positions become one (STL and texture seams
repeat them); then, only along edges that are still open, vertices closer than a tolerance do.
"""

import logging
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from texmap_opt.errors import PartError
from texmap_opt.solid.tri_mesh import TriMesh

ENDINGS = (".stl", ".obj", ".ply", ".3mf")
# Share of the bounding box's diagonal: ten times the rounding of a coordinate in a float32 STL far
# from the origin, a hundredth of the finest detail a printer resolves.
WELD_TOLERANCE = 1e-6
# A direction along which hardly any two vertices of a regular mesh have one height.
OBLIQUE = (np.sqrt(2.0), np.sqrt(3.0), np.sqrt(5.0))
# 3MF files say their unit; the names of the format and of `[part] unit`.
UNITS_3MF = {
    "millimeter": "mm",
    "millimeters": "mm",
    "centimeter": "cm",
    "centimeters": "cm",
    "meter": "m",
    "meters": "m",
    "inch": "in",
    "inches": "in",
}


@dataclass(frozen=True, eq=False)
class PartFile:
    """What a file holds.

    Attributes:
        surface: the triangles, in the file's unit, welded; neither closed nor oriented for certain.
        unit: the unit the file itself states (3MF only).
        notes: what reading changed, in sentences.
    """

    surface: TriMesh
    unit: str | None = None
    notes: tuple[str, ...] = ()


def read_part_file(path: Path) -> PartFile:
    """Triangles of a surface file.

    Raises:
        PartError: no such file, unknown ending, unreadable, empty, or not finite.
    """
    path = Path(path)
    vertices, faces, unit = _triangles(path)
    bad = ~np.isfinite(vertices).all(axis=1)
    if bad.any():
        raise PartError(
            f"{path.name}: {int(bad.sum())} of {len(vertices)} vertices have coordinates that are "
            "not finite numbers (NaN or infinite); export the part again."
        )
    surface, notes = welded(TriMesh(vertices, faces))
    return PartFile(surface, unit, notes)


def read_surface_file(path: str | Path) -> TriMesh:
    """The welded triangles alone, as `read_part_file`, in the file's unit."""
    return read_part_file(Path(path)).surface


def read_any_surface(path: Path) -> TriMesh:
    """The triangles of a file, to be checked: welded unless some coordinate is not finite.

    Raises:
        PartError: no such file, unknown ending, unreadable, or empty.
    """
    vertices, faces, _ = _triangles(path)
    surface = TriMesh(vertices, faces)
    return welded(surface)[0] if np.isfinite(vertices).all() else surface


def _triangles(
    path: Path,
) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "faces 3"], str | None]:
    """Vertices, triangles that name existing ones, and the unit where the file states one."""
    if path.suffix.lower() not in ENDINGS:
        raise PartError(
            f'{path.name}: the ending "{path.suffix}" is not one of {", ".join(ENDINGS)}; '
            "export the part in one of these formats."
        )
    if not path.is_file():
        raise PartError(f"{path}: there is no such file; check the path.")
    if path.stat().st_size == 0:
        raise PartError(f"{path.name}: the file is empty; export the part again.")
    vertices, faces, unit = _loaded(path)
    if len(faces) == 0:
        raise PartError(f"{path.name}: the file holds no triangles; export the part as a surface.")
    outside = (faces < 0) | (faces >= len(vertices))
    if outside.any():
        raise PartError(
            f"{path.name}: {int(outside.any(axis=1).sum())} triangles refer to vertices the file "
            "does not have; it is cut off or damaged: export it again."
        )
    return vertices, faces, unit


def welded(surface: TriMesh) -> tuple[TriMesh, tuple[str, ...]]:
    """The surface with one vertex per position, and notes on what needed a tolerance.

    Vertices on open edges that lie within `WELD_TOLERANCE` of the diagonal of each other are
    joined as well; all others keep their exact position.
    """
    positions, index = distinct_positions(surface.vertices)
    faces = index[surface.faces]
    notes = []
    open_ends = np.unique(open_edges(faces))
    if open_ends.size:
        reach = WELD_TOLERANCE * float(np.linalg.norm(np.ptp(positions, axis=0)))
        pairs = KDTree(positions[open_ends]).query_pairs(reach, output_type="ndarray")
        pairs = open_ends[pairs]
        if len(pairs):
            joins = coo_array(
                (np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])),
                shape=(len(positions), len(positions)),
            )
            groups, label = connected_components(joins, directed=False)
            joined = len(positions) - groups
            # The first vertex of each group gives its position.
            first = np.unique(label, return_index=True)[1]
            positions, faces = positions[first], label.astype(np.int64)[faces]
            notes.append(
                f"welded {joined} vertices on open edges that were at most {reach:.3g} apart"
            )
    return TriMesh(positions, faces), tuple(notes)


def distinct_positions(
    vertices: Float[np.ndarray, "vertices 3"],
) -> tuple[Float[np.ndarray, "distinct 3"], Int[np.ndarray, " vertices"]]:
    """The rows of `numpy.unique(vertices, axis=0)` and where each vertex is among them.

    Sorted by one number each, the height along an oblique direction, which takes a fifth of the
    time of sorting rows; those are sorted only where different positions have one height.
    """
    # Adding 0 turns -0.0 into 0.0, which sorting holds for different.
    x, y, z = (column + 0.0 for column in vertices.T)
    # Not a matrix product, whose rounding may depend on the row.
    height = x * OBLIQUE[0] + y * OBLIQUE[1] + z * OBLIQUE[2]
    order = np.argsort(height, kind="stable")
    risen = np.diff(height[order]) > 0
    moved = np.zeros(len(risen), dtype=bool)
    for column in (x, y, z):
        moved |= np.diff(column[order]) != 0
    if (moved & ~risen).any():
        rows, index = np.unique(np.stack([x, y, z], axis=1), axis=0, return_inverse=True)
        return rows, index.reshape(-1)
    starts = np.concatenate([np.zeros(min(len(order), 1), np.int64), np.flatnonzero(moved) + 1])
    first = order[starts]
    rank = np.lexsort((z[first], y[first], x[first]))
    place = np.zeros(len(first), dtype=np.int64)
    place[rank] = np.arange(len(first))
    index = np.zeros(len(order), dtype=np.int64)
    index[order] = np.repeat(place, np.diff(starts, append=len(order)))
    return vertices[first[rank]] + 0.0, index


def open_edges(faces: Int[np.ndarray, "faces 3"]) -> Int[np.ndarray, "edges 2"]:
    """Edges that only one triangle has, as sorted pairs of vertices."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    return unique[count == 1]


def _loaded(
    path: Path,
) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "faces 3"], str | None]:
    """What trimesh reads, with everything it would print or warn about turned into one error."""
    import trimesh  # Takes a quarter of a second; built-in parts do without.

    log = logging.getLogger("trimesh")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            scene = trimesh.load_scene(
                str(path), file_type=path.suffix.lower()[1:], process=False, allow_remote=False
            )
            mesh = scene.to_mesh()
            vertices = np.array(mesh.vertices, dtype=np.float64).reshape(-1, 3)
            faces = np.array(mesh.faces, dtype=np.int64).reshape(-1, 3)
            stated = scene.units if path.suffix.lower() == ".3mf" else None
    # Readers fail on damaged files with whatever their parsing meets: every kind is the same
    # news to the user, and the original is kept as the cause.
    except Exception as failure:
        reason = " ".join(str(failure).split())[:160] or type(failure).__name__
        raise PartError(
            f"{path.name}: cannot be read as {path.suffix[1:].upper()} ({reason}); "
            "export the part again."
        ) from failure
    finally:
        log.setLevel(level)
    return vertices, faces, UNITS_3MF.get(stated) if stated else None
