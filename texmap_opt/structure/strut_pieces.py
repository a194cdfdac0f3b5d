"""The pieces of struts that lie inside a part."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from texmap_opt.part import Part
from texmap_opt.structure.segment_cuts import crossings
from texmap_opt.structure.structure import Structure

# Points this close to the surface, as a share of the part's diagonal, lie on it. Coordinates of an
# STL are known to 1e-7 of their size; a lattice plane that coincides with a face of the part must
# count as inside throughout, whatever the rounding.
ON_SURFACE = 1e-6


@dataclass(frozen=True, eq=False)
class Pieces:
    """Struts cut at a surface, outside pieces left out.

    Attributes:
        structure: the pieces; joints that nothing uses are gone.
        depth: how far inside each joint lies [mm]; 0 on the surface.
        shortened: pieces that are not a whole strut.
        outside: how many struts left no piece.
        cut: how many struts were cut.
    """

    structure: Structure
    depth: Float[np.ndarray, " joints"]
    shortened: Bool[np.ndarray, " struts"]
    outside: int
    cut: int


def strut_pieces(structure: Structure, part: Part) -> Pieces:
    """Cut struts where they pass through a part's surface and keep what is inside.

    Every crossing of every strut counts, so a strut through a notch leaves two pieces. A piece is
    inside when its middle is, and neither end is outside; points on the surface are inside.

    Args:
        structure: joints and struts.
        part: gives the surface and signed distances to it.
    """
    on_surface = ON_SURFACE * float(np.linalg.norm(np.ptp(part.surface.bounds, axis=0)))
    distance = _signed_distance(part, structure.joints, on_surface)
    a, b = structure.struts.T
    length = structure.lengths()
    # The distance to the surface changes by no more than the way along the strut, so a strut whose
    # ends are together farther from the surface than it is long does not meet it.
    near = np.abs(distance[a]) + np.abs(distance[b]) <= length + 2 * on_surface
    strut, position = _stations(structure, part, np.flatnonzero(near), on_surface)
    at = structure.joints[a[strut]] + position[:, None] * _direction(structure)[strut]

    same = strut[1:] == strut[:-1]
    first, last = np.flatnonzero(same), np.flatnonzero(same) + 1
    middle = (at[first] + at[last]) / 2
    inside = _signed_distance(part, middle, on_surface) <= on_surface
    outside_end = distance > on_surface
    inside &= ~((position[first] == 0) & outside_end[a[strut[first]]])
    inside &= ~((position[last] == 1) & outside_end[b[strut[last]]])
    begin, end = _runs(first, last, strut, inside)

    whole = np.flatnonzero(~near & (distance[a] < 0))
    ends = np.stack([position[begin], position[end]], axis=1)
    on = np.abs(distance) <= on_surface
    return _assemble(structure, np.where(on, 0, -distance), whole, strut[begin], ends)


def _signed_distance(
    part: Part, points: Float[np.ndarray, "samples 3"], on_surface: float
) -> Float[np.ndarray, " samples"]:
    """Distance to the surface [mm], negative inside; on the surface itself without sign.

    There the sign means nothing and costs the most: the winding number is in doubt.
    """
    distance = part.signed_distance.unsigned(points)[0]
    off = np.flatnonzero(distance > on_surface)
    distance[off[part.contains(points[off])]] *= -1
    return distance


def _direction(structure: Structure) -> Float[np.ndarray, "struts 3"]:
    return structure.joints[structure.struts[:, 1]] - structure.joints[structure.struts[:, 0]]


def _stations(
    structure: Structure, part: Part, near: Int[np.ndarray, " n"], on_surface: float
) -> tuple[Int[np.ndarray, " samples"], Float[np.ndarray, " samples"]]:
    """Ends and crossings of the struts near the surface, in order along each; no two coincide."""
    start, end = np.moveaxis(structure.joints[structure.struts[near]], 1, 0)
    found = crossings(part.surface, start, end)
    slack = on_surface / structure.lengths()[near]
    t, s = found.position, slack[found.segment]
    between = (t > s) & (t < 1 - s)
    segment, t = found.segment[between], t[between]
    again = np.zeros(len(t), bool)
    again[1:] = (segment[1:] == segment[:-1]) & (np.diff(t) < slack[segment[1:]])
    segment, t = segment[~again], t[~again]
    index = np.arange(len(near))
    strut = np.concatenate([index, segment, index])
    position = np.concatenate([np.zeros(len(near)), t, np.ones(len(near))])
    order = np.lexsort((position, strut))
    return near[strut[order]], position[order]


def _runs(
    first: Int[np.ndarray, " struts"],
    last: Int[np.ndarray, " struts"],
    strut: Int[np.ndarray, " samples"],
    inside: Bool[np.ndarray, " struts"],
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """First and last station of each run of pieces inside: a mere touch does not cut a strut."""
    joined = np.zeros(len(first), bool)
    joined[1:] = inside[1:] & inside[:-1] & (strut[first[1:]] == strut[first[:-1]])
    begins = inside & ~joined
    ends = inside & ~np.append(joined[1:], False)
    return first[begins], last[ends]


def _assemble(
    structure: Structure,
    depth: Float[np.ndarray, " joints"],
    whole: Int[np.ndarray, " samples"],
    strut: Int[np.ndarray, " n"],
    ends: Float[np.ndarray, "n 2"],
) -> Pieces:
    """Whole struts and pieces as one structure, with new joints where struts were cut."""
    made = (ends > 0) & (ends < 1)
    # Where a piece ends with its strut it keeps the strut's joint; elsewhere it gets a new one.
    struts = structure.struts[strut]
    struts[made] = len(structure.joints) + np.arange(made.sum())
    start = structure.joints[structure.struts[strut, 0]]
    cuts = start[:, None] + ends[..., None] * _direction(structure)[strut][:, None]
    source = np.concatenate([whole, strut])
    pieces = replace(
        structure,
        joints=np.concatenate([structure.joints, cuts[made]]),
        struts=np.concatenate([structure.struts[whole], struts]),
        radii=np.concatenate([structure.radii[whole], _radii_at(structure, strut, ends)]),
        cut=np.concatenate([depth == 0, np.ones(made.sum(), bool)]),
        cell_size=structure.cell_size[source],
        origin=None if structure.origin is None else structure.origin.select(source),
        extrusion=None if structure.extrusion is None else structure.extrusion.select(source),
    )
    used = np.unique(pieces.struts)
    return Pieces(
        structure=pieces.select(np.ones(len(source), bool)),
        depth=np.concatenate([depth, np.zeros(made.sum())])[used],
        shortened=np.concatenate([np.zeros(len(whole), bool), made.any(axis=1)]),
        outside=len(structure.struts) - len(np.unique(source)),
        cut=len(np.unique(strut[made.any(axis=1)])),
    )


def _radii_at(
    structure: Structure, strut: Int[np.ndarray, " n"], ends: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n 2"]:
    """Radius [mm] at positions 0 to 1 along struts that taper linearly."""
    first, last = structure.radii[strut, :1], structure.radii[strut, 1:]
    return first * (1 - ends) + last * ends
