"""What of a part its lattice does not reach: too thin for the cells, it stays without struts."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from fea.tet_mesh import TetMesh
from texmap_opt.part import Part
from texmap_opt.structure.structure import Structure

# Points are put on a strut at most this share of a cell's edge apart. What is an edge away from the
# strut is then at most sqrt(1 + 1/16²) - 1 = 0.2 % of it farther from the next point.
SPACING_SHARE = 1 / 8

# The user is told of more than this share of the part's volume: less is a rib's tip or a sharp edge.
NOTABLE_SHARE = 0.01


@dataclass(frozen=True, eq=False)
class Unreached:
    """The volume of a part that is farther from every strut than one edge of a cell, and not skin.

    No place of a whole lattice is: the widest holes of the library are those of the cube and the
    tetrahedron, whose middles are sqrt(1/2) of an edge from a strut. What is farther away lies
    where cells were cut so small that nothing of theirs holds.

    Attributes:
        share: of the part's volume.
        farther_than_mm: longest edge of a uniform cell; where cells are warped, times their size [mm].
        largest_mm3: volume of the largest connected piece [mm³].
        largest_at: a point in the middle of it [mm]; None where all is reached.
    """

    share: float
    farther_than_mm: float
    largest_mm3: float
    largest_at: tuple[float, float, float] | None

    def warning(self, kind: str) -> str | None:
        """One sentence for the user of a lattice of rods or a plate; None where it is not worth one."""
        if self.largest_at is None or self.share <= NOTABLE_SHARE:
            return None
        place = ", ".join(f"{x:.4g}" for x in self.largest_at)
        stays = "empty" if kind == "rod" else "without holes"
        return (
            f"structure: {100 * self.share:.2g} % of the part's volume is farther than a cell's edge "
            f"({self.farther_than_mm:.3g} mm) from any strut and stays {stays}; the largest such place "
            f"is around [{place}] mm, too thin for the cells: smaller cells would reach it"
        )

    def numbers(self) -> dict[str, Any]:
        """For report.json."""
        return {
            "share": self.share,
            "farther_than_mm": self.farther_than_mm,
            "largest_mm3": self.largest_mm3,
            "largest_at_mm": None if self.largest_at is None else list(self.largest_at),
        }


def unreached(
    structure: Structure, mesh: TetMesh, part: Part, *, cell_mm: float, skin_mm: float
) -> Unreached:
    """Find what no strut is near, at the middles of the tets that fill the part.

    Walls reach all that lies beside them along their axis.

    Args:
        structure: the trimmed lattice.
        mesh: fills the part; each tet counts as a whole.
        part: what is filled.
        cell_mm: longest edge of a uniform cell [mm].
        skin_mm: thickness of the part's skin, which needs no strut [mm].
    """
    middles = mesh.nodes[mesh.tets[:, :4]].mean(axis=1)
    far = _far(structure, middles, cell_mm)
    if skin_mm > 0 and far.any():
        depth = -part.signed_distance(middles[far])[0]
        far[far] = depth > skin_mm
    if not far.any():
        return Unreached(0.0, cell_mm, 0.0, None)
    volumes = mesh.volumes
    piece = _pieces(mesh, far)
    of_piece = np.bincount(piece, weights=volumes[far])
    largest = np.flatnonzero(far)[piece == np.argmax(of_piece)]
    centre = np.average(middles[largest], axis=0, weights=volumes[largest])
    # The middle of a ring is not in it: the nearest place that is.
    nearest = middles[largest[np.argmin(np.linalg.norm(middles[largest] - centre, axis=1))]]
    x, y, z = nearest.tolist()
    share = float(volumes[far].sum() / volumes.sum())
    return Unreached(share, cell_mm, float(of_piece.max()), (x, y, z))


def _far(
    structure: Structure, points: Float[np.ndarray, "points 3"], cell_mm: float
) -> Bool[np.ndarray, " points"]:
    """Points farther from each strut than the edge of the cell that the nearest strut comes from."""
    walls = structure.extrusion
    across = np.eye(3) if walls is None else np.eye(3) - np.outer(walls.axis, walls.axis)
    ends = structure.joints[structure.struts]
    along = ends[:, 1] - ends[:, 0]
    edges = cell_mm * structure.cell_size
    steps = np.ceil(np.linalg.norm(along, axis=1) / (SPACING_SHARE * edges)).astype(int) + 1
    strut = np.repeat(np.arange(len(steps)), steps)
    step = np.arange(len(strut)) - np.repeat(np.cumsum(steps) - steps, steps)
    t = step / (steps[strut] - 1)
    on_struts = ends[strut, 0] + t[:, None] * along[strut]
    distance, nearest = KDTree(on_struts @ across).query(points @ across)
    return distance > edges[strut[nearest]]


def _pieces(mesh: TetMesh, chosen: Bool[np.ndarray, " cells"]) -> np.ndarray:
    """Number of the connected piece of each chosen tet; pieces share no node."""
    tets = mesh.tets[chosen, :4]
    rows = np.repeat(np.arange(len(tets)), 4)
    belongs = scipy.sparse.coo_array(
        (np.ones(tets.size), (rows, tets.ravel())), shape=(len(tets), len(mesh.nodes))
    ).tocsr()
    return scipy.sparse.csgraph.connected_components(belongs @ belongs.T, directed=False)[1]
