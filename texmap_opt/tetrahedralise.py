"""Tet mesh of a part: fTetWild's, with its boundary brought onto the part's surface.

The mesher's meshes differ from run to run, so they are stored; everything after it is deterministic.
"""

from dataclasses import dataclass

import numpy as np

from fea import FeaError, TetMesh
from fea.ftetwild import (
    ENVELOPE,
    ENVELOPE_PER_EDGE,
    LEAST_ENVELOPE,
    TETS_PER_VOLUME,
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
# fTetWild's threads race: of equal input it once made 398,413 tets instead of 2,700, off the surface.
# So what is wrong with a mesh is told only when it is wrong twice.
MESHINGS = 2
# A mesh of this many times more tets than foreseen has run away. Nine parts, meshed at 1/20, 1/6 and
# 1/2 of their extent, had at most 2.0, 4.5 and 3.1 times as many; meshes that ran away 37, 76 and 82
# times, the first two of a bust whose wanted edge is half its height.
RUNAWAY = 20.0
# However large the edge, fTetWild makes this many along the diagonal with its usual envelope; the chords
# of an arc shorten with the root of the envelope.
LEAST_EDGES = 12


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

    Meshed once more where the mesh is not the part or has run away, since equal input gives another.

    Args:
        part: a closed surface.
        edge_mm: target edge, and the upper bound of `sizing` [mm].
        element: "tet4" or "tet10" (straight edges).
        sizing: where smaller edges are wanted; see `fea.ftetwild`.

    Raises:
        TetrahedralisationError: impossible edge, the mesher failed, or its mesh is twice not the part:
            inverted, of another volume, off the surface, or of far too many tets.
    """
    if element not in ("tet4", "tet10"):
        raise TetrahedralisationError(f'element = "{element}": must be "tet4" or "tet10".')
    smallest = edge_mm if sizing is None else min(edge_mm, float(sizing.edge.min()))
    envelope = _envelope(part, smallest)
    surface = part.surface
    if len(surface.faces) > MANY_FACES:
        surface = simplified(surface, SIMPLIFY_SHARE * envelope)
    fault = None
    for _ in range(MESHINGS):
        try:
            mesh = mesh_of_surface(
                surface.vertices, surface.faces, edge=edge_mm, sizing=sizing, envelope=envelope
            )
        except FeaError as failure:
            raise TetrahedralisationError(
                f"{part.name}: meshing at edge_mm = {edge_mm:g} failed: {failure}"
            ) from failure
        most = _most_tets(part, len(surface.faces), edge_mm, sizing, envelope)
        if len(mesh.tets) > most:
            fault = (
                f"the mesh has {len(mesh.tets):,} tets where at most {most:,.0f} make sense; try "
                f"another edge_mm than {edge_mm:g}, or repair the surface."
            )
            continue
        nodes = fitted_to_surface(
            mesh.nodes, mesh.tets, part.surface, query=part.signed_distance, reach=envelope
        )
        mesh = TetMesh(nodes, mesh.tets)
        fault = _fault(mesh, part, edge_mm, envelope)
        if fault is None:
            return mesh.to_tet10() if element == "tet10" else mesh
    raise TetrahedralisationError(f"{part.name}, meshed {MESHINGS} times: {fault}")


def _most_tets(
    part: Part, faces: int, edge_mm: float, sizing: Sizing | None, envelope: float
) -> float:
    """Tets above which a mesh has run away; `faces` are those of the surface that is meshed."""
    longest = part.diagonal / LEAST_EDGES * np.sqrt(envelope / (ENVELOPE * part.diagonal))
    tets = estimated_tets(part.volume, part.area, edge=min(edge_mm, longest)) + faces
    if sizing is not None:
        tets += TETS_PER_VOLUME * sizing.tets_wanted
    return RUNAWAY * tets


def _envelope(part: Part, smallest_edge: float) -> float:
    """Distance the mesh's surface may stray from the part's before it is fitted [mm]."""
    wall = thinnest_wall(part.surface, query=part.signed_distance)
    widest = min(
        ENVELOPE * part.diagonal, ENVELOPE_PER_EDGE * smallest_edge, ENVELOPE_PER_WALL * wall
    )
    return max(widest, LEAST_ENVELOPE * part.diagonal)


def _fault(mesh: TetMesh, part: Part, edge_mm: float, envelope: float) -> str | None:
    """What is wrong with a mesh that should be the part, and what to do; None: nothing."""
    inverted = int((mesh.volumes <= 0).sum())
    if inverted:
        return (
            f"{inverted} of {len(mesh.tets)} tets are flat or inverted; try another edge_mm than "
            f"{edge_mm:g}."
        )
    change = mesh.volume / part.volume - 1
    if abs(change) > VOLUME_TOLERANCE:
        return (
            f"the tet mesh differs from the part's volume by {100 * change:+.2g} %, more than "
            f"{100 * VOLUME_TOLERANCE:g} %; take a smaller edge_mm than {edge_mm:g}."
        )
    boundary = np.unique(mesh.boundary_facets)
    distance, _, _ = part.signed_distance.unsigned(mesh.nodes[boundary])
    # As far as the mesher may stray from the surface it was given, and that from the part's.
    allowed = (1 + SIMPLIFY_SHARE) * envelope
    off = int((distance > allowed).sum())
    if off:
        return (
            f"{off} of {len(boundary)} nodes of the tet mesh's boundary are off the part's surface by "
            f"up to {distance.max():.3g} mm, more than {allowed:.3g} mm; try another edge_mm than "
            f"{edge_mm:g}, or repair the surface."
        )
    return None
