"""The part of a lattice that lies inside a part, without loose ends, in one piece."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from texmap_opt.errors import LatticeError
from texmap_opt.part import Part
from texmap_opt.structure.structure import Structure
from texmap_opt.structure.strut_pieces import Pieces, strut_pieces

# A piece between a joint and the surface shorter than this share of its strut is left out when the
# joint reaches the surface by itself: such a stub adds nothing but ill-conditioned equations.
SLIVER_SHARE = 0.05
# ... and so is one shorter than this many radii: it lies inside the joint's own sphere.
SLIVER_RADII = 1.0
# Smallest share of the strut length that the largest connected piece must hold. Bits that fall off
# at thin edges are a few per cent; more means that the part is not filled as asked.
LEAST_SHARE = 0.9


@dataclass(frozen=True)
class TrimCounts:
    """What trimming did.

    Attributes:
        struts_given: struts of the untrimmed lattice.
        struts_outside: of these, wholly outside the part.
        struts_cut: of these, cut at the surface (a strut may leave several pieces).
        slivers: pieces left out because they are too short.
        loose_struts: struts removed because an end held on to nothing.
        loose_share: their share of the length inside the part.
        components: connected pieces that were left, before the largest was taken.
        dropped_share: share of the strut length in the smaller pieces, which are dropped.
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
    struts: int


@dataclass(frozen=True, eq=False)
class Trimmed:
    """A lattice trimmed to a part.

    Attributes:
        structure: one connected net; `cut` marks the joints on the surface.
        at_surface: joints on the surface, or whose own sphere reaches it: a skin holds them.
        counts: what was removed.
    """

    structure: Structure
    at_surface: Bool[np.ndarray, " joints"]
    counts: TrimCounts


def trim(
    structure: Structure,
    part: Part,
    *,
    attached_to_skin: bool,
    in_region: Callable[[Float[np.ndarray, "n 3"]], Bool[np.ndarray, " n"]] | None = None,
    least_share: float = LEAST_SHARE,
) -> Trimmed:
    """Keep what lies inside a part: cut at the surface, no loose ends, one connected piece.

    A joint with a single strut is a loose end, and goes with its strut, unless a skin holds it (it
    is at the surface and there is a skin) or it lies in a region that is supported or loaded. That
    is repeated until nothing is loose. Of the connected pieces the longest stays.

    Args:
        structure: a lattice that overlaps the part, uncut.
        part: the part.
        attached_to_skin: there is a skin, so ends at the surface hold.
        in_region: says which points lie in a supported or loaded region; None: there are none.
        least_share: smallest share of the strut length that the largest piece must hold.

    Raises:
        LatticeError: when nothing is left, or the lattice falls into pieces of which none holds
            `least_share`.
    """
    pieces = strut_pieces(structure, part)
    inside, at_surface, slivers = _without_slivers(pieces)
    if len(inside.struts) == 0:
        raise LatticeError(_nothing_inside(structure, part))
    held = at_surface if attached_to_skin else np.zeros(len(inside.joints), bool)
    if in_region is not None:
        held = held | in_region(inside.joints)
    tight = _without_loose_ends(inside.struts, held)
    length = inside.lengths()
    if not tight.any():
        raise LatticeError(_all_loose(structure, len(length), attached_to_skin=attached_to_skin))
    largest, shares = _largest_component(inside, tight)
    if shares[0] < least_share:
        raise LatticeError(_falls_apart(shares, least_share))
    kept = inside.select(largest)
    return Trimmed(
        structure=kept,
        at_surface=at_surface[np.unique(inside.struts[largest])],
        counts=TrimCounts(
            struts_given=len(structure.struts),
            struts_outside=pieces.outside,
            struts_cut=pieces.cut,
            slivers=slivers,
            loose_struts=int(np.sum(~tight)),
            loose_share=float(length[~tight].sum() / length.sum()),
            components=len(shares),
            dropped_share=float(1 - shares[0]) if len(shares) > 1 else 0.0,
            struts=len(kept.struts),
        ),
    )


def _without_slivers(pieces: Pieces) -> tuple[Structure, Bool[np.ndarray, " joints"], int]:
    """Leave out stubs; also says which of the remaining joints are at the surface."""
    net, depth = pieces.structure, pieces.depth
    a, b = net.struts.T
    length, radius = net.lengths(), net.radii.max(axis=1)
    joint_radius = np.zeros(len(net.joints))
    np.maximum.at(joint_radius, net.struts, net.radii)
    reaches = net.cut | (depth <= joint_radius)
    short = length < np.maximum(SLIVER_SHARE * pieces.whole_length, SLIVER_RADII * radius)
    # Only pieces that were cut: a short strut of a fine cell is no sliver. Both ends of a sliver
    # are at the surface without it, so nothing that hangs there lets go.
    sliver = short & pieces.shortened & reaches[a] & reaches[b]
    keep = ~sliver
    kept = net.select(keep)
    return kept, reaches[np.unique(net.struts[keep])], int(sliver.sum())


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


def _largest_component(
    net: Structure, kept: Bool[np.ndarray, " struts"]
) -> tuple[Bool[np.ndarray, " struts"], Float[np.ndarray, " n"]]:
    """The kept struts of the longest piece, and each piece's share of the length, longest first."""
    label = net.select(kept).components()
    used = np.zeros(len(net.joints), bool)
    used[net.struts[kept]] = True
    of_joint = np.full(len(net.joints), -1)
    of_joint[used] = label
    of_strut = of_joint[net.struts[:, 0]]
    length = np.bincount(of_strut[kept], weights=net.lengths()[kept])
    largest = kept & (of_strut == np.argmax(length))
    return largest, np.sort(length / length.sum())[::-1]


def _nothing_inside(structure: Structure, part: Part) -> str:
    size = " x ".join(f"{x:.4g}" for x in np.ptp(part.surface.bounds, axis=0))
    longest = float(structure.lengths().max()) if len(structure.struts) else 0.0
    return (
        f"No strut of the lattice lies inside the part ({size} mm): its struts are up to "
        f"{longest:.3g} mm long. Use smaller cells ([lattice] cells or cell_mm)."
    )


def _all_loose(structure: Structure, inside: int, *, attached_to_skin: bool) -> str:
    skin = "" if attached_to_skin else " or give the part a skin that holds them (skin_mm > 0)"
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
