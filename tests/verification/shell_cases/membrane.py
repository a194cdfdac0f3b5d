"""Plates loaded in their plane."""

from functools import cache

import numpy as np
from shell_cases.mapped_skin import CLAMP, mapped_square, solve_skin
from target import Benchmark, Measured, Target

# Cook's membrane -----------------------------------------------------------------------------

IN_PLANE = np.array([0, 0, 1, 1, 1, 0], dtype=bool)


@cache
def cook(divisions: int) -> Measured:
    """Vertical displacement in the middle of the loaded edge."""
    mesh = mapped_square(
        (divisions, divisions),
        lambda s, t: [48 * s, 44 * t * (1 - s) + s * (44 + 16 * t), 0 * s],
        falling=True,
    )
    fixed = mesh.held((mesh.at(), IN_PLANE), (mesh.at(s=0), CLAMP))
    force = mesh.edge_force(mesh.at(s=1), 1, 1.0)
    u = solve_skin(mesh, mesh.skin(1.0, 1.0, 1 / 3), fixed, force).displacement
    return Measured(float(u[0, mesh.node(s=1, t=0.5), 1]), "shell", len(mesh.points))


BENCHMARKS = (
    Benchmark(
        name="Cook's membrane, plane stress, of flat shells",
        source=(
            "R. D. Cook, J. Struct. Div. ASCE 100 (1974) 1851-1863; 23.96 is the converged value that "
            "C. A. Felippa, Comput. Methods Appl. Mech. Eng. 192 (2003) 2125-2168, compares membrane "
            "triangles with"
        ),
        problem=(
            "Trapezium with corners (0, 0), (48, 44), (48, 60), (0, 44), thickness 1, E = 1, nu = 1/3, "
            "clamped on the left, shear force 1 spread over the right."
        ),
        targets=tuple(
            Target(
                f"u_y, middle of the right edge, {n} x {n}",
                "mm",
                23.96,
                # The corner of the clamped edge is singular: the error falls by about 3 a halving, and
                # is 0.35 % here.
                0.005 if n == 32 else None,
                lambda n=n: cook(n),
            )
            for n in (4, 8, 16, 32)
        ),
    ),
)
