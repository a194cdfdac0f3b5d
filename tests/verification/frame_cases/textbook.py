"""Frames with known answers: textbook examples, closed forms, and what must not depend on the axes."""

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation
from target import Benchmark, Measured, Target

from fea import FrameProblem, FrameSolution, compliance_gradient, solve_frame
from fea.assembly import Pattern
from fea.sections import AbstractSection, Given, Round


def frame(
    joints: list[list[float]],
    struts: list[list[int]],
    constants: tuple[float, float, AbstractSection],
    *,
    fixed: dict[int, list[int]],
    forces: dict[int, list[float]],
    radius: float = 1.0,
) -> FrameProblem:
    """A frame from lists: dofs that are fixed, and forces, by joint."""
    E, nu, section = constants
    held = np.zeros((len(joints), 6), bool)
    for joint, dofs in fixed.items():
        held[joint, dofs] = True
    loads = np.zeros((1, len(joints), 6))
    for joint, force in forces.items():
        loads[0, joint] = force
    return FrameProblem(
        joints=np.array(joints, float),
        struts=np.array(struts),
        radii=np.full((len(struts), 2), radius),
        E=E,
        nu=nu,
        section=section,
        fixed=held,
        value=np.zeros((len(joints), 6)),
        forces=loads,
    )


ALL = [0, 1, 2, 3, 4, 5]
# Out of the plane: z, and the rotations about x and y.
PLANE = [2, 3, 4]


@cache
def logan_5_8() -> FrameSolution:
    """Three members at right angles, one of them vertical; G = 10000 with E = 30000 is nu = 0.5."""
    return solve_frame(
        frame(
            [[0, 0, 0], [-100, 0, 0], [0, 0, -100], [0, -100, 0]],
            [[1, 0], [2, 0], [3, 0]],
            (30_000.0, 0.5, Given(A=10.0, I=100.0, J=50.0)),
            fixed={1: ALL, 2: ALL, 3: ALL},
            forces={0: [0, -50, 0, -1000, 0, 0]},
        )
    )


@cache
def logan_5_30() -> FrameSolution:
    """A plane gable frame."""
    return solve_frame(
        frame(
            [[0, 0, 0], [0, 360, 0], [180, 480, 0], [420, 480, 0], [600, 360, 0], [600, 0, 0]],
            [[0, 1], [1, 2], [2, 3], [3, 4], [4, 5]],
            (30_000.0, 0.3, Given(A=12.0, I=200.0, J=1.0)),
            fixed={0: ALL, 5: ALL} | dict.fromkeys([1, 2, 3, 4], PLANE),
            forces={2: [0, -30, 0, 0, 0, 0], 3: [0, -30, 0, 0, 0, 0]},
        )
    )


# Of the Timoshenko cantilever: length, radius, force, E, nu; kappa = 0.9.
CANTILEVER = (30.0, 2.0, 7.0, 70_000.0, 0.33)


def timoshenko_deflection() -> float:
    """P L³/(3 E I) + P L/(kappa G A)."""
    L, r, P, E, nu = CANTILEVER
    I, A, G = np.pi * r**4 / 4, np.pi * r**2, E / (2 * (1 + nu))
    return P * L**3 / (3 * E * I) + P * L / (0.9 * G * A)


def timoshenko_cantilever(axis: list[float]) -> float:
    """Deflection of the tip of one element along an axis, loaded across it."""
    L, r, P, E, nu = CANTILEVER
    t = np.array(axis) / np.linalg.norm(axis)
    across = np.cross(t, [0.3, 0.5, 0.7])
    across /= np.linalg.norm(across)
    problem = frame(
        [[0, 0, 0], list(L * t)],
        [[0, 1]],
        (E, nu, Round(shear_factor=0.9)),
        fixed={0: ALL},
        forces={1: [*(P * across), 0, 0, 0]},
        radius=r,
    )
    return float(solve_frame(problem).displacement[0, 1, :3] @ across)


def space_frame() -> FrameProblem:
    """Edges and face diagonals of a jittered cube, clamped below, forces and moments on top."""
    rng = np.random.default_rng(0)
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T * 10.0
    a, b = np.triu_indices(8, 1)
    near = np.linalg.norm(corners[a] - corners[b], axis=1) < 15
    below = {joint: ALL for joint in range(8) if corners[joint, 2] == 0}
    problem = frame(
        (corners + rng.uniform(-1, 1, (8, 3))).tolist(),
        np.stack([a[near], b[near]], axis=1).tolist(),
        (70e3, 0.3, Round()),
        fixed=below,
        forces={
            j: list(rng.normal(size=6) * [1, 1, 1, 5, 5, 5]) for j in range(8) if j not in below
        },
    )
    return replace(problem, radii=rng.uniform(0.4, 0.9, problem.radii.shape))


def zero_energy_motions() -> float:
    """Eigenvalues of the free frame's stiffness that are rounding."""
    problem = space_frame()
    K = problem.stiffness(Pattern.from_groups(problem.groups, len(problem.joints))).toarray()
    energy = np.linalg.eigvalsh(K)
    return float(np.count_nonzero(np.abs(energy) < 1e-12 * energy[-1]))


def change_by_rotation() -> float:
    """Relative change of the compliance when everything is turned and moved."""
    problem = space_frame()
    turn = Rotation.from_rotvec([0.3, -1.2, 0.8])

    def turned(field: np.ndarray) -> np.ndarray:
        return turn.apply(field.reshape(-1, 3)).reshape(field.shape)

    moved = replace(
        problem,
        joints=turned(problem.joints) + np.array([7.0, -3.0, 11.0]),
        forces=turned(problem.forces),
    )
    return float(solve_frame(moved).compliance[0] / solve_frame(problem).compliance[0] - 1)


def taylor_order(parameter: str) -> float:
    """Order of the remainder of the compliance after its gradient, from the last two of three steps."""
    problem = space_frame()
    v = np.random.default_rng(3).normal(size=problem.parameters[parameter].shape)
    v *= 0.5 if parameter == "joints" else 0.1
    solution = solve_frame(problem)
    slope = float(np.sum(compliance_gradient(solution)[parameter] * v))

    def remainder(h: float) -> float:
        moved = problem.with_parameters({parameter: problem.parameters[parameter] + h * v})
        return abs(float(solve_frame(moved).compliance[0] - solution.compliance[0]) - h * slope)

    return float(np.log2(remainder(5e-3) / remainder(2.5e-3)))


# Struts of `space_frame`.
STRUTS = 24


def _logan_targets() -> tuple[Target, ...]:
    names = ("u_x", "u_y", "u_z", "theta_x", "theta_y", "theta_z")
    expected = (7.098258e-5, -1.399513e-2, -2.351889e-3, -3.996090e-3, 1.780069e-5, -1.033429e-4)
    return tuple(
        Target(
            f"{name} at node 0",
            "in" if dof < 3 else "rad",
            number,
            1e-6,
            lambda dof=dof: Measured.by_beams(3, logan_5_8().displacement[0, 0, dof]),
        )
        for dof, (name, number) in enumerate(zip(names, expected, strict=True))
    )


AXES = {"along x": [1, 0, 0], "upwards": [0, 0, 1], "downwards": [0, 0, -1], "skew": [1, 2, -2]}

BENCHMARKS = (
    Benchmark(
        "Space frame",
        "D. L. Logan, A First Course in the Finite Element Method, 4th ed., example 5.8.",
        "Three members of 100 in along -x, -z and -y from node 0, far ends clamped; E = 30000 and "
        "G = 10000 ksi, A = 10 in², I = 100 in⁴, J = 50 in⁴, no shear deformation; F_y = -50 kip and "
        "M_x = -1000 kip in on node 0. Tolerance: the book's digits.",
        _logan_targets(),
    ),
    Benchmark(
        "Plane gable frame",
        "D. L. Logan, 4th ed., problem 5.30.",
        "Columns of 360 in, rafters to 480 in, span 600 in, feet clamped; E = 30000 ksi, A = 12 in², "
        "I = 200 in⁴; 30 kip down on both ends of the ridge.",
        (
            Target(
                "horizontal reaction",
                "kip",
                11.6877,
                1e-5,
                lambda: Measured.by_beams(5, abs(logan_5_30().reaction[0, 0, 0])),
            ),
            Target(
                "vertical reaction",
                "kip",
                30.0,
                1e-6,
                lambda: Measured.by_beams(5, abs(logan_5_30().reaction[0, 0, 1])),
            ),
            Target(
                "moment at the foot",
                "kip in",
                1810.0745,
                1e-6,
                lambda: Measured.by_beams(5, abs(logan_5_30().reaction[0, 0, 5])),
            ),
            Target(
                "v at node 2",
                "in",
                -6.666757,
                1e-6,
                lambda: Measured.by_beams(5, logan_5_30().displacement[0, 2, 1]),
            ),
        ),
    ),
    Benchmark(
        "Timoshenko's cantilever",
        "Closed form P L³/(3 E I) + P L/(kappa G A).",
        "L = 30, r = 2 mm, P = 7 N across the axis, E = 70000 MPa, nu = 0.33, kappa = 0.9, in one element, "
        "whichever way it points: a vertical member is no special case.",
        tuple(
            Target(
                f"tip deflection, {name}",
                "mm",
                timoshenko_deflection(),
                1e-10,
                lambda axis=axis: Measured.by_beams(1, timoshenko_cantilever(axis)),
            )
            for name, axis in AXES.items()
        ),
    ),
    Benchmark(
        "Invariances",
        "Rigid-body mechanics; Taylor's theorem.",
        "A jittered cube with face diagonals, tapered round struts.",
        (
            Target(
                "zero eigenvalues of the free frame",
                "",
                6.0,
                1e-12,
                lambda: Measured.by_beams(STRUTS, zero_energy_motions()),
            ),
            Target(
                "compliance, change by rotation of everything",
                "",
                0.0,
                1e-10,
                lambda: Measured.by_beams(STRUTS, change_by_rotation()),
                bound="absolute",
            ),
            *(
                Target(
                    f"order of the Taylor remainder, {name}",
                    "",
                    2.0,
                    0.1,
                    lambda name=name: Measured.by_beams(STRUTS, taylor_order(name)),
                    bound="absolute",
                )
                for name in ("joints", "radii")
            ),
        ),
    ),
)
