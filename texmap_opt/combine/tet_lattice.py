"""A lattice of tetrahedra around a level of a distance field, bisected where it is asked to be.

Cubes that cannot meet the level are never made: an octree of cubes is cut down by the field's
Lipschitz constant, 1. Cubes left are split into Kuhn's six tetrahedra, and those are bisected after
Maubach (SIAM J. Sci. Comput. 16, 1995), which keeps neighbours face to face and shapes few.
Memory follows the surface.
"""

import abc
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

# Bisection levels a coarse cube can be divided into: lattice coordinates are whole numbers.
DEPTH = 10
# Bits a lattice coordinate has in the key of a vertex.
_KEY_BITS = 21
# Rows are the lattice's axes: turned by 0.35, 0.52 and 0.83 rad about x, y and z. Walls and edges
# of parts are often along coordinate axes; a crease along a row of lattice edges, just beside
# them, would have to be divided all the way to the tolerance.
_TURN = Rotation.from_euler("xyz", [0.35, 0.52, 0.83]).as_matrix()
EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


class AbstractField(abc.ABC):
    """A function of space with Lipschitz constant 1, such as a signed distance."""

    @abc.abstractmethod
    def __call__(
        self,
        points: Float[np.ndarray, "n 3"],
        hint: tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]] | None = None,
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Value [mm] and unit gradient at points.

        Args:
            points: where [mm].
            hint: for each point another place and the value there: may save time.
        """


@dataclass(frozen=True, eq=False)
class TetLattice:
    """Tetrahedra near the zero level of a field.

    Attributes:
        field: value and gradient at any point.
        origin: lattice point (0, 0, 0) in the turned axes of the lattice [mm].
        step: length of one lattice unit [mm].
        lattice: whole lattice coordinates of the vertices.
        values: the field at the vertices [mm].
        gradients: its unit gradient there.
        tets: vertices in Maubach's order.
        tags: which edge is bisected next: from corner 0 to corner `tag`.
        settled: tetrahedra that were examined and need no bisection of their own.
    """

    field: AbstractField
    origin: Float[np.ndarray, " 3"]
    step: float
    lattice: Int[np.ndarray, "nodes 3"]
    values: Float[np.ndarray, " nodes"]
    gradients: Float[np.ndarray, "nodes 3"]
    tets: Int[np.ndarray, "cells 4"]
    tags: Int[np.ndarray, " cells"]
    settled: np.ndarray

    @property
    def points(self) -> Float[np.ndarray, "nodes 3"]:
        """Positions of the vertices [mm]."""
        return _placed(self.origin + self.step * self.lattice)

    def sampled(
        self, points: Float[np.ndarray, "n 3"], tets: Int[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Value and unit gradient at one point inside each of the given tetrahedra."""
        corners = self.tets[tets]
        # The lowest corner: inside the level, if any is, hence farthest from the part's surface.
        lowest = np.argmin(self.values[corners], axis=1)
        return self.beside(points, corners[np.arange(len(corners)), lowest])

    def beside(
        self, points: Float[np.ndarray, "n 3"], nodes: Int[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Value and unit gradient at points near the given vertices."""
        places = _placed(self.origin + self.step * self.lattice[nodes])
        return self.field(points, (places, self.values[nodes]))

    def only(self, chosen: np.ndarray) -> "TetLattice":
        """The chosen tetrahedra, over the same vertices."""
        return replace(
            self, tets=self.tets[chosen], tags=self.tags[chosen], settled=self.settled[chosen]
        )


def coarse_lattice(
    field: AbstractField, bounds: Float[np.ndarray, "2 3"], cube: float
) -> tuple[TetLattice, float]:
    """Kuhn tetrahedra of all cubes that the zero level may meet.

    Args:
        field: what to find the level of.
        bounds: box to search [mm].
        cube: edge of the cubes at most [mm].

    Returns:
        the lattice, and the lowest value seen at a cube's centre [mm].
    """
    box = np.array(np.meshgrid(*bounds.T, indexing="ij")).reshape(3, 8).T @ _TURN.T
    bounds = np.stack([box.min(axis=0), box.max(axis=0)])
    extent = float(np.ptp(bounds, axis=0).max())
    levels = max(0, int(np.ceil(np.log2(extent / cube))))
    # An irrational share of a cube is left free on every side: walls of the part, often at round
    # numbers, then do not lie on lattice planes.
    origin = bounds[0] - 0.0271828 * extent
    size = 1.0618034 * extent / 2**levels
    # Start from 4 cubes along the longest side: coarser ones nearly always meet the level.
    level = min(2, levels)
    counts = [
        int(np.ceil(side / (size * 2 ** (levels - level))))
        for side in np.ptp(bounds, axis=0) * 1.06
    ]
    cubes = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, 3)
    lowest = np.inf
    while True:
        edge = size * 2 ** (levels - level)
        values, _ = field(_placed(origin + edge * (cubes + 0.5)))
        lowest = min(lowest, float(values.min(initial=np.inf)))
        cubes = cubes[np.abs(values) <= np.sqrt(3) / 2 * edge]
        if level == levels or not len(cubes):
            break
        octants = np.array(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij")).reshape(3, 8).T
        cubes = (2 * cubes[:, None] + octants).reshape(-1, 3)
        level += 1
    return _kuhn(field, origin, size, cubes), lowest


def bisected(mesh: TetLattice, chosen: np.ndarray) -> TetLattice:
    """The lattice after bisecting the chosen tetrahedra, and others until all meet face to face."""
    middles, ends = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    while chosen.any():
        row = np.flatnonzero(chosen)
        split = np.concatenate([mesh.tets[row, 0], mesh.tets[row, mesh.tags[row]]])
        mesh, fresh = _bisected_once(mesh, chosen)
        # Also those of earlier rounds: a child may still have one in the middle of an edge.
        middles, ends = np.union1d(middles, fresh), np.union1d(ends, split)
        chosen = _hanging(mesh, middles, ends)
    return near_level(mesh)


def near_level(mesh: TetLattice) -> TetLattice:
    """Without the tetrahedra that the zero level cannot meet."""
    corners = mesh.lattice[mesh.tets]
    edges = corners[:, EDGES[:, 0]] - corners[:, EDGES[:, 1]]
    longest = mesh.step * np.sqrt((edges**2).sum(axis=2).max(axis=1))
    return mesh.only(np.abs(mesh.values[mesh.tets]).max(axis=1) <= longest)


def _kuhn(field: AbstractField, origin: np.ndarray, size: float, cubes: np.ndarray) -> TetLattice:
    """Six tetrahedra a cube, along the paths from its lowest to its highest corner."""
    unit = 2**DEPTH
    paths = np.array(
        [
            np.cumsum([np.zeros(3, int), *np.eye(3, dtype=int)[list(p)]], axis=0)
            for p in permutations(range(3))
        ]
    )
    corners = unit * (cubes[:, None, None] + paths).reshape(-1, 3)
    keys, index = np.unique(_keys(corners), return_inverse=True)
    lattice = _unkeyed(keys)
    tets = index.reshape(-1, 4)
    step = size / unit
    values, gradients = field(_placed(origin + step * lattice))
    count = len(tets)
    return near_level(
        TetLattice(
            field,
            origin,
            step,
            lattice,
            values,
            gradients,
            tets,
            np.full(count, 3),
            np.zeros(count, dtype=bool),
        )
    )


def _bisected_once(mesh: TetLattice, chosen: np.ndarray) -> tuple[TetLattice, np.ndarray]:
    """Bisects each chosen tetrahedron once; also the keys of all midpoints used."""
    tets, tags = mesh.tets[chosen], mesh.tags[chosen]
    row = np.arange(len(tets))
    ends = mesh.lattice[np.stack([tets[:, 0], tets[row, tags]])]
    middle_keys = _keys(ends.sum(axis=0) // 2)
    keys, first, inverse = np.unique(middle_keys, return_index=True, return_inverse=True)
    known = _keys(mesh.lattice)
    order = np.argsort(known)
    place = np.minimum(np.searchsorted(known, keys, sorter=order), len(known) - 1)
    old = order[place]
    fresh = known[old] != keys
    number = np.where(fresh, len(known) + np.cumsum(fresh) - 1, old)
    lattice = _unkeyed(keys[fresh])
    pair = np.stack([tets[:, 0], tets[row, tags]])[:, first[fresh]]
    lowest = np.argmin(mesh.values[pair], axis=0)
    values, gradients = mesh.beside(
        _placed(mesh.origin + mesh.step * lattice), pair[lowest, np.arange(len(lowest))]
    )
    middle = number[inverse.reshape(-1)]
    left, right = tets.copy(), tets.copy()
    left[row, tags] = middle
    for k in range(3):
        # (x1 ... x_tag, z, x_tag+1 ...): corners up to the tag move one place down.
        right[:, k] = np.where(k < tags, tets[:, k + 1], right[:, k])
    right[row, tags] = middle
    next_tags = np.where(tags == 1, 3, tags - 1)
    refined = replace(
        mesh,
        lattice=np.concatenate([mesh.lattice, lattice]),
        values=np.concatenate([mesh.values, values]),
        gradients=np.concatenate([mesh.gradients, gradients]),
        tets=np.concatenate([mesh.tets[~chosen], left, right]),
        tags=np.concatenate([mesh.tags[~chosen], next_tags, next_tags]),
        settled=np.concatenate([mesh.settled[~chosen], np.zeros(2 * len(tets), dtype=bool)]),
    )
    return refined, keys


def _hanging(mesh: TetLattice, middles: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Tetrahedra with a vertex in the middle of an edge.

    Args:
        mesh: the lattice.
        middles: keys of the vertices put into the middle of edges.
        ends: the vertices at the ends of those edges.
    """
    is_end = np.zeros(len(mesh.lattice), dtype=bool)
    is_end[ends] = True
    near = np.flatnonzero(is_end[mesh.tets].sum(axis=1) >= 2)
    corners = mesh.lattice[mesh.tets[near]]
    hit = np.zeros(len(near), dtype=bool)
    for a, b in EDGES:
        total = corners[:, a] + corners[:, b]
        hit |= (total % 2 == 0).all(axis=1) & np.isin(_keys(total // 2), middles)
    hanging = np.zeros(len(mesh.tets), dtype=bool)
    hanging[near[hit]] = True
    return hanging


def _placed(coordinates: np.ndarray) -> np.ndarray:
    """Positions in space from those in the lattice's turned axes [mm]."""
    return coordinates @ _TURN


def _keys(lattice: np.ndarray) -> np.ndarray:
    return (lattice[:, 0] << 2 * _KEY_BITS) | (lattice[:, 1] << _KEY_BITS) | lattice[:, 2]


def _unkeyed(keys: np.ndarray) -> np.ndarray:
    mask = (1 << _KEY_BITS) - 1
    return np.column_stack([keys >> 2 * _KEY_BITS, (keys >> _KEY_BITS) & mask, keys & mask])
