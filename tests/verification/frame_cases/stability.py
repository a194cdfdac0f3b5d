"""Buckling and vibration of frames: what targets and tests share, and the targets."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
from jaxtyping import Float, Int
from target import Benchmark, Measured, Target

from fea import FrameProblem, Inertia, buckling, solve_frame, vibration
from fea.sections import AbstractSection, Given, Round

# Any direction: nothing depends on it.
DIRECTION = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)

E, NU, LENGTH, RADIUS = 1000.0, 0.3, 10.0, 0.1
AREA, I = np.pi * RADIUS**2, np.pi / 4 * RADIUS**4
DENSITY = 1e-9
SLENDER = Round(shear_factor=float("inf"))


def cantilever(
    elements: int,
    *,
    section: AbstractSection = SLENDER,
    radius: Callable[[np.ndarray], np.ndarray] = lambda x: np.full_like(x, RADIUS),
    length: float = LENGTH,
) -> FrameProblem:
    """A column, clamped at its first joint, with a unit compression at its last."""
    x = np.linspace(0.0, length, elements + 1)
    struts = np.stack([np.arange(elements), np.arange(1, elements + 1)], axis=1)
    fixed = np.zeros((elements + 1, 6), dtype=bool)
    fixed[0] = True
    forces = np.zeros((1, elements + 1, 6))
    forces[0, -1, :3] = -DIRECTION
    return FrameProblem(
        joints=x[:, None] * DIRECTION,
        struts=struts,
        radii=radius(x)[struts],
        E=E,
        nu=NU,
        section=section,
        fixed=fixed,
        value=np.zeros(fixed.shape),
        forces=forces,
    )


def lowest_factor(frame: FrameProblem) -> float:
    return float(buckling(solve_frame(frame)).factors[0])


def split(frame: FrameProblem, parts: int) -> FrameProblem:
    """Every strut in equal parts, its taper and rigid ends shared out."""
    a, b = frame.joints[frame.struts].swapaxes(0, 1)
    share = np.arange(1, parts) / parts
    between = a[:, None] + share[:, None] * (b - a)[:, None]
    count, struts = len(frame.joints), len(frame.struts)
    number = count + np.arange(struts * (parts - 1)).reshape(struts, parts - 1)
    chain = np.concatenate([frame.struts[:, :1], number, frame.struts[:, 1:]], axis=1)
    step = np.linspace(0, 1, parts + 1)
    radii = frame.radii[:, :1] + step * np.diff(frame.radii, axis=1)
    extra = struts * (parts - 1)

    def grown(field: np.ndarray, axis: int) -> np.ndarray:
        width = [(0, 0)] * field.ndim
        width[axis] = (0, extra)
        return np.pad(field, width)

    return replace(
        frame,
        joints=np.concatenate([frame.joints, between.reshape(-1, 3)]),
        struts=_links(chain),
        radii=_links(radii),
        fixed=grown(frame.fixed, 0),
        value=grown(frame.value, 0),
        forces=grown(frame.forces, 1),
    )


def _links(
    chain: Int[np.ndarray, "struts ends"] | Float[np.ndarray, "struts ends"],
) -> np.ndarray:
    return np.stack([chain[:, :-1], chain[:, 1:]], axis=-1).reshape(-1, 2)


# Elements of each member of the portal.
PORTAL_PARTS = 16


def block(radius_ratio: float) -> FrameProblem:
    """A block of 2 x 2 x 2 body-centred cells on a clamped foot, under a load on its head."""
    cells = np.array([2, 2, 2])
    corner = np.stack(np.meshgrid(*[np.arange(n + 1) for n in cells], indexing="ij"), -1)
    centre = np.stack(np.meshgrid(*[np.arange(n) for n in cells], indexing="ij"), -1)
    joints = np.concatenate([corner.reshape(-1, 3), centre.reshape(-1, 3) + 0.5]) * 10.0
    gap = np.linalg.norm(joints[:, None] - joints[None], axis=2)
    a, b = np.nonzero(np.triu(np.abs(gap - 10 * np.sqrt(3) / 2) < 1e-6))
    struts = np.stack([a, b], axis=1)
    fixed = np.repeat((joints[:, 2] < 1e-6)[:, None], 6, axis=1)
    forces = np.zeros((1, len(joints), 6))
    head = joints[:, 2] > joints[:, 2].max() - 1e-6
    forces[0, head, 2] = -1.0
    forces[0, head, 0] = 0.02  # off the axis of symmetry
    return FrameProblem(
        joints=joints,
        struts=struts,
        radii=np.full((len(struts), 2), 10 * radius_ratio),
        E=70_000.0,
        nu=0.3,
        section=Round(),
        fixed=fixed,
        value=np.zeros(fixed.shape),
        forces=forces,
    )


def portal_sway(base: str) -> float:
    """Lowest buckling load of a portal with "fixed" or "pinned" feet, times L²/EI.

    Equal columns and beam, loads on the columns, so stiff along that the closed form holds to six
    digits.
    """
    L, second = 10.0, 1e-2
    fixed = np.zeros((4, 6), dtype=bool)
    fixed[[0, 3], :3] = True
    if base == "fixed":
        fixed[[0, 3]] = True
    fixed[:, [1, 3, 5]] = True  # a plane frame
    forces = np.zeros((1, 4, 6))
    forces[0, [1, 2], 2] = -1.0
    frame = FrameProblem(
        joints=np.array([[0.0, 0, 0], [0, 0, L], [L, 0, L], [L, 0, 0]]),
        struts=np.array([[0, 1], [1, 2], [2, 3]]),
        radii=np.ones((3, 2)),
        E=E,
        nu=NU,
        section=Given(A=1e4, I=second, J=second),
        fixed=fixed,
        value=np.zeros((4, 6)),
        forces=forces,
    )
    refined = split(frame, PORTAL_PARTS)
    held = refined.fixed.copy()
    held[:, [1, 3, 5]] = True
    return lowest_factor(replace(refined, fixed=held)) * L**2 / (E * second)


@cache
def block_factor(parts: int) -> float:
    """Buckling factor of the lattice block with each strut in so many elements."""
    return lowest_factor(split(block(0.03), parts))


@cache
def slender_frequencies() -> list[float]:
    """The first three of a slender cantilever [Hz], each of which comes twice."""
    return vibration(cantilever(16), Inertia(DENSITY), modes=6).frequencies[::2].tolist()


def column_error(elements: int) -> float:
    """Of the load of a column that is clamped at its foot, against pi² EI/(4 L²)."""
    return lowest_factor(cantilever(elements)) * 4 * LENGTH**2 / (np.pi**2 * E * I) - 1


COLUMN_ERRORS = {1: 0.00752, 2: 0.000512, 4: 3.28e-5, 8: 2.06e-6}
PORTALS = {"fixed": 7.37915, "pinned": 1.82129}
ROOTS = (1.875104, 4.694091, 7.854757)

BENCHMARKS = (
    Benchmark(
        "Euler's column",
        "Closed form pi² EI/(4 L²); errors of Hermite elements with the consistent geometric stiffness.",
        "Clamped at its foot, free at its head, r = 0.1, L = 10 mm, no shear deformation. Relative error of "
        "the lowest buckling load.",
        tuple(
            # Three digits are given.
            Target(
                f"error of {count} element" + "s" * (count > 1),
                "",
                error,
                2e-3,
                lambda count=count: Measured.by_beams(count, column_error(count)),
            )
            for count, error in COLUMN_ERRORS.items()
        ),
    ),
    Benchmark(
        "Portal that sways",
        "S. P. Timoshenko, J. M. Gere, Theory of Elastic Stability, 2nd ed., chapter 2: roots of "
        "k L/tan(k L) = -6 (clamped feet), k L tan(k L) = 6 (hinged feet).",
        "Columns and beam of equal EI and L, a load on either column. Lowest buckling load times L²/EI.",
        tuple(
            Target(
                f"{base} base",
                "",
                load,
                2e-6,
                lambda base=base: Measured.by_beams(3 * PORTAL_PARTS, portal_sway(base)),
            )
            for base, load in PORTALS.items()
        ),
    ),
    Benchmark(
        "Buckling of a lattice block",
        "The same block with every strut in eight elements.",
        "2 x 2 x 2 body-centred cells, r/a = 0.03, clamped foot, pressed at its head. Lowest buckling factor "
        "over that of eight elements a strut.",
        tuple(
            Target(
                f"{parts} element{'s' * (parts > 1)} a strut",
                "",
                1.0,
                tolerance,
                lambda parts=parts: Measured.by_beams(
                    64 * parts, block_factor(parts) / block_factor(8)
                ),
            )
            for parts, tolerance in ((1, 0.01), (2, 1e-3), (4, 1e-4))
        ),
    ),
    Benchmark(
        "Vibration of a cantilever",
        "Closed form (beta L)² sqrt(EI/(rho A L⁴))/(2 pi), beta L = 1.8751, 4.6941, 7.8548.",
        "The slender column above, density 1e-9 tonne/mm³. Rotary inertia lowers the third by 0.1 %.",
        tuple(
            Target(
                f"frequency {mode + 1}",
                "Hz",
                root**2 * float(np.sqrt(E * I / (DENSITY * AREA))) / LENGTH**2 / (2 * np.pi),
                1e-3,
                lambda mode=mode: Measured.by_beams(16, slender_frequencies()[mode]),
            )
            for mode, root in enumerate(ROOTS)
        ),
    ),
)
