"""Tet mesh of a part: fTetWild's, with its boundary brought onto the part's surface.

The mesher's meshes differ from run to run, so they are stored; everything after it is deterministic.
"""

from dataclasses import dataclass

from fea import FeaError, TetMesh
from fea.ftetwild import (
    ENVELOPE,
    ENVELOPE_PER_EDGE,
    LEAST_ENVELOPE,
    VOLUME_TOLERANCE,
    estimated_tets,
)
from fea.ftetwild import tetrahedralise as mesh_of_surface
from fea.sizing_field import Sizing
from texmap_opt.combine.boolean import simplified
from texmap_opt.errors import TetrahedralisationError
from texmap_opt.part import Part
from texmap_opt.tet_surface import fitted_to_surface
from texmap_opt.thickness import thinnest_wall

# Tets along the part's diagonal, when the case does not say.
EDGES_PER_DIAGONAL = 25
# fTetWild's envelope also stays below this share of the thinnest wall.
ENVELOPE_PER_WALL = 0.1
# A surface of more triangles is simplified first, within this share of the envelope: fTetWild's own
# collapses of 70,000 triangles take four minutes, these half a second.
MANY_FACES, SIMPLIFY_SHARE = 15_000, 0.5
NODES_PER_TET = 0.24


@dataclass(frozen=True)
class TetEstimate:
    """What meshing a part will give, to within a factor of two; more where detail is fine.

    Attributes:
        tets: number of tetrahedra.
        nodes: number of nodes.
    """

    tets: int
    nodes: int


def default_edge_mm(part: Part) -> float:
    """Target edge when the case gives none [mm]: a 25th of the diagonal."""
    return part.diagonal / EDGES_PER_DIAGONAL


def estimated_counts(part: Part, *, edge_mm: float, element: str) -> TetEstimate:
    """Tets and nodes to expect.

    Args:
        part: what is to be meshed.
        edge_mm: target edge [mm].
        element: "tet4" or "tet10".
    """
    tets = estimated_tets(part.volume, part.area, edge=edge_mm)
    # Each tet has about 1.2 edges of its own, which carry the additional nodes of tet10.
    nodes = NODES_PER_TET * tets + (1.25 * tets if element == "tet10" else 0)
    return TetEstimate(int(tets), int(nodes))


def tetrahedralise(
    part: Part, *, edge_mm: float, element: str, sizing: Sizing | None = None
) -> TetMesh:
    """Tet mesh of a part, its boundary nodes on the part's surface.

    Args:
        part: a closed surface.
        edge_mm: target edge, and the upper bound of `sizing` [mm].
        element: "tet4" or "tet10" (straight edges).
        sizing: where smaller edges are wanted; see `fea.ftetwild`.

    Raises:
        TetrahedralisationError: impossible edge, the mesher failed, or its mesh is not the part.
    """
    if element not in ("tet4", "tet10"):
        raise TetrahedralisationError(f'element = "{element}": must be "tet4" or "tet10".')
    smallest = edge_mm if sizing is None else min(edge_mm, float(sizing.edge.min()))
    envelope = _envelope(part, smallest)
    surface = part.surface
    if len(surface.faces) > MANY_FACES:
        surface = simplified(surface, SIMPLIFY_SHARE * envelope)
    try:
        mesh = mesh_of_surface(
            surface.vertices, surface.faces, edge=edge_mm, sizing=sizing, envelope=envelope
        )
    except FeaError as failure:
        raise TetrahedralisationError(
            f"{part.name}: meshing at edge_mm = {edge_mm:g} failed: {failure}"
        ) from failure
    nodes = fitted_to_surface(
        mesh.nodes, mesh.tets, part.surface, query=part.signed_distance, reach=envelope
    )
    mesh = TetMesh(nodes, mesh.tets)
    _check(mesh, part, edge_mm)
    return mesh.to_tet10() if element == "tet10" else mesh


def _envelope(part: Part, smallest_edge: float) -> float:
    """Distance the mesh's surface may stray from the part's before it is fitted [mm]."""
    wall = thinnest_wall(part.surface, query=part.signed_distance)
    widest = min(
        ENVELOPE * part.diagonal, ENVELOPE_PER_EDGE * smallest_edge, ENVELOPE_PER_WALL * wall
    )
    return max(widest, LEAST_ENVELOPE * part.diagonal)


def _check(mesh: TetMesh, part: Part, edge_mm: float) -> None:
    inverted = int((mesh.volumes <= 0).sum())
    if inverted:
        raise TetrahedralisationError(
            f"{part.name}: {inverted} of {len(mesh.tets)} tets are flat or inverted; try another "
            f"edge_mm than {edge_mm:g}."
        )
    change = mesh.volume / part.volume - 1
    if abs(change) > VOLUME_TOLERANCE:
        raise TetrahedralisationError(
            f"{part.name}: the tet mesh has {100 * change:+.2g} % of the part's volume, more than "
            f"{100 * VOLUME_TOLERANCE:g} %; take a smaller edge_mm than {edge_mm:g}."
        )
