"""Closed forms on curved parts: Lamé's cylinder and sphere, Kirsch's hole."""

from functools import cache

import numpy as np
from jaxtyping import Float
from solid_cases.mapped_mesh import ON, facets_on, mapped, slide, welded
from target import Benchmark, Measured, Target, furthest

from fea import (
    Material,
    SolidProblem,
    SolidSolution,
    TetMesh,
    pressure_forces,
    solve_solid,
    traction_forces,
)
from fea.isoparametric import cell_points
from fea.quadrature import TETRAHEDRON_5
from fea.voigt import tensor

Points = Float[np.ndarray, "n 3"]

E = 1000.0


def _along(
    stress: Float[np.ndarray, "n 6"], direction: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, " n"]:
    return np.einsum("ni,nij,nj->n", direction, tensor(stress), direction)


# Cylinder ------------------------------------------------------------------------------------

INNER_RADIUS, OUTER_RADIUS = 3.0, 9.0
SLICE = 0.5
# u(a) of the closed form below, by nu.
CYLINDER_U = {0.3: 4.5825e-3, 0.49: 5.0399e-3, 0.499: 5.0602e-3, 0.4999: 5.0623e-3}


@cache
def cylinder(
    nu: float, *, element: str = "tet10", curved: bool = True, pressure: float = 1.0
) -> dict[str, Measured]:
    """A quarter in plane strain; u and hoop stress at the bore, each where it is furthest off."""

    def polar(s, t, z):
        # Cells grow with the radius as the stress gradient falls.
        r, angle = INNER_RADIUS * (OUTER_RADIUS / INNER_RADIUS) ** s, t * np.pi / 2
        return np.stack([r * np.cos(angle), r * np.sin(angle), SLICE * z], axis=1)

    mesh = mapped((10, 12, 1), polar, element=element, curved=curved)
    x, y, z = mesh.nodes.T
    supports = [
        slide(0, np.abs(x) < ON),
        slide(1, np.abs(y) < ON),
        slide(2, (np.abs(z) < ON) | (np.abs(z - SLICE) < ON)),
    ]
    # Middles of straight edges lie inside the radius.
    bore = facets_on(mesh, lambda p: np.hypot(p[:, 0], p[:, 1]) < INNER_RADIUS + ON)
    forces = pressure_forces(mesh, bore, pressure)
    solution = solve_solid(SolidProblem.from_supports(mesh, Material(E, nu, 0.0), supports, forces))
    at = np.unique(bore)
    radial = mesh.nodes[at] * [1.0, 1.0, 0.0]
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    hoop = _along(solution.stress[0, at], radial[:, [1, 0, 2]] * [-1.0, 1.0, 0.0])
    u = np.einsum("nx,nx->n", solution.displacement[0, at], radial)
    return {
        "u": Measured.on(mesh, furthest(u, CYLINDER_U.get(nu, CYLINDER_U[0.3]))),
        "hoop": Measured.on(mesh, furthest(hoop, 1.25)),
    }


# Sphere --------------------------------------------------------------------------------------

A, B = 1.0, 2.0
SPHERE = {"u_a": 8.0e-4, "u_b": 3.0e-4, "hoop_a": 0.7142857, "hoop_b": 0.2142857}


def octant(cells: int) -> TetMesh:
    """Three mapped boxes, one for each face of the cube that the octant is the corner of."""

    def third(s, t, w):
        # Equal angles rather than equal lengths on the cube's face.
        direction = np.stack([0 * s + 1, np.tan(s * np.pi / 4), np.tan(t * np.pi / 4)], axis=1)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        return direction * (A * (B / A) ** w)[:, None]

    one = mapped((cells, cells, cells), third)
    return welded([TetMesh(np.roll(one.nodes, k, axis=1), one.tets) for k in range(3)])


@cache
def sphere() -> dict[str, Measured]:
    """An octant; u and hoop stress at both radii, each where it is furthest off."""
    mesh = octant(6)
    radius = np.linalg.norm(mesh.nodes, axis=1)
    supports = [slide(k, np.abs(mesh.nodes[:, k]) < ON) for k in range(3)]
    bore = facets_on(mesh, lambda p: np.abs(np.linalg.norm(p, axis=1) - A) < ON)
    forces = pressure_forces(mesh, bore, 1.0)
    solution = solve_solid(
        SolidProblem.from_supports(mesh, Material(E, 0.3, 0.0), supports, forces)
    )
    result = {}
    for name, r in (("a", A), ("b", B)):
        at = np.flatnonzero(np.abs(radius - r) < ON)
        n = mesh.nodes[at] / r
        u = np.einsum("nx,nx->n", solution.displacement[0, at], n)
        stress = solution.stress[0, at]
        # The mean of the two hoop stresses: what of the trace is not radial.
        hoop = (stress[:, :3].sum(axis=1) - _along(stress, n)) / 2
        result[f"u_{name}"] = Measured.on(mesh, furthest(u, SPHERE[f"u_{name}"]))
        result[f"hoop_{name}"] = Measured.on(mesh, furthest(hoop, SPHERE[f"hoop_{name}"]))
    return result


# Hole ----------------------------------------------------------------------------------------

HOLE, HALF_SIDE = 1.0, 4.0
HOLE_NU = 0.3
# Cells round the quarter; the second mesh is twice as fine in the plane.
HOLE_CELLS = (6, 12)


def kirsch_stress(p: Points, nu: float = HOLE_NU) -> Float[np.ndarray, "n 6"]:
    """Kirsch's stress around a hole of radius 1 in an infinite plate under unit tension along x.

    S. P. Timoshenko, J. N. Goodier, Theory of Elasticity, 3rd ed., section 35, in plane strain,
    turned from polar to Cartesian components.
    """
    r, t = np.hypot(p[:, 0], p[:, 1]), np.arctan2(p[:, 1], p[:, 0])
    q2, q4 = (HOLE / r) ** 2, (HOLE / r) ** 4
    cos2, cos4, sin2, sin4 = np.cos(2 * t), np.cos(4 * t), np.sin(2 * t), np.sin(4 * t)
    s = np.zeros((len(p), 6))
    s[:, 0] = 1 - q2 * (1.5 * cos2 + cos4) + 1.5 * q4 * cos4
    s[:, 1] = -q2 * (0.5 * cos2 - cos4) - 1.5 * q4 * cos4
    s[:, 5] = -q2 * (0.5 * sin2 + sin4) + 1.5 * q4 * sin4
    s[:, 2] = nu * (s[:, 0] + s[:, 1])
    return s


def _square_with_hole(s, t, z) -> Points:
    angle = t * np.pi / 2
    circle = HOLE * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    # On the square's edges equal angles too: its corner is a node, its edges stay straight.
    square = circle / np.abs(circle).max(axis=1, keepdims=True) * HALF_SIDE
    # Layers grow with the distance from the hole.
    share = ((HALF_SIDE / HOLE) ** s - 1)[:, None] / (HALF_SIDE / HOLE - 1)
    plane = (1 - share) * circle + share * square
    return np.concatenate([plane, 0.5 * z[:, None]], axis=1)


def _kirsch(cells: int, *, curved: bool) -> SolidSolution:
    """A quarter of the square under the exact tractions, w = 0 on both faces."""
    mesh = mapped((cells, cells, 1), _square_with_hole, curved=curved)
    x, y, z = mesh.nodes.T
    supports = [
        slide(0, np.abs(x) < ON),
        slide(1, np.abs(y) < ON),
        slide(2, (np.abs(z) < ON) | (np.abs(z - 0.5) < ON)),
    ]
    forces = np.zeros_like(mesh.nodes)
    for axis in (0, 1):
        edge = facets_on(mesh, lambda p, axis=axis: np.abs(p[:, axis] - HALF_SIDE) < ON)
        forces += traction_forces(
            mesh, edge, lambda p, axis=axis: tensor(kirsch_stress(p))[:, :, axis]
        )
    material = Material(E, HOLE_NU, 0.0)
    return solve_solid(SolidProblem.from_supports(mesh, material, supports, forces))


def _stress_error(solution: SolidSolution) -> float:
    """L2 norm of the error of the recovered stress relative to that of the stress."""
    mesh, rule = solution.problem.mesh, TETRAHEDRON_5
    x, volume = cell_points(mesh.nodes[mesh.tets], rule)
    shape = mesh.element_type.shape(rule.points)
    recovered = np.einsum("cnv,qn->cqv", solution.stress[0][mesh.tets], shape)
    exact = kirsch_stress(x.reshape(-1, 3)).reshape(recovered.shape)
    # Shears count twice in the norm of a tensor.
    square = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    error = np.einsum("cq,cqv,v->", volume, (recovered - exact) ** 2, square)
    return float(np.sqrt(error / np.einsum("cq,cqv,v->", volume, exact**2, square)))


@cache
def kirsch(*, curved: bool = True) -> dict[str, Measured]:
    """Concentration at the hole's top, order of the recovered stress, its error."""
    coarse, fine = (_kirsch(cells, curved=curved) for cells in HOLE_CELLS)
    mesh = fine.problem.mesh
    top = mesh.nodes_where(lambda p: (np.abs(p[:, 0]) < ON) & (np.abs(p[:, 1] - HOLE) < ON))
    before, after = _stress_error(coarse), _stress_error(fine)
    return {
        "concentration": Measured.on(mesh, furthest(fine.stress[0, top, 0], 3.0)),
        "order": Measured.on(mesh, np.log2(before / after)),
        "error": Measured.on(mesh, after),
    }


BENCHMARKS = (
    Benchmark(
        "Lamé's cylinder",
        "G. Lamé; S. P. Timoshenko, J. N. Goodier, Theory of Elasticity, 3rd ed., section 28, in "
        "plane strain: u(a) = (1 + nu) p a ((1 - 2 nu) a² + b²) / (E (b² - a²)).",
        "Inner radius 3 mm, outer radius 9 mm, E = 1000 MPa, inner pressure 1 MPa, plane strain; a "
        "quarter with edges on the circle. As nu approaches 0.5 elements that lock become stiff. "
        "Values are those furthest off along the bore.",
        (
            *(
                Target(f"u(a), nu = {nu}", "mm", u, 0.01, lambda nu=nu: cylinder(nu)["u"])
                for nu, u in CYLINDER_U.items()
            ),
            Target("hoop stress at a, nu = 0.3", "MPa", 1.25, 0.01, lambda: cylinder(0.3)["hoop"]),
            *(
                Target(
                    f"u(a), nu = {nu}, tet4",
                    "mm",
                    u,
                    None,
                    lambda nu=nu: cylinder(nu, element="tet4")["u"],
                )
                for nu, u in CYLINDER_U.items()
            ),
        ),
    ),
    Benchmark(
        "Lamé's sphere",
        "G. Lamé; S. P. Timoshenko, J. N. Goodier, Theory of Elasticity, 3rd ed., section 136.",
        "Inner radius 1 mm, outer radius 2 mm, E = 1000 MPa, nu = 0.3, inner pressure 1 MPa; an "
        "octant with edges on the spheres. Values are those furthest off on each sphere.",
        tuple(
            Target(
                f"{'u' if name[0] == 'u' else 'hoop stress'} at {name[-1]}",
                "mm" if name[0] == "u" else "MPa",
                value,
                0.01,
                lambda name=name: sphere()[name],
            )
            for name, value in SPHERE.items()
        ),
    ),
    Benchmark(
        "Kirsch's hole",
        "G. Kirsch (1898); S. P. Timoshenko, J. N. Goodier, Theory of Elasticity, 3rd ed., section "
        "35.",
        "Hole of radius 1 mm in a square of side 8 mm, plane strain, nu = 0.3; on the square's edges "
        "the exact tractions of the infinite plate under 1 MPa along x, so that the finite square has "
        "the exact stress of the plate. A quarter, two meshes, 6 and 12 cells round the quarter; "
        "nodes of the finer. Stress recovered at nodes; its error in the L2 norm relative to the "
        "stress.",
        (
            Target("stress concentration", "", 3.0, 0.01, lambda: kirsch()["concentration"]),
            Target(
                "order of the recovered stress, at least",
                "",
                2.0,
                0.15,
                lambda: kirsch()["order"],
                "least",
            ),
            Target(
                "error of the recovered stress",
                "",
                0.0,
                0.01,
                lambda: kirsch()["error"],
                "absolute",
            ),
        ),
    ),
)
