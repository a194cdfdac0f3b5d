"""Fields that are known everywhere: constant strain, manufactured, graded modulus."""

from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.spatial import Delaunay
from solid_cases.mapped_mesh import facets_on, field_support
from target import Benchmark, Measured, Target, furthest

from fea import (
    Material,
    SolidProblem,
    Support,
    TetMesh,
    body_forces,
    solve_solid,
    traction_forces,
)
from fea.elements import TETRAHEDRA
from fea.ftetwild import tetrahedralise
from fea.isoparametric import cell_points
from fea.quadrature import TETRAHEDRON_5

Points = Float[np.ndarray, "n 3"]

# Constant strain -----------------------------------------------------------------------------

# The inner nodes of MacNeal and Harder's cube.
INNER = np.array(
    [
        [0.249, 0.342, 0.192],
        [0.826, 0.288, 0.288],
        [0.850, 0.649, 0.263],
        [0.273, 0.750, 0.230],
        [0.320, 0.186, 0.643],
        [0.677, 0.305, 0.683],
        [0.788, 0.693, 0.644],
        [0.165, 0.745, 0.702],
    ]
)
CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
PATCH_MATERIAL = Material(E=1e6, nu=0.25, density=0.0)
# Tetrahedra of the Delaunay mesh below this volume lie flat in the cube's faces.
FLAT = 1e-9
# Edge of the mesher's tetrahedra: coarse, with some nodes inside the cube all the same.
FTETWILD_EDGE = 0.3


def linear_field(x: Points) -> Points:
    """Displacement 1e-3 (2x + y + z)/2 and its cyclic companions: every strain is 1e-3."""
    return 0.5e-3 * (x + x.sum(axis=1, keepdims=True))


def macneal_harder_cube(element: str) -> TetMesh:
    """Delaunay mesh of the sixteen nodes of the three-dimensional patch."""
    nodes = np.concatenate([CORNERS, INNER])
    tets = Delaunay(nodes).simplices.astype(np.int64)
    volume = np.linalg.det(nodes[tets[:, 1:]] - nodes[tets[:, :1]]) / 6
    tets[volume < 0] = tets[volume < 0][:, [1, 0, 2, 3]]
    mesh = TetMesh(nodes, tets[np.abs(volume) > FLAT])
    return mesh if element == "tet4" else mesh.to_tet10()


@cache
def ftetwild_cube() -> TetMesh:
    """The mesher's cube: unstructured, and its boundary flat to within its envelope only."""
    x, y, z = 4, 2, 1  # numbers of the corners next to corner 0, along the axes
    faces = [(0, z, y), (x, y, z)], [(0, x, z), (y, z, x)], [(0, y, x), (z, x, y)]
    triangles = [
        triangle
        for (o, a, b), (p, c, d) in faces
        for triangle in [(o, a, a + b), (o, a + b, b), (p, p + c, 7), (p, 7, p + d)]
    ]
    return tetrahedralise(CORNERS, np.array(triangles), edge=FTETWILD_EDGE)


@cache
def patch_test(mesher: str, element: str) -> dict[str, Measured]:
    """Displacement prescribed at all boundary nodes; what is furthest off of all points."""
    if mesher == "Delaunay":
        mesh = macneal_harder_cube(element)
    else:
        mesh = ftetwild_cube() if element == "tet4" else ftetwild_cube().to_tet10()
    boundary = np.unique(mesh.boundary_facets)
    u = linear_field(mesh.nodes)
    supports = [field_support(boundary, u[boundary])]
    forces = np.zeros((1, *mesh.nodes.shape))
    solution = solve_solid(SolidProblem.from_supports(mesh, PATCH_MATERIAL, supports, forces))
    inner = np.setdiff1d(np.arange(len(u)), boundary)
    error = (solution.displacement[0] - u)[inner]
    stress = [solution.quadrature_stress.reshape(-1, 6), solution.stress.reshape(-1, 6)]
    both = np.concatenate(stress)
    values = {
        "u": np.abs(error).max() / np.abs(u).max(),
        "normal": furthest(both[:, :3], 2000.0),
        "shear": furthest(both[:, 3:], 400.0),
    }
    nodes = len(u) if mesher == "Delaunay" else None
    return {name: Measured(float(v), element, nodes) for name, v in values.items()}


def _patch_targets() -> list[Target]:
    targets = []
    for mesher in ("Delaunay", "fTetWild"):
        for element in ("tet4", "tet10"):

            def of(name: str, mesher: str = mesher, element: str = element):
                return lambda: patch_test(mesher, element)[name]

            where = f"{mesher} mesh, {element}"
            targets += [
                Target(f"displacement inside, {where}", "", 0.0, 1e-10, of("u"), "absolute"),
                Target(f"normal stress, {where}", "MPa", 2000.0, 1e-10, of("normal")),
                Target(f"shear stress, {where}", "MPa", 400.0, 1e-10, of("shear")),
            ]
    return targets


# Manufactured solution -----------------------------------------------------------------------

UNIT_MATERIAL = Material(E=1.0, nu=0.3, density=0.0)


def manufactured(p: Points) -> Points:
    """Displacement u = sin(pi x)/10, v = y² z/2, w = x log(1 + y)/5."""
    x, y, z = p.T
    return np.stack([np.sin(np.pi * x) / 10, y**2 * z / 2, x * np.log1p(y) / 5], axis=1)


def manufactured_gradient(p: Points) -> Float[np.ndarray, "n 3 3"]:
    """[n, i, j] = du_i/dx_j."""
    x, y, z = p.T
    H = np.zeros((len(p), 3, 3))
    H[:, 0, 0] = np.pi * np.cos(np.pi * x) / 10
    H[:, 1, 1], H[:, 1, 2] = y * z, y**2 / 2
    H[:, 2, 0], H[:, 2, 1] = np.log1p(y) / 5, x / (1 + y) / 5
    return H


def manufactured_force(p: Points) -> Points:
    """Force per volume -(lambda + mu) grad div u - mu laplace u, by hand from `manufactured`.

    div u = pi cos(pi x)/10 + y z, so grad div u = (-pi² sin(pi x)/10, z, y);
    laplace u = (-pi² sin(pi x)/10, z, -x/(5 (1 + y)²)).
    """
    lam, mu = UNIT_MATERIAL.lame
    x, y, z = p.T
    first = -(np.pi**2) * np.sin(np.pi * x) / 10
    grad_div = np.stack([first, z, y], axis=1)
    laplace = np.stack([first, z, -x / (5 * (1 + y) ** 2)], axis=1)
    return -(lam + mu) * grad_div - mu * laplace


@cache
def manufactured_errors(element: str, cells: int) -> tuple[float, float, int]:
    """L2 norms of the errors of displacement and of its gradient; nodes of the mesh."""
    mesh = TetMesh.box((1.0, 1.0, 1.0), (cells, cells, cells))
    mesh = mesh if element == "tet4" else mesh.to_tet10()
    boundary = np.unique(mesh.boundary_facets)
    supports = [field_support(boundary, manufactured(mesh.nodes[boundary]))]
    forces = body_forces(mesh, manufactured_force)
    solution = solve_solid(SolidProblem.from_supports(mesh, UNIT_MATERIAL, supports, forces))
    uh = solution.displacement[0][mesh.tets]
    # Degree 5: one order above the square of a quadratic element's error.
    rule, kind = TETRAHEDRON_5, TETRAHEDRA[mesh.tets.shape[1]]
    corners = mesh.nodes[mesh.tets]
    x, volume = cell_points(corners, rule)
    J = np.einsum("cnx,qnr->cqxr", corners, kind.gradient(rule.points))
    value = np.einsum("cni,qn->cqi", uh, kind.shape(rule.points))
    gradient = np.einsum("cni,qnr->cqir", uh, kind.gradient(rule.points)) @ np.linalg.inv(J)
    flat = x.reshape(-1, 3)
    e0 = value - manufactured(flat).reshape(value.shape)
    e1 = gradient - manufactured_gradient(flat).reshape(gradient.shape)
    squares = (volume * (e0**2).sum(axis=-1)).sum(), (volume * (e1**2).sum(axis=(-1, -2))).sum()
    return float(np.sqrt(squares[0])), float(np.sqrt(squares[1])), len(mesh.nodes)


def order(element: str, norm: int) -> Measured:
    """Observed order of convergence on two meshes, the second twice as fine."""
    cells = {"tet4": 6, "tet10": 3}[element]
    coarse, fine = manufactured_errors(element, cells), manufactured_errors(element, 2 * cells)
    return Measured(float(np.log2(coarse[norm] / fine[norm])), element, fine[2])


# Graded modulus ------------------------------------------------------------------------------

A, B, C, D, H = 0.002, 0.003, 0.004, 0.76, 10.0
NU = 0.3
LENGTH = 20.0


def softness(p: Points) -> Float[np.ndarray, " n"]:
    """1/E [1/MPa]."""
    return D + p @ np.array([A, B, C])


def graded_exact(p: Points) -> Points:
    """Displacement under sigma_xx = 1, all other stresses zero.

    It meets the law: du/dx = 1/E, dv/dy = dw/dz = -nu/E, and all three shears vanish.
    """
    x, y, z = p.T
    u = A / 2 * (x**2 + NU * (y**2 + z**2)) + x * (B * y + C * z + D) - NU * A * H / 4 * (y + z)
    v = A * x * y + B / 2 * (y**2 - z**2 + x**2 / NU) + C * y * z + D * y
    w = A * x * z + B * y * z + C / 2 * (z**2 - y**2 + x**2 / NU) + D * z
    v, w = v - A * H / 4 * x - C * H / 4 * z, w + C * H / 4 * y - A * H / 4 * x
    return np.stack([u, -NU * v, -NU * w], axis=1)


@cache
def graded_modulus(*, uniform: bool = False) -> dict[str, Measured]:
    """The modulus at quadrature points; `uniform` replaces it by its mean (a negative control)."""
    mesh = TetMesh.box((LENGTH, H, H), (4, 2, 2), origin=(0.0, -H / 2, -H / 2)).to_tet10()
    x = mesh.quadrature_points
    E = 1 / softness(x.reshape(-1, 3)).reshape(x.shape[:2])
    modulus = np.full_like(E, E.mean()) if uniform else E
    held = [((0, 0, 0), (True, True, True)), ((0, 5, 0), (True, False, True))]
    held += [((0, 0, 5), (True, False, False))]
    supports = [
        Support(
            mesh.nodes_where(lambda p, at=at: np.abs(p - np.array(at)).max(axis=1) < 1e-9),
            np.array(axes),
            np.zeros(3),
        )
        for at, axes in held
    ]
    forces = np.zeros_like(mesh.nodes)
    for end, sign in ((0.0, -1.0), (LENGTH, 1.0)):
        facets = facets_on(mesh, lambda p, end=end: np.abs(p[:, 0] - end) < 1e-9)
        forces += traction_forces(mesh, facets, np.array([sign, 0.0, 0.0]))
    solution = solve_solid(
        SolidProblem.from_supports(mesh, UNIT_MATERIAL, supports, forces, modulus=modulus)
    )
    u, exact = solution.displacement[0], graded_exact(mesh.nodes)
    tip = mesh.nodes_where(lambda p: np.abs(p - np.array([LENGTH, 0, 0])).max(axis=1) < 1e-9)
    return {
        "tip": Measured.on(mesh, u[tip[0], 0]),
        "u": Measured.on(mesh, np.abs(u - exact).max() / np.abs(exact).max()),
        "stress": Measured.on(mesh, furthest(solution.quadrature_stress[..., 0], 1.0)),
    }


BENCHMARKS = (
    Benchmark(
        "Patch test",
        "R. H. MacNeal, R. L. Harder, Finite Elements in Analysis and Design 1 (1985) 3-20, "
        "three-dimensional patch.",
        "Unit cube, E = 1e6 MPa, nu = 0.25; on the boundary u = 1e-3 (2x + y + z)/2, "
        "v = 1e-3 (x + 2y + z)/2, w = 1e-3 (x + y + 2z)/2 mm, so that all strains are 1e-3. Meshes: "
        "the eight inner nodes of the source, and fTetWild's of the cube. Each value is the one "
        "furthest off among all quadrature points and nodes; displacements relative to the largest.",
        tuple(_patch_targets()),
    ),
    Benchmark(
        "Manufactured solution",
        "FeenoX test suite, method of manufactured solutions, linear elasticity.",
        "Unit cube, u = sin(pi x)/10, v = y² z/2, w = x log(1 + y)/5 mm, prescribed on the boundary, "
        "body force by hand. Orders of the errors of displacement (L2) and of its gradient (H1) "
        "between two meshes, 6 and 12 (tet4), 3 and 6 (tet10) cells a side; nodes of the finer.",
        (
            Target("order, L2, tet4", "", 2, 0.15, lambda: order("tet4", 0), "absolute"),
            Target("order, H1, tet4", "", 1, 0.15, lambda: order("tet4", 1), "absolute"),
            Target("order, L2, tet10", "", 3, 0.15, lambda: order("tet10", 0), "absolute"),
            Target("order, H1, tet10", "", 2, 0.15, lambda: order("tet10", 1), "absolute"),
        ),
    ),
    Benchmark(
        "Graded modulus",
        "FeenoX examples, parallelepiped whose Young modulus is a function of the temperature (VPCS "
        "235/89 family).",
        "Box from (0, -5, -5) to (20, 5, 5) mm, 1/E = 0.76 + 0.002 x + 0.003 y + 0.004 z per MPa at "
        "each quadrature point, nu = 0.3; unit tension on both x faces; u = v = w = 0 at the origin, "
        "u = w = 0 at (0, 5, 0), u = 0 at (0, 0, 5). The exact displacement is quadratic. Largest "
        "difference over all nodes relative to the largest displacement; stress furthest off.",
        (
            Target("u at (20, 0, 0)", "mm", 15.6, 0.01, lambda: graded_modulus()["tip"]),
            Target(
                "displacement, difference", "", 0, 0.01, lambda: graded_modulus()["u"], "absolute"
            ),
            Target("sigma_xx", "MPa", 1.0, 0.01, lambda: graded_modulus()["stress"]),
        ),
    ),
)
