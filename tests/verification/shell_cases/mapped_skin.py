"""Structured triangulations of curved rectangles and spheres, and their solution."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from fea import FrameProblem, FrameSolution, Round, solve_frame
from fea.skin import Skin

# The dofs of a node that a plane of symmetry through it holds, by the plane's normal axis.
SYMMETRY = {
    "x": np.array([1, 0, 0, 0, 1, 1], dtype=bool),
    "y": np.array([0, 1, 0, 1, 0, 1], dtype=bool),
    "z": np.array([0, 0, 1, 1, 1, 0], dtype=bool),
}
CLAMP = np.ones(6, dtype=bool)
# A node counts as on an edge of the unit square within this distance.
ON_EDGE = 1e-9


@dataclass(frozen=True, eq=False)
class MappedSkin:
    """A triangulated surface over parameters.

    Attributes:
        points: positions of the nodes [mm].
        triangles: nodes of each triangle.
        parameters: of each node; those of a square lie between 0 and 1.
    """

    points: Float[np.ndarray, "joints 3"]
    triangles: Int[np.ndarray, "faces 3"]
    parameters: Float[np.ndarray, "joints dim"]

    def at(self, **where: float) -> Bool[np.ndarray, " joints"]:
        """Nodes with these parameters, such as s=0, t=1."""
        chosen = np.ones(len(self.points), dtype=bool)
        for name, value in where.items():
            chosen &= np.abs(self.parameters[:, "stu".index(name)] - value) < ON_EDGE
        return chosen

    def node(self, **where: float) -> int:
        """The one node with these parameters."""
        (node,) = np.flatnonzero(self.at(**where))
        return int(node)

    def held(
        self, *supports: tuple[Bool[np.ndarray, " joints"], Bool[np.ndarray, " 6"]]
    ) -> Bool[np.ndarray, "joints 6"]:
        """Dofs that are zero: of each support its nodes, and which of their dofs."""
        fixed = np.zeros((len(self.points), 6), dtype=bool)
        for nodes, dofs in supports:
            fixed |= nodes[:, None] & dofs
        return fixed

    def skin(self, thickness: float, E: float, nu: float) -> Skin:
        """The surface with a uniform thickness [mm], E [MPa] and nu."""
        return Skin(self.triangles, np.full(len(self.triangles), thickness), E, nu)

    def point_forces(self, *forces: tuple[int, int, float]) -> Float[np.ndarray, "joints 6"]:
        """Forces on nodes: node, dof, value."""
        f = np.zeros((len(self.points), 6))
        for node, dof, value in forces:
            f[node, dof] += value
        return f

    def edge_force(
        self, nodes: Bool[np.ndarray, " joints"], dof: int, total: float
    ) -> Float[np.ndarray, "joints 6"]:
        """A force spread evenly over a straight edge of equally spaced nodes."""
        along = np.flatnonzero(nodes)
        along = along[np.argsort(self.parameters[along].sum(axis=1))]
        share = np.ones(len(along))
        share[[0, -1]] = 0.5
        f = np.zeros((len(self.points), 6))
        f[along, dof] = total * share / share.sum()
        return f


def mapped_square(
    divisions: tuple[int, int],
    mapping: Callable[[np.ndarray, np.ndarray], list[np.ndarray]],
    *,
    falling: bool = False,
) -> MappedSkin:
    """Two triangles for each cell of a grid on the unit square.

    Args:
        divisions: along s and t.
        mapping: from s and t to x, y, z.
        falling: whether the diagonal of each cell falls in the direction of s and t; else it rises.
    """
    n, m = divisions
    s, t = (
        axis.ravel()
        for axis in np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1), indexing="ij")
    )
    number = np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    halves = ([a, b, d], [b, c, d]) if falling else ([a, b, c], [a, c, d])
    triangles = np.concatenate([np.stack(half, axis=-1).reshape(-1, 3) for half in halves])
    points = np.stack([axis + np.zeros_like(s) for axis in mapping(s, t)], axis=1)
    return MappedSkin(points, triangles, np.stack([s, t], axis=1))


def sphere_octant(divisions: int, radius: float) -> MappedSkin:
    """The part of a sphere with x, y, z > 0, from a triangle's subdivision; parameters sum to 1."""
    n = divisions
    i, j = (axis.ravel() for axis in np.meshgrid(*[np.arange(n + 1)] * 2, indexing="ij"))
    inside = i + j <= n
    number = np.full((n + 1, n + 1), -1)
    i, j = i[inside], j[inside]
    number[i, j] = np.arange(len(i))
    flat = np.stack([i, j, n - i - j], axis=1) / n
    # Equal angles along the three edges.
    bulged = np.sin(np.pi / 2 * flat)
    points = radius * bulged / np.linalg.norm(bulged, axis=1, keepdims=True)
    up = i + j < n
    down = up & (i + j < n - 1)
    i, j = (np.concatenate([axis[up], axis[down]]) for axis in (i, j))
    first = np.arange(len(i)) < up.sum()
    corners = np.where(
        first,
        [number[i, j], number[i + 1, j], number[i, j + 1]],
        [number[i + 1, j], number[i + 1, np.minimum(j + 1, n)], number[i, j + 1]],
    )
    return MappedSkin(points, corners.T.copy(), flat)


def solve_skin(
    mesh: MappedSkin,
    skin: Skin,
    fixed: Bool[np.ndarray, "joints 6"],
    forces: Float[np.ndarray, "joints 6"],
    value: Float[np.ndarray, "joints 6"] | None = None,
) -> FrameSolution:
    """A skin without struts."""
    return solve_frame(
        FrameProblem(
            joints=mesh.points,
            struts=np.zeros((0, 2), dtype=np.int64),
            radii=np.zeros((0, 2)),
            E=skin.E,
            nu=skin.nu,
            section=Round(),
            fixed=fixed,
            value=np.zeros(fixed.shape) if value is None else value,
            forces=forces[None],
            skin=skin,
        )
    )


def whole_matrix(
    triangles: Int[np.ndarray, "faces 3"], matrices: Float[np.ndarray, "faces 18 18"], joints: int
) -> Float[np.ndarray, "dofs dofs"]:
    """The dense sum of element matrices."""
    dofs = (6 * triangles[:, :, None] + np.arange(6)).reshape(-1, 18)
    whole = np.zeros((6 * joints, 6 * joints))
    np.add.at(whole, (dofs[:, :, None], dofs[:, None, :]), np.asarray(matrices))
    return whole
