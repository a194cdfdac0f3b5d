"""The crystal system of the lattice that a unit cell makes, found from its struts."""

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from texmap_opt.cells.unit_cell import TICKS, UnitCell
from texmap_opt.structure.tile import tile

SYSTEMS = (
    "cubic",
    "hexagonal",
    "tetragonal",
    "trigonal",
    "orthorhombic",
    "monoclinic",
    "triclinic",
    "square",
    "rectangular",
    "oblique",
)
# In cell edges: above the rounding of coordinates typed with nine digits, far below any strut.
SAME_PLACE = 1e-6


@dataclass(frozen=True, eq=False)
class _Pattern:
    """Struts of one period in space, as points with a direction and a radius.

    Attributes:
        period: edges of the period.
        middles: of the struts.
        tensors: n n' of each strut's direction n, times its length.
        radius: relative radius.
        tree: of all that, periodic in the middles.
    """

    period: Float[np.ndarray, " d"]
    middles: Float[np.ndarray, "struts d"]
    tensors: Float[np.ndarray, "struts d d"]
    radius: Float[np.ndarray, " struts"]
    tree: KDTree

    @classmethod
    def of(cls, cell: UnitCell) -> "_Pattern":
        scale = np.array(cell.proportions)
        period = np.array(cell.period) * scale
        starts, vectors, radius = _whole_struts(cell)
        vectors = vectors * scale
        tensors = np.einsum("si,sj,s->sij", vectors, vectors, 1 / np.linalg.norm(vectors, axis=1))
        features = _features(starts * scale + vectors / 2, tensors, radius, period)
        boxsize = np.zeros(features.shape[1])
        boxsize[: len(period)] = period
        return cls(
            period,
            features[:, : len(period)],
            tensors,
            radius,
            KDTree(features, boxsize=boxsize),
        )

    def holds(
        self,
        middles: Float[np.ndarray, "samples d"],
        tensors: Float[np.ndarray, "samples d d"],
        radius: Float[np.ndarray, " samples"],
    ) -> Bool[np.ndarray, " samples"]:
        """Whether there is such a strut."""
        features = _features(middles, tensors, radius, self.period)
        return self.tree.query(features)[0] < SAME_PLACE

    def shifts(self, turn: Float[np.ndarray, "d d"]) -> Float[np.ndarray, "n d"]:
        """Translations that take the pattern, turned about the origin, to itself."""
        turned = np.einsum("ij,sjk,lk->sil", turn, self.tensors, turn)
        middles = self.middles @ turn.T
        # The first strut must go to some strut; the others tell which of these shifts are right.
        found = self.middles - middles[0]
        for middle, tensor, radius in zip(middles, turned, self.radius, strict=True):
            count = len(found)
            kept = self.holds(
                middle + found,
                np.broadcast_to(tensor, (count, *tensor.shape)),
                np.full(count, radius),
            )
            found = found[kept]
            if not len(found):
                break
        return found

    def has(self, turn: Float[np.ndarray, "d d"]) -> bool:
        """Whether a rotation or reflection, with some translation, takes the pattern to itself.

        The pattern repeats by its periods; what is turned repeats by the turned periods, which must
        be translations of the pattern too.
        """
        if not len(self.shifts(turn)):
            return False
        return all(
            self.holds(self.middles + shift, self.tensors, self.radius).all()
            for shift in (turn * self.period).T
        )


def crystal_system(cell: UnitCell) -> str:
    """Crystal system of the endless lattice in its undistorted proportions.

    It is read off the point group: every rotation and reflection that, with some translation, takes
    the lattice to itself (International Tables for Crystallography A, table 2.1.1.1). Radii count.
    Looked for are turns that map a square or cube to itself, and those by 60 degrees about an axis.
    """
    pattern = _Pattern.of(cell)
    turns = [turn for turn in _candidates(cell.dimensions) if pattern.has(turn)]
    return _plane_system(turns) if cell.dimensions == 2 else _space_system(turns)


def _plane_system(turns: list[np.ndarray]) -> str:
    rotations = sum(np.linalg.det(turn) > 0 for turn in turns)
    if rotations % 3 == 0:
        return "hexagonal"
    if rotations == 4:
        return "square"
    return "rectangular" if len(turns) > rotations else "oblique"


def _space_system(turns: list[np.ndarray]) -> str:
    # A reflection is a half turn and an inversion: systems do not tell inversions apart.
    proper = np.unique([np.round(t * np.linalg.det(t), 9) + 0.0 for t in turns], axis=0)
    traces = np.rint(np.trace(proper, axis1=1, axis2=2)).astype(int)
    count = {trace: int(np.sum(traces == trace)) for trace in (-1, 0, 1, 2)}
    # Traces of turns by 180, 120, 90 and 60 degrees.
    if count[0] == 8:
        return "cubic"
    if count[2]:
        return "hexagonal"
    if count[0]:
        return "trigonal"
    if count[1]:
        return "tetragonal"
    return {0: "triclinic", 1: "monoclinic"}.get(count[-1], "orthorhombic")


def _candidates(d: int) -> list[np.ndarray]:
    """Turns that may take a lattice to itself."""
    square = [
        np.eye(d)[list(order)] * np.array(signs)[:, None]
        for order in itertools.permutations(range(d))
        for signs in itertools.product((1.0, -1.0), repeat=d)
    ]
    half, root = 0.5, np.sqrt(0.75)
    sixth = np.array([[half, -root], [root, half]])
    hexagonal = []
    for axes in itertools.combinations(range(d), 2):
        turn = np.eye(d)
        turn[np.ix_(axes, axes)] = sixth
        hexagonal += [power @ own for own in square for power in (turn, turn @ turn)]
    both = np.array([*square, *hexagonal])
    _, first = np.unique(np.round(both, 9) + 0.0, axis=0, return_index=True)
    return [both[k] for k in np.sort(first)]


def _whole_struts(
    cell: UnitCell,
) -> tuple[
    Float[np.ndarray, "struts d"], Float[np.ndarray, "struts d"], Float[np.ndarray, " struts"]
]:
    """Start, vector to the other end and radius of each strut in one period, in cells.

    What opposite faces share is there once. Where a straight strut runs on through a joint that
    holds nothing else (the faces of the cell cut it there), its pieces are one.
    """
    net = tile(cell, cell.period)
    ticks = np.rint(net.joints * TICKS).astype(np.int64)
    places, image = np.unique(ticks % (np.array(cell.period) * TICKS), axis=0, return_inverse=True)
    image = image.reshape(-1)
    struts: dict[tuple, tuple[int, np.ndarray, int, float]] = {}
    for (a, b), radius in zip(net.struts, net.relative_radius, strict=True):
        step = ticks[b] - ticks[a]
        ends = int(image[a]), int(image[b])
        if (*ends[::-1], *(-step).tolist()) not in struts:
            struts[*ends, *step.tolist()] = ends[0], step, ends[1], float(radius)
    whole = list(struts.values())
    for joint in range(len(places)):
        # As seen from the joint: the vector to the other end, and that end.
        here = [
            (s, *((step, b) if end == 0 else (-step, a)))
            for s, (a, step, b, _) in enumerate(whole)
            for end in (0, 1)
            if (a, b)[end] == joint
        ]
        if len(here) == 2 and here[0][0] != here[1][0]:
            (s, to_a, a), (t, to_b, b) = here
            if whole[s][3] == whole[t][3] and _opposite(to_a, to_b):
                whole[s] = a, to_b - to_a, b, whole[s][3]
                del whole[t]
    starts, vectors, _, radii = zip(*whole, strict=True)
    return places[list(starts)] / TICKS, np.array(vectors) / TICKS, np.array(radii)


def _opposite(a: Int[np.ndarray, " d"], b: Int[np.ndarray, " d"]) -> bool:
    """Whether two vectors point apart along one line."""
    u, v = a / np.linalg.norm(a), b / np.linalg.norm(b)
    return bool(np.linalg.norm(u + v) < SAME_PLACE)


def _features(
    middles: Float[np.ndarray, "samples d"],
    tensors: Float[np.ndarray, "samples d d"],
    radius: Float[np.ndarray, " samples"],
    period: Float[np.ndarray, " d"],
) -> Float[np.ndarray, "samples _"]:
    """Numbers that are equal for equal struts: place in the period, direction and length, radius."""
    place = np.mod(middles, period)
    place[place >= period - SAME_PLACE / 4] = 0.0
    return np.column_stack([place, tensors.reshape(len(place), -1), radius])
