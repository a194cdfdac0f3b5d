"""Meshes of curved parts: a box whose nodes, mid-edge nodes included, are moved by a smooth map."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Int

from fea import Support, TetMesh
from fea.elements import TETRAHEDRON_EDGES

# Rounding of node positions, relative to parts of size 1 to 50.
ON = 1e-9

Positions = Float[np.ndarray, "nodes 3"]
Map = Callable[..., Positions]


def mapped(
    cells: tuple[int, int, int], function: Map, *, element: str = "tet10", curved: bool = True
) -> TetMesh:
    """The unit box moved by x, y, z -> positions.

    Args:
        cells: hexahedra along each axis.
        function: from the coordinates of all nodes to their positions.
        element: "tet4" or "tet10".
        curved: whether mid-edge nodes are moved by the map too, onto the curve; otherwise they stay
            in the middle of straight edges.
    """
    mesh = TetMesh.box((1.0, 1.0, 1.0), cells)
    if element == "tet10" and curved:
        mesh = mesh.to_tet10()
    mesh = TetMesh(function(*mesh.nodes.T), mesh.tets)
    return mesh.to_tet10() if element == "tet10" else mesh


def welded(meshes: list[TetMesh]) -> TetMesh:
    """One mesh of several whose common faces have the same nodes."""
    nodes = np.concatenate([mesh.nodes for mesh in meshes])
    start = np.cumsum([0, *[len(mesh.nodes) for mesh in meshes]])
    tets = np.concatenate([m.tets + s for m, s in zip(meshes, start[:-1], strict=True)])
    # Adding 0 turns -0 into 0.
    _, first, number = np.unique(
        np.round(nodes / ON) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    return TetMesh(nodes[first], number.ravel()[tets])


def facets_on(
    mesh: TetMesh, test: Callable[[Positions], Bool[np.ndarray, " nodes"]]
) -> Int[np.ndarray, "facets corners"]:
    """Boundary facets all of whose nodes pass a test of their positions."""
    return mesh.boundary_facets[test(mesh.nodes)[mesh.boundary_facets].all(axis=1)]


def slide(axis: int, where: Bool[np.ndarray, " nodes"]) -> Support:
    """No displacement along an axis at chosen nodes: a symmetry plane."""
    return Support(np.flatnonzero(where), np.eye(3, dtype=bool)[axis], np.zeros(3))


def field_support(nodes: Int[np.ndarray, " nodes"], u: Float[np.ndarray, "nodes 3"]) -> Support:
    """All three displacements given, one row a node."""
    return Support(nodes, np.ones(3, dtype=bool), u)


def eye_bar(element: str) -> TetMesh:
    """A bar of 60 x 20 x 10 mm with a hole of radius 5 mm through (20, 10), edges on its circle.

    Around the hole a square of side 10 mm is left out of a regular mesh, and squares around it are
    rounded, fully at the hole and not at all at twice its size. Inner edges are straight.
    """
    centre, hole = np.array([20.0, 10.0]), 5.0
    box = TetMesh.box((60.0, 20.0, 10.0), (24, 8, 2))
    middle = box.nodes[box.tets].mean(axis=1)[:, :2] - centre
    used, tets = np.unique(box.tets[np.abs(middle).max(axis=1) > hole], return_inverse=True)
    nodes = box.nodes[used]
    p = nodes[:, :2] - centre
    size = np.abs(p).max(axis=1, keepdims=True)
    share = np.clip(2 - size / hole, 0, 1)
    circle = p * size / np.linalg.norm(p, axis=1, keepdims=True)
    nodes[:, :2] = centre + (1 - share) * p + share * circle
    mesh = TetMesh(nodes, tets.reshape(-1, 4))
    if element == "tet4":
        return mesh
    mesh = mesh.to_tet10()
    ends = np.linalg.norm(mesh.nodes[mesh.tets[:, TETRAHEDRON_EDGES]][..., :2] - centre, axis=-1)
    on_circle = np.unique(mesh.tets[:, 4:][(np.abs(ends - hole) < ON).all(axis=-1)])
    nodes = mesh.nodes.copy()
    p = nodes[on_circle, :2] - centre
    nodes[on_circle, :2] = centre + hole * p / np.linalg.norm(p, axis=1, keepdims=True)
    return TetMesh(nodes, mesh.tets)
