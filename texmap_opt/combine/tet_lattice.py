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
from jaxtyping import Bool, Float, Int
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
        points: their positions [mm].
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
    points: Float[np.ndarray, "nodes 3"]
    values: Float[np.ndarray, " nodes"]
    gradients: Float[np.ndarray, "nodes 3"]
    tets: Int[np.ndarray, "cells 4"]
    tags: Int[np.ndarray, " cells"]
    settled: Bool[np.ndarray, " cells"]

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
        return self.field(points, (self.points[nodes], self.values[nodes]))

    def only(self, chosen: Bool[np.ndarray, " cells"] | Int[np.ndarray, " chosen"]) -> "TetLattice":
        """The chosen tetrahedra, over the same vertices."""
        return replace(
            self, tets=self.tets[chosen], tags=self.tags[chosen], settled=self.settled[chosen]
        )


def coarse_lattice(
    field: AbstractField, bounds: Float[np.ndarray, "2 3"], cube: float
) -> TetLattice:
    """Kuhn tetrahedra of all cubes that the zero level may meet.

    Args:
        field: what to find the level of.
        bounds: box to search [mm].
        cube: edge of the cubes at most [mm].
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
    while True:
        edge = size * 2 ** (levels - level)
        values, _ = field(_placed(origin + edge * (cubes + 0.5)))
        cubes = cubes[np.abs(values) <= np.sqrt(3) / 2 * edge]
        if level == levels or not len(cubes):
            break
        octants = np.array(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij")).reshape(3, 8).T
        cubes = (2 * cubes[:, None] + octants).reshape(-1, 3)
        level += 1
    return _kuhn(field, origin, size, cubes)


def bisected(mesh: TetLattice, chosen: Bool[np.ndarray, " cells"]) -> TetLattice:
    """The lattice after bisecting the chosen tetrahedra, and others until all meet face to face."""
    made = _Middles(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
    is_end = np.zeros(len(mesh.lattice), dtype=bool)
    while chosen.any():
        row = np.flatnonzero(chosen)
        is_end[mesh.tets[row, 0]] = True
        is_end[mesh.tets[row, mesh.tags[row]]] = True
        mesh, made = _bisected_once(mesh, row, made)
        is_end = np.concatenate([is_end, np.zeros(len(mesh.lattice) - len(is_end), dtype=bool)])
        chosen = _hanging(mesh, made, is_end)
    return mesh


@dataclass(frozen=True, eq=False)
class _Middles:
    """Vertices put into the middle of edges since the tetrahedra last met face to face.

    Attributes:
        keys: of their lattice coordinates, sorted.
        numbers: which vertices they are.
    """

    keys: Int[np.ndarray, " n"]
    numbers: Int[np.ndarray, " n"]

    def find(self, keys: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
        """The vertices with these keys; -1 where there is none."""
        if not len(self.keys):
            return np.full(len(keys), -1)
        place = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        return np.where(self.keys[place] == keys, self.numbers[place], -1)

    def with_more(self, keys: Int[np.ndarray, " m"], numbers: Int[np.ndarray, " m"]) -> "_Middles":
        """With further vertices."""
        keys, numbers = np.concatenate([self.keys, keys]), np.concatenate([self.numbers, numbers])
        order = np.argsort(keys, kind="stable")
        return _Middles(keys[order], numbers[order])


def _near_level(mesh: TetLattice, tets: Int[np.ndarray, "cells 4"]) -> Bool[np.ndarray, " cells"]:
    """Which tetrahedra the zero level may meet."""
    corners = mesh.lattice[tets]
    edges = corners[:, EDGES[:, 0]] - corners[:, EDGES[:, 1]]
    longest = mesh.step * np.sqrt((edges**2).sum(axis=2).max(axis=1))
    return np.abs(mesh.values[tets]).max(axis=1) <= longest


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
    points = _placed(origin + step * lattice)
    values, gradients = field(points)
    tags, settled = np.full(len(tets), 3), np.zeros(len(tets), dtype=bool)
    mesh = TetLattice(field, origin, step, lattice, points, values, gradients, tets, tags, settled)
    return mesh.only(_near_level(mesh, tets))


def _bisected_once(
    mesh: TetLattice, row: Int[np.ndarray, " n"], made: _Middles
) -> tuple[TetLattice, _Middles]:
    """Bisects each chosen tetrahedron once; children that the level cannot meet are left out."""
    tets, tags = mesh.tets[row], mesh.tags[row]
    each = np.arange(len(tets))
    pairs = np.stack([tets[:, 0], tets[each, tags]])
    keys, first, inverse = np.unique(
        _keys(mesh.lattice[pairs].sum(axis=0) // 2), return_index=True, return_inverse=True
    )
    # The tetrahedra met face to face before: no older vertex is the middle of an edge of theirs.
    number = made.find(keys)
    fresh = np.flatnonzero(number < 0)
    # In the order of the tetrahedra: points near each other stay near each other in memory.
    fresh = fresh[np.argsort(first[fresh])]
    number[fresh] = len(mesh.lattice) + np.arange(len(fresh))
    mesh = _with_vertices(mesh, _unkeyed(keys[fresh]), pairs[:, first[fresh]])
    middle = number[inverse.reshape(-1)]
    left, right = tets.copy(), tets.copy()
    left[each, tags] = middle
    for k in range(3):
        # (x1 ... x_tag, z, x_tag+1 ...): corners up to the tag move one place down.
        right[:, k] = np.where(k < tags, tets[:, k + 1], right[:, k])
    right[each, tags] = middle
    children = np.stack([left, right], axis=1).reshape(-1, 4)
    near = _near_level(mesh, children)
    kept = np.ones(len(mesh.tets), dtype=bool)
    kept[row] = False
    next_tags = np.repeat(np.where(tags == 1, 3, tags - 1), 2)
    refined = replace(
        mesh,
        tets=np.concatenate([mesh.tets[kept], children[near]]),
        tags=np.concatenate([mesh.tags[kept], next_tags[near]]),
        settled=np.concatenate([mesh.settled[kept], np.zeros(int(near.sum()), dtype=bool)]),
    )
    return refined, made.with_more(keys[fresh], number[fresh])


def _with_vertices(
    mesh: TetLattice, lattice: Int[np.ndarray, "n 3"], pairs: Int[np.ndarray, "2 n"]
) -> TetLattice:
    """With further vertices, each in the middle between two others."""
    points = _placed(mesh.origin + mesh.step * lattice)
    lowest = np.argmin(mesh.values[pairs], axis=0)
    values, gradients = mesh.beside(points, pairs[lowest, np.arange(len(lowest))])
    return replace(
        mesh,
        lattice=np.concatenate([mesh.lattice, lattice]),
        points=np.concatenate([mesh.points, points]),
        values=np.concatenate([mesh.values, values]),
        gradients=np.concatenate([mesh.gradients, gradients]),
    )


def _hanging(
    mesh: TetLattice, made: _Middles, is_end: Bool[np.ndarray, " nodes"]
) -> Bool[np.ndarray, " cells"]:
    """Tetrahedra with a vertex in the middle of an edge.

    Args:
        mesh: the lattice.
        made: the vertices put into the middle of edges.
        is_end: the vertices at the ends of those edges.
    """
    # Four flags in one word: two or more are set when clearing the lowest leaves something.
    flags = is_end[mesh.tets].view(np.uint32).reshape(-1)
    near = np.flatnonzero(flags & (flags - np.uint32(1)))
    corners = mesh.lattice[mesh.tets[near]]
    hit = np.zeros(len(near), dtype=bool)
    for a, b in EDGES:
        total = corners[:, a] + corners[:, b]
        even = np.flatnonzero(~(total & 1).any(axis=1))
        hit[even] |= made.find(_keys(total[even] // 2)) >= 0
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
