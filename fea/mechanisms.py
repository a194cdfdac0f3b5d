"""What can move without resistance: the bodies of a mesh and the motions their supports leave.

Cells that share a face move as one: three corners that are not in line hold six motions. So a
solid without energy is a set of rigid bodies, and bodies that share nodes or edges only are
hinged there. Whether supports and hinges hold them all is a small linear system, six unknowns a
body, that is solved before any stiffness is computed.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import eigsh
from scipy.spatial import KDTree

from fea.errors import FeaError
from fea.rigid_motion import extent_of, free_motion, motion_in_words, null_space, rigid_modes
from fea.tet_mesh import TetMesh

# Unknowns up to which the null space comes from dense singular values: a second for 150 bodies.
DENSE = 900

# Rows that are condensed at once, which bounds memory: 60 MB with the most unknowns.
ROWS_AT_ONCE = 8192

# Where bodies are many, squares of singular values are compared; below this they are rounding.
HELD_SQUARED = 1e-12

# Free motions that are looked for where bodies are many; one is enough to say so.
MOTIONS = 6

# A body whose motion is a smaller share of the largest is at rest; of two bodies, the same.
AT_REST = 1e-6

# Nodes that move less than this share of the largest displacement are not what a mode is about.
MOVES = 0.01

# A mode that a rigid motion misses by more than this is not called one.
RIGID = 0.05

# Offset of a centre, as a share of the whole's size, from which it counts as on one side.
ASIDE = 0.05

# Share of a mode, found with the solver's rounding, that counts as nothing when it is described.
ROUGH = 0.02

# Nodes closer than this share of the mesh's size were meant to be one.
MERGE = 1e-9

# Words for a place by the axis along which it is away from the middle.
SIDES = (("left", "right"), ("front", "back"), ("lower", "upper"))


@dataclass(frozen=True, eq=False)
class Bodies:
    """The face-connected bodies of a mesh and where they meet.

    Attributes:
        of_cell: body of each cell.
        of_node: one body of each node.
        shared: nodes that belong to a further body too, one a body.
        other: that body.
        centre: of each body [mm].
        extent: largest distance of a body's nodes from its centre along an axis [mm].
    """

    of_cell: Int[np.ndarray, " cells"]
    of_node: Int[np.ndarray, " nodes"]
    shared: Int[np.ndarray, " shared"]
    other: Int[np.ndarray, " shared"]
    centre: Float[np.ndarray, "bodies 3"]
    extent: Float[np.ndarray, " bodies"]

    @classmethod
    def of_mesh(cls, mesh: TetMesh) -> "Bodies":
        """Find the bodies; every node must belong to a cell."""
        cells, (a, b) = len(mesh.tets), mesh.face_neighbours.T
        graph = csr_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(cells, cells))
        count, of_cell = connected_components(graph, directed=False)
        of_cell = of_cell.astype(np.int64)
        of_node = np.zeros(len(mesh.nodes), dtype=np.int64)
        of_node[mesh.tets] = of_cell[:, None]
        cell, corner = np.nonzero(of_node[mesh.tets] != of_cell[:, None])
        pairs = np.unique(mesh.tets[cell, corner].astype(np.int64) * count + of_cell[cell])
        shared, other = np.divmod(pairs, count)
        number, node = (
            np.concatenate([of_node, other]),
            np.concatenate([np.arange(len(of_node)), shared]),
        )
        size = np.bincount(number, minlength=count)
        centre = np.stack(
            [np.bincount(number, x[node], minlength=count) / size for x in mesh.nodes.T], axis=1
        )
        extent = np.zeros(count)
        np.maximum.at(extent, number, np.abs(mesh.nodes[node] - centre[number]).max(axis=1))
        return cls(of_cell, of_node, shared, other, centre, extent)

    @property
    def count(self) -> int:
        """Number of bodies."""
        return len(self.extent)

    def parts(self) -> Int[np.ndarray, " bodies"]:
        """Number of the part that each body belongs to: bodies that share nodes are one part."""
        a, b = self.of_node[self.shared], self.other
        graph = csr_array((np.ones(len(a), dtype=np.int8), (a, b)), (self.count, self.count))
        return connected_components(graph, directed=False)[1].astype(np.int64)

    def constraints(self, mesh: TetMesh, fixed: Bool[np.ndarray, "nodes 3"]) -> csr_array:
        """Rows that a motion of all bodies, six unknowns each, must take to zero.

        Shared nodes move alike in both bodies, and fixed dofs do not move. Unknowns are those of
        `rigid_modes` about each body's own centre, so that entries are of order one.
        """
        node, axis = np.nonzero(fixed)
        held = self._modes(mesh, node, self.of_node[node])[np.arange(len(node)), axis]
        one = self._modes(mesh, self.shared, self.of_node[self.shared]).reshape(-1, 6)
        two = self._modes(mesh, self.shared, self.other).reshape(-1, 6)
        joints = np.arange(len(one)) + len(held)
        blocks = [
            (np.arange(len(held)), self.of_node[node], held),
            (joints, np.repeat(self.of_node[self.shared], 3), one),
            (joints, np.repeat(self.other, 3), -two),
        ]
        row = np.concatenate([np.repeat(r, 6) for r, _, _ in blocks])
        column = np.concatenate([(6 * b[:, None] + np.arange(6)).ravel() for _, b, _ in blocks])
        values = np.concatenate([v.ravel() for _, _, v in blocks])
        return csr_array((values, (row, column)), (len(held) + len(one), 6 * self.count))

    def _modes(
        self, mesh: TetMesh, node: Int[np.ndarray, " points"], body: Int[np.ndarray, " points"]
    ) -> Float[np.ndarray, "points 3 6"]:
        return rigid_modes(mesh.nodes[node], self.centre[body], self.extent[body])


def free_body(mesh: TetMesh, fixed: Bool[np.ndarray, "nodes 3"]) -> str | None:
    """Name a part of a solid that its supports do not hold, and how it can move.

    Exact for any mesh of sound cells, whatever its material: None means that the stiffness without
    the fixed dofs is positive definite.

    Args:
        mesh: sound cells; see `TetMesh.check`.
        fixed: which displacements are prescribed.

    Returns:
        A sentence without its end, such as "the left one of 2 separate parts (x 0 to 10, y 0 to 4,
        z 0 to 6 mm, 120 cells) can slide along x"; None when everything is held.
    """
    bodies = Bodies.of_mesh(mesh)
    part = bodies.parts()
    part_of_node = part[bodies.of_node]
    free = _free_parts(mesh, fixed, part_of_node)
    if len(free) == 0:
        return None if bodies.count == 1 else _hinged(mesh, bodies, part, fixed)
    count = int(part.max()) + 1
    cells = np.bincount(part[bodies.of_cell], minlength=count)
    largest = int(free[np.argmax(cells[free])])
    inside = part_of_node == largest
    motion = free_motion(mesh.nodes[inside], fixed[inside], base_form=True)
    if count == 1:
        return f"the solid can {motion}"
    side, box = _place(mesh, part[bodies.of_cell] == largest)
    gap = _gap(mesh, inside)
    if len(free) == 1:
        return f"the {side} one of {count} separate parts {box} can {motion}{gap}"
    return (
        f"{len(free)} of {count} separate parts can move; the largest of them, the {side} one "
        f"{box}, can {motion}{gap}"
    )


def describe_mode(points: Float[np.ndarray, "n 3"], mode: Float[np.ndarray, "n 3"]) -> str:
    """Say in words what moves in a null vector that a solver found, and how.

    Args:
        points: positions of all nodes or joints [mm].
        mode: their displacements, of any size.

    Returns:
        A sentence without its end, such as "12 of 36 nodes, in the left part (x 0 to 10, y 0 to 4, z 0
        to 6 mm), slide along x".

    Raises:
        FeaError: when nothing moves, or displacements are not numbers.
    """
    size = np.linalg.norm(mode, axis=1)
    top = size.max(initial=0.0)
    if not (np.isfinite(top) and top > 0):
        raise FeaError(f"The mode's largest displacement is {top:g}; give a null vector of K.")
    moving = size > MOVES * top
    x, u = points[moving], mode[moving] / top
    centre = x.mean(axis=0)
    extent = extent_of(x, centre)
    modes = rigid_modes(x, centre, extent).reshape(-1, 6)
    # The smallest of equal fits, where what moves is a point or a line.
    fit = np.linalg.lstsq(modes, u.ravel(), rcond=None)[0]
    miss = np.linalg.norm(modes @ fit - u.ravel()) / np.linalg.norm(u)
    what = f"all {len(points)} nodes"
    if not moving.all():
        side, box = _side(x, points), _box(x)
        what = f"{len(x)} of {len(points)} nodes, in the {side} part ({box} mm),"
    if miss > RIGID:
        most = ", ".join(f"{c:.4g}" for c in points[np.argmax(size)])
        return f"{what} deform without resistance, most at ({most})"
    motion = motion_in_words(
        fit[:, None], centre=centre, extent=extent, tolerance=ROUGH, base_form=True
    )
    return f"{what} {motion}"


def _free_parts(
    mesh: TetMesh, fixed: Bool[np.ndarray, "nodes 3"], part_of_node: Int[np.ndarray, " nodes"]
) -> Int[np.ndarray, " free"]:
    """Parts that can move as a whole."""
    count = int(part_of_node.max()) + 1
    free = np.bincount(part_of_node, fixed.sum(axis=1), minlength=count) < 6
    order = np.argsort(part_of_node, kind="stable")
    start = np.searchsorted(part_of_node[order], np.arange(count + 1))
    for number in np.flatnonzero(~free):
        nodes = order[start[number] : start[number + 1]]
        free[number] = free_motion(mesh.nodes[nodes], fixed[nodes]) is not None
    return np.flatnonzero(free)


def _hinged(
    mesh: TetMesh,
    bodies: Bodies,
    part: Int[np.ndarray, " bodies"],
    fixed: Bool[np.ndarray, "nodes 3"],
) -> str | None:
    """What can move on the hinges of parts that are each held as a whole."""
    A = bodies.constraints(mesh, fixed)
    row_part = part[A.indices[A.indptr[:-1]] // 6]
    for number in np.flatnonzero(np.bincount(part) > 1):
        (members,) = np.nonzero(part == number)
        columns = (6 * members[:, None] + np.arange(6)).ravel()
        (rows,) = np.nonzero(row_part == number)
        motions = _null_motions(csr_array(A[np.ix_(rows, columns)]), len(columns))
        if motions.shape[1]:
            return _swinging(mesh, bodies, members, motions.reshape(len(members), 6, -1))
    return None


def _null_motions(A: csr_array, n: int) -> Float[np.ndarray, "n free"]:
    if n <= DENSE:
        R, count = np.zeros((0, n)), len(A.indptr) - 1
        for first in range(0, count, ROWS_AT_ONCE):
            chosen = np.arange(first, min(first + ROWS_AT_ONCE, count))
            rows = np.vstack([R, csr_array(A[chosen]).toarray()])
            R = np.asarray(np.linalg.qr(rows, mode="r")) if len(rows) > n else rows
        return null_space(R)
    # Shifted off zero the matrix is positive definite; a fixed start makes runs repeatable.
    start = np.random.default_rng(0).standard_normal(n)
    squared, motions = eigsh((A.T @ A).tocsc(), k=MOTIONS, sigma=-HELD_SQUARED, v0=start)
    return motions[:, squared < HELD_SQUARED]


def _swinging(
    mesh: TetMesh,
    bodies: Bodies,
    members: Int[np.ndarray, " bodies"],
    motions: Float[np.ndarray, "bodies 6 free"],
) -> str:
    """Name the largest group of bodies that move as one on their hinges."""
    centre, extent = mesh.nodes.mean(axis=0), extent_of(mesh.nodes, mesh.nodes.mean(axis=0))
    # Of all bodies about one point, so that those that move as one are seen to.
    common = np.zeros((bodies.count, 6, motions.shape[2]))
    common[members] = _recentred(
        motions, bodies.centre[members], bodies.extent[members], centre, extent
    )
    size = np.linalg.norm(common, axis=(1, 2))
    a, b = bodies.of_node[bodies.shared], bodies.other
    difference = np.linalg.norm(common[a] - common[b], axis=(1, 2))
    alike = difference <= AT_REST * np.maximum(size[a], size[b])
    graph = csr_array((np.ones(int(alike.sum())), (a[alike], b[alike])), (bodies.count,) * 2)
    group = connected_components(graph, directed=False)[1]
    cells = np.bincount(bodies.of_cell, minlength=bodies.count)
    weight = np.bincount(group, cells * (size > AT_REST * size.max()))
    swings = group == int(np.argmax(weight))
    inside = np.isin(np.arange(len(mesh.nodes)), mesh.tets[swings[bodies.of_cell]])
    own = mesh.nodes[inside].mean(axis=0)
    own_extent = extent_of(mesh.nodes[inside], own)
    moved = _recentred(common[swings][:1], centre[None], np.array([extent]), own, own_extent)[0]
    words = motion_in_words(moved, centre=own, extent=own_extent, base_form=True)
    side, box = _place(mesh, swings[bodies.of_cell])
    hinges = np.unique(bodies.shared[swings[a] != swings[b]])
    nodes = "1 node" if len(hinges) == 1 else f"{len(hinges)} nodes"
    return f"the {side} part {box}, which shares only {nodes} with the rest, can {words}"


def _recentred(
    motions: Float[np.ndarray, "bodies 6 free"],
    old: Float[np.ndarray, "bodies 3"],
    old_extent: Float[np.ndarray, " bodies"],
    new: Float[np.ndarray, " 3"],
    extent: float,
) -> Float[np.ndarray, "bodies 6 free"]:
    """The same motions as displacement of another point and rotation times another extent."""
    turn = motions[:, 3:] / old_extent[:, None, None]
    there = motions[:, :3] + np.cross(turn, (new - old)[:, :, None], axis=1)
    return np.concatenate([there, turn * extent], axis=1)


def _place(mesh: TetMesh, of_part: Bool[np.ndarray, " cells"]) -> tuple[str, str]:
    """The side of the mesh that some cells are on, and their box and number."""
    points = mesh.nodes[np.unique(mesh.tets[of_part])]
    cells = int(np.count_nonzero(of_part))
    number = "1 cell" if cells == 1 else f"{cells} cells"
    return _side(points, mesh.nodes), f"({_box(points)} mm, {number})"


def _side(points: Float[np.ndarray, "some 3"], whole: Float[np.ndarray, "n 3"]) -> str:
    low, high = whole.min(axis=0), whole.max(axis=0)
    away = (points.min(axis=0) + points.max(axis=0) - low - high) / 2
    axis = int(np.argmax(np.abs(away)))
    if abs(away[axis]) < ASIDE * float((high - low).max()):
        return "middle"
    return SIDES[axis][int(away[axis] > 0)]


def _box(points: Float[np.ndarray, "some 3"]) -> str:
    low, high = points.min(axis=0), points.max(axis=0)
    return ", ".join(
        f"{axis} {a:.4g} to {b:.4g}" for axis, a, b in zip("xyz", low, high, strict=True)
    )


def _gap(mesh: TetMesh, inside: Bool[np.ndarray, " nodes"]) -> str:
    """A remark on nodes that coincide with nodes of another part, the usual reason for two."""
    near = MERGE * float(np.ptp(mesh.nodes, axis=0).max())
    distance, _ = KDTree(mesh.nodes[~inside]).query(mesh.nodes[inside], distance_upper_bound=near)
    count = int(np.count_nonzero(np.isfinite(distance)))
    if count == 0:
        return ""
    return f" ({count} of its nodes coincide with nodes of other parts: merge them to join these)"
