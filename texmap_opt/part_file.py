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


def welded(surface: TriMesh) -> tuple[TriMesh, tuple[str, ...]]:
    """The surface with one vertex per position, and notes on what needed a tolerance.

    Vertices on open edges that lie within `WELD_TOLERANCE` of the diagonal of each other are
    joined as well; all others keep their exact position.
    """
    # Adding 0 turns -0.0 into 0.0, which `unique` holds for different.
    positions, index = np.unique(surface.vertices + 0.0, axis=0, return_inverse=True)
    faces = index.reshape(-1)[surface.faces]
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
