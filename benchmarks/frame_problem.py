"""The structures of `benchmarks/frame.py`: lattices alone, with a skin, and shells."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from linear_solve import frame
from scipy.spatial import KDTree

from fea.couplings import Tie
from fea.frame import FrameProblem
from fea.sections import Round
from fea.skin import Skin

# Edge of a unit cell, and of the shells [mm]; material of struts and skins [MPa].
CELL, SHELL = 10.0, 100.0
E, NU = 70_000.0, 0.3

# Squares of two triangles along a unit cell on the skin of a lattice, and thickness of skins and shells
# over the edge of a square.
SQUARES, THINNESS = 3, 0.05

# Triangles near a joint among which that which holds it is looked for.
NEAR = 12


@dataclass(frozen=True)
class Lattice:
    """A cube of unit cells, clamped below, loaded above.

    Attributes:
        cell: unit cell.
        cells: along an edge.
        radius: of the struts over the cell's edge.
        skinned: whether its six faces have a skin, to which the joints on them are tied; supports and
            loads then act on the skin.
    """

    cell: str
    cells: int
    radius: float
    skinned: bool = False

    def problem(self) -> FrameProblem:
        """The frame."""
        bare = frame(self.cell, self.cells, self.radius)
        return with_skin(bare, CELL * self.cells, SQUARES * self.cells) if self.skinned else bare


@dataclass(frozen=True)
class Sheet:
    """A square shell, clamped along one edge, loaded across.

    Attributes:
        squares: of two triangles each, along an edge.
        rise: of a sine over its edge; 0 for a plate.
    """

    squares: int
    rise: float = 0.0

    def problem(self) -> FrameProblem:
        """The shell, a frame without struts."""
        points, triangles = _grid(self.squares)
        along = points[:, 0] / self.squares
        x = np.column_stack([along, points[:, 1] / self.squares, self.rise * np.sin(np.pi * along)])
        forces = np.zeros((1, len(x), 6))
        forces[..., 2] = -1.0
        fixed = np.repeat(points[:, :1] == 0, 6, axis=1)
        return FrameProblem(
            joints=SHELL * x,
            struts=np.zeros((0, 2), dtype=np.int64),
            radii=np.zeros((0, 2)),
            E=E,
            nu=NU,
            section=Round(),
            fixed=fixed,
            value=np.zeros(fixed.shape),
            forces=forces,
            skin=_skin(triangles, THINNESS * SHELL / self.squares),
        )


def varied(problem: FrameProblem) -> FrameProblem:
    """Radii, or the thickness of a shell, changed at random by up to 5 %."""
    name = "radii" if len(problem.struts) else "thickness"
    old = problem.parameters[name]
    factor = np.random.default_rng(0).uniform(0.95, 1.05, len(old))
    return problem.with_parameters({name: (old.T * factor).T})


def with_skin(bare: FrameProblem, size: float, squares: int) -> FrameProblem:
    """A cube's frame in a skin: supports and loads below and above act on that."""
    points, triangles = _cube(squares)
    points = points * (size / squares)
    near = 1e-6 * size
    on = np.flatnonzero(((bare.joints < near) | (bare.joints > size - near)).any(axis=1))
    corners, shape = _places(bare.joints[on], points, triangles)
    first = len(bare.joints)
    joints = np.concatenate([bare.joints, points])
    fixed = np.zeros((len(joints), 6), dtype=bool)
    fixed[first:][points[:, 2] < near] = True
    forces = np.zeros((1, len(joints), 6))
    forces[0, first:, :3][points[:, 2] > size - near] = [1.0, 0.0, -1.0]
    return replace(
        bare,
        joints=joints,
        fixed=fixed,
        value=np.zeros(fixed.shape),
        forces=forces,
        skin=_skin(triangles + first, THINNESS * size / squares),
        couplings=(Tie(on, corners + first, shape),),
    )


def _skin(triangles: np.ndarray, thickness: float) -> Skin:
    return Skin(triangles, np.full(len(triangles), thickness), E, NU)


def _grid(squares: int) -> tuple[np.ndarray, np.ndarray]:
    """Whole-numbered points of a square and its triangles, diagonals in turn."""
    i, j = np.meshgrid(np.arange(squares + 1), np.arange(squares + 1), indexing="ij")
    number = i * (squares + 1) + j
    a, b = number[:-1, :-1], number[1:, :-1]
    c, d = number[1:, 1:], number[:-1, 1:]
    even = ((i + j)[:-1, :-1, None] % 2) == 0
    one = np.where(even, np.stack([a, b, c], axis=-1), np.stack([a, b, d], axis=-1))
    other = np.where(even, np.stack([a, c, d], axis=-1), np.stack([b, c, d], axis=-1))
    triangles = np.concatenate([one.reshape(-1, 3), other.reshape(-1, 3)])
    return np.column_stack([i.ravel(), j.ravel()]), triangles


def _cube(squares: int) -> tuple[np.ndarray, np.ndarray]:
    """Whole-numbered points on the surface of a cube, and its triangles."""
    flat, triangles = _grid(squares)
    faces = [np.insert(flat, axis, side, axis=1) for axis, side in product(range(3), (0, squares))]
    points, number = np.unique(np.concatenate(faces), axis=0, return_inverse=True)
    offsets = len(flat) * np.arange(len(faces))
    return points, number.ravel()[(triangles[None] + offsets[:, None, None]).reshape(-1, 3)]


def _places(
    points: np.ndarray, nodes: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the triangle on which each point lies, and their shape functions there."""
    corners = nodes[triangles]
    _, near = KDTree(corners.mean(axis=1)).query(points, k=NEAR)
    x = corners[near]  # point, triangle, corner, axis
    edges = np.moveaxis(x[:, :, 1:] - x[:, :, :1], 2, 3)
    arm = points[:, None] - x[:, :, 0]
    two = np.einsum("ptij,ptj->pti", np.linalg.pinv(edges), arm)
    off = np.linalg.norm(np.einsum("ptij,ptj->pti", edges, two) - arm, axis=2)
    shape = np.concatenate([1 - two.sum(axis=2, keepdims=True), two], axis=2)
    # Inside, and in the plane.
    best = np.argmax(shape.min(axis=2) - off, axis=1)
    every = np.arange(len(points))
    return triangles[near[every, best]], shape[every, best]


PROBLEMS: dict[str, Lattice | Sheet] = {
    "octet-12": Lattice("octet", 12, 0.05),
    "octet-16": Lattice("octet", 16, 0.05),
    "octet-24": Lattice("octet", 24, 0.05),
    "octet-34": Lattice("octet", 34, 0.05),
    "bcc-24-slender": Lattice("bcc", 24, 0.01),
    "octet-12-skinned": Lattice("octet", 12, 0.05, skinned=True),
    "plate-40": Sheet(40),
    "plate-100": Sheet(100),
    "shell-40": Sheet(40, rise=0.3),
    "bcc-4": Lattice("bcc", 4, 0.05),
}
