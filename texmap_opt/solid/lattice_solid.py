"""The lattice as one solid: struts and joints meshed directly, or extruded walls."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from texmap_opt.errors import LatticeError, SolidError
from texmap_opt.solid.clearance import Clusters, clusters, near_pairs
from texmap_opt.solid.cluster_solids import ClusterSolid, cluster_solids
from texmap_opt.solid.extruded import extruded_solid
from texmap_opt.solid.lattice_mesh import Meshed, assembled, joint_surfaces
from texmap_opt.solid.strut_ends import StrutEnds, clamped_fillets
from texmap_opt.solid.struts import round_ring, segments_within, square_ring
from texmap_opt.solid.tri_mesh import TriMesh
from texmap_opt.structure.structure import Structure

# Rounds in which a cluster may take in the joints that its union spoils.
MAX_GROWTH = 12


@dataclass(frozen=True, eq=False)
class LatticeSolid:
    """A lattice as a solid, and how it came about.

    Attributes:
        surface: closed, outward oriented [mm].
        joint_types: different joints that were worked out; 0 for walls.
        clusters: groups of struts and joints that were united by booleans, since struts are too
            short for their radii or pass through each other.
        cluster_struts: struts in them.
        cluster_joints: joints in them.
        clamped_fillets: joints whose fillets had to be smaller than asked for.
        smallest_fillet_mm: of all joints with more than one strut; 0 in clusters.
        error_mm: largest known distance of a joint's triangle from the surface it stands for [mm].
    """

    surface: TriMesh
    joint_types: int = 0
    clusters: int = 0
    cluster_struts: int = 0
    cluster_joints: int = 0
    clamped_fillets: int = 0
    smallest_fillet_mm: float = 0.0
    error_mm: float = 0.0

    def notes(self, fillet_mm: float) -> list[str]:
        """What a user should know, in sentences; `fillet_mm` was asked for [mm]."""
        notes = []
        if self.clusters:
            notes.append(
                f"lattice: {self.cluster_struts:,} struts in {self.clusters:,} places are too short "
                "for their radii or pass through others; they were united as solids, without fillets"
            )
        if fillet_mm and self.clamped_fillets:
            notes.append(
                f"lattice: fillet_mm = {fillet_mm:g} has no room at {self.clamped_fillets:,} joints, "
                f"where fillets are smaller, {self.smallest_fillet_mm:.3g} mm at the least"
            )
        return notes


def lattice_solid(
    structure: Structure,
    *,
    tolerance_mm: float,
    segments: int | None = None,
    fillet_mm: float = 0.0,
) -> LatticeSolid:
    """Closed surface of the union of all struts and joints.

    Struts are polygons of the circle's area (or squares), so that their volume is right; a joint is
    as round as its thickest strut, and its surface within the tolerance of the union of its struts
    and that ball. For walls see `extruded_solid`.

    Args:
        structure: joints, struts and radii [mm].
        tolerance_mm: largest distance of a polygon from its circle, for the thickest strut, and of
            a joint's surface from the union.
        segments: sides of a round strut, or of the joints of walls; absent: as many as
            `tolerance_mm` asks for (8 to 24).
        fillet_mm: radius of the fillets between struts [mm]; smaller where there is no room.

    Raises:
        LatticeError: for no struts, a radius that is not positive, or a strut without length.
        SolidError: when a union fails.
    """
    _check(structure)
    if structure.extrusion is not None:
        return LatticeSolid(
            extruded_solid(
                structure,
                structure.extrusion,
                tolerance_mm=tolerance_mm,
                segments=segments,
                fillet_mm=fillet_mm,
            ),
            smallest_fillet_mm=fillet_mm,
        )
    thickest = float(structure.radii.max())
    sides = segments or segments_within(tolerance_mm, thickest)
    ends = StrutEnds.of(
        structure, square_ring() if structure.section == "square" else round_ring(sides)
    )
    near, gaps = near_pairs(ends, 2 * (tolerance_mm + fillet_mm))
    if fillet_mm > 0:
        ends = ends.filleted(_fillets(ends, fillet_mm, near, gaps))
    united = clusters(ends, near, gaps, tolerance=tolerance_mm)
    own = np.flatnonzero(~united.joints & (ends.valence > 0))
    meshed = joint_surfaces(ends, own, tolerance=tolerance_mm)
    united = united.grown(np.concatenate([own[:0], *(part.failed for part in meshed)]), own[:0])
    united, solids = _whole_clusters(ends, united)
    meshed = [part.without(united.joints) for part in meshed]
    return _joined(ends, united, meshed, solids, fillet_mm)


def _fillets(
    ends: StrutEnds,
    fillet: float,
    near: Int[np.ndarray, "pairs 2"],
    gaps: Float[np.ndarray, " pairs"],
) -> Float[np.ndarray, " joints"]:
    """Radii of the fillets, with room along the struts and before struts that pass by [mm]."""
    radius = clamped_fillets(ends, fillet)
    # A fillet nowhere stands out of the struts by more than its radius; two may face each other.
    room = np.repeat(np.maximum(gaps, 0) / 2, 4)
    np.minimum.at(radius, ends.structure.struts[near].reshape(-1), room)
    return radius


def _whole_clusters(ends: StrutEnds, united: Clusters) -> tuple[Clusters, list[ClusterSolid]]:
    """Clusters grown until every ring between them and the rest is whole, and their solids."""
    for _ in range(MAX_GROWTH):
        solids = cluster_solids(ends, united)
        spoiled = np.concatenate([np.zeros(0, np.int64), *(solid.spoiled for solid in solids)])
        if not len(spoiled):
            return united, solids
        # First the strut is taken in as far as its other ring, then the joint that the ring is at.
        strut = ends.end[spoiled] // 2
        again = united.struts[strut]
        united = united.grown(ends.joint[spoiled[again]], strut[~again])
    raise SolidError(
        f"The lattice cannot be meshed: {int(united.struts.sum())} of {len(united.struts)} struts "
        "lie so near to others that their union has no clear border. Reduce radius_mm or use larger "
        "cells."
    )


def _joined(
    ends: StrutEnds,
    united: Clusters,
    meshed: list[Meshed],
    solids: list[ClusterSolid],
    fillet_mm: float,
) -> LatticeSolid:
    """Everything in one surface."""
    open_surface = assembled(ends, ~united.struts, meshed)
    vertices, faces = [open_surface.vertices], [open_surface.faces]
    count = len(open_surface.vertices)
    for solid in solids:
        new = solid.corner < 0
        number = np.where(new, count + np.cumsum(new) - 1, solid.corner)
        vertices.append(solid.surface.vertices[new])
        faces.append(number[solid.surface.faces])
        count += int(new.sum())
    whole = TriMesh(np.concatenate(vertices), np.concatenate(faces))
    filleted = ends.valence > 1
    radius = np.where(united.joints, 0.0, ends.fillet)[filleted]
    return LatticeSolid(
        surface=_with_used_vertices(whole),
        joint_types=sum(len(part.valid) for part in meshed),
        clusters=len(solids),
        cluster_struts=int(united.struts.sum()),
        cluster_joints=int(united.joints.sum()),
        clamped_fillets=int((radius < fillet_mm * (1 - 1e-9)).sum()),
        smallest_fillet_mm=float(radius.min(initial=fillet_mm)),
        error_mm=max((part.error_mm for part in meshed), default=0.0),
    )


def _with_used_vertices(surface: TriMesh) -> TriMesh:
    """Without the corners of rings that only clusters would have used."""
    used = np.zeros(len(surface.vertices), bool)
    used[surface.faces] = True
    if used.all():
        return surface
    return TriMesh(surface.vertices[used], (np.cumsum(used) - 1)[surface.faces])


def _check(structure: Structure) -> None:
    if not len(structure.struts):
        raise LatticeError("The lattice has no struts: use smaller cells or a larger part.")
    if not (np.isfinite(structure.radii).all() and (structure.radii > 0).all()):
        worst = int(np.argmin(structure.radii.min(axis=1)))
        raise LatticeError(
            f"Strut {worst} has radius {float(structure.radii[worst].min()):g} mm; radii must be "
            "above 0: raise radius_mm or min_radius_mm."
        )
    lengths = structure.lengths()
    if not (lengths > 0).all():
        raise LatticeError(
            f"Strut {int(np.argmin(lengths))} has no length: its joints coincide; weld the "
            "structure first."
        )
