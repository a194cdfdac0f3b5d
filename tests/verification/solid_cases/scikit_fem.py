"""The same mesh in scikit-fem: stiffness and displacement to rounding."""

from functools import cache

import numpy as np
import skfem
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree
from skfem.models.elasticity import lame_parameters, linear_elasticity
from solid_cases.mapped_mesh import ON, eye_bar
from target import Benchmark, Measured, Target

from fea import Material, SolidProblem, Support, TetMesh, force_on_facets, solve_solid
from fea.elements import TETRAHEDRON_EDGES

MATERIAL = Material(E=210e3, nu=0.3, density=0.0)
# Shape of the mesh's inner nodes.
SEED = 3


def distorted(element: str) -> TetMesh:
    """A box mesh whose inner nodes are moved, so that no two cells are alike."""
    mesh = TetMesh.box((3.0, 2.0, 1.0), (4, 3, 2))
    inner = np.setdiff1d(np.arange(len(mesh.nodes)), np.unique(mesh.boundary_facets))
    nodes = mesh.nodes.copy()
    nodes[inner] += np.random.default_rng(SEED).uniform(-0.1, 0.1, (len(inner), 3))
    mesh = TetMesh(nodes, mesh.tets)
    return mesh if element == "tet4" else mesh.to_tet10()


def their_stiffness(mesh: TetMesh) -> csr_matrix:
    """scikit-fem's stiffness with vector P1 or P2, in this project's dof order."""
    corners = np.unique(mesh.tets[:, :4])
    number = np.full(len(mesh.nodes), -1)
    number[corners] = np.arange(len(corners))
    theirs = skfem.MeshTet(mesh.nodes[corners].T.copy(), number[mesh.tets[:, :4]].T.copy())
    scalar = skfem.ElementTetP1()
    where = theirs.p.T
    if mesh.element == "tet10":
        theirs, scalar = skfem.MeshTet2.from_mesh(theirs), skfem.ElementTetP2()
        where = theirs.doflocs.T
    # Their mid-edge nodes lie on straight edges, where ours are found before they are moved.
    straight = mesh.nodes.copy()
    if mesh.element == "tet10":
        straight[mesh.tets[:, 4:]] = mesh.nodes[mesh.tets[:, TETRAHEDRON_EDGES]].mean(axis=2)
    distance, node = cKDTree(where).query(straight)
    if distance.max() > ON:
        raise ValueError("scikit-fem's nodes are not this mesh's.")
    if mesh.element == "tet10":
        moved = np.zeros_like(theirs.doflocs)
        moved[:, node] = mesh.nodes.T
        theirs = skfem.MeshTet2(moved, theirs.t)
    # Order 2 integrates the product of two linear strains exactly, and has four points as ours has.
    basis = skfem.Basis(theirs, skfem.ElementVector(scalar), intorder=2)
    A = linear_elasticity(*lame_parameters(MATERIAL.E, MATERIAL.nu)).assemble(basis).tocsr()
    # Corner nodes, then mid-edge nodes; components run fastest.
    dofs = (3 * node[:, None] + np.arange(3)).ravel()
    return A[dofs][:, dofs]


MESHES = {
    "P1": lambda: distorted("tet4"),
    "P2": lambda: distorted("tet10"),
    "curved P2": lambda: eye_bar("tet10"),
}


@cache
def same_mesh(name: str, nu: float = MATERIAL.nu) -> dict[str, Measured]:
    """Largest differences, relative to the largest stiffness and displacement."""
    mesh = MESHES[name]()
    clamp = Support.clamp(np.flatnonzero(mesh.nodes[:, 0] < ON))
    length = mesh.nodes[:, 0].max()
    end = mesh.facets_where(lambda x: x[:, 0] > length - ON)
    forces = force_on_facets(mesh, end, np.array([10.0, -20.0, 30.0]))
    material = Material(MATERIAL.E, nu, 0.0)
    solution = solve_solid(SolidProblem.from_supports(mesh, material, [clamp], forces))
    K, A = solution.system.K.tocsr(), their_stiffness(mesh)
    fixed = (3 * clamp.nodes[:, None] + np.arange(3)).ravel()
    theirs = skfem.solve(*skfem.condense(A, forces.ravel(), D=fixed)).reshape(-1, 3)
    difference = np.abs(solution.displacement[0] - theirs).max() / np.abs(theirs).max()
    return {
        "K": Measured.on(mesh, abs(K - A).max() / abs(A).max()),
        "u": Measured.on(mesh, difference),
    }


def _targets(name: str) -> list[Target]:
    return [
        Target(
            f"stiffness, difference, {name}",
            "",
            0.0,
            1e-12,
            lambda: same_mesh(name)["K"],
            "absolute",
        ),
        Target(
            f"displacement, difference, {name}",
            "",
            0.0,
            1e-9,
            lambda: same_mesh(name)["u"],
            "absolute",
        ),
    ]


BENCHMARKS = (
    Benchmark(
        "Same mesh in scikit-fem",
        "T. Gustafsson, G. D. McBain, scikit-fem, Journal of Open Source Software 5 (2020) 2369.",
        "P1 and P2: a box of 3 x 2 x 1 mm with displaced inner nodes. Curved P2: a bar with an eye, "
        "edges on its circle. One end clamped, a force on the other. Largest difference, relative to "
        "the largest entry of scikit-fem's.",
        tuple(target for name in MESHES for target in _targets(name)),
    ),
)
