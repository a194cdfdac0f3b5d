"""Thin square plates: bending, buckling, vibration."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import eigh
from shell_cases.mapped_skin import (
    CLAMP,
    SYMMETRY,
    MappedSkin,
    mapped_square,
    solve_skin,
    whole_matrix,
)
from target import Benchmark, Measured, Target

from fea.shell import Triangle, shell_stiffness
from fea.shell_eigen import shell_geometric_stiffness, shell_mass
from fea.skin_loads import skin_pressure_forces

SIDE, THICKNESS, E, NU, DENSITY = 10.0, 0.01, 70_000.0, 0.3, 2.7e-9
# Bending stiffness of the plate [N mm].
D = E * THICKNESS**3 / 12 / (1 - NU**2)

OUT_OF_PLANE_ONLY = np.array([1, 1, 0, 0, 0, 1], dtype=bool)
DEFLECTION = np.array([0, 0, 1, 0, 0, 0], dtype=bool)
# Along edges of constant s and t, a simply supported plate does not turn along the edge either.
SUPPORTED = {
    "s": np.array([0, 0, 1, 1, 0, 0], dtype=bool),
    "t": np.array([0, 0, 1, 0, 1, 0], dtype=bool),
}

# Deflection of the centre over q a^4/D and P a²/D.
DEFLECTIONS = {
    ("simply supported", "uniform"): 0.00406235,
    ("simply supported", "point"): 0.0116008,
    ("clamped", "uniform"): 0.00126532,
    ("clamped", "point"): 0.00561202,
}
# Four lowest frequencies times a² sqrt(rho h/D).
FREQUENCIES = {
    "simply supported": np.array([2, 5, 5, 8]) * np.pi**2,
    "clamped": np.array([35.992, 73.413, 73.413, 108.27]),
}
# Critical compression in one direction over pi² D/a².
BUCKLING = {"simply supported": 4.0, "clamped": 10.07}


def edges_held(mesh: MappedSkin, support: str, *ends: float) -> np.ndarray:
    """Dofs held where s or t has one of the given values, and those in the plane everywhere."""
    kinds = {"clamped": {"s": CLAMP, "t": CLAMP}, "simply supported": SUPPORTED}[support]
    on_edges = [(mesh.at(**{axis: end}), dofs) for axis, dofs in kinds.items() for end in ends]
    return mesh.held((mesh.at(), OUT_OF_PLANE_ONLY), *on_edges)


@cache
def bending(support: str, load: str, divisions: int) -> Measured:
    """Deflection of the centre, from a quarter of the plate, the centre at s = t = 0."""
    mesh = mapped_square((divisions, divisions), lambda s, t: [s * SIDE / 2, t * SIDE / 2, 0 * s])
    symmetric = mesh.held((mesh.at(s=0), SYMMETRY["x"]), (mesh.at(t=0), SYMMETRY["y"]))
    skin, centre = mesh.skin(THICKNESS, E, NU), mesh.node(s=0, t=0)
    if load == "uniform":
        forces, scale = skin_pressure_forces(skin, mesh.points, -1.0), SIDE**4 / D
    else:
        forces, scale = mesh.point_forces((centre, 2, 0.25)), SIDE**2 / D
    u = solve_skin(mesh, skin, edges_held(mesh, support, 1.0) | symmetric, forces).displacement
    return Measured(float(u[0, centre, 2] / scale), "shell", len(mesh.points))


@jax.jit
def _matrices(triangles: Triangle, corners: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Stiffness, mass, and geometric stiffness under the displacements of the corners."""
    return (
        jax.vmap(lambda each: shell_stiffness(each, E, NU))(triangles),
        jax.vmap(lambda each: shell_mass(each, DENSITY))(triangles),
        jax.vmap(lambda each, u: shell_geometric_stiffness(each, E, NU, u))(triangles, corners),
    )


@cache
def spectra(support: str, divisions: int) -> tuple[np.ndarray, float, int]:
    """Four frequencies and the buckling load of the whole plate, without dimensions; its nodes."""
    mesh = mapped_square((divisions, divisions), lambda s, t: [s * SIDE, t * SIDE, 0 * s])
    triangles = mesh.skin(THICKNESS, E, NU).triangle_values(mesh.points)
    # Compression of 1 N/mm along x, free to expand along y.
    u = np.zeros((len(mesh.points), 6))
    u[:, :2] = mesh.points[:, :2] * [-1, NU] / (E * THICKNESS)
    corners = u[mesh.triangles].reshape(-1, 18)
    free = np.flatnonzero(~edges_held(mesh, support, 0.0, 1.0).ravel())

    def free_matrix(matrices: jax.Array) -> np.ndarray:
        whole = whole_matrix(mesh.triangles, np.asarray(matrices), len(mesh.points))
        return whole[np.ix_(free, free)]

    K, M, G = map(free_matrix, _matrices(triangles, jnp.asarray(corners)))
    last = len(free) - 1
    squares = eigh(M, K, eigvals_only=True, subset_by_index=[last - 3, last])[::-1]
    frequencies = SIDE**2 * np.sqrt(DENSITY * THICKNESS / D / squares)
    factor = 1 / eigh(-G, K, eigvals_only=True, subset_by_index=[last, last])[0]
    return frequencies, float(factor * SIDE**2 / (np.pi**2 * D)), len(mesh.points)


def frequency(support: str, mode: int, divisions: int) -> Measured:
    """One of the lowest frequencies."""
    frequencies, _, nodes = spectra(support, divisions)
    return Measured(float(frequencies[mode]), "shell", nodes)


def buckling(support: str, divisions: int) -> Measured:
    """The critical compression."""
    _, factor, nodes = spectra(support, divisions)
    return Measured(factor, "shell", nodes)


# The error falls as the square of the size of triangles: 0.42 % for the clamped plate under pressure,
# less for the others, with 16 triangles along half a side.
BENDING_TOLERANCE = 0.005
# Likewise: 0.6 % of the clamped plate's first frequency, 2 % of its fourth, with 12 along the side.
FREQUENCY_TOLERANCE = (0.01, 0.02, 0.02, 0.025)
# And 0.1 %, clamped, with 12.
BUCKLING_TOLERANCE = 0.002

BENCHMARKS = (
    Benchmark(
        name="Bending of thin square plates",
        source=(
            "S. Timoshenko, S. Woinowsky-Krieger, Theory of Plates and Shells, 2nd ed. (1959), articles "
            "30, 34, 44: 0.00406, 0.01160, 0.00126, 0.00560; more digits of the clamped plate by "
            "R. L. Taylor, S. Govindjee, Commun. Numer. Meth. Eng. 20 (2004) 757-765, of the supported one "
            "by Navier's series"
        ),
        problem=(
            "Side a, thickness a/1000, nu = 0.3, under a uniform pressure q or a force P at the centre: "
            "deflection of the centre over q a^4/D or P a^2/D, from n x n cells on a quarter."
        ),
        targets=tuple(
            Target(
                f"w, {support}, {load}, n = {n}",
                "",
                expected,
                BENDING_TOLERANCE if n == 16 else None,
                lambda support=support, load=load, n=n: bending(support, load, n),
            )
            for (support, load), expected in DEFLECTIONS.items()
            for n in (4, 8, 16)
        ),
    ),
    Benchmark(
        name="Vibration of thin square plates",
        source="A. W. Leissa, Vibration of Plates, NASA SP-160 (1969), sections 4.1 and 4.2",
        problem=(
            "Side a, thickness h = a/1000, nu = 0.3: circular frequency times a^2 sqrt(rho h/D), from "
            "n x n cells on the whole plate."
        ),
        targets=tuple(
            Target(
                f"frequency {mode + 1}, {support}, n = {n}",
                "",
                float(FREQUENCIES[support][mode]),
                FREQUENCY_TOLERANCE[mode] if n == 12 else None,
                lambda support=support, mode=mode, n=n: frequency(support, mode, n),
            )
            for support in FREQUENCIES
            for mode in (0, 1, 3)
            for n in (6, 12)
        ),
    ),
    Benchmark(
        name="Buckling of thin square plates",
        source=(
            "S. P. Timoshenko, J. M. Gere, Theory of Elastic Stability, 2nd ed. (1961), articles 9.2 "
            "(4, exact) and 9.9 (10.07)"
        ),
        problem=(
            "Side a, nu = 0.3, compressed along one axis and free to expand along the other: critical "
            "force per length over pi^2 D/a^2, from n x n cells on the whole plate."
        ),
        targets=tuple(
            Target(
                f"N, {support}, n = {n}",
                "",
                BUCKLING[support],
                BUCKLING_TOLERANCE if n == 12 else None,
                lambda support=support, n=n: buckling(support, n),
            )
            for support in BUCKLING
            for n in (6, 12)
        ),
    ),
)
