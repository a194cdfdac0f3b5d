"""The part of a lattice that lies inside a part, without loose ends, in one piece."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from texmap_opt.errors import LatticeError
from texmap_opt.part import Part
from texmap_opt.solid.edges import Edges
from texmap_opt.structure.silhouette import silhouette, wall_depths
from texmap_opt.structure.structure import Extrusion, Structure
from texmap_opt.structure.strut_pieces import Pieces, strut_pieces

# A piece between a joint and the surface shorter than this many radii is left out when the joint
# reaches the surface by itself: it lies inside the joint's own sphere.
SLIVER_RADII = 1.0
# Walls whose depth inside the part is below this share of the part's own depth are left out: they
# stand where the part tapers to an edge, and stiffen nothing but the equations' condition number.
LEAST_DEPTH_SHARE = 1e-3
# Smallest share of the strut length that the largest connected piece must hold, where there is a skin
# with all that hangs on it. Bits that fall off at thin edges are a few per cent; more means that
# the part is not filled as asked.
LEAST_SHARE = 0.9
# A joint this many radii below the inner face of the skin has half a strut's section in common with
# it: sqrt(1 - x²) of the radius is 1/sqrt(2).
FUSED = 2**-0.5


@dataclass(frozen=True)
class TrimCounts:
    """What trimming did.

    Attributes:
        struts_given: struts of the untrimmed lattice.
        struts_outside: of these, wholly outside the part.
        struts_cut: of these, cut at the surface (a strut may leave several pieces).
        slivers: pieces left out because they are too short, or walls too shallow.
        loose_struts: struts removed because an end held on to nothing.
        loose_share: their share of the length inside the part.
        components: connected pieces that were left, before the largest was taken; all that hangs on
            the skin is one.
        dropped_share: share of the strut length in the smaller pieces, which are dropped.
        skin_only_share: share of it in pieces that only the skin connects to the longest.
        struts: struts of the result.
    """

    struts_given: int
    struts_outside: int
    struts_cut: int
    slivers: int
    loose_struts: int
    loose_share: float
    components: int
    dropped_share: float
    skin_only_share: float
    struts: int


@dataclass(frozen=True, eq=False)
class Trimmed:
    """A lattice trimmed to a part.

    Attributes:
        structure: one net, connected by itself or by the skin; `cut` marks the joints on the surface.
        in_skin: joints that the skin holds; none without one.
        counts: what was removed.
    """

    structure: Structure
    in_skin: Bool[np.ndarray, " joints"]
    counts: TrimCounts


def held_by_skin(
    cut: Bool[np.ndarray, " joints"],
    depth: Float[np.ndarray, " joints"],
    radius: Float[np.ndarray, " joints"],
    skin_mm: float,
) -> Bool[np.ndarray, " joints"]:
    """Joints on the surface, those whose sphere reaches it, and those that the skin grows together with.

    Args:
        cut: joints on the surface.
        depth: of the joints below the part's surface [mm].
        radius: of their spheres [mm].
        skin_mm: thickness of the skin [mm].
    """
    return cut | (depth <= np.maximum(skin_mm + FUSED * radius, radius))


def joint_radii(structure: Structure) -> Float[np.ndarray, " joints"]:
    """Radius of the thickest strut at each joint [mm]."""
    radius = np.zeros(len(structure.joints))
    np.maximum.at(radius, structure.struts, structure.radii)
    return radius


def trim(
    structure: Structure,
    part: Part,
    *,
    skin_mm: float,
    in_region: Callable[[Float[np.ndarray, "n 3"]], Bool[np.ndarray, " n"]] | None = None,
    least_share: float = LEAST_SHARE,
    sliver_mm: float = 0.0,
) -> Trimmed:
    """Keep what lies inside a part: cut at the surface, no loose ends, one connected piece.

    A joint with a single strut is a loose end, and goes with its strut, unless a skin holds it or it
    lies in a region that is supported or loaded. That is repeated until nothing is loose. Of the
    connected pieces the longest stays; pieces that the same skin holds are one.

    Walls are cut in their plane at the part's silhouette, and get their depth inside the part; the
    skin that holds their ends is that along the silhouette (see `silhouette`).

    Args:
        structure: a lattice that overlaps the part, uncut.
        part: the part.
        skin_mm: thickness of the skin that holds ends at the surface [mm]; 0: there is none.
        in_region: says which points lie in a supported or loaded region; None: there are none.
        least_share: smallest share of the strut length that the largest piece must hold.
        sliver_mm: cut pieces shorter than this, times the size of their cell, are left out when both
            their ends reach the surface anyway: such stubs add nothing but ill-conditioned
            equations [mm].

    Raises:
        LatticeError: when nothing is left, or the lattice falls into pieces of which none holds
            `least_share`.
    """
    outline, extrusion = part, structure.extrusion
    if extrusion is not None:
        outline = Part(silhouette(part.surface, extrusion.axis), part.name)
    pieces = strut_pieces(structure, outline)
    inside, depth, slivers = _without_slivers(pieces, sliver_mm)
    if inside.extrusion is not None:
        inside, depth, shallow = _without_shallow_walls(inside, inside.extrusion, depth, part)
        slivers += shallow
    if len(inside.struts) == 0:
        raise LatticeError(_nothing_inside(structure, part))
    in_skin = np.zeros(len(inside.joints), bool)
    if skin_mm > 0:
        in_skin = held_by_skin(inside.cut, depth, joint_radii(inside), skin_mm)
    held = in_skin if in_region is None else in_skin | in_region(inside.joints)
    tight = _without_loose_ends(inside.struts, held)
    length = inside.lengths()
    if not tight.any():
        raise LatticeError(_all_loose(structure, len(length), skin_mm))
    net = _Pieces.of(inside, tight, in_skin, outline)
    largest, shares = net.largest(length)
    if shares[0] < least_share:
        raise LatticeError(_falls_apart(shares, least_share))
    kept = inside.select(largest)
    return Trimmed(
        structure=kept,
        in_skin=in_skin[np.unique(inside.struts[largest])],
        counts=TrimCounts(
            struts_given=len(structure.struts),
            struts_outside=pieces.outside,
            struts_cut=pieces.cut,
            slivers=slivers,
            loose_struts=int(np.sum(~tight)),
            loose_share=float(length[~tight].sum() / length.sum()),
            components=len(shares),
            dropped_share=float(1 - shares[0]) if len(shares) > 1 else 0.0,
            skin_only_share=_skin_only_share(kept),
            struts=len(kept.struts),
        ),
    )


def _without_slivers(
    pieces: Pieces, sliver_mm: float
) -> tuple[Structure, Float[np.ndarray, " joints"], int]:
    """Leave out stubs; also says how deep the remaining joints lie [mm]."""
    net, depth = pieces.structure, pieces.depth
    a, b = net.struts.T
    length, radius = net.lengths(), net.radii.max(axis=1)
    reaches = net.cut | (depth <= joint_radii(net))
    short = length < np.maximum(sliver_mm * net.cell_size, SLIVER_RADII * radius)
    # Only pieces that were cut: a short strut of a fine cell is no sliver. Both ends of a sliver
    # are at the surface without it, so nothing that hangs there lets go.
    sliver = short & pieces.shortened & reaches[a] & reaches[b]
    keep = ~sliver
    return net.select(keep), depth[np.unique(net.struts[keep])], int(sliver.sum())


def _without_shallow_walls(
    net: Structure, extrusion: Extrusion, depth: Float[np.ndarray, " joints"], part: Part
) -> tuple[Structure, Float[np.ndarray, " joints"], int]:
    """Walls with their depths in the part; also says how deep the remaining joints lie [mm].

    Not to be confused: `depth` is how far inside the silhouette each joint lies.
    """
    of_wall = wall_depths(net, extrusion, part)
    keep = of_wall > LEAST_DEPTH_SHARE * float(np.ptp(part.surface.vertices @ extrusion.axis))
    walls = replace(net, extrusion=replace(extrusion, depth=of_wall)).select(keep)
    return walls, depth[np.unique(net.struts[keep])], int(np.sum(~keep))


def _without_loose_ends(
    struts: Int[np.ndarray, "struts 2"], held: Bool[np.ndarray, " joints"]
) -> Bool[np.ndarray, " struts"]:
    """The struts that remain when loose ends are removed until there are none."""
    keep = np.ones(len(struts), bool)
    while True:
        degree = np.bincount(struts[keep].reshape(-1), minlength=len(held))
        loose = ((degree == 1) & ~held)[struts].any(axis=1) & keep
        if not loose.any():
            return keep
        keep &= ~loose


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Kept struts, and the connected piece of each; -1 for struts that are not kept."""

    kept: Bool[np.ndarray, " struts"]
    piece: Int[np.ndarray, " struts"]

    @classmethod
    def of(
        cls,
        net: Structure,
        kept: Bool[np.ndarray, " struts"],
        in_skin: Bool[np.ndarray, " joints"],
        part: Part,
    ) -> "_Pieces":
        """Joined by struts, and by the skin of each closed shell of the part's surface."""
        joints = len(net.joints)
        links = [net.struts[kept]]
        if in_skin.any():
            held = np.flatnonzero(in_skin)
            face = part.signed_distance.unsigned(net.joints[held])[1]
            shell = Edges(part.surface).shell_of_face[face]
            links.append(np.stack([held, joints + shell], axis=1))
        a, b = np.concatenate(links).T
        nodes = max(joints, int(b.max()) + 1)
        graph = coo_array((np.ones(len(a)), (a, b)), shape=(nodes, nodes))
        label = connected_components(graph, directed=False)[1]
        return cls(kept, np.where(kept, label[net.struts[:, 0]], -1).astype(np.int64))

    def largest(
        self, length: Float[np.ndarray, " struts"]
    ) -> tuple[Bool[np.ndarray, " struts"], Float[np.ndarray, " n"]]:
        """The struts of the longest piece, and each piece's share of the length, longest first."""
        names, piece = np.unique(self.piece[self.kept], return_inverse=True)
        total = np.bincount(piece, weights=length[self.kept])
        largest = self.kept & (self.piece == names[np.argmax(total)])
        return largest, np.sort(total / total.sum())[::-1]


def _skin_only_share(kept: Structure) -> float:
    """Share of the strut length outside the longest piece that struts alone connect."""
    length = np.bincount(kept.components()[kept.struts[:, 0]], weights=kept.lengths())
    return float(1 - length.max() / length.sum()) if len(length) > 1 else 0.0


def _nothing_inside(structure: Structure, part: Part) -> str:
    size = " x ".join(f"{x:.4g}" for x in np.ptp(part.surface.bounds, axis=0))
    longest = float(structure.lengths().max()) if len(structure.struts) else 0.0
    return (
        f"No strut of the lattice lies inside the part ({size} mm): its struts are up to "
        f"{longest:.3g} mm long. Use smaller cells ([lattice] cells or cell_mm)."
    )


def _all_loose(structure: Structure, inside: int, skin_mm: float) -> str:
    skin = "" if skin_mm > 0 else " or give the part a skin that holds them (skin_mm > 0)"
    return (
        f"All {inside} pieces of struts inside the part are loose ends: cells with struts of "
        f"{np.median(structure.lengths()):.3g} mm are larger than the part's thickest region. Use "
        f"smaller cells ([lattice] cells or cell_mm){skin}."
    )


def _falls_apart(shares: Float[np.ndarray, " n"], least_share: float) -> str:
    largest = ", ".join(f"{share:.1%}" for share in shares[:3])
    more = ", ..." if len(shares) > 3 else ""
    return (
        f"The lattice falls into {len(shares)} pieces that hold {largest}{more} of the strut "
        f"length; the largest must hold at least {least_share:.0%}. The part is too thin between "
        "them for these cells: use smaller cells ([lattice] cells or cell_mm), or thicken the part."
    )
