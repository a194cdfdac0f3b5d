"""The problem of `benchmarks/solid.py`: its mesh files, and how answers are judged.

A box of steel, clamped at x = 0, pulled down at x = 100 mm. `fea` is imported by the functions that need
it, so that its memory is not counted with other codes.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np

# Edges [mm], material [MPa], force on the free end [N].
SIZE = (100.0, 20.0, 20.0)
E, NU = 210e3, 0.3
FORCE = (0.0, 0.0, -500.0)

# The mesher's surface strays from the box by a thousandth of its diagonal, 0.104 mm.
ENVELOPE = 0.11

# Hexahedra of the mesh on which code is compiled before the clock starts: 11,664 tetrahedra, more
# than `fea` computes at once, so that it compiles for full batches.
WARM_UP = (24, 9, 9)


def prepare(folder: Path, fraction: float, element: str) -> dict[str, Any]:
    """Mesh the box, unless its file is there, and write the problem that all codes solve."""
    from fea import TetMesh
    from fea.ftetwild import tetrahedralise

    made = folder / f"mesh-{fraction:g}.npz"
    seconds = None
    if not made.is_file():
        start = time.perf_counter()
        box = TetMesh.box(SIZE, (1, 1, 1))
        edge = fraction * float(np.linalg.norm(SIZE))
        mesh = tetrahedralise(box.nodes, box.boundary_facets, edge=edge)
        np.savez(made, nodes=mesh.nodes, tets=mesh.tets)
        seconds = round(time.perf_counter() - start, 1)
    mesh = read_mesh(made)
    if element == "tet10":
        mesh = mesh.to_tet10()
    written = folder / f"{element}-{fraction:g}.npz"
    write_problem(written, mesh)
    small = TetMesh.box(SIZE, WARM_UP)
    write_problem(warm_up(written), small if element == "tet4" else small.to_tet10())
    return {
        "problem": written.name,
        "mesh": made.name,
        "element": element,
        "nodes": len(mesh.nodes),
        "cells": len(mesh.tets),
        "dofs": mesh.nodes.size,
        "meshing_s": seconds,
    }


def write_problem(path: Path, mesh: Any) -> None:
    """Write nodes, cells, supports and forces."""
    from fea import force_on_facets

    clamped, pulled = ends(mesh)
    fixed = np.zeros(mesh.nodes.shape, dtype=bool)
    fixed[np.unique(clamped)] = True
    forces = force_on_facets(mesh, pulled, np.array(FORCE))
    np.savez(path, nodes=mesh.nodes, tets=mesh.tets, fixed=fixed, forces=forces)


def accuracy(path: Path, u: np.ndarray) -> dict[str, float]:
    """Residual and largest displacement of an answer u [nodes, 3]."""
    problem = read_problem(path)
    K = stiffness(problem)
    return {
        "residual": residual(K, u, problem),
        "max_displacement_mm": float(np.abs(u).max()),
    }


def residual(K: Any, u: np.ndarray, problem: Any) -> float:
    """|f - K u| / |f| on free dofs."""
    free = ~problem.fixed.ravel()
    f = problem.forces[0].ravel()
    return float(np.linalg.norm((f - K @ u.ravel())[free]) / np.linalg.norm(f[free]))


def stiffness_difference(path: Path, theirs: Any, places: np.ndarray) -> float:
    """Largest difference between two stiffness matrices, relative to the largest entry.

    Args:
        path: the problem.
        theirs: their matrix.
        places: positions of their nodes, in their order.
    """
    from scipy.spatial import KDTree

    problem = read_problem(path)
    distance, node = KDTree(places).query(problem.points)
    if distance.max() > 1e-9:
        raise RuntimeError("The two codes have different nodes.")
    dofs = (3 * node[:, None] + np.arange(3)).ravel()
    ours = stiffness(problem).tocsr()
    return float(abs(theirs.tocsr()[dofs][:, dofs] - ours).max() / abs(ours).max())


def stiffness(problem: Any) -> Any:
    """K of a problem without its supports, as `fea` assembles it."""
    from fea.assembly import Pattern

    return problem.stiffness(Pattern.from_groups(problem.groups, len(problem.points)))


def read_problem(path: Path) -> Any:
    """The problem of a file, for `fea`."""
    with np.load(path) as data:
        return problem_of(data["nodes"], data["tets"], data["fixed"], data["forces"])


def warm_up(path: Path) -> Path:
    """The problem that warms a code up, in a file beside the one to measure."""
    return path.with_name(f"{path.stem.split('-')[0]}-warm-up.npz")


def problem_of(nodes: Any, tets: Any, fixed: Any, forces: Any) -> Any:
    """The problem of these arrays, for `fea`."""
    from fea.solid import SolidProblem

    modulus = np.ones((len(tets), 1))
    mesh = mesh_of(nodes, tets)
    return SolidProblem(mesh, steel(), fixed, np.zeros(nodes.shape), forces[None], modulus)


def steel() -> Any:
    """The material, for `fea`; its weight takes no part."""
    from fea import Material

    return Material(E=E, nu=NU, density=0.0)


def read_mesh(path: Path) -> Any:
    """The mesh of a file, for `fea`."""
    with np.load(path) as data:
        return mesh_of(data["nodes"], data["tets"])


def mesh_of(nodes: np.ndarray, tets: np.ndarray) -> Any:
    """The mesh of these arrays, for `fea`, which computes in float64."""
    import jax

    from fea import TetMesh

    jax.config.update("jax_enable_x64", True)
    return TetMesh(nodes, tets.astype(np.int64))


def ends(mesh: Any) -> tuple[np.ndarray, np.ndarray]:
    """Facets of the clamped and of the pulled end."""
    return (
        mesh.facets_where(lambda x: x[:, 0] < ENVELOPE),
        mesh.facets_where(lambda x: x[:, 0] > SIZE[0] - ENVELOPE),
    )
